"""Curves of solutions of N equations in N + 1 unknowns, by pseudo-arclength continuation.

Source: E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods, SIAM (2003).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from dynid.arrays import Array
from dynid.errors import NumericalError

# Scaled step of Newton's iteration after which its error, of the order of its square, is below 1e-9.
_STEP_TOL = 1e-5
_MAX_ITERATIONS = 12
# Scaled lengths of steps: a motion changes by these parts of its size.
_FIRST_STEP, _MIN_STEP = 0.02, 1e-7
#: The largest one.
MAX_STEP = 0.1
# Cosine of the angle between tangents below which a step is taken again, half as long.
_MIN_COSINE = 0.9
# Length of a step below which its tangents may turn: a corner of the curve.
_MIN_BEND = 1e-3
# Evaluations of a step after which the next one is longer, or shorter.
_FEW_EVALUATIONS, _MANY_EVALUATIONS = 3, 6


class Equations(Protocol):
    """N equations in N + 1 unknowns, the last of which is the parameter in whose direction a curve starts."""

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the residuals (N) and their derivatives (N x N + 1)."""
        ...

    def scale(self, u: Array) -> Array:
        """Return the sizes of the unknowns (N + 1)."""
        ...

    def resized(self, u: Array) -> Array | None:
        """Return the unknowns with as many harmonics as they need at a solution; None if they have these.

        The first call after `evaluate` is about its solution.
        """
        ...

    def padded(self, v: Array) -> Array:
        """Return a vector of unknowns with as many harmonics as the equations have now."""
        ...


class Point(NamedTuple):
    """A solution, its tangent in scaled unknowns, and the evaluations that it took."""

    u: Array
    tangent: Array
    evaluations: int


def solve(
    equations: Equations, u: Array, row: Array, target: float, tangent: Array | None = None
) -> Point | None:
    """Return the solution at which ``row @ (unknowns / scale)`` has a value, or None.

    `u`: where Newton's iteration starts, without whose convergence there is none; `row` (N + 1); `tangent`:
    by which the new one is oriented; default: `row`.
    """
    scale = equations.scale(u)
    evaluations = 0
    while True:
        for _ in range(_MAX_ITERATIONS):
            residual, J = equations.evaluate(u)
            evaluations += 1
            matrix = np.concatenate([J * scale, row[None]])
            try:
                step = np.linalg.solve(matrix, np.append(residual, row @ (u / scale) - target))
            except np.linalg.LinAlgError:
                return None
            size = float(np.abs(step).max())
            if not np.isfinite(size) or size > 1e3:
                return None
            u = u - step * scale
            if size <= _STEP_TOL:
                break
        else:
            return None
        resized = equations.resized(u)
        if resized is None:
            break
        scale, row = equations.scale(resized), equations.padded(row)
        tangent = None if tangent is None else equations.padded(tangent)
        u, target = resized, float(row @ (resized / scale))
    along = row if tangent is None else tangent
    last = np.zeros(len(u))
    last[-1] = 1.0
    new = np.linalg.solve(np.concatenate([J * scale, along[None]]), last)
    return Point(u, new / np.linalg.norm(new), evaluations)


def solve_at(equations: Equations, u: Array) -> Point | None:
    """Return the solution with the last unknown as it is; None if Newton does not converge."""
    row = np.zeros(len(u))
    row[-1] = 1.0
    return solve(equations, u, row, u[-1] / equations.scale(u)[-1])


def trace(
    equations: Equations,
    first: Point,
    low: float,
    high: float,
    towards: float,
    points: int,
    longest: float,
    max_step: float = MAX_STEP,
) -> Iterator[Array]:
    """Yield the solutions along a curve (N + 1) until its last unknown leaves an interval.

    `first`: the solution at one end of the interval; `towards`: the other end; `points`: their largest
    number; `longest`: the largest change of the last unknown in a step, relative to it; `max_step`: of any.

    Raises NumericalError if a step does not converge, or the curve has more points.
    """
    point = first
    yield point.u
    tangent = point.tangent * np.sign(point.tangent[-1] * (towards - point.u[-1]))
    bend, step, count = np.zeros(len(tangent)), min(_FIRST_STEP, max_step), 1
    while True:
        if count >= points:
            raise NumericalError(
                f"the curve of steady states has not left its interval after {points} points",
                remedy="Narrow the interval, or allow more 'points'.",
            )
        before, tangent, bend = (equations.padded(vector) for vector in (point.u, tangent, bend))
        scale = equations.scale(before)
        length = min(step, longest / max(abs(tangent[-1]), _MIN_STEP))
        predicted = before + (length * tangent + length**2 / 2 * bend) * scale
        new, turned, cause = None, 0.0, None
        try:
            new = solve(equations, predicted, tangent, float(tangent @ (before / scale)) + length)
        except NumericalError as error:
            cause = error
        if new is not None:
            tangent, bend = equations.padded(tangent), equations.padded(bend)
            turned = float(tangent @ equations.padded(new.tangent))
        if new is None or (turned < _MIN_COSINE and length > _MIN_BEND):
            step = length / 2
            if step < _MIN_STEP:
                raise cause or NumericalError(
                    f"the curve of steady states cannot be followed beyond {point.u[-1]:.6g}",
                    remedy="Soften contacts and sliders, or end the interval before.",
                )
            continue
        if not low <= new.u[-1] <= high:
            end = high if new.u[-1] > high else low
            before = equations.padded(point.u)
            part = (end - before[-1]) / (new.u[-1] - before[-1])
            between = before + part * (equations.padded(new.u) - before)
            ended = solve_at(equations, np.append(between[:-1], end))
            if ended is not None:
                yield ended.u
            return
        along = equations.padded(new.tangent)
        bend = (along - tangent) / length if count > 1 else bend
        point, tangent, count = new, along / np.linalg.norm(along), count + 1
        yield point.u
        if new.evaluations <= _FEW_EVALUATIONS:
            step = min(1.5 * length, max_step)
        elif new.evaluations >= _MANY_EVALUATIONS:
            step = 0.6 * length
