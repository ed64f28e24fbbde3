"""The filter of the augmented state, one pass over the record.

Source: K. T. Yang 1997, eqs 19–20 (Detchmendy–Sridhar), which is the Kalman–Bucy filter of the augmented
state with R = (2 Q)^-1. It is split here into exact propagation between samples and a measurement update in
Joseph form, which keeps the covariance positive whatever the step and the weighting.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged
from dynid.identification.augmented import AugmentedModel

Array = NDArray[np.float64]

# A logarithm this far from its start is a run-away: a factor of a million.
RUNAWAY = float(np.log(1e6))


class Prior(NamedTuple):
    """What a pass starts from: state (n, scaled), logarithms (p) and the covariance of both (n + p)."""

    state: Array
    logs: Array
    covariance: Array


class Pass(NamedTuple):
    """One pass: logarithms and their standard deviations (times x p), physical states (times x n, scaled)."""

    logs: Array
    deviations: Array
    states: Array


def filter_pass(
    model: AugmentedModel, measured: Array, prior: Prior, deviation: Array, origin: Array
) -> Pass:
    """Run the filter once over the record.

    Parameters
    ----------
    model
        The augmented model.
    measured
        Measured values (times x channels); NaN where a sample is missing.
    prior
        State, parameters and covariance before the first sample.
    deviation
        Assumed standard deviation of each channel's noise (channels) or of each sample (times x channels).
    origin
        Logarithms that a run-away is measured from (p).

    Raises
    ------
    Diverged
        If a parameter becomes non-finite or leaves its start by a factor of a million.
    """
    n, p = model.states, model.parameters
    samples = len(measured)
    variance = np.broadcast_to(deviation**2, measured.shape)
    here: NDArray[np.bool_] = np.logical_not(np.isnan(measured))
    complete = np.all(here, axis=1).tolist()
    outputs_vary = bool(model.C_slopes.any())
    x, logs, P = prior.state.copy(), prior.logs.copy(), prior.covariance.copy()
    history = Pass(np.empty((samples, p)), np.empty((samples, p)), np.empty((samples, n)))
    F, identity = np.eye(n + p), np.eye(n + p)
    H = np.zeros((measured.shape[1], n + p))
    H[:, :n] = model.C
    sample_of = np.full(len(model.line.nodes), -1)
    sample_of[model.line.wanted] = np.arange(samples)
    for node, sample in enumerate(sample_of):
        if node:
            step, slopes = model.transition(logs, float(model.line.lengths[model.line.which[node - 1]]))
            z = np.concatenate([x, model.W[node - 1]])
            x = step @ z
            F[:n, :n] = step[:, :n]
            F[:n, n:] = (slopes @ z).T
            P = F @ P @ F.T
        if sample < 0:
            continue
        if outputs_vary:
            C, C_slopes = model.output(logs)
            H[:, :n], H[:, n:] = C, (C_slopes @ x).T
        rows = slice(None) if complete[sample] else here[sample]
        innovation = (measured[sample] - model.feedthrough[sample] - H[:, :n] @ x)[rows]
        x, logs, P = _updated(x, logs, P, H[rows], innovation, variance[sample][rows], identity)
        _check(model, logs, origin)
        history.logs[sample] = logs
        history.deviations[sample] = np.sqrt(P.diagonal()[n:])
        history.states[sample] = x
    return history


def _updated(
    x: Array, logs: Array, P: Array, H: Array, innovation: Array, variance: Array, identity: Array
) -> tuple[Array, Array, Array]:
    """Take one sample's channels into account, in Joseph form."""
    if not len(innovation):
        return x, logs, P
    HP = H @ P
    S = HP @ H.T
    S.flat[:: len(S) + 1] += variance
    gain = np.linalg.solve(S, HP).T
    correction = gain @ innovation
    n = len(x)
    reduced = identity - gain @ H
    P = reduced @ P @ reduced.T + (gain * variance) @ gain.T
    P += P.T
    P *= 0.5
    return x + correction[:n], logs + correction[n:], P


def _check(model: AugmentedModel, logs: Array, origin: Array) -> None:
    away = ~(np.abs(logs - origin) < RUNAWAY)
    if away.any():
        raise run_away([unknown.name for unknown, bad in zip(model.unknowns, away, strict=True) if bad])


def run_away(names: list[str]) -> Diverged:
    """Return the error that says which parameters ran away."""
    verb = "runs" if len(names) == 1 else "run"
    return Diverged(
        f"the estimate of {', '.join(names)} {verb} away from its start by a factor of more than 1e6",
        remedy="Start nearer to the true values, or check model, units and excitation against the record.",
        names=names,
    )
