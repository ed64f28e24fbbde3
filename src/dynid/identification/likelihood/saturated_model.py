"""Regressors of the saturated model of a record: the response of any linear structure, channel by channel.

The scene's model ties all amplitudes and poles to a few unknowns. In the saturated model they are free,
channel by channel: a complex amplitude at every excited frequency; where a force is not a sum of sines, a
residue of every pole and a direct term; free decays; and the poles themselves, to first order. The scene's
prediction and its derivatives belong to it as well, so that the scene's model is nested in it to first order.
Further regressors are for other faults of a model: a trend, and harmonics (powers of the prediction: J. B.
Ramsey, J. R. Stat. Soc. B 31 (1969) 350–371). Delayed residuals take up the predictable part of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.defaults import SATURATED
from dynid.identification.records.frf_measurement import stacked
from dynid.lti.recurrence import recurrence
from dynid.lti.signals import Multisine, Signal

Labels: TypeAlias = tuple[NDArray[np.int_], NDArray[np.int_], ComplexArray, Array]
"""Kinds, groups, poles and rates of columns."""

# Part of the values of a channel that the regressors may be.
_COLUMN_PART = 3
# Most delayed residuals that are regressors; and the part of the values that they may be.
_MAX_LAGS, _LAG_PART = 8, 20
# A pole this many times faster than the sampling rate has decayed within a sample.
_FAST_POLE_RATIO = 3.0
# Largest growth over a record that a column may have.
_MAX_COLUMN_GROWTH = 30.0
# Norm of a column of norm 1, projected off those before it, below which it is linearly dependent.
_NEW_DIRECTION_NORM = 1e-5
# That of a column off a range of which it is a part, to rounding.
_RANGE_ROUND_OFF = 1e-11


class RegressorKind:
    """The kinds of regressors, as numbers in the order of their columns.

    Lines and direct terms, modes, derivatives by poles, the scene's own, faults, delayed residuals.
    """

    LINE = 0
    MODE = 1
    POLE = 2
    SCENE = 3
    FAULT = 4
    BEFORE = 5


class Directions(NamedTuple):
    """Orthonormal directions that columns add in turn (m x rows), and where they come from.

    `places` (m): the column of each; `size` (m): the norm of what that one has beside those before it.
    """

    places: NDArray[np.int_]
    size: Array
    vectors: Array

    def first(self, count: int) -> Directions:
        """Return the first ones, at most so many."""
        few = slice(max(count, 0))
        return Directions(self.places[few], self.size[few], self.vectors[few])


@dataclass(frozen=True, eq=False)
class Regressors:
    """Regressors (rows x d) with their `kind` (d) and `group` (d): columns of one complex number.

    The derivative by a pole has the group of the mode's amplitude. `rate` (d) is the change of a pole's
    column by a relative change of the pole, and `pole` (d) the pole itself, NaN of other columns.
    """

    values: Array
    kind: NDArray[np.int_]
    group: NDArray[np.int_]
    pole: ComplexArray
    rate: Array
    # Free decays, which span most derivatives by the first state (rows x any); they are no regressors.
    decays: Array | None = None
    _labels: dict[tuple[int, ...], Labels] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(
        cls, kind: int, pairs: Sequence[Array], rows: int, poles: Sequence[complex] = (), span: float = 0.0
    ) -> Regressors:
        """Return groups of columns of one kind; of poles over a record that spans so many seconds."""
        widths = [pair.shape[1] for pair in pairs]
        pole = np.repeat(np.array([*poles, *[np.nan] * (len(pairs) - len(poles))], dtype=complex), widths)
        return cls(
            np.concatenate([np.zeros((rows, 0)), *pairs], axis=1),
            np.full(sum(widths), kind),
            np.repeat(np.arange(len(pairs)), widths),
            pole,
            np.abs(pole) * span,
        )

    @classmethod
    def of_poles(cls, kind: int, columns: ComplexArray, poles: ComplexArray, span: float = 0.0) -> Regressors:
        """Return the real columns that complex ones (rows x groups) of poles (groups) span."""
        real = np.ascontiguousarray(columns).view(float)
        kept = np.ones((len(poles), 2), dtype=bool)
        kept[:, 1] = poles.imag != 0
        group, _ = kept.nonzero()
        pole = poles[group]
        values = real if kept.all() else real[:, kept.ravel()]
        return cls(values, np.full(len(group), kind), group, pole, np.abs(pole) * span)

    def joined(self, *others: Regressors) -> Regressors:
        """Return these columns and, after them, others."""
        parts = ("values", "kind", "group", "pole", "rate")
        blocks = ([getattr(block, part) for block in (self, *others)] for part in parts)
        return Regressors(*(np.concatenate(block, axis=-1) for block in blocks))

    @cached_property
    def directions(self) -> tuple[Directions, Array]:
        """Their directions, and all of the range of regressors and decays, these first (any x rows)."""
        count, decays = self.values.shape[1], self.decays
        columns = np.concatenate([self.values] if decays is None else [self.values, decays], axis=1)
        norms = np.linalg.norm(columns, axis=0)
        columns /= np.where(norms > 0, norms, 1.0)
        Q, R = np.linalg.qr(columns)
        del columns  # as large as Q
        places, size, vectors = _directions(R[:, :count])
        rest = np.linalg.qr(vectors.T, mode="complete")[0].T[len(places) :]
        both = np.concatenate([vectors, rest]) @ Q.T
        return Directions(places, size * norms[places], both[: len(places)]), both

    def labels_with(self, *widths: int) -> Labels:
        """Return kinds, groups, poles, rates with so many columns of the scene, faults and delays after."""
        if widths not in self._labels:
            kinds = np.repeat([RegressorKind.SCENE, RegressorKind.FAULT, RegressorKind.BEFORE], widths)
            none = np.full(len(kinds), -1)
            self._labels[widths] = (
                np.concatenate([self.kind, kinds]),
                np.concatenate([self.group, none]),
                np.concatenate([self.pole, none]),
                np.concatenate([self.rate, none]),
            )
        return self._labels[widths]

    def where(self, there: NDArray[np.bool_]) -> Regressors:
        """Return the regressors of a channel whose values are there (rows)."""
        if there.all():
            return self
        decays = None if self.decays is None else self.decays * there[:, None]
        return replace(self, values=self.values * there[:, None], decays=decays)


@dataclass(frozen=True, eq=False)
class SaturatedCoordinates:
    """A channel in orthonormal directions of its saturated model."""

    # `kind`, `group`, `pole`, `rate`: as of the regressor that each direction comes from (m)
    kind: NDArray[np.int_]
    group: NDArray[np.int_]
    pole: ComplexArray
    rate: Array
    size: Array  # norm of that regressor beside those before it (m)
    # `measured`, `residual`: measured values and the scene's residuals (m)
    measured: Array
    residual: Array
    # `by_state`, `by_parameter`: derivatives of the prediction (m x n, m x p)
    by_state: Array
    by_parameter: Array
    count: float  # number of independent values
    # `energy`, `left`: sums of squares of the measured values and of the residuals
    energy: float
    left: float

    @cached_property
    def tested(self) -> int:
        """Number of directions that are tested, the first ones: all but delayed residuals."""
        return int(np.count_nonzero(self.kind < RegressorKind.BEFORE))

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Mask of directions of lines and modes (m)."""
        return self.kind <= RegressorKind.MODE


class ChannelColumns(NamedTuple):
    """The saturated model of one channel (rows): `prediction`, `measured`, `residual`, derivatives.

    `by_state` (rows x n), `by_parameter` (rows x p), `faults` and delayed residuals `before` (rows x
    any).
    """

    prediction: Array
    measured: Array
    residual: Array
    by_state: Array
    by_parameter: Array
    faults: Array
    before: Array


class ForcedRegressors(NamedTuple):
    """Regressors of a record that do not depend on an estimate: lines and direct terms, `direct`.

    `forces` (times x any) are those that are no sums of few sines, to which the modes respond.
    """

    direct: Regressors
    forces: Array


def forced_regressors(
    signals: Sequence[Signal], inputs: Sequence[Array], times: Array, max_count: int
) -> ForcedRegressors:
    """Return the regressors of the forces, which the channels of a record of time share.

    `signals`: the inputs as signals; `inputs`: their values, and their derivatives (times x signals).
    `times`: sampling times, s, evenly spaced; `max_count`: how many regressors there may be.
    """
    # The sums of sines among the signals, or those of which a signal is a derivative.
    sources = [getattr(signal, "signal", signal) for signal in signals]
    sines = [source for source in sources if isinstance(source, Multisine)]
    excited = [np.abs(sine.frequency)[np.asarray(sine.amplitude) != 0] for sine in sines]
    lines = np.unique(np.concatenate([np.empty(0), *excited]))
    broad = [k for k, source in enumerate(sources) if not isinstance(source, Multisine)]
    if 2 * len(lines) > max_count // 2:  # too many to be free: as a broadband force
        lines, broad = np.empty(0), list(range(len(signals)))
    columns = []
    for omega in lines:
        phase = omega * times
        sine = np.column_stack([np.cos(phase), np.sin(phase)])
        columns.append(sine if omega else np.ones((len(times), 1)))
    columns += [_unit(values[:, [k]]) for values in inputs for k in broad]
    forces = _unit(inputs[0][:, broad]) if broad else np.zeros((len(times), 0))
    return ForcedRegressors(Regressors.of(RegressorKind.LINE, columns, len(times)), forces)


def regressors_in_time(
    forced: ForcedRegressors, poles: ComplexArray, times: Array, max_count: int
) -> Regressors:
    """Return the regressors that the channels of a record of time share.

    `forced`: those of the forces; `poles`: poles of the model, 1/s. `times`, `max_count`: as of
    `forced_regressors`.
    """
    (direct, forces), (step, span) = forced, _spacing(times)
    budget = max(0, max_count - direct.values.shape[1]) // (4 * (1 + forces.shape[1]))
    kept = _upper_poles(poles, math.pi / step, _FAST_POLE_RATIO / step)[:budget]
    modes, moves, pole_of_column = _modes(kept, forces, times)
    others = poles[(poles.imag >= 0) & ~np.isin(poles, kept)]
    decays = Regressors.of_poles(RegressorKind.SCENE, _decays(others * step, len(times)), others)
    regressors = direct.joined(
        Regressors.of_poles(RegressorKind.MODE, modes, pole_of_column),
        Regressors.of_poles(RegressorKind.POLE, moves, pole_of_column, span),
    )
    return replace(regressors, decays=decays.values)


def _unit(values: Array) -> Array:
    """Return columns over their largest values."""
    largest = np.abs(values).max(axis=0, initial=0.0)
    return np.asarray(values / np.where(largest > 0, largest, 1.0))


def _spacing(times: Array) -> tuple[float, float]:
    """Return step and length of a record, s."""
    span = float(times[-1] - times[0])
    return (span / (len(times) - 1), span) if span else (1.0, 1.0)


def _upper_poles(poles: ComplexArray, fastest: float, shortest: float) -> ComplexArray:
    """Return one pole of each pair, the slow ones first; none beyond the limits of sampling."""
    real = np.abs(poles.imag) <= 1e-9 * np.abs(poles)
    upper = np.where(real, poles.real, poles)[real | (poles.imag > 0)]
    upper = upper[(upper.imag < fastest) & (upper.real > -shortest)]
    return np.asarray(upper[np.argsort(np.abs(upper), kind="stable")])


def _modes(
    poles: ComplexArray, forces: Array, times: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return forced responses and free decays of poles, their derivatives by the pole, and the pole of each.

    The columns (times x groups) stand pole by pole, the free decay of a pole last.
    """
    step, _ = _spacing(times)
    decays = _decays(poles * step, len(times))
    since = (np.arange(len(times)) / max(len(times) - 1, 1))[:, None]
    if not forces.shape[1]:
        return decays, since * decays, poles
    modes, moves, pole_of_column = [], [], []
    for pole, decay in zip(poles, decays.T, strict=True):
        forced, by_pole = _forced(pole, forces, times)
        modes += [*forced, decay]
        moves += [*by_pole, since[:, 0] * decay]
        pole_of_column += [pole] * (len(forced) + 1)
    shape = (len(times), len(pole_of_column))
    free, moved = (np.asarray(columns, dtype=complex).reshape(shape[::-1]).T for columns in (modes, moves))
    return free, moved, np.asarray(pole_of_column, dtype=complex)


def _decays(exponents: ComplexArray, rows: int) -> ComplexArray:
    """Return exp(k exponents), k = 0, 1, … (rows x exponents); growing ones are scaled to their end."""
    # Only the direction of a column matters. Blocks of rows are products of two exponentials, none above 1.
    height = math.isqrt(rows) + 1
    blocks = -(-rows // height)
    growing = exponents.real > 0
    inside, first = np.arange(height)[:, None], height * np.arange(blocks)[:, None]
    inner = np.exp(exponents * np.where(growing, inside - (height - 1), inside))
    outer = np.exp(exponents * np.where(growing, first - height * (blocks - 1), first))
    decays = (outer[:, None] * inner).reshape(height * blocks, len(exponents))
    return decays[:rows] if not growing.any() else np.where(growing, decays[-rows:], decays[:rows])


def _forced(pole: complex, forces: Array, times: Array) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """Return the responses of x' = pole x + f to the forces from rest, and the derivatives by the pole."""
    (step, span), n = _spacing(times), forces.shape[1]
    if not n or pole.real * span > _MAX_COLUMN_GROWTH:
        return [], []
    grown = np.exp(pole * step)
    a, b = grown.real, grown.imag
    turn = np.array([[a, -b], [b, a]])
    phi = np.block([[turn, np.zeros((2, 2))], [np.eye(2), turn]])
    pushed = step / 2 * (grown * forces[:-1] + forces[1:])
    forcing = np.stack([pushed.real, pushed.imag, np.zeros(pushed.shape), np.zeros(pushed.shape)], axis=2)
    states = np.zeros((len(times), n, 4))
    states[1:] = recurrence(phi, np.ascontiguousarray(forcing), np.zeros((n, 4)))
    return (
        [states[:, k, 0] + 1j * states[:, k, 1] for k in range(n)],
        [states[:, k, 2] + 1j * states[:, k, 3] for k in range(n)],
    )


def most_regressors(rows: int) -> int:
    """Return how many regressors a channel of so many values may have besides the scene's own."""
    return min(SATURATED.value, rows // _COLUMN_PART)


def fault_columns(prediction: Array) -> Array:
    """Return regressors of faults (times x 4): a trend, and harmonics of a prediction."""
    rows, squares = len(prediction), prediction**2
    return np.stack([np.ones(rows), np.linspace(-1, 1, rows), squares, squares * prediction]).T


def delayed_residuals(residual: Array) -> Array:
    """Return the delayed residuals (times x any) of a channel (times), 0 where a value is missing."""
    lags = min(_MAX_LAGS, len(residual) // _LAG_PART)
    delayed = np.zeros((lags, len(residual)))
    for lag in range(1, lags + 1):
        delayed[lag - 1, lag:] = residual[:-lag]
    return delayed.T


def regressors_by_line(poles: ComplexArray, omega: Array, profile: Array, max_count: int) -> Regressors:
    """Return the regressors of a frequency response, real parts above imaginary ones (2 L x d).

    `poles`: poles of the model, 1/s; `omega`: lines (L), rad/s. `profile`: deviation by line by which values
    are divided (L); `max_count`: how many regressors there may be.
    """
    s, scale = 1j * omega, max(float(omega[-1]), np.finfo(float).tiny)
    rest = [stacked(np.asarray((s / scale) ** order / profile))[:, None] for order in range(3)]
    direct = Regressors.of(RegressorKind.LINE, rest, 2 * len(omega))
    kept = _upper_poles(poles, 2 * scale, math.inf)[: max(0, max_count - len(rest)) // 4]
    kept = kept[np.abs(s[:, None] - kept).min(axis=0, initial=math.inf) > 0]
    modes: list[Array] = []
    moves: list[Array] = []
    for pole in kept:
        upper_term, lower_term = scale / (s - pole), scale / (s - pole.conjugate())
        for out, power in ((modes, 1), (moves, 2)):
            a, b = upper_term**power, lower_term**power
            pair = [a + b, 1j * (a - b)] if pole.imag else [a]
            out.append(np.column_stack([stacked(column / profile) for column in pair]))
    free = Regressors.of(RegressorKind.MODE, modes, 2 * len(omega), kept.tolist())
    return direct.joined(
        free, Regressors.of(RegressorKind.POLE, moves, 2 * len(omega), kept.tolist(), 1 / scale)
    )


def delayed_residuals_by_line(residual: Array) -> Array:
    """Return the residuals delayed by lines (2 L x any), real parts above imaginary ones."""
    real, imaginary = np.split(residual, 2)
    pairs = zip(delayed_residuals(real).T, delayed_residuals(imaginary).T, strict=True)
    turned = [column for a, b in pairs for column in (np.concatenate([a, b]), np.concatenate([-b, a]))]
    return np.column_stack([np.zeros((len(residual), 0)), *turned])


def saturated_coordinates(
    shared: Regressors, channel: ChannelColumns, count: float, *, state_in_range: bool = False
) -> SaturatedCoordinates:
    """Return a channel in orthonormal directions of its saturated model, in the order of its regressors.

    `shared`: the regressors besides the scene's own (rows x d), 0 where a value is missing; `channel`: the
    columns of the channel itself, alike. `count`: how many independent values it has. `state_in_range`: True:
    `by_state` has the products with all directions of regressors and decays, in which it is.
    """
    by_state = () if state_in_range else (channel.by_state.T,)
    sides = (channel.by_parameter.T, *by_state, channel.faults.T, channel.before.T)
    compared = channel.measured[None], channel.residual[None]
    columns = np.concatenate([channel.prediction[None], *sides, *compared])
    largest = np.abs(columns).max(axis=1, initial=0.0)
    columns /= np.where(largest > 0, largest, 1.0)[:, None]
    norms = np.linalg.norm(columns, axis=1)
    columns /= np.where(norms > 0, norms, 1.0)[:, None]
    p, n, max_rank = channel.by_parameter.shape[1], channel.by_state.shape[1], int(count) - 1
    directions, both = shared.directions
    places, size, basis = directions.first(max_rank)
    dropped = slice(len(basis), len(directions.places))  # more than there are values
    both = np.delete(both, dropped, axis=0) if len(basis) < len(directions.places) else both
    inside = columns @ both.T
    # Derivatives by the state are in the range of those directions, but for rounding.
    columns -= inside @ both
    new = np.flatnonzero(np.linalg.norm(columns, axis=1) > _RANGE_ROUND_OFF)
    further = np.linalg.qr(columns[new].T, mode="r")
    norms *= largest
    if state_in_range:
        state = np.delete(channel.by_state, dropped, axis=0).T
        sizes = np.linalg.norm(state, axis=1)
        inside = np.insert(inside, 1 + p, state / np.where(sizes > 0, sizes, 1.0)[:, None], axis=0)
        norms, new = np.insert(norms, 1 + p, sizes), new + np.where(new > p, n, 0)
    decays = len(both) - len(places)
    beside = np.zeros((decays + len(further), len(inside)))
    beside[:decays], beside[decays:, new] = inside[:, len(places) :].T, further
    own = _directions(beside[:, : -len(compared)]).first(max_rank - len(places))
    R = np.concatenate([inside[:, : len(places)].T, own.vectors @ beside]) * norms
    labels = shared.labels_with(1 + p + n, channel.faults.shape[1], channel.before.shape[1])
    kind, group, pole, rate = (
        label[np.concatenate([places, shared.values.shape[1] + own.places])] for label in labels
    )
    return SaturatedCoordinates(
        kind=kind,
        group=group,
        pole=pole,
        rate=rate,
        size=np.concatenate([size, own.size * norms[own.places]]),
        measured=R[:, -2],
        residual=R[:, -1],
        by_state=R[:, 1 + p : 1 + p + n].copy(),  # without the columns between
        by_parameter=R[:, 1 : 1 + p].copy(),
        count=count,
        energy=float(np.sum(channel.measured**2)),
        left=float(np.sum(channel.residual**2)),
    )


def _directions(columns: Array) -> Directions:
    """Return the directions that columns (rows x d) add, of norm 1 or parts of such (Gram–Schmidt)."""
    candidates = np.flatnonzero(np.linalg.norm(columns, axis=0) > _NEW_DIRECTION_NORM)
    if len(candidates) <= len(columns):
        Q, R = np.linalg.qr(columns[:, candidates])
        along = R.diagonal()
        if np.abs(along).min(initial=np.inf) > 2 * _NEW_DIRECTION_NORM:  # all are new, beyond rounding
            return Directions(candidates, np.abs(along), (Q * np.sign(along)).T)
    directions = np.zeros((min(columns.shape), len(columns)))
    places: list[int] = []
    size: list[float] = []
    for k, column in enumerate(columns.T):
        before = directions[: len(places)]
        new = column - (before @ column) @ before
        new -= (before @ new) @ before  # once more: what rounding left
        norm = math.sqrt(new @ new)
        if norm > _NEW_DIRECTION_NORM and len(places) < len(directions):
            directions[len(places)] = new / norm
            places.append(k)
            size.append(norm)
    return Directions(np.array(places, dtype=int), np.array(size), directions[: len(places)])
