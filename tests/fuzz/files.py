"""Damaged files on record: `python -m tests.fuzz.files [TRIALS]`, by default 2,000 for every format; `--keep`
writes the counts to docs/quality/fuzz.json.

Bytes are changed, or the end is cut off; each trial reads the file in a process of its own group, so that a
library that crashes or hangs is counted instead of ending the run.
"""

from __future__ import annotations

import multiprocessing
import random
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

import dynid
from dynid.errors import DynidError
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_measured import read_columns
from dynid.store import write_result
from tests.files.test_matlab_and_universal_files import stored
from tests.files.test_readers import WRITERS
from tests.fuzz.record import RECORD, asked, kept_records

# Longer than a file is read on trial, so that what would never end is refused.
_SECONDS = 60
_ROOT = Path(__file__).parents[2]


def sources(folder):
    """Yield every format: its name, a good file, and what reads it."""
    for entry in WRITERS:
        (writer,) = getattr(entry, "values", (entry,))
        path, name = writer(folder)
        yield writer.__name__.removeprefix("write_"), path, _matrix(name)
    table, values = folder / "table.csv", np.random.default_rng(1).normal(size=(40, 2))
    np.savetxt(table, values, delimiter=",", header="a,b", comments="")
    yield "csv", table, lambda file: read_columns(file, ["a", "b"])
    times = 0.01 * np.arange(50)
    for binary, form in enumerate(("text", "binary")):
        path = folder / f"{form}.uff"
        stored(path, binary, [(times, np.sin(7 * times), 1), (times, np.cos(7 * times), 1)])
        yield f"uff {form}", path, lambda file: read_columns(file, None)
    result = folder / "result.h5"
    write_result(dynid.run(_ROOT / "configs" / "isolator.yaml"), result)
    yield "result", result, dynid.open_result


def _matrix(name):
    return lambda file: read_matrix(MatrixFile(file, name), "stiffness")


def spoilt(seed, whole):
    """Return the bytes of a file, damaged by the chance of a seed."""
    chance, content = random.Random(seed), bytearray(whole)
    if chance.random() < 0.2:
        return bytes(content[: chance.randrange(len(content))])
    for _ in range(chance.choice([1, 1, 2, 8])):
        place = chance.randrange(len(content))
        flipped = content[place] ^ (1 << chance.randrange(8))
        content[place] = chance.choice([0, 255, flipped, chance.randrange(256)])
    return bytes(content)


def _trial(read, file):
    try:
        read(file)
    except DynidError as error:
        return "refused" if str(error).strip() and "\n" not in str(error) else "bad message"
    except MemoryError:
        return "out of memory"
    except Exception as error:
        return f"escaped: {type(error).__name__}"
    return "read"


def _work(read, path, whole, seeds, report):
    for seed in seeds:
        report.send((seed, None))
        path.write_bytes(spoilt(seed, whole))
        signal.alarm(_SECONDS)  # its default ends the process
        outcome = _trial(read, path)
        signal.alarm(0)
        report.send((seed, outcome))


def _judge(read, path, whole, count):
    """Count what becomes of so many damaged files; a process that dies is followed by another."""
    outcomes, first = Counter(), 0
    context = multiprocessing.get_context("fork")
    while first < count:
        receiver, sender = context.Pipe(duplex=False)
        child = context.Process(target=_work, args=(read, path, whole, range(first, count), sender))
        child.start()
        sender.close()
        try:
            while True:
                seed, outcome = receiver.recv()
                if outcome is not None:
                    outcomes[outcome] += 1
                    if outcome not in ("read", "refused"):
                        print(f"  {path.name} seed {seed}: {outcome}", flush=True)
                first = seed + (outcome is not None)
        except EOFError:
            child.join()
        if first < count:
            code = child.exitcode or 0
            died = signal.Signals(-code).name if code < 0 else str(code)
            outcomes[f"died of {died}"] += 1
            print(f"  {path.name} seed {first}: died of {died}", flush=True)
            first += 1
    return outcomes


def main(count: int = 2000, *, keep: bool = False) -> int:
    """Judge every format, and return how many trials broke something."""
    broken, results = 0, {}
    with tempfile.TemporaryDirectory() as folder:
        for name, path, read in sources(Path(folder)):
            outcomes = _judge(read, path, path.read_bytes(), count)
            broken += sum(outcomes.values()) - outcomes["read"] - outcomes["refused"]
            results[name] = dict(sorted(outcomes.items()))
            print(f"{name:22} {results[name]}", flush=True)
    if keep:
        kept_records(RECORD, files=results)
    return broken


if __name__ == "__main__":
    given = asked(__doc__)
    given.add_argument("trials", nargs="?", type=int, default=2000)
    told = given.parse_args()
    sys.exit(min(main(told.trials, keep=told.keep), 1))
