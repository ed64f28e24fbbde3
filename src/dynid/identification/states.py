"""Physical states of a record as the whole of it tells them: bands, and the truth of simulated records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.identification.filter import stored_rows
from dynid.identification.least_squares import thin_svd
from dynid.identification.likelihood import RecordFit
from dynid.identification.measurement import Measurement, Simulation, simulated
from dynid.identification.prediction import runs
from dynid.identification.time_record import TimeRecord
from dynid.lti.recurrence import recurrence
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel, Load

Array = NDArray[np.float64]


def state_deviations(record: TimeRecord, fit: RecordFit, noise: Array, known: Array) -> Array:
    """Return the standard deviations of the states (rows that are kept x n, scaled), given all records.

    The covariance of initial state and parameters, carried along exactly. Initial states that the record
    does not show keep the deviation of the wide prior.

    Parameters
    ----------
    record
        Model and record.
    fit
        Its fit at the estimate.
    noise
        Standard deviation of the noise (channels).
    known
        A root of the covariance of the logarithms, given all records (p x p).
    """
    model, n = record.model, record.model.states
    transitions = [model.transition(fit.logs, h) for h in model.line.lengths]
    shown = np.zeros(len(model.line.nodes), dtype=bool)
    shown[model.line.wanted[stored_rows(len(model.line.wanted))]] = True
    root = _initial_root(record, fit, noise, known)
    by_logs, columns = root[n:].T, root[:n].T
    x = fit.predicted.states[0]
    out = [_sizes(columns[None])] if shown[0] else []
    for first, last, k in runs(model.line.which):
        step, slopes = transitions[k]
        Phi, W = step[:, :n], model.W[first:last]
        path = recurrence(Phi, (W @ step[:, n:].T)[:, None], x[None])[:, 0]
        driven = np.concatenate([np.concatenate([x[None], path[:-1]]), W], axis=1)
        moved = (driven @ slopes.swapaxes(1, 2)).swapaxes(0, 1)  # steps x p x n
        spread = recurrence(Phi, by_logs @ moved, columns)
        x, columns = path[-1], spread[-1]
        out.append(_sizes(spread[shown[first + 1 : last + 1]]))
    return np.concatenate(out)


def _sizes(columns: Array) -> Array:
    """Return the lengths of states (steps x columns x n) over the columns, however large or small."""
    unit = np.abs(columns).max(axis=1)  # squares of large units overflow
    shares = columns / np.where(unit > 0, unit, 1.0)[:, None]
    return np.asarray(np.sqrt(np.einsum("ijk,ijk->ik", shares, shares)) * unit)


def _initial_root(record: TimeRecord, fit: RecordFit, noise: Array, known: Array) -> Array:
    """Return a root of the covariance of initial state (scaled) and logarithms (n + p x n + p).

    Given the logarithms, the state is what a regression on them leaves, with the covariance that it then has.
    """
    n = record.model.states
    by_state, by_parameter = record.by_start(fit, noise), record.slopes(fit, noise)
    U, s, Vt = thin_svd(by_state)
    stored_rows = np.zeros(n)
    stored_rows[: len(s)] = s
    follows = np.zeros((n, len(known)))
    follows[: len(s)] = U[:, : len(s)].T @ by_parameter @ known
    follows *= -(stored_rows / (1 + stored_rows**2))[:, None]
    left = Vt.T @ np.concatenate([np.diag(1 / np.sqrt(1 + stored_rows**2)), follows], axis=1)
    below = np.concatenate([np.zeros((len(known), n)), known], axis=1)
    return np.concatenate([record.root @ left, below])


def true_states(
    truth: StructuralModel, model: StructuralModel, loads: Sequence[Load], measurement: Measurement
) -> Array | None:
    """Return the states that a simulated record was made with (times x n, SI), in the coordinates of `model`.

    Displacements, then velocities. Coordinates of a reduced model that are DOFs of the truth are read there;
    if there are others, all are those of the nearest motion of the reduced model, by kinetic energy.
    """
    if not isinstance(measurement.source, Simulation):
        return None
    states = simulated(truth, loads, measurement).states
    if states.shape[1] != 2 * truth.size:  # massless DOFs are no states
        channels = tuple(Channel(dof, kind) for kind in ("displacement", "velocity") for dof in truth.dofs)
        states = simulated(truth, loads, replace(measurement, channels=channels)).outputs
    read = _coordinates(truth, model)
    moved = states.reshape(len(states), 2, truth.size) @ read.T
    return np.asarray(moved.reshape(len(states), -1))


def _coordinates(truth: StructuralModel, model: StructuralModel) -> Array:
    """Return what reads the coordinates of a model from displacements of the truth (n x size)."""
    if model.basis is None or (truth.basis is not None and truth.dofs == model.dofs):
        return np.eye(truth.size)
    known = set(truth.dofs)
    if known.issuperset(model.dofs):
        return np.array([truth.row(dof) for dof in model.dofs])
    full = model.basis.parent
    momentum = model.basis.T.T @ np.asarray(as_array(full.M))
    return np.asarray(np.linalg.lstsq(as_array(model.M), momentum, rcond=None)[0])
