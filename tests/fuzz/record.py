"""Fuzz on record: `python -m tests.fuzz.record [COUNT] [FIRST SEED] [run] [--keep]`, or 100,000 scenes.

Each is checked, or with `run` run, which takes far longer. Prints counts, and every seed that broke
something; `--keep` adds the counts to docs/quality/fuzz.json, from which `docs/quality.py` makes the page.
`again` judges those alone that broke something on record, and notes which are mended.
A process of its own judges a thousand scenes, so that what ends or stops it is counted as well.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.fuzz.judge import Sandbox
from tests.fuzz.kinds import hostile_scene
from tests.fuzz.mutation import bases

RECORD = Path(__file__).parents[2] / "docs" / "quality" / "fuzz.json"
SECONDS = {"check": 10, "run": 60}
_BYTES = 6 * 2**30
_CHUNK = 1000
#: Seconds without a word from a process after which it is ended.
_SILENT = 3600


def _work(command, seeds, every, report):
    resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
    with tempfile.TemporaryDirectory() as folder:
        sandbox = Sandbox(Path(folder))
        for seed in seeds:
            kind, text = hostile_scene(seed, every)
            report.send((seed, kind, None, 0))
            verdict = sandbox.judge(text, command, seconds=SECONDS[command])
            verdict = verdict._replace(wrong=verdict.wrong.replace(f"{folder}/", ""))
            peak = max(
                resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
            )
            report.send((seed, kind, verdict, peak // 1024))


def empty():
    """Return a record of nothing."""
    counts = {"scenes": 0, "messages": 0, "kinds": {}, "codes": {}}
    return counts | {"broken": [], "slowest": [0, None], "peak_MB": 0, "ranges": []}


def judge(command, first, count, every):
    """Judge so many scenes from a seed on; return the record of it."""
    record, context, seed, last = empty(), multiprocessing.get_context("fork"), first, first + count
    record["ranges"] = [[first, last]]
    while seed < last:
        receiver, sender = context.Pipe(duplex=False)
        child = context.Process(
            target=_work, args=(command, range(seed, min(last, seed + _CHUNK)), every, sender)
        )
        child.start()
        sender.close()
        began, end = None, min(last, seed + _CHUNK)
        try:
            while receiver.poll(_SILENT):
                seed, kind, verdict, peak = receiver.recv()
                began = None if verdict else (seed, kind)
                if verdict:
                    _count(record, seed, kind, verdict, peak)
                    seed += 1
            child.kill()
        except EOFError:
            pass
        child.join()
        if began:
            _broken(record, *began, f"the process ended with {child.exitcode}")
            record["scenes"] += 1
            seed = began[0] + 1
        elif seed < end:
            raise RuntimeError(f"a judge left before seed {seed} with {child.exitcode}")
    return record


def _broken(record, seed, kind, wrong):
    record["broken"].append([seed, kind, wrong[:300]])
    print(f"seed {seed} ({kind}): {wrong[:500]}", flush=True)


def _count(record, seed, kind, verdict, peak):
    record["scenes"] += 1
    record["messages"] += verdict.messages
    codes = record["kinds"].setdefault(kind, {})
    for counts in (record["codes"], codes):
        counts[str(verdict.code)] = counts.get(str(verdict.code), 0) + 1
    record["slowest"] = max(record["slowest"], [round(verdict.seconds, 2), seed], key=lambda slow: slow[0])
    record["peak_MB"] = max(record["peak_MB"], peak)
    if verdict.wrong:
        _broken(record, seed, kind, verdict.wrong)


def together(one, other):
    """Return what two records say together."""
    kinds = {
        kind: dict(Counter(one["kinds"].get(kind, {})) + Counter(other["kinds"].get(kind, {})))
        for kind in sorted({*one["kinds"], *other["kinds"]})
    }
    return {
        "scenes": one["scenes"] + other["scenes"],
        "kinds": kinds,
        "codes": dict(sorted((Counter(one["codes"]) + Counter(other["codes"])).items())),
        "messages": one["messages"] + other["messages"],
        "broken": sorted(one["broken"] + other["broken"]),
        "mended": sorted(one.get("mended", []) + other.get("mended", [])),
        "slowest": max(one["slowest"], other["slowest"], key=lambda slow: slow[0]),
        "peak_MB": max(one["peak_MB"], other["peak_MB"]),
        "ranges": sorted(one["ranges"] + other["ranges"]),
    }


def kept_records(path=RECORD, **new):
    """Write records to those that are kept, in place of those of the same name; return all."""
    kept = (json.loads(path.read_text()) if path.exists() else {}) | new
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(kept, indent=1) + "\n")
    return kept


def asked(about: str) -> argparse.ArgumentParser:
    """Return what reads a fuzz's command line, with its help."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--keep", action="store_true", help=f"write the counts to {RECORD.name}")
    return parser


def again(command: str = "check", *, path: Path = RECORD) -> int:
    """Judge those on record as broken once more; note the mended ones, and return how many are broken."""
    record, every = kept_records(path)[command], bases()
    broken = [entry for entry in record["broken"] if judge(command, entry[0], 1, every)["broken"]]
    record["mended"] = record.get("mended", []) + [e for e in record["broken"] if e not in broken]
    record["broken"] = broken
    kept_records(path, **{command: record})
    print(f"{len(broken)} are still broken, {len(record['mended'])} mended", flush=True)
    return len(broken)


def main(count: int = 100_000, first: int = 0, *, command: str = "check", kept: bool = False) -> int:
    """Judge so many scenes, and return how many broke something."""
    every, total = bases(), empty()
    for start in range(first, first + count, _CHUNK):
        record = judge(command, start, min(_CHUNK, first + count - start), every)
        if kept:
            so_far = kept_records().get(command, empty())
            kept_records(**{command: together(so_far, record)})
        total = together(total, record)
        print(
            f"{total['scenes']} scenes, {len(total['broken'])} broken; exit codes {total['codes']}, slowest "
            f"{total['slowest'][0]} s of CPU, peak {total['peak_MB']} MB",
            flush=True,
        )
    return len(total["broken"])


if __name__ == "__main__":
    given = asked(__doc__)
    given.add_argument("words", nargs="*", metavar="COUNT|FIRST|run|again")
    told = given.parse_args()
    numbers = [int(word) for word in told.words if word.isdigit()]
    if strange := [
        word for word in told.words if not word.isdigit() and word not in ("check", "run", "again")
    ]:
        given.error(f"what is {strange[0]!r}?")
    chosen = "run" if "run" in told.words else "check"
    if "again" in told.words:
        sys.exit(min(again(chosen), 1))
    sys.exit(min(main(*numbers, command=chosen, kept=told.keep), 1))
