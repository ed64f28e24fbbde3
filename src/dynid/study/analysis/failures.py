"""Reasons of failed samples, equal reasons together."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.study.analysis.table import StudyTable

_NUMBER = re.compile(r"[-+±]?\d[\d.]*(?:[eE][-+]?\d+)?j?")


@dataclass(frozen=True)
class Failure:
    """One reason.

    Parameters
    ----------
    error
        Its words in the first sample that has it; in others the numbers may differ.
    exit_code
        2 (the scene), 3 (numerics) or 4 (a file).
    samples
        The numbers of the samples that have it.
    """

    error: str
    exit_code: int
    samples: NDArray[np.int64]


def failures(table: StudyTable) -> list[Failure]:
    """Return the reasons why samples failed, the most frequent first."""
    if not len(table.failed):
        return []
    errors = table.result["study/error"].data[table.failed]
    codes = table.result["study/exit_code"].data[table.failed]
    groups: dict[str, list[int]] = {}
    for place, error in enumerate(errors):
        groups.setdefault(_NUMBER.sub("#", str(error)), []).append(place)
    found = [
        Failure(str(errors[rows[0]]), int(codes[rows[0]]), table.numbers[table.failed[rows]])
        for rows in groups.values()
    ]
    return sorted(found, key=lambda failure: -len(failure.samples))
