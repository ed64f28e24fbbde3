"""A study explained: its size, how its samples are run, and what they cost together."""

from __future__ import annotations

import time
from collections.abc import Sequence

from dynid.progress import report_progress
from dynid.scene.batch import why_alone
from dynid.scene.explanations.explanation import CostEstimate, Explanation, Fact, explain, file_kilobytes
from dynid.scene.outcomes import SampleOutcome
from dynid.study.executors.base import cores
from dynid.study.packing import unpacked
from dynid.study.plan import Plan
from dynid.study.run import valid_samples
from dynid.study.work import Job, run_chunk

#: A sample that should take longer than this is not tried.
_PROBE = 2.0
#: Samples that are tried, after one that the others share its preparation with.
_TRIED = 4


def explain_study(plan: Plan, target: str) -> Explanation:
    """Explain a study.

    Parameters
    ----------
    plan
        Its samples.
    target
        The file that they would be written to; what it holds already is not done again.

    Returns
    -------
    Explanation
        The scene's own causality or identifiability; the cost of all samples that are not finished. Where
        one takes little, a few are run to measure it.
    """
    base = explain(plan.base)
    paths = list(plan.settings)
    report_progress("how samples are run")
    reason = (
        why_alone(plan.base, paths, plan.collect, plan.size) if base.obstacle is None else "the scene fails"
    )
    done = valid_samples(plan, target)
    facts = [
        Fact("scene", f"{plan.attrs['base']} ({plan.base.kind}); what follows of it is at its own values"),
        Fact("samples", f"{plan.size:,} by {plan.attrs['method']} over {', '.join(plan.arrays)}"),
        Fact("finished", f"{done:,} of them, in {target}" if done else f"none in {target}"),
        Fact("batched", f"no, one by one: {reason}" if reason else "yes, samples share their preparation"),
        Fact("processes", f"{cores()}: one a core, unless --workers or --scheduler says otherwise"),
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


def _numbers(outcome: SampleOutcome) -> float:
    return sum(value.data.nbytes for value in outcome.values.values()) / 8


def _sample(plan: Plan, alone: CostEstimate, numbers: Sequence[int]) -> tuple[float, float, float]:
    """Return seconds of the first sample beyond those of any other, of another, and kilobytes of each."""
    if alone.seconds > _PROBE:
        return 0.0, alone.seconds, alone.kilobytes / 10
    report_progress(f"trying {len(numbers)} samples")
    job = Job.of(plan.base, plan.collect, len(numbers))  # what repays over the whole study is not compiled
    began = time.thread_time()
    outcomes = [run_chunk(job, plan.overrides(numbers[:1])).outcomes]
    first = time.thread_time() - began
    each = first
    if len(numbers) > 1:
        done = run_chunk(job, plan.overrides(numbers[1:]))
        outcomes.append(done.outcomes)
        each = done.seconds / (len(numbers) - 1)
    gathered = max(_numbers(one) for part in outcomes for one in unpacked(part.content))
    return (
        max(0.0, first - each),
        each,
        file_kilobytes(0, gathered + 6 + len(plan.columns)) - file_kilobytes(0, 0),
    )
