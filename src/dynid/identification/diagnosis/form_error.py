"""Errors of the form of a model that its residuals from a modal survey would need.

The scatter of a survey says how far its values are from those of the structure, not how far the structure is
from its model. Where a fit for the scatter is rejected, an error e of the form, relative, of each quantity
would make the residuals as large as expected: ``sum r^2 / (scatter^2 + (e size)^2) = nu - 2``, nu being the
degrees of freedom of the quantity: the posterior mean of a variance with Jeffreys' prior (A. Gelman et al.,
Bayesian Data Analysis, 3rd ed. 2013, sec. 2.6). The likeliest one, with nu, is often far too small where nu
is 3 or 4. This is a proposal: the scene decides, by `model_error`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Array
from dynid.defaults import LACK_OF_FIT
from dynid.errors import DynidError
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.lack_of_fit import ModelComparison, compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.modal_record import ModalFit, ModalRecord
from dynid.identification.likelihood.priors import Priors
from dynid.number_format import p_text

# Error with which the search begins: a fit for the scatter alone is led by the values of the smallest one.
_COMPROMISE = 0.1
# Rounds of fit and error, and the relative change of the errors below which they have settled: an error of
# few values is known to a fifth at best.
_MAX_ROUNDS, _SETTLED_REL_CHANGE = 30, 0.01
# Deviations between a prior and the survey above which wider priors are named: one in 22 by chance.
_PRIOR_CONFLICT_DEVIATIONS = 2.0
# Factor by which the priors are widened to see if they decide.
_WIDER_PRIORS = 10.0


@dataclass(frozen=True, eq=False)
class FormError:
    """Errors of the form that the residuals need, and the fit with them."""

    quantities: tuple[str, ...]  # names of the quantities
    error: Array  # their errors, relative (quantities), rounded upwards to two digits
    p: float  # the p-value of the residuals with these errors
    priors: tuple[str, ...] = ()  # parameters whose priors decide: with wider ones the residuals are scatter

    @property
    def statement(self) -> str:
        """Return the errors that would explain the survey, with the keys that state them."""
        errors = [(name, e) for name, e in zip(self.quantities, self.error.tolist(), strict=True) if e > 0]
        parts = " and ".join(f"{100 * e:.2g} % of {name}" for name, e in errors)
        keys = ", ".join(f"{name}: {e:.2g}" for name, e in errors)
        said = (
            "the scatter of the survey alone does not explain its residuals; an error of the model's form of "
            f"{parts} would ({p_text(self.p, 1)}): correct the model or the scatter, or state such an error, "
            f"measurement.modes.model_error: {{{keys}}}, which then counts in fit, intervals and verdict"
        )
        if self.p <= LACK_OF_FIT.value:
            said = (
                "no error of the model's form (measurement.modes.model_error) explains the residuals of the "
                "survey: correct the model, its starts or its priors"
            )
        if self.priors:
            said += f"; or give wider priors of {', '.join(self.priors)}, with which the scatter explains it"
        return said


def needed_form_error(posterior: Posterior) -> FormError | None:
    """Return the errors of the form that an estimate needs; None where the scatter explains the modes."""
    likelihood = posterior.likelihood
    at = next((k for k, record in enumerate(likelihood.records) if isinstance(record, ModalRecord)), None)
    if at is None or posterior.comparison.scatter_p > LACK_OF_FIT.value:
        return None
    record = likelihood.records[at]
    assert isinstance(record, ModalRecord)
    bare = record.error
    try:
        error = np.maximum(bare, _COMPROMISE)
        fit = refine(_with_error(likelihood, at, error), posterior.fit.eta).fit
        for _ in range(_MAX_ROUNDS):
            before, error = error, np.maximum(bare, _form_errors(likelihood, at, error, fit))
            fit = refine(_with_error(likelihood, at, error), fit.eta).fit
            if np.all(np.abs(error - before) <= _SETTLED_REL_CHANGE * error):
                break
        units = 10.0 ** (np.floor(np.log10(np.where(error > 0, error, 1.0))) - 1)  # upwards to two digits
        rounded = np.array([float(f"{e:.2g}") for e in np.abs(np.ceil(error / units - 1e-9)) * units])
        compared = _compared(_with_error(likelihood, at, rounded), fit)
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        return None
    names = tuple(channel.name for channel in record.channels)
    return FormError(names, rounded, compared.scatter_p, _deciding_priors(posterior))


def _with_error(likelihood: Likelihood, at: int, error: Array) -> Likelihood:
    """Return the likelihood with other errors of the form of its modes, the record at this position."""
    records = list(likelihood.records)
    modes = records[at]
    assert isinstance(modes, ModalRecord)
    records[at] = modes.with_error(error)
    return replace(likelihood, records=tuple(records))


def _compared(likelihood: Likelihood, fit: Fit) -> ModelComparison:
    return compare_models(likelihood, refine(likelihood, fit.eta).fit)


def _form_errors(likelihood: Likelihood, at: int, error: Array, fit: Fit) -> Array:
    """Return the errors that belong to the residuals of a fit for these ones (quantities)."""
    weighted = _with_error(likelihood, at, error)
    modes = weighted.records[at]
    assert isinstance(modes, ModalRecord)
    record_fit = fit.parts[at]
    degrees = compare_models(weighted, fit).tables[0].degrees
    errors = np.zeros(len(error))
    for k, (scatter, size) in enumerate(modes.scatter_and_size):
        residual = record_fit.residual[: len(scatter), k] * modes.spread[k]
        if modes.root is not None:
            assert isinstance(record_fit, ModalFit)
            residual = modes.measured_columns[k] - record_fit.modes.columns[k]
        there = ~np.isnan(residual)
        expected = max(float(degrees[k]) - 2, float(degrees[k]) / 3)
        errors[k] = _form_error(residual[there], scatter[there], size[there], expected)
    return errors


def _form_error(residual: Array, scatter: Array, size: Array, degrees: float) -> float:
    """Return e >= 0 with ``sum r^2 / (scatter^2 + (e size)^2) = degrees``, by bisection of its logarithm."""

    def excess(error: float) -> float:
        return float(np.sum(residual**2 / (scatter**2 + (error * size) ** 2))) - degrees

    if degrees <= 0 or excess(0.0) <= 0:
        return 0.0
    low, high = 1e-6, 1.0
    if excess(low) <= 0:
        return 0.0
    while excess(high) > 0:
        high *= 2
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def _deciding_priors(posterior: Posterior) -> tuple[str, ...]:
    """Return the parameters whose priors contradict the survey, if wider ones let the scatter explain it."""
    likelihood = posterior.likelihood
    names = [
        name
        for name, apart in zip(likelihood.names, posterior.prior_conflict, strict=True)
        if apart > _PRIOR_CONFLICT_DEVIATIONS
    ]
    if not names:
        return ()
    try:
        priors = Priors.of(likelihood.unknowns)
        wider = replace(priors, deviations=_WIDER_PRIORS * priors.deviations)
        compared = _compared(Likelihood(likelihood.records, stated_priors=wider), posterior.fit)
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        return ()
    return tuple(names) if compared.scatter_p > LACK_OF_FIT.value else ()
