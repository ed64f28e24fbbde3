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
from dynid.identification.systems import kernels
from dynid.identification.systems.free_decays import FreeDecays
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.identification.systems.prediction import (
    ALL_CHANNELS,
    Prediction,
    Trajectory,
    sensitive_runs,
)
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
    at_rest = kernels.at_rest(model, at, model.output(at.eta)[0], model.direct(at.eta).value)
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
    parts: list[tuple[Array, Array]] = []  # R of blocks of decays, and what their ranges have
    rest = np.zeros((0, 0))
    w = channels = 0

    def absorb(*rows: Array) -> Array:
        """Return triangles (w x w channels) of the columns' rows outside of the ranges and those before."""
        stacked = np.concatenate([*rows, rest] if len(rest) else rows).reshape(-1, w, channels).swapaxes(1, 2)
        none = np.zeros((*stacked.shape[:2], 0)), np.zeros(stacked.shape[:2]), np.ones(channels)
        triangles, _ = kernels.triangles(none[0], stacked, *none[1:])
        return triangles[:, :w, :w].transpose(1, 2, 0).reshape(w, -1)

    def merged() -> Array:
        """Join the parts, and return what their range leaves."""
        R, inside, left = _projected(*map(np.concatenate, zip(*parts, strict=True)))
        parts[:] = [(R, inside)]
        return left

    for samples, columns in blocks:
        _, w, channels = columns.shape
        R, inside, left = _projected(decays.columns[samples], columns.reshape(len(samples), -1))
        parts.append((R, inside))
        rest = absorb(left, merged()) if len(parts) > _MAX_PARTS else absorb(left)
    if len(parts) > 1:
        rest = absorb(merged())
    R, inside = parts[0]
    n = decays.columns.shape[1]
    factors = np.zeros((channels, n + w, n + w))
    factors[:, : len(R), :n] = R @ decays.weights
    factors[:, : len(R), n:] = inside.reshape(-1, w, channels).transpose(2, 0, 1)
    factors[:, n:, n:] = rest.reshape(w, w, channels).transpose(2, 0, 1)
    return factors


def _projected(columns: Array, right: Array) -> tuple[Array, Array, Array]:
    """Return R of columns = Q R, Q^T right, and what the range of the columns leaves of the right side."""
    Q, R = np.linalg.qr(columns)
    inside = Q.T @ right
    return R, inside, right - Q @ inside
