"""Draw docs/overview.png, the figure of the README: `python docs/overview.py`."""

from pathlib import Path

import numpy as np

import dynid
from dynid.report.figure import as_file
from dynid.report.plot import (
    Annotation,
    BandLayer,
    Chart,
    Curve,
    PlotAxis,
    ReferenceLine,
    Subplot,
    series_class,
)

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"


def isolator() -> Subplot:
    """Show how much of the base's motion the mass sees."""
    result = dynid.run(CONFIGS / "isolator.yaml")
    group = "bond_graph/frequency_response"
    hertz = result[f"{group}/omega"].data / (2 * np.pi)
    zeros = result["bond_graph/transfer_function/m_s.f/v_in/zeros"].data
    notch = abs(zeros[0]) / (2 * np.pi)
    layers = [
        Curve(hertz, np.abs(result[f"{group}/response"].data[:, 0, 0]), cls="s7"),
        ReferenceLine(notch, cls="s2 dashed fine", upright=True),
        Annotation(notch, 8, f"zero at {notch:.2f} Hz", cls="small s2", shift=(6, 0)),
    ]
    x, y = PlotAxis("frequency (Hz)", log=True), PlotAxis("|v_s / v_in|", log=True, low=1e-4, high=20)
    return Subplot(x, y, layers, "Passive tuned isolator, from its bond graph")


def suspension() -> Subplot:
    """Show the filter pass from half the true joint values, in percent of these."""
    result = dynid.run(CONFIGS / "suspension_noisy.yaml")
    group = "identification/history"
    time = result[f"{group}/time"].data
    truth = result["identification/parameters/true"].data
    histories, bands = (
        100 * result[f"{group}/{name}"].data / truth for name in ("estimate", "standard_deviation")
    )
    layers = [ReferenceLine(100.0, cls="line dashed")]
    for k, name in enumerate(result[f"{group}/parameter"].data):
        layers.append(
            BandLayer(time, histories[:, k] - bands[:, k], histories[:, k] + bands[:, k], cls=series_class(k))
        )
        layers.append(Curve(time, histories[:, k], name, series_class(k)))
    x, y = (
        PlotAxis("time (s)", low=0, high=time[-1]),
        PlotAxis("estimate (% of the true value)", low=40, high=140),
    )
    return Subplot(x, y, layers, "Joints of a suspension, from a record with 5 % noise")


if __name__ == "__main__":
    chart = Chart([[isolator(), suspension()]], width=1100.0, height=260.0)
    picture = chart.picture("overview", "A bond graph in frequency, joints over time")
    (HERE / "overview.png").write_bytes(as_file(picture.svg, "png"))
