"""Test the paper's remarks: `python docs/remarks.py` draws docs/remarks.svg and prints the numbers."""

from pathlib import Path

import numpy as np
from gallery import on_paper

import dynid
from dynid.report.plot import Chart, Curve, Markers, PlotAxis, ReferenceLine, Subplot
from dynid.scene.batch import run_alone

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
GROUP = "identification/parameters"
DIRECT = "estimator={method: output-error}"
# Of the RMS of three lines of amplitude 100.
RANDOM = "excitation=[{{dof: {}, kind: random, amplitude: 122.5, seed: {}, band: [0, 300]}}]"


def parameters(name: str, *changes: str) -> dict[str, np.ndarray] | None:
    """Return the arrays of the parameters that a scene with changes identifies; None where it fails."""
    outcome = run_alone(dynid.load_scene(CONFIGS / f"{name}.yaml", changes), {}, (GROUP,))
    if outcome.error:
        return None
    return {path.removeprefix(f"{GROUP}/"): variable.data for path, variable in outcome.values.items()}


def bounds(name: str, *changes: str) -> dict[str, float]:
    """Return the bounds in per cent of the true values."""
    arrays = parameters(name, *changes)
    return dict(zip(arrays["name"], 100 * arrays["cramer_rao"] / arrays["true"], strict=True))


def dotted(x, y, label: str, cls: str) -> list:
    """Return a line with a dot at each of its points."""
    return [Curve(x, y, label, cls), Markers(x, y, cls=cls.partition(" ")[0], size=2.5)]


def damping() -> Subplot:
    """Show the bounds on stiffness and damping of the suspension's lower joint over its damping."""
    values = np.geomspace(2, 2000, 13)
    k, c = [], []
    for value in values:
        joint = f"{{dofs: [3, 4], k: {{start: 2.0e4, true: 2.0e4}}, c: {{start: {value}, true: {value}}}}}"
        found = bounds("table2", f"joints.lower={joint}", DIRECT)
        k.append(found["lower.k"])
        c.append(found["lower.c"])
    ratio = np.divide(c, k)
    print("damping: c, bound of c over bound of k, k/(c 110)")
    for row in zip(values, ratio, 2e4 / (110 * values), strict=True):
        print("  {:7.1f} {:8.3f} {:8.3f}".format(*row))
    layers = [
        ReferenceLine(1.0, cls="hair"),
        ReferenceLine(20.0, cls="hair dashed", upright=True),
        Curve(values, 2e4 / (110 * values), "k / (c ω), ω = 110 rad/s", "s2 dash"),
        *dotted(values, ratio, "bound of c over bound of k, relative", "s1"),
    ]
    x, y = PlotAxis("damping of the joint (N·s/m)", log=True), PlotAxis("ratio", log=True)
    return Subplot(x, y, layers, "Damping against stiffness (5 % noise)")


def excitation() -> Subplot:
    """Show the largest bound over the length of the record, for lines and for random forces."""
    lengths, layers = [100, 200, 400, 800, 1600], []
    for name, dof, label, cls in (("table2", 5, "suspension", "s3"), ("table4", 2, "beam", "s4")):
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
        layers += dotted(time, lines, f"{label}, three lines", f"{cls} dashed")
        layers += dotted(time, middle, f"{label}, random", cls)
    x, y = (
        PlotAxis("length of the record (s)", log=True),
        PlotAxis("bound of the least certain parameter (%)", log=True),
    )
    return Subplot(x, y, layers, "Lines against random forces of the same RMS")


def _largest(name: str, samples: int, *changes: str) -> float:
    joints = {
        "table2": "{upper: {dofs: [2, 3], k: {start: 2.0e4, true: 2.0e4}, c: {start: 20, true: 20}}, "
        "lower: {dofs: [3, 4], k: {start: 2.0e4, true: 2.0e4}, c: {start: 20, true: 20}}}",
        "table4": "{turn: {dofs: [1], k: {start: 5.0e3, true: 5.0e3}}, "
        "link: {dofs: [3], k: {start: 1.0e4, true: 1.0e4}, c: {start: 20, true: 20}}}",
    }[name]
    return max(bounds(name, f"joints={joints}", f"measurement.samples={samples}", DIRECT, *changes).values())


def resonance() -> Subplot:
    """Show what a basis of four modes does to the estimates, by the line that excites the beam."""
    methods = "reduction=[{method: joint-aware, modes: {count: 4}}]"
    frf = dynid.run(dynid.load_scene(CONFIGS / "beam_reduction.yaml", [methods, "expect=[]"]))
    omega, full, reduced = (frf[f"reduction/frf/{name}"].data for name in ("omega", "full", "joint-aware"))
    joints = (
        "joints={turn: {dofs: [theta_1], k: {start: 5.0e3, true: 5.0e3}}, "
        "link: {dofs: [w_6], k: {start: 1.0e4, true: 1.0e4}, c: {start: 20, true: 20}}}"
    )
    lines = np.arange(20, 331, 10)
    errors, mobility = [], []
    for line in lines:
        force = f"excitation=[{{dof: w_4, kind: sine, amplitude: 100, frequency: {line}}}]"
        changes = (
            joints,
            force,
            "reduction={method: joint-aware, modes: {count: 4}, residuals: none}",
            "expect=[]",
        )
        arrays = parameters("table5", *changes, DIRECT, "measurement.samples=400")
        # Some are so far off that they explain nothing.
        errors.append(np.nan if arrays is None else float(arrays["error_percent"].max()))
        mobility.append(
            [np.interp(line, omega, np.abs(part)) for part in (full[:, 0, 0], (full - reduced)[:, 0, 0])]
        )
    size, left = np.transpose(mobility)
    print("resonance: line, largest error %, error of the FRF %, mobility over the largest")
    for row in zip(lines, errors, 100 * left / size, size / np.abs(full[:, 0, 0]).max(), strict=True):
        print("  {:5d} {:9.3f} {:9.3f} {:9.5f}".format(*row))
    layers = [ReferenceLine(natural, cls="hair dashed", upright=True) for natural in (50.35, 96.15, 220.7)]
    layers += dotted(lines, errors, "largest error of the joints (%)", "s6")
    layers += dotted(lines, 100 * left / size, "error of the FRF there (%)", "s5")
    x = PlotAxis("line of the excitation (rad/s); dashed: resonances")
    return Subplot(x, PlotAxis("error (%)", log=True), layers, "Reduced beam, four modes, clean record")


if __name__ == "__main__":
    row = [damping(), excitation(), resonance()]
    chart = Chart([row], width=1300.0, height=300.0)
    picture = chart.picture("remarks", "The paper's remarks put to the test")
    (HERE / "remarks.svg").write_text(on_paper(picture.svg), encoding="utf-8")
