"""What a worker does: samples of one scene, run together."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.checks import check_expectations
from dynid.result import Result
from dynid.scene.batch import Outcome, run_batch
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

if TYPE_CHECKING:
    from dynid.scene.load import Scene


@dataclass(frozen=True)
class Job:
    """What all samples of a study share.

    Parameters
    ----------
    text, file
        Their scene, and the name of its file.
    collect
        What is gathered.
    size
        How many they are.
    """

    text: str
    file: str
    collect: tuple[str, ...]
    size: int

    @classmethod
    def of(cls, base: Scene, collect: tuple[str, ...], size: int) -> Job:
        """Return the job of a scene; workers may stand in other folders."""
        return cls(base.source.resolved_text(), str(Path(base.source.file).absolute()), collect, size)


@dataclass(frozen=True)
class Done:
    """What a worker returns: the outcomes in order, and how long they took in seconds."""

    outcomes: list[Outcome]
    seconds: float


def run_chunk(job: Job, overrides: Sequence[Mapping[str, Any]]) -> Done:
    """Run samples; whatever happens to one of them is its outcome."""
    template = _template(job.text, job.file)
    started = time.perf_counter()
    outcomes = run_batch(template, overrides, job.collect, judge, job.size)
    return Done(outcomes, time.perf_counter() - started)


@lru_cache(maxsize=4)
def _template(text: str, file: str) -> Scene:
    """Read the scene once in each worker."""
    return check_source(parse_source(text, file))


def judge(result: Result, expected: Sequence[Mapping[str, Any]]) -> tuple[bool, ...]:
    """Say of each expectation whether a result meets it."""
    return tuple(outcome.passed for outcome in check_expectations(result, expected))
