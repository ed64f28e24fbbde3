"""The filter of the augmented state where joints have nonlinear laws: states, hidden states and parameters.

Source: K. T. Yang 1997, eqs 19–20, split as in `filter` into propagation between samples and a measurement
update on a root of the covariance. The state is integrated by Runge and Kutta's method of order 4, with steps
short for the fastest mode: linearised about the estimate, or at sigma points (cubature: I. Arasaratnam,
S. Haykin, IEEE Trans. Autom. Control 54 (2009) 1254–1269), whose equal weights keep the covariance positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import Diverged, UsageError
from dynid.identification.estimators.filter import Pass, check_run_away, filter_pass
from dynid.identification.information import RECORD
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.systems.nonlinear_prediction import hidden_start, rate_tables
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.native import call, compiled, structure
from dynid.parameters import logarithmic
from dynid.structure.law import BoundLaw
from dynid.structure.nonlinear.compiled_march import by_law_tables, law_tables
from dynid.structure.nonlinear.tables import Steps, load_polynomials

# Phase of the fastest mode in a step of integration: the error of its frequency is this to the power 4 over
# 120, 1e-5. Steps of an interval beyond which a record is refused.
_MAX_PHASE, _MAX_STEPS = 0.2, 64
# Change of the coordinates at which matrices have to be those of their derivatives, and the tolerance.
_PROBE, _AFFINE_TOL = 0.1, 1e-9


def law_filter_pass(
    record: NonlinearRecord, prior: InitialState, deviation: Array, origin: Array, *, sigma_points: bool
) -> Pass:
    """Run the filter once over a record, as `filter.filter_pass`; numbers of hidden states in the prior.

    Raises UsageError of a law that slips or is remembered at once, Diverged if the estimate is lost.
    """
    model, n = record.model, record.model.states
    for name, bound in record.laws_at(prior.eta):
        if bound.law.hidden and bound.rate(0, 0.0, 0.0, 0.0) is None:
            raise UsageError(
                f"the filter follows no slip that begins or ends at once, as of the law '{bound.law.kind}' "
                f"of joint {name}",
                remedy="Use method: auto or output-error, or describe the slip by a law of kind 'bouc_wen'.",
                names=("estimator.method", "estimator"),
            )
    hidden = hidden_start(model, prior.eta, prior.state[:n], prior.state[n:])
    root, m = prior.root.copy(), len(prior.state)
    root[n:m] = hidden.by_state @ prior.root[:n] + hidden.by_number[:, None] * prior.root[n:m]
    root[n:m] += hidden.by_parameter @ prior.root[m:]
    state = np.concatenate([prior.state[:n], hidden.z0])

    def walk(
        model: ParametricModel, measured: Array, weight: Array, z: Array, S: Array, origin: Array,
        history: Mapping[str, Array], _: float,
    ) -> Array:  # fmt: skip
        return _Walk(model, measured, weight, sigma_points).over(z, S, origin, history)

    return filter_pass(
        model, record.data.values, InitialState(state, prior.eta, root), deviation, origin, walk=walk
    )


class _Local(NamedTuple):
    """The equations of motion at coordinates, and the derivatives of their terms by these."""

    A: Array
    B: Array
    E: Array
    C: Array
    T: Array
    laws: list[BoundLaw]
    by_laws: list[Array]
    growth: Array
    here: Array


class _Walk:
    """A pass over the record."""

    def __init__(self, model: ParametricModel, measured: Array, weight: Array, sigma_points: bool) -> None:
        self.model, self.measured, self.weight = model, measured, weight
        self.sigma_points, self.log = sigma_points, logarithmic(model.unknowns)

    def over(self, z: Array, S: Array, origin: Array, history: Mapping[str, Array]) -> Array:
        """Filter the record from state and root before the first sample; fill `history`, return the root."""
        line, p = self.model.line, self.model.parameters
        self.about(z[-p:])
        fastest = np.abs(np.linalg.eigvals(self.stiffest())).max()
        steps = max(1, math.ceil(float(fastest * line.lengths.max()) / _MAX_PHASE))
        if steps > _MAX_STEPS:
            raise UsageError(
                f"the fastest mode turns by {fastest * line.lengths.max():.3g} rad between two samples, "
                "which the filter of joints with nonlinear laws does not follow",
                remedy="Use method: auto or output-error, or keep fewer modes.",
                names=("estimator.method", "estimator"),
            )
        loads = Steps.of(line, steps).coefficients
        self.u = np.einsum("ek,sku->seu", load_polynomials(np.array([0.0, 0.5, 1.0])), loads)
        self.h, self.steps, nodes = line.lengths[line.which] / steps, steps, len(line.nodes)
        # Where matrices are not affine in the values they are those about the estimate of each sample.
        ahead = nodes if self.affine(z[-p:]) else 1
        fast = compiled("dynid_law_filter") and all(bound.law.code for bound in self.tables.laws)
        walk = self._compiled if fast else self._over
        for first in range(0, nodes, ahead):
            if first:
                self.about(z[-p:])
            S = walk(first, min(first + ahead, nodes), z, S, history)
            check_run_away(self.model.unknowns, z[-p:], origin)
            if not (np.isfinite(z).all() and np.isfinite(S).all()):
                raise Diverged("the filter's estimate of the motion is lost", remedy=RECORD.astray)
        return S

    def about(self, eta: Array) -> None:
        """Take the equations of motion about coordinates."""
        self.eta, self.tables = eta.copy(), rate_tables(self.model, eta)
        laws = self.tables.laws
        self.dynamic = [k for k, law in enumerate(laws) if law.law.hidden]

    def stiffest(self) -> Array:
        """Return the matrix of the rest with the tangents of the laws at rest."""
        tables, nf = self.tables, self.tables.E.shape[2]
        k, c = np.zeros((2, nf))
        for law in tables.laws:
            tangent = law.at_rest
            k[law.row] += tangent[0]
            c[law.row] += tangent[1]
        fold = k[:, None] * tables.rows[:nf] + c[:, None] * tables.rows[nf:]
        return np.asarray(tables.A[0] + tables.E[0] @ fold)

    def affine(self, eta: Array) -> bool:
        """Return True if all matrices and laws' parameters are affine in the values of the parameters."""
        other = eta + _PROBE
        here, there = self.local(other), rate_tables(self.model, other)
        pairs = [(here.A, there.A[0]), (here.B, there.B[0]), (here.E, there.E[0]), (here.C, there.C[0])]
        pairs.append((here.T, there.T[0]))
        pairs += [
            (np.array([*a.values, a.offset]), np.array([*b.values, b.offset]))
            for a, b in zip(here.laws, there.laws, strict=True)
        ]
        pairs.append((self.direct(here), there.direct[0]))
        return all(
            np.abs(a - b).max(initial=0.0) <= _AFFINE_TOL * np.abs(b).max(initial=0.0) for a, b in pairs
        )

    def local(self, eta: Array) -> _Local:
        """Return the equations of motion at coordinates."""
        left, tables = eta - self.eta, self.tables
        growth = np.where(self.log, np.expm1(np.where(self.log, left, 0.0)), left)
        here = np.where(self.log, growth + 1, 1.0)
        weights = np.concatenate([[1.0], growth])
        A, B, E, C, T = (np.tensordot(weights, array, 1) for array in tables[:5])
        laws = []
        for law, by in zip(tables.laws, tables.by_laws, strict=True):
            change = by @ growth
            values = tuple((np.array(law.values) + change[:-1]).tolist())
            laws.append(replace(law, values=values, offset=law.offset + float(change[-1])))
        return _Local(A, B, E, C, T, laws, [by * here for by in tables.by_laws], growth, here)

    def direct(self, local: _Local) -> Array:
        """Return what the channels have beside states and forces (times x channels)."""
        return np.asarray(np.tensordot(np.concatenate([[1.0], local.growth]), self.tables.direct, 1))

    def forces(self, local: _Local, y: Array, Y: Array | None) -> tuple[Array, Array, Array, Array]:
        """Return joint forces (nf) and hidden rates (h) at a state, and their slopes if asked for (… x N)."""
        nf, n, h = local.E.shape[1], len(local.A), len(self.dynamic)
        w, p = self.tables.rows @ y[:n], len(local.growth)
        f, rate, size = np.zeros(nf), np.zeros(h), 0 if Y is None else Y.shape[1]
        F, R = np.zeros((nf, size)), np.zeros((h, size))
        W = None if Y is None else self.tables.rows @ Y[:n]
        for k, (law, by) in enumerate(zip(local.laws, local.by_laws, strict=True)):
            row, place = law.row, self.dynamic.index(k) if k in self.dynamic else -1
            at = float(w[row]), float(w[nf + row]), float(y[n + place]) if place >= 0 else 0.0
            regime = law.regime(*at)
            force = law.force(regime, *at)
            f[row] += force.value
            functions = [(force, F, row)]
            if place >= 0:
                flow = law.rate(regime, *at)
                assert flow is not None
                rate[place] = flow.value
                functions.append((flow, R, place))
            if W is None or Y is None:
                continue
            for function, into, line in functions:
                into[line] += function.d * W[row] + function.v * W[nf + row]
                if place >= 0:
                    into[line] += function.z * Y[n + place]
                into[line, -p:] += np.array([float(s) for s in function.p]) @ by
        return f, rate, F, R

    def rates(self, local: _Local, y: Array, Y: Array | None, u: Array) -> tuple[Array, Array | None]:
        """Return the rate of state and hidden states, and of their slopes."""
        n, (f, rate, F, R) = len(local.A), self.forces(local, y, Y)
        out = np.concatenate([local.A @ y[:n] + local.B @ u + local.E @ f, rate])
        if Y is None:
            return out, None
        tables, p = self.tables, len(local.growth)
        slopes = np.concatenate([local.A @ Y[:n] + local.E @ F, R])
        moved = tables.A[1:] @ y[:n] + tables.B[1:] @ u + tables.E[1:] @ f
        slopes[:n, -p:] += (moved * local.here[:, None]).T
        return out, slopes

    def propagated(self, local: _Local, y: Array, Y: Array | None, node: int) -> tuple[Array, Array | None]:
        """Return the state a node later, with its slopes (Runge and Kutta)."""
        h = float(self.h[node])
        for u in self.u[node * self.steps : (node + 1) * self.steps]:
            stages: list[tuple[Array, Array | None]] = []
            for part, load in ((0.0, u[0]), (0.5, u[1]), (0.5, u[1]), (1.0, u[2])):
                at, slopes = y, Y
                if stages:
                    at = y + part * h * stages[-1][0]
                    slopes = None if Y is None else Y + part * h * stages[-1][1]  # type: ignore[operator]
                stages.append(self.rates(local, at, slopes, load))
            weights = (h / 6, h / 3, h / 3, h / 6)
            y = y + sum(weight * stage[0] for weight, stage in zip(weights, stages, strict=True))
            if Y is not None:
                Y = Y + sum(weight * stage[1] for weight, stage in zip(weights, stages, strict=True))  # type: ignore[operator,misc]
        return y, Y

    def outputs(self, local: _Local, y: Array, Y: Array | None, sample: int) -> tuple[Array, Array | None]:
        """Return the channels at a sample, with their slopes."""
        n, p, (f, _, F, _) = len(local.A), len(local.growth), self.forces(local, y, Y)
        direct, tables = self.tables.direct[:, sample], self.tables
        out = local.C @ y[:n] + local.T @ f + direct[0] + local.growth @ direct[1:]
        if Y is None:
            return out, None
        slopes = local.C @ Y[:n] + local.T @ F
        slopes[:, -p:] += ((tables.C[1:] @ y[:n] + tables.T[1:] @ f + direct[1:]) * local.here[:, None]).T
        return out, slopes

    def _over(self, first: int, last: int, z: Array, S: Array, history: Mapping[str, Array]) -> Array:
        """Filter some nodes."""
        n, p, N = self.model.states, self.model.parameters, len(z)
        samples = self.model.line.sample_of().tolist()
        for node in range(first, last):
            move = (lambda at, y, Y, node=node: self.propagated(at, y, Y, node - 1)) if node else None
            sample = samples[node]
            z[:], D, out, H = (self._at_points if self.sigma_points else self._linearised)(z, S, move, sample)
            if sample < 0:
                S = _triangle(D) if self.sigma_points else D
                continue
            present = np.flatnonzero(~np.isnan(self.measured[sample]))
            weight = self.weight[sample, present]
            k = len(present)
            joint = np.zeros((k + N, D.shape[1] + k))
            joint[:k, : D.shape[1]], joint[k:, : D.shape[1]] = H[present] * weight[:, None], D
            joint[:k, D.shape[1] :] = np.eye(k)
            L = _triangle(joint)
            innovation = np.zeros(k)
            for row in range(k):  # each given the channels before it
                left = (self.measured[sample, present[row]] - out[present[row]]) * weight[row]
                innovation[row] = (left - L[row, :row] @ innovation[:row]) / L[row, row]
            history["innovations"][sample, present] = innovation * np.sign(np.diag(L)[:k])
            z += L[k:, :k] @ innovation
            S = L[k:, k:]
            spread = np.sqrt(np.einsum("ij,ij->i", S, S))
            history["eta"][sample], history["deviations"][sample] = z[-p:], spread[-p:]
            history["states"][sample], history["state_deviations"][sample] = z[:n], spread[:n]
        return S

    def _linearised(
        self, z: Array, S: Array, move: Callable[..., Any] | None, sample: int
    ) -> tuple[Array, Array, Array, Array]:
        """Return augmented state, deviations, outputs and theirs, linearised about the estimate."""
        m, local = len(z) - self.model.parameters, self.local(z[-self.model.parameters :])
        y, Y = z[:m], np.eye(m, len(z))
        if move is not None:
            y, Y = move(local, y, Y)
        D = np.concatenate([Y @ S, S[m:]])
        if sample < 0:
            return np.concatenate([y, z[m:]]), D, z, D
        out, H = self.outputs(local, y, np.eye(m, len(z)), sample)
        assert H is not None
        return np.concatenate([y, z[m:]]), D, out, H @ D

    def _at_points(
        self, z: Array, S: Array, move: Callable[..., Any] | None, sample: int
    ) -> tuple[Array, Array, Array, Array]:
        """Return augmented state, deviations, outputs and theirs by sigma points."""
        N, p = len(z), self.model.parameters
        points = z + math.sqrt(N) * np.concatenate([S.T, -S.T])
        rows, outs = [], []
        for point in points:
            local, y = self.local(point[-p:]), point[:-p]
            if move is not None:
                y, _ = move(local, y, None)
            rows.append(np.concatenate([y, point[-p:]]))
            if sample >= 0:
                outs.append(self.outputs(local, y, None, sample)[0])
        X, Y = np.array(rows), np.array(outs or rows)
        mean, out = X.mean(axis=0), Y.mean(axis=0)
        scale = math.sqrt(2 * N)
        return mean, (X - mean).T / scale, out, (Y - out).T / scale

    def _compiled(self, first: int, last: int, z: Array, S: Array, history: Mapping[str, Array]) -> Array:
        """Filter some nodes by the kernel."""
        tables, line, p = self.tables, self.model.line, self.model.parameters
        laws = {**law_tables(tables.laws), "by_laws": by_law_tables(tables.laws, tables.by_laws, p)}
        names = ("A", "B", "E", "C", "T", "direct", "rows")
        arrays = {name: np.ascontiguousarray(getattr(tables, name)) for name in names}
        root = np.ascontiguousarray(S)
        members = structure(
            n=self.model.states, h=len(self.dynamic), p=p, nf=tables.E.shape[2], nu=tables.B.shape[2],
            nl=len(tables.laws), nc=tables.C.shape[1], steps=self.steps, first=first, last=last,
            samples=tables.direct.shape[1], sigma_points=int(self.sigma_points), **arrays, **laws,
            dynamic=np.array([*self.dynamic, 0], dtype=np.int64), eta=self.eta,
            log=self.log.astype(np.int64), u=np.ascontiguousarray(self.u), dt=self.h,
            sample_of=np.asarray(line.sample_of(), dtype=np.int64),
            measured=np.ascontiguousarray(self.measured), weight=np.ascontiguousarray(self.weight),
            z=z, S=root, **{f"history_{name}": array for name, array in history.items()},
        )  # fmt: skip
        call("dynid_law_filter", members)
        return root


def _triangle(D: Array) -> Array:
    """Return the lower triangular root (rows x rows) of D D^T."""
    return np.transpose(np.linalg.qr(D.T, mode="r"))
