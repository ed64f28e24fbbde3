"""Noise-free prediction of the record and its exact sensitivities."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.identification.systems.parametric_model import ParametricModel, Transition
from dynid.identification.systems.readout import Readout
from dynid.lti.recurrence import free_response, powers_of, recurrence
from dynid.native import compiled
from dynid.progress import report_progress

if TYPE_CHECKING:
    from dynid.identification.systems.kernels import Linear

Steps: TypeAlias = "list[Transition] | Linear"
"""The steps of all lengths at some parameters, as NumPy or as kernels have them."""

ALL_CHANNELS = slice(None)
# Runs are cut at so many steps: work arrays do not grow with the record.
_LONGEST_RUN = 4096
# Most numbers of states and their sensitivities of a run: 2 MB.
_MAX_RUN_NUMBERS = 250_000


class Free(NamedTuple):
    """Prediction as a function of the initial state: ``forced + by_state x0``.

    `forced` (times x channels), `by_state` (times x channels x n).
    """

    forced: Array
    by_state: Array
    readout: Readout  # the rows that both are read out from


class Trajectory(NamedTuple):
    """A noise-free prediction: `outputs` (times x channels), `states` (times x n, scaled).

    `start` (n): the state at the first time of the model's timeline, which delayed channels put before the
    first sample.
    """

    outputs: Array
    states: Array
    start: Array = np.empty(0)


class Prediction(NamedTuple):
    """Prediction at given parameters and initial state, with sensitivities.

    `outputs` (times x channels), `states` (times x n, scaled), `by_parameter` (times x channels x p) with
    respect to the coordinates of the parameters, `by_state` (times x channels x n).
    """

    outputs: Array
    states: Array
    by_parameter: Array
    by_state: Array

    def of(self, channels: slice) -> Prediction:
        """Return the prediction of some channels."""
        parts = self.by_parameter[:, channels], self.by_state[:, channels]
        return Prediction(self.outputs[:, channels], self.states, *parts)


class PredictionBlock(NamedTuple):
    """Prediction of some `samples` (k) with its sensitivities.

    `outputs` (k x channels), `states` (k x n, scaled), `by_parameter` (k x channels x p), `by_state` (k x
    channels x n).
    """

    samples: slice
    outputs: Array
    states: Array
    by_parameter: Array
    by_state: Array


def free_prediction(model: ParametricModel, eta: Array, channels: slice = ALL_CHANNELS) -> tuple[Free, Steps]:
    """Return the prediction of channels for every initial state, and the steps that it uses.

    `eta`: coordinates of the parameters (p).
    """
    model = model.moved(eta)
    line, n, readout = model.line, model.states, Readout.of(model, eta, channels)
    if model.system.delayed:
        from dynid.identification.systems.delayed_prediction import delayed_free

        return Free(*delayed_free(model, eta, channels), readout), []
    if kernels_used(model):
        from dynid.identification.systems import kernels

        at = kernels.steps_at(model, eta)
        outputs, by_state = kernels.free(model, at, readout.C, readout.direct.value)
        return Free(readout.gathered(outputs), readout.gathered(by_state), readout), at
    transitions = [model.transition(eta, h) for h in line.lengths]
    forcing = _forcing(model, [transition.step[:, n:] for transition in transitions])
    forced = np.zeros((len(line.nodes), n))
    C, state = readout.C, np.eye(n)
    sample_of = line.sample_of()
    # Of the response to the state only that of the channels is kept: all of it would be n times as large.
    by_state = np.empty((len(line.wanted), len(C), n))
    by_state[sample_of[:1]] = C
    for first, last, k in runs(line.which):
        Phi = transitions[k].step[:, :n]
        after = slice(first + 1, last + 1)
        forced[after] = recurrence(Phi, forcing[first:last, None], forced[first, None])[:, 0]
        by_nodes, state = free_response(Phi, state, C, last - first)
        here = sample_of[after]
        by_state[here[here >= 0]] = by_nodes[here >= 0]
    outputs = forced[line.wanted] @ C.T + readout.direct.value
    return Free(readout.gathered(outputs), readout.gathered(by_state), readout), transitions


def prediction(
    model: ParametricModel,
    eta: Array,
    x0: Array,
    free: Free,
    steps: Steps,
) -> Prediction:
    """Return the prediction from `x0` with its sensitivities to the parameters' coordinates.

    `model`, `eta`: model and parameters' coordinates (p); `x0`: initial state (n), scaled. `free`, `steps`:
    the result of `free_prediction` for the same parameters; the channels are those of it.
    """
    model, readout = model.moved(eta), free.readout
    n, p = model.states, model.parameters
    C, C_slopes, direct = readout.C, readout.C_slopes, readout.direct
    if model.system.delayed:
        from dynid.identification.systems.delayed_prediction import delayed_prediction

        return Prediction(*delayed_prediction(model, eta, x0, readout.channels), free.by_state)
    if not isinstance(steps, list):
        from dynid.identification.systems import kernels

        start = kernels.carried_sensitive(model, x0)
        outputs, by_time, by_parameter = kernels.sensitive(model, steps, C, C_slopes, direct.value, start)
        if direct.slopes is not None:
            by_parameter += np.moveaxis(direct.slopes, 0, -1)
        slopes = readout.by_parameter(by_parameter, outputs)
        return Prediction(readout.gathered(outputs), model.own(by_time), slopes, free.by_state)
    trajectory = np.empty((len(model.line.wanted), n))
    moved = np.empty((len(trajectory), len(C), p))
    for samples, states, by_parameter in sensitive_runs(model, eta, x0, steps, C):
        trajectory[samples], moved[samples] = states, by_parameter.swapaxes(1, 2)
    if C_slopes.any():
        for j, C_slope in enumerate(C_slopes):
            moved[..., j] += trajectory @ C_slope.T
    if direct.slopes is not None:
        moved += np.moveaxis(direct.slopes, 0, -1)
    outputs = trajectory @ C.T + direct.value
    slopes = readout.by_parameter(moved, outputs)
    return Prediction(readout.gathered(outputs), model.own(trajectory), slopes, free.by_state)


def free_blocks(model: ParametricModel, at: Linear, rows: int) -> Iterator[tuple[slice, Array, Array]]:
    """Yield so many samples after the other, outputs from rest, and their derivatives by the first state.

    `at`: the steps at some coordinates. The model is compiled, and its channels have no delays or clocks.
    """
    from dynid.identification.systems import kernels

    C = model.output(at.eta)[0]
    carried = kernels.carried_free(model, len(C))
    for samples in _blocks_of(len(model.times), rows):
        direct = model.direct(at.eta, chosen=samples).value
        yield samples, *kernels.free(model, at, C, direct, carried)


def prediction_blocks(
    model: ParametricModel, at: Linear, start: Array, rows: int, *, by_state: bool = True
) -> Iterator[PredictionBlock]:
    """Yield the prediction of so many samples after the other from a first state (n, scaled).

    `model`, `at`: as of `free_blocks`; `by_state`: False: derivatives by the first state are left out.
    """
    from dynid.identification.systems import kernels

    C, C_slopes = model.output(at.eta)
    free = kernels.carried_free(model, len(C))
    sensitive = kernels.carried_sensitive(model, start)
    for samples in _blocks_of(len(model.times), rows):
        report_progress(f"sensitivities, {samples.start} of {len(model.times)} samples")
        direct = model.direct(at.eta, chosen=samples)
        outputs, states, by_parameter = kernels.sensitive(model, at, C, C_slopes, direct.value, sensitive)
        if direct.slopes is not None:
            by_parameter += np.moveaxis(direct.slopes, 0, -1)
        by_start = np.zeros((*outputs.shape, 0))
        if by_state:
            by_start = kernels.free(model, at, C, direct.value, free)[1]
        yield PredictionBlock(samples, outputs, states, by_parameter, by_start)


def _blocks_of(samples: int, rows: int) -> Iterator[slice]:
    return (slice(first, min(first + rows, samples)) for first in range(0, samples, rows))


def sensitive_runs(
    model: ParametricModel, eta: Array, x0: Array, steps: Sequence[Transition], C: Array
) -> Iterator[tuple[NDArray[np.int64], Array, Array]]:
    """Yield the samples of a run after the other, their states (… x n), and derivatives (… x p x channels).

    `model`: on its own timeline; C: output matrix (channels x n), whose derivatives are left out; the other
    arguments are as of `prediction`.
    """
    n, p = model.states, model.parameters
    jumps, sample_of = model.jumps(eta), model.line.sample_of()
    x, slope = x0[None], np.zeros((p, n))
    if sample_of[0] >= 0:
        yield sample_of[:1], x, np.zeros((1, p, len(C)))
    longest = max(1, min(_LONGEST_RUN, _MAX_RUN_NUMBERS // ((1 + p) * n)))
    powers, powers_k = np.empty((0, n, n)), -1
    for first, last, k in runs(model.line.which, longest):
        (Phi, gamma), (Phi_slopes, gamma_slopes) = (
            (matrix[..., :n], matrix[..., n:]) for matrix in (steps[k].step, steps[k].derivatives)
        )
        W, count = model.W[first:last], math.isqrt(last - first)
        if k != powers_k or len(powers) < count:
            powers, powers_k = powers_of(Phi, count), k
        path = recurrence(Phi, (W @ gamma.T)[:, None], x, powers=powers)
        driven = np.concatenate([x[None], path[:-1]])[:, 0] @ Phi_slopes.swapaxes(1, 2)
        driven = (driven + W @ gamma_slopes.swapaxes(1, 2)).swapaxes(0, 1)
        driven = driven if jumps is None else driven + jumps[first:last]
        slopes = recurrence(Phi, driven, slope, powers=powers)
        samples = sample_of[first + 1 : last + 1]
        kept = samples >= 0
        yield samples[kept], path[kept, 0], (slopes[kept].reshape(-1, n) @ C.T).reshape(-1, p, len(C))
        x, slope = path[-1], slopes[-1]


def output_rates(model: ParametricModel, eta: Array, states: Array) -> Array:
    """Return the derivatives of the outputs by time (times x channels), as of `ParametricModel.rates`."""
    if not model.system.delayed:
        return model.rates(eta, states)
    from dynid.identification.systems.delayed_prediction import delayed_rates

    return delayed_rates(model, eta, states[0])


def kernels_used(model: ParametricModel) -> bool:
    """Return True if predictions are compiled: those in which no jump of an input, nor an answer, moves."""
    return compiled() and not (model.has_moving_jumps or model.system.delayed)


def outputs_from(model: ParametricModel, eta: Array, start: Array, blocks: Sequence[slice]) -> Array:
    """Return the outputs from a first state (times x channels), some blocks of channels at a time.

    `model`, `eta`: model and parameters' coordinates (p); `start`: the state (n), scaled.
    """
    parts = []
    for channels in blocks:
        free, _ = free_prediction(model, eta, channels)
        parts.append(free.forced + free.by_state @ start)
    return np.concatenate(parts, axis=1)


def runs(which: NDArray[np.int64], longest: int = _LONGEST_RUN) -> Iterator[tuple[int, int, int]]:
    """Return first and last node, and index of the length, of runs of intervals of one length."""
    changes = np.flatnonzero(np.diff(which)) + 1
    for begin, end in pairwise([0, *changes.tolist(), len(which)]):
        for first in range(begin, end, longest):
            yield first, min(first + longest, end), int(which[first])


def _forcing(model: ParametricModel, gammas: list[Array]) -> Array:
    """Return ``Gamma w`` of every interval (intervals x …)."""
    shape = gammas[0].shape[:-1] if gammas else (0,)
    out = np.empty((len(model.line.which), *shape))
    for k, gamma in enumerate(gammas):
        here = model.line.which == k
        out[here] = np.moveaxis(gamma @ model.W[:-1][here].T, -1, 0)
    return out
