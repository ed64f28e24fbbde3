"""A first look at a study that is watched: samples evenly over its plan, as many as a short wait allows."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.study.plan import Plan

#: Samples of the first look, most of the second, and the seconds that this one may take.
FIRST, MOST, SECONDS = 6, 1000, 4.0


def looks(study: Scene, target: Path) -> Iterator[str]:
    """Run a few samples of a study into a file, then more where they are quick; tell each time which.

    Parameters
    ----------
    study
        The study, checked.
    target
        The file, which holds what was run whenever this yields.
    """
    from dynid.study.plan import make_plan

    plan, started = make_plan(study), time.perf_counter()
    count = _run(plan, target, FIRST)
    yield _said(plan, count)
    each = (time.perf_counter() - started) / count
    enough = min(plan.size, MOST, int(SECONDS / each))
    if enough >= 2 * count or count < plan.size <= enough:
        yield _said(plan, _run(plan, target, enough))


def _run(plan: Plan, target: Path, most: int) -> int:
    """Run at most so many samples, those that the file has excepted; return how many there are."""
    from dynid.study.execute import run_study, shard_of
    from dynid.study.executors import hire

    shard = (1, -(-plan.size // most))
    run_study(plan, target, hire("serial", None, None, None), shard=shard)
    return len(shard_of(plan, shard))


def _said(plan: Plan, count: int) -> str:
    if count == plan.size:
        return ""
    return (
        f"A first look: {count:,} of {plan.size:,} samples, evenly over the plan; dynid study runs them all."
    )
