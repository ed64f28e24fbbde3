"""Segments of a record of loops with delays, on which all quantities are polynomials.

Their borders are the break points b + Σ k_i τ_i, as far as these show (the method of steps).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import NumericalError
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.lti.method_of_steps import break_orders
from dynid.lti.state_space import Matrices, StateSpace
from dynid.lti.time_response import derivative_jumps

_DEGREE = 16
# Fastest rate of the cut loops, times the length of a segment, that the polynomials resolve.
_MAX_RATE = 3.0
# Most segments.
_MAX_SEGMENTS = 500_000
# Order of the derivative up to which jumps are borders; of the many of sampled inputs, between which
# segments are short, fewer.
_MAX_ORDER, _MAX_SAMPLED_ORDER, _FEW_BREAKS = 8, 5, 50
# Borders, and lengths of segments, that differ by less than this part of the record are one.
_SAME_TIME = 1e-12
# Most segments that are computed at once; part of a segment by which points are moved inwards to find what
# was a delay before.
_MAX_WINDOW, _INWARDS = 128, 1e-6

#: Points of a segment, from 0 to 1; values of the polynomials there, their inverse, and the derivatives of
#: coefficients.
POINTS = (1 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)) / 2
VALUES = chebyshev.chebvander(2 * POINTS - 1, _DEGREE)
INVERSE = np.linalg.inv(VALUES)
RATE = np.stack([np.pad(2 * chebyshev.chebder(row), (0, 1))[: _DEGREE + 1] for row in np.eye(_DEGREE + 1)], 1)
COUNT = _DEGREE + 1


def basis(fractions: Array) -> Array:
    """Return the polynomials at fractions of their segment (… x degree + 1)."""
    angle = np.arccos(np.clip(2 * fractions - 1, -1.0, 1.0))
    return np.asarray(np.cos(angle[..., None] * np.arange(COUNT)))


class Loops(NamedTuple):
    """The system at coordinates of the parameters."""

    matrices: Matrices  # with v as the last inputs and z as the last outputs
    delays: Array  # s (m)
    delay_slopes: Array  # by the coordinates (p x m)

    @property
    def loads(self) -> int:
        """The number of inputs u."""
        return int(self.matrices.B.shape[1]) - len(self.delays)

    @property
    def channels(self) -> int:
        """The number of outputs beside z."""
        return len(self.matrices.C) - len(self.delays)


class Own(NamedTuple):
    """Points of a segment whose time less a delay is in it, too, and the matrices to the values there."""

    inside: NDArray[np.bool_]  # m x points
    matrix: Array  # m x points x points


class Grid:
    """Segments of a record, and the inputs on them."""

    def __init__(self, model: ParametricModel, loops: Loops, parts: int) -> None:
        first, last = model.line.nodes[[0, -1]].tolist()
        self.delays = loops.delays
        self.tolerance = _SAME_TIME * max(last - first, abs(first), abs(last))
        rate = np.abs(np.linalg.eigvals(loops.matrices.A)).max(initial=0.0)
        borders = self._borders(model, loops, first, last)
        counts = parts * np.maximum(1, np.ceil(np.diff(borders) * rate / _MAX_RATE)).astype(np.int64)
        _check_number(int(counts.sum()), loops)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        steps = np.repeat(np.diff(borders) / counts, counts)
        self.borders = np.append(np.repeat(borders[:-1], counts) + within * steps, last)
        self.lengths = np.diff(self.borders)
        _, chosen, self.which = np.unique(
            np.round(self.lengths / self.tolerance), return_index=True, return_inverse=True
        )
        self.distinct = self.lengths[chosen]
        self.inputs = self._inputs(model, loops)

    def _borders(self, model: ParametricModel, loops: Loops, first: float, last: float) -> Array:
        """Return the break points, and the first and the last time of a record."""
        matrices, nu = loops.matrices, loops.loads
        space = StateSpace(matrices.A, matrices.B, matrices.C, matrices.D[0], tuple(matrices.D[1:]))
        passed = break_orders(space)[loops.channels :]  # orders that an input gains on the way to z
        # By input, order of the derivative that jumps, and the highest that shows.
        present: dict[tuple[int, float, int], Array] = {}
        for column, (times, order) in enumerate(_input_breaks(model)):
            limit = _MAX_ORDER if len(times) < _FEW_BREAKS else _MAX_SAMPLED_ORDER
            present[column, order, limit] = times
        for index, delay in enumerate(loops.delays.tolist()):
            present[nu + index, 0.0, _MAX_ORDER] = np.array([first + delay])
        found = [np.array([first, last])]
        while present:
            found += present.values()
            _check_number(sum(map(len, found)), loops)
            later = defaultdict(list)
            for (column, order, limit), breaks in present.items():
                for index, delay in enumerate(loops.delays.tolist()):
                    following = max(order + passed[index, column], 0.0)
                    if following <= limit:
                        later[nu + index, following, limit].append(breaks + delay)
            merged = {key: self._merged(np.concatenate(parts)) for key, parts in later.items()}
            present = {key: breaks[breaks < last] for key, breaks in merged.items() if breaks[0] < last}
        breaks = np.concatenate(found)
        return np.append(self._merged(breaks[breaks < last - self.tolerance]), last)

    def _merged(self, times: Array) -> Array:
        """Return times in order, each once."""
        times = np.sort(times)
        return np.asarray(times[np.append(True, np.diff(times) > self.tolerance)])

    def _inputs(self, model: ParametricModel, loops: Loops) -> Array:
        """Return the inputs and their derivatives at the points (orders x segments x points x loads)."""
        times = self.borders[:-1, None] + self.lengths[:, None] * POINTS
        middles = np.repeat(self.borders[:-1] + self.lengths / 2, COUNT)
        out = np.zeros((len(loops.matrices.D), *times.shape, loops.loads))
        for column in np.flatnonzero(model.acting).tolist():
            G, readout = model.line.signals[column].generator()
            states = model.line.signals[column].states(times.ravel(), middles)
            for order in range(len(out)):
                out[order, ..., column] = (states @ readout).reshape(times.shape)
                readout = readout @ G
        return out

    def windows(self) -> Iterator[slice]:
        """Yield the segments that can be computed at once: none follows another by a delay."""
        reach = self.borders[:-1] + (self.delays.min() + self.tolerance)
        ends = np.searchsorted(self.borders, reach, side="right") - 1
        first = 0
        while first < len(self.lengths):
            last = min(max(int(ends[first]), first + 1), first + _MAX_WINDOW)
            yield slice(first, last)
            first = last

    def own(self, length: float) -> Own | None:
        """Return where a segment follows itself by a delay; None where it is shorter than all delays."""
        if length <= self.delays.min() + self.tolerance:
            return None
        inside = (self.delays[:, None] / length <= POINTS) & (length > self.delays[:, None] + self.tolerance)
        matrix = basis(POINTS - self.delays[:, None] / length) @ INVERSE
        return Own(inside, np.where(inside[..., None], matrix, 0.0))

    def border(self, time: float) -> int:
        """Return the border at a time, -1 where there is none."""
        index = int(np.searchsorted(self.borders, time - 4 * self.tolerance))
        near = index < len(self.lengths) and self.borders[index] <= time + 4 * self.tolerance
        return index if near else -1


def _check_number(count: int, loops: Loops) -> None:
    if count > _MAX_SEGMENTS:
        raise NumericalError(
            f"the record takes {count:,} segments or more at a delay of {loops.delays.min():.3g} s; at most "
            f"{_MAX_SEGMENTS:,} are computed",
            remedy="Shorten the record, or limit the delays and the fastest parts (min, max).",
        )


# Break points of the inputs, which do not depend on the parameters.
_BREAKS: WeakKeyDictionary[ParametricModel, list[tuple[Array, float]]] = WeakKeyDictionary()


def _input_breaks(model: ParametricModel) -> list[tuple[Array, float]]:
    """Return the break points of each input in a record, and the order of the derivative that jumps there."""
    if model not in _BREAKS:
        first, last = model.line.nodes[[0, -1]].tolist()
        breaks = []
        for signal in model.line.signals:
            times = signal.breakpoints(first, last)
            orders = (k for k in range(_MAX_ORDER + 1) if derivative_jumps(signal, k, last))
            if len(times := np.unique(times[(times > first) & (times < last)])):
                breaks.append((times, float(next(orders, np.inf))))
        _BREAKS[model] = breaks
    return _BREAKS[model]


class Past(NamedTuple):
    """Where a window reads what was delays before (m): pieces and polynomials there."""

    pieces: NDArray[np.int64]  # m x segments x points; -1: before the record, or in the segment itself
    polynomials: Array  # … x degree + 1

    @classmethod
    def of(cls, grid: Grid, window: slice, own: Own | None) -> Past:
        """Return where the segments of a window read, beside their own values."""
        lengths, borders = grid.lengths[window, None], grid.borders
        times = borders[:-1][window, None] + lengths * POINTS - grid.delays[:, None, None]
        inwards = times + _INWARDS * lengths * (1 - 2 * POINTS)
        pieces = np.minimum(np.searchsorted(borders, inwards, side="right") - 1, window.start - 1)
        if own is not None:
            pieces[own.inside[:, None]] = -1
        at = np.maximum(pieces, 0)
        return cls(pieces, basis((times - borders[at]) / grid.lengths[at]))

    def read(self, coefficients: Array) -> Array:
        """Return v of quantities by their coefficients (pieces x degree + 1 x m x q)."""
        parts = []
        for index, (pieces, values_at) in enumerate(zip(self.pieces, self.polynomials, strict=True)):
            values = np.einsum("kpj,kpjq->kpq", values_at, coefficients[np.maximum(pieces, 0), :, index])
            parts.append(np.where((pieces >= 0)[..., None], values, 0.0))
        return np.stack(parts, axis=2)
