"""Wall time of whole commands against what Python needs to import: `python benchmarks/startup.py [RUNS]`.

Commands and references take turns, so that a drift of the machine's speed hits both; medians are printed.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CONFIGS = Path(__file__).parents[1] / "configs"
DYNID = [sys.executable, "-m", "dynid"]
NUMERIC = [sys.executable, "-c", "import numpy, scipy.linalg, h5py, pydantic"]
CHECKING = [sys.executable, "-c", "import pydantic, yaml"]
CLICK = [sys.executable, "-c", "import click"]

#: What is timed: the command, its reference, and the ratio that it must not exceed.
CASES = {
    "dynid --help": ([*DYNID, "--help"], CLICK, 1.3),
    "dynid check configs/*.yaml": (
        [*DYNID, "check", *map(str, sorted(CONFIGS.glob("*.yaml")))],
        CHECKING,
        5.0,
    ),
    "dynid run configs/isolator.yaml": ([*DYNID, "run", str(CONFIGS / "isolator.yaml")], NUMERIC, 3.0),
    "dynid run configs/suspension_noisy.yaml": (
        [*DYNID, "run", str(CONFIGS / "suspension_noisy.yaml")],
        NUMERIC,
        5.0,
    ),
}


def seconds(command: list[str], folder: str) -> float:
    """Return the wall time of one process."""
    started = time.perf_counter()
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - started


def main(runs: int) -> None:
    """Print the median times and ratios."""
    print(f"{'command':<42} {'time':>8} {'reference':>10} {'ratio':>6} {'limit':>6}")
    with tempfile.TemporaryDirectory() as folder:
        for name, (command, reference, limit) in CASES.items():
            pairs = [(seconds(command, folder), seconds(reference, folder)) for _ in range(runs + 1)][1:]
            own, base = (statistics.median(column) for column in zip(*pairs, strict=True))
            ratio = statistics.median(a / b for a, b in pairs)
            print(f"{name:<42} {own * 1e3:5.0f} ms {base * 1e3:7.0f} ms {ratio:6.2f} {limit:6.1f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 9)
