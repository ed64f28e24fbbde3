"""Noise-free prediction of the record and its exact sensitivities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.identification.augmented import AugmentedModel, Transition

Array = NDArray[np.float64]


class Free(NamedTuple):
    """Prediction as a function of the initial state: ``forced + by_state x0``.

    `forced` (times x channels), `by_state` (times x channels x n).
    """

    forced: Array
    by_state: Array


class Prediction(NamedTuple):
    """Prediction at given parameters and initial state, with sensitivities.

    `outputs` (times x channels), `states` (times x n, scaled), `by_parameter` (times x channels x p) with
    respect to the logarithms of the parameters, `by_state` (times x channels x n).
    """

    outputs: Array
    states: Array
    by_parameter: Array
    by_state: Array


def free_prediction(model: AugmentedModel, logs: Array) -> tuple[Free, list[Transition]]:
    """Return the prediction for every initial state, and the transitions it was made with.

    Parameters
    ----------
    model
        The augmented model.
    logs
        Logarithms of the parameters (p).
    """
    n = model.states
    transitions = [model.transition(logs, h) for h in model.line.lengths]
    forcing = _forcing(model, [transition.step[:, n:] for transition in transitions])
    state = np.concatenate([np.zeros((n, 1)), np.eye(n)], axis=1)
    steps = [transition.step[:, :n] for transition in transitions]
    C = model.output(logs)[0]
    # Only what the channels see is kept: all states at all nodes would be n times as much.
    outputs = np.empty((len(model.line.wanted), len(C), 1 + n))
    first = 0
    for sample, node in enumerate(model.line.wanted.tolist()):
        for between in range(first, node):
            state = steps[model.line.which[between]] @ state
            state[:, 0] += forcing[between]
        first = node
        outputs[sample] = C @ state
    return Free(outputs[:, :, 0] + model.feedthrough, outputs[:, :, 1:]), transitions


def prediction(
    model: AugmentedModel, logs: Array, x0: Array, free: Free, transitions: list[Transition]
) -> Prediction:
    """Return the prediction from `x0` with its sensitivities to the parameters' logarithms.

    Parameters
    ----------
    model, logs
        Model and parameters' logarithms (p).
    x0
        Initial state (n), scaled.
    free, transitions
        What `free_prediction` returned for the same parameters.
    """
    n, p = model.states, model.parameters
    trajectory = np.empty((len(model.line.nodes), n, 1 + p))
    state = np.zeros((n, 1 + p))
    state[:, 0] = x0
    trajectory[0] = state
    forcing = _forcing(model, [transition.step[:, n:] for transition in transitions])
    drift = _forcing(model, [transition.derivatives[:, :, n:] for transition in transitions])
    steps = [transition.step[:, :n] for transition in transitions]
    slopes = [transition.derivatives[:, :, :n] for transition in transitions]
    for node, k in enumerate(model.line.which):
        change = slopes[k] @ state[:, 0] + drift[node]
        state = steps[k] @ state
        state[:, 0] += forcing[node]
        state[:, 1:] += change.T
        trajectory[node + 1] = state
    trajectory = trajectory[model.line.wanted]
    C, C_slopes = model.output(logs)
    outputs = C @ trajectory
    by_parameter = outputs[:, :, 1:] + np.einsum("pcn,tn->tcp", C_slopes, trajectory[:, :, 0])
    return Prediction(outputs[:, :, 0] + model.feedthrough, trajectory[:, :, 0], by_parameter, free.by_state)


def _forcing(model: AugmentedModel, gammas: list[Array]) -> Array:
    """Return ``Gamma w`` of every interval (intervals x …)."""
    shape = gammas[0].shape[:-1] if gammas else (0,)
    out = np.empty((len(model.line.which), *shape))
    for k, gamma in enumerate(gammas):
        here = model.line.which == k
        out[here] = np.moveaxis(gamma @ model.W[:-1][here].T, -1, 0)
    return out
