"""Write docs/gallery.md and the figures in docs/gallery of scenes; with --pictures the figures alone."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import dynid
from dynid.report import Figure, figures

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"


class Entry(NamedTuple):
    """A figure of the gallery: a scene, values that it is given, the figure's name, and what it is."""

    scene: str
    overrides: tuple[str, ...]
    figure: str
    about: str


#: Yang's suspension with the responses at its sensors; his beam without joints, reduced as he does.
SENSORS = (
    "analysis={inputs: [5], outputs: [{dof: 2, quantity: velocity}, {dof: 3, quantity: velocity}], "
    "frequency: {start: 10, stop: 300, points: 600}}",
)
PAPERS_BASIS = (
    "reduction=[{method: serep, masters: [1, 6, 10], modes: [2, 3, 4]}]",
    "joints={}",
    "expect=[]",
)

ENTRIES = (
    Entry("isolator", (), "prototype-m_s.f", "Park & Kim, Figs. 1 and 2: the prototype of a reduction"),
    Entry("isolator_port", (), "port-dynamics", "Park & Kim, Figs. 3 and 4: path and free motion"),
    Entry("isolator_port", (), "equivalent-source", "Park & Kim, Fig. 5: equivalent sources of one side"),
    Entry("isolator", (), "bond-graph", "Park & Kim, Fig. 6(b): the passive tuned isolator"),
    Entry("isolator_port", (), "bond-graph", "the same, cut into source and load at a port (section 4)"),
    Entry("isolator", (), "reduction-m_s.f", "Park & Kim, Figs. 6(b) to 8(b): its reduction"),
    Entry("isolator", (), "bode", "its frequency response"),
    Entry("isolator", (), "poles-m_s.f-v_in", "its poles and zeros (eqs 20, 21)"),
    Entry("isolator", (), "time-response", "its response to a step"),
    Entry("isolator_transmissibility", (), "bode", "the isolator before and after its loops are closed"),
    Entry(
        "isolator_transmissibility",
        (),
        "loop-nyquist",
        "the Nyquist diagrams of its loops, with their delays",
    ),
    Entry("isolator_port", (), "port-impedances", "impedances of source and load"),
    Entry("isolator_port", (), "performance", "source and load characteristics"),
    Entry("beam_joints", (), "structure", "Yang, Figs. 1 and 6: a beam on a pin, with joints"),
    Entry("table2", (), "structure", "Yang, Fig. 3: the suspension with two joints"),
    Entry("table2", SENSORS, "bode", "Yang, Fig. 4: its responses at the sensors"),
    Entry("table1", (), "history", "Yang, Fig. 5: its joints, identified"),
    Entry("table2", (), "history", "the same with 5 % noise (Table 2)"),
    Entry("table2", (), "estimates", "its estimates with the Cramér–Rao bounds"),
    Entry("table2", (), "prediction", "measured and predicted values"),
    Entry(
        "beam_reduction", PAPERS_BASIS, "reduction-frf", "Yang, Fig. 7: the beam before and after reduction"
    ),
    Entry("beam_reduction", (), "reduction-frf", "the beam with its joints, reduced in five ways"),
    Entry("beam_reduction", (), "mac", "how alike their modes are"),
    Entry("table3", (), "history", "Yang, Fig. 8: the beam's joints, identified"),
    Entry("table3", (), "state-error", "Yang, Fig. 9: state estimation error"),
    Entry("table4", (), "history", "Yang, Fig. 10: the beam's joints with 8 % noise"),
    Entry("beam_joints", (), "modes-animated", "the beam's modes"),
    Entry("beam_joints", (), "correlation", "correlations of its joint parameters"),
    Entry("beam_frf", (), "fit", "joints from measured frequency responses"),
    Entry("dc_motor", (), "nyquist", "a motor: every input to every output"),
    Entry(
        "lattice_all_pass",
        (),
        "poles-R.e-source",
        "a lattice: uncontrollable or unobservable (hidden) modes, a zero on the right",
    ),
    Entry("two_tank", (), "bond-graph", "water in two tanks"),
    Entry("loudspeaker", (), "bond-graph", "a loudspeaker: electrical, mechanical, acoustical"),
    Entry("lattice_all_pass", (), "bond-graph", "a lattice: junctions in a ring"),
    Entry("half_car", (), "bond-graph", "half a car: junctions in a ring, with trees on it"),
    Entry("beam_reduction", (), "structure", "the beam's masters, its load and its sensors"),
    Entry(
        "studies/isolator_tuning",
        (),
        "map",
        "a study: the isolator's notch and resonance over two parameters",
    ),
    Entry("studies/isolator_tuning", (), "tornado", "what they depend on"),
    Entry("studies/table2_monte_carlo", (), "parallel", "a study: Table 2 over forty records"),
    Entry("studies/table2_monte_carlo", (), "scatter", "how its estimates go together"),
)


def on_paper(svg: str) -> str:
    """Return a figure on a ground of its own, light or dark as its reader prefers."""
    x, y, width, height = re.search(r'viewBox="([^"]+)"', svg)[1].split()
    ground = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" class="paper"/>'
    return svg.replace("</style>", f"</style>\n{ground}", 1)


def result_of(entry: Entry, folder: Path) -> dynid.Result:
    """Run the scene of an entry; a study as its command does, into a folder."""
    scene = CONFIGS / f"{entry.scene}.yaml"
    if not entry.scene.startswith("studies/"):
        return dynid.run(dynid.load_scene(scene, entry.overrides))
    target = folder / f"{scene.stem}.h5"
    subprocess.run([sys.executable, "-m", "dynid", "study", scene, "-o", target, "-q"], check=True)
    return dynid.open_result(target)


def main() -> None:
    """Write every figure, and the page that shows them."""
    folder = HERE / "gallery"
    folder.mkdir(exist_ok=True)
    results: dict[tuple[str, tuple[str, ...]], dict[str, Figure]] = {}
    names: set[str] = set()
    how = "Written by `python docs/gallery.py` from the scenes in `configs/`; a click shows its full size."
    lines = ["# Gallery", "", how, ""]
    with tempfile.TemporaryDirectory() as scratch:
        for entry in ENTRIES:
            key = (entry.scene, entry.overrides)
            if key not in results:
                found = result_of(entry, Path(scratch))
                results[key] = {figure.name: figure for figure in figures(found)}
            figure = results[key][entry.figure]
            name = f"{Path(entry.scene).name}-{entry.figure}"
            name = f"{name}-2.svg" if f"{name}.svg" in names else f"{name}.svg"
            names.add(name)
            (folder / name).write_text(on_paper(figure.svg), encoding="utf-8")
            heading = f"{entry.about[0].upper()}{entry.about[1:]}"
            lines += [f"## {heading}", "", f"[![{figure.title}](gallery/{name})](gallery/{name})", ""]
            lines += [f"{figure.caption} (`configs/{entry.scene}.yaml`)", ""]
    for old in folder.glob("*.svg"):
        if old.name not in names:
            old.unlink()
    if sys.argv[1:] != ["--pictures"]:
        (HERE / "gallery.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
