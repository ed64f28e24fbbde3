"""The exact step and its derivatives at given parameters, as a kernel; see `ParametricModel.transition`.

They are summed from a Taylor series, which the lower half of the system matrix alone drives: the upper half
states that velocities are rates of displacements. Where a step is too long for the series the kernel returns
that, and its caller uses `ParametricModel.transition`, which squares.
"""

from __future__ import annotations

import math
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynid.defaults import FORCING_TABLE
from dynid.identification.kernels.simd import LANES, accumulate, inlined, kernel, product
from dynid.identification.linear_system import Affine
from dynid.identification.parametric_model import ParametricModel, Transition
from dynid.parameters import logarithmic

Array = NDArray[np.float64]

# The series' first omitted term, over the sum: rounding of the state, a digit more for the sensitivities.
_REMAINDER = 1e-15
#: Norm of the longest step that the series takes: beyond, cancellation would cost more than a digit.
REACH = 4.0


class Tables(NamedTuple):
    """The parts of a model that the steps of a kernel need, as plain arrays.

    `lower` (n/2 x n) and `rates` (n/2) are the lower half of A and the diagonal of its upper right quarter;
    `left` (p x n/2 x r) times `right` (p x r x n) is the lower half's change by the parameters. `forcing`
    (lengths x degrees x n/2 x q) takes the generator state to what it feeds, degree by degree; `reach`
    (lengths) is the norm of the generator, times the step; infinite where the series is not used. `log` (p):
    1 of coordinates that are logarithms, else 0. Of a model that is not affine `lower`, `left`, `right` and
    `rates` are zeros: its steps are computed by the caller.
    """

    lower: Array
    left: Array
    right: Array
    rates: Array
    lengths: Array
    forcing: Array
    reach: Array
    W: Array
    log: Array
    which: NDArray[np.int64]
    sample: NDArray[np.int64]


_TABLES: WeakKeyDictionary[ParametricModel, Tables] = WeakKeyDictionary()


class Linear(NamedTuple):
    """The steps of all lengths at some coordinates (p), so far as they are `ready` (lengths).

    `forward` (lengths x n + q x n (1 + p), padded) takes [x, w] to the next state and its derivatives, the
    latter beside each state; `phis` (lengths x 1 + p x n (n + p padded)) are Phi and its derivatives, row
    after row, with room in each row for the sensitivities.
    """

    eta: Array
    ready: NDArray[np.bool_]
    forward: Array
    phis: Array


class Outputs(NamedTuple):
    """Outputs of a model: C, its slopes, and the direct term with its slopes (p x times x channels).

    Of an affine model C is that without the parameters, and the slopes are by their values; of any other both
    are at the coordinates of the steps. Slopes that vanish have no rows.
    """

    affine: bool
    C: Array
    C_slopes: Array
    direct: Array
    direct_slopes: Array


class Work(NamedTuple):
    """Room to sum a series in: scaled matrices, and what is summed, block by block."""

    values: Array
    A: Array
    scaled: Array
    left: Array
    touched: Array
    one: Array
    other: Array


def plain(array: Array) -> Array:
    """Return an array of the one type that kernels are compiled for."""
    return np.require(array, float, ["C", "W"])


def lanes(count: int) -> int:
    """Return the next multiple of the registers' width."""
    return -(-count // LANES) * LANES


def tables(model: ParametricModel) -> Tables:
    """Return the tables of a model, which are made once."""
    found = _TABLES.get(model)
    if found is not None:
        return found
    line, n, m, affine = model.line, model.states, model.states // 2, model.affine
    if affine is None:
        found = _TABLES[model] = Tables(
            lower=np.zeros((m, n)),
            left=np.zeros((model.parameters, m, 1)),
            right=np.zeros((model.parameters, 1, n)),
            rates=np.zeros(m),
            lengths=plain(line.lengths),
            forcing=np.empty((0, 0, m, model.W.shape[1])),
            reach=np.full(len(line.lengths), np.inf),
            W=plain(model.W),
            log=logarithmic(model.unknowns).astype(float),
            which=line.which,
            sample=line.sample_of(),
        )
        return found
    # The changes of the lower half, factorised by their largest rank.
    U, s, Vt = np.linalg.svd(affine.A_slopes[:, m:], full_matrices=False)
    rank = max(1, int((s > 8 * np.finfo(float).eps * s[:, :1]).sum(axis=1).max()))
    forcing = _forcing(model, affine)
    reach = np.abs(line.G).sum(axis=0).max(initial=0.0) * line.lengths
    found = _TABLES[model] = Tables(
        lower=plain(affine.A[m:]),
        left=plain(U[:, :, :rank] * s[:, None, :rank]),
        right=plain(Vt[:, :rank]),
        rates=plain(affine.A[:m, m:].diagonal()),
        lengths=plain(line.lengths),
        forcing=forcing,
        reach=reach if len(forcing) else np.full(len(line.lengths), np.inf),
        W=plain(model.W),
        log=logarithmic(model.unknowns).astype(float),
        which=line.which,
        sample=line.sample_of(),
    )
    return found


def outputs(model: ParametricModel, eta: Array) -> Outputs:
    """Return the outputs of a model, for steps about these coordinates."""
    direct = model.direct(eta)
    slopes = np.empty((0, *direct.value.shape)) if direct.slopes is None else direct.slopes
    affine = model.affine
    C, C_slopes = model.output(eta) if affine is None else (affine.C, affine.C_slopes)
    varying = C_slopes if C_slopes.any() else C_slopes[:0]
    return Outputs(affine is not None, *map(plain, (C, varying, direct.value, slopes)))


def _forcing(model: ParametricModel, affine: Affine) -> Array:
    """Return the table of forcing, by Horner's scheme from the highest degree down; empty if it is large."""
    line = model.line
    drive = (affine.B @ (line.H * model.acting[:, None]) * model.w_scale)[model.states // 2 :]
    degrees = _degree(REACH) + 1
    if len(line.lengths) * degrees * drive.size > FORCING_TABLE.value:
        return np.empty((0, degrees, *drive.shape))
    forcing = np.empty((len(line.lengths), degrees, *drive.shape))
    for table, h in zip(forcing, line.lengths, strict=True):
        E = np.eye(len(line.G))
        for k in reversed(range(degrees)):
            table[k] = drive @ E * (h / (k + 1))
            E = np.eye(len(E)) + line.G @ E * (h / (k + 1))
    return forcing


def linear(model: ParametricModel) -> Linear:
    """Return room for the steps of a model, none of which is ready."""
    n, p, lengths = model.states, model.parameters, len(model.line.lengths)
    return Linear(
        np.full(p, np.nan),
        np.zeros(lengths, dtype=bool),
        np.zeros((lengths, n + len(model.line.G), lanes(n * (1 + p)))),
        np.zeros((lengths, 1 + p, n * lanes(n + p))),
    )


def place(at: Linear, length: int, transition: Transition) -> None:
    """Insert a step for which the series does not converge fast enough."""
    step, derivatives = transition
    n = len(step)
    both = np.concatenate([step[None], derivatives]).transpose(2, 1, 0).reshape(step.shape[1], -1)
    at.forward[length, :, : both.shape[1]] = both
    phis = at.phis[length].reshape(1 + len(derivatives), n, -1)
    phis[0, :, :n], phis[1:, :, :n] = step[:, :n], derivatives[:, :, :n]
    at.ready[length] = True


@kernel
def _degree(norm: float) -> int:
    """Return the degree of the Taylor polynomial of exp for a matrix of this norm."""
    degree, term = 1, norm * norm / 2
    while term > _REMAINDER:
        degree += 1
        term *= norm / (degree + 1)
    return degree


@kernel
def work(t: Tables) -> Work:
    """Return room to work in."""
    p, m, rank = t.left.shape
    n, block = 2 * m, -(-(2 * m + t.W.shape[1]) // LANES) * LANES
    return Work(
        np.zeros(p),
        np.zeros((m, n)),
        np.zeros((m, n)),
        np.zeros((m, rank)),
        np.zeros((p * rank, block)),
        np.zeros((n, (1 + p) * block)),
        np.zeros((n, (1 + p) * block)),
    )


@inlined
def _norm(t: Tables, eta: Array, room: Work) -> float:
    """Set values and lower half of the system matrix; return the largest column sum of the whole."""
    p, m, rank = t.left.shape
    A = room.A
    A[:] = t.lower
    for j in range(p):
        room.values[j] = math.exp(eta[j])
        for i in range(m):
            for r in range(rank):
                share = room.values[j] * t.left[j, i, r]
                for k in range(2 * m):
                    A[i, k] += share * t.right[j, r, k]
    largest = 0.0
    for k in range(2 * m):
        column = abs(t.rates[k - m]) if k >= m else 0.0
        for i in range(m):
            column += abs(A[i, k])
        largest = max(largest, column)
    return largest


@inlined
def _summed(t: Tables, length: int, degree: int, room: Work) -> Array:
    """Sum the series of [Phi, Gamma] and its derivatives (1 + p x n x padded), by Horner's scheme."""
    p, m, rank = t.left.shape
    n, block = 2 * m, room.touched.shape[1]
    wide = (1 + p) * block
    q, h, old, new = t.W.shape[1], t.lengths[length], room.one, room.other
    old[:] = 0.0
    for i in range(n):
        old[i, i] = 1.0
    for k in range(degree, 0, -1):
        share = h / k
        for i in range(m):
            for c in range(n):
                room.scaled[i, c] = share * room.A[i, c]
        product(m, n, wide, room.scaled, 0, n, old, 0, wide, new, m * wide, wide)
        product(p * rank, n, block, t.right, 0, n, old, 0, wide, room.touched, 0, block)
        for j in range(p):
            for i in range(m):
                for r in range(rank):
                    room.left[i, r] = share * room.values[j] * t.left[j, i, r]
            fed = m * wide + (1 + j) * block
            accumulate(
                m, rank, block, room.left, 0, rank, room.touched, j * rank * block, block, new, fed, wide
            )
        for i in range(m):
            rate = share * t.rates[i]
            for c in range(wide):
                new[i, c] = rate * old[m + i, c]
            for j in range(q):
                new[m + i, n + j] += t.forcing[length, k - 1, i, j]
        for i in range(n):
            new[i, i] += 1.0
        old, new = new, old
    return old


@kernel
def linearise(t: Tables, length: int, at: Linear, room: Work) -> bool:
    """Compute the step of a length; return False where the series does not converge fast enough."""
    norm = max(t.lengths[length] * _norm(t, at.eta, room), t.reach[length])
    if not norm <= REACH:
        return False
    summed = _summed(t, length, _degree(norm) + 1, room)
    n, beside, block = 2 * len(t.lower), 1 + len(at.eta), room.touched.shape[1]
    for i in range(n):
        for j in range(beside):
            for k in range(at.forward.shape[1]):
                at.forward[length, k, i * beside + j] = summed[i, j * block + k]
        here = i * (at.phis.shape[2] // n)
        for j in range(beside):
            for k in range(n):
                at.phis[length, j, here + k] = summed[i, j * block + k]
    at.ready[length] = True
    return True
