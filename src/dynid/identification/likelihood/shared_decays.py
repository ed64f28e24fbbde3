"""Fits of records whose channels share their free decays, in blocks of samples.

The derivatives of a channel by the first state are D W, with the decays D (times x n) of all. Blocks of D are
factorised; what their range leaves of the derivatives by the coordinates and of residuals is reflected into a
triangle of each channel. The triangles R of the blocks, with what these ranges have, are factorised in turn,
as if all samples stood in one matrix (J. Demmel et al., SIAM J. Sci. Comput. 34 (2012) A206–A239).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.identification.least_squares import triangular_factors
from dynid.identification.systems import kernels
from dynid.identification.systems.free_decays import FreeDecays
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.identification.systems.prediction import (
    ALL_CHANNELS,
    Prediction,
    Trajectory,
    sensitive_runs,
)
from dynid.native import compiled
from dynid.progress import report_progress

# Most blocks whose decays are factorised before they are merged.
_MAX_PARTS = 8


class SensitiveBlock(NamedTuple):
    """Prediction of some samples (k), whose numbers are `samples`, with its derivatives by the coordinates.

    `outputs` (k x channels), `states` (k x n, scaled), `by_parameter` (k x p x channels).
    """

    samples: NDArray[np.int64]
    outputs: Array
    states: Array
    by_parameter: Array


def sensitive_blocks(
    model: ParametricModel,
    eta: Array,
    start: Array,
    channels: slice = ALL_CHANNELS,
    at: kernels.Linear | None = None,
) -> Iterator[SensitiveBlock]:
    """Yield the prediction of channels from a first state (n, scaled), block by block.

    `at`: the steps at these coordinates, if they are ready.
    """
    # Large matrices multiply faster in NumPy, run by run.
    steps = kernels.transitions(at or kernels.steps_at(model, eta), len(start))
    C, C_slopes = model.output(eta)
    C, C_slopes = C[channels], C_slopes[:, channels]
    for number, (samples, states, read) in enumerate(sensitive_runs(model, eta, start, steps, C)):
        report_progress(f"sensitivities, block {number + 1}")
        by_parameter, direct = read, model.direct(eta, channels, samples)
        if C_slopes.any():
            by_parameter += (states @ C_slopes.reshape(-1, len(start)).T).reshape(read.shape)
        if direct.slopes is not None:
            by_parameter += direct.slopes.swapaxes(0, 1)
        yield SensitiveBlock(samples, states @ C.T + direct.value, states, by_parameter)


def sensitive(model: ParametricModel, eta: Array, start: Array, channels: slice = ALL_CHANNELS) -> Prediction:
    """Return the prediction of channels from a first state (n, scaled), without derivatives by it."""
    samples, count = len(model.times), len(range(len(model.output(eta)[0]))[channels])
    by_parameter = np.empty((samples, model.parameters, count))
    outputs, states = np.empty((samples, count)), np.empty((samples, len(start)))
    for rows, *parts in sensitive_blocks(model, eta, start, channels):
        outputs[rows], states[rows], by_parameter[rows] = parts
    return Prediction(outputs, states, by_parameter.swapaxes(1, 2), np.zeros((samples, count, 0)))


def first_state_rows(
    model: ParametricModel, at: kernels.Linear, decays: FreeDecays, values: Array
) -> tuple[Array, Array]:
    """Return what `values` have beside the prediction from the given first state, and its factors.

    The latter (channels x n x n + 1) are the derivatives by the first state, and those values, in the range
    of the decays.
    """
    Q, R = decays.factors
    at_rest = kernels.outputs_from(model, at, model.output(at.eta)[0], model.direct(at.eta).value)
    left = values - at_rest - decays.columns @ (decays.weights @ model.initial).T
    return left, np.concatenate([R @ decays.weights, (Q.T @ left).T[..., None]], axis=2)


def fit_from(
    model: ParametricModel, at: kernels.Linear, decays: FreeDecays, start: Array, values: Array
) -> tuple[Trajectory, Array, Array]:
    """Return the prediction from a first state, residuals, and factors of derivatives and residuals.

    The factors are as of `shared_triangles`.
    """
    outputs, states = np.empty(values.shape), np.empty((len(values), len(start)))
    residual = np.empty(values.shape)

    def columns() -> Iterator[tuple[NDArray[np.int64], Array]]:
        for samples, *parts in sensitive_blocks(model, at.eta, start, at=at):
            outputs[samples], states[samples], by_parameter = parts
            residual[samples] = values[samples] - outputs[samples]
            yield samples, np.concatenate([by_parameter, residual[samples, None]], axis=1)

    factors = shared_triangles(decays, columns())
    return Trajectory(outputs, states, start), residual, factors


def shared_triangles(decays: FreeDecays, blocks: Iterable[tuple[NDArray[np.int64], Array]]) -> Array:
    """Return factors (channels x n + w x n + w) of the derivatives by the first state and further columns.

    They are block triangular, with the products of these columns. `blocks`: samples (k), and the columns of
    all channels at these (k x w x channels).
    """
    shared, n, w, channels = SharedTriangles(), decays.columns.shape[1], 0, 0
    for samples, columns in blocks:
        Q, R = np.linalg.qr(decays.columns[samples])
        shared.absorb((Q, R), columns)
        _, w, channels = columns.shape
    shared.triangular()
    R, inside, _, outside = shared.ended((w, channels))
    factors = np.zeros((channels, n + w, n + w))
    factors[:, : len(R), :n] = R @ decays.weights
    factors[:, : len(R), n:] = inside.transpose(2, 0, 1)
    factors[:, n:, n:] = outside.transpose(2, 0, 1)
    return factors


class SharedTriangles:
    """Factors of columns of channels beside columns that all share, of blocks of samples in turn."""

    def __init__(self) -> None:
        # R of blocks of the shared columns, and what their ranges have of others.
        self._parts: list[tuple[Array, Array]] = []
        # What is outside of the ranges: of the first block as it is (k x w x channels), of all in triangles.
        self._first: Array | None = None
        self._triangles = _Triangles()

    def absorb(self, shared: tuple[Array, Array], columns: Array, beside: Array | None = None) -> None:
        """Add the next samples (k): factors Q, R of shared columns, and columns (k x w x channels).

        `beside`: columns in the range of the shared ones (k x any).
        """
        (Q, R), flat = shared, columns.reshape(len(columns), -1)
        inside = Q.T @ flat
        left = Q @ inside
        np.subtract(flat, left, out=left)
        if beside is not None:
            inside = np.concatenate([inside, Q.T @ beside], axis=1)
        self._parts.append((R, inside))
        if self._first is None and len(self._parts) == 1:
            self._first = left.reshape(columns.shape)
            return
        self._begin_triangles()
        self._triangles.add(left.reshape(columns.shape))
        if len(self._parts) > _MAX_PARTS:
            self._merge(columns.shape)

    def ended(self, shape: tuple[int, int]) -> tuple[Array, Array, Array, Array]:
        """Return R of the shared columns, and what their range has of columns (r x w x channels) and beside.

        `shape`: w and channels. The last are what is outside of it (any x w x channels): of several blocks
        triangles.
        """
        if len(self._parts) > 1:
            self._merge((0, *shape))
        (R, inside), width = self._parts[0], shape[0] * shape[1]
        outside = self._triangles.rows if self._first is None else self._first
        return R, inside[:, :width].reshape(-1, *shape), inside[:, width:], outside

    def triangular(self) -> None:
        """Let what is outside be triangles."""
        self._begin_triangles()

    def _begin_triangles(self) -> None:
        if self._first is not None:
            self._triangles.add(self._first)
            self._first = None

    def _merge(self, shape: tuple[int, ...]) -> None:
        """Join the parts, and add what their range leaves."""
        Q, R = np.linalg.qr(np.concatenate([R for R, _ in self._parts]))
        right = np.concatenate([inside for _, inside in self._parts])
        inside = Q.T @ right
        self._parts, width = [(R, inside)], shape[1] * shape[2]
        left = right[:, :width] - Q @ inside[:, :width]
        self._triangles.add(left.reshape(-1, *shape[1:]))


class _Triangles:
    """Triangles of rows of all channels (rows x w x channels)."""

    def __init__(self) -> None:
        self._compiled = kernels.Triangles() if compiled() else None
        self._rows = np.zeros((0, 0, 0))

    def add(self, rows: Array) -> None:
        """Reflect rows into the triangles."""
        columns = rows.swapaxes(1, 2)
        if self._compiled is not None:
            none = np.zeros(columns.shape[:2])
            self._compiled.absorb(none[..., None][..., :0], columns, none)
            return
        before = [self._rows.swapaxes(1, 2)] if len(self._rows) else []
        self._rows = triangular_factors(np.concatenate([*before, columns])).transpose(1, 2, 0)

    @property
    def rows(self) -> Array:
        """The triangles (w x w x channels)."""
        if self._compiled is None:
            return self._rows
        channels = len(self._compiled.counts)
        return self._compiled.over(np.ones(channels))[:, :-1, :-1].transpose(1, 2, 0)
