"""Explanation of a study: its size, how its samples are run, and their total cost."""

from __future__ import annotations

import time
from collections.abc import Sequence

from dynid.progress import report_progress
from dynid.scene.batch import why_alone
from dynid.scene.explanations.explanation import CostEstimate, Explanation, Fact, explain, file_kilobytes
from dynid.study.executors.base import cores
from dynid.study.plan import Plan
from dynid.study.run import valid_samples
from dynid.study.work import Job, run_chunk, unpacked

#: Estimated time of a sample above which no sample is tried, s.
_PROBE = 2.0
#: Samples that are tried after the first, whose preparation they share.
_TRIED = 4


def explain_study(plan: Plan, target: str) -> Explanation:
    """Explain a study.

    Parameters
    ----------
    plan
        The plan of the study.
    target
        The file to write; its finished samples are not run again.

    Returns
    -------
    Explanation
        Causality or identifiability of the scene, and the cost of all samples that are not finished. If a
        sample is fast, a few are run to measure their cost.
    """
    base = explain(plan.base)
    paths = list(plan.settings)
    report_progress("how samples are run")
    reason = why_alone(plan.base, paths, plan.collect) if base.obstacle is None else "the scene fails"
    done = valid_samples(plan, target)
    facts = [
        Fact("scene", f"{plan.attrs['base']} ({plan.base.kind}); what follows is at its own values"),
        Fact("samples", f"{plan.size:,} by {plan.attrs['method']} over {', '.join(plan.arrays)}"),
        Fact("finished", f"{done:,} of them, in {target}" if done else f"none in {target}"),
        Fact("batched", f"no, one by one: {reason}" if reason else "yes, samples share their preparation"),
        Fact("processes", f"{cores()}: one per core, unless --workers or --scheduler is given"),
        *base.facts,
    ]
    if base.cost is None:
        return Explanation(base.result, facts, None, base.obstacle)
    first, each, kilobytes = _sample(plan, base.cost, [*range(min(plan.size, 1 + _TRIED))])
    left = plan.size - done
    parts = {}
    if left:
        workers = min(cores(), left)
        parts = {"preparation": first, f"{left:,} samples in {workers} processes": each * left / workers}
    cost = CostEstimate(
        parts, base.cost.megabytes * (1 + min(cores(), max(1, left))), 40 + kilobytes * plan.size
    )
    return Explanation(base.result, facts, cost)


def _sample(plan: Plan, alone: CostEstimate, numbers: Sequence[int]) -> tuple[float, float, float]:
    """Return the preparation time (s), the time of a sample (s) and its size in the file (kB)."""
    if alone.seconds > _PROBE:
        return 0.0, alone.seconds, alone.kilobytes / 10
    report_progress(f"trying {len(numbers)} samples")
    job = Job.of(plan.base, plan.collect)
    began = time.thread_time()
    outcomes = [run_chunk(job, plan.overrides(numbers[:1])).outcomes]
    first = time.thread_time() - began
    each = first
    if len(numbers) > 1:
        done = run_chunk(job, plan.overrides(numbers[1:]))
        outcomes.append(done.outcomes)
        each = done.seconds / (len(numbers) - 1)
    numbers_each = max(
        sum(value.data.nbytes for value in outcome.values.values()) / 8
        for part in outcomes
        for outcome in unpacked(part.content)
    )
    return (
        max(0.0, first - each),
        each,
        file_kilobytes(0, numbers_each + 6 + len(plan.columns)) - file_kilobytes(0, 0),
    )
