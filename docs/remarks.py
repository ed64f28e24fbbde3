"""The paper's remarks put to the test: `python docs/remarks.py` draws docs/remarks.png, prints numbers."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import dynid
from dynid.errors import NumericalError

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"  # Okabe and Ito: safe for all eyes
DIRECT = "estimator={method: output-error}"
# Of the RMS of three lines of amplitude 100.
RANDOM = "excitation=[{{dof: {}, kind: random, amplitude: 122.5, seed: {}, band: [0, 300]}}]"


def run(name: str, *changes: str):
    """Run a scene with changes."""
    return dynid.run(dynid.load_scene(CONFIGS / f"{name}.yaml", changes))


def bounds(result) -> dict[str, float]:
    """Return the bounds in per cent of the true values."""
    group = "identification/parameters"
    share = 100 * result[f"{group}/cramer_rao"].data / result[f"{group}/true"].data
    return dict(zip(result[f"{group}/name"].data, share, strict=True))


def damping(axes) -> None:
    """Show the bounds on stiffness and damping of the suspension's lower joint over its damping."""
    values = np.geomspace(2, 2000, 13)
    k, c = [], []
    for value in values:
        joint = f"{{dofs: [3, 4], k: {{start: 2.0e4, true: 2.0e4}}, c: {{start: {value}, true: {value}}}}}"
        found = bounds(run("table2", f"joints.lower={joint}", DIRECT))
        k.append(found["lower.k"])
        c.append(found["lower.c"])
    ratio = np.divide(c, k)
    print("damping: c, bound of c over bound of k, k/(c 110)")
    for row in zip(values, ratio, 2e4 / (110 * values), strict=True):
        print("  {:7.1f} {:8.3f} {:8.3f}".format(*row))
    axes.loglog(values, ratio, "o-", color=BLUE, markersize=3, label="bound of c over bound of k, relative")
    axes.loglog(values, 2e4 / (110 * values), "--", color=ORANGE, label="k / (c ω), ω = 110 rad/s")
    axes.axhline(1, color="black", linewidth=0.8)
    axes.axvline(20, color="gray", linewidth=0.8, linestyle=":")
    axes.set(xlabel="damping of the joint (N s/m)", ylabel="ratio")
    axes.legend(frameon=False, fontsize=8)
    axes.set_title("Damping against stiffness (5 % noise)", fontsize=10)


def excitation(axes) -> None:
    """Show the largest bound over the length of the record, for lines and for random forces."""
    lengths = [100, 200, 400, 800, 1600]
    for name, dof, label, colour in (("table2", 5, "suspension", BLUE), ("table4", 2, "beam", ORANGE)):
        lines = [_largest(name, samples) for samples in lengths]
        noise = [
            [_largest(name, samples, RANDOM.format(dof, seed)) for samples in lengths]
            for seed in (1, 2, 3, 4, 5)
        ]
        middle = np.median(noise, axis=0)
        print(f"excitation, {label}: samples, largest bound of lines, of random forces (median of five)")
        for row in zip(lengths, lines, middle, strict=True):
            print("  {:5d} {:8.3f} {:8.3f}".format(*row))
        time = 0.002 * np.array(lengths)
        axes.loglog(time, lines, "o--", color=colour, markersize=3, label=f"{label}, three lines")
        axes.loglog(time, middle, "o-", color=colour, markersize=3, label=f"{label}, random")
    axes.set_xticks(0.002 * np.array(lengths), [f"{0.002 * samples:g}" for samples in lengths])
    axes.minorticks_off()
    axes.set(xlabel="length of the record (s)", ylabel="bound of the least certain parameter (%)")
    axes.legend(frameon=False, fontsize=8)
    axes.set_title("Lines against random forces of the same RMS", fontsize=10)


def _largest(name: str, samples: int, *changes: str) -> float:
    joints = {
        "table2": "{upper: {dofs: [2, 3], k: {start: 2.0e4, true: 2.0e4}, c: {start: 20, true: 20}}, "
        "lower: {dofs: [3, 4], k: {start: 2.0e4, true: 2.0e4}, c: {start: 20, true: 20}}}",
        "table4": "{turn: {dofs: [1], k: {start: 5.0e3, true: 5.0e3}}, "
        "link: {dofs: [3], k: {start: 1.0e4, true: 1.0e4}, c: {start: 20, true: 20}}}",
    }[name]
    result = run(name, f"joints={joints}", f"measurement.samples={samples}", DIRECT, *changes)
    return max(bounds(result).values())


def resonance(axes) -> None:
    """Show what a basis of four modes does to the estimates, by the line that excites the beam."""
    frf = run("beam_reduction", "reduction=[{method: joint-aware, modes: {count: 4}}]", "expect=[]")
    omega, full, reduced = (frf[f"reduction/frf/{name}"].data for name in ("omega", "full", "joint-aware"))
    joints = (
        "joints={turn: {dofs: [theta_1], k: {start: 5.0e3, true: 5.0e3}}, "
        "link: {dofs: [w_6], k: {start: 1.0e4, true: 1.0e4}, c: {start: 20, true: 20}}}"
    )
    lines = np.arange(20, 331, 10)
    errors, mobility = [], []
    for line in lines:
        force = f"excitation=[{{dof: w_4, kind: sine, amplitude: 100, frequency: {line}}}]"
        changes = (joints, force, "reduction={method: joint-aware, modes: {count: 4}}", "expect=[]")
        try:
            result = run("table5", *changes, DIRECT, "measurement.samples=400")
            errors.append(float(result["identification/parameters/error_percent"].data.max()))
        except NumericalError:  # so far off that it explains nothing
            errors.append(np.nan)
        mobility.append(
            [np.interp(line, omega, np.abs(part)) for part in (full[:, 0, 0], (full - reduced)[:, 0, 0])]
        )
    size, left = np.transpose(mobility)
    print("resonance: line, largest error %, error of the FRF %, mobility over the largest")
    for row in zip(lines, errors, 100 * left / size, size / np.abs(full[:, 0, 0]).max(), strict=True):
        print("  {:5d} {:9.3f} {:9.3f} {:9.5f}".format(*row))
    axes.semilogy(lines, errors, "o-", color=BLUE, markersize=3, label="largest error of the joints (%)")
    axes.semilogy(
        lines, 100 * left / size, "o-", color=ORANGE, markersize=3, label="error of the FRF there (%)"
    )
    for natural in (50.35, 96.15, 220.7):
        axes.axvline(natural, color="gray", linewidth=0.8, linestyle=":")
    axes.set(xlabel="line of the excitation (rad/s); dotted: resonances", ylabel="error (%)")
    axes.legend(frameon=False, fontsize=8)
    axes.set_title("Reduced beam, four modes, clean record", fontsize=10)


if __name__ == "__main__":
    figure = Figure(figsize=(13, 4), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    for draw, axes in zip((damping, excitation, resonance), figure.subplots(1, 3), strict=True):
        draw(axes)
    figure.savefig(HERE / "remarks.png", metadata={"Software": None})
