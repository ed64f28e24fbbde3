"""Prediction of a record by a linear system with delays in loops, and its exact sensitivities.

``x' = A x + B u + E v``, ``z = C x + D u + F v``, and ``v_i(t) = z_i(t - τ_i)``, zero before the record
(the method of steps: Bellman & Cooke 1963, 3.3). A derivative by a parameter follows the same equations,
driven by what the derivatives of the matrices add, with ``∂v_i(t) = ∂z_i(t - τ_i) - ∂τ_i z_i'(t - τ_i)``: of
that last term a jump of z is an impulse a delay later.

On segments between the break points b + Σ k_i τ_i all quantities are polynomials, which satisfy the equations
at Chebyshev points. Where no break point shows, a segment may be longer than a delay: values of its own are
then among the unknowns of its equations, and a delay that vanishes takes no more time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from dynid.arrays import Array
from dynid.errors import NumericalError
from dynid.identification.systems.delay_segments import (
    COUNT,
    INVERSE,
    RATE,
    VALUES,
    Grid,
    Loops,
    Own,
    Past,
    basis,
)
from dynid.identification.systems.parametric_model import ParametricModel

# Last coefficients that are examined; where they are resolved their size, over the largest of that quantity,
# and of the derivatives by the coordinates.
_TAIL, _TAIL_RTOL, _SLOPE_RTOL = 2, 1e-10, 1e-8
# Halvings of all segments until they are resolved.
_MAX_HALVINGS = 8
# Jumps below this part of the largest value are rounding.
_JUMP_RTOL = 1e-9
# Numbers of the operators, and of the polynomials, that are kept.
_MAX_OPERATOR_NUMBERS = 20_000_000


class _Operator(NamedTuple):
    """Matrices of a segment of one length: x from its first state, and from what drives it."""

    state: Array  # points n x n
    drive: Array  # points n x points n
    #: v from what is known of it beside the values of its own, of these: points m x points m; None: it is.
    closed: Array | None
    own: Own | None


class _Prepared:
    """What all columns share at coordinates of the parameters."""

    def __init__(self, model: ParametricModel, eta: Array, parts: int) -> None:
        matrices, (delays, slopes) = model.lft(eta), model.loop_delays(eta)
        self.loops = loops = Loops(matrices, delays, slopes)
        self.grid = Grid(model, loops, parts)
        nu, nc = loops.loads, loops.channels
        self.A, self.B, self.E = matrices.A, matrices.B[:, :nu], matrices.B[:, nu:]
        self.C, self.D, self.F = matrices.C[nc:], matrices.D[:, nc:, :nu], matrices.D[0, nc:, nu:]
        self._operators: dict[int, _Operator] = {}
        self.pasts: dict[int, Past] = {}  # by first segment of a window

    def operator(self, which: int) -> _Operator:
        """Return the operator of segments of a distinct length."""
        if which not in self._operators:
            n, m, length = len(self.A), len(self.F), float(self.grid.distinct[which])
            rate = np.kron(VALUES @ RATE @ INVERSE / length, np.eye(n)) - np.kron(np.eye(COUNT), self.A)
            closed, own = None, self.grid.own(length)
            if own is not None:  # v = W (S (C x + …) + …) with W = (1 - S F)^-1, S the matrices of `own`
                S = np.einsum("ipr,ij->pirj", own.matrix, np.eye(m)).reshape(COUNT * m, COUNT * m)
                closed = np.linalg.inv(np.eye(len(S)) - S @ np.kron(np.eye(COUNT), self.F))
                feedback = closed @ S @ np.kron(np.eye(COUNT), self.C)
                rate -= np.kron(np.eye(COUNT), self.E) @ feedback
            drive = np.zeros_like(rate)
            drive[n:, n:] = np.linalg.inv(rate[n:, n:])
            state = np.concatenate([np.eye(n), -drive[n:, n:] @ rate[n:, :n]])
            if (1 + len(self._operators)) * drive.size > _MAX_OPERATOR_NUMBERS:
                self._operators.clear()
            self._operators[which] = _Operator(state, drive, closed, own)
        return self._operators[which]


class _Stretch(NamedTuple):
    """Values of x, v and z at the points of a window (segments x points x … x q)."""

    x: Array
    v: Array
    z: Array


class _Columns:
    """Solutions of the same equations with other drives, side by side (q)."""

    def __init__(self, prepared: _Prepared, start: Array) -> None:
        self._prepared, self._x = prepared, start
        m, (n, q) = len(prepared.F), start.shape
        self.coefficients = np.zeros((len(prepared.grid.lengths), COUNT, m, q))  # of z
        self.largest, self._tails = np.zeros((m + n, q)), np.zeros((m + n, q))

    def resolved(self, rtol: float) -> bool:
        """Return True if the polynomials are."""
        return bool(np.all(self._tails <= rtol * self.largest))

    def advance(
        self, window: slice, past: Array, drive: Array, direct: Array, impulses: dict[int, Array]
    ) -> _Stretch:
        """Return the columns on a window.

        `past`: v beside what a segment's own values give (segments x points x m x q); `drive`, `direct`:
        further terms of x' and z (… x n x q, … x m x q). `impulses`: jumps of x at borders (n x q).
        """
        prepared, which = self._prepared, self._prepared.grid.which[window]
        (count, *_, q), n = past.shape, len(self._x)
        first, v = prepared.operator(int(which[0])), past
        if first.closed is not None and first.own is not None:  # a window of its own
            known = past + np.einsum("ipr,kriq->kpiq", first.own.matrix, direct)
            v = (first.closed @ known.reshape(count, -1, q)).reshape(past.shape)
        driven = (drive + np.einsum("nm,kpmq->kpnq", prepared.E, v)).reshape(count, COUNT * n, q)
        lengths = [(np.flatnonzero(which == k), prepared.operator(k)) for k in np.unique(which).tolist()]
        states, steps = np.empty_like(driven), dict[int, Array]()
        for here, operator in lengths:
            states[here] = operator.drive @ driven[here]
            steps |= dict.fromkeys(here.tolist(), operator.state[-n:])
        starts, x = np.empty((count, n, q)), self._x
        for k in range(count):
            if window.start + k in impulses:
                x = x + impulses[window.start + k]
            starts[k] = x
            x = steps[k] @ x + states[k, -n:]
        self._x = x
        for here, operator in lengths:
            states[here] += operator.state @ starts[here]
        states = states.reshape(count, COUNT, n, q)
        z = direct + np.einsum("mn,kpnq->kpmq", prepared.C, states)
        if first.closed is not None and first.own is not None:
            known = past + np.einsum("ipr,kriq->kpiq", first.own.matrix, z)
            v = (first.closed @ known.reshape(count, -1, q)).reshape(past.shape)
        z = z + np.einsum("mj,kpjq->kpmq", prepared.F, v)
        self.coefficients[window] = np.einsum("jp,kpmq->kjmq", INVERSE, z)
        both = np.concatenate([z, states], axis=2)
        tails = np.abs(np.einsum("jp,kpmq->kjmq", INVERSE[-_TAIL:], both))
        self.largest = np.maximum(self.largest, np.abs(both).max(axis=(0, 1), initial=0.0))
        self._tails = np.maximum(self._tails, tails.max(axis=(0, 1), initial=0.0))
        return _Stretch(states, v, z)


class Motion(NamedTuple):
    """Channels and states at the times of a timeline (u x channels or n x q), side by side (q)."""

    outputs: Array
    states: Array


@dataclass(frozen=True, eq=False)
class _Run:
    """A pass over a record: columns of the response, and of its derivatives by the coordinates."""

    model: ParametricModel
    prepared: _Prepared
    columns: _Columns
    slopes: _Columns | None  # of the first column
    rates: Array  # coefficients of z' of the first column (pieces x degree + 1 x m x 1)
    strengths: dict[int, Array] = field(default_factory=dict)  # of impulses in ∂v by border (m x p)

    def motions(self, *, rates: bool) -> tuple[Motion, Motion | None]:
        """Return the columns, and the derivatives of the first by the coordinates; of all the rates."""
        model, (matrices, *_) = self.model, self.prepared.loops
        times, nc, nu = (
            model.line.nodes[model.line.wanted],
            self.prepared.loops.channels,
            self.prepared.loops.loads,
        )
        moved = times + 4 * np.finfo(float).eps * np.abs(times)
        grid = self.prepared.grid
        read: tuple[list[tuple[Array, Array]], ...] = ([], [])
        pieces = np.clip(np.searchsorted(grid.borders, moved, side="right") - 1, 0, len(grid.lengths) - 1)
        weights = basis((times - grid.borders[pieces]) / grid.lengths[pieces])
        weights = (weights @ RATE / grid.lengths[pieces, None] if rates else weights) @ INVERSE
        C, F = matrices.C[:nc], matrices.D[0, :nc, nu:]
        C_slopes, F_slopes = matrices.C_slopes[:, :nc], matrices.D_slopes[:, 0, :nc, nu:]
        for window in grid.windows():
            here = slice(*np.searchsorted(pieces, [window.start, window.stop]).tolist())
            at, stretch = pieces[here] - window.start, self._advanced(window)
            x, v = (np.einsum("sp,spnq->snq", weights[here], part[at]) for part in (stretch.x, stretch.v))
            read[0].append((np.einsum("cn,snq->scq", C, x) + np.einsum("cm,smq->scq", F, v), x))
            if self.slopes is None:
                continue
            stretch = self._sensitive(window, stretch)
            dx, dv = (np.einsum("sp,spnq->snq", weights[here], part[at]) for part in (stretch.x, stretch.v))
            y = np.einsum("cn,snq->scq", C, dx) + np.einsum("cm,smq->scq", F, dv)
            y += np.einsum("qcn,sn->scq", C_slopes, x[..., 0]) + np.einsum("qcm,sm->scq", F_slopes, v[..., 0])
            read[1].append((y, dx))
        first, second = (
            Motion(*(np.concatenate(part) for part in zip(*parts, strict=True))) if parts else None
            for parts in read
        )
        assert first is not None
        return first, second

    def _advanced(self, window: slice) -> _Stretch:
        """Return the response on a window, the inputs driving its first column."""
        prepared, u = self.prepared, self.prepared.grid.inputs[:, window]
        shape, q = u.shape[1:3], self.columns.largest.shape[1]
        past = self._past(window).read(self.columns.coefficients)
        drive, direct = np.zeros((*shape, len(prepared.A), q)), np.zeros((*shape, len(prepared.F), q))
        drive[..., 0] = u[0] @ prepared.B.T
        direct[..., 0] = np.einsum("omu,okpu->kpm", prepared.D, u)
        return self.columns.advance(window, past, drive, direct, {})

    def _past(self, window: slice) -> Past:
        """Return where a window reads what was delays before, kept for further passes."""
        grid, kept = self.prepared.grid, self.prepared.pasts
        if window.start not in kept:
            past = Past.of(grid, window, self._own(window))
            if (1 + len(kept)) * past.polynomials.size > _MAX_OPERATOR_NUMBERS:
                kept.clear()
            kept[window.start] = past
        return kept[window.start]

    def _own(self, window: slice) -> Own | None:
        return self.prepared.operator(int(self.prepared.grid.which[window.start])).own

    def _sensitive(self, window: slice, stretch: _Stretch) -> _Stretch:
        """Return the derivatives of the response on a window."""
        assert self.slopes is not None
        grid, loops = self.prepared.grid, self.prepared.loops
        nu, nc, moved = loops.loads, loops.channels, loops.matrices
        x, v, u, own = stretch.x[..., 0], stretch.v[..., 0], grid.inputs[:, window], self._own(window)
        past = self._past(window)
        late = past.read(self.rates)
        rates = RATE @ self.columns.coefficients[window, ..., 0] / grid.lengths[window, None, None]
        self.rates[window, ..., 0] = rates
        if own is not None:
            late[..., 0] += np.einsum("ipr,kri->kpi", own.matrix, VALUES @ rates)
        past_slopes = past.read(self.slopes.coefficients) - late * loops.delay_slopes.T
        drive = np.einsum("qnj,kpj->kpnq", moved.A_slopes, x) + np.einsum(
            "qnu,kpu->kpnq", moved.B_slopes[..., :nu], u[0]
        )
        drive += np.einsum("qnm,kpm->kpnq", moved.B_slopes[..., nu:], v)
        direct = np.einsum("qmn,kpn->kpmq", moved.C_slopes[:, nc:], x)
        direct += np.einsum("qomu,okpu->kpmq", moved.D_slopes[:, :, nc:, :nu], u)
        direct += np.einsum("qmj,kpj->kpmq", moved.D_slopes[:, 0, nc:, nu:], v)
        impulses = self._impulses(window, stretch.z[..., 0])
        return self.slopes.advance(window, past_slopes, drive, direct, impulses)

    def _impulses(self, window: slice, z: Array) -> dict[int, Array]:
        """Return the jumps of derivatives of x on a window; note the impulses that jumps of z send on."""
        grid, slopes = self.prepared.grid, self.prepared.loops.delay_slopes
        if not slopes.any():
            return {}
        before = np.zeros((len(z), z.shape[2]))
        before[1:] = z[:-1, -1]
        if window.start:
            before[0] = self.columns.coefficients[window.start - 1, ..., 0].sum(axis=0)
        jumps = z[:, 0] - before
        significant = np.abs(jumps) > _JUMP_RTOL * self.columns.largest[: z.shape[2], 0]
        impulses = {}
        for k in range(len(z)):
            sent = np.zeros(slopes.shape[::-1])
            if (strength := self.strengths.pop(window.start + k, None)) is not None:
                impulses[window.start + k] = self.prepared.E @ strength
                sent = self.prepared.F @ strength  # of ∂z
            sent = sent - np.where(significant[k], jumps[k], 0.0)[:, None] * slopes.T
            for index in np.flatnonzero(sent.any(axis=1)).tolist():
                border = grid.border(float(grid.borders[window.start + k] + grid.delays[index]))
                if border >= 0:
                    row = self.strengths.setdefault(border, np.zeros(slopes.shape[::-1]))
                    row[index] += sent[index]
        return impulses


class _Last(NamedTuple):
    """The last coordinates of a model, what was prepared there, and the parts of its segments."""

    eta: Array
    prepared: _Prepared
    parts: int


_LAST: WeakKeyDictionary[ParametricModel, _Last] = WeakKeyDictionary()


def motions(
    model: ParametricModel, eta: Array, start: Array, *, sensitive: bool = False, rates: bool = False
) -> tuple[Motion, Motion | None]:
    """Return the motion from first states (n x q), scaled, and derivatives of the first by the coordinates.

    The inputs drive the first alone; direct terms of the channels, offsets included, are left out. `rates`:
    the derivatives by time of all. Raises NumericalError where segments do not resolve the motion.
    """
    last = _LAST.get(model)
    parts = last.parts if last is not None else 1
    for _ in range(_MAX_HALVINGS):
        if last is None or last.parts != parts or not np.array_equal(last.eta, eta):
            last = _LAST[model] = _Last(eta.copy(), _Prepared(model, eta, parts), parts)
        columns = _Columns(last.prepared, start)
        slopes = _Columns(last.prepared, np.zeros((len(start), len(eta)))) if sensitive else None
        z_rates = np.zeros_like(columns.coefficients[..., :1])
        out = _Run(model, last.prepared, columns, slopes, z_rates).motions(rates=rates)
        if columns.resolved(_TAIL_RTOL) and (slopes is None or slopes.resolved(_SLOPE_RTOL)):
            return out
        parts *= 2
    raise NumericalError(
        "the record of a loop with a delay is not resolved",
        remedy="Shorten the record, or limit the fastest parts (min, max).",
    )


def delayed_free(model: ParametricModel, eta: Array, channels: slice) -> tuple[Array, Array]:
    """Return forced outputs of channels, and their derivatives by the first state."""
    motion, _ = motions(model, eta, np.eye(model.states, 1 + model.states, 1))
    outputs = motion.outputs[:, channels]
    return outputs[..., 0] + model.direct(eta, channels).value, outputs[..., 1:]


def delayed_prediction(
    model: ParametricModel, eta: Array, x0: Array, channels: slice
) -> tuple[Array, Array, Array]:
    """Return outputs of channels from a first state (n), states, and derivatives by the coordinates."""
    motion, slopes = motions(model, eta, x0[:, None], sensitive=True)
    assert slopes is not None
    direct, by_parameter = model.direct(eta, channels), slopes.outputs[:, channels]
    if direct.slopes is not None:
        by_parameter = by_parameter + np.moveaxis(direct.slopes, 0, -1)
    return motion.outputs[:, channels, 0] + direct.value, motion.states[..., 0], by_parameter


def delayed_state_slopes(model: ParametricModel, eta: Array, x0: Array) -> Array:
    """Return the derivatives of the states (times x n, scaled) by first states and coordinates (n + p)."""
    by_state, _ = motions(model, eta, np.eye(model.states, 1 + model.states, 1))
    _, slopes = motions(model, eta, x0[:, None], sensitive=True)
    assert slopes is not None
    return np.concatenate([by_state.states[..., 1:], slopes.states], axis=2)


def delayed_rates(model: ParametricModel, eta: Array, x0: Array) -> Array:
    """Return the derivatives of the outputs by time (times x channels), from a first state (n)."""
    motion, _ = motions(model, eta, x0[:, None], rates=True)
    rates = motion.outputs[..., 0]
    for order, D in enumerate(model.at(eta).D, 1):
        rates = rates + (model.inputs(order) * model.acting) @ D.T
    return rates
