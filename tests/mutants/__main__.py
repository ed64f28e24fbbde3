"""Mutation testing: `python -m tests.mutants [--sample N] [--seed S] [--keep] [--resume FOLDER]`.

Every mutant is one small wrong in a module of `targets.MODULES`, which a test must notice. Without
`--sample` all are tried, which takes an hour. Survivors that are not in `equivalent.py`, with a reason, end
in exit code 1.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections import Counter
from pathlib import Path

from tests.mutants.equivalent import EQUIVALENT
from tests.mutants.operators import Mutant, mutants
from tests.mutants.session import Session, run
from tests.mutants.targets import MODULES, ROOT

RECORD = ROOT / "docs" / "quality" / "mutants.json"
_LOST = ("survived", "not reached")


def main() -> int:
    """Try the mutants that were asked for; return the exit code."""
    asked = _arguments()
    if asked.resume:
        asked.resume.mkdir(parents=True, exist_ok=True)
    sources = {name: path.read_text() for name, path in MODULES.items()}
    every = [mutant for name, source in sources.items() for mutant in mutants(name, source)]
    chosen = [mutant for mutant in _sample(every, asked.sample, asked.seed) if asked.only in mutant.key]
    kept = asked.resume / "outcomes.json" if asked.resume else None
    outcomes = json.loads(kept.read_text()) if kept and kept.exists() else {}
    tried = [m for m in chosen if m.key not in EQUIVALENT and m.key not in outcomes]
    print(f"{len(every)} mutants, {len(chosen)} chosen, {len(tried)} to be tried", flush=True)

    def told(mutant: Mutant, outcome: str) -> None:
        outcomes[mutant.key] = outcome
        if outcome in _LOST:
            print(f"{outcome}: {mutant.key}  ({MODULES[mutant.module].name}:{mutant.lines[0]})", flush=True)
        if kept:
            kept.write_text(json.dumps(outcomes, indent=0))

    if tried:
        reached = asked.resume / "reached.json" if asked.resume else None
        code = run(Session(tried, sources, told, reached, asked.jobs))
        if code not in (0, 5):
            return code
    return _tell(chosen, len(every), outcomes, keep=asked.keep)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants")
    parser.add_argument("--sample", type=int, default=0, help="how many (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="which of them")
    parser.add_argument("--only", default="", help="those alone whose description holds this text")
    parser.add_argument(
        "--keep", action="store_true", help=f"write the figures to {RECORD.relative_to(ROOT)}"
    )
    parser.add_argument("--resume", type=Path, help="a folder that keeps what is known, to go on")
    parser.add_argument("--jobs", type=int, default=1, help="how many at a time (default: 1)")
    return parser.parse_args()


def _sample(every: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """Choose by what a mutant is: a change elsewhere leaves the choice as it was, a larger one adds."""

    def lot(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.key}".encode()).digest()

    return sorted(every, key=lot)[: count or len(every)]


def _tell(chosen: list[Mutant], every: int, outcomes: dict[str, str], *, keep: bool) -> int:
    counts: dict[str, Counter[str]] = {}
    for mutant in chosen:
        outcome = "equivalent" if mutant.key in EQUIVALENT else outcomes[mutant.key]
        counts.setdefault(mutant.module, Counter())[outcome] += 1
    survivors = [m.key for m in chosen if m.key not in EQUIVALENT and outcomes[m.key] in _LOST]
    total = sum(counts.values(), Counter())
    tried, dead = total.total() - total["equivalent"], total["killed"] + total["timeout"]
    for module, count in sorted(counts.items()):
        print(f"{module:44} {dict(count)}")
    for key in survivors:
        print(f"survivor: {key}")
    print(
        f"mutation score: {dead} of {tried} killed ({100 * dead / max(tried, 1):.1f} %), "
        f"{total['timeout']} of them by time; {total['equivalent']} equivalent; {len(chosen)} of {every}"
    )
    if keep:
        RECORD.parent.mkdir(exist_ok=True)
        kept = {"mutants": every, "chosen": len(chosen), "modules": counts, "survivors": survivors}
        RECORD.write_text(json.dumps(kept, indent=1) + "\n")
    unknown = EQUIVALENT.keys() - {mutant.key for mutant in chosen} if len(chosen) == every else ()
    for key in unknown:
        print(f"not a mutant any more: {key}")
    return 1 if survivors or unknown else 0


if __name__ == "__main__":
    sys.exit(main())
