"""The filter's pass as a compiled kernel. Importing this loads numba: see `compiled.py`.

Between two samples state, transition and sensitivities are summed from one Taylor series, which the
lower half of the system matrix alone drives: the upper half says that velocities are rates of displacements.
Where the step is too long for the series the kernel stops, and its caller takes that step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from dynid.identification.augmented import AugmentedModel

Array = NDArray[np.float64]
# Numbers in the table of forcing: beyond, its making would take longer than it saves.
_MOST_FORCING = 1_000_000

F = TypeVar("F", bound=Callable[..., Any])

# The series' first omitted term, over the sum: rounding of the state, a digit more for the sensitivities.
_REMAINDER = 1e-15
#: Norm of the longest step that the series takes: beyond, cancellation would cost more than a digit.
REACH = 4.0
#: Columns are padded to a multiple of this: whole vector registers.
LANES = 8


class Tables(NamedTuple):
    """What a pass needs of the model and the record, as plain arrays.

    `lower` (n/2 x n), `slopes` (n x n/2 p, the parameter fastest) and `rates` (n/2) are the lower half of A,
    its change by the parameters, and the diagonal of its upper right quarter. `forcing` (lengths x terms x
    n/2 x q) takes the generator state to the terms that it feeds; `reach` (lengths) is the norm of what
    drives, times the step. `sample` (nodes) is the sample at a node, or -1.
    """

    lower: Array
    slopes: Array
    rates: Array
    lengths: Array
    forcing: Array
    reach: Array
    W: Array
    C: Array
    C_slopes: Array
    measured: Array
    feedthrough: Array
    weight: Array
    which: NDArray[np.int64]
    sample: NDArray[np.int64]


class Work(NamedTuple):
    """Room to work in."""

    total: Array
    term: Array
    new: Array
    source: Array
    x: Array
    A: Array
    slopes: Array
    values: Array
    root: Array
    state: Array
    row: Array
    phi: Array
    correction: Array


def tables(model: AugmentedModel, measured: Array, weight: Array) -> Tables:
    """Return the tables of a pass.

    Parameters
    ----------
    model
        The augmented model.
    measured, weight
        Measured values, and one over the standard deviation of their noise (times x channels).
    """
    line, n, p = model.line, model.states, model.parameters
    m = n // 2
    drive = model.drive[m:]
    terms = _degree(REACH)
    affordable = len(line.lengths) * terms * drive.size <= _MOST_FORCING
    shown = line.lengths if affordable else line.lengths[:0]
    forcing = np.empty((len(shown), terms, *drive.shape))
    for table, h in zip(forcing, shown, strict=True):
        fed = drive * h
        for k in range(terms):
            table[k] = fed / (k + 1)
            fed = fed @ line.G * (h / (k + 1))
    norm = float((np.abs(drive).sum(axis=0) + np.abs(line.G).sum(axis=0)).max(initial=0.0))

    def plain(array: Array) -> Array:
        """Return it as every pass has it: the kernels are compiled for one type of array."""
        return np.require(array, float, ["C", "W"])

    return Tables(
        lower=plain(model.A[m:]),
        slopes=plain(model.A_slopes[:, m:].transpose(2, 1, 0).reshape(n, m * p)),
        rates=plain(model.A[:m, m:].diagonal()),
        lengths=plain(line.lengths),
        forcing=forcing,
        reach=norm * line.lengths if affordable else np.full(len(line.lengths), np.inf),
        which=line.which,
        W=plain(model.W),
        sample=line.sample_of(),
        C=plain(model.C),
        C_slopes=plain(model.C_slopes),
        measured=plain(measured),
        feedthrough=plain(model.feedthrough),
        weight=plain(weight),
    )


def padded(S: Array) -> Array:
    """Return a copy of a root (rows x columns), with columns of zeros after it."""
    return np.pad(S, ((0, 0), (0, -len(S) % LANES)))


_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}


def _compiled(function: F) -> F:
    """Compile on first call; kept on disk for the next process where a folder for it can be written."""
    try:
        compiled: F = numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # numba finds no folder to write to
        compiled = numba.njit(**_OPTIONS)(function)
    return compiled


def _inlined(function: F) -> F:
    """Compile into its callers: handing over a table of arrays takes longer than some of the work on them."""
    inlined: F = numba.njit(inline="always", **_OPTIONS)(function)
    return inlined


@_compiled
def _multiply(factor: float, A: Array, X: Array, out: Array, first: int) -> None:
    """Set the rows of `out` from the first on to ``factor A X``, X having as many rows as are needed."""
    rows, count = A.shape[0], min(A.shape[1], X.shape[0])
    width = X.shape[1]
    for i in range(rows):
        row = first + i
        for c in range(width):
            out[row, c] = 0.0
        k = 0
        while k + 4 <= count:  # four at a time: a fourth of the stores
            a0, a1 = factor * A[i, k], factor * A[i, k + 1]
            a2, a3 = factor * A[i, k + 2], factor * A[i, k + 3]
            for c in range(width):
                out[row, c] += a0 * X[k, c] + a1 * X[k + 1, c] + a2 * X[k + 2, c] + a3 * X[k + 3, c]
            k += 4
        while k + 2 <= count:
            a0, a1 = factor * A[i, k], factor * A[i, k + 1]
            for c in range(width):
                out[row, c] += a0 * X[k, c] + a1 * X[k + 1, c]
            k += 2
        if k < count:
            a0 = factor * A[i, k]
            for c in range(width):
                out[row, c] += a0 * X[k, c]


@_compiled
def _degree(norm: float) -> int:
    """Return the degree of the Taylor polynomial of exp for a matrix of this norm."""
    degree, term = 1, norm * norm / 2
    while term > _REMAINDER:
        degree += 1
        term *= norm / (degree + 1)
    return degree


@_inlined
def _norm(A: Array, rates: Array) -> float:
    """Return the largest column sum of the system matrix, given its lower half and its rates."""
    m, n = A.shape
    largest = 0.0
    for k in range(n):
        column = rates[k - m] if k >= m else 0.0
        for i in range(m):
            column += abs(A[i, k])
        largest = max(largest, column)
    return largest


@_inlined
def _series(
    A: Array, slopes: Array, rates: Array, forcing: Array, w: Array, h: float, degree: int, work: Work
) -> None:
    """Sum [Phi, sensitivities, state] of a step into ``work.total``, the state being ``work.x``."""
    m, n = A.shape
    p = slopes.shape[1] // m
    total, term, new, source, x = work.total, work.term, work.new, work.source, work.x
    width, last = total.shape[1], n + p
    for i in range(n):
        for c in range(width):
            term[i, c] = 0.0
        term[i, i] = 1.0
        term[i, last] = x[0, i]
        for c in range(width):
            total[i, c] = term[i, c]
    for k in range(degree):
        f = h / (k + 1)
        for i in range(n):
            x[0, i] = term[i, last]
        _multiply(f, x, slopes, source, 0)
        _multiply(f, A, term, new, m)
        for i in range(m):
            row = m + i
            for j in range(p):
                new[row, n + j] += source[0, i * p + j]
            for j in range(len(w)):
                new[row, last] += forcing[k, i, j] * w[j]
            rate = f * rates[i]
            for c in range(width):
                new[i, c] = rate * term[row, c]
        for i in range(n):
            for c in range(width):
                total[i, c] += new[i, c]
        term, new = new, term


@_inlined
def _system(t: Tables, z: Array, work: Work) -> None:
    """Set ``work.A`` and ``work.slopes`` for the parameters of z."""
    m, n = t.lower.shape
    p = len(z) - n
    for j in range(p):
        work.values[j] = math.exp(z[n + j])
    for k in range(n):
        for i in range(m):
            entry = t.lower[i, k]
            for j in range(p):
                change = work.values[j] * t.slopes[k, i * p + j]
                work.slopes[k, i * p + j] = change
                entry += change
            work.A[i, k] = entry


@_inlined
def _propagate(t: Tables, node: int, z: Array, S: Array, work: Work) -> bool:
    """Take state and root to a node from the one before it; tell whether the series reaches."""
    size, n = len(z), t.lower.shape[1]
    length = t.which[node - 1]
    h = t.lengths[length]
    _system(t, z, work)
    norm = max(h * _norm(work.A, t.rates), t.reach[length])
    if not norm <= REACH:
        return False
    for i in range(n):
        work.x[0, i] = z[i]
    _series(work.A, work.slopes, t.rates, t.forcing[length], t.W[node - 1], h, _degree(norm), work)
    _multiply(1.0, work.total, S, work.root, 0)
    for i in range(n):
        z[i] = work.total[i, size]
    for i in range(n):
        for c in range(S.shape[1]):
            S[i, c] = work.root[i, c]
    return True


@_inlined
def _update(t: Tables, sample: int, z: Array, S: Array, normalised: Array, work: Work) -> None:
    """Take one sample into account, channel by channel, in units of its noise (Potter)."""
    n, size, width = t.lower.shape[1], len(z), S.shape[1]
    p = size - n
    state, row, phi = work.state, work.row, work.phi
    for i in range(n):
        state[i] = z[i]  # every channel is linearised about the state before the sample
    for j in range(p):
        work.values[j] = math.exp(z[n + j])
    correction = work.correction
    correction[:] = 0.0
    for channel in range(len(t.C)):
        if math.isnan(t.measured[sample, channel]):
            continue
        weight = t.weight[sample, channel]
        for j in range(p):
            row[0, n + j] = 0.0
        for i in range(n):
            entry = t.C[channel, i]
            for j in range(p):
                change = work.values[j] * t.C_slopes[j, channel, i]
                entry += change
                row[0, n + j] += change * state[i]
            row[0, i] = entry
        innovation = t.measured[sample, channel] - t.feedthrough[sample, channel]
        for i in range(n):
            innovation -= row[0, i] * state[i]
        innovation *= weight
        _multiply(weight, row, S, phi, 0)
        spread = 1.0
        for c in range(width):
            spread += phi[0, c] * phi[0, c]
        for i in range(size):
            innovation -= weight * row[0, i] * correction[i]
        normalised[sample, channel] = innovation / math.sqrt(spread)
        shrink = 1 / (1 + math.sqrt(1 / spread))
        for i in range(size):
            gain = 0.0
            for c in range(width):
                gain += S[i, c] * phi[0, c]
            gain /= spread
            correction[i] += gain * innovation
            gain *= shrink
            for c in range(width):
                S[i, c] -= gain * phi[0, c]
    for i in range(size):
        z[i] += correction[i]


@_inlined
def _length(S: Array, row: int) -> float:
    unit = 0.0  # squares of large units overflow
    for c in range(S.shape[1]):
        unit = max(unit, abs(S[row, c]))
    if unit == 0.0:
        return 0.0
    square = 0.0
    for c in range(S.shape[1]):
        share = S[row, c] / unit
        square += share * share
    return math.sqrt(square) * unit


@_compiled
def _work(t: Tables, size: int, width: int) -> Work:
    m, n = t.lower.shape
    wide = -(-(size + 1) // LANES) * LANES
    return Work(
        np.zeros((n, wide)),
        np.zeros((n, wide)),
        np.zeros((n, wide)),
        np.zeros((1, t.slopes.shape[1])),
        np.zeros((1, n)),
        np.zeros((m, n)),
        np.zeros(t.slopes.shape),
        np.zeros(size - n),
        np.zeros((n, width)),
        np.zeros(n),
        np.zeros((1, size)),
        np.zeros((1, width)),
        np.zeros(size),
    )


@_compiled
def walk(
    t: Tables, first: int, arrived: bool, z: Array, S: Array, origin: Array, runaway: float, history: Any
) -> int:
    """Filter from a node on; see `filter_pass`.

    Parameters
    ----------
    t
        Model and record.
    first, arrived
        The node to go to, and whether state and root are already there.
    z, S
        State and logarithms (n + p), and root of their covariance (n + p x width), in place.
    origin, runaway
        What a logarithm must not leave by how much.
    history
        What is filled: logarithms, their deviations, states, their deviations, innovations.

    Returns
    -------
    int
        The node that it has not got to: the number of nodes, or where the series does not reach, or minus one
        minus the node of a run-away.
    """
    work = _work(t, len(z), S.shape[1])
    logs, deviations, states, bands, innovations = history
    n = t.lower.shape[1]
    for node in range(first, len(t.sample)):
        if node > 0 and not (arrived and node == first) and not _propagate(t, node, z, S, work):
            return node
        sample = t.sample[node]
        if sample < 0:
            continue
        _update(t, sample, z, S, innovations, work)
        for j in range(len(origin)):
            if not abs(z[n + j] - origin[j]) < runaway:
                return -1 - node
            logs[sample, j], deviations[sample, j] = z[n + j], _length(S, n + j)
        for i in range(n):
            states[sample, i], bands[sample, i] = z[i], _length(S, i)
    return len(t.sample)
