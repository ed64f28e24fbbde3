"""The likelihood of segments of a record whose initial states are each their own (multiple shooting).

Phase errors of a wrong model grow with time: the longer the prediction from one initial state, the more local
minima its misfit has. Segments are predicted from initial states of their own, which are linear and projected
out, so that fits to segments of growing length converge to the optimum of the record from poor initial
guesses. H. G. Bock, in: Modelling of Chemical Reaction Systems, Springer 1981, 102–125; L. Kaufman, BIT 15
(1975) 49–57.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, finite
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.saturated_model import SaturatedCoordinates
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.identification.records.measurement import RecordData
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.prediction import Trajectory, free_prediction, prediction
from dynid.lti.recurrence import recurrence

# The prior of the initial states of segments has this part of the information of one value of RMS size:
# states that are not observable in a segment stay those of the forced response.
_STATE_RIDGE = 1e-6
# A segment has at least this many values for each of its initial states.
_MIN_VALUES_PER_STATE = 2


@dataclass(frozen=True, eq=False)
class _Segments(RecordLikelihood):
    """A record in segments of one length, channels counting by their RMS."""

    record: TimeRecord  # the record as a whole
    length: int  # samples of a segment
    sharing: int = 1

    @cached_property
    def data(self) -> RecordData:  # type: ignore[override]
        """All values over their channel's RMS, as one channel whose noise is given."""
        record = self.record.data
        return RecordData((record.values / record.rms).reshape(-1, 1), given=np.ones(1))

    @property
    def system_model(self) -> LinearSystem:
        """The model of the record."""
        return self.record.system_model

    @property
    def nuisances(self) -> int:
        """Number of initial states of all segments."""
        return self.record.nuisances * math.ceil(len(self.record.data.values) / self.length)

    def residual(self, eta: Array) -> Array:
        """Return a residual with the RMS of those of all segments (1 x 1)."""
        model = self.record.model
        free, _ = free_prediction(model, eta)
        left = self._cut(self.record.data.values - free.forced - free.by_state @ model.initial)[..., None]
        by_start = self._by_start(free.by_state)
        projected = by_start.swapaxes(-1, -2) @ left
        return self._sized(float(np.sum(left**2) - np.sum(projected * _starts(by_start, projected))))

    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> RecordFit:  # noqa: ARG002
        """Fit the initial states of all segments at coordinates of the parameters."""
        model = self.record.model
        self.record.system_model.evaluations += 1
        free, steps = free_prediction(model, eta)
        predicted_whole = prediction(model, eta, model.initial, free, steps)
        left = self._cut(self.record.data.values - predicted_whole.outputs)[..., None]
        by_start = self._by_start(free.by_state)
        starts = _starts(by_start, by_start.swapaxes(-1, -2) @ left)[..., 0]
        slopes = self._cut(predicted_whole.by_parameter) + self._moved(eta, starts)
        columns = np.where(self._present[..., None], np.concatenate([slopes, left], axis=2), 0.0)
        projected = by_start.swapaxes(-1, -2) @ columns
        products = columns.swapaxes(1, 2) @ columns - projected.swapaxes(1, 2) @ _starts(by_start, projected)
        finite("the sensitivity of the record", products)
        size, V = np.linalg.eigh(products.sum(axis=0))
        rows = np.sqrt(np.maximum(size, 0.0))[:, None] * V.T  # as many as there are columns, same products
        residual, by_parameter = rows[:, -1:], rows[:, None, :-1]
        rms = self._sized(float(np.sum(residual**2)))[0]
        predicted = Trajectory(residual, np.zeros((len(rows), 0)))
        return RecordFit(
            eta, predicted, residual, self.data.counts, rms, np.ones(1), by_parameter=by_parameter
        )

    def slopes(self, fit: RecordFit, noise: Array) -> Array:
        """Return few rows with the same products as the derivatives by the coordinates over noise (… x p)."""
        assert fit.by_parameter is not None
        return np.asarray(fit.by_parameter[:, 0] / noise)

    def by_row(self, level: NDArray[Any]) -> NDArray[Any]:
        """Return the number of the one channel that all values count as, row by row."""
        return np.tile(level, len(self.unknowns) + 1)

    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:  # noqa: ARG002
        """Return none: segments are a step of the search, and no test of the model."""
        return []

    def on(self, data: RecordData) -> Self:
        """Return the same segments of other values."""
        return replace(self, record=self.record.on(data))

    @cached_property
    def _present(self) -> NDArray[np.bool_]:
        """Return the mask of measured rows of each segment (segments x rows)."""
        there = ~np.isnan(self.record.data.values)
        filled = np.concatenate([there, np.zeros((-len(there) % self.length, there.shape[1]), dtype=bool)])
        return filled.reshape(-1, self.length * there.shape[1])

    def _cut(self, values: Array) -> Array:
        """Return values (times x channels x …) over RMS by segments (segments x rows x …), 0 if missing."""
        samples, channels, *more = values.shape
        scaled = values / self.record.data.rms.reshape(channels, *(1 for _ in more))
        filled = np.concatenate([scaled, np.zeros((-samples % self.length, channels, *more))])
        cut = filled.reshape(-1, self.length * channels, *more)
        return cut if more else np.where(self._present, cut, 0.0)

    def _by_start(self, by_state: Array) -> Array:
        """Return the response to initial states in the units of their prior ((segments x) rows x n)."""
        root, rms = self.record.root, self.record.data.rms
        projected = ((by_state[: self.length] @ root) / rms[:, None]).reshape(-1, len(root))
        return projected if self._present.all() else np.where(self._present[..., None], projected, 0.0)

    def _moved(self, eta: Array, starts: Array) -> Array:
        """Return the derivatives of the free decays from initial states (segments x rows x p)."""
        model = self.record.model.moved(eta)
        n, p, L = model.states, model.parameters, self.length
        sampled = model.times
        transition = model.transition(eta, float(sampled[-1] - sampled[0]) / (len(sampled) - 1))
        Phi, by_parameter = transition.step[:, :n], transition.derivatives[:, :, :n]
        # From the states of the prior's root, of which every initial state is a sum.
        states, slopes = np.empty((L, n, n)), np.zeros((L, n * p, n))
        states[0] = self.record.root.T
        states[1:] = recurrence(Phi, np.zeros((L - 1, n, n)), states[0])
        forcing = states[:-1].reshape(-1, n) @ by_parameter.reshape(p * n, n).T
        slopes[1:] = recurrence(Phi, forcing.reshape(L - 1, n * p, n), slopes[0])
        C, C_slopes = model.output(eta)
        seen = states.reshape(-1, n) @ C_slopes.reshape(-1, n).T
        seen = (seen.reshape(L, n, p, -1) + (slopes @ C.T).reshape(L, n, p, -1)) / self.record.data.rms
        derivatives = starts @ seen.transpose(1, 0, 3, 2).reshape(n, -1)
        return np.asarray(derivatives.reshape(len(starts), -1, p))

    def _sized(self, square: float) -> Array:
        """Return a residual whose RMS is that of all values, of a sum of squares (1 x 1)."""
        return np.full((1, 1), math.sqrt(max(square, 0.0) / int(self.data.counts[0])))


def _starts(by_start: Array, projected: Array) -> Array:
    """Return the initial states that fit best, in the units of their prior (segments x n x …)."""
    products = by_start.swapaxes(-1, -2) @ by_start
    return np.asarray(np.linalg.solve(products + _STATE_RIDGE * np.eye(products.shape[-1]), projected))


def in_segments(likelihood: TimeLikelihood, divisor: int) -> Likelihood:
    """Return the likelihood of records in segments of this part of their length, or somewhat longer ones."""
    segments = []
    for record in likelihood.records:
        samples, channels = record.data.values.shape
        min_length = math.ceil(_MIN_VALUES_PER_STATE * record.nuisances / channels)
        length = int(min(samples, max(min_length, samples // divisor)))
        segments.append(_Segments(record, length, len(likelihood.records)))
    return Likelihood(tuple(segments))
