"""Explanation of a study: its size, how its samples are run, and their total cost."""

from __future__ import annotations

import time

from dynid.progress import report_progress
from dynid.scene.batch import why_alone
from dynid.scene.explanations.explanation import (
    Cost,
    Explanation,
    Fact,
    explain,
    file_kilobytes,
    peak_megabytes,
)
from dynid.study.executors.base import cores
from dynid.study.plan import Plan
from dynid.study.run import valid_samples
from dynid.study.work import Job, run_chunk, unpacked

#: Time of the first sample above which no others are tried, s.
_SLOW_SAMPLE = 1.0
#: Samples that are tried after the first, whose preparation they share.
_TRIED = 4


def explain_study(plan: Plan, target: str) -> Explanation:
    """Explain a study: its scene, and how the samples are run that are not finished in the file to write."""
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
    return Explanation(base.result, facts, base.obstacle)


def study_cost(plan: Plan, target: str) -> Cost:
    """Return the cost of the samples of a study that are not finished, from a trial of the first few."""
    remaining = plan.size - valid_samples(plan, target)
    count = min(plan.size, 1 + _TRIED)
    report_progress(f"trying {count} samples")
    job = Job.of(plan.base, plan.collect)
    began = time.thread_time()
    chunks = [run_chunk(job, plan.overrides([0]))]
    first = seconds_per_sample = time.thread_time() - began
    if count > 1 and first < _SLOW_SAMPLE:
        chunks.append(run_chunk(job, plan.overrides([*range(1, count)])))
        seconds_per_sample = chunks[-1].seconds / (count - 1)
    size = max(
        sum(value.data.nbytes for value in outcome.values.values())
        for chunk in chunks
        for outcome in unpacked(chunk.outcomes.content)
    )
    workers = min(cores(), max(1, remaining))
    seconds = (
        max(0.0, first - seconds_per_sample) + seconds_per_sample * remaining / workers if remaining else 0.0
    )
    sample = size + 8 * (6 + len(plan.columns))
    return Cost(
        seconds,
        peak_megabytes() * (1 + workers),
        file_kilobytes(40, sample * plan.size),
        "from a trial of its first samples",
    )
