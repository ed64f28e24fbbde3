"""Likelihood of a record of time whose joints have nonlinear laws.

Nothing is superposed: the prediction depends on first state and hidden states of the laws through the whole
motion, with exact sensitivities (`systems.nonlinear_prediction`). Given the parameters, both are solved for
by Gauss and Newton's iteration, as a linear record solves for its first state in one step. All else is that
of a linear record, about the motion at the estimate: information, projections, tests of the residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.least_squares import STATE_RANK, least_squares
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.identification.systems.nonlinear_prediction import (
    HiddenStart,
    NonlinearPrediction,
    bound_laws,
    hidden_start,
    hidden_states,
    predicted,
    steps_needed,
)
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.identification.systems.prediction import ALL_CHANNELS, Prediction, Trajectory
from dynid.identification.systems.structure_system import StructureSystem
from dynid.structure.law import BoundLaw
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.tables import Refine

# Most steps to the first state, and the change of the sum of squares, relative, below which none is needed.
_MAX_START_STEPS, _LAST_GAIN = 12, 1e-8
# Change below which the tangent at the present first state is as good as another march: what it leaves out is
# of second order in a step that moves the prediction by a hundredth of the residual.
_TANGENT_GAIN = 1e-4
# Quarterings of a step to the first state that does not improve.
_MAX_QUARTERINGS = 6
# Parameters far from the estimate may need steps so many times shorter; a search does not go to others, whose
# motion may be chaotic.
_SHORTER_STEPS = 4


# A step of the march with its sensitivities takes as long as so many multiplications, whatever its size.
_STEP_WORK = 30_000


# Distance of numbers of hidden states, from -1 to 1, from which others are tried at an estimate; and the
# logarithm of the likelihood that these must gain.
_OTHER_HIDDEN, _BETTER_START = 0.5, 1e-2


class _Warm(NamedTuple):
    """A fit from which the next one begins."""

    eta: Array
    start: Array  # first state and numbers of the hidden states (n + h)
    by_parameter: Array  # derivatives of it (n + h x p)


@dataclass(frozen=True, eq=False)
class NonlinearRecord(TimeRecord):
    """The likelihood of one record of time with a model whose joints have nonlinear laws."""

    origin_is_free: ClassVar[bool] = True
    superposes: ClassVar[bool] = False
    _kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def hidden(self) -> int:
        """Number of hidden states."""
        return len(hidden_states(self.model))

    @property
    def nuisances(self) -> int:
        """Number of first states that are unknown, hidden ones included."""
        return self.model.states + self.hidden

    @property
    def evaluation_work(self) -> int:
        """Multiplications of a prediction with its sensitivities, about."""
        return super().evaluation_work + _STEP_WORK * len(self.times) * int(self._kept.get("steps", 1))

    @cached_property
    def root(self) -> Array:
        """Lower root of the wide prior covariance of first state and numbers of hidden states."""
        n = self.model.states
        root = np.eye(self.nuisances)
        root[:n, :n] = super().root
        return root

    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> RecordFit:
        """Fit first and hidden states to `values` (times x channels) at coordinates of the parameters."""
        level = self.data.rms if noise is None else noise
        start, prediction, states_slopes = self._fitted(eta, values, level)
        residual = values - prediction.outputs
        triangles, counts = self.triangles(residual, prediction.by_state, prediction.by_parameter)
        self._last.clear()
        self._last[eta.tobytes() + start.tobytes()] = prediction
        self._kept["slopes"] = eta.tobytes(), states_slopes
        size = np.sqrt(np.einsum("cr,cr->c", triangles[..., -1], triangles[..., -1]) / counts) * self.data.rms
        trajectory = Trajectory(prediction.outputs, prediction.states, start)
        return RecordFit(
            eta, trajectory, residual, counts, size, self.noise_in(counts, size), triangles, measured=values
        )

    def prediction_from(
        self,
        eta: Array,
        start: Array,
        model: ParametricModel,
        channels: slice = ALL_CHANNELS,
        *,
        by_state: bool = True,  # noqa: ARG002 - they come with the others
    ) -> Prediction:
        """Return the prediction of channels at coordinates `eta` from a start in the units of a model."""
        n = model.states
        scaled = start[:n] * (model.scale / self.model.scale)
        return self._prediction(eta, np.concatenate([scaled, start[n:]]))[0].of(channels)

    def residual(self, eta: Array) -> Array:
        """Return the residual of the fit at coordinates `eta` (times x channels), NaN where missing."""
        return self.fit(eta, self.data.values).residual

    def residual_rms_at(self, eta: Array) -> Array:
        """Return the RMS of the residuals, whitened, at these coordinates (channels)."""
        return self.fit(eta, self.data.values).size

    def state_slopes(self, fit: RecordFit) -> Array:
        """Return the derivatives of the states (times x n, scaled) by first states and coordinates."""
        key, slopes = self._kept.get("slopes", (b"", None))
        return slopes if key == fit.eta.tobytes() else self._prediction(fit.eta, fit.predicted.start)[1]

    def joint_motion(self, fit: RecordFit) -> tuple[Array, Array, list[tuple[str, BoundLaw]]]:
        """Return deflections (times x joints with laws), first hidden states (h), and laws with joints."""
        z0 = self._hidden_start(fit).z0
        n, eta, start = self.model.states, fit.eta, fit.predicted.start
        motion = predicted(self.model, eta, start[:n], z0, self._kept.get("steps", 1), sensitive=False)
        return motion.deflections, z0, self.laws_at(eta)

    def laws_at(self, eta: Array) -> list[tuple[str, BoundLaw]]:
        """Return the laws with their joints' names at coordinates of the parameters."""
        names = [joint.name for joint in self.structure.joints for _ in joint.laws]
        return list(zip(names, bound_laws(self.model, eta), strict=True))

    @property
    def structure(self) -> StructuralModel:
        """The structure whose joints have laws."""
        assert isinstance(self.system_model, StructureSystem)
        return self.system_model.model

    def joint_forces(self, fit: RecordFit) -> tuple[NonlinearPrediction, Array]:
        """Return the motion with its joint forces, and their slopes (times x joints x nuisances + p)."""
        n, p, hidden = self.model.states, self.model.parameters, self._hidden_start(fit)
        start, steps = fit.predicted.start, self._kept.get("steps", 1)
        motion = predicted(self.model, fit.eta, start[:n], hidden.z0, steps)
        slopes = motion.force_slopes
        parts = _joined(hidden, slopes[..., :p], slopes[..., p : p + n], slopes[..., p + n :])
        return motion, np.concatenate(parts[::-1], axis=2)

    def _hidden_start(self, fit: RecordFit) -> HiddenStart:
        n, start = self.model.states, fit.predicted.start
        return hidden_start(self.model, fit.eta, start[:n], start[n:])

    def covering(self, eta: Array, *, narrowed: bool) -> Self:
        """Return the likelihood with steps that are short enough at coordinates `eta`; itself if they are.

        Nor does it stay where hidden states from another part of their range explain the record better.
        """
        covering, warm = super().covering(eta, narrowed=narrowed), self._kept.get("warm")
        if warm is None or covering is not self:
            return covering
        needed = self._steps_needed(eta, warm.start)
        if needed > self._kept["steps"]:
            finer = replace(self)
            finer._kept["steps"] = needed
            return finer
        return self._from_other_hidden_states(eta, warm)

    def _from_other_hidden_states(self, eta: Array, warm: _Warm) -> Self:
        """Return the likelihood whose fits begin with the likeliest hidden states at these coordinates."""
        best, least = self, self._misfit_at(eta) - _BETTER_START
        for place in range(self.model.states, self.nuisances):
            for number in (-1.0, 0.0, 1.0):
                if abs(warm.start[place] - number) < _OTHER_HIDDEN:
                    continue
                start, other = warm.start.copy(), replace(self)
                start[place] = number
                other._kept.update(steps=self._kept["steps"], warm=_Warm(eta, start, 0 * warm.by_parameter))
                try:
                    misfit = other._misfit_at(eta)
                except DynidError:
                    continue
                if misfit < least:
                    best, least = other, misfit
        return best

    def _misfit_at(self, eta: Array) -> float:
        return self.misfit(self.data.counts, self.residual_rms_at(eta))

    def _steps_needed(self, eta: Array, start: Array) -> int:
        """Return how many steps each interval needs from a start."""
        x0, numbers = np.split(start, [self.model.states])
        return steps_needed(self.model, eta, x0, hidden_start(self.model, eta, x0, numbers).z0)

    def _fitted(self, eta: Array, values: Array, level: Array) -> tuple[Array, Prediction, Array]:
        """Return first and hidden states of least squares, and the prediction from them."""
        current = self._begun(eta, values, level)
        for _ in range(_MAX_START_STEPS):
            squares, start, prediction, slopes, rows = current
            shift, left, free = self._start_step(start, rows)
            gain = squares - left
            if gain <= _LAST_GAIN * squares:
                break
            if gain <= _TANGENT_GAIN * squares:
                prediction = prediction._replace(
                    outputs=prediction.outputs + prediction.by_state @ shift,
                    states=prediction.states + slopes[..., : self.nuisances] @ shift,
                )
                current = left, start + shift, prediction, slopes, rows
                break
            better = None
            for _ in range(_MAX_QUARTERINGS):
                try:
                    trial = self._evaluated(eta, start + shift, values, level)
                except DynidError:
                    trial = None
                if trial is not None and trial[0] < squares:
                    better = trial
                    break
                shift = shift / 4
                if trial is not None and trial[0] <= (1 + _LAST_GAIN) * squares:
                    break  # round-off is all that is left
            if better is None:
                break
            current = better
        _, start, prediction, slopes, rows = current
        by_start = np.where(free, rows[:, : self.nuisances], 0.0) @ self.root
        follow = [least_squares(by_start, column, STATE_RANK) for column in rows[:, self.nuisances : -1].T]
        moved = -self.root @ np.array(follow).reshape(-1, self.nuisances).T
        self._kept["warm"] = _Warm(eta, start, moved)
        # A hidden state at the end of its range is no free direction there.
        prediction = prediction._replace(by_state=np.where(free, prediction.by_state, 0.0))
        return start, prediction, slopes

    def _begun(
        self, eta: Array, values: Array, level: Array
    ) -> tuple[float, Array, Prediction, Array, Array]:
        """Return what `_evaluated` does at the first states that can be followed, from the likeliest on."""
        warm = self._kept.get("warm")
        start = np.concatenate([self.model.initial, np.zeros(self.hidden)])
        candidates = [start]
        if warm is not None:  # where the first states follow the parameters
            follows = warm.start + warm.by_parameter @ np.clip(eta - warm.eta, -1.0, 1.0)
            candidates = [follows, warm.start, start]
        failure: DynidError | None = None
        for candidate in candidates:
            try:
                return self._evaluated(eta, self._limited(candidate), values, level)
            except DynidError as error:
                failure = failure or error
        assert failure is not None
        raise failure

    def _start_step(self, start: Array, rows: Array) -> tuple[Array, float, Array]:
        """Return the step to the first states of least squares, what it leaves, and which of them are free.

        Hidden states stay within their ranges; those that are not free end where these do.
        """
        by_start, right = rows[:, : self.nuisances] @ self.root, rows[:, -1]
        n, shift, free = self.model.states, np.zeros(self.nuisances), np.ones(self.nuisances, dtype=bool)
        for _ in range(self.hidden + 1):
            number = least_squares(np.where(free, by_start, 0.0), right - by_start @ shift, STATE_RANK)
            step = shift + self.root @ number
            beyond = free & (np.arange(len(step)) >= n) & (np.abs(start + step) > 1)
            if not beyond.any():
                break
            shift[beyond] = np.sign(start + step)[beyond] - start[beyond]  # the root is 1 there
            free &= ~beyond
        return step, float(np.sum((right - by_start @ np.linalg.solve(self.root, step)) ** 2)), free

    def _limited(self, start: Array) -> Array:
        """Return first states with the numbers of hidden ones within their ranges."""
        n = self.model.states
        return np.concatenate([start[:n], np.clip(start[n:], -1.0, 1.0)])

    def _evaluated(
        self, eta: Array, start: Array, values: Array, level: Array
    ) -> tuple[float, Array, Prediction, Array, Array]:
        """Return the sum of squares, first states, prediction, slopes of the states, and rows over noise."""
        prediction, slopes = self._prediction(eta, start)
        triangles, _ = self.triangles(
            values - prediction.outputs, prediction.by_state, prediction.by_parameter
        )
        rows = triangles * (self.data.rms / level)[:, None, None]
        rows = rows.reshape(-1, rows.shape[-1])
        return float(np.sum(rows[:, -1] ** 2)), start, prediction, slopes, rows

    def _prediction(self, eta: Array, start: Array) -> tuple[Prediction, Array]:
        """Return the prediction from first states, and the slopes of the states by these and parameters."""
        n, p = self.model.states, self.model.parameters
        self.system_model.evaluations += 1
        hidden = hidden_start(self.model, eta, start[:n], start[n:])
        if "steps" not in self._kept:
            self._kept["steps"] = self._steps_needed(eta, start)
        steps = self._kept["steps"]
        while True:
            try:
                motion = predicted(self.model, eta, start[:n], hidden.z0, steps)
                break
            except Refine:
                if steps >= _SHORTER_STEPS * self._kept["steps"]:
                    raise
                steps *= 2
        by_parameter, by_state = _joined(hidden, motion.by_parameter, motion.by_state, motion.by_hidden)
        slopes = motion.state_slopes
        parts = _joined(hidden, slopes[..., :p], slopes[..., p : p + n], slopes[..., p + n :])
        return Prediction(motion.outputs, motion.states, by_parameter, by_state), np.concatenate(
            parts[::-1], axis=2
        )


def _joined(
    hidden: HiddenStart, by_parameter: Array, by_state: Array, by_hidden: Array
) -> tuple[Array, Array]:
    """Return slopes by the parameters, and by first states and numbers of hidden ones."""
    by_parameter = by_parameter + by_hidden @ hidden.by_parameter
    by_state = by_state + by_hidden @ hidden.by_state
    return by_parameter, np.concatenate([by_state, by_hidden * hidden.by_number], axis=2)


def nonlinear(likelihood: Any) -> bool:
    """Return True if a record of a likelihood has joints with nonlinear laws."""
    return any(isinstance(record, NonlinearRecord) for record in likelihood.records)


def growing(likelihood: TimeLikelihood, parts: Sequence[int]) -> list[TimeLikelihood]:
    """Return the likelihoods of the first parts (one in so many) of all records."""
    # Shorter records have fewer local optima: a wrong stiffness has shifted the phase less.
    out = []
    for divisor in parts:
        records = [
            record.first_part(divisor) if isinstance(record, NonlinearRecord) else record
            for record in likelihood.records
        ]
        out.append(replace(likelihood, records=tuple(records), noiseless=None))
    return out
