"""Recognition of sampling designs from the samples, which may be a list made by other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[Any]]


def sortable(column: NDArray[Any]) -> NDArray[Any]:
    """Return a column in a type with an order; texts as strings."""
    return column.astype(str) if column.dtype.kind == "O" else column


@dataclass(frozen=True)
class SaltelliDesign:
    """Saltelli's design: samples A and B, and for each factor i, A with its column i from B.

    Parameters
    ----------
    factors
        The inputs that change together, for each of the d factors.
    blocks
        A, B and the mixed samples follow each other as blocks; else as rows of d + 2: one sample of A, the
        mixed ones, and the one of B.
    """

    factors: tuple[tuple[str, ...], ...]
    blocks: bool

    def split(self, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the values at A, at B (each of shape (rows,)) and at the mixed samples (factors, rows)."""
        rows = _rows(values, len(self.factors), self.blocks)
        return rows[:, 0], rows[:, -1], rows[:, 1:-1].T


def saltelli_design(inputs: Columns) -> SaltelliDesign | None:
    """Return Saltelli's design of the samples; None if they have another design.

    Parameters
    ----------
    inputs
        The samples, by input. Inputs that change together are one factor; an input that is a function of
        several factors is no factor.
    """
    count = len(next(iter(inputs.values()), ()))
    for factors in range(len(inputs), 0, -1):
        if count % (factors + 2) == 0 and count > factors + 2:
            for blocks in (True, False):
                found = _saltelli_factors(inputs, factors, blocks)
                if found is not None:
                    return SaltelliDesign(found, blocks)
    return None


def _rows(column: NDArray[Any], factors: int, blocks: bool) -> NDArray[Any]:
    """Return the samples in rows: A, mixed, B."""
    if not blocks:
        return column.reshape(-1, factors + 2)
    return column.reshape(factors + 2, -1).T[:, [0, *range(2, factors + 2), 1]]


def _saltelli_factors(inputs: Columns, count: int, blocks: bool) -> tuple[tuple[str, ...], ...] | None:
    found: list[list[str]] = [[] for _ in range(count)]
    for name, column in inputs.items():
        rows = _rows(column, count, blocks)
        a, b = rows[:, :1], rows[:, -1:]
        of_a, of_b = (rows[:, 1:-1] == a).all(axis=0), (rows[:, 1:-1] == b).all(axis=0)
        if of_b.sum() == 1 and not (of_a & of_b).any() and (of_a | of_b).all():
            found[int(np.flatnonzero(of_b)[0])].append(name)
    own = [name for group in found for name in group]
    others = [name for name in inputs if name not in own]
    if not all(found):
        return None
    # The other inputs must be functions of the factors; in a part of a grid they are not.
    together = len(_levels(inputs, own)) if others else 0
    dependent = all(len(_levels(inputs, [*own, name])) == together for name in others)
    return tuple(map(tuple, found)) if dependent else None


def _levels(inputs: Columns, names: list[str]) -> NDArray[np.intp]:
    """Return the different combinations of values of several inputs, as ranks."""
    ranks = [np.unique(sortable(inputs[name]), return_inverse=True)[1] for name in names]
    return np.unique(np.stack(ranks, axis=-1), axis=0)


@dataclass(frozen=True)
class OneAtATime:
    """Samples that differ from a centre in one input each.

    Parameters
    ----------
    centre
        The samples at the centre.
    varied
        For each input, the samples that differ from the centre in this input only.
    """

    centre: NDArray[np.intp]
    varied: Mapping[str, NDArray[np.intp]]


def one_at_a_time(inputs: Columns) -> OneAtATime | None:
    """Return a design whose samples differ from a centre in at most one input; None for other samples."""
    changed = {}
    for name, column in inputs.items():
        levels, counts = np.unique(sortable(column), return_counts=True)
        changed[name] = sortable(column) != levels[np.argmax(counts)]
    if not changed:
        return None
    differing = np.sum(list(changed.values()), axis=0)
    if differing.max(initial=0) != 1 or not (differing == 0).any():
        return None
    varied = {name: np.flatnonzero(where) for name, where in changed.items() if where.any()}
    return OneAtATime(np.flatnonzero(differing == 0), varied)
