"""Noise that is not white: what a scene states of it, and autoregressions with their exact likelihood.

The noise of a channel is ``x_t = a_1 x_(t-1) + … + a_n x_(t-n) + e_t``, stationary, with Gaussian innovations
e that are white in time; across channels they are independent, or have a full covariance ``L diag(d^2) L^T``.
An autoregression whitens: it is a linear map of records to innovations of deviation d, so that the likelihood
of coloured noise is that of white noise of whitened residuals and derivatives. First samples, and those
beside missing ones, are whitened by the covariance of what is not known before them (Kalman filter), which
makes the Gaussian likelihood exact. P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods, 2nd ed.
1991, ch. 8 and 12.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.defaults import NOISE_VALUES
from dynid.errors import UsageError

Mask = NDArray[np.bool_]

#: The highest order that is tried, and that may be given.
HIGHEST_ORDER, MOST_COEFFICIENTS = 20, 200
# Most numbers of rows that are whitened at once, with copies: 2 MB.
_MAX_BLOCK_NUMBERS = 250_000


class ColouredNoise(NamedTuple):
    """Autoregressive noise, estimated together with the parameters.

    `order` of the autoregression of each channel; None: that of the lowest BIC, channel by channel.
    `correlated`: innovations of different channels at the same time are correlated.
    """

    order: int | None = None
    correlated: bool = False


class _Update(NamedTuple):
    """One value of a Kalman filter: `channel`, `gain` of the state, `scale` to the innovation's deviation."""

    channel: int
    gain: Array
    scale: float


@dataclass(frozen=True, eq=False)
class Autoregression:
    """A stationary autoregressive noise of several channels."""

    coefficients: Array  # coefficients ``a_1, a_2, …`` (channels x n), 0 beyond the order of a channel
    orders: NDArray[np.int_]  # order of each channel (channels)
    # Unit lower triangular factor L of the covariance of the innovations (channels x channels); None where
    # channels are independent.
    mixing: Array | None = None
    # Deviations d of the innovations that are left beside those of channels before (channels). Where channels
    # are independent they may have any size.
    deviation: Array = field(default_factory=lambda: np.ones(1))
    # Bayesian information criterion (orders from 0 x channels), less that of white noise.
    bic: Array | None = None
    _updates: dict[bytes, list[tuple[list[list[_Update]], int]]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, coefficients: Sequence[float], channels: int) -> Autoregression:
        """Return an autoregression with the same coefficients in all channels.

        Raises UsageError if it is not stationary.
        """
        a = np.asarray(coefficients, dtype=float)
        largest = float(np.abs(np.linalg.eigvals(_companion(a[None]))).max()) if len(a) else 0.0
        if not largest < 1:
            raise UsageError(
                f"noise with these coefficients is not stationary: it grows by {largest:.6g} a sample",
                remedy="All roots of 1 = a_1 z + a_2 z^2 + … must lie outside the unit circle.",
                names=("noise_colour",),
            )
        return cls(np.tile(a, (channels, 1)), np.full(channels, len(a)), deviation=np.ones(channels))

    @property
    def order(self) -> int:
        """The highest order of a channel."""
        return int(self.coefficients.shape[1])

    @property
    def correlation(self) -> Array:
        """Correlation of the innovations (channels x channels)."""
        if self.mixing is None:
            return np.eye(len(self.coefficients))
        root = self.mixing * self.deviation
        size = np.linalg.norm(root, axis=1)
        return np.asarray(root @ root.T / np.outer(size, size))

    def innovations(self, deviation: Array) -> Array:
        """Return the deviations of the innovations, for these of what is left of them (channels)."""
        if self.mixing is None:
            return deviation
        return np.asarray(np.linalg.norm(self.mixing * deviation, axis=1))

    @cached_property
    def shares(self) -> Array:
        """Deviation of the innovations over that of the noise (channels)."""
        variances = (_stationary(a[None], np.eye(1))[0, 0] for a in self.coefficients)
        return np.array([1 / np.sqrt(variance) for variance in variances])

    def simulated(self, innovations: Array) -> Array:
        """Return noise of deviation 1 from independent normal numbers (times x channels)."""
        noise = np.empty_like(innovations)
        for c, (a, share) in enumerate(zip(self.coefficients, self.shares, strict=True)):
            n = min(len(a), len(innovations))
            start = _stationary(a[None], np.eye(1))[:n, :n]  # symmetric in time
            noise[:n, c] = np.linalg.cholesky(start) @ innovations[:n, c] * share
            noise[n:, c] = innovations[n:, c] * share
            for t in range(n, len(noise)):
                noise[t, c] += a @ noise[t - n : t, c][::-1]
        return noise

    def whitened(self, rows: Array, present: Mask) -> Array:
        """Return rows (times x channels x w) whitened: noise in them becomes innovations of deviation d.

        `rows`: finite where values are present; `present`: mask of the values (times x channels); the others
        are no values, and their rows become 0.
        """
        white, out = Whitening(self, present), np.empty(rows.shape)
        count = max(self.order, _MAX_BLOCK_NUMBERS // max(1, math.prod(rows.shape[1:])))
        for first in range(0, len(rows), count):
            out[first : first + count] = white.following(rows[first : first + count])
        return out

    def of_channel(self, channel: int) -> Autoregression:
        """Return the autoregression of a channel alone."""
        return Autoregression(self.coefficients[[channel]], self.orders[[channel]])

    def log_determinant(self, present: Mask) -> float:
        """Return half the logarithm of the determinant of the covariance of values in units of d."""
        total = 0.0
        for channels in self.groups:
            for block, _ in self.runs(present[:, channels], channels):
                total -= sum(np.log(update.scale) for updates in block for update in updates)
        return float(total)

    @cached_property
    def groups(self) -> list[list[int]]:
        """Channels that are correlated with each other."""
        channels = list(range(len(self.coefficients)))
        return [[c] for c in channels] if self.mixing is None else [channels]

    def runs(self, present: Mask, channels: list[int]) -> list[tuple[list[list[_Update]], int]]:
        """Return runs of rows without `order` complete rows before them: updates row by row, first row."""
        key = bytes(channels) + present.tobytes()
        if key not in self._updates:
            self._updates[key] = self._new_blocks(present, channels)
        return self._updates[key]

    def _new_blocks(self, present: Mask, channels: list[int]) -> list[tuple[list[list[_Update]], int]]:
        A, g = self.coefficients[channels], len(channels)
        d = self.deviation[channels] if self.mixing is not None else np.ones(1)
        root = d if self.mixing is None else self.mixing * d
        step, order = _companion(A), max(A.shape[1], 1)
        innovation = np.zeros((order * g, order * g))
        innovation[:g, :g] = np.atleast_2d(root) @ np.atleast_2d(root).T
        complete = np.concatenate([[0], np.cumsum(present.all(axis=1))])
        n = min(A.shape[1], len(present))
        regular = np.zeros(len(present), dtype=bool)
        regular[n:] = complete[n + 1 :] - complete[: len(present) - n] == n + 1
        blocks: list[tuple[list[list[_Update]], int]] = []
        P = np.zeros((0, 0))
        for t in np.flatnonzero(~regular):
            if t == 0 or regular[t - 1]:  # all rows before are known; before the first one none
                P = np.zeros_like(innovation)
                blocks.append(([], int(t)))
            P = _stationary(A, innovation[:g, :g]) if t == 0 else step @ P @ step.T + innovation
            updates = []
            for c in np.flatnonzero(present[t]):
                gain = P[:, c] / P[c, c]
                updates.append(_Update(int(c), gain, float(d[c] / np.sqrt(P[c, c]))))
                P = P - np.outer(gain, P[c])
            blocks[-1][0].append(updates)
        return blocks


class Whitening:
    """Whitens the rows of a record block after block, as `Autoregression.whitened` does all at once.

    `present`: mask of the values of the record (times x channels).
    """

    def __init__(self, colour: Autoregression, present: Mask) -> None:
        self._colour, self._present, self._done = colour, present, 0
        self._before = np.zeros((0, 0, 0))  # the last rows
        # Of each group of channels the runs that are left, the next one last, and the state inside of one.
        self._runs = [colour.runs(present[:, channels], channels)[::-1] for channels in colour.groups]
        self._states: dict[int, Array] = {}

    def following(self, rows: Array) -> Array:
        """Return the next rows (count x channels x w) whitened."""
        colour, first = self._colour, self._done
        self._done += len(rows)
        present = self._present[first : self._done]
        complete = bool(present.all())
        rows = rows if complete else np.where(present[..., None], rows, 0.0)
        if not first:
            self._before = np.zeros((max(colour.order, 1), *rows.shape[1:]))
        out = rows.copy()
        for k, a in enumerate(colour.coefficients.T, 1):
            out[k:] -= a[:, None] * rows[:-k]
            if first:
                out[:k] -= a[:, None] * self._before[-k:][: len(rows)]
        if colour.mixing is not None:
            out = np.asarray(np.linalg.solve(colour.mixing, out), dtype=float)
        for group, channels in enumerate(colour.groups):
            self._beside_gaps(group, channels, rows, out, first)
        if not complete:
            out[~present] = 0.0
        self._before = np.concatenate([self._before, rows[-len(self._before) :]])[-len(self._before) :]
        return out

    def _beside_gaps(self, group: int, channels: list[int], rows: Array, out: Array, first: int) -> None:
        """Replace whitened rows that do not have `order` complete rows before them, `first` the first one."""
        a, g = self._colour.coefficients[channels].T[..., None], len(channels)  # order x channels x 1
        order, last = len(self._before), first + len(rows)
        runs = self._runs[group]
        while runs and runs[-1][1] < last:
            run, start = runs[-1]
            if start < first:
                state = self._states.pop(group)
            else:
                known = np.concatenate([self._before, rows[max(start - first - order, 0) : start - first]])
                state = known[-order:, channels][::-1].reshape(order * g, -1)  # the newest row first
            for t in range(max(start, first), min(start + len(run), last)):
                blocks = state.reshape(order, g, -1)
                state = np.concatenate([np.sum(a * blocks[: len(a)], axis=0), state[:-g]])
                for update in run[t - start]:
                    channel = channels[update.channel]
                    left = rows[t - first, channel] - state[update.channel]
                    out[t - first, channel] = left * update.scale
                    state = state + np.outer(update.gain, left)
            if start + len(run) > last:
                self._states[group] = state
                return
            runs.pop()


def _companion(coefficients: Array) -> Array:
    """Return the matrix of one step of the last rows (channels x order of each), the newest first."""
    g, n = coefficients.shape
    order = max(n, 1)
    step = np.zeros((order * g, order * g))
    step[g:, :-g] = np.eye((order - 1) * g)
    for k, a in enumerate(coefficients.T):
        step[:g, k * g : (k + 1) * g] = np.diag(a)
    return step


def _stationary(coefficients: Array, innovation: Array) -> Array:
    """Return the stationary covariance of the last rows, for this covariance of the innovations."""
    from scipy.linalg import solve_discrete_lyapunov  # heavy import, needed here only

    step = _companion(coefficients)
    both = np.zeros_like(step)
    both[: len(innovation), : len(innovation)] = innovation
    covariance = solve_discrete_lyapunov(step, both)
    return np.asarray((covariance + covariance.T) / 2)


def estimated(
    residual: Array,
    errors: Iterable[Array],
    request: ColouredNoise,
    orders: NDArray[np.int_] | None = None,
    errors_by_samples: Callable[[], Iterable[Array]] = tuple,
) -> Autoregression:
    """Return the autoregression of noise, whose products are those of residuals plus those of errors.

    Burg's method, whose autoregressions are stationary: J. P. Burg, Maximum Entropy Spectral Analysis, 1975;
    of the orders that are tried, that of the lowest Bayesian information criterion (G. Schwarz, Ann. Statist.
    6 (1978) 461–464), ``N ln(variance of innovations) + order ln N``. Windows with missing samples are left
    out.

    `residual`: residuals (times x channels), NaN where missing; `errors`: of each channel the columns of a
    root of the covariance of the prediction's error (times x any). `request`: what is to be estimated;
    `orders`: orders to keep (channels); default: as wanted. `errors_by_samples` returns the same in blocks of
    samples of all channels (… x channels x any), for their correlation. Raises UsageError where a channel has
    too few values without a gap.
    """
    coefficient_sets, chosen, criteria = [], [], []
    present = ~np.isnan(residual)
    for c, errors_of_channel in enumerate(errors):
        count = int(np.count_nonzero(present[:, c]))
        highest = min(_highest(present[:, c]), HIGHEST_ORDER)
        if request.order is not None:
            _check_order(request.order, _highest(present[:, c]))
            highest = request.order
        with_errors = np.concatenate([residual[:, [c]], errors_of_channel], axis=1)
        coefficients, variances = _burg(with_errors, present[:, c], highest)
        bic = count * np.log(variances / variances[0]) + np.arange(len(variances)) * np.log(count)
        order = int(np.argmin(bic)) if request.order is None else highest
        chosen.append(min(order if orders is None else int(orders[c]), len(coefficients) - 1))
        coefficient_sets.append(coefficients[chosen[-1]])
        criteria.append(bic)
    max_order, longest = max(chosen), max(len(bic) for bic in criteria)
    a = np.array([np.concatenate([row, np.zeros(max_order - len(row))]) for row in coefficient_sets])
    bic = np.array([np.concatenate([row, np.full(longest - len(row), np.nan)]) for row in criteria]).T
    independent = Autoregression(a, np.array(chosen), deviation=np.ones(len(a)), bic=bic)
    if not request.correlated or len(a) == 1:
        return independent
    count = int(np.count_nonzero(present.all(axis=1)))
    if count < NOISE_VALUES.value * len(a):
        raise UsageError(
            f"only {count} samples have values of all channels: too few for the correlation of their noise",
            remedy="Leave out correlated: true.",
            names=("measurement.noise",),
        )
    products, whitening, first = np.zeros((len(a), len(a))), Whitening(independent, present), 0
    for block in errors_by_samples():
        samples = slice(first, first + len(block))
        e = whitening.following(np.concatenate([residual[samples, :, None], block], axis=2))
        e, first = e[present[samples].all(axis=1)], samples.stop
        products += np.einsum("tck,tdk->cd", e, e)
    products /= count
    size = np.sqrt(products.diagonal())
    root = np.linalg.cholesky(products / np.outer(size, size)) * size[:, None]
    d = root.diagonal()
    return Autoregression(a, np.array(chosen), root / d, d, bic)


def _check_order(order: int, highest: int) -> None:
    """Refuse an order above the highest one that a channel allows."""
    if order > highest:
        raise UsageError(
            f"an autoregression of order {order} needs {NOISE_VALUES.value * order} stretches of {order + 1} "
            f"samples without a gap in each channel; there are enough for order {highest}",
            remedy=f"Take at most order {highest}, or a longer record."
            if highest
            else "Leave 'noise' out: the noise then is taken for white.",
            names=("measurement.noise.order", "measurement.noise"),
        )


def _highest(present: Mask) -> int:
    """Return the highest order for which there are enough stretches without a gap."""
    complete = present
    for order in range(1, len(present)):
        complete = complete[1:] & present[: len(present) - order]
        if np.count_nonzero(complete) < NOISE_VALUES.value * order or order > MOST_COEFFICIENTS:
            return order - 1
    return 0


def _burg(x: Array, there: Mask, order: int) -> tuple[list[Array], Array]:
    """Return the coefficients of the orders 0, 1, …, and the variances of their innovations."""
    # `x`, `there`: series whose products add up (times x any), and a mask of the times that are present;
    # `order`: the highest order; lower ones are the last where no innovations are left.
    filled = np.where(there[:, None], x, 0.0)
    forward = filled / (np.abs(filled).max() or 1.0)
    backward, complete = forward.copy(), there
    coefficient_sets, variances = [np.zeros(0)], [float(np.sum(forward**2) / np.count_nonzero(there)) or 1.0]
    for k in range(1, order + 1):
        # Windows of k + 1 samples, by their last one.
        complete = complete[1:] & there[: len(x) - k]
        f = np.where(complete[:, None], forward[1:], 0.0)
        b = np.where(complete[:, None], backward[:-1], 0.0)
        power = float(np.sum(f**2) + np.sum(b**2))
        if not power > 0:
            break
        reflection = 2 * float(np.sum(f * b)) / power
        a = coefficient_sets[-1]
        coefficient_sets.append(np.concatenate([a - reflection * a[::-1], [reflection]]))
        variances.append(variances[-1] * max(1 - reflection**2, np.finfo(float).eps))
        forward, backward = f - reflection * b, b - reflection * f
    return coefficient_sets, np.array(variances)
