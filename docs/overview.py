"""Draw docs/overview.png, the figure of the README: `python docs/overview.py`."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import dynid

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"  # Okabe and Ito: safe for all eyes


def isolator(axes) -> None:
    """Show how much of the base's motion the mass sees."""
    result = dynid.run(CONFIGS / "isolator.yaml")
    group = "bond_graph/frequency_response"
    hertz = result[f"{group}/omega"].data / (2 * np.pi)
    axes.loglog(hertz, np.abs(result[f"{group}/response"].data[:, 0, 0]), color=BLUE)
    zeros = result["bond_graph/transfer_function/m_s.f/v_in/zeros"].data
    notch = abs(zeros[0]) / (2 * np.pi)
    axes.axvline(notch, color=ORANGE, linewidth=0.8, linestyle="--")
    axes.text(notch * 1.06, 3, f"zero at\n{notch:.2f} Hz", color=ORANGE, va="top")
    axes.set(xlabel="frequency (Hz)", ylabel="|v_s / v_in|", ylim=(1e-4, 20), xlim=(hertz[0], hertz[-1]))
    axes.set_title("Passive tuned isolator, from its bond graph", fontsize=11)


def suspension(axes) -> None:
    """Show the filter pass from half the true joint values, in percent of these."""
    result = dynid.run(CONFIGS / "suspension_noisy.yaml")
    group = "identification/history"
    time = result[f"{group}/time"].data
    truth = result["identification/parameters/true"].data
    histories = result[f"{group}/estimate"].data / truth
    bands = result[f"{group}/standard_deviation"].data / truth
    names = result[f"{group}/parameter"].data
    for k, (name, colour) in enumerate(zip(names, (BLUE, ORANGE, GREEN, PURPLE), strict=True)):
        low, high = (100 * (histories[:, k] + sign * bands[:, k]) for sign in (-1, 1))
        axes.fill_between(time, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(time, 100 * histories[:, k], color=colour, label=name)
    axes.axhline(100, color="black", linewidth=0.8, linestyle="--")
    axes.set(xlabel="time (s)", ylabel="estimate (% of the true value)", xlim=(0, time[-1]), ylim=(40, 140))
    axes.legend(ncols=2, frameon=False)
    axes.set_title("Joints of a suspension, from a record with 5 % noise", fontsize=11)


if __name__ == "__main__":
    figure = Figure(figsize=(11, 3.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    isolator(left)
    suspension(right)
    figure.savefig(HERE / "overview.png", metadata={"Software": None})
