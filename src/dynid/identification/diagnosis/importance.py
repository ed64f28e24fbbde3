"""Check of the Gaussian posterior by Pareto-smoothed importance sampling; likelihood, BIC and evidence.

Samples of the Gaussian posterior are weighted by the likelihood that is not linearised. The initial state, of
which the prediction is a linear function, is integrated out with a flat prior: the sum of squares is that of
the best initial state, and half the logarithm of the determinant of its information, which depends on the
parameters, is subtracted. So is a deviation of the noise that is not given, with a prior in proportion to its
inverse.

Source: A. Vehtari, D. Simpson, A. Gelman, Y. Yao, J. Gabry, Pareto smoothed importance sampling, J. Mach.
Learn. Res. 25 (2024) 72: weights are reliable where the shape k of the generalised Pareto distribution of the
largest ones is below 0.7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError, UsageError
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.least_squares import STATE_RANK, thin_svd
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.statistics import TAIL_PROBABILITY
from dynid.parameters import values

#: Samples of the posterior, and the shape of the weights above which it is not Gaussian enough.
DRAWS, RELIABLE = 1000, 0.7
# Part of the samples that are effective above which weights hardly differ.
_EVEN_WEIGHTS = 0.95
# Rounds of further samples where those of the Gaussian posterior are not enough; their degrees of freedom.
_PROPOSAL_ROUNDS, _STUDENT_DEGREES = 4, 5.0
_PROPOSAL_SEED = 20261124
#: A residual of clean data is no smaller than this part of its channel's RMS.
_RESIDUAL_FLOOR = 1e-13


@dataclass(frozen=True, eq=False)
class PosteriorCheck:
    """Comparison of the Gaussian posterior with the one that is not linearised."""

    # `k_hat`, `effective`: shape of the distribution of the largest weights of samples of the Gaussian
    # posterior, and the effective number of these samples
    k_hat: float
    effective: float
    # `k_used`, `effective_used`: the same of the samples that the intervals are from: of Student's t
    # distribution, fitted to the weighted samples, where the Gaussian ones are not enough
    k_used: float
    effective_used: float
    # `mean`, `low`, `high`: means and 95 % intervals of the parameters (p) by the weights
    mean: Array
    low: Array
    high: Array
    log_evidence: float | None  # logarithm of the evidence; None where there is none
    no_evidence: str  # the reason for that

    @property
    def gaussian(self) -> bool:
        """True if the posterior is near enough to the Gaussian one.

        The shape of weights that hardly differ says nothing: then the effective number of samples decides.
        """
        return self.k_hat <= RELIABLE or self.effective >= _EVEN_WEIGHTS * DRAWS

    @property
    def warnings(self) -> list[str]:
        """The warning in words where the posterior is not Gaussian."""
        if self.gaussian:
            return []
        sure = "" if self.k_used <= RELIABLE else f", themselves uncertain (k = {self.k_used:.2f})"
        return [
            f"the posterior is not Gaussian (k = {self.k_hat:.2f} > {RELIABLE}): the standard errors are "
            f"nominal; identification/posterior has weighted intervals{sure}; measure longer or with less "
            "noise, or give priors"
        ]


@dataclass(frozen=True)
class LikelihoodSize:
    """Greatest log-likelihood of the records, with its numbers of observations and free parameters."""

    log_likelihood: float
    observations: int
    free: int

    @property
    def bic(self) -> float:
        """Bayesian information criterion (G. Schwarz, Ann. Statist. 6 (1978) 461–464); less is better."""
        return self.free * math.log(self.observations) - 2 * self.log_likelihood


def likelihood_size(likelihood: Likelihood, fit: Fit) -> LikelihoodSize:
    """Return the log-likelihood of the records at a fit, without priors.

    Initial states and deviations of the noise that are not given have their most likely values.
    """
    total, observations, free = 0.0, 0, len(likelihood.unknowns)
    for record, record_fit, level in zip(
        likelihood.records, fit.parts, likelihood.likeliest(fit), strict=True
    ):
        noise_given = ~np.isnan(record.stated_noise)
        counts = record.data.passed * record_fit.counts
        squares = np.where(noise_given, record_fit.size / level, 1.0) ** 2
        total -= float(counts @ (np.log(level) + squares / 2 + math.log(2 * math.pi) / 2))
        total -= record.log_determinant()
        observations += int(record_fit.counts.sum())
        free += record.noise_coefficients
        free += len(_state_strength(record, record_fit, level)) + int(np.count_nonzero(~noise_given))
    return LikelihoodSize(total, observations, free)


def posterior_check(posterior: Posterior) -> PosteriorCheck:
    """Weight samples of the Gaussian posterior by the likelihood that is not linearised.

    Raises UsageError if arviz-stats is not installed, or a robust loss was used.
    """
    try:
        import arviz_stats.base  # noqa: F401
    except ImportError:
        raise UsageError(
            "the check of the posterior needs arviz-stats, which is not installed",
            remedy="Install it with: pip install dynid[posterior]",
            names=("posterior_check",),
        ) from None
    if posterior.robust:
        raise UsageError(
            "the check of the posterior needs a likelihood, which a robust loss has not",
            remedy="Leave `loss` or `posterior_check` out.",
            names=("posterior_check",),
        )
    likelihood, fit = posterior.likelihood, posterior.fit
    triangle = np.asarray(np.linalg.qr(posterior.gaussian_root.T, mode="r"))
    root = (triangle * np.sign(triangle.diagonal())[:, None]).T  # the same whatever the signs of its factors
    target = _Target(posterior)
    first = used = _weighted(target, likelihood, fit.eta, root, math.inf)
    for _ in range(_PROPOSAL_ROUNDS):
        if used.k_hat <= RELIABLE or used.effective >= _EVEN_WEIGHTS * DRAWS:
            break
        # A proposal with heavy tails, fitted to the weighted samples, and never narrower than the Gaussian.
        mean = used.weight @ used.eta
        apart = np.sqrt(used.weight)[:, None] * (used.eta - mean)
        wider = np.asarray(np.linalg.cholesky(apart.T @ apart + root @ root.T))
        student = _weighted(target, likelihood, mean, wider, _STUDENT_DEGREES)
        if student.k_hat >= used.k_hat and student.effective <= used.effective:
            break
        used = student
    theta = values(likelihood.unknowns, used.eta)
    ends = []
    for column in theta.T:  # weighted quantiles
        order = np.argsort(column)
        cumulated = np.cumsum(used.weight[order]) - used.weight[order] / 2
        ends.append(np.interp([TAIL_PROBABILITY, 1 - TAIL_PROBABILITY], cumulated, column[order]))
    low, high = np.transpose(ends)
    reason = _no_evidence(likelihood)
    evidence = None
    if not reason:
        evidence = likelihood_size(likelihood, fit).log_likelihood + target.prior + used.log_mean
    return PosteriorCheck(
        first.k_hat,
        first.effective,
        used.k_hat,
        used.effective,
        used.weight @ theta,
        low,
        high,
        evidence,
        reason,
    )


class _Weighted(NamedTuple):
    """Samples inside the limits (samples x p) with their smoothed weights (samples), which add up to 1.

    `log_mean`: logarithm of the mean weight of all samples, against the likelihood at the estimate.
    """

    eta: Array
    weight: Array
    k_hat: float
    log_mean: float

    @property
    def effective(self) -> float:
        """Effective number of samples."""
        return float(1 / np.sum(self.weight**2))


def _weighted(target: _Target, likelihood: Likelihood, mean: Array, root: Array, freedom: float) -> _Weighted:
    """Weight samples of a Gaussian (infinite `freedom`) or Student's t distribution by the target."""
    from arviz_stats.base import array_stats  # type: ignore[attr-defined]
    from scipy.special import gammaln

    p, generator = len(mean), np.random.default_rng(_PROPOSAL_SEED)
    drawn = generator.standard_normal((DRAWS, p))
    if math.isfinite(freedom):
        drawn /= np.sqrt(generator.chisquare(freedom, DRAWS) / freedom)[:, None]
    square = np.sum(drawn**2, axis=1)
    if math.isfinite(freedom):
        constant = gammaln((freedom + p) / 2) - gammaln(freedom / 2) - p * math.log(freedom * math.pi) / 2
        density = constant - (freedom + p) / 2 * np.log1p(square / freedom)
    else:
        density = -p * math.log(2 * math.pi) / 2 - square / 2
    density = density - np.log(np.abs(np.linalg.det(root)))
    eta = mean + drawn @ root.T
    ratio, priors = np.full(DRAWS, -np.inf), likelihood.priors
    for k in np.flatnonzero(((eta >= priors.low) & (eta <= priors.high)).all(axis=1)):
        ratio[k] = target.at(eta[k]) - density[k]
    there = np.isfinite(ratio)
    if np.count_nonzero(there) < DRAWS // 10:
        raise UsageError(
            "the check of the posterior fails: nearly all of its samples are beyond the limits, or have no "
            "response",
            remedy="Widen the limits, or leave `posterior_check` out.",
            names=("posterior_check",),
        )
    # It takes the negative logarithms of the ratios, as log-likelihoods are for leave-one-out.
    smoothed, shape = array_stats.psislw(-ratio[there])  # type: ignore[no-untyped-call]
    weight = np.exp(smoothed - np.max(smoothed))
    largest = float(ratio[there].max())
    log_mean = largest + math.log(float(np.exp(ratio[there] - largest).sum()) / DRAWS)
    return _Weighted(eta[there], weight / weight.sum(), float(shape), log_mean)


class _Target:
    """Logarithm of the posterior, over its value at the estimate."""

    def __init__(self, posterior: Posterior) -> None:
        self.likelihood, self.noise = posterior.likelihood, posterior.noise
        self._ranks: list[int] = []
        fits = zip(self.likelihood.records, posterior.fit.parts, self.noise, strict=True)
        self._ranks = [len(_state_strength(*record_and_fit)) for record_and_fit in fits]
        self._taken = [
            record.nuisance_degrees(record_fit, noise)
            for record, record_fit, noise in zip(
                self.likelihood.records, posterior.fit.parts, self.noise, strict=True
            )
        ]
        priors = self.likelihood.priors
        misfit = float(np.sum(priors.residual(posterior.fit.eta) ** 2)) / 2
        scale = (
            np.log(priors.deviations[priors.has_prior]).sum()
            + priors.has_prior.sum() * math.log(2 * math.pi) / 2
        )
        #: Logarithm of the density of the priors at the estimate.
        self.prior = float(-misfit - scale)
        self._start = self._absolute(posterior.fit.eta)

    def at(self, eta: Array) -> float:
        """Return the logarithm at coordinates (p); minus infinity where there is no response."""
        try:
            return self._absolute(eta) - self._start
        except (DynidError, np.linalg.LinAlgError):
            return -math.inf

    def _absolute(self, eta: Array) -> float:
        total = -float(np.sum(self.likelihood.priors.residual(eta) ** 2)) / 2
        records = zip(self.likelihood.records, self.noise, self._ranks, self._taken, strict=True)
        for record, noise, rank, nuisances in records:
            record_fit = record.fit(eta, record.data.values, noise)
            counts = record.data.passed * record_fit.counts
            size = np.maximum(record_fit.size, _RESIDUAL_FLOOR * record.data.rms)
            with_given_noise = -counts * (size / noise) ** 2 / 2
            free = -np.maximum(counts - nuisances, 1.0) * np.log(size / noise)
            total += float(np.where(np.isnan(record.stated_noise), free, with_given_noise).sum())
            total -= float(np.log(_state_strength(record, record_fit, noise, rank)).sum())
        return total


def _state_strength(record: RecordLikelihood, fit: RecordFit, noise: Array, rank: int | None = None) -> Array:
    """Return the singular values of the sensitivity to the initial state that count, or so many."""
    if not isinstance(record, TimeRecord):
        return np.zeros(0)
    s = thin_svd(record.by_start(fit, noise))[1]
    return s[s > STATE_RANK * s.max(initial=0.0)] if rank is None else s[:rank]


def _no_evidence(likelihood: Likelihood) -> str:
    """Return why the evidence of a model is not defined; empty where it is."""
    priors, records = likelihood.priors, likelihood.records
    without = [
        name for name, has_prior in zip(likelihood.names, priors.has_prior, strict=True) if not has_prior
    ]
    reasons = []
    if without:
        reasons.append(f"no prior of {', '.join(without)}")
    if any(isinstance(record, TimeRecord) and not record.model.known.all() for record in records):
        reasons.append("the initial state has no prior")
    if any(np.isnan(record.stated_noise).any() for record in records):
        reasons.append("the noise is not given")
    return "; ".join(reasons)
