"""Passes of the filter, and predictions of records, by machine code (`dynid.native`).

A step and its derivatives are summed there from a Taylor series, which the lower half of the system matrix
alone drives: the upper half states that velocities are rates of displacements. A longer step is halved, and
squared; where halvings are not enough `ParametricModel.transition` makes it.

The kernels are used wherever the library is there. They give what NumPy gives, to rounding.
"""

from __future__ import annotations

from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, finite
from dynid.defaults import FORCING_TABLE
from dynid.identification.systems.linear_system import Affine
from dynid.identification.systems.parametric_model import ParametricModel, Transition
from dynid.native import call, structure
from dynid.parameters import logarithmic

#: Columns of what the kernels write are a multiple of it, as in `native/products.h`.
LANES = 8
#: Norm of the longest step that the series takes: beyond, cancellation would cost more than a digit.
MAX_SERIES_NORM = 4.0
#: How often a longer step is halved at most.
MAX_HALVINGS = 3


class Linear(NamedTuple):
    """The steps of all lengths at some coordinates (p), so far as they are `ready` (lengths).

    `forward` (lengths x n + q x n (1 + p), padded) takes [x, w] to the next state and its derivatives, the
    latter beside each state; `phis` (lengths x 1 + p x n (n + p padded)) are Phi and its derivatives, row
    after row, with room in each row for the sensitivities. `members` is the same as the kernels have it.
    """

    eta: Array
    ready: NDArray[np.bool_]
    forward: Array
    phis: Array
    members: Any


# Of models, and outputs of affine ones.
_TABLES: WeakKeyDictionary[ParametricModel, Any] = WeakKeyDictionary()
_OUTPUTS: WeakKeyDictionary[ParametricModel, Any] = WeakKeyDictionary()
_DOUBLE = np.dtype(float)
# What a fit returns where the series does not reach a step, and where derivatives are not finite.
_UNREACHED, _NOT_FINITE = 1, 2


def plain(array: Array) -> Array:
    """Return an array as the kernels take it."""
    flags = array.flags
    if array.dtype is _DOUBLE and flags.c_contiguous and flags.writeable:
        return array
    return np.require(array, float, ["C", "W"])


def lanes(count: int) -> int:
    """Return the next multiple of `LANES`."""
    return -(-count // LANES) * LANES


def tables(model: ParametricModel) -> Any:
    """Return the parts of a model that its steps need, as `native/steps.h` has them; made once.

    `left` times `right` is the change of the lower half of A by the parameters. `forcing` takes the generator
    state to what it feeds, degree by degree; `turned` takes it a step ahead; `reach` is the norm of the
    generator times the step; infinite where the series is not used. Of a model that is not affine the
    matrices are zeros: the caller makes its steps.
    """
    if (kept := _TABLES.get(model)) is not None:
        return kept
    line, n, p, m, affine = model.line, model.states, model.parameters, model.states // 2, model.affine
    q, lengths = model.W.shape[1], len(line.lengths)
    lower, rates = np.zeros((m, n)), np.zeros(m)
    left, right = np.zeros((p, m, 1)), np.zeros((p, 1, n))
    forcing, turned, reach = np.empty((0, 1, 0, m, q)), np.empty(0), np.full(lengths, np.inf)
    if affine is not None:
        # The changes of the lower half, factorised by their largest rank.
        U, s, Vt = np.linalg.svd(affine.A_slopes[:, m:], full_matrices=False)
        rank = max(1, int((s > 8 * np.finfo(float).eps * s[:, :1]).sum(axis=1).max()))
        left, right = U[:, :, :rank] * s[:, None, :rank], Vt[:, :rank]
        lower, rates = affine.A[m:], affine.A[:m, m:].diagonal()
        forcing, turned = _forcing(model, affine)
        if len(forcing):
            reach = np.abs(line.G).sum(axis=0).max(initial=0.0) * line.lengths
    kept = _TABLES[model] = structure(
        n=n,
        p=p,
        rank=left.shape[2],
        q=q,
        lengths=lengths,
        halvings=forcing.shape[1] - 1,
        degrees=forcing.shape[2],
        nodes=len(line.nodes),
        lower=plain(lower),
        left=plain(left),
        right=plain(right),
        rates=plain(rates),
        h=plain(line.lengths),
        forcing=plain(forcing),
        turned=plain(turned),
        reach=plain(reach),
        W=plain(model.W),
        log=logarithmic(model.unknowns).astype(float),
        which=np.require(line.which, np.int64, ["C"]),
        sample=np.require(line.sample_of(), np.int64, ["C"]),
    )
    return kept


def _forcing(model: ParametricModel, affine: Affine) -> tuple[Array, Array]:
    """Return the tables of forcing and of the generator's exponentials; empty if they are large."""
    # Of every length, its half, its quarter …: lengths x 1 + halvings x degrees x n/2 x q, and … x q x q.
    line = model.line
    drive = (affine.B @ (line.H * model.acting[:, None]) * model.w_scale)[model.states // 2 :]
    # Degree of the Taylor polynomial of exp for a matrix of this norm, as in `native/steps.h`.
    terms = np.cumprod(np.append(MAX_SERIES_NORM, MAX_SERIES_NORM / np.arange(2, 100)))
    degrees, identity = int(np.argmax(terms <= 1e-15)) + 1, np.eye(len(line.G))
    parts = min(1 + MAX_HALVINGS, int(FORCING_TABLE.value / max(1, len(line.lengths) * degrees * drive.size)))
    if not parts:
        return np.empty((0, 1, degrees, *drive.shape)), np.empty(0)
    forcing = np.empty((len(line.lengths), parts, degrees, *drive.shape))
    turned = np.empty((len(line.lengths), parts, *identity.shape))
    for length, halving in np.ndindex(len(line.lengths), parts):
        h, E = line.lengths[length] / 2**halving, identity
        for k in reversed(range(degrees)):  # by Horner's scheme
            forcing[length, halving, k] = drive @ E * (h / (k + 1))
            E = identity + line.G @ E * (h / (k + 1))
        turned[length, halving] = E
    return forcing, turned


def linear(model: ParametricModel, eta: Array) -> Linear:
    """Return room for the steps of a model at some coordinates (p), none of which is ready."""
    n, p, lengths = model.states, model.parameters, len(model.line.lengths)
    eta, ready = np.array(eta, dtype=float), np.zeros(lengths, dtype=bool)
    forward = np.zeros((lengths, n + len(model.line.G), lanes(n * (1 + p))))
    phis = np.zeros((lengths, 1 + p, n * lanes(n + p)))
    members = structure(
        wide=forward.shape[2], tall=phis.shape[2], eta=eta, ready=ready, forward=forward, phis=phis
    )
    return Linear(eta, ready, forward, phis, members)


def place(at: Linear, length: int, transition: Transition) -> None:
    """Insert a step for which the series does not converge fast enough."""
    step, derivatives = transition
    n = len(step)
    both = np.concatenate([step[None], derivatives]).transpose(2, 1, 0).reshape(step.shape[1], -1)
    at.forward[length, :, : both.shape[1]] = both
    phis = at.phis[length].reshape(1 + len(derivatives), n, -1)
    phis[0, :, :n], phis[1:, :, :n] = step[:, :n], derivatives[:, :, :n]
    at.ready[length] = True


def steps_at(model: ParametricModel, eta: Array) -> Linear:
    """Return the steps of all lengths at these coordinates (p)."""
    at, missed = linear(model, eta), np.zeros(len(model.line.lengths), dtype=bool)
    call("dynid_prepare", tables(model), at.members, missed)
    for length in missed.nonzero()[0].tolist():
        place(at, length, model.transition(eta, float(model.line.lengths[length])))
    return at


def transitions(at: Linear, states: int) -> list[Transition]:
    """Return steps of all lengths as NumPy has them, of a model of so many states."""
    width = states * (1 + len(at.eta))
    both = at.forward[:, :, :width].reshape(len(at.ready), -1, states, 1 + len(at.eta)).transpose(0, 3, 2, 1)
    return [Transition(parts[0], parts[1:]) for parts in np.ascontiguousarray(both)]


# --- the filter ------------------------------------------------------------------------------------


def padded(S: Array) -> Array:
    """Return a copy of a root (rows x columns), with columns of zeros after it."""
    return np.pad(S, ((0, 0), (0, -len(S) % LANES)))


def outputs(model: ParametricModel, eta: Array) -> Any:
    """Return C, its slopes, and the direct term with its slopes, for steps about these coordinates (p).

    Of an affine model C is that without the parameters, and the slopes are by their values; of any other both
    are at the coordinates.
    """
    if (kept := _OUTPUTS.get(model)) is not None:
        return kept
    direct, affine = model.direct(eta), model.affine
    C, C_slopes = model.output(eta) if affine is None else (affine.C, affine.C_slopes)
    samples, channels = direct.value.shape
    kept = structure(
        affine=int(affine is not None),
        channels=channels,
        samples=samples,
        C=plain(C),
        C_slopes=plain(C_slopes) if C_slopes.any() else None,
        direct=plain(direct.value),
        direct_slopes=None if direct.slopes is None else plain(direct.slopes),
    )
    if affine is not None:
        _OUTPUTS[model] = kept
    return kept


def record(measured: Array, weights: Array, origin: Array, limits: tuple[float, Array, Array]) -> Any:
    """Return what a pass reads.

    `measured`, `weights`: measured values, and one over the standard deviation of their noise (times x
    channels); `origin`: coordinates from which a divergence is measured (p). `limits`: part of their
    deviation, and most (p), that coordinates may be off the linearisation; and off the origin (p).
    """
    fraction, max_change, runaway = limits
    return structure(
        measured=plain(measured),
        weights=plain(weights),
        origin=plain(origin),
        most=plain(max_change),
        runaway=plain(runaway),
        part=float(fraction),
    )


# --- predictions -----------------------------------------------------------------------------------


class Carried(NamedTuple):
    """What a prediction carries from a block of samples to the next one: nodes that are done, and numbers."""

    node: NDArray[np.int64]
    numbers: Array


def carried(model: ParametricModel, beside: int, start: Array | None = None) -> Carried:
    """Return the beginning of a prediction from a first state (n; default: rest), with further numbers."""
    n = model.states
    numbers = np.zeros(lanes(n) + beside)
    numbers[:n] = 0.0 if start is None else start
    return Carried(np.zeros(1, dtype=np.int64), numbers)


def carried_free(model: ParametricModel, channels: int, start: Array | None = None) -> Carried:
    """Return the beginning of what `free` computes for so many channels."""
    return carried(model, channels * lanes(model.states), start)


def carried_sensitive(model: ParametricModel, start: Array) -> Carried:
    """Return the beginning of what `sensitive` computes from a first state (n)."""
    return carried(model, model.states * lanes(1 + model.parameters), start)


def free(
    model: ParametricModel, at: Linear, C: Array, direct: Array, before: Carried | None = None
) -> tuple[Array, Array]:
    """Return outputs from rest (times x channels), and their derivatives by the first state (… x n).

    `direct`: the direct term of these samples. `before`: what was carried to them, which changes; default:
    they are the first ones.
    """
    before = before or carried_free(model, len(C))
    outputs_at_rest, by_state = np.empty(direct.shape), np.empty((*direct.shape, model.states))
    arguments = len(C), plain(C), *before, len(direct), plain(direct)
    call("dynid_free", tables(model), at.members, *arguments, outputs_at_rest, by_state)
    return outputs_at_rest, by_state


def outputs_from(
    model: ParametricModel, at: Linear, C: Array, direct: Array, start: Array | None = None
) -> Array:
    """Return outputs from a first state (n; default: rest; times x channels)."""
    predicted, before = np.empty(direct.shape), carried_free(model, len(C), start)
    arguments = len(C), plain(C), *before, len(direct), plain(direct)
    call("dynid_free", tables(model), at.members, *arguments, predicted, None)
    return predicted


def sensitive(
    model: ParametricModel, at: Linear, C: Array, C_slopes: Array, direct: Array, before: Carried
) -> tuple[Array, Array, Array]:
    """Return outputs from a first state, states (times x n), and derivatives by the coordinates (… x p).

    `direct`, `before`: as of `free`; the latter is that of `carried_sensitive` before the first sample.
    """
    predicted, states = np.empty(direct.shape), np.empty((len(direct), model.states))
    by_parameter = np.empty((*direct.shape, model.parameters))
    varying = plain(C_slopes) if C_slopes.any() else None
    arguments = len(C), plain(C), varying, *before, len(direct), plain(direct)
    call("dynid_sensitive", tables(model), at.members, *arguments, predicted, states, by_parameter)
    return predicted, states, by_parameter


class _Fitted(NamedTuple):
    """The fit of a record: the first state (n), what `sensitive` and `triangles` return, and residuals.

    `by_state` (times x channels x n) are the derivatives by the first state.
    """

    start: Array
    outputs: Array
    residual: Array
    states: Array
    by_state: Array | None
    by_parameter: Array | None
    factors: Array | None
    counts: NDArray[np.int64]


class FirstState(NamedTuple):
    """How the first state is fitted.

    `rms`, `weights` (channels): what each channel is divided by, and then multiplied with; `root`: root of
    the prior covariance of the state (n x n). `rank`: singular values of the derivatives by the state below
    this part of the largest are none.
    """

    rms: Array
    weights: Array
    root: Array
    rank: float


def fitted(
    model: ParametricModel,
    eta: Array,
    values: Array,
    first: FirstState,
    *,
    kept: bool = True,
    factors: bool = True,
) -> _Fitted:
    """Return the fit of a record to `values` (times x channels), NaN where missing, at coordinates (p).

    `kept`: derivatives are kept, else held block by block; `factors`: False: first state and residuals are
    all that is computed. Raises NumericalError if the derivatives by the first state leave the range of
    double precision.
    """
    (samples, channels), n, p = values.shape, model.states, model.parameters
    kept = kept and factors
    fit = _Fitted(
        np.empty(n),
        np.empty((samples, channels)),
        np.empty((samples, channels)),
        np.empty((samples if factors else 0, n)),
        np.empty((samples, channels, n)) if kept else None,
        np.empty((samples, channels, p)) if kept else None,
        np.empty((channels, n + p + 1, n + p + 1)) if factors else None,
        np.zeros(channels, dtype=np.int64),
    )
    arguments = outputs(model, eta), _read(model, values, first), structure(**fit._asdict())
    missed = model.affine is None
    if not missed:
        missed = (done := call("dynid_fit", tables(model), None, plain(eta), *arguments)) == _UNREACHED
    if missed:
        done = call("dynid_fit", tables(model), steps_at(model, eta).members, plain(eta), *arguments)
    if done == _NOT_FINITE:
        finite("the sensitivity of the record", np.array(np.nan))
    return fit


def residual_rms(model: ParametricModel, etas: Array, values: Array, first: FirstState) -> Array:
    """Return the RMS of residuals (count x channels) of fits of an affine model at coordinates (count x p).

    NaN where the series does not reach a step, or the derivatives by the first state are not finite.
    """
    sizes = np.empty((len(etas), values.shape[1]))
    read, start = _read(model, values, first), np.empty(model.states)
    call("dynid_sizes", tables(model), len(etas), plain(etas), outputs(model, etas[0]), read, start, sizes)
    return sizes


def _read(model: ParametricModel, values: Array, first: FirstState) -> Any:
    """Return what a fit reads."""
    return structure(
        values=plain(values),
        rms=plain(first.rms),
        weights=plain(first.weights),
        initial=plain(model.initial),
        root=plain(first.root),
        rank=first.rank,
    )


class Triangles:
    """Triangular factors of derivatives and residuals side by side, of blocks of samples in turn.

    Householder reflections of blocks of rows, with columns in powers of two of their own size.
    """

    def __init__(self) -> None:
        self._factors, self._powers = np.zeros((0, 0, 0)), np.zeros((0, 0))
        self.counts = np.zeros(0, dtype=np.int64)  #: how many residuals there are

    def absorb(self, by_state: Array, by_parameter: Array, residual: Array) -> None:
        """Reflect derivatives (samples x channels x n, … x p), and residuals (samples x channels)."""
        samples, channels, n = by_state.shape
        if not len(self.counts):
            width = n + by_parameter.shape[2] + 1
            self._factors, self._powers = np.zeros((channels, width, width)), np.zeros((channels, width))
            self.counts = np.zeros(channels, dtype=np.int64)
        read = map(plain, (by_state, by_parameter, residual))
        written = self._powers, self._factors, self.counts
        call("dynid_triangles", samples, channels, n, by_parameter.shape[2], *read, *written)

    def over(self, rms: Array) -> Array:
        """Return the factors over numbers of the channels (channels x n + p + 1 x n + p + 1)."""
        units = np.where(self._powers > 0, self._powers / rms[:, None], 1.0)
        return np.asarray(self._factors * units[:, None])


def triangles(
    by_state: Array, by_parameter: Array, residual: Array, rms: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Return the triangular factors of derivatives and residuals side by side, over the channels' RMS.

    Channels x n + p + 1 x n + p + 1; and how many residuals there are (channels).
    """
    factors = Triangles()
    factors.absorb(by_state, by_parameter, residual)
    return factors.over(rms), factors.counts
