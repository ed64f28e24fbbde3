"""Write docs/tables.md, the tables of the paper, and its figures; with --pictures the figures alone."""

import sys
from pathlib import Path

import numpy as np
from gallery import on_paper

import dynid
from dynid.errors import NumericalError
from dynid.report.plot import BandLayer, Chart, Curve, PlotAxis, ReferenceLine, Subplot, series_class
from dynid.scene.kinds.structures import build_structure
from dynid.structure.ports import Channel
from dynid.structure.response import frequency_response

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
# The errors that the paper prints, %; 2 with its misprints put right.
PAPER = {
    1: {"upper.k": 0.50, "lower.k": 0.45, "upper.c": 1.15, "lower.c": 0.90},
    2: {"upper.k": 1.55, "lower.k": 1.55, "upper.c": 13.07, "lower.c": 2.82},
    3: {"turn.k": 0.02, "link.k": 0.3, "link.c": 1.05},
    4: {"turn.k": 0.1, "link.k": 0.3, "link.c": 2.0},
    5: {"turn.k": 17.5, "link.k": 34.6, "link.c": 41.5},
    6: {"turn.k": 1.08, "link.k": 1.40, "link.c": 1.95},
}
RADIANS = PlotAxis("angular frequency (rad/s)")
PAPERS_BASIS = "reduction={method: serep, masters: [1, 6, 10], modes: [2, 3, 4]}"
NOISE = "measurement.simulate.noise_ratio=0.05"
HEADER = """\
# The tables of the paper

Written by `python docs/tables.py` from `configs/table1.yaml` … `table6.yaml`. Errors are those of one
record (noise seed 1, start values half the true values); the bound is the Cramér–Rao bound on the
standard error, at the true values, with the initial state unknown. Tables 2 and 4 over 2,000 records:
[Errors over many records](monte_carlo.md). If the paper does not state step, duration and amplitude, they
are 0.002 s, 800 samples and 100 N. An error of the paper below the bound (Table 4) belongs to another
record. A clean record has no bound: its residuals are round-off.
"""
FIGURES = """\
![Joints of the suspension over the first pass.](tables-suspension.svg)
![Joints of the beam over the first pass.](tables-beam.svg)
![The rotation at the pin, which is not measured.](tables-state.svg)
![Responses of the full and of reduced beams.](tables-reduced.svg)
![Responses of the suspension at its sensors.](tables-sensors.svg)

The curves of the paper's figures: parameters over the first pass of the filter (Figs 5, 8, 10; stored
under `identification/history`, or `first_pass` if there are several passes), the unmeasured rotation at
the pin (Fig. 9), the mobility of the beam with joints, full and reduced (Fig. 7), and the mobilities of
the suspension between force and sensors, with the joints at their true values and at the starts (Fig. 4).
"""


def run(number: int, *changes: str):
    """Run the scene of a table."""
    return dynid.run(dynid.load_scene(CONFIGS / f"table{number}.yaml", changes))


def column(result, name: str) -> np.ndarray:
    """Return a column of the parameters."""
    return result[f"identification/parameters/{name}"].data


def percent(value: float) -> str:
    """Write a percentage with two digits; below a millionth its order only."""
    if value == 0:
        return "—"
    return f"{value:.0e} %" if value < 1e-3 else f"{value:.2g} %"


def table(number: int, title: str, result, others: dict | None = None) -> str:
    """Return a table: the paper's error, ours, the bound, and other runs beside them."""
    others = others or {}
    heads = ["parameter", "true", "the paper", "dynid", "bound", *others]
    rows = [heads, ["---"] * len(heads)]
    bound = 100 * column(result, "cramer_rao") / column(result, "true")
    for k, name in enumerate(column(result, "name")):
        row = [name, f"{column(result, 'true')[k]:g} {column(result, 'unit')[k]}"]
        row += [f"{PAPER[number][name]:g} %", percent(column(result, "error_percent")[k]), percent(bound[k])]
        rows.append([*row, *(values[k] for values in others.values())])
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([f"## Table {number}: {title}", "", *lines, ""])


def reduced(number: int, title: str, result) -> str:
    """Return a table of a reduced model: with noise, and with the basis that the paper took."""
    noisy = run(number, NOISE)
    try:
        paper = list(map(percent, column(run(number, PAPERS_BASIS), "error_percent")))
    except NumericalError:  # the prediction does not explain the record
        paper = ["refused"] * len(column(result, "name"))
    group = "identification/model_error"
    shift, left = (100 * np.abs(noisy[f"{group}/{name}"].data) for name in ("shift", "noise_error"))
    estimate = column(noisy, "estimate")
    others = {
        "the paper's basis": paper,
        "with 5 % noise": list(map(percent, column(noisy, "error_percent"))),
        "moved by the basis": list(map(percent, shift / estimate)),
        "left by the noise": list(map(percent, left / estimate)),
    }
    size = len(result[f"{group}/mode"].data)
    warning = result.value(f"{group}/warning")
    said = (
        f"{size} coordinates: modes chosen by the band of the excitation, and residual vectors at joints, "
        "sensors and\nforce; recomputed as the joints converge."
    )
    warned = [f"The run says: *{warning}*."] if warning else []
    return "\n".join([table(number, title, result, others), said, *warned, ""])


def history(result, title: str) -> Subplot:
    """Show the parameters over the first pass, in percent of their true values."""
    group = "identification/first_pass"
    if f"{group}/estimate" not in result:
        group = "identification/history"
    time, true = result[f"{group}/time"].data, column(result, "true")
    estimate, deviation = (
        100 * result[f"{group}/{name}"].data / true for name in ("estimate", "standard_deviation")
    )
    layers = [ReferenceLine(100.0, cls="line dashed")]
    for k, name in enumerate(column(result, "name")):
        layers.append(
            BandLayer(
                time, estimate[:, k] - deviation[:, k], estimate[:, k] + deviation[:, k], cls=series_class(k)
            )
        )
        layers.append(Curve(time, estimate[:, k], name, series_class(k)))
    x, y = (
        PlotAxis("time (s)", low=0, high=time[-1]),
        PlotAxis("estimate (% of the true value)", low=40, high=140),
    )
    return Subplot(x, y, layers, title)


def hidden_state(result) -> Subplot:
    """Show the rotation at the pin as estimated in the pass, and as it was."""
    unseen = "measurement.channels=[{dof: 1, quantity: displacement}, {dof: 2, quantity: velocity}]"
    truth = run(3, unseen)["identification/measurement/measured"].data[:, 0]
    group = "identification/history"
    time, state = result[f"{group}/time"].data, result[f"{group}/state"].data[:, 0]
    layers = [
        Curve(time, 1e3 * truth, "true", series_class(6)),
        Curve(time, 1e3 * state, "filter, 8 % noise", "s1 fine"),
    ]
    size = 1.6e3 * np.abs(truth).max()
    return Subplot(
        PlotAxis("time (s)", low=0, high=1),
        PlotAxis("rotation at the pin (mrad)", low=-size, high=size),
        layers,
    )


def suspension_responses() -> Subplot:
    """Show the mobilities between force and sensors, with the joints as they are and as they start."""
    scene = dynid.load_scene(CONFIGS / "table1.yaml")
    structure = build_structure(scene, scene.model.structure, scene.model.joints)
    omega = np.linspace(10, 300, 600)
    sensors = [Channel(2, "velocity"), Channel(3, "velocity")]
    starts = {unknown.name: unknown.start for unknown in structure.unknowns}
    layers = [ReferenceLine(line, cls="hair dashed", upright=True) for line in (70, 110, 250)]
    for values, style, words in ((structure.true_values(), "", "true"), (starts, " dashed", "start")):
        found = frequency_response(structure, [5], sensors, omega, values)
        response = np.abs(found["structure/frequency_response/response"].data[:, :, 0])
        for k, sensor in enumerate(sensors):
            label = f"DOF {sensor.dof}, joints at their {words} values"
            layers.append(Curve(omega, response[:, k], label, f"{series_class(k)}{style}"))
    return Subplot(RADIANS, PlotAxis("mobility from DOF 5 (m/(s·N))", log=True), layers)


def responses() -> Subplot:
    """Show the mobility at the force of the full beam with joints and of two reduced ones."""
    result = dynid.run(CONFIGS / "beam_reduction.yaml")
    omega = result["reduction/frf/omega"].data
    labels = {
        "full": ("full", series_class(6)),
        "serep": ("modes without joints (the paper)", "s2 fine"),
        "joint-aware": ("modes with joints", "s1 fine"),
    }
    layers = [ReferenceLine(line, cls="hair dashed", upright=True) for line in (45, 250, 300)]
    for name, (label, cls) in labels.items():
        layers.append(Curve(omega, np.abs(result[f"reduction/frf/{name}"].data[:, 0, 0]), label, cls))
    return Subplot(RADIANS, PlotAxis("mobility at the force (m/(s·N))", log=True), layers)


def save(name: str, title: str, *row: Subplot) -> None:
    """Write one figure."""
    picture = Chart([row], width=1000.0 if len(row) > 1 else 760.0).picture(f"tables-{name}", title)
    (HERE / f"tables-{name}.svg").write_text(on_paper(picture.svg), encoding="utf-8")


def page(results: dict) -> str:
    """Return the page of all tables."""
    parts = [
        HEADER,
        table(1, "suspension, clean", results[1]),
        table(2, "suspension, 5 % noise", results[2]),
        table(3, "beam of eq 25, clean", results[3]),
        table(4, "beam of eq 25, 8 % noise", results[4]),
        reduced(5, "full beam, reduced model, lines at 45, 250, 300 rad/s", results[5]),
        reduced(6, "full beam, reduced model, random force", results[6]),
        "## Figures\n",
        FIGURES,
    ]
    return "\n".join(parts)


def main() -> None:
    """Run everything once; write the tables and draw the figures, which are of the first four."""
    pictures = sys.argv[1:] == ["--pictures"]
    results = {number: run(number) for number in ((1, 2, 3, 4) if pictures else PAPER)}
    if not pictures:
        (HERE / "tables.md").write_text(page(results), encoding="utf-8")
    save(
        "suspension",
        "Joints of the suspension, identified",
        history(results[1], "Fig. 5: clean"),
        history(results[2], "5 % noise (Table 2)"),
    )
    save(
        "beam",
        "Joints of the beam, identified",
        history(results[3], "Fig. 8: clean"),
        history(results[4], "Fig. 10: 8 % noise"),
    )
    save("state", "Fig. 9: a state that is not measured", hidden_state(results[4]))
    save("reduced", "Fig. 7: responses of full and reduced beam; dashed: lines of Table 5", responses())
    save("sensors", "Fig. 4: responses at the sensors; dashed: lines of the force", suspension_responses())


if __name__ == "__main__":
    main()
