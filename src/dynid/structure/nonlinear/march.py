"""Motion of a linear structure with few nonlinear joint forces, and its exact sensitivities.

The rest ``x' = A x + D [f, u, …]`` is propagated exactly (exponential collocation on Lobatto nodes, s = 5,
order 8): within a step joint forces and loads are the polynomials through their values at the nodes, and A
answers polynomials by phi functions. The unknowns of Newton's iteration are the joint forces at the nodes
alone, whatever the number of DOFs. The tangent of each regime of the laws is taken into A, so that what is
interpolated is the rest of the force: zero for laws that are linear in their regimes. A step ends where a
guard of a law vanishes. The sensitivities solve the variational equation on the same nodes with the same
matrix; where the force jumps at an event they jump as well (saltation).

`march` takes the steps that it is told, `accurate_march` halves them until the response does not change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import NumericalError
from dynid.lti.time_response import Timeline
from dynid.native import compiled
from dynid.structure.joint_laws import BoundLaw, Slopes
from dynid.structure.nonlinear.tables import (
    NODES,
    SCAN,
    Columns,
    LinearRest,
    Motion,
    Refine,
    Regime,
    Regimes,
    Steps,
    Tables,
    first_regimes,
    left_out,
    lobatto,
)

# Newton ends where the forces change by less than this part of the largest; two more digits than the
# response has.
_NEWTON_TOL = 1e-12
_MAX_NEWTON = 30
# Events of one step beyond which a motion chatters.
_MAX_EVENTS = 200
# An event is located where its time changes by less than this part of a step.
_EVENT_TOL = 1e-12
_MAX_LOCATIONS = 12
# Change of a motion, relative to its largest, when its steps are halved: the error of the finer one is some
# hundred times smaller, by the order 8 of the steps.
_COARSE_TOL = 1e-7
# Estimated error of a motion, relative to its largest state, of laws without regimes: the estimate exceeds
# the error by a factor of five and more on chains and stiff beams.
_ERROR_TOL = 1e-6
_MAX_PARTS = 64


@dataclass
class _March:
    """The state of a march."""

    kept: Regimes
    loads: Steps
    columns: Columns | None
    x: Array
    z: Array
    regimes: list[int]
    S: Array  # slopes of the state (n x q)
    T: Array  # slopes of the hidden states (laws x q)
    work: Array  # done on the laws (nf), J
    events: int = 0
    steps: int = 0
    local_error: float = 0.0

    @property
    def rest(self) -> LinearRest:
        """The linear rest."""
        return self.kept.rest

    @property
    def laws(self) -> Sequence[BoundLaw]:
        """The laws."""
        return self.kept.laws

    @property
    def regime(self) -> Regime:
        """The rest with the tangents of the regimes."""
        return self.kept.at(self.regimes)

    def forces(self, w: Array, z: Array) -> _Forces:
        """Return the forces at nodes with rows w (nodes x rows) and hidden states z (nodes x laws)."""
        nodes, nf, laws = len(w), self.rest.forces, len(self.laws)
        value, d, v = np.zeros((3, nodes, nf))
        rates = np.zeros((4, nodes, laws))
        f = _Forces(value, d, v, np.zeros((nodes, nf, laws)), rates[0], rates[1], rates[2], rates[3], [], [])
        for index, (law, regime) in enumerate(zip(self.laws, self.regimes, strict=True)):
            d, v, hidden = w[:, law.row], w[:, nf + law.row], z[:, index]
            force, rate = law.force(regime, d, v, hidden), law.rate(regime, d, v, hidden)
            f.value[:, law.row] += force.value
            f.d[:, law.row] += force.d
            f.v[:, law.row] += force.v
            f.z[:, law.row, index] += force.z
            f.p.append(force.p)
            f.rate_p.append(None if rate is None else rate.p)
            if rate is not None:
                f.rate[:, index], f.rate_d[:, index] = rate.value, rate.d
                f.rate_v[:, index], f.rate_z[:, index] = rate.v, rate.z
        return f

    # A step.

    def solve(self, tables: Tables, u: Array) -> _Step:
        """Solve for the joint forces at the nodes of a step, with loads u (s x nu) there."""
        regime, nf, nu = self.regime, self.rest.forces, self.rest.loads
        _, _, integrals = lobatto()
        a, influence = integrals * tables.h, tables.influence
        w = np.empty((NODES, len(regime.R)))
        w[0] = regime.R @ self.x
        start = self.forces(w[:1], self.z[None])
        linear = tables.rows @ self.x + np.einsum("erju,ju->er", influence[..., nf : nf + nu], u)
        g = np.repeat(start.value - regime.k * w[:1, :nf] - regime.c * w[:1, nf : 2 * nf], NODES, axis=0)
        dynamic = [
            index for index, law in enumerate(self.laws) if law.rate(self.regimes[index], 0.0, 0.0, 0.0)
        ]
        z = np.repeat(self.z[None], NODES, axis=0)
        z[1:, dynamic] += integrals[1:].sum(axis=1)[:, None] * tables.h * start.rate[:, dynamic]
        R, before = influence[..., :nf], (0.0, 0.0)
        for _ in range(_MAX_NEWTON):
            w[1:] = linear + np.einsum("erjf,jf->er", R, g)
            f = self.forces(w, z)
            error_g = (f.value - regime.k * w[:, :nf] - regime.c * w[:, nf : 2 * nf] - g)[1:]
            error_z = (self.z + a @ f.rate - z)[1:, dynamic]
            J = self._jacobian(f, R, a, dynamic)
            change = np.linalg.solve(J, np.concatenate([error_g.ravel(), error_z.ravel()]))
            if not np.isfinite(change).all():
                break
            size = (NODES - 1) * nf
            g[1:] += change[:size].reshape(NODES - 1, nf)
            z[1:, dynamic] += change[size:].reshape(NODES - 1, len(dynamic))
            moved = np.abs(change[:size]).max(initial=0.0), np.abs(change[size:]).max(initial=0.0)
            scale = np.abs(f.value).max(initial=0.0) + np.abs(g).max(), np.abs(z).max(initial=0.0)
            # The next change is smaller by as much as this one was, at least.
            following = [m * min(1.0, m / b if b else 1.0) for m, b in zip(moved, before, strict=True)]
            before = moved
            if all(m <= _NEWTON_TOL * s + 1e-300 for m, s in zip(following, scale, strict=True)):
                w[1:] = linear + np.einsum("erjf,jf->er", R, g)
                return _Step(tables, u, w, z, g, self.forces(w, z), J, dynamic)
        raise Refine("the joint forces of a step do not converge")

    def _jacobian(self, f: _Forces, R: Array, a: Array, dynamic: list[int]) -> Array:
        """Return the matrix of Newton's iteration, forces at nodes 1 … s - 1 before hidden states."""
        m, nf, nz = NODES - 1, self.rest.forces, len(dynamic)
        regime = self.regime
        rows, inner = [law.row for law in (self.laws[index] for index in dynamic)], R[:, :, 1:]
        by_g = (f.d[1:] - regime.k)[:, :, None, None] * inner[:, :nf]
        by_g = by_g + (f.v[1:] - regime.c)[:, :, None, None] * inner[:, nf : 2 * nf]
        J = np.eye(m * (nf + nz))
        J[: m * nf, : m * nf] -= by_g.reshape(m * nf, m * nf)
        if nz:
            nodes = np.arange(m)
            gz = np.zeros((m, nf, m, nz))
            gz[nodes, :, nodes] = f.z[1:][:, :, dynamic]
            J[: m * nf, m * nf :] -= gz.reshape(m * nf, m * nz)
            moved = f.rate_d[1:, dynamic, None, None] * inner[:, rows]
            moved = moved + f.rate_v[1:, dynamic, None, None] * inner[:, [nf + row for row in rows]]
            J[m * nf :, : m * nf] -= np.einsum("ej,jzkf->ezkf", a[1:, 1:], moved).reshape(m * nz, m * nf)
            zz = np.zeros((m, nz, m, nz))
            for index in range(nz):
                zz[:, index, :, index] = a[1:, 1:] * f.rate_z[1:, dynamic[index]]
            J[m * nf :, m * nf :] -= zz.reshape(m * nz, m * nz)
        return J

    def accept(self, step: _Step) -> None:
        """Go to the end of a step, with the sensitivities."""
        tables, nf, nu = step.tables, self.rest.forces, self.rest.loads
        if self.S.shape[1]:
            self._sensitivities(step)
        acting = np.concatenate([step.g, step.u], axis=1)
        self.x = tables.P @ self.x + np.einsum("njd,jd->n", tables.Q[..., : nf + nu], acting)
        self.z = step.z[-1].copy()
        power = np.zeros((NODES, nf + 2))
        power[:, :nf] = step.f.value * step.w[:, nf : 2 * nf]
        of_energy = step.w[:, len(self.rest.rows) :]
        if of_energy.shape[1]:
            power[:, nf] = np.sum(of_energy[:, :nu] * step.u, axis=1)
            power[:, nf + 1] = np.sum(of_energy[:, nu:] ** 2, axis=1)
        self.work = self.work + tables.h * (lobatto()[2][-1] @ power)
        self.local_error += tables.h * left_out(acting, self.rest.D[:, : nf + nu])
        self.steps += 1

    def _column_forces(self, step: _Step) -> tuple[Array, Array, Array]:
        """Return what parameters add at the nodes: further forces (s x r x p), joint forces, hidden rates."""
        columns, nf = self.columns, self.rest.forces
        assert columns is not None
        p = columns.by_rows.shape[0]
        further = np.einsum("prw,ew->erp", columns.by_rows, step.w[:, 2 * nf : len(self.rest.rows)])
        further += np.einsum("pru,eu->erp", columns.by_loads, step.u)
        further += np.einsum("prf,ef->erp", columns.by_forces, step.f.value)
        forces, rates = np.zeros((NODES, nf, p)), np.zeros((NODES, len(self.laws), p))
        for index, (law, by) in enumerate(zip(self.laws, columns.laws, strict=True)):
            for k, slope in enumerate(step.f.p[index]):
                forces[:, law.row] += np.multiply.outer(np.broadcast_to(slope, NODES), by[k])
            for k, slope in enumerate(step.f.rate_p[index] or ()):
                rates[:, index] += np.multiply.outer(np.broadcast_to(slope, NODES), by[k])
        return further, forces, rates

    def _sensitivities(self, step: _Step) -> None:
        """Solve the variational equation over a step."""
        tables, f, nf, nu = step.tables, step.f, self.rest.forces, self.rest.loads
        q, m, dynamic = self.S.shape[1], NODES - 1, step.dynamic
        regime, a = self.regime, lobatto()[2] * tables.h
        R = tables.influence[..., :nf]
        direct, direct_rate = np.zeros((NODES, nf, q)), np.zeros((NODES, len(self.laws), q))
        W = np.empty((NODES, len(regime.R), q))
        W[0], W[1:] = regime.R @ self.S, tables.rows @ self.S
        further = np.zeros((NODES, self.rest.D.shape[1] - nf - nu, q))
        if self.columns is not None:
            p = self.columns.by_rows.shape[0]
            further[..., :p], direct[..., :p], direct_rate[..., :p] = self._column_forces(step)
            W[1:] += np.einsum("erjx,jxq->erq", tables.influence[..., nf + nu :], further)

        def force(W: Array, Z: Array, nodes: slice) -> Array:
            moved = (f.d[nodes] - regime.k)[..., None] * W[:, :nf]
            moved = moved + (f.v[nodes] - regime.c)[..., None] * W[:, nf : 2 * nf]
            return np.asarray(moved + np.einsum("efl,elq->efq", f.z[nodes], Z) + direct[nodes])

        def rate(W: Array, nodes: slice) -> Array:
            rows = [law.row for law in self.laws]
            moved = (
                f.rate_d[nodes][..., None] * W[:, rows]
                + f.rate_v[nodes][..., None] * W[:, [nf + r for r in rows]]
            )
            return moved + direct_rate[nodes]

        Z = np.repeat(self.T[None], NODES, axis=0)
        g = np.empty((NODES, nf, q))
        g[0] = force(W[:1], Z[:1], slice(0, 1))[0]
        W[1:] += np.einsum("erf,fq->erq", R[:, :, 0], g[0])
        constant = Z.copy()
        constant[:, dynamic] = 0.0
        right = [force(W[1:], constant[1:], slice(1, None)).reshape(m * nf, q)]
        if dynamic:
            rates = rate(W, slice(None))
            rates[0] += f.rate_z[0][:, None] * self.T
            right.append((self.T + np.einsum("ej,jlq->elq", a, rates))[1:, dynamic].reshape(-1, q))
        solution = np.linalg.solve(step.J, np.concatenate(right))
        g[1:] = solution[: m * nf].reshape(m, nf, q)
        acting = np.concatenate([g, np.zeros((NODES, nu, q)), further], axis=1)
        self.S = tables.P @ self.S + np.einsum("njd,jdq->nq", tables.Q, acting)
        if dynamic:
            self.T = self.T.copy()
            self.T[dynamic] = solution[m * nf :].reshape(m, len(dynamic), q)[-1]

    def read(self) -> tuple[Array, ...]:
        """Return state, hidden states, forces and regimes, with the sensitivities, as of `Motion`."""
        nf, q = self.rest.forces, self.S.shape[1]
        w = self.rest.rows @ self.x
        f = self.forces(w[None], self.z[None])
        W = self.rest.rows @ self.S
        slopes = f.d[0][:, None] * W[:nf] + f.v[0][:, None] * W[nf : 2 * nf] + f.z[0] @ self.T
        if self.columns is not None:
            for law, by, p in zip(self.laws, self.columns.laws, f.p, strict=True):
                for k, slope in enumerate(p):
                    slopes[law.row, : by.shape[1]] += float(np.ravel(slope)[0]) * by[k]
        regimes = np.array(self.regimes)
        return self.x, self.z, f.value[0], regimes, self.work, self.S, slopes.reshape(nf, q), self.T

    # Events.

    def guards(self, w: Array, z: Array) -> list[tuple[int, int, Array]]:
        """Return law, following regime and values of the guards at points with rows w, hidden states z."""
        nf, out = self.rest.forces, []
        for index, (law, regime) in enumerate(zip(self.laws, self.regimes, strict=True)):
            for guard in law.guards(regime, w[:, law.row], w[:, nf + law.row], z[:, index]):
                out.append((index, guard.following, np.broadcast_to(guard.function.value, len(w))))
        return out

    def first_event(self, step: _Step) -> _Event | None:
        """Return the earliest event of a step, located on the polynomials through its nodes."""
        if not any(law.guards(r, 0.0, 0.0, 0.0) for law, r in zip(self.laws, self.regimes, strict=True)):
            return None
        _, L, _ = lobatto()
        V = np.vander(SCAN, NODES, increasing=True) @ L.T
        event: _Event | None = None
        for number, (index, following, values) in enumerate(self.guards(V @ step.w, V @ step.z)):
            negative = np.flatnonzero(values < 0)
            if not len(negative) or (event and SCAN[negative[0]] > event.high):
                continue
            low = SCAN[negative[0] - 1] if negative[0] else 0.0
            theta = self._root(step, number, low, float(SCAN[negative[0]]))
            if event is None or theta < event.theta:
                event = _Event(theta, index, following, number, float(SCAN[negative[0]]))
        return event

    def guard_at(self, step: _Step, number: int, theta: float) -> float:
        """Return a guard on the polynomials of a step."""
        basis = theta ** np.arange(NODES) @ lobatto()[1].T
        return float(self.guards((basis @ step.w)[None], (basis @ step.z)[None])[number][2][0])

    def _root(self, step: _Step, number: int, low: float, high: float) -> float:
        """Return the zero of a guard in an interval at whose end it is negative (Illinois algorithm)."""
        at_low, at_high = self.guard_at(step, number, low), self.guard_at(step, number, high)
        if at_low <= 0:
            return low
        side = 0
        for _ in range(100):
            if high - low <= _EVENT_TOL:
                break
            apart = at_high - at_low
            theta = (low * at_high - high * at_low) / apart if apart else low
            if not low < theta < high:
                theta = (low + high) / 2
            value = self.guard_at(step, number, theta)
            if value > 0:
                at_high, side, low, at_low = (at_high / 2 if side > 0 else at_high), 1, theta, value
            else:
                at_low, side, high, at_high = (at_low / 2 if side < 0 else at_low), -1, theta, value
        return high

    def switch(self, event: _Event, u: Array) -> None:
        """Change the regime of a law, with hidden states and sensitivities."""
        nf, law, before = self.rest.forces, self.laws[event.law], self.regimes[event.law]
        w = self.rest.rows @ self.x
        d, v, z = float(w[law.row]), float(w[nf + law.row]), float(self.z[event.law])
        f = self.forces(w[None], self.z[None])
        guards = law.guards(before, d, v, z)
        function = next(guard.function for guard in guards if guard.following == event.following)
        hidden = law.entered(before, event.following, d, z)
        W, q = self.rest.rows @ self.S, self.S.shape[1]
        by = np.zeros((len(law.values) + 1, q))
        if self.columns is not None:
            by[:, : self.columns.by_rows.shape[0]] = self.columns.laws[event.law]

        def total(function: Slopes) -> Array:
            moved = function.d * W[law.row] + function.v * W[nf + law.row] + function.z * self.T[event.law]
            by_values = sum((s * row for s, row in zip(function.p, by, strict=True)), np.zeros(q))
            return np.asarray(moved + by_values)

        acceleration = self.rest.rows[nf + law.row] @ (
            self.rest.A @ self.x + self.rest.D[:, :nf] @ f.value[0] + self.rest.D[:, nf : nf + len(u)] @ u
        )
        moved = total(function)
        rate = function.d * v + function.v * acceleration + function.z * f.rate[0, event.law]
        shift = -moved / rate if rate else np.zeros(q)  # of the event's time
        if hidden is not None:
            T = total(hidden) + (hidden.d * v + hidden.v * acceleration) * shift
            self.z = self.z.copy()
            self.z[event.law] = hidden.value
        self.regimes[event.law] = event.following
        after = self.forces(w[None], self.z[None])
        if q:
            jump = f.value[0] - after.value[0]
            if np.abs(jump).max(initial=0.0) > 1e-9 * (np.abs(f.value).max() + np.abs(after.value).max()):
                self.S = self.S + np.outer(self.rest.D[:, :nf] @ jump, shift)
            if hidden is not None:
                self.T = self.T.copy()
                self.T[event.law] = T
        self.events += 1

    def advance(self, index: int, h: float) -> None:
        """Go over a regular step, from event to event."""
        c, _, _ = lobatto()
        done = 0.0
        for _ in range(_MAX_EVENTS):
            part = 1.0 - done
            tables = self.regime.tables(h * part, regular=done == 0.0)
            step = self.solve(tables, self.loads.at(index, done + part * c))
            event = self.first_event(step)
            if event is None:
                self.accept(step)
                return
            theta = event.theta
            if theta > 0:
                theta = self._located(event, index, h, done, part)
                done += part * theta
            if done >= 1.0 - _EVENT_TOL:
                done = 1.0
            self.switch(event, self.loads.at(index, np.array([done]))[0])
            if done == 1.0:
                return
        raise Refine("the regimes of a joint change without end")

    def _located(self, event: _Event, index: int, h: float, done: float, part: float) -> float:
        """Take the part of a step up to an event, whose place is corrected until it does not move."""
        c, _, _ = lobatto()
        theta = event.theta
        for _ in range(_MAX_LOCATIONS):
            tables = self.regime.tables(h * part * theta, regular=False)
            step = self.solve(tables, self.loads.at(index, done + part * theta * c))
            at_end, earlier = (
                self.guard_at(step, event.number, 1.0),
                self.guard_at(step, event.number, 1 - 1e-4),
            )
            slope = (at_end - earlier) / 1e-4
            correction = -at_end / slope if slope < 0 else 0.0
            if abs(correction) * theta < 1e-9 or not 0.5 < 1 + correction < 2:
                break
            theta = min(1.0, theta * (1 + correction))
        self.accept(step)
        return theta


class _Forces(NamedTuple):
    """Joint forces and hidden rates at nodes, with their slopes by deflection, its rate and hidden states."""

    value: Array
    d: Array
    v: Array
    z: Array
    rate: Array
    rate_d: Array
    rate_v: Array
    rate_z: Array
    p: list[Any]
    rate_p: list[Any]


class _Step(NamedTuple):
    """The solution of a step: loads, rows, hidden states and interpolated forces at its nodes."""

    tables: Tables
    u: Array
    w: Array
    z: Array
    g: Array
    f: _Forces
    J: Array
    dynamic: list[int]


class _Event(NamedTuple):
    """An event of a step: its place, its law, the following regime and the number of its guard."""

    theta: float
    law: int
    following: int
    number: int
    high: float


def march(
    rest: LinearRest,
    laws: Sequence[BoundLaw],
    steps: Steps,
    x0: Array,
    z0: Array,
    columns: Columns | None = None,
    *,
    first: bool = False,
    impulse: tuple[int, Array] | None = None,
    kept: Regimes | None = None,
) -> Motion:
    """March from a first state, with these regular steps.

    `x0` (n), `z0` (laws): first state and hidden states; `columns`: what parameters act on, if sensitivities
    by these are asked for; `first`: with those by the first and hidden states; `impulse`: a step at whose
    beginning the state jumps, and by how much; `kept`: regimes of this rest and these laws, whose tables
    several marches share.

    Raises Refine if a step is too long.
    """
    kept = kept or Regimes(rest, laws)
    if compiled("dynid_march") and all(law.law.code for law in laws):
        from dynid.structure.nonlinear import compiled_march

        motion = compiled_march.march(kept, steps, x0, z0, columns, first=first, impulse=impulse)
        if motion is not None:
            return motion
    n, p = len(x0), 0 if columns is None else len(columns.by_rows)
    q = p + (n + len(laws)) * first
    S, T = np.zeros((n, q)), np.zeros((len(laws), q))
    if first:
        S[:, p : p + n], T[:, p + n :] = np.eye(n), np.eye(len(laws))
    nf, regimes = rest.forces, first_regimes(rest, laws, x0, z0)
    state = _March(kept, steps, columns, x0.copy(), z0.copy(), regimes, S, T, np.zeros(nf + 2))
    samples, shapes = (
        len(steps.samples),
        ((n,), (len(laws),), (nf,), (len(laws),), (nf + 2,), (n, q), (nf, q), (len(laws), q)),
    )
    out = [np.empty((samples, *shape)) for shape in shapes]
    sample = 0
    for index in range(len(steps.lengths) + 1):
        if impulse is not None and impulse[0] == index:
            state.work[nf] += (state.x + impulse[1] / 2) @ rest.work_of(impulse[1])
            state.x = state.x + impulse[1]
        if sample < samples and steps.samples[sample] == index:
            for array, value in zip(out, state.read(), strict=True):
                array[sample] = value
            sample += 1
        if sample == samples:
            break
        state.advance(index, float(steps.lengths[index]))
    return Motion._make((*out, state.events, state.steps, state.local_error))


class Accuracy(NamedTuple):
    """What was needed for a motion: parts of each interval, and its error.

    That is the largest change by halving the steps; of laws without regimes an estimate from a single motion.
    """

    parts: int
    error: float


def accurate_march(
    rest: LinearRest,
    laws: Sequence[BoundLaw],
    line: Timeline,
    x0: Array,
    z0: Array,
    *,
    added: Callable[[Array], Array] | None = None,
    impulse: Array | None = None,
    parts: int = 1,
) -> tuple[Motion, Accuracy]:
    """March with steps that are halved until the error of the motion is small.

    `line`: intervals between the times asked for; `added`: what is added to its loads at times; `impulse`:
    jump of the state at its jump node; `parts`: of each interval to begin with. The states are to be
    balanced: changes are relative to the largest one.

    Raises NumericalError if the steps would become too short.
    """
    coarse: Motion | None = None
    kept = Regimes(rest, laws)
    smooth = all(not law.guards(law.regime(0.0, 0.0, 0.0), 0.0, 0.0, 0.0) for law in laws)
    while parts <= _MAX_PARTS:
        steps = Steps.of(line, parts, added)
        at = None if impulse is None else (line.jump_node * parts, impulse)
        motion: Motion | None = None
        with suppress(Refine):
            motion = march(rest, laws, steps, x0, z0, impulse=at, kept=kept)
        if motion is None:
            coarse, parts = None, 2 * parts
            continue
        size = np.abs(motion.states).max(initial=0.0) or 1.0
        if smooth:
            error = motion.local_error / float(size)
            if error <= _ERROR_TOL:
                return motion, Accuracy(parts, error)
        if coarse is not None:
            error = float(np.abs(motion.states - coarse.states).max(initial=0.0) / size)
            if error <= _COARSE_TOL:
                return motion, Accuracy(parts, error)
        coarse, parts = motion, 2 * parts
    raise NumericalError(
        f"the motion still changes with {_MAX_PARTS} steps between two samples",
        remedy="Shorten the time between samples, or soften contacts and sliders: the motion may be chaotic, "
        "or change between contacts faster than can be followed.",
    )
