"""Fuzz on record: `python -m tests.fuzz.record [COUNT] [FIRST SEED] [run]`, by default 100,000 scenes.

Each is checked; with `run`, what is valid is run as well, which takes far longer. Prints counts, and
every seed that broke something.
"""

from __future__ import annotations

import resource
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.fuzz.judge import verdict
from tests.fuzz.mutation import bases, hostile_scene

_SECONDS = 60
_BYTES = 6 * 2**30


def main(count: int = 100_000, first: int = 0, *, run: bool = False) -> int:
    """Judge so many scenes, and return how many broke something."""
    resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
    every, outcomes = bases(), Counter()
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.yaml"
        for number, seed in enumerate(range(first, first + count), 1):
            text = hostile_scene(seed, every[seed % len(every)])
            wrong = verdict(text, scene, "check")
            if run and not wrong:
                output = str(scene.with_suffix(".h5"))
                wrong = verdict(text, scene, "run", "-o", output, seconds=_SECONDS, codes=(0, 1, 2, 3, 4))
            outcomes[bool(wrong)] += 1
            if wrong:
                print(f"seed {seed}: {wrong[:500]}", flush=True)
            if number % 5000 == 0 or number == count:
                print(f"{number} scenes, {outcomes[True]} broken", flush=True)
    return outcomes[True]


if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if argument != "run"]
    sys.exit(min(main(*map(int, arguments), run="run" in sys.argv), 1))
