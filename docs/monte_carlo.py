"""Compare many noisy records of a scene with its bound: `python docs/monte_carlo.py [SEEDS] [PROCESSES]`.

Writes docs/monte_carlo.md. Every seed is a complete run of the scene from its start values: the errors
are those that a user would get, without selection.
"""

from __future__ import annotations

import os
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process a core: threads would only wait for each other

import numpy as np

import dynid
from dynid.errors import NumericalError

HERE = Path(__file__).parent
SCENES = ("table2", "table4")
#: Half width of a 95 % interval in standard errors.
WIDE = 1.959963984540054
HEADER = """\
# Errors over many records

Written by `python docs/monte_carlo.py {seeds}`: the scenes of Tables 2 and 4, each run with the noise seeds
1 … {seeds} from its own start values (half the true ones). RMS is the root mean square error over the
Cramér–Rao bound of the record, coverage the share of 95 % intervals that contain the true value; ± is the
standard error of these figures. An efficient estimator has 1 and 95 %.
"""


def of_seed(name: str, seed: int) -> tuple[list[str], np.ndarray] | None:
    """Return the parameters, and (error over bound, whether the interval holds the truth, converged)."""
    scene = dynid.load_scene(HERE.parent / f"configs/{name}.yaml", [f"measurement.simulate.seed={seed}"])
    try:
        result = dynid.run(scene)
    except NumericalError:
        return None
    get = {
        part: result[f"identification/parameters/{part}"].data
        for part in ("name", "estimate", "true", "standard_error", "cramer_rao")
    }
    error = (get["estimate"] - get["true"]) / get["cramer_rao"]
    held = np.abs(np.log(get["true"] / get["estimate"])) <= WIDE * get["standard_error"] / get["estimate"]
    converged = np.full(len(held), result.value("identification/diagnostics/converged"))
    return list(get["name"]), np.array([error, held, converged])


def table(name: str, seeds: int, pool: ProcessPoolExecutor) -> str:
    """Run a scene with all seeds and return its table."""
    runs = list(pool.map(of_seed, repeat(name), range(1, seeds + 1), chunksize=10))
    ended = [run for run in runs if run is not None]
    names = ended[0][0]
    errors, held, converged = np.moveaxis([found for _, found in ended], 1, 0)
    n = len(ended)
    rms = np.sqrt(np.mean(errors**2, axis=0))
    rms_error = np.std(errors**2, axis=0) / np.sqrt(n) / (2 * rms)
    coverage = np.mean(held, axis=0)
    coverage_error = np.sqrt(coverage * (1 - coverage) / n)
    lines = [
        f"## configs/{name}.yaml",
        "",
        f"{seeds} records · {seeds - n} refused · {int(n - converged[:, 0].sum())} not converged",
        "",
        "| parameter | RMS / bound | coverage | bias / bound | largest error / bound |",
        "|---|---|---|---|---|",
    ]
    for k, parameter in enumerate(names):
        lines.append(
            f"| {parameter} | {rms[k]:.3f} ± {rms_error[k]:.3f} "
            f"| {100 * coverage[k]:.1f} ± {100 * coverage_error[k]:.1f} % "
            f"| {np.mean(errors[:, k]):+.3f} ± {rms[k] / np.sqrt(n):.3f} | {np.abs(errors[:, k]).max():.1f} |"
        )
    return "\n".join(lines)


def main(seeds: int, processes: int) -> None:
    """Write the tables."""
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        tables = [table(name, seeds, pool) for name in SCENES]
    text = "\n\n".join([HEADER.format(seeds=seeds).strip(), *tables]) + "\n"
    (HERE / "monte_carlo.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*given, *(2000, os.cpu_count() or 1)[len(given) :])
