"""Stepped sines: steady states at given frequencies along the branch that a sweep follows, with derivatives.

The branch is that of the curve from the first frequency of the sweep to its first fold; beyond it there is
none. The derivatives by a parameter p follow from the residuals R(u, p) = 0 of harmonic balance:
``du/dp = -(dR/du)^-1 dR/dp``. Modes and tangents by which the structure is condensed stay as they are: any
would do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.structure.labels import Label
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.model_laws import ModelLaw, model_laws
from dynid.structure.nonlinear.continuation import solve_at, trace
from dynid.structure.nonlinear.cycle import cycle_force
from dynid.structure.nonlinear.fourier import to_complex, to_real
from dynid.structure.nonlinear.harmonic_balance import (
    MAX_HARMONICS,
    Condensed,
    ForcedResponse,
    condensed,
    solved,
)

# Most points of a curve that is followed, and the largest part of the interval between two of them.
_MAX_POINTS, _LONGEST_STEP = 2000, 0.04
# Largest change of the deflection, relative to it, with which a state continues that of other parameters, or
# of a frequency nearby: states of other branches are farther away.
_NEAR = 0.3


class Sine(NamedTuple):
    """A force ``amplitude cos(omega t)`` at a DOF, whose frequency is stepped ``up`` or ``down``."""

    dof: Label
    amplitude: float
    sweep: str = "up"


class _State(NamedTuple):
    """A steady state: unknowns, hidden states of the laws, and the derivatives of the unknowns (N x p)."""

    u: Array
    hidden: tuple[tuple[float, int] | None, ...]
    by_parameter: Array


@dataclass
class Branch:
    """The states of the last evaluation, with which the next one begins."""

    values: Array = field(default_factory=lambda: np.zeros(0))
    omega: Array = field(default_factory=lambda: np.zeros(0))
    states: list[_State] = field(default_factory=list)


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
    derivatives = _Derivatives(model, values, names, structure)
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
    branch.values, branch.omega, branch.states = at, omega[order], [state for state, *_ in states]
    return Motions(structure.shapes, motion, slopes)


_Solution = tuple[_State, ComplexArray, ComplexArray]


def _continued(
    equations: ForcedResponse, derivatives: _Derivatives, omega: Array, branch: Branch, values: Array
) -> list[_Solution] | None:
    """Return the states that continue those of other parameters at all lines, or None."""
    if len(branch.states) < len(omega) or not np.allclose(branch.omega, omega, rtol=1e-3):
        return None
    out: list[_Solution] = []
    for state, line in zip(branch.states, omega.tolist(), strict=True):
        predicted = state.u + np.append(state.by_parameter @ (values - branch.values), 0.0)
        predicted[-1] = line
        if not _is_near(equations, state.u, predicted):
            return None
        solution = _solution(equations, derivatives, predicted, state.hidden)
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


def _is_near(equations: ForcedResponse, u: Array, other: Array) -> bool:
    size = float(np.abs(equations.motion(u)).sum(axis=1).max())
    return bool(np.abs(equations.motion(other) - equations.motion(u)).max() <= _NEAR * size)


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
        near = _is_near(equations, point.u, equations.padded(predicted))
        _, J = equations.evaluate(point.u)
    except NumericalError:
        return None
    # Of small motions the matrix is 1: where its determinant is negative, a fold is between.
    if not near or np.linalg.slogdet(J[:, :-1])[0] <= 0:
        return None
    by_parameter, first, slopes = derivatives.of(equations, point.u, J[:, :-1])
    equations.harmonics = size
    return _State(point.u, tuple(equations.memory.hidden), by_parameter), first, slopes


class _Derivatives:
    """Derivatives of steady states by parameters."""

    def __init__(
        self,
        model: StructuralModel,
        values: Mapping[str, float],
        names: Sequence[str],
        structure: Condensed,
    ) -> None:
        self.structure, self.names = structure, names
        linear, shapes = model.without_laws(), structure.shapes
        known = {parameter.name for parameter in linear.unknowns}
        of_rest = {name: value for name, value in values.items() if name in known}
        self.matrices = [
            {letter: shapes.T @ as_array(matrix) @ shapes for letter, matrix in slopes.items()}
            for slopes in linear.slopes(of_rest, names)
        ]
        self.laws: Sequence[ModelLaw] = model_laws(model.joints, values)

    def of(self, equations: ForcedResponse, u: Array, J: Array) -> tuple[Array, ComplexArray, ComplexArray]:
        """Return derivatives of the unknowns (N x p), first harmonics of the modes (n), and theirs (n x p).

        `J`: the derivatives of the residuals by the unknowns, at the solution that was evaluated last.
        """
        s, omega, q = self.structure, float(u[-1]), equations.motion(u)
        forces, motion = equations.forces, equations.modal_motion(u)
        Z, _ = s.stiffness(omega, len(motion) - 1)
        X = solved(s.free(Z), s.deflections.T)
        A = s.deflections @ X
        h = np.arange(len(motion))[:, None]
        moved = np.zeros((len(motion), len(s.eigenvalues), len(self.names)), dtype=complex)
        residual = np.zeros((len(motion), equations.joints, len(self.names)), dtype=complex)
        factor = {"K": 1.0 + 0 * h, "C": 1j * h * omega, "M": -((h * omega) ** 2)}
        for k, matrices in enumerate(self.matrices):
            if matrices:
                turned = np.zeros_like(motion)
                for letter, matrix in matrices.items():
                    turned += factor[letter] * (motion @ matrix.T)
                residual[:, :, k] += np.einsum("hnj,hn->hj", X, turned)
                moved[:, :, k] -= solved(s.free(Z), turned[:, :, None])[:, :, 0]
        for index, law in enumerate(self.laws):
            if not any(law.slopes):
                continue
            row, hidden = law.bound.row, equations.memory.hidden[index]
            by = to_complex(cycle_force(law.bound, q[row], omega, hidden, parameters=True).by_parameters)
            for place, slopes in enumerate(law.slopes):
                for name, slope in slopes.items():
                    if name in self.names:
                        k = self.names.index(name)
                        residual[:, :, k] += A[:, :, row] * (slope * by[:, place])[:, None]
                        moved[:, :, k] -= X[:, :, row] * (slope * by[:, place])[:, None]
        flat = to_real(residual).transpose(1, 0, 2).reshape(-1, len(self.names))
        by_parameter = -np.linalg.solve(J, flat)
        change = np.einsum("jik,jkp->ijp", forces.by_motion, by_parameter.reshape(*q.shape, -1))
        moved -= np.einsum("hnj,hjp->hnp", X, to_complex(change))
        return np.asarray(by_parameter), motion[1], np.asarray(moved[1])
