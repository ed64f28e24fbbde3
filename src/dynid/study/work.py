"""Task of an executor: a chunk of samples of one scene, run together."""

from __future__ import annotations

import socket
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid._version import __version__
from dynid.checks import check_expectations, samples_meet
from dynid.errors import FileError
from dynid.result import Result
from dynid.scene.batch import Expected, run_batch
from dynid.scene.load import check_source
from dynid.scene.outcomes import SampleBlock
from dynid.scene.yaml.source import parse_source
from dynid.study.packing import Packed, packed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.scene.load import Scene


@dataclass(frozen=True)
class Job:
    """Data that all samples of a study share.

    Parameters
    ----------
    text, file
        The text of the scene, and the name of its file.
    collect
        Paths of the outputs to collect.
    version
        The version of dynid that runs the study.
    """

    text: str
    file: str
    collect: tuple[str, ...]
    version: str = __version__

    @classmethod
    def of(cls, base: Scene, collect: tuple[str, ...]) -> Job:
        """Return the job of a scene, with an absolute path for workers in other folders."""
        return cls(base.source.resolved_text(), str(Path(base.source.file).absolute()), collect)


@dataclass(frozen=True)
class Done:
    """Result of a chunk: the outcomes in order, and the time they took, s."""

    outcomes: Packed
    seconds: float


def run_chunk(job: Job, overrides: Sequence[Mapping[str, Any]]) -> Done:
    """Run samples; the error of a failed one is its outcome."""
    if job.version != __version__:
        problem = f"a worker on {socket.gethostname()} has dynid {__version__}, and the study {job.version}"
        raise FileError(problem, remedy="Install the same version on all workers, and run the study again.")
    template = _template(job.text, job.file)
    started = time.perf_counter()
    outcomes = packed(run_batch(template, overrides, job.collect, JUDGE))
    return Done(outcomes, time.perf_counter() - started)


@lru_cache(maxsize=4)
def _template(text: str, file: str) -> Scene:
    """Parse the scene, once in each worker."""
    return check_source(parse_source(text, file))


class _Judge:
    """Checker of the expectations that results meet."""

    def one(self, result: Result, expected: Expected) -> tuple[bool, ...]:
        """Return for one result whether each expectation is met."""
        return tuple(outcome.passed for outcome in check_expectations(result, expected))

    def many(self, block: SampleBlock, expected: Expected, kind: str, title: str) -> NDArray[np.bool_]:
        """Return for many samples whether each expectation is met (samples x expectations)."""
        return samples_meet(
            block.values, len(block), lambda place: block.result(place, kind, title), expected
        )


JUDGE = _Judge()
