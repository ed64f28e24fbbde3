"""Write docs/gallery.md and the figures in docs/gallery from the scenes: `python docs/gallery.py`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import dynid
from dynid.report import figures

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"


class Entry(NamedTuple):
    """A figure of the gallery: a scene, values that it is given, the figure's name, and what it is."""

    scene: str
    overrides: tuple[str, ...]
    figure: str
    about: str


#: Park & Kim's example with the domains of its parts.
DOMAINS = ("graph.nodes.base={type: 0, domain: mechanical}", "graph.nodes.fluid={type: 1, domain: hydraulic}")

ENTRIES = (
    Entry("isolator", DOMAINS, "bond-graph", "Park & Kim, Fig. 6(b): the passive tuned isolator"),
    Entry("isolator_port", DOMAINS, "bond-graph", "the same, cut into source and load at a port (section 4)"),
    Entry("isolator", DOMAINS, "reduction-m_s.f", "Park & Kim, Figs. 6(b) to 8(b): its reduction"),
    Entry("isolator", (), "prototype-m_s.f", "Park & Kim, Figs. 1 and 2: the prototype that it ends in"),
    Entry("two_tank", (), "bond-graph", "water in two tanks"),
    Entry("loudspeaker", (), "bond-graph", "a loudspeaker: electrical, mechanical, acoustical"),
    Entry("lattice_all_pass", (), "bond-graph", "a lattice: junctions in a ring"),
    Entry("half_car", (), "bond-graph", "half a car: junctions in a ring, with trees on it"),
    Entry("beam_joints", (), "structure", "Yang, Figs. 1 and 6: a beam on a pin, with joints"),
    Entry("table2", (), "structure", "Yang, Fig. 3: the suspension with two joints"),
    Entry("beam_reduction", (), "structure", "the beam's masters, its load and its sensors"),
)


def main() -> None:
    """Write every figure, and the page that shows them."""
    folder = HERE / "gallery"
    folder.mkdir(exist_ok=True)
    results = {}
    lines = ["# Gallery", "", "Made by `python docs/gallery.py` from the scenes in `configs/`.", ""]
    for entry in ENTRIES:
        key = (entry.scene, entry.overrides)
        if key not in results:
            scene = dynid.load_scene(CONFIGS / f"{entry.scene}.yaml", entry.overrides)
            results[key] = {figure.name: figure for figure in figures(dynid.run(scene))}
        figure = results[key][entry.figure]
        name = f"{entry.scene}-{entry.figure}.svg"
        (folder / name).write_text(figure.svg, encoding="utf-8")
        lines += [
            f"## {entry.about[0].upper()}{entry.about[1:]}",
            "",
            f"![{figure.title}](gallery/{name})",
            "",
        ]
        lines += [f"{figure.caption} (`configs/{entry.scene}.yaml`)", ""]
    (HERE / "gallery.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
