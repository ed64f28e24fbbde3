"""Natural frequencies and damping ratios of modes at given amplitudes, with derivatives by parameters.

The amplitude is that of the first harmonic of a place's motion. The derivatives follow from those of motions
along a mode (`dynid.structure.nonlinear.backbone`) with this amplitude held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.defaults import BACKBONE_HARMONICS
from dynid.errors import NumericalError, UsageError
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.backbone import BackboneCurve
from dynid.structure.nonlinear.branch import Branch, State
from dynid.structure.nonlinear.continuation import solve_at
from dynid.structure.nonlinear.harmonic_balance import MAX_HARMONICS, condensed
from dynid.structure.nonlinear.parameter_forces import ParameterForces

# Longest and shortest growth of the amplitude in a step, relative.
_LONGEST_STEP, _SHORTEST_STEP = 0.3, 0.01
# Amplitudes are followed from the smallest one, or where need be from this part of it, again and again.
_SMALLER, _MAX_SMALLER = 0.25, 20
# Relative error of an amplitude below which the rest is to first order, and most steps until it is reached.
_AMPLITUDE_TOL, _MAX_STEPS = 1e-6, 20
_PLACE = ("measurement.modes.values", "measurement.modes")
# Motion of a mode at the place, relative to its largest, below which it is a node.
_NODE = 1e-9


class Place(NamedTuple):
    """Motion whose amplitude is given: a `row` (N) of displacements, and its derivative of an `order`."""

    row: Array
    order: int = 0


@dataclass
class Backbones:
    """The states of the last evaluation, of each mode, with which the next begins; harmonics until now."""

    branches: dict[int, Branch] = field(default_factory=dict)
    harmonics: int = 0


class BackbonePoints(NamedTuple):
    """Natural frequencies (r), rad/s, damping ratios (r), and their derivatives by parameters (r x p)."""

    omega: Array
    damping: Array
    omega_slopes: Array
    damping_slopes: Array


def backbone_points(
    model: StructuralModel,
    values: Mapping[str, float],
    names: Sequence[str],
    place: Place,
    amplitudes: Array,
    modes: Array,
    near: float,
    backbones: Backbones,
) -> BackbonePoints:
    """Return natural frequencies and damping ratios at amplitudes (r) of motions along modes (r, from 0).

    `names`: the parameters (p); modes are numbered by the frequencies of small motions; `near`: a frequency
    of the motions, rad/s; `backbones`: where the search begins, which is renewed.

    Raises NumericalError if a backbone cannot be followed to an amplitude, or too many motions were solved,
    UsageError if there is no such mode, or if it does not move the place.
    """
    if backbones.harmonics > BACKBONE_HARMONICS.value * len(modes):
        raise NumericalError(
            f"the search for backbones has solved motions of {backbones.harmonics:,} harmonics in all",
            remedy="Start nearer to the true values, and check units, modes and amplitudes of the points.",
            names=_PLACE,
        )
    structure = condensed(model, values, near)
    parameters = ParameterForces(model, values, names, structure)
    at, row = np.array([values[name] for name in names]), place.row @ structure.shapes
    points = BackbonePoints(*np.zeros((2, len(modes))), *np.zeros((2, len(modes), len(names))))
    for mode in np.unique(modes).tolist():
        if not 0 <= mode < len(row) or structure.eigenvalues[mode] <= 0:
            raise UsageError(f"the structure has no mode {mode + 1} that vibrates", names=_PLACE)
        if abs(row[mode]) <= _NODE * np.abs(row).max(initial=0.0):
            raise UsageError(
                f"mode {mode + 1} does not move the place at which its amplitude is measured",
                remedy="Name another DOF as that of the amplitudes.",
                names=("measurement.modes.amplitude_of", *_PLACE),
            )
        curve = BackboneCurve(structure, mode, MAX_HARMONICS)
        along = _Along(curve, parameters, row, place.order, backbones)
        of_mode = np.flatnonzero(modes == mode)
        order = of_mode[np.argsort(amplitudes[of_mode], kind="stable")]
        branch = backbones.branches.setdefault(mode, Branch())
        states = along.continued(branch, at, amplitudes[order]) or along.followed(amplitudes[order])
        branch.values, branch.at, branch.states = at, amplitudes[order], states
        for k, state in zip(order.tolist(), states, strict=True):
            (omega, growth), slopes = state.u[-3:-1], state.by_parameter[-3:-1]
            points.omega[k], points.omega_slopes[k] = omega, slopes[0]
            points.damping[k] = growth / (2 * omega)
            points.damping_slopes[k] = (slopes[1] - 2 * points.damping[k] * slopes[0]) / (2 * omega)
    return points


class _Solution(NamedTuple):
    """A motion with a given amplitude, and the derivatives of its unknowns by it (N)."""

    state: State
    by_amplitude: Array


class _Along:
    """Motions along a mode with given amplitudes of a place, whose modal displacements are `row` (n)."""

    def __init__(
        self, curve: BackboneCurve, parameters: ParameterForces, row: Array, order: int, backbones: Backbones
    ) -> None:
        self.curve, self.parameters, self.row, self.order = curve, parameters, row, order
        self.backbones = backbones

    def continued(self, branch: Branch, values: Array, amplitudes: Array) -> list[State]:
        """Return the states that continue those of other values; none where one fails."""
        out: list[State] = []
        predicted = branch.predicted(values, amplitudes)
        for state, u, amplitude in zip(branch.states, predicted, amplitudes.tolist(), strict=False):
            self.curve.memory.hidden = list(state.hidden)
            close = u[-1] > 0 and self.curve.is_close(state.u, u)
            solution = self._at(amplitude, u) if close else None
            if solution is None:
                return []
            out.append(solution.state)
        return out

    def followed(self, amplitudes: Array) -> list[State]:
        """Return the states at growing amplitudes, from small ones on.

        Raises NumericalError if they cannot be followed.
        """
        size, solution = self._start(float(amplitudes[0]))
        out, step = list[State](), _LONGEST_STEP
        for amplitude in amplitudes.tolist():
            while size < amplitude:
                grown = min(amplitude, size * (1 + step))
                predicted = solution.state.u + solution.by_amplitude * (grown - size)
                self.curve.memory.hidden = list(solution.state.hidden)
                found = self._at(grown, predicted)
                if found is not None:
                    size, solution, step = grown, found, min(2 * step, _LONGEST_STEP)
                    continue
                step = min(step, amplitude / size - 1) / 2
                if step < _SHORTEST_STEP:
                    raise NumericalError(
                        f"the backbone of mode {self.curve.mode + 1} cannot be followed beyond the amplitude "
                        f"{size:.4g}",
                        remedy="Start nearer to the true values, name the 'mode' of each point, or leave out "
                        "larger amplitudes.",
                    )
            out.append(solution.state)
        return out

    def _start(self, amplitude: float) -> tuple[float, _Solution]:
        """Return a motion of at most an amplitude, and its amplitude."""
        s, mode = self.curve.structure, self.curve.mode
        of_mode = 1 / (abs(self.row[mode]) * s.eigenvalues[mode] ** (self.order / 2))
        for part in amplitude * _SMALLER ** np.arange(_MAX_SMALLER):
            self.curve.memory.hidden = [None] * len(s.laws)
            solution = self._at(part, self.curve.linear(part * of_mode))
            if solution is not None:
                return float(part), solution
        raise NumericalError(
            f"the backbone of mode {mode + 1} cannot be followed from small amplitudes",
            remedy="Start nearer to the true values, or soften contacts and sliders.",
        )

    def _at(self, amplitude: float, u: Array) -> _Solution | None:
        """Return the motion with an amplitude near a prediction; None where there is none."""
        curve, predicted = self.curve, u
        try:
            for _ in range(_MAX_STEPS):
                solution, size = self._solved(amplitude, u)
                if abs(size / amplitude - 1) <= _AMPLITUDE_TOL:
                    curve.harmonics = curve.order(curve.motion(solution.state.u))
                    close = curve.is_close(solution.state.u, curve.padded(predicted))
                    return solution if close else None
                u = solution.state.u
        except (NumericalError, np.linalg.LinAlgError):
            pass
        return None

    def _solved(self, amplitude: float, u: Array) -> tuple[_Solution, float]:
        """Return the motion with an amplitude to first order, and the amplitude that it is from.

        Raises NumericalError if there is none.
        """
        curve = self.curve
        curve.harmonics = curve.order(curve.motion(u))
        point = solve_at(curve, u)
        self.backbones.harmonics += curve.harmonics
        if point is None:
            raise NumericalError("Newton's iteration does not converge")
        u = point.u
        curve.harmonics = curve.order(curve.motion(u))
        _, J = curve.evaluate(u)
        modal, omega = curve.modal_motion(u), float(u[-3])
        forces = self.parameters.of(curve.motion(u), omega, modal, curve.memory, float(u[-2]))
        slopes, moved = curve.derivatives(J, forces)
        first = modal[1] @ self.row
        size = float(abs(first) * omega**self.order)
        of_size = size * ((self.row @ moved[1] / first).real + self.order * slopes[-2] / omega)
        slopes = np.vstack([slopes, np.eye(slopes.shape[1])[-1]])
        by_amplitude = slopes[:, -1] / of_size[-1]
        by_parameter = slopes[:, :-1] - np.outer(by_amplitude, of_size[:-1])
        step = np.clip(amplitude - size, -0.5 * size, size)
        state = State(u + step * by_amplitude, tuple(curve.memory.hidden), by_parameter)
        return _Solution(state, by_amplitude), size
