"""Write docs/hard_cases.md, the hard cases with errors or refusals: `python docs/hard_cases.py --slow`.

Without `--slow`, cases that take minutes are listed but not run.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from tests.hard.case import Case  # noqa: E402
from tests.hard.catalogue import HALVES, cases  # noqa: E402

HEADS = ("case", "known from", "bound", "error, or refusal")
HEADER = """\
# Hard cases

Written by `python docs/hard_cases.py{option}` from the {count} cases of `tests/hard`, which the tests
also run. Each has a known answer from an independent source and a bound on the relative error (of the
worst number of an array; 0: exact). A case without a valid answer must be refused with an error that
names a remedy.
"""


def rows(
    half: str, listed: Sequence[Case] | None = None, *, slow: bool = False
) -> list[tuple[str, str, str, str]]:
    """Run the cases of a half and return their rows: name, source, bound, measured error or refusal.

    Parameters
    ----------
    half
        One of `HALVES`.
    listed
        The cases; absent: all.
    slow
        Whether to run those that take minutes, too.
    """
    chosen = [case for case in (cases() if listed is None else listed) if case.half == half]
    return [_row(case, slow) for case in chosen]


def table(found: Sequence[Sequence[str]]) -> str:
    """Return rows as a table in Markdown."""
    lines = [HEADS, ["---"] * len(HEADS), *found]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def _row(case: Case, slow: bool) -> tuple[str, str, str, str]:
    if case.slow and not slow:
        bound = "refused" if case.refused else _short(case.bound)
        return case.name, case.source, bound, "not run: slow (`--slow`, `pytest -m slow`)"
    if case.needs is not None and not case.needs.exists():
        return case.name, case.source, _short(case.bound), "not run: its data are missing"
    if case.refused:
        return case.name, case.source, "refused", str(case.refusal())
    return case.name, case.source, _short(case.bound), _short(case.error())


def _short(value: float) -> str:
    return "0" if value == 0 else f"{value:.1g}"


def main() -> None:
    """Run all cases, and write the page."""
    warnings.simplefilter("error")
    slow = "--slow" in sys.argv[1:]
    parts = [f"## {half.capitalize()}\n\n{table(rows(half, slow=slow))}\n" for half in HALVES]
    page = "\n".join([HEADER.format(count=len(cases()), option=" --slow" * slow), *parts])
    (HERE / "hard_cases.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
