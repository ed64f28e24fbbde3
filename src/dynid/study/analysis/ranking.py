"""Ranking of inputs by their influence on a result."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.study.analysis.correlation import correlations
from dynid.study.analysis.design import SaltelliDesign, saltelli_design
from dynid.study.analysis.influence import Indices, classes, from_design, from_samples
from dynid.study.analysis.table import StudyTable

#: Correlation of two inputs above which their parts of a variance overlap noticeably.
OVERLAPPING = 0.2


class Influences:
    """The Sobol indices of the numbers of one study.

    Parameters
    ----------
    table
        The study. Where its samples are Saltelli's design, indices are of first and total order and inputs
        that change together are one factor; else of first order, and of every input.
    """

    def __init__(self, table: StudyTable) -> None:
        self.inputs = {name: column for name, column in table.inputs.items() if _varies(column)}

    @cached_property
    def design(self) -> SaltelliDesign | None:
        """Saltelli's design, where the samples are one."""
        return saltelli_design(self.inputs)

    @cached_property
    def factors(self) -> list[str]:
        """The names of what the indices are of."""
        return (
            list(self.inputs) if self.design is None else [", ".join(group) for group in self.design.factors]
        )

    def of(self, values: NDArray[np.float64]) -> Indices | None:
        """Return the indices of one number; None where it does not vary, or the samples are too few."""
        if not self.inputs:
            return None
        if self.design is not None:
            return from_design(*self.design.split(values))
        return from_samples(self._classes, values)

    def direction(self, factor: int, values: NDArray[np.float64]) -> float:
        """Return the rank correlation of an input with a number; NaN of a text, and of several inputs."""
        x = self.inputs.get(self.factors[factor])
        if x is None or x.dtype.kind not in "bif":
            return float("nan")
        return float(correlations([x.astype(float)], [values], ranks=True)[0, 0])

    @cached_property
    def correlated(self) -> tuple[str, str, float] | None:
        """The two inputs that are most correlated, where that makes their parts of a variance overlap."""
        numbers = {name: x.astype(float) for name, x in self.inputs.items() if x.dtype.kind in "bif"}
        names = list(numbers)
        if self.design is not None or len(names) < 2:
            return None
        found = np.corrcoef(list(numbers.values()))
        np.fill_diagonal(found, 0)
        first, second = np.unravel_index(np.argmax(np.abs(found)), found.shape)
        value = float(found[first, second])
        # Of independent samples, five standard errors are chance in one of two million.
        chance = 5 / np.sqrt(len(numbers[names[0]]))
        return (names[first], names[second], value) if abs(value) > max(OVERLAPPING, chance) else None

    @cached_property
    def _classes(self) -> list[NDArray[np.intp]]:
        return [classes(column) for column in self.inputs.values()]


def _varies(column: NDArray[Any]) -> bool:
    return bool(len(column)) and bool((column != column[0]).any())
