"""Stepped sines: steady states at given frequencies along the branch that a sweep follows, with derivatives.

The branch is that of the curve from the first frequency of the sweep to its first fold; beyond it there is
none. The derivatives by a parameter p follow from the residuals R(u, p) = 0 of harmonic balance:
``du/dp = -(dR/du)^-1 dR/dp``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.structure.labels import Label
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.branch import Branch, State
from dynid.structure.nonlinear.continuation import solve_at, trace
from dynid.structure.nonlinear.fourier import to_real
from dynid.structure.nonlinear.harmonic_balance import MAX_HARMONICS, ForcedResponse, condensed, solved
from dynid.structure.nonlinear.parameter_forces import ParameterForces

# Most points of a curve that is followed, and the largest part of the interval between two of them.
_MAX_POINTS, _LONGEST_STEP = 2000, 0.04


class Sine(NamedTuple):
    """A force ``amplitude cos(omega t)`` at a DOF, whose frequency is stepped ``up`` or ``down``."""

    dof: Label
    amplitude: float
    sweep: str = "up"


class Motions(NamedTuple):
    """First harmonics of the modes over the force, and their derivatives.

    `shapes` (N x n); `motion` (L x n) and `slopes` (L x n x p) of the amplitudes of ``exp(i omega t)``, NaN
    where the branch does not exist.
    """

    shapes: Array
    motion: ComplexArray
    slopes: ComplexArray


def stepped_sine(
    model: StructuralModel,
    values: Mapping[str, float],
    names: Sequence[str],
    sine: Sine,
    omega: Array,
    branch: Branch,
) -> Motions:
    """Return the steady states at frequencies (L), rad/s, of a branch, with derivatives by parameters.

    `names`: the parameters (p); `branch`: where the search begins, and which is renewed.

    Raises NumericalError if the first state cannot be found.
    """
    structure = condensed(model, values, float(np.mean(omega)))
    load = structure.shapes.T @ model.row(sine.dof)
    equations = ForcedResponse(structure, load, sine.amplitude, MAX_HARMONICS)
    derivatives = _Derivatives(ParameterForces(model, values, names, structure))
    at = np.array([values[name] for name in names])
    order = np.argsort(omega if sine.sweep == "up" else -omega, kind="stable")
    states = _continued(equations, derivatives, omega[order], branch, at)
    if states is None:
        states = _followed(equations, derivatives, omega[order])
    n = len(structure.eigenvalues)
    motion = np.full((len(omega), n), complex(np.nan, np.nan))
    slopes = np.full((len(omega), n, len(names)), complex(np.nan, np.nan))
    for line, (_, first, by_parameter) in zip(order.tolist(), states, strict=False):
        motion[line], slopes[line] = first / sine.amplitude, by_parameter / sine.amplitude
    branch.values, branch.at, branch.states = at, omega[order], [state for state, *_ in states]
    return Motions(structure.shapes, motion, slopes)


_Solution = tuple[State, ComplexArray, ComplexArray]


def _continued(
    equations: ForcedResponse, derivatives: _Derivatives, omega: Array, branch: Branch, values: Array
) -> list[_Solution] | None:
    """Return the states that continue those of other parameters at all lines, or None."""
    predicted = branch.predicted(values, omega)
    if not predicted:
        return None
    out: list[_Solution] = []
    for state, u, line in zip(branch.states, predicted, omega.tolist(), strict=True):
        u[-1] = line
        if not equations.is_close(state.u, u):
            return None
        solution = _solution(equations, derivatives, u, state.hidden)
        if solution is None:
            return None
        out.append(solution)
    return out


def _followed(equations: ForcedResponse, derivatives: _Derivatives, omega: Array) -> list[_Solution]:
    """Return the states of the branch from the first line on, as far as it goes."""
    first = equations.first(float(omega[0]))
    start = _solution(equations, derivatives, first.u)
    assert start is not None
    if len(omega) == 1:
        return [start]
    low, high = sorted((float(omega[0]), float(omega[-1])))
    up, longest = np.sign(omega[-1] - omega[0]), max(_LONGEST_STEP * (high - low) / high, 1e-6)
    out, before = [start], first.u
    for u in trace(equations, first, low, high, float(omega[-1]), _MAX_POINTS, longest):
        step = float(u[-1] - before[-1])
        folds = step * up < 0
        while len(out) < len(omega) and (folds or (u[-1] - omega[len(out)]) * up >= -1e-12 * high):
            line = float(omega[len(out)])
            part = (line - before[-1]) / step if step and not folds else 0.0
            near, far = equations.padded(before), equations.padded(u)
            predicted = np.append((near + part * (far - near))[:-1], line)
            solution = _solution(equations, derivatives, predicted)
            if solution is None and not folds:
                solution = _solution(equations, derivatives, np.append(far[:-1], line))
            if solution is None:
                return out
            out.append(solution)
        if folds or len(out) == len(omega):
            return out
        before = u
    return out


def _solution(
    equations: ForcedResponse,
    derivatives: _Derivatives,
    predicted: Array,
    hidden: Sequence[tuple[float, int] | None] | None = None,
) -> _Solution | None:
    """Return the steady state near a prediction, which has no fold between; None where there is none."""
    equations.harmonics = equations.order(equations.motion(predicted))
    if hidden is not None:
        equations.memory.hidden = list(hidden)
    try:
        point = solve_at(equations, predicted)
        if point is None:
            return None
        size = equations.harmonics
        equations.harmonics = equations.order(equations.motion(point.u))
        near = equations.is_close(point.u, equations.padded(predicted))
        _, J = equations.evaluate(point.u)
    except NumericalError:
        return None
    # Of small motions the matrix is 1: where its determinant is negative, a fold is between.
    if not near or np.linalg.slogdet(J[:, :-1])[0] <= 0:
        return None
    by_parameter, first, slopes = derivatives.of(equations, point.u, J[:, :-1])
    equations.harmonics = size
    state = State(point.u, tuple(equations.memory.hidden), np.pad(by_parameter, ((0, 1), (0, 0))))
    return state, first, slopes


class _Derivatives:
    """Derivatives of steady states by parameters."""

    def __init__(self, parameters: ParameterForces) -> None:
        self.structure, self.parameters = parameters.structure, parameters

    def of(self, equations: ForcedResponse, u: Array, J: Array) -> tuple[Array, ComplexArray, ComplexArray]:
        """Return derivatives of the unknowns (N x p), first harmonics of the modes (n), and theirs (n x p).

        `J`: the derivatives of the residuals by the unknowns, at the solution that was evaluated last.
        """
        s, omega, motion = self.structure, float(u[-1]), equations.modal_motion(u)
        by_parameter = self.parameters.of(equations.motion(u), omega, motion, equations.memory)
        Z = s.free(s.stiffness(omega, len(motion) - 1)[0])
        moved = -solved(Z, by_parameter)
        residual = to_real(-(s.deflections @ moved)).transpose(1, 0, 2)
        slopes = np.asarray(-np.linalg.solve(J, residual.reshape(len(J), -1)))
        moved -= solved(Z, equations.law_forces(slopes))
        return slopes, motion[1], np.asarray(moved[1])
