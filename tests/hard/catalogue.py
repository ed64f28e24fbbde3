"""All hard cases."""

from __future__ import annotations

from tests.hard import graphs, ladders, long_run, published, records, reductions, responses, roots, structures
from tests.hard.case import Case

HALVES = ("frequency", "structure", "identification", "long run")


def cases() -> list[Case]:
    """Return all cases, half by half."""
    modules = (published, roots, graphs, ladders, responses, structures, reductions, records, long_run)
    listed = [case for module in modules for case in module.CASES]
    return sorted(listed, key=lambda case: HALVES.index(case.half))
