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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self, TypeAlias

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
# Numbers of the largest regressors that are kept.
_MAX_KEPT_NUMBERS = 1_000_000
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
    def factors(self) -> tuple[Array, Array]:
        """The factors Q (rows x r) and R (r x any) of the columns and the free decays after them."""
        Q, R = np.linalg.qr(self.values if self.decays is None else np.hstack([self.values, self.decays]))
        return Q, R

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

    def whitened(self, values: Array) -> Regressors:
        """Return the regressors with whitened values; there are no decays then."""
        return replace(self, values=values, decays=None)

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
    """The saturated model of a channel beside that of its regressors, by products with orthonormal columns.

    Prediction, derivatives by parameters (p) and by the first state (n), faults, delayed residuals, measured
    values and the scene's residuals stand side by side. `inside`: products with r columns that span the
    regressors (r x w); `outside`: a factor of what these leave (any x w); `by_state` (r x n): derivatives by
    the first state that are in the range of the regressors and decays, which then are no columns.
    """

    inside: Array
    outside: Array
    widths: tuple[int, int, int, int]  # p, n of columns, number of faults, of delayed residuals
    by_state: Array | None = None

    @classmethod
    def of(cls, shared: Regressors, columns: Array, widths: tuple[int, int, int, int]) -> Self:
        """Return the columns of a channel (rows x w) beside regressors (rows x d)."""
        Q, _ = shared.factors
        inside = Q.T @ columns
        return cls(inside, columns - Q @ inside, widths)


@dataclass(frozen=True, eq=False)
class ForcedRegressors:
    """Regressors of a record that do not depend on an estimate: lines and direct terms."""

    times: Array  # sampling times (times), s
    lines: Array  # frequencies of sines (lines), rad/s
    terms: Array  # direct terms (times x any)
    forces: Array  # those that are no sums of few sines, to which the modes respond (times x any)

    @property
    def count(self) -> int:
        """Number of columns of lines and direct terms."""
        sines = 2 * len(self.lines) - int(np.count_nonzero(self.lines == 0))
        return sines + int(self.terms.shape[1])

    def direct(self, samples: slice) -> Regressors:
        """Return the columns of lines and direct terms at samples."""
        first, last, _ = samples.indices(len(self.times))
        if self._kept is not None:
            return replace(self._kept, values=self._kept.values[samples])
        return self._columns(first, last)

    @cached_property
    def _kept(self) -> Regressors | None:
        """The columns at all samples, unless they are large."""
        few = self.count * len(self.times) <= _MAX_KEPT_NUMBERS
        return self._columns(0, len(self.times)) if few else None

    def _columns(self, first: int, last: int) -> Regressors:
        columns = []
        for omega in self.lines:
            phase = omega * self.times[first:last]
            sine = np.column_stack([np.cos(phase), np.sin(phase)])
            columns.append(sine if omega else np.ones((last - first, 1)))
        columns += [self.terms[first:last, [k]] for k in range(self.terms.shape[1])]
        return Regressors.of(RegressorKind.LINE, columns, last - first)


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
    terms = [_unit(values[:, [k]]) for values in inputs for k in broad]
    forces = _unit(inputs[0][:, broad]) if broad else np.zeros((len(times), 0))
    return ForcedRegressors(times, lines, np.hstack([np.zeros((len(times), 0)), *terms]), forces)


def regressors_in_time(forced: ForcedRegressors, poles: ComplexArray, max_count: int) -> RegressorsInTime:
    """Return the regressors that the channels of a record of time share, which follow block by block.

    `forced`: those of the forces; `poles`: poles of the model, 1/s; `max_count`: as of `forced_regressors`.
    """
    step, _ = _spacing(forced.times)
    budget = max(0, max_count - forced.count) // (4 * (1 + forced.forces.shape[1]))
    modes = _upper_poles(poles, math.pi / step, _FAST_POLE_RATIO / step)[:budget]
    others = poles[(poles.imag >= 0) & ~np.isin(poles, modes)]
    return RegressorsInTime(forced, modes, others)


class RegressorsInTime:
    """The regressors of a record of time, which its channels share.

    `modes`, `others`: poles that are regressors, and those whose decays alone are held beside, 1/s.
    """

    def __init__(self, forced: ForcedRegressors, modes: ComplexArray, others: ComplexArray) -> None:
        self._forced, self._modes, self._others = forced, modes, others
        self._all: Regressors | None = None

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self._forced.times)

    @property
    def all(self) -> Regressors:
        """Those of all samples, kept unless they are large."""
        if self._all is not None:
            return self._all
        regressors = next(self.blocks(self.samples))
        if regressors.values.size <= _MAX_KEPT_NUMBERS:
            self._all = regressors
        return regressors

    def blocks(self, rows: int) -> Iterator[Regressors]:
        """Yield those of so many samples after the other."""
        total, (step, span), forces = self.samples, _spacing(self._forced.times), self._forced.forces
        if rows >= total and self._all is not None:
            yield self._all
            return
        since = np.arange(total) / max(total - 1, 1)
        responses = [_Forced(pole, step, span, forces) for pole in self._modes]
        for first in range(0, total, rows):
            samples = slice(first, min(first + rows, total))
            decays = _decays(self._modes * step, samples, total)
            modes: list[ComplexArray] = []
            moves: list[ComplexArray] = []
            pole_of_column: list[complex] = []
            for pole, decay, response in zip(self._modes, decays.T, responses, strict=True):
                values, by_pole = response.at(samples)
                modes += [*values, decay]
                moves += [*by_pole, since[samples] * decay]
                pole_of_column += [pole] * (len(values) + 1)
            poles, shape = np.array(pole_of_column, dtype=complex), (len(pole_of_column), len(decays))
            mode_columns, moved_columns = (
                np.asarray(columns, dtype=complex).reshape(shape).T for columns in (modes, moves)
            )
            beside = Regressors.of_poles(
                RegressorKind.SCENE, _decays(self._others * step, samples, total), self._others
            )
            regressors = self._forced.direct(samples).joined(
                Regressors.of_poles(RegressorKind.MODE, mode_columns, poles),
                Regressors.of_poles(RegressorKind.POLE, moved_columns, poles, span),
            )
            yield replace(regressors, decays=beside.values)


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


def _decays(exponents: ComplexArray, samples: slice, total: int) -> ComplexArray:
    """Return exp(k exponents), k = 0, 1, … of some samples of all; growing ones are scaled to their end."""
    # Only the direction of a column matters. Blocks of rows are products of two exponentials, none above 1.
    rows = samples.stop - samples.start
    height = math.isqrt(rows) + 1
    blocks = -(-rows // height)
    growing = exponents.real > 0
    inside, first = np.arange(height)[:, None], height * np.arange(blocks)[:, None]
    inner = np.exp(exponents * np.where(growing, inside - (height - 1), inside))
    to_end = first - height * (blocks - 1) + (samples.stop - total)
    outer = np.exp(exponents * np.where(growing, to_end, first + samples.start))
    decays = (outer[:, None] * inner).reshape(height * blocks, len(exponents))
    ahead = decays[:rows]
    return np.asarray(np.where(growing, decays[-rows:], ahead) if growing.any() else ahead)


class _Forced:
    """Responses of x' = pole x + f to forces from rest, and derivatives by the pole, block by block."""

    def __init__(self, pole: complex, step: float, span: float, forces: Array) -> None:
        self._step, self._forces, n = step, forces, forces.shape[1]
        self._none = not n or pole.real * span > _MAX_COLUMN_GROWTH
        if self._none:
            return
        self._grown = np.exp(pole * step)
        a, b = self._grown.real, self._grown.imag
        turn = np.array([[a, -b], [b, a]])
        self._phi = np.block([[turn, np.zeros((2, 2))], [np.eye(2), turn]])
        self._state = np.zeros((n, 4))

    def at(self, samples: slice) -> tuple[list[ComplexArray], list[ComplexArray]]:
        """Return responses and derivatives at the next samples."""
        if self._none:
            return [], []
        first, n = max(samples.start - 1, 0), len(self._state)
        forces = self._forces[first : samples.stop]
        pushed = self._step / 2 * (self._grown * forces[:-1] + forces[1:])
        forcing = np.stack([pushed.real, pushed.imag, np.zeros(pushed.shape), np.zeros(pushed.shape)], axis=2)
        states = np.empty((len(forces), n, 4))
        states[0] = self._state
        states[1:] = recurrence(self._phi, np.ascontiguousarray(forcing), self._state)
        self._state = states[-1].copy()
        states = states[samples.start - first :]
        return (
            [states[:, k, 0] + 1j * states[:, k, 1] for k in range(n)],
            [states[:, k, 2] + 1j * states[:, k, 3] for k in range(n)],
        )


def most_regressors(rows: int) -> int:
    """Return how many regressors a channel of so many values may have besides the scene's own."""
    return min(SATURATED.value, rows // _COLUMN_PART)


def fault_columns(prediction: Array, rows: slice = slice(None), total: int | None = None) -> Array:
    """Return regressors of faults (times x 4 x …): a trend, and harmonics of a prediction (times x …).

    `rows`: those of a total of times that the prediction is of; default: all.
    """
    squares, trend = prediction**2, np.linspace(-1, 1, total or len(prediction))[rows]
    straight = np.broadcast_to(trend.reshape(-1, *(1 for _ in prediction.shape[1:])), prediction.shape)
    return np.stack([np.ones(prediction.shape), straight, squares, squares * prediction], axis=1)


def most_delayed(rows: int) -> int:
    """Return how many delayed residuals are regressors of a channel of so many values."""
    return min(_MAX_LAGS, rows // _LAG_PART)


def delayed_residuals(residual: Array) -> Array:
    """Return the delayed residuals (rows x any) of a channel (rows), 0 before the first one."""
    lags = most_delayed(len(residual))
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


def saturated_directions(R: Array, count: int) -> tuple[Directions, Array]:
    """Return the directions of regressors, and all of the range of regressors and decays, these first.

    `R`: the triangular factor of `count` regressors and of decays after them (r x any).
    """
    norms = np.linalg.norm(R[:, :count], axis=0)
    places, size, vectors = _directions(R[:, :count] / np.where(norms > 0, norms, 1.0))
    rest = np.linalg.qr(vectors.T, mode="complete")[0].T[len(places) :]
    return Directions(places, size * norms[places], vectors), np.concatenate([vectors, rest])


def saturated_coordinates(
    shared: Regressors, ranges: tuple[Directions, Array], channel: ChannelColumns, count: float
) -> SaturatedCoordinates:
    """Return a channel in orthonormal directions of its saturated model, in the order of its regressors.

    `shared`: the regressors besides the scene's own; `ranges`: their `saturated_directions`; `channel`: the
    columns of the channel itself. `count`: how many independent values it has.
    """
    p, of_columns, faults, delayed = channel.widths
    rows, columns = len(channel.inside), np.concatenate([channel.inside, channel.outside])
    largest = np.abs(columns).max(axis=0, initial=0.0)
    columns = columns / np.where(largest > 0, largest, 1.0)
    norms = np.linalg.norm(columns, axis=0)
    columns /= np.where(norms > 0, norms, 1.0)
    norms *= largest
    energy, left = np.square(norms[-2:]).tolist()
    max_rank = int(count) - 1
    directions, both = ranges
    places, size, basis = directions.first(max_rank)
    dropped = slice(len(basis), len(directions.places))  # more than there are values
    all_of_range = both
    both = np.delete(both, dropped, axis=0) if len(basis) < len(directions.places) else both
    inside = (both @ columns[:rows]).T
    # Derivatives by the state are in the range of those directions, but for rounding.
    outside = np.concatenate([all_of_range[dropped] @ columns[:rows], columns[rows:]])
    new = np.flatnonzero(np.linalg.norm(outside, axis=0) > _RANGE_ROUND_OFF)
    further = np.linalg.qr(outside[:, new], mode="r")
    n = of_columns
    if channel.by_state is not None:
        n, state = channel.by_state.shape[1], (both @ channel.by_state).T
        sizes = np.linalg.norm(state, axis=1)
        inside = np.insert(inside, 1 + p, state / np.where(sizes > 0, sizes, 1.0)[:, None], axis=0)
        norms, new = np.insert(norms, 1 + p, sizes), new + np.where(new > p, n, 0)
    decays = len(both) - len(places)
    beside = np.zeros((decays + len(further), len(inside)))
    beside[:decays], beside[decays:, new] = inside[:, len(places) :].T, further
    own = _directions(beside[:, :-2]).first(max_rank - len(places))
    R = np.concatenate([inside[:, : len(places)].T, own.vectors @ beside]) * norms
    labels = shared.labels_with(1 + p + n, faults, delayed)
    kind, group, pole, rate = (
        label[np.concatenate([places, len(shared.kind) + own.places])] for label in labels
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
        energy=energy,
        left=left,
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
