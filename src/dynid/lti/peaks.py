"""Maxima of frequency responses.

The largest value on a grid depends on the grid. Here the brackets around the local maxima of a response, on
the grid and near natural frequencies, are narrowed by evaluating the response until its value converges.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError

if TYPE_CHECKING:
    from dynid.result import Result


#: Returns a response, shape (omega, output, input), at ascending angular frequencies in rad/s.
ResponseFunction = Callable[[Array], ComplexArray]

#: Frequencies within each bracket at a time: its width shrinks to 2/11 in a round.
_POINTS_INSIDE = 10
#: Frequencies nearer to each other than this part of the bracket count as one.
_MIN_FREQUENCY_SEPARATION = 0.01
#: Most local maxima of a channel, the largest ones, that are refined.
_MAX_BRACKETS = 4
#: A bracket is narrow enough where the response changes by less than this within it, relative. The frequency
#: of a maximum is then known to about the square root, times the width of the resonance.
_FLAT_PEAK_TOL = 1e-10
#: Rounds after which a bracket of any width has shrunk to neighbouring numbers ((2/11)^30 = 6e-23).
_BRACKET_ROUNDS = 30


class Peaks(NamedTuple):
    """The largest magnitude of every channel (output, input), inf at an undamped pole; where, rad/s."""

    magnitude: Array
    omega: Array


def peaks(
    evaluate: ResponseFunction, omega: ArrayLike, response: ComplexArray, near: ArrayLike = ()
) -> Peaks:
    """Find the largest magnitude of every channel over the band of an ascending grid, rad/s.

    Where `evaluate` raises `NumericalError`, because a frequency lies on an undamped pole to double
    precision, the response is infinite there. `near` are further frequencies at which to look, of the band:
    imaginary parts and moduli of poles. With them a resonance between two frequencies of a coarse grid is
    found; without them only the local maxima of the grid are refined.
    """
    grid = np.asarray(omega, dtype=float)
    sizes = np.abs(response)
    candidates = np.unique(np.asarray(near, dtype=float))
    candidates = candidates[(candidates > grid[0]) & (candidates < grid[-1]) & ~np.isin(candidates, grid)]
    if len(candidates):
        order = np.argsort(np.concatenate([grid, candidates]), kind="stable")
        sizes = np.concatenate([sizes, _sizes(evaluate, candidates)])[order]
        grid = np.concatenate([grid, candidates])[order]
    shape = sizes.shape[1:]
    flat = sizes.reshape(len(grid), -1)
    brackets = []
    for column, values in enumerate(flat.T):
        left = np.concatenate([[True], values[1:] > values[:-1]])
        right = np.concatenate([values[:-1] >= values[1:], [True]])
        maxima = np.flatnonzero(left & right & (values > 0))  # of equal neighbours the first
        largest = maxima[np.argsort(-values[maxima], kind="stable")][:_MAX_BRACKETS]
        brackets += [_Bracket(column, grid, values, int(at)) for at in largest]
    for _ in range(_BRACKET_ROUNDS):  # each round evaluates the response once for all brackets
        active = [bracket for bracket in brackets if bracket.open]
        if not active:
            break
        inside = [bracket.inside() for bracket in active]
        among = np.unique(np.concatenate(inside))
        refined_sizes = _sizes(evaluate, among).reshape(len(among), -1)
        for bracket, requested in zip(active, inside, strict=True):
            bracket.narrow(requested, refined_sizes[np.searchsorted(among, requested), bracket.column])
    magnitude, where = flat.max(axis=0), grid[flat.argmax(axis=0)]
    for bracket in brackets:
        if bracket.top > magnitude[bracket.column]:
            magnitude[bracket.column], where[bracket.column] = bracket.top, bracket.where
    return Peaks(magnitude.reshape(shape), where.reshape(shape))


def add_peaks(result: Result, holder: str, evaluate: ResponseFunction, near: ArrayLike = ()) -> None:
    """Add `frequency_peaks/` (`magnitude`, `omega`) beside a holder's `frequency_response/`; see `peaks`."""
    group, peak_group = f"{holder}/frequency_response", f"{holder}/frequency_peaks"
    response = result[f"{group}/response"]
    maxima = peaks(evaluate, result[f"{group}/omega"].data, response.data, near)
    for axis in ("output", "input"):
        result.add_axis(f"{peak_group}/{axis}", result[f"{group}/{axis}"].data)
    result.add(f"{peak_group}/magnitude", maxima.magnitude, ("output", "input"), response.units)
    result.add(f"{peak_group}/omega", maxima.omega, ("output", "input"), "rad/s")


class _Bracket:
    """Neighbouring frequencies around a local maximum of one channel."""

    def __init__(self, column: int, grid: Array, sizes: Array, at: int) -> None:
        self.column = column
        self.omega = grid[max(at - 1, 0) : at + 2]
        self.sizes = sizes[max(at - 1, 0) : at + 2]
        self.top, self.where = float(sizes[at]), float(grid[at])
        self.open = bool(np.isfinite(self.top)) and len(self.omega) > 1

    def inside(self) -> Array:
        """Return the next frequencies, none next to a known one; ever nearer to a maximum at an end."""
        first, last = self.omega[0], self.omega[-1]
        if self.where in (first, last):
            shares = 10.0 ** -np.arange(1, _POINTS_INSIDE + 1)
            return np.unique(self.where + (last + first - 2 * self.where) * shares)
        spread = np.linspace(first, last, _POINTS_INSIDE + 2)[1:-1]
        distance = np.abs(spread[:, None] - self.omega).min(axis=1)
        return np.asarray(spread[distance > _MIN_FREQUENCY_SEPARATION * (self.omega[-1] - self.omega[0])])

    def narrow(self, omega: Array, sizes: Array) -> None:
        """Keep the neighbours of the largest value."""
        places = np.concatenate([self.omega, omega])
        order = np.argsort(places)
        places, values = places[order], np.concatenate([self.sizes, sizes])[order]
        at = int(np.argmax(values))
        self.top, self.where = float(values[at]), float(places[at])
        rows = slice(max(at - 1, 0), at + 2)
        self.omega, self.sizes = places[rows], values[rows]
        self.open = bool(np.isfinite(self.top) and self.sizes.min() < (1 - _FLAT_PEAK_TOL) * self.top)
        if self.open and self.omega[-1] - self.omega[0] <= 4 * np.spacing(self.omega[-1]):
            self.open = False
            if self.sizes.min() < 0.5 * self.top:  # between neighbouring doubles: a pole on the axis
                self.top = np.inf


def _sizes(evaluate: ResponseFunction, omega: Array) -> Array:
    """Return magnitudes; infinite where a frequency lies on a pole to double precision."""
    try:
        return np.abs(evaluate(omega))
    except NumericalError:
        if len(omega) == 1:
            raise
    largest = []
    for frequency in omega:
        try:
            largest.append(np.abs(evaluate(np.array([frequency])))[0])
        except NumericalError:
            largest.append(None)
    shape = next((sizes.shape for sizes in largest if sizes is not None), None)
    if shape is None:
        return np.abs(evaluate(omega))
    return np.array([np.full(shape, np.inf) if sizes is None else sizes for sizes in largest])
