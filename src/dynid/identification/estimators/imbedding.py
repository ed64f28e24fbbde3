"""Invariant imbedding as the paper prints it: state and covariance as one stiff differential equation.

Source: K. T. Yang 1997, eqs 19–20 (D. M. Detchmendy, R. Sridhar, J. Basic Eng. 88 (1966) 362–368):

    dX/dt = f(X) + 2 P H Q (y - h(X)),
    dP/dt = F P + P F^T - 2 P H Q H^T P + 1/2 k W^-1 k^T,    F = df/dX, H^T = dh/dX,

with X the augmented state, its parameters as coordinates, and y(t) the record between its samples by a cubic
spline. N states make N + N (N + 1)/2 equations. With Q = 1/(2 sigma^2 step) it is the Kalman–Bucy filter of
white noise of deviation sigma, which `filter` solves exactly and in a hundredth of the time. Eqs 16–18 (the
two-point boundary-value problem) are not solved: the imbedding replaces it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Array
from dynid.errors import Diverged, UsageError
from dynid.identification.estimators.estimate import Estimate, EstimationStage
from dynid.identification.estimators.filter import Pass, check_run_away
from dynid.identification.estimators.filter_passes import (
    chained,
    check_one_clock,
    check_states,
    last,
    wide_prior,
)
from dynid.identification.information import RECORD
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.progress import report_progress

#: Terms of the exponential series between two nodes of the record's timeline.
_EXPONENTIAL_TERMS = 12
# Part of a record by which a time may lie outside: round-off.
_TIME_ROUND_OFF = 1e-12


@dataclass(frozen=True)
class InvariantImbedding:
    """Estimator: eqs 19–20 of the paper, integrated by LSODA (implicit where stiff, its step controlled)."""

    # Deviation of the noise that the weight Q stands for, as a part of each channel's RMS.
    noise_ratio: float = 0.05
    # Deviation of an unmodelled force at every load, N; with it goes the term 1/2 k W^-1 k^T, W taken so that
    # it is the covariance that white noise of this deviation and the record's step would add.
    input_deviation: float = 0.0
    tolerance: float = 1e-4  # relative tolerance of the integration
    name: str = "invariant-imbedding"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise_ratio) and self.noise_ratio > 0):
            raise UsageError("the noise ratio of the weight must be finite and positive")
        if not (math.isfinite(self.input_deviation) and self.input_deviation >= 0):
            raise UsageError("the deviation of the unmodelled input must be finite and not negative")
        if not 1e-12 <= self.tolerance <= 1e-2:
            raise UsageError("the tolerance of the integration must lie between 1e-12 and 0.01")

    def run(self, likelihood: TimeLikelihood, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises Diverged if the integration breaks down, or parameters run away.
        """
        check_states(likelihood, "invariant imbedding")
        if not all(record.superposes for record in likelihood.records):
            raise UsageError(
                "eqs 19 and 20 are integrated for a linear model, and a joint has nonlinear laws",
                remedy="Use method: filter, which solves them sample by sample, or sigma-point.",
                names=("estimator.method", "estimator"),
            )
        check_one_clock(likelihood)
        counts = {"equations": 0, "evaluations": 0}

        def passed(_: int, record: TimeRecord, prior: InitialState) -> Pass:
            history, equations, evaluations = self._integrated(record, prior, origin)
            counts["equations"] = equations
            counts["evaluations"] += evaluations
            return history

        sweep = chained(likelihood, [wide_prior(record, origin) for record in likelihood.records], passed)
        fit = likelihood.fit(last(likelihood, [sweep]))
        return Estimate(fit, [sweep], [EstimationStage.at("invariant imbedding", likelihood, fit)], counts)

    def _integrated(self, record: TimeRecord, prior: InitialState, origin: Array) -> tuple[Pass, int, int]:
        """Return the pass over one record, its number of equations, and that of their evaluations."""
        report_progress("integrating eqs 19 and 20")
        from scipy.integrate import solve_ivp  # heavy import, needed here only

        flow = Flow(record, self, origin)
        start = flow.packed(np.concatenate([prior.state, prior.eta]), prior.root @ prior.root.T)
        times = record.model.line.nodes
        solved = solve_ivp(
            flow.rate,
            (times[0], times[-1]),
            start,
            method="LSODA",
            t_eval=times[record.model.line.wanted],
            jac=flow.jacobian,
            rtol=self.tolerance,
            atol=self.tolerance * flow.scale(prior.root),
        )
        if not solved.success:
            raise Diverged(
                f"the integration of eqs 19 and 20 breaks down: {solved.message}", remedy=RECORD.astray
            )
        history = flow.history(record.model.own(np.asarray(solved.y.T)))
        for eta in history.eta[[len(history.eta) // 2, -1]]:
            check_run_away(record.unknowns, eta, origin)
        return history, len(start), int(solved.nfev)


class Flow:
    """Right-hand side of eqs 19 and 20, and its derivatives; the covariance as its upper triangle."""

    def __init__(self, record: TimeRecord, options: InvariantImbedding, origin: Array) -> None:
        self.model = model = record.model
        if model.instruments.unknown_delays:
            raise UsageError(
                "invariant imbedding takes no delays that are unknown",
                remedy="Use estimator: {method: auto}.",
                names=("estimator.method",),
            )
        self.size = model.states + model.parameters
        self.upper = np.triu_indices(self.size)
        times = model.times
        step = float(np.mean(np.diff(times))) if len(times) > 1 else 1.0
        self.weight = 1 / (2 * (options.noise_ratio * record.data.rms) ** 2 * step)  # Q
        self.unmodelled = np.zeros((self.size, self.size))
        n = model.states
        at_origin, line = model.at(origin), model.line
        self.unmodelled[:n, :n] = options.input_deviation**2 * step * at_origin.B @ at_origin.B.T
        # What the inputs add at once may jump between samples: it is taken off before the record is bridged.
        self._delays = model.instruments.numbers(model.instruments.delays, {}).value
        at_once = model.gathered(model.direct(origin).value)
        self._splines = _splines(times, record.data.values - at_once)
        self._span = times[[0, -1]]
        self._direct = at_origin.D
        # Inputs and their derivatives (orders x loads x q) by the generators' states.
        readout = line.H * model.acting[:, None] * model.w_scale
        self._inputs = np.stack(
            [readout @ np.linalg.matrix_power(line.G, order) for order in range(len(at_origin.D))]
        )

    def packed(self, z: Array, P: Array) -> Array:
        """Join augmented state and covariance."""
        return np.concatenate([z, P[self.upper]])

    def _unpacked(self, v: Array) -> tuple[Array, Array]:
        P = np.zeros((self.size, self.size))
        P[self.upper] = v[self.size :]
        return v[: self.size], P + np.triu(P, 1).T

    def scale(self, root: Array) -> Array:
        """Return the size below which a component does not matter, before the tolerance."""
        deviation = np.linalg.norm(root, axis=1)
        return self.packed(1e-3 * deviation, 1e-6 * np.outer(deviation, deviation))

    def history(self, rows: Array) -> Pass:
        """Return the estimates, their deviations, and the states."""
        n, N = self.model.states, self.size
        diagonal = [self.upper[0].tolist().index(k) for k in range(N)]  # a row starts at its diagonal
        variances = rows[:, [N + at for at in diagonal]]
        if not np.all(variances > 0):
            raise Diverged("the covariance of eq 20 loses its sign in the integration", remedy=RECORD.astray)
        left = self._unpacked(rows[-1])[1][n:, n:]
        deviations, root = np.sqrt(variances), np.asarray(np.linalg.cholesky(left))
        return Pass(rows[:, n:N], deviations[:, n:], rows[:, :n], deviations[:, :n], root)

    def _linearised(self, t: float, z: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return F (N x N), H^T (channels x N), innovation, drive (n), and slopes of A (p x n x n)."""
        model, n = self.model, self.model.states
        matrices, w = model.at(z[n:]), self._generators(t)
        inputs = self._inputs @ w  # orders x loads
        F = np.zeros((self.size, self.size))
        F[:n, :n] = matrices.A
        F[:n, n:] = (matrices.A_slopes @ z[:n] + matrices.B_slopes @ inputs[0]).T
        moved = matrices.C_slopes @ z[:n] + np.einsum("pkcl,kl->pc", matrices.D_slopes, inputs)
        Ht = np.concatenate([matrices.C, moved.T], axis=1)
        direct = np.einsum("kcl,kl->c", matrices.D - self._direct, inputs)
        recorded = np.clip(t + self._delays, *self._span)
        innovation = self._splines(recorded) - matrices.C @ z[:n] - direct
        outside = np.abs(recorded - t - self._delays) > _TIME_ROUND_OFF * (self._span[1] - self._span[0])
        if outside.any():  # of a delayed channel there is no value of this time, or none yet
            Ht[outside], innovation[outside] = 0.0, 0.0
        return F, Ht, innovation, matrices.B @ inputs[0], matrices.A_slopes

    def _generators(self, t: float) -> Array:
        """Return the generators' states between two nodes, by the series of their exponential."""
        line = self.model.line
        node = int(np.clip(np.searchsorted(line.nodes, t, side="right") - 1, 0, len(line.nodes) - 1))
        tau, w = t - line.nodes[node], self.model.W[node]
        term = w
        for k in range(1, _EXPONENTIAL_TERMS):
            term = (line.G @ term) * (tau / k)
            w = w + term
        return np.asarray(w)

    def rate(self, t: float, v: Array) -> Array:
        """Return dX/dt and dP/dt (eqs 19, 20)."""
        n = self.model.states
        z, P = self._unpacked(v)
        F, Ht, innovation, driven, _ = self._linearised(t, z)
        gain = 2 * P @ Ht.T * self.weight
        dz = gain @ innovation
        dz[:n] += F[:n, :n] @ z[:n] + driven
        FP = F @ P
        return self.packed(dz, FP + FP.T - gain @ (Ht @ P) + self.unmodelled)

    def jacobian(self, t: float, v: Array) -> Array:
        """Return the derivatives of `rate`, but for those of H and of slopes (they only slow Newton down)."""
        n, N = self.model.states, self.size
        z, P = self._unpacked(v)
        F, Ht, innovation, _, change = self._linearised(t, z)
        gain = 2 * P @ Ht.T * self.weight
        closed = F - gain @ Ht
        pull = 2 * Ht.T @ (self.weight * innovation)
        J = np.zeros((len(v), len(v)))
        J[:N, :N] = closed
        i, j = self.upper
        for a, b in ((i, j), (j, i)):  # an entry of the triangle stands for two of P
            once = 1.0 if a is i else (i != j)
            J[np.ix_(range(N), range(N, len(v)))] += once * (np.arange(N)[:, None] == a) * pull[b]
            J[N:, N:] += once * (
                closed[np.ix_(i, a)] * (j[:, None] == b) + (i[:, None] == a) * closed[np.ix_(j, b)]
            )
        for k in range(N):
            dF = np.zeros((N, N))
            if k < n:
                dF[:n, n:] = change[:, :, k].T
            else:
                dF[:n, :n], dF[:n, k] = change[k - n], change[k - n] @ z[:n]
            turned = dF @ P
            J[N:, k] = (turned + turned.T)[self.upper]
        return J


def _splines(times: Array, values: Array) -> Callable[[Array], Array]:
    """Return the channels between their samples, each at its own time, by cubic splines over gaps."""
    from scipy.interpolate import CubicSpline  # heavy import, needed here only

    present = [~np.isnan(column) for column in values.T]
    if min(int(there.sum()) for there in present) < 2:
        raise UsageError("invariant imbedding needs two samples of every channel")
    curves = [
        CubicSpline(times[there], column[there]) for there, column in zip(present, values.T, strict=True)
    ]
    return lambda t: np.array([curve(at) for curve, at in zip(curves, t, strict=True)])
