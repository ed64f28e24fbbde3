"""What linear joints say of the measured double beam, and what they cannot: `python docs/double_beam.py`.

Writes docs/double_beam.md. The data lie beside the project, see configs/measured/double_beam.yaml.
"""

from pathlib import Path

import numpy as np

import dynid
from dynid.errors import NumericalError
from dynid.identification.augmented import augmented
from dynid.identification.fit import fitter
from dynid.identification.measurement import Data
from dynid.scene.kinds.records import experiments
from dynid.scene.kinds.structures import build_structure

HERE = Path(__file__).parent
SCENE = HERE.parent / "configs/measured/double_beam.yaml"
TRAINED, HELD = (1, 2, 3, 5, 6, 7, 9, 10, 11), (4, 8, 12)
# First samples of windows of 2048 (0.4 s) on the way down.
WINDOWS = (1, 2049, 4097, 8193, 13665)
HEAD = 512
HEADER = """\
# The measured double beam

Made by `python docs/double_beam.py` from `configs/measured/double_beam.yaml`: two masses, two joints,
stiffness and damping of both from nine free decays; three more, one for each place of impact, are predicted.
"""
WORDS = """\
The frequencies rise and the damping falls on the way down: joints that slip less as the amplitude falls. With
the second mode at twice the first, the first feeds the second, which late in the record decays slower than
any dampers allow. No linear joint does either; what is left of the records is this, not noise, so that the
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
    """Return rows of how well the held records are predicted: part of each that is left, in per cent.

    Of a free decay the initial state must come from the record: from all of it, or from its first 0.1 s
    alone, so that the rest is foreseen.
    """
    records = ", ".join(f"{{file: {{row: {row}}}}}" for row in HELD)
    scene = dynid.load_scene(SCENE, [f"measurement.records=[{records}]"])
    model = build_structure(scene, scene.model.structure, scene.model.joints)
    rows = []
    for row, (loads, measurement) in zip(HELD, experiments(scene, [], scene.model.measurement), strict=True):
        values = np.asarray(measurement.source)
        head = np.where(np.arange(len(values))[:, None] < HEAD, values, np.nan)
        joint = augmented(model, loads, measurement.channels, measurement.record.times)
        record = fitter(joint, model, measurement.channels, Data(values))
        left = []
        for known in (values, head):
            fit = record.fit(np.log(estimate), known)
            left.append(100 * size(values - fit.predicted.outputs) / size(values))
        rows.append(f"| {row} | {left[0]:.0f} % | {left[1]:.0f} % |")
    return rows


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
    table = [
        "| window (s) | f1 (Hz) | f2 (Hz) | ζ1 (%) | ζ2 (%) | left of the signal |",
        "|---|---|---|---|---|---|",
    ]
    lines += ["", f"Of the records used (0.8 s) this is left: {parts}.", "", "## Two modes", "", *table]
    lines.append(f"| 0 … 0.80 | {modes(result)} | {left.mean():.0f} % |")
    for first in WINDOWS:
        start = (first - 1) * 1.953e-4
        try:
            window = run(f"measurement.file.first={first}", "measurement.samples=2048")
        except NumericalError as refusal:
            lines.append(f"| {start:.2f} … {start + 0.40:.2f} | refused: {refusal.problem} | | | | |")
            continue
        part = 100 * window["identification/diagnostics/residual_ratio"].data.mean()
        lines.append(f"| {start:.2f} … {start + 0.40:.2f} | {modes(window)} | {part:.1f} % |")
    lines += ["", WORDS, "## Records that were held back", ""]
    lines += ["| record | left, initial state from all of it | from the first 0.1 s |", "|---|---|---|"]
    lines += predicted(estimate)
    (HERE / "double_beam.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
