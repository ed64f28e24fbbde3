"""The schedule of filter passes, and its limit.

The last pass ends at the filter's fixed point, where each sample is linearised about the estimate before it.
This is near the maximum-likelihood point of the record, but not that point: with acceleration channels or
strong noise it can be several standard errors off, and more passes do not move it. The result gives the
distance (`identification/diagnostics/distance_to_optimum`); beyond half a standard error it is not `settled`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Array
from dynid.defaults import FILTER_PASSES
from dynid.errors import UsageError
from dynid.identification.estimators.estimate import Estimate, EstimationStage, Sweep
from dynid.identification.estimators.filter import Pass, ended, filter_pass, thinned
from dynid.identification.least_squares import thin_svd
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.progress import report_progress, tracked

# Noise below this part of the RMS is not assumed: the covariance would lose its digits.
_MIN_NOISE = 1e-4
# Variance of the prior of a later pass over that of the fit, where joints have nonlinear laws: hysteresis is
# linear over few deviations of its parameters. The pass before it then counts for a 30th of the estimate.
_LAW_PRIOR = 30.0
# The first pass assumes a noise that falls from twice the RMS to a twentieth, over an eighth of the record:
# far from the optimum early samples must not narrow the covariance, since the linearisation is wrong there.
_FIRST_NOISE = 2.0
_LAST_NOISE = 0.05
_FALL = 0.125
# Annealing, pass by pass: the noise assumed, over the RMS, and the part of the first spread of coordinates.
_ANNEALED = ((0.5, 1.0), (0.2, 0.5), (0.08, 0.25), (0.03, 0.15))


@dataclass(frozen=True)
class Filter:
    """Estimator: several passes of the filter of the augmented state.

    Where there are several records a pass takes one after the other. Each pass restarts from the last one's
    parameters with a fresh covariance (`_unit_prior`) and the noise of its residuals. They
    converge to the filter's fixed point, which is not exactly the maximum-likelihood point; where the two
    differ, more passes do not help.
    """

    passes: int = FILTER_PASSES.value  # number of passes over the record
    sigma_points: bool = False  # of joints with laws, in place of linearisation

    @property
    def name(self) -> str:
        """Its name in a scene."""
        return "sigma-point" if self.sigma_points else "filter"

    def __post_init__(self) -> None:
        if self.passes < 1:
            raise UsageError("the filter needs at least one pass")

    def run(self, likelihood: TimeLikelihood, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises Diverged if the parameters run away.
        """
        if self.sigma_points and any(record.superposes for record in likelihood.records):
            raise UsageError(
                "sigma points are for joints with nonlinear laws: the steps of a linear model are exact",
                remedy="Use method: filter.",
                names=("estimator.method", "estimator"),
            )
        check_one_clock(likelihood)
        check_states(likelihood, "the filter")
        histories = run_passes(likelihood, origin, self.passes, sigma_points=self.sigma_points)
        fit = likelihood.fit(last(likelihood, histories))
        return Estimate(fit, histories, [EstimationStage.at("filter", likelihood, fit)])


def check_one_clock(likelihood: TimeLikelihood) -> None:
    """Refuse records whose channels have clocks of their own (UsageError): a filter goes sample by sample."""
    if any(record.model.instruments.clocked for record in likelihood.records):
        raise UsageError(
            "a filter takes the samples of all channels together, and a channel has a clock of its own",
            remedy="Use method: auto, or output-error.",
            names=("estimator.method", "estimator"),
        )


def sigma_point_filter(**options: int) -> Filter:
    """Return the filter with sigma points."""
    return Filter(sigma_points=True, **options)


def last(likelihood: TimeLikelihood, sweeps: Sequence[Sweep]) -> Array:
    """Return the likeliest coordinates within the limits (p) of the Gaussian that sweeps end with.

    D. Simon, D. L. Simon, Int. J. Syst. Sci. 41 (2010) 159–171.
    """
    end = sweeps[-1][-1]
    return likelihood.priors.constrained(end.eta[-1], end.root)


def run_passes(
    likelihood: TimeLikelihood, origin: Array, passes: int, *, sigma_points: bool = False
) -> list[Sweep]:
    """Run passes of the filter.

    `origin`: coordinates of the initial parameters (p); `sigma_points`: of joints with laws, in place of
    linearisation. Raises Diverged if the parameters run away.
    """
    records = likelihood.records
    priors = [wide_prior(record, origin) for record in records]
    report_progress(f"filter pass 1 of {passes}")
    # Sigma points of the wide first prior lie where a law has no sense: the first of several passes has none.
    at_points = sigma_points and passes == 1
    sweeps = [_sweep(likelihood, priors, first_noise(likelihood), origin, sigma_points=at_points)]
    while len(sweeps) < passes:
        report_progress(f"filter pass {len(sweeps) + 1} of {passes}")
        fit = likelihood.fit(last(likelihood, sweeps))
        fits = list(zip(records, fit.parts, strict=True))
        priors = [_unit_prior(record, record_fit) for record, record_fit in fits]
        noise = [_floored(record, record_fit.noise) for record, record_fit in fits]
        sweeps[1:] = map(ended, sweeps[1:])
        sweeps.append(_sweep(likelihood, priors, noise, origin, sigma_points=sigma_points))
    return sweeps


def annealed_passes(likelihood: TimeLikelihood, origin: Array) -> list[Sweep]:
    """Run passes whose assumed noise and prior deviations decrease from one to the next.

    It takes longer than `run_passes` and converges from poorer initial guesses.

    `origin`: coordinates of the initial parameters (p). Raises Diverged if the parameters run away.
    """
    sweeps: list[Sweep] = []
    eta = origin
    for level, share in tracked(_ANNEALED, "annealed pass"):
        priors = [wide_prior(record, eta, share) for record in likelihood.records]
        sweeps.append(_sweep(likelihood, priors, [level * r.data.rms for r in likelihood.records], eta))
        eta = last(likelihood, sweeps)
    return sweeps


def chained(
    likelihood: TimeLikelihood,
    priors: Sequence[InitialState],
    passed: Callable[[int, TimeRecord, InitialState], Pass],
) -> Sweep:
    """Run one pass over each record; its estimate of the parameters is the prior of the next one.

    `likelihood`: the records; `priors`: of each record the prior of its first state; of the first one that
    of the parameters, too, which is combined with their priors. `passed`: runs the pass over a record,
    numbered from 0.
    """
    sweep: list[Pass] = []
    first = likelihood.priors.combined(priors[0])
    for k, (record, prior) in enumerate(zip(likelihood.records, priors, strict=True)):
        before = first
        if sweep:  # the prior of the first state, with coordinates as the pass before left them
            n, root = len(prior.state), np.zeros_like(prior.root)
            for here, rows in ((slice(n), prior.root[:n]), (slice(n, None), sweep[-1].root)):
                root[here, here] = np.linalg.qr(rows.T).R.T  # triangular
            before = InitialState(prior.state, sweep[-1].eta[-1], root)
        sweep.append(thinned(passed(k, record, before)))
    return sweep


def _sweep(
    likelihood: TimeLikelihood,
    priors: Sequence[InitialState],
    noise: Sequence[Array],
    origin: Array,
    *,
    sigma_points: bool = False,
) -> Sweep:
    """Run the filter over each record, at these assumed noises."""

    def passed(k: int, record: TimeRecord, prior: InitialState) -> Pass:
        n, size = record.model.states, len(prior.root)  # a triangular factor a sample
        record.system_model.evaluations += size**3 // (n**2 * (1 + record.model.parameters)) + 1
        if not record.superposes:
            from dynid.identification.estimators.law_filter import law_filter_pass  # of laws alone
            from dynid.identification.likelihood.nonlinear_record import NonlinearRecord

            assert isinstance(record, NonlinearRecord)
            return law_filter_pass(record, prior, noise[k], origin, sigma_points=sigma_points)
        return filter_pass(record.model, record.data.values, prior, noise[k], origin)

    return chained(likelihood, priors, passed)


def check_states(likelihood: TimeLikelihood, method: str) -> None:
    """Refuse records of loops with delays, of which no finite state is estimated sample by sample."""
    if any(record.system_model.delayed for record in likelihood.records):
        raise UsageError(
            f"{method} estimates a state, and that of a loop with a delay has what is under way in it, too",
            remedy="Use estimator: {method: auto} or output-error.",
            names=("estimator.method", "estimator"),
        )


def first_noise(likelihood: TimeLikelihood) -> list[Array]:
    """Return the noise that a first pass assumes, record by record (channels; first: times x channels)."""
    first, *others = likelihood.records
    samples = len(first.data.values)
    progress = np.arange(samples) / (_FALL * samples)
    falling = np.maximum(_LAST_NOISE, _FIRST_NOISE * np.exp(-progress))
    return [falling[:, None] * first.data.rms, *(_LAST_NOISE * record.data.rms for record in others)]


def wide_prior(record: TimeRecord, eta: Array, share: float = 1.0) -> InitialState:
    """Return a first prior: any state that the record allows, coordinates with a share of their spread."""
    hidden = np.zeros(record.nuisances - record.model.states)
    return InitialState(np.concatenate([record.model.initial, hidden]), eta, _wide_root(record, share))


def _unit_prior(record: TimeRecord, fit: RecordFit) -> InitialState:
    """Return a fresh prior around a fit that weighs as much as a single measured value."""
    # It is the fit's own covariance times the number of values, bounded by the wide one: wide enough not to
    # pull, narrow enough to keep the filter where its linearisation holds.
    root = _wide_root(record)
    rows = record.rows(fit, _floored(record, fit.noise))[:, :-1]
    _, s, Vt = thin_svd(rows @ root)
    share = np.zeros(len(root))
    values = np.count_nonzero(~np.isnan(fit.residual))
    share[: len(s)] = s**2 / (values if record.superposes else _LAW_PRIOR)
    return InitialState(fit.predicted.start, fit.eta, root @ (Vt.T / np.sqrt(1 + share)))


def _floored(record: TimeRecord, noise: Array) -> Array:
    """Return the noise to assume: not less than a small part of each channel's RMS."""
    return np.maximum(noise, _MIN_NOISE * record.data.rms)


def _wide_root(record: TimeRecord, share: float = 1.0) -> Array:
    """Return the root of the covariance of a wide prior."""
    n, size = record.nuisances, record.nuisances + record.model.parameters
    root = np.zeros((size, size))
    root[:n, :n] = record.root
    root[n:, n:] = np.diag([share * unknown.first_spread for unknown in record.unknowns])
    return root
