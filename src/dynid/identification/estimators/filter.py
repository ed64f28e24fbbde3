"""The filter of the augmented state, one pass over the record.

Source: K. T. Yang 1997, eqs 19–20 (Detchmendy–Sridhar), which is the Kalman–Bucy filter of the augmented
state with R = (2 Q)^-1. It is split here into exact propagation between samples and a measurement update,
both on a square root S of the covariance P = S S^T (J. E. Potter; G. J. Bierman, Factorization Methods for
Discrete Sequential Estimation, 1977, ch. II). P is never formed: it is positive semidefinite and its
variances are not negative by construction, whatever step, stiffness and weighting, and small variances have
twice the digits that they would have in P itself.

Of eq 20 the term ½ k W⁻¹ kᵀ, an unmodelled input, is dropped: forces are taken as known and joints as
constant, so that between samples nothing is added to P.

Between samples the physical part is propagated exactly at parameters near the estimate, and to first order in
the difference of their values: in these a short step is nearly linear, in their logarithms it is not. It is
linearised anew where a coordinate has changed by its own standard deviation. The error of this first order is
then some thousandths of that of the filter itself, which linearises about an estimate with errors of that
size; so a pass takes some tens of matrix exponentials, not one a sample, and hardly more over a longer
record.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from dynid.arrays import Array
from dynid.defaults import LINEARISED
from dynid.errors import Diverged
from dynid.identification.information import RECORD
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.likelihood.state_deviations import stored_rows
from dynid.identification.systems.parametric_model import DirectTerm, ParametricModel
from dynid.native import call, compiled, structure
from dynid.parameters import Parameter, logarithmic

#: How far a coordinate may move before steps are linearised anew: in its standard deviations, and at most.
LINEARISED_DEVIATIONS, MAX_LINEARISED_CHANGE = LINEARISED.value, 0.1
# A logarithm this far from its start has diverged: a factor of a million; and any other, in its unit.
RUNAWAY, RUNAWAY_UNITS = float(np.log(1e6)), 1e6
# Squares between these neither overflow nor lose digits.
_MIN_SQUARE, _MAX_SQUARE = 1e-280, 1e280


Walk: TypeAlias = Callable[..., Array]
"""Filters a record: see `_walk`."""


class Outputs(NamedTuple):
    """Outputs about some coordinates: C (channels x n), what the inputs add at once, and their slopes."""

    C: Array
    C_slopes: Array
    direct: DirectTerm


class _LinearisedStep(NamedTuple):
    """``forward`` (n (1 + p) x n + q) takes [x, w] to the next state and its derivatives by the coordinates.

    `phi` (n x n) is its part of x, `phi_slopes` (p x n n) the derivatives of that.
    """

    forward: Array
    phi: Array
    phi_slopes: Array


class Linearised:
    """The steps of a model about some coordinates, computed when they are needed.

    `part`: how far a coordinate may move, in its deviations; `origin`: coordinates whose delays the timeline
    of the model has (p): it is linear in delays about these.
    """

    def __init__(self, model: ParametricModel, fraction: float, origin: Array) -> None:
        self._model, self._part = model, fraction
        self._origin, self._delays = origin.copy(), model.follows_delays(origin)
        self._steps: dict[int, _LinearisedStep] = {}
        self._outputs: Outputs | None = None
        self._log, self._most = logarithmic(model.unknowns), _max_changes(model)
        self._every_log = bool(self._log.all())
        self.eta = np.full(model.parameters, np.nan)

    def follow(self, eta: Array, spread: Array) -> None:
        """Linearise anew if coordinates of these deviations (p) have left the present ones."""
        near = np.abs(eta - self.eta) <= np.minimum(self._part * spread, self._most)
        if not np.all(near | (self._delays & (self.eta == self._origin))):
            self.eta = np.where(self._delays, self._origin, eta)
            self._steps.clear()
            self._outputs = None

    def growth(self, eta: Array) -> tuple[Array, Array]:
        """Return what slopes are multiplied by (p): for the change from the steps, and for the slope here.

        Of a logarithm the former is the relative change of the value, to second order.
        """
        left = eta - self.eta
        growth = left + left * left / 2
        if self._every_log:
            return growth, 1 + growth
        return np.where(self._log, growth, left), np.where(self._log, 1 + growth, 1.0)

    def outputs(self, eta: Array, sample: int) -> tuple[Array, Array, Array, Array | float]:
        """Return C (channels x n), its slopes, and the direct term of a sample (channels) with its slopes."""
        affine = self._model.affine
        if self._outputs is None:
            self._outputs = Outputs(*self._model.output(self.eta), self._model.direct(self.eta))
        (C, slopes, direct) = self._outputs
        if affine is not None:
            change = np.exp(eta)[:, None, None] * affine.C_slopes
            return affine.C + change.sum(axis=0), change, direct.value[sample], 0.0
        growth, here = self.growth(eta)
        moved = slopes * here[:, None, None]
        C = C + np.einsum("p,pcn->cn", growth, slopes)
        if direct.slopes is None:
            return C, moved, direct.value[sample], 0.0
        direct_slopes = direct.slopes[:, sample]
        return C, moved, direct.value[sample] + growth @ direct_slopes, direct_slopes * here[:, None]

    def step(self, length: int) -> _LinearisedStep:
        """Return the step of a length of the timeline."""
        if length not in self._steps:
            n = self._model.states
            step, slopes = self._model.transition(self.eta, float(self._model.line.lengths[length]))
            forward = np.concatenate([step[None], slopes]).reshape(-1, step.shape[1])
            phi_slopes = slopes[:, :, :n].reshape(len(slopes), n * n)
            self._steps[length] = _LinearisedStep(forward, step[:, :n], phi_slopes)
        return self._steps[length]


class Pass(NamedTuple):
    """One pass over a record.

    `eta` and `deviations`: coordinates and their standard deviations (times x p); `states` and
    `state_deviations`: physical states and theirs (times x n, scaled); `root`: a root of the coordinates'
    covariance after the last sample (p x any); `innovations`: normalised by their deviations (times x
    channels; NaN where a sample is missing), if known; `whole`: a root of the
    covariance of state (scaled) and coordinates after the last sample (n + p x any), if known.
    """

    eta: Array
    deviations: Array
    states: Array
    state_deviations: Array
    root: Array
    innovations: Array | None = None
    whole: Array | None = None


def filter_pass(
    model: ParametricModel,
    measured: Array,
    prior: InitialState,
    deviation: Array,
    origin: Array,
    fraction: float = LINEARISED_DEVIATIONS,
    walk: Walk | None = None,
) -> Pass:
    """Run the filter once over the record.

    `measured`: measured values (times x channels); NaN where a sample is missing; `prior`: state, parameters
    and covariance before the first sample. `deviation`: assumed standard deviation of each channel's noise
    (channels) or of each sample (times x channels); `origin`: coordinates from which a divergence is
    measured (p). `fraction`: how far a coordinate may move, in its deviations, before steps are linearised
    anew; 0: every sample; `walk`: what filters the samples, default the steps of a linear model. Raises
    Diverged if a parameter becomes non-finite or leaves its start by a factor of a million.
    """
    model = model.moved(prior.eta)
    n, p, sampling = model.states, model.parameters, model.sampling
    weight = np.broadcast_to(1 / deviation, measured.shape)
    if sampling is not None:
        measured, weight = sampling.spread(measured), np.nan_to_num(sampling.spread(weight), nan=1.0)
    samples = len(measured)
    z, S = np.concatenate([prior.state, prior.eta]), prior.root.copy()
    sizes = {"eta": p, "deviations": p, "states": n, "state_deviations": n}
    history = {name: np.empty((samples, size)) for name, size in sizes.items()}
    innovations = np.full(measured.shape, np.nan)
    run = _walk_compiled if compiled() and not model.instruments.unknown_delays else _walk
    run = walk or run
    root = run(model, measured, weight, z, S, origin, history | {"innovations": innovations}, fraction)
    rows = {name: model.own(array) for name, array in history.items()}
    return Pass(**rows, root=root[-p:], innovations=model.gathered(innovations), whole=root)


def _walk(
    model: ParametricModel,
    measured: Array,
    weight: Array,
    z: Array,
    S: Array,
    origin: Array,
    history: Mapping[str, Array],
    fraction: float,
) -> Array:
    """Filter the record, from state and root before the first sample; return the last root."""
    # The arrays of `history`, as in `Pass`, are filled in.
    n = model.states
    eta, deviations, states, bands, innovations = history.values()
    present = [np.flatnonzero(row).tolist() for row in ~np.isnan(measured)]
    vary = bool(model.output(z[n:])[1].any()) or model.affine is None
    expected = measured if vary else measured - model.direct(z[n:]).value
    H = np.zeros((measured.shape[1], len(z)), dtype=z.dtype)
    steps, spread, limits = Linearised(model, fraction, z[n:]), _lengths(S), _run_away_limits(model.unknowns)
    steps.follow(z[n:], spread[n:])
    H[:, :n] = model.output(z[n:])[0]
    for node, sample in enumerate(model.line.sample_of().tolist()):
        if node:
            steps.follow(z[n:], spread[n:])
            # State and root from the node before this one: S turns into F S.
            step, (growth, here) = steps.step(int(model.line.which[node - 1])), steps.growth(z[n:])
            moved = (step.forward @ np.concatenate([z[:n], model.W[node - 1]])).reshape(-1, n)
            phi = step.phi + (growth @ step.phi_slopes).reshape(n, n)
            z[:n] = moved[0] + growth @ moved[1:]
            S[:n] = np.concatenate([phi, (moved[1:] * here[:, None]).T], axis=1) @ S
        if sample < 0:
            continue
        innovation = expected[sample]
        if vary:
            H[:, :n], C_slopes, direct, direct_slopes = steps.outputs(z[n:], sample)
            H[:, n:] = (C_slopes @ z[:n] + direct_slopes).T
            innovation = innovation - direct
        innovation = innovation - H[:, :n] @ z[:n]
        whitened = H * weight[sample][:, None], innovation * weight[sample]
        z += _update(S, *whitened, present[sample], innovations[sample])
        if not (np.abs(z[n:] - origin) < limits).all():
            check_run_away(model.unknowns, z[n:], origin)
        spread = _lengths(S)
        eta[sample], deviations[sample] = z[n:], spread[n:]
        states[sample], bands[sample] = z[:n], spread[:n]
    return S


def _walk_compiled(
    model: ParametricModel,
    measured: Array,
    weight: Array,
    z: Array,
    S: Array,
    origin: Array,
    history: Mapping[str, Array],
    fraction: float,
) -> Array:
    """Filter the record by the kernel; steps for which its series does not converge are computed here."""
    from dynid.identification.systems import kernels

    n, nodes = model.states, len(model.line.nodes)
    at, padded, spread = kernels.linear(model, z[n:]), kernels.padded(S), _lengths(S)[n:].copy()
    record = kernels.record(
        measured, weight, origin, (fraction, _max_changes(model), _run_away_limits(model.unknowns))
    )
    filled = structure(**history)
    outputs, about, node = kernels.outputs(model, at.eta), at.eta.copy(), 0
    while node < nodes:
        read = kernels.tables(model), at.members, outputs, record
        node = call("dynid_filter", *read, node, z, padded, padded.shape[1], spread, filled)
        if node < 0:
            check_run_away(model.unknowns, z[n:], origin)
        if node < nodes:
            length = int(model.line.which[node - 1])
            kernels.place(at, length, model.transition(at.eta, float(model.line.lengths[length])))
            if model.affine is None and not np.array_equal(about, at.eta):
                outputs, about = kernels.outputs(model, at.eta), at.eta.copy()
    return padded[:, : len(S)]


def _lengths(S: Array) -> Array:
    """Return the lengths of the rows of a root, however large or small."""
    with np.errstate(over="ignore", under="ignore"):
        squares = np.einsum("ij,ij->i", S, S)
    if squares.min() > _MIN_SQUARE and squares.max() < _MAX_SQUARE:
        return np.asarray(np.sqrt(squares))
    unit = np.abs(S).max(axis=1)  # squares of large units overflow
    shares = S / np.where(unit > 0, unit, 1.0)[:, None]
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", shares, shares)) * unit)


def _update(S: Array, H: Array, innovation: Array, present: list[int], normalised: Array) -> Array:
    """Take one sample into account, in units of its noise (Potter); return the correction (n + p)."""
    # S changes in place; into `normalised` (channels) go the innovations over their deviations, each given
    # the channels before it.
    correction = np.zeros(len(S), dtype=S.dtype)
    for channel in present:
        h = H[channel]
        phi = h @ S
        spread = float(phi @ phi) + 1.0
        gain = S @ phi / spread
        unexplained = innovation[channel] - h @ correction
        normalised[channel] = unexplained / math.sqrt(spread)
        correction += gain * unexplained
        S -= np.outer(gain / (1 + math.sqrt(1 / spread)), phi)
    return correction


def _max_changes(model: ParametricModel) -> Array:
    """Return how far coordinates may move at the most before steps are linearised anew (p)."""
    return np.array([MAX_LINEARISED_CHANGE * unknown.first_spread / 2 for unknown in model.unknowns])


def _run_away_limits(unknowns: Sequence[Parameter]) -> Array:
    """Return how far from their origin coordinates have diverged (p)."""
    return np.array(
        [RUNAWAY if unknown.logarithmic else RUNAWAY_UNITS * unknown.first_spread for unknown in unknowns]
    )


def check_run_away(
    unknowns: Sequence[Parameter], eta: Array, origin: Array, remedy: str = RECORD.astray
) -> None:
    """Refuse coordinates (p) that are not finite or a factor of a million from their origin."""
    away = ~(np.abs(eta - origin) < _run_away_limits(unknowns))
    if away.any():
        raise run_away([unknown.name for unknown, bad in zip(unknowns, away, strict=True) if bad], remedy)


def run_away(names: list[str], remedy: str = RECORD.astray) -> Diverged:
    """Return the error that names parameters that diverged."""
    several = len(names) > 1
    return Diverged(
        f"the estimate{'s' * several} of {', '.join(names)} {'run' if several else 'runs'} away from "
        f"{'their starts' if several else 'its start'} by a factor of more than 1e6",
        remedy=remedy,
        names=names,
    )


def thinned(history: Pass) -> Pass:
    """Return a pass with the rows that are stored; innovations are kept whole."""
    rows = stored_rows(len(history.eta))
    if rows.step == 1:
        return history
    names = ("eta", "deviations", "states", "state_deviations")
    # Copies: a view would keep all of it in memory.
    return history._replace(**{name: getattr(history, name)[rows].copy() for name in names})


def ended(sweep: Sequence[Pass]) -> list[Pass]:
    """Return passes with their last rows alone, as of those between the first and the last one."""
    names = ("eta", "deviations", "states", "state_deviations")
    return [
        history._replace(innovations=None, **{name: getattr(history, name)[-1:].copy() for name in names})
        for history in sweep
    ]
