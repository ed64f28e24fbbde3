"""Standard deviations of the states of a record, given the posterior of the parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.arrays import Array
from dynid.identification.least_squares import thin_svd
from dynid.identification.systems.prediction import runs
from dynid.lti.recurrence import recurrence

if TYPE_CHECKING:
    from dynid.identification.likelihood.record_likelihood import RecordFit

#: Rows of a history, at the most.
MAX_STORED_ROWS = 100_000
# Most numbers of states and of their derivatives that are held at once: 32 MB.
_MAX_BLOCK_NUMBERS = 4_000_000


def stored_rows(samples: int) -> slice:
    """Return the rows of a history over so many samples that are stored."""
    stride = max(1, -(-samples // MAX_STORED_ROWS))
    return slice((samples - 1) % stride, None, stride)


def state_deviations(record: Any, fit: RecordFit, noise: Array, root_of_parameters: Array) -> Array:
    """Return the standard deviations of the states (stored rows x n, scaled), given all records.

    The covariance of initial state and parameters, propagated exactly. Initial states that are not observable
    in the record keep the deviation of the wide prior.

    `fit`: its fit at the estimate; `noise`: standard deviation of the noise (channels).
    `root_of_parameters`: a root of the covariance of the coordinates, given all records (p x p).
    """
    root = initial_root(record, fit, noise, root_of_parameters)
    if (state_slopes := record.state_slopes(fit)) is not None:
        return np.asarray(np.linalg.norm(state_slopes[stored_rows(len(state_slopes))] @ root, axis=2))
    model, n = record.model.moved(fit.eta), record.model.states
    transitions = [model.transition(fit.eta, h) for h in model.line.lengths]
    stored = np.zeros(len(model.line.nodes), dtype=bool)
    sample_nodes = model.own(model.line.wanted)
    stored[sample_nodes[stored_rows(len(sample_nodes))]] = True
    by_eta, columns = root[n:].T, root[:n].T
    x = fit.predicted.start
    out = [_sizes(columns[None])] if stored[0] else []
    longest = max(1, _MAX_BLOCK_NUMBERS // (4 * n * (n + len(fit.eta))))  # and copies
    for first, last, k in runs(model.line.which, longest):
        step, slopes = transitions[k]
        Phi, W = step[:, :n], model.W[first:last]
        path = recurrence(Phi, (W @ step[:, n:].T)[:, None], x[None])[:, 0]
        driven = np.concatenate([np.concatenate([x[None], path[:-1]]), W], axis=1)
        moved = (driven @ slopes.swapaxes(1, 2)).swapaxes(0, 1)  # steps x p x n
        spread = recurrence(Phi, by_eta @ moved, columns)
        x, columns = path[-1], spread[-1]
        out.append(_sizes(spread[stored[first + 1 : last + 1]]))
    return np.concatenate(out)


def _sizes(columns: Array) -> Array:
    """Return the lengths of states (steps x columns x n) over the columns, however large or small."""
    unit = np.abs(columns).max(axis=1)  # squares of large units overflow
    shares = columns / np.where(unit > 0, unit, 1.0)[:, None]
    return np.asarray(np.sqrt(np.einsum("ijk,ijk->ik", shares, shares)) * unit)


def initial_root(record: Any, fit: RecordFit, noise: Array, root_of_parameters: Array) -> Array:
    """Return a root of the covariance of initial state (scaled) and coordinates (n + p x n + p)."""
    # Given the coordinates, the state has the mean and covariance of its regression on them.
    n = record.nuisances
    by_state, by_parameter = record.by_start(fit, noise), record.slopes(fit, noise)
    U, s, Vt = thin_svd(by_state)
    size = np.zeros(n)
    size[: len(s)] = s
    follows = np.zeros((n, len(root_of_parameters)))
    follows[: len(s)] = U[:, : len(s)].T @ by_parameter @ root_of_parameters
    follows *= -(size / (1 + size**2))[:, None]
    left = Vt.T @ np.concatenate([np.diag(1 / np.sqrt(1 + size**2)), follows], axis=1)
    below = np.concatenate([np.zeros((len(root_of_parameters), n)), root_of_parameters], axis=1)
    return np.concatenate([record.root @ left, below])
