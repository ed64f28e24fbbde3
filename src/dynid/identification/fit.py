"""The fit of a record at given parameters: initial state, residuals, information, and a fresh prior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dynid.identification.augmented import AugmentedModel
from dynid.identification.filtering.filter import Prior
from dynid.identification.information import (
    STATE_RANK,
    Information,
    information,
    least_squares,
    thin_svd,
    triangles,
)
from dynid.identification.kernels.compiled import compiled
from dynid.identification.measurement import Data
from dynid.identification.observed import Fit, Observed
from dynid.identification.prediction import Free, Trajectory, free_prediction, prediction
from dynid.lti.floating import finite
from dynid.structure.joints import Unknown
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel

Array = NDArray[np.float64]

# The prior lets every channel be this many times larger than measured.
_WIDE = 10.0
# Prior standard deviation of the logarithms in the first pass: a factor of e squared.
_FACTOR = 2.0
# Noise below this part of the RMS is not assumed: the covariance would lose its digits.
_LEAST_NOISE = 1e-4


class Frame(NamedTuple):
    """What the fits of records share that differ in their values alone.

    `model`, the augmented one; `root` (n x n) of the wide prior covariance of the state (scaled), up to a
    factor; `reach`, how large it lets each channel be (channels).
    """

    model: AugmentedModel
    root: Array
    reach: Array


@dataclass(frozen=True, eq=False)
class Fitter(Observed):
    """Fits one record with one model; see `fitter`.

    Attributes
    ----------
    frame
        The augmented model and the prior of its states.
    data
        The record.
    sharing
        Number of records that share the parameters.
    """

    frame: Frame
    data: Data
    sharing: int = 1

    @property
    def model(self) -> AugmentedModel:
        """The augmented model."""
        return self.frame.model

    @cached_property
    def root(self) -> Array:
        """Lower root of the wide prior covariance of the state (n x n)."""
        return np.asarray(_WIDE * (self.data.rms / self.frame.reach).max() * self.frame.root)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""
        return self.model.unknowns

    @property
    def nuisances(self) -> int:
        """Number of physical states, whose initial values are unknown."""
        return self.model.states

    def fit(self, logs: Array, values: Array, noise: Array | None = None) -> Fit:
        """Fit the initial state to `values` (times x channels) at the parameters exp(logs).

        Channels count by `noise`, their standard deviations (channels); absent: by their RMS.
        """
        free, steps = free_prediction(self.model, logs)
        x0 = self._start(free, values, noise)
        predicted = prediction(self.model, logs, x0, free, steps)
        residual = values - predicted.outputs
        found, counts = self._triangles(residual, predicted.by_state, predicted.by_parameter)
        size = np.sqrt(np.einsum("cr,cr->c", found[..., -1], found[..., -1]) / counts) * self.data.rms
        trajectory = Trajectory(predicted.outputs, predicted.states)
        return Fit(logs, trajectory, residual, counts, size, self.noise_in(counts, size), found)

    def residual(self, logs: Array) -> Array:
        """Return what the fit at exp(logs) leaves of the record (times x channels), NaN where missing."""
        free, _ = free_prediction(self.model, logs)
        x0 = self._start(free, self.data.values, None)
        return np.asarray(self.data.values - free.forced - free.by_state @ x0)

    def _start(self, free: Free, values: Array, noise: Array | None) -> Array:
        """Return the initial state that fits `values` best (n), as of `fit`."""
        forced = free.forced + free.by_state @ self.model.initial
        weight = 1.0 if noise is None else (self.data.rms / noise)[:, None, None]
        rows = self._triangles(values - forced, free.by_state, free.by_state[..., :0])[0] * weight
        matrix = (rows[..., :-1] @ self.root).reshape(-1, len(self.root))
        # Rank-revealing: initial states that the record does not show stay at zero.
        shift = least_squares(matrix, rows[..., -1].ravel(), STATE_RANK)
        return np.asarray(self.model.initial + self.root @ shift)

    def slopes(self, fit: Fit, noise: Array) -> Array:
        """Return few rows with the same products as the derivatives by the logarithms over noise (… x p)."""
        n, p = self.model.states, self.model.parameters
        return self._weighted(fit, noise)[:, n : n + p]

    def by_start(self, fit: Fit, noise: Array) -> Array:
        """Return, row by row beside `slopes`, those by the first state in the units of its prior (… x n)."""
        return np.asarray(self._weighted(fit, noise)[:, : self.model.states] @ self.root)

    def on(self, data: Data) -> Self:
        """Return the fitter of other values of the same record."""
        return replace(self, data=data)

    def information(self, fit: Fit, noise: Array) -> Information:
        """Return the information on the parameters of a fit, for a noise of this deviation (channels)."""
        n, p = self.model.states, self.model.parameters
        rows = self._weighted(fit, noise)
        names = tuple(unknown.name for unknown in self.model.unknowns)
        present = ~np.isnan(fit.residual)
        signal = float(np.linalg.norm(np.where(present, fit.predicted.outputs, 0.0) / noise))
        count = int(np.count_nonzero(present))
        found = information(names, rows[:, n : n + p], rows[:, :n] @ self.root, signal, count)
        return replace(found, values=np.exp(fit.logs))

    def weighted(self, fit: Fit, noise: Array) -> Array:
        """Return the residuals over noise, row by row as the information has them."""
        return self._weighted(fit, noise)[:, -1]

    def _weighted(self, fit: Fit, noise: Array) -> Array:
        assert fit.triangles is not None
        rows = fit.triangles * (self.data.rms / noise)[:, None, None]
        return rows.reshape(-1, rows.shape[-1])

    def _triangles(
        self, residual: Array, by_state: Array, by_parameter: Array
    ) -> tuple[Array, NDArray[np.int_]]:
        """Return the triangles (channels x w x w) of derivatives and residuals, and counts of the latter."""
        line = self.model.line
        if compiled(len(line.nodes), self.model.states + len(line.G), self.model.parameters):
            from dynid.identification.kernels import steps, triangle  # loads numba

            every = (steps.plain(each) for each in (by_state, by_parameter, residual, self.data.rms))
            return triangle.triangles(*every)
        rows = np.concatenate([by_state, by_parameter, residual[..., None]], axis=2)
        rows /= self.data.rms[:, None]
        missing = np.isnan(residual)
        rows[missing] = 0.0
        return triangles(rows), np.count_nonzero(~missing, axis=0)

    def floored(self, noise: Array) -> Array:
        """Return the noise to assume: never less than a small part of each channel's RMS."""
        return np.maximum(noise, _LEAST_NOISE * self.data.rms)

    def wide_prior(self, logs: Array, spread: float = _FACTOR) -> Prior:
        """Return the prior of a first pass: any state the record allows, logarithms with this deviation."""
        return Prior(self.model.initial, logs, self._wide_root(spread))

    def unit_prior(self, fit: Fit) -> Prior:
        """Return a fresh prior around a fit that weighs as much as a single measured value.

        It is the fit's own covariance times the number of values, bounded by the wide prior: wide enough
        not to pull, narrow enough to keep the filter where its linearisation holds.
        """
        root = self._wide_root()
        rows = self._weighted(fit, self.floored(fit.noise))[:, :-1]
        _, s, Vt = thin_svd(rows @ root)
        seen = np.zeros(len(root))
        seen[: len(s)] = s**2 / np.count_nonzero(~np.isnan(fit.residual))
        return Prior(fit.predicted.states[0], fit.logs, root @ (Vt.T / np.sqrt(1 + seen)))

    def continued(self, prior: Prior, logs: Array, root: Array) -> Prior:
        """Return a prior of this record's state, with logarithms as another record left them.

        Parameters
        ----------
        prior
            State and its root.
        logs, root
            Logarithms (p) and a root of their covariance (p x any).
        """
        n, size = self.model.states, len(prior.root)
        both = np.zeros((size, size))
        both[:n, :n], both[n:, n:] = _square(prior.root[:n]), _square(root)
        return Prior(prior.state, logs, both)

    def _wide_root(self, spread: float = _FACTOR) -> Array:
        n, p = self.model.states, self.model.parameters
        root = np.zeros((n + p, n + p))
        root[:n, :n] = self.root
        root[n:, n:] = spread * np.eye(p)
        return root


def fitter(
    model: AugmentedModel,
    structure: StructuralModel,
    channels: tuple[Channel, ...],
    data: Data,
    sharing: int = 1,
) -> Fitter:
    """Return the fitter of a record; see `frame`."""
    return Fitter(frame(model, structure, channels), data, sharing)


def frame(model: AugmentedModel, structure: StructuralModel, channels: tuple[Channel, ...]) -> Frame:
    """Return what fits share, with a prior on the state from the structure's energy.

    Displacements and velocities share the covariance ``s^2 (K + M / T^2)^-1`` and ``s^2 M^-1``, equal energy
    in every mode; s is such that each channel could be ten times what was measured. T, the record's length,
    bounds rigid-body drift. The roots of both come from the modes, so that no stiffness is too large.
    """
    start = {unknown.name: unknown.start for unknown in model.unknowns}
    M, _, K = structure.dense(start)
    length = max(float(np.ptp(model.line.nodes)), 1.0)
    mobility = _inverse_root(M)
    stiffness = mobility.T @ K @ mobility
    finite("the stiffness beside the mass", stiffness)
    square, shapes = np.linalg.eigh((stiffness + stiffness.T) / 2)
    omega = np.sqrt(np.maximum(square, 0.0) + 1 / length**2)  # below 0: rounding of rigid-body modes
    mobility = mobility @ shapes
    compliance = mobility / omega
    reach = []
    for channel in channels:
        row = channel.row(structure)
        spread = np.linalg.norm(row @ (compliance if channel.order == 0 else mobility))
        # An acceleration is taken for the slowest motion it can be: the widest prior.
        reach.append(spread * (omega[0] if channel.order == 2 else 1.0))
    n = len(M)
    root = np.zeros((2 * n, 2 * n))
    root[:n, :n], root[n:, n:] = compliance, mobility
    root[model.known] = 0.0
    return Frame(model, root / model.scale[:, None], np.array(reach))


def _square(root: Array) -> Array:
    """Return the triangular root of ``root root^T``."""
    return np.asarray(np.linalg.qr(root.T).R.T)


def _inverse_root(M: Array) -> Array:
    """Return R with ``R^T M R`` the unit matrix, of a mass matrix that is equilibrated first."""
    scale = np.sqrt(np.diag(M))
    lower = np.linalg.cholesky(M / scale / scale[:, None])
    return np.asarray(np.linalg.solve(lower.T, np.eye(len(M))) / scale[:, None])
