"""Draw docs/beam_reduction.svg from configs/beam_reduction.yaml: `python docs/beam_reduction.py`."""

from pathlib import Path

import numpy as np
from gallery import on_paper

import dynid
from dynid.report.plot import Annotation, Chart, Curve, Markers, PlotAxis, Subplot, series_class
from dynid.result import Result

HERE = Path(__file__).parent
LABELS = {
    "serep": "SEREP on modes without joints (Yang)",
    "guyan": "static condensation (Guyan)",
    "craig-bampton": "Craig–Bampton, 2 modes",
    "joint-aware": "SEREP on modes with joints",
}


def responses(result: Result) -> Subplot:
    """Show the mobility at the force, of the full beam and of each reduced one."""
    group = "reduction/frf"
    omega = result[f"{group}/omega"].data
    layers = [Curve(omega, np.abs(result[f"{group}/full"].data[:, 0, 0]), "full, 15 DOFs", series_class(6))]
    for place, (name, label) in enumerate(LABELS.items()):
        size = result[f"reduction/{name}/T"].data.shape[1]
        response = np.abs(result[f"{group}/{name}"].data[:, 0, 0])
        layers.append(Curve(omega, response, f"{label}, {size}", f"{series_class(place)} fine"))
    x = PlotAxis("angular frequency (rad/s)", low=10, high=400)
    y = PlotAxis("velocity at DOF 6 over force there (m/(s·N))", log=True)
    return Subplot(x, y, layers, "Beam with two joints, full and reduced", weight=2.2)


def errors(result: Result) -> Subplot:
    """Show how far off the first three natural frequencies are."""
    floor = 1e-14
    layers = [Annotation(1, floor, "exact to rounding", shift=(0, -8))]
    for place, name in enumerate(LABELS):
        error = np.maximum(np.abs(result[f"reduction/{name}/frequency_error"].data[:3]), floor)
        layers += [
            Curve([1, 2, 3], error, cls=f"{series_class(place)} fine"),
            Markers([1, 2, 3], error, cls=series_class(place)),
        ]
    x, y = (
        PlotAxis("mode", low=0.8, high=3.2, step=1),
        PlotAxis("relative error of its frequency", log=True, low=1e-15, high=10),
    )
    return Subplot(x, y, layers, "Natural frequencies with the joints")


if __name__ == "__main__":
    found = dynid.run(HERE.parent / "configs/beam_reduction.yaml")
    row = [responses(found), errors(found)]
    chart = Chart([row], width=1100.0, height=320.0)
    picture = chart.picture("beam-reduction", "A beam and its reduced models")
    (HERE / "beam_reduction.svg").write_text(on_paper(picture.svg), encoding="utf-8")
