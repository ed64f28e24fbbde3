"""A step of a march: joint forces at its nodes, the state at its end, and the sensitivities of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.structure.law import BoundLaw
from dynid.structure.nonlinear.memory import Memory
from dynid.structure.nonlinear.tables import (
    NODES,
    Columns,
    LinearRest,
    Refine,
    Regime,
    Regimes,
    Steps,
    Tables,
    left_out,
    load_polynomials,
    lobatto,
)

# Newton ends where the next change of the forces is below this part of the largest: two more digits than the
# response has; thirty changes, each a third of the last one, would reach it.
_NEWTON_TOL = 1e-12
_MAX_NEWTON = 30


class Forces(NamedTuple):
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


class Step(NamedTuple):
    """The solution of a step: coefficients of its loads; loads, rows, hidden states, forces at its nodes."""

    tables: Tables
    loads: Array
    u: Array
    w: Array
    z: Array
    g: Array
    f: Forces
    J: Array
    dynamic: list[int]


@dataclass
class MarchState:
    """The state of a march, and the steps from it."""

    kept: Regimes
    loads: Steps
    columns: Columns | None
    x: Array
    z: Array
    regimes: list[int]
    S: Array  # slopes of the state (n x q)
    T: Array  # slopes of the hidden states (laws x q)
    memory: Memory
    work: Array  # done on the laws (nf), J
    fading: float  # rate at which errors fade, 1/s
    before: Step | None = None
    error: float = 0.0
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

    def forces(self, w: Array, z: Array) -> Forces:
        """Return the forces at nodes with rows w (nodes x rows) and hidden states z (nodes x laws)."""
        nodes, nf, laws = len(w), self.rest.forces, len(self.laws)
        value, d, v = np.zeros((3, nodes, nf))
        rates = np.zeros((4, nodes, laws))
        f = Forces(value, d, v, np.zeros((nodes, nf, laws)), rates[0], rates[1], rates[2], rates[3], [], [])
        for index, (law, regime) in enumerate(zip(self.laws, self.regimes, strict=True)):
            d, v, hidden = w[:, law.row], w[:, nf + law.row], z[:, index]
            force, rate = law.force(regime, d, v, hidden), law.rate(regime, d, v, hidden)
            f.value[:, law.row] += force.value + self.memory.f[index]
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

    def solve(self, tables: Tables, loads: Array) -> Step:
        """Solve for the joint forces at the nodes of a step, with these coefficients of its loads."""
        regime, nf = self.regime, self.rest.forces
        _, _, integrals = lobatto()
        a, influence, u = integrals * tables.h, tables.influence, load_polynomials(lobatto()[0]) @ loads
        w = np.empty((NODES, len(regime.R)))
        w[0] = regime.R @ self.x
        start = self.forces(w[:1], self.z[None])
        linear = tables.rows @ self.x + np.einsum("erju,ju->er", tables.by_loads, loads)
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
                f = self.forces(w, z)
                return Step(tables, loads, u, w, z, g, f, self._jacobian(f, R, a, dynamic), dynamic)
        raise Refine("the joint forces of a step do not converge")

    def _jacobian(self, f: Forces, R: Array, a: Array, dynamic: list[int]) -> Array:
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

    def accept(self, step: Step) -> None:
        """Go to the end of a step, with the sensitivities."""
        tables, nf, nu = step.tables, self.rest.forces, self.rest.loads
        if self.S.shape[1]:
            self._sensitivities(step)
        self.x = tables.P @ self.x + np.einsum("njd,jd->n", tables.Q[..., :nf], step.g)
        self.x += np.einsum("njd,jd->n", tables.U, step.loads)
        self.z = step.z[-1].copy()
        power = np.zeros((NODES, nf + 2))
        power[:, :nf] = step.f.value * step.w[:, nf : 2 * nf]
        of_energy = step.w[:, len(self.rest.rows) :]
        if of_energy.shape[1]:
            power[:, nf] = np.sum(of_energy[:, :nu] * step.u, axis=1)
            power[:, nf + 1] = np.sum(of_energy[:, nu:] ** 2, axis=1)
        self.work = self.work + tables.h * (lobatto()[2][-1] @ power)
        self.steps += 1

    def add_error(self, step: Step) -> None:
        """Add to the error of the state what polynomials leave out over a whole step."""
        h, nf, nu = step.tables.h, self.rest.forces, self.rest.loads
        last, before = np.abs(step.loads[:-3:-1]) * np.linalg.norm(self.rest.D[:, nf : nf + nu], axis=0)
        change = h * np.max(last * np.minimum(1, last / np.where(before > 0, before, 1)), initial=0.0)
        before_g = self.before.g if self.before and self.before.tables.h == h else None
        change += np.sum(left_out(step.g, before_g) * step.tables.beyond)
        self.error = self.error * np.exp(-self.fading * h) + float(change)
        self.local_error, self.before = max(self.local_error, self.error), step

    def _column_forces(self, step: Step) -> tuple[Array, Array, Array]:
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

    def _began(self) -> Array:
        """Return the slopes of the forces at which the branches of the laws began (nf x q)."""
        out = np.zeros((self.rest.forces, self.S.shape[1]))
        np.add.at(out, [law.row for law in self.laws], self.memory.F)
        return out

    def _sensitivities(self, step: Step) -> None:
        """Solve the variational equation over a step."""
        tables, f, nf, nu = step.tables, step.f, self.rest.forces, self.rest.loads
        q, m, dynamic = self.S.shape[1], NODES - 1, step.dynamic
        regime, a = self.regime, lobatto()[2] * tables.h
        R = tables.influence[..., :nf]
        direct, direct_rate = np.zeros((NODES, nf, q)), np.zeros((NODES, len(self.laws), q))
        direct += self._began()
        W = np.empty((NODES, len(regime.R), q))
        W[0], W[1:] = regime.R @ self.S, tables.rows @ self.S
        further = np.zeros((NODES, self.rest.D.shape[1] - nf - nu, q))
        if self.columns is not None:
            p = self.columns.by_rows.shape[0]
            further[..., :p], forces, direct_rate[..., :p] = self._column_forces(step)
            direct[..., :p] += forces
            W[1:] += np.einsum("erjx,jxq->erq", tables.influence[..., nf:], further)

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
        acting = np.concatenate([g, further], axis=1)
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
        slopes += self._began()
        if self.columns is not None:
            for law, by, p in zip(self.laws, self.columns.laws, f.p, strict=True):
                for k, slope in enumerate(p):
                    slopes[law.row, : by.shape[1]] += float(np.ravel(slope)[0]) * by[k]
        regimes = np.array(self.regimes)
        return self.x, self.z, f.value[0], regimes, self.work, self.S, slopes.reshape(nf, q), self.T
