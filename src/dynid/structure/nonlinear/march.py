"""Motion of a linear structure with few nonlinear joint forces, and its exact sensitivities.

The rest ``x' = A x + D [f, u, …]`` is propagated exactly (exponential collocation on Lobatto nodes, s = 5,
order 8): within a step joint forces and loads are the polynomials through their values at the nodes, and A
answers polynomials by phi functions. The unknowns of Newton's iteration are the joint forces at the nodes
alone, whatever the number of DOFs. The tangent of each regime of the laws is taken into A, so that what is
interpolated is the rest of the force: zero for laws that are linear in their regimes. A step ends where a
guard of a law vanishes. The sensitivities solve the variational equation on the same nodes with the same
matrix; where the force jumps at an event they jump as well (saltation).

`march` takes the steps that it is told; `accuracy` halves them until the response does not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.native import compiled
from dynid.structure.law import BoundLaw, Guard, Slopes
from dynid.structure.nonlinear.memory import Memory, Origin
from dynid.structure.nonlinear.step import MarchState, Step
from dynid.structure.nonlinear.tables import (
    NODES,
    SCAN,
    Columns,
    LinearRest,
    Motion,
    Refine,
    Regimes,
    Steps,
    first_regimes,
    lobatto,
)

# Events of one step beyond which a motion chatters.
_MAX_EVENTS = 200
# An event is located where its time changes by less than this part of a step: round-off of the guards.
_EVENT_TOL = 1e-12
# Round-off of a guard, over the sizes of what it is made of: units in the last place. Without it a slider
# that has just stuck would slip again, and so on for ever.
_GUARD_ROUND_OFF = 4e-15
# Corrections of the end of a step to an event: each squares the error, and four reach round-off.
_MAX_LOCATIONS = 12


class _March(MarchState):
    """A march through the events of its steps."""

    def guards(self, w: Array, z: Array) -> list[tuple[int, int, Array]]:
        """Return law, following regime and values of the guards at points with rows w, hidden states z."""
        nf, out = self.rest.forces, []
        for index, law in enumerate(self.laws):
            for guard in self.guards_of(index, w[:, law.row], w[:, nf + law.row], z[:, index]):
                out.append((index, guard.following, np.broadcast_to(guard.function.value, len(w))))
        return out

    def guards_of(self, index: int, d: Any, v: Any, z: Any) -> list[Guard]:
        """Return the guards of a law, and of its open loop."""
        law, regime = self.laws[index], self.regimes[index]
        return [*law.guards(regime, d, v, z), *self.memory.closing(index, regime, d)]

    def begun(self, step: Step) -> list[tuple[float, bool]]:
        """Return the round-off of the guards within a step, and whether they rise from 0 to the first node.

        Before that node these are positive, whatever the polynomials say.
        """
        nf, out = self.rest.forces, []
        for index, law in enumerate(self.laws):
            d, v, z = step.w[:, law.row], step.w[:, nf + law.row], step.z[:, index]
            sizes = max(np.abs(d).max(), abs(law.offset)), np.abs(v).max(), np.abs(z).max()
            for guard in self.guards_of(index, d[:2], v[:2], z[:2]):
                f = guard.function
                slopes = (np.abs(s).max() for s in (f.d, f.v, f.z))
                round_off = _GUARD_ROUND_OFF * sum(s * x for s, x in zip(slopes, sizes, strict=True))
                first, second = np.broadcast_to(f.value, 2)
                moved = np.ravel(f.d)[0] * v[0] + np.ravel(f.z)[0] * step.f.rate[0, index]
                rises = first <= round_off < second and moved >= 0 and not np.any(f.v)
                out.append((float(round_off), bool(rises)))
        return out

    def first_event(self, step: Step) -> _Event | None:
        """Return the earliest event of a step, located on the polynomials through its nodes."""
        if not any(self.guards_of(index, 0.0, 0.0, 0.0) for index in range(len(self.laws))):
            return None
        c, L, _ = lobatto()
        V = np.vander(SCAN, NODES, increasing=True) @ L.T
        event: _Event | None = None
        begun = self.begun(step)
        guards = zip(self.guards(V @ step.w, V @ step.z), begun, strict=True)
        for number, ((index, following, values), (round_off, rises)) in enumerate(guards):
            negative = np.flatnonzero((values < -round_off) & ~(rises & (c[1] > SCAN)))
            if not len(negative) or (event and SCAN[negative[0]] > event.high):
                continue
            low = SCAN[negative[0] - 1] if negative[0] else 0.0
            theta = self._root(step, number, low, float(SCAN[negative[0]]))
            if event is None or theta < event.theta:
                event = _Event(theta, index, following, number, float(SCAN[negative[0]]))
        return event and self._before(step, event, begun)

    def _before(self, step: Step, event: _Event, begun: Sequence[tuple[float, bool]]) -> _Event:
        """Return the event, or that of a guard of its law which is negative there, though not at the scan."""
        low = float(SCAN[event.high > SCAN].max(initial=0.0))
        basis = event.theta ** np.arange(NODES) @ lobatto()[1].T
        guards = self.guards((basis @ step.w)[None], (basis @ step.z)[None])
        for number, (index, following, value) in enumerate(guards):
            round_off, rises = begun[number]
            if index != event.law or number == event.number or not value[0] < -round_off:
                continue
            if not (rises and event.theta < lobatto()[0][1]):
                event = _Event(
                    self._root(step, number, low, event.theta), index, following, number, event.high
                )
        return event

    def guard_at(self, step: Step, number: int, theta: float) -> float:
        """Return a guard on the polynomials of a step."""
        basis = theta ** np.arange(NODES) @ lobatto()[1].T
        return float(self.guards((basis @ step.w)[None], (basis @ step.z)[None])[number][2][0])

    def _root(self, step: Step, number: int, low: float, high: float) -> float:
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
        guards = self.guards_of(event.law, d, v, z)
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
        moved, force = total(function), law.force(before, d, v, z)
        rate = function.d * v + function.v * acceleration + function.z * f.rate[0, event.law]
        shift = -moved / rate if rate else np.zeros(q)  # of the event's time
        if hidden is not None:
            T = total(hidden) + (hidden.d * v + hidden.v * acceleration) * shift
            self.z = self.z.copy()
            self.z[event.law] = hidden.value
            self.T = self.T.copy()
            self.T[event.law] = T
        if law.law.remembers:
            slopes = total(force) + self.memory.F[event.law]
            reversal = Origin(d, float(force.value) + self.memory.f[event.law], W[law.row], slopes)
            self._remember(event, before, reversal)
        self.regimes[event.law] = event.following
        after = self.forces(w[None], self.z[None])
        if q:
            jump = f.value[0] - after.value[0]
            if np.abs(jump).max(initial=0.0) > 1e-9 * (np.abs(f.value).max() + np.abs(after.value).max()):
                self.S = self.S + np.outer(self.rest.D[:, :nf] @ jump, shift)
        self.events += 1

    def _remember(self, event: _Event, before: int, reversal: Origin) -> None:
        """Open a loop of a law at a reversal, or close the last one."""
        law = event.law
        if (event.following ^ before) & 1:
            branch = Origin(float(self.z[law]), self.memory.f[law], self.T[law], self.memory.F[law].copy())
            self.memory.reverse(law, first=not before & 4, branch=branch, reversal=reversal)
            began = reversal
        elif before & 4:
            began = self.memory.close(law)
        else:
            return
        self.z, self.T = self.z.copy(), self.T.copy()
        self.z[law], self.T[law] = began.d, began.D

    def advance(self, index: int, h: float) -> None:
        """Go over a regular step, from event to event."""
        done = 0.0
        for _ in range(_MAX_EVENTS):
            part = 1.0 - done
            tables = self.regime.tables(h * part, regular=done == 0.0)
            step = self.solve(tables, self.loads.over(index, done, part))
            event = self.first_event(step)
            if event is None:
                self.accept(step)
                if done == 0.0:
                    self.add_error(step)
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
        theta = event.theta
        for _ in range(_MAX_LOCATIONS):
            tables = self.regime.tables(h * part * theta, regular=False)
            step = self.solve(tables, self.loads.over(index, done, part * theta))
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
    state = _March(
        kept, steps, columns, x0.copy(), z0.copy(), regimes, S, T, Memory(len(laws), q), np.zeros(nf + 2),
        kept.fading(regimes),
    )  # fmt: skip
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
