"""Forces of joints with nonlinear laws: as the record has them, and the energy that the laws take up.

The rest of the structure is linear under its joint forces. So the residual shows by how much the force of a
joint differs from its law: a Rauch–Tung–Striebel smoother takes the difference for a Markov process that is
as large as the force itself. So the law does not decide, and the band says where the record determines it.

Source: H. E. Rauch, F. Tung, C. T. Striebel, AIAA J. 3 (1965) 1445–1450.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.systems.nonlinear_prediction import forced_rest
from dynid.lti.exponential import exponential
from dynid.number_format import general

# Most samples that are smoothed, and most numbers of their covariances.
_MAX_SAMPLES, _MAX_NUMBERS = 4000, 5_000_000
# Energy below this part of what the force could do in a cycle is round-off, or the error of its sum.
_CREATED_TOL = 1e-3
#: Amplitudes of cycles, over the largest deflection in the records.
FRACTIONS = np.arange(1, 9) / 8


class MeasuredForces(NamedTuple):
    """What a record shows of joints (samples x joints): deflections, forces, standard deviations of these."""

    deflections: Array
    forces: Array
    deviations: Array


def measured_forces(
    record: NonlinearRecord, fit: RecordFit, noise: Array, deflections: Array, forces: Array, rate: float
) -> MeasuredForces | None:
    """Return the forces of joints as a record has them; None of one that is too large.

    `deflections`, `forces` (times x joints): of the model; `noise`: deviations (channels); `rate`: at which
    the forces change, rad/s. The first samples are smoothed, as many as there may be.
    """
    rest = forced_rest(record.model, fit.eta)
    n, nf = rest.E.shape
    size, rows = n + nf, min(len(forces), _MAX_SAMPLES)
    if rows * size**2 > _MAX_NUMBERS or record.sampling_step is None:
        return None
    h, rms = record.sampling_step, np.sqrt(np.mean(forces**2, axis=0))
    joint = np.zeros((size, size))
    joint[:n, :n], joint[:n, n:], joint[n:, n:] = rest.A, rest.E, -rate * np.eye(nf)
    step, read = exponential(joint, h), np.concatenate([rest.C, rest.D], axis=1)
    state_rms = np.sqrt(np.mean(fit.predicted.states**2, axis=0))
    deviation = np.maximum(rms, np.finfo(float).tiny)
    first = np.diag(np.concatenate([state_rms, deviation]) ** 2)
    driven = np.zeros((size, size))
    driven[n:, n:] = np.diag(deviation**2) * (1 - np.exp(-2 * rate * h))
    states, spread = _smoothed(step, read, driven, first, fit.residual[:rows], noise)
    return MeasuredForces(
        deflections[:rows] + states[:, :n] @ rest.rows.T, forces[:rows] + states[:, n:], spread[:, n:]
    )


def _smoothed(
    step: Array, read: Array, driven: Array, first: Array, residual: Array, noise: Array
) -> tuple[Array, Array]:
    """Return smoothed states and their deviations (samples x states)."""
    rows, size = len(residual), len(step)
    x, P = np.zeros(size), first
    before, filtered, covariances, predicted = *np.zeros((2, rows, size)), *np.zeros((2, rows, size, size))
    for k, values in enumerate(residual):
        if k:
            x, P = step @ x, step @ P @ step.T + driven
        before[k], predicted[k] = x, P
        there = ~np.isnan(values)
        if there.any():
            C = read[there]
            S = C @ P @ C.T + np.diag(noise[there] ** 2)
            gain = np.linalg.solve(S, C @ P).T
            x, P = x + gain @ (values[there] - C @ x), P - gain @ (C @ P)
            P = (P + P.T) / 2
        filtered[k], covariances[k] = x, P
    states, spread = filtered.copy(), covariances.copy()
    for k in range(rows - 2, -1, -1):
        back = np.linalg.lstsq(predicted[k + 1], step @ covariances[k], rcond=None)[0].T
        states[k] += back @ (states[k + 1] - before[k + 1])
        spread[k] += back @ (spread[k + 1] - predicted[k + 1]) @ back.T
    return states, np.sqrt(np.maximum(np.diagonal(spread, axis1=1, axis2=2), 0.0))


def motion_sizes(records: Sequence[NonlinearRecord], fits: Sequence[RecordFit]) -> tuple[Array, Array]:
    """Return the largest deflections of joints with laws, and the rates of their motions, rad/s."""
    peaks, squares = [], []
    for record, fit in zip(records, fits, strict=True):
        model, states = record.structure, fit.predicted.states * record.model.scale
        rows = model.deflections().T
        d, v = states[:, : model.size] @ rows, states[:, model.size :] @ rows
        peaks.append(np.abs(d).max(axis=0))
        squares.append([np.sum(d**2, axis=0), np.sum(v**2, axis=0)])
    d, v = np.sum(squares, axis=0)
    return np.max(peaks, axis=0), np.sqrt(np.where((d > 0) & (v > 0), v, 1.0) / np.where(d > 0, d, 1.0))


def created_energy(posterior: Posterior) -> Iterator[str]:
    """Yield one sentence for each law that creates energy, as estimated, at an amplitude of its records."""
    records: Any = posterior.likelihood.records
    peaks, rates = motion_sizes(records, posterior.fit.parts)
    units = records[0].structure.deflection_units("m")
    for name, bound in records[0].laws_at(posterior.fit.eta):
        peak, rate = float(peaks[bound.row]), float(rates[bound.row])
        work = np.array([bound.cycle_work(float(fraction) * peak, rate) for fraction in FRACTIONS])
        worst = int(np.argmin(work))
        amplitude = float(FRACTIONS[worst]) * peak
        # What a force that turns once with the motion could do: that part of it is round-off.
        size = (
            np.abs(work).max()
            + abs(float(bound.force(bound.regime(amplitude, 0.0, 0.0), amplitude, 0.0, 0.0).value))
            * amplitude
        )
        if work[worst] < -_CREATED_TOL * size:
            yield (
                f"the law {bound.law.kind} of joint {name}, as estimated, creates energy: "
                f"{general(-work[worst])} J in a cycle at an amplitude of {general(amplitude)} "
                f"{units[bound.row]}; responses with it may grow without bound: give limits to its "
                "parameters, or choose another law"
            )
