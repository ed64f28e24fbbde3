"""Draw docs/beam_reduction.png from configs/beam_reduction.yaml: `python docs/beam_reduction.py`."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import dynid

HERE = Path(__file__).parent
# Okabe and Ito: safe for all eyes.
STYLES = {
    "serep": ("#D55E00", "SEREP on modes without joints (Yang)"),
    "guyan": ("#CC79A7", "static condensation (Guyan)"),
    "craig-bampton": ("#009E73", "Craig–Bampton, 2 modes"),
    "joint-aware": ("#0072B2", "SEREP on modes with joints"),
}


def responses(axes, result) -> None:
    """Show the mobility at the force, of the full beam and of each reduced one."""
    group = "reduction/frf"
    omega = result[f"{group}/omega"].data
    full = np.abs(result[f"{group}/full"].data[:, 0, 0])
    axes.semilogy(omega, full, color="black", linewidth=3, alpha=0.35, label="full, 15 DOFs")
    for name, (colour, label) in STYLES.items():
        size = result[f"reduction/{name}/T"].data.shape[1]
        response = np.abs(result[f"{group}/{name}"].data[:, 0, 0])
        axes.semilogy(omega, response, color=colour, linewidth=1.1, label=f"{label}, {size}")
    axes.set(xlabel="frequency (rad/s)", ylabel="velocity at DOF 6 over force there (m/s/N)", xlim=(10, 400))
    axes.legend(frameon=False, fontsize=8, loc="upper right")
    axes.set_title("Beam with two joints, full and reduced", fontsize=11)


def errors(axes, result) -> None:
    """Show how far off the first three natural frequencies are."""
    floor = 1e-14
    for name, (colour, _) in STYLES.items():
        error = np.abs(result[f"reduction/{name}/frequency_error"].data[:3])
        axes.semilogy([1, 2, 3], np.maximum(error, floor), "o-", color=colour, linewidth=1.1)
    axes.annotate("exact to rounding", (1, floor), xytext=(0, 6), textcoords="offset points", fontsize=8)
    axes.set(xlabel="mode", ylabel="relative error of its frequency", xticks=[1, 2, 3], ylim=(1e-15, 10))
    axes.set_title("Natural frequencies with the joints", fontsize=11)


if __name__ == "__main__":
    found = dynid.run(HERE.parent / "configs/beam_reduction.yaml")
    figure = Figure(figsize=(11, 4.2), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=[2.2, 1])
    responses(left, found)
    errors(right, found)
    figure.savefig(HERE / "beam_reduction.png", metadata={"Software": None})
