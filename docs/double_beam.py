"""Identify the measured double beam with linear joints, and show their limits: `python docs/double_beam.py`.

Writes docs/double_beam.md. The data are not part of the project, see configs/measured/double_beam.yaml.
"""

from pathlib import Path

import numpy as np
from scipy.optimize import least_squares, root

import dynid
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import RecordData
from dynid.identification.systems.parametric_model import parametric_model
from dynid.scene.kinds.measurements import experiments
from dynid.scene.kinds.structures import build_structure

HERE = Path(__file__).parent
SCENE = HERE.parent / "configs/measured/double_beam.yaml"
TRAINED, HELD = (1, 2, 3, 5, 6, 7, 9, 10, 11), (4, 8, 12)
STEP, LENGTH = 1.953e-4, 2048  # s; samples of a window on the way down: 0.4 s
HEAD = 512
MASSES = (1.0, 0.25)  # those of the scene
HEADER = """\
# The measured double beam

Written by `python docs/double_beam.py` from `configs/measured/double_beam.yaml`: a model of two masses
and two joints, whose stiffness and damping are identified from nine free decays. Three further decays,
one for each point of impact, are predicted.
"""
WHY = """\
The model has two masses because one sensor without a force identifies only what all free decays share:
the poles. Two pairs of poles lie below 300 Hz, which are four numbers, as many as two joints have. A
finite-element model of both beams needs masses and bending stiffnesses that are not published with the
data, and adds nothing that these decays could test. For given masses, the four numbers are equivalent to
the joint parameters.
"""
WORDS = """\
In every window two poles are fitted to all twelve records, with free amplitudes and phases and damping of
either sign. The joint parameters are those of the two masses with these poles. `x` is the RMS of the
velocity.

Linear joints cannot explain the following. From the first to the last window the level falls by a factor
of {fall}; the equivalent stiffness of the root changes by {root:+.2f} %, that of the bolt by {bolt:+.2f}
%; the equivalent damping of the root from {before:.3g} to {after:.3g} N s/m, that of the bolt from
{first:.3g} to {last:.3g} N s/m: joints slip less at smaller amplitudes. In the last window the second
line is at {ratio:.3f} times the first and decays at {rates:.2f} times its rate. It is therefore not a
mode but the second harmonic of the first mode, which a linear joint does not generate. Where the harmonic
dominates, the damping of the second mode is not identifiable, and an identification with positive dampers
is refused (1.6 … 2.0 s). These effects, not noise, are the unexplained part of the records, so the
standard errors above are nominal.
"""


def run(*changes: str):
    """Run the scene."""
    return dynid.run(dynid.load_scene(SCENE, changes))


def modes(result) -> str:
    """Return natural frequencies in Hz and damping ratios in per cent, as cells of a table."""
    hertz = result["structure/modes/omega"].data / (2 * np.pi)
    damping = 100 * result["structure/modes/damping"].data
    return f"{hertz[0]:.2f} | {hertz[1]:.2f} | {damping[0]:.3f} | {damping[1]:.3f}"


def size(values: np.ndarray) -> float:
    """Return the RMS."""
    return float(np.sqrt(np.mean(values**2)))


def predicted(estimate: np.ndarray) -> list[str]:
    """Return rows of the unexplained part of each predicted record, in per cent.

    The initial state of a free decay comes from the record: from all of it, or from its first 0.1 s
    alone, so that the rest is a prediction.
    """
    records = ", ".join(f"{{file: {{row: {row}}}}}" for row in HELD)
    scene = dynid.load_scene(SCENE, [f"measurement.records=[{records}]"])
    model = build_structure(scene, scene.model.structure, scene.model.joints)
    rows = []
    for row, (loads, measurement) in zip(HELD, experiments(scene, [], scene.model.measurement), strict=True):
        values = np.asarray(measurement.source)
        head = np.where(np.arange(len(values))[:, None] < HEAD, values, np.nan)
        joint = parametric_model(model, loads, measurement.channels, measurement.record.times)
        record = TimeRecord(joint, RecordData(values))
        left = []
        for known in (values, head):
            fit = record.fit(np.log(estimate), known)
            left.append(100 * size(values - fit.predicted.outputs) / size(values))
        rows.append(f"| {row} | {left[0]:.0f} % | {left[1]:.0f} % |")
    return rows


def decays() -> np.ndarray:
    """Return all records (times x 12)."""
    rows = ", ".join(f"{{file: {{row: {row}}}}}" for row in sorted(TRAINED + HELD))
    whole = ["measurement.samples=15718", f"measurement.records=[{rows}]"]
    scene = dynid.load_scene(SCENE, whole)
    taken = experiments(scene, [], scene.model.measurement)
    return np.column_stack([np.asarray(measurement.source)[:, 0] for _, measurement in taken])


def poles(values: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Return decay rates and angular frequencies of two modes that all decays share, and the part left."""
    t = STEP * np.arange(len(values))[:, None]

    def left(unknown: np.ndarray) -> np.ndarray:
        rate, omega = unknown[:2], unknown[2:]
        basis = np.hstack([np.exp(-rate * t) * np.cos(omega * t), np.exp(-rate * t) * np.sin(omega * t)])
        Q, _ = np.linalg.qr(basis)
        return (values - Q @ (Q.T @ values)).ravel()

    scale = np.array([1.0, 1.0, 1e2, 1e2])
    found = least_squares(left, start, x_scale=scale, xtol=1e-12, ftol=1e-12)
    return found.x, size(found.fun) / size(values)


def equivalent(found: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return root.k, bolt.k, root.c, bolt.c of the two masses that have these poles."""
    rate, omega = found[:2], found[2:]
    pairs = [np.array([1, 2 * r, r * r + w * w]) for r, w in zip(rate, omega, strict=True)]
    wanted = np.polymul(*pairs)[1:]
    m1, m2 = MASSES
    unit = np.array([1e5, 1e5, 1.0, 1.0])

    def missing(x: np.ndarray) -> np.ndarray:
        k1, k2, c1, c2 = x * unit
        outer, bolt = [m1, c1 + c2, k1 + k2], np.array([c2, k2])
        has = np.polysub(np.polymul(outer, [m2, c2, k2]), np.polymul(bolt, bolt)) / (m1 * m2)
        return (has[1:] / wanted) - 1

    return root(missing, start / unit, tol=1e-12).x * unit


def windows(estimate: np.ndarray, result) -> list[str]:
    """Return the rows of the windows, and words about them."""
    values, rows, seen = decays(), [], []
    omega = result["structure/modes/omega"].data
    start = np.array([*(omega * result["structure/modes/damping"].data), *omega])
    joints = np.array([estimate[0], estimate[2], estimate[1], estimate[3]])
    for first in range(0, len(values) - LENGTH + 1, LENGTH):
        part = values[first : first + LENGTH]
        start, left = poles(part, start)
        joints = equivalent(start, joints)
        zeta = 100 * start[:2] / np.hypot(start[:2], start[2:])
        seen.append([size(part), *joints])
        rows.append(
            f"| {STEP * first:.1f} … {STEP * (first + LENGTH):.1f} | {1e3 * size(part):.3g} | "
            f"{start[2] / (2 * np.pi):.2f} | {start[3] / (2 * np.pi):.2f} | {zeta[0]:.3f} | {zeta[1]:.3f} | "
            f"{joints[0]:.5g} | {joints[1]:.5g} | {joints[2]:.3g} | {joints[3]:.3g} | {100 * left:.1f} % |"
        )
    table = np.array(seen)
    change = 100 * (table[-1] / table[0] - 1)
    said = WORDS.format(
        fall=f"{table[0, 0] / table[-1, 0]:.1f}", root=change[1], bolt=change[2], before=table[0, 3],
        after=table[-1, 3], first=table[0, 4], last=table[-1, 4], ratio=start[3] / start[2],
        rates=start[1] / start[0],
    )  # fmt: skip
    return [*rows, "", said]


def main() -> None:
    """Write the page."""
    result = run()
    estimate, error = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "standard_error")
    )
    lines = [
        HEADER,
        "## The joints",
        "",
        "| parameter | estimate | nominal standard error |",
        "|---|---|---|",
    ]
    names = result["identification/parameters/name"].data
    lines += [
        f"| {n} | {e:.5g} | {100 * d / e:.2g} % |" for n, e, d in zip(names, estimate, error, strict=True)
    ]
    left = 100 * result["identification/diagnostics/residual_ratio"].data
    parts = ", ".join(f"{TRAINED[k]}: {left[k]:.0f} %" for k in range(len(left)))
    lines += ["", f"Unexplained part of the records used (0.8 s): {parts}.", "", WHY, "## Two modes", ""]
    lines += ["| window (s) | f1 (Hz) | f2 (Hz) | ζ1 (%) | ζ2 (%) | unexplained |"]
    lines += ["|---|---|---|---|---|---|", f"| 0 … 0.80 | {modes(result)} | {left.mean():.0f} % |"]
    lines += ["", "## Windows of falling amplitude", ""]
    lines += [
        "| window (s) | x (mm/s) | f1 (Hz) | f2 (Hz) | ζ1 (%) | ζ2 (%) | root.k (N/m) | bolt.k (N/m) | "
        "root.c (N s/m) | bolt.c (N s/m) | left |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [*windows(estimate, result), "## Predicted records", ""]
    lines += [
        "| record | unexplained, initial state from the whole record | from the first 0.1 s |",
        "|---|---|---|",
    ]
    lines += predicted(estimate)
    (HERE / "double_beam.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
