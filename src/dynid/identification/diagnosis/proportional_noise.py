"""Residuals that grow with the response: noise in proportion to it, or a model that is wrong at resonances.

Of noise of one deviation, sizes of residuals and of responses are independent. Spearman's rank correlation of
the two tests that, whatever the distribution of the noise (M. G. Kendall, Rank Correlation Methods, 4th ed.
1970, ch. 5). Where they are correlated, frequency responses are fitted again with noise in proportion to the
response: if the model then has no lack of fit, the noise explains the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.defaults import LACK_OF_FIT, RESIDUAL_GROWTH
from dynid.errors import DynidError
from dynid.identification.estimators.maximum_likelihood import refine, with_noise
from dynid.identification.likelihood.frf_record import FrfLikelihood, FrfRecord
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.frf_measurement import unstacked
from dynid.identification.residual_tests import is_coloured, whiteness
from dynid.number_format import p_text, with_error
from dynid.parameters import rates, values

# Rank correlations below this one do not matter, however significant.
_MATTERS = 0.2
# Multiplications of one evaluation of frequency responses beyond which no other noise is tried.
_MAX_WORK = 3e7
# Residuals below this part of the signal are round-off and holds, whatever their sizes.
_RESIDUAL_ROUND_OFF_SHARE = 1e-6
# How much larger the logarithm of the likelihood is with noise in proportion, for it to be suggested.
_MIN_GAIN = 5.0
# Most estimates that a sentence has, and what makes parts of one.
_NAMED = 3
_FAILURES = (DynidError, ArithmeticError, np.linalg.LinAlgError)


class GrowingResiduals(NamedTuple):
    """Residuals that grow with the response."""

    channels: tuple[tuple[int, int], ...]  # places of these channels, record by record (record, column)
    statement: str  # what they suggest, in words
    explained: bool = False  # True if noise in proportion to the response leaves no lack of fit


def growing_residuals(likelihood: Likelihood, fit: Fit, names: Sequence[str]) -> GrowingResiduals | None:
    """Return residuals of a fit that grow with the response, and what that suggests; None where none do.

    `likelihood`, `fit`: records and the fit; `names`: names of all channels, record by record.
    """
    growing, correlations, channel = [], [], 0
    for k, (record, record_fit) in enumerate(zip(likelihood.records, fit.parts, strict=True)):
        for column in range(len(record.channels)):
            sizes = None if record.modal else _sizes(record, record_fit, column)
            correlation, p = (0.0, 1.0) if sizes is None else rank_correlation(*sizes)
            if p < RESIDUAL_GROWTH.value and correlation > _MATTERS:
                growing.append((k, column))
                correlations.append(f"{names[channel]} (rank correlation {correlation:.2g})")
            channel += 1
    if not growing:
        return None
    verb, noun = ("grows", "residual") if len(growing) == 1 else ("grow", "residuals")
    begun = f"the {noun} of {', '.join(correlations)} {verb} with the response: noise in proportion to it?"
    if not isinstance(likelihood, FrfLikelihood):
        loss = "estimator: {loss: huber} bounds the influence of the largest ones"
        return GrowingResiduals(tuple(growing), f"{begun} Or a nonlinear joint; {loss}")
    outcome = _with_proportional_noise(likelihood, fit)
    return None if outcome is None else GrowingResiduals(tuple(growing), f"{begun} {outcome[0]}", outcome[1])


def _sizes(record: RecordLikelihood, record_fit: RecordFit, column: int) -> tuple[Array, Array] | None:
    """Return sizes of residuals and of responses of a channel; None where these are not to be compared."""
    # That is where noise is not taken for white and of one deviation, and where residuals are round-off.
    negligible = record_fit.size[column] < _RESIDUAL_ROUND_OFF_SHARE * record.data.rms[column]
    if record.data.robust is not None or record.modelled or record.data.passed != 1 or negligible:
        return None
    residual, predicted = record_fit.residual[:, [column]], record_fit.predicted.outputs[:, [column]]
    if isinstance(record, TimeRecord):  # of coloured residuals the sizes are correlated by chance, too
        return None if is_coloured(whiteness(residual)) else (np.abs(residual[:, 0]), np.abs(predicted[:, 0]))
    if not isinstance(record, FrfRecord) or record.measurement.deviation is not None:
        return None
    return np.abs(unstacked(residual))[:, 0], np.abs(unstacked(predicted))[:, 0]


def rank_correlation(a: Array, b: Array) -> tuple[float, float]:
    """Return Spearman's rank correlation where both are known, and the probability of a larger one."""
    both = np.isfinite(a) & np.isfinite(b)
    n = int(np.count_nonzero(both))
    if n < 3:
        return 0.0, 1.0
    ranks = [np.argsort(np.argsort(values[both], kind="stable")) - (n - 1) / 2 for values in (a, b)]
    correlation = float(ranks[0] @ ranks[1]) / (n * (n * n - 1) / 12)
    return correlation, math.erfc(correlation * math.sqrt((n - 1) / 2)) / 2


def _with_proportional_noise(likelihood: FrfLikelihood, fit: Fit) -> tuple[str, bool] | None:
    """Return what noise in proportion to the response makes of a fit, in words; True if it explains it."""
    (record,) = likelihood.records
    if record.multiplications > _MAX_WORK:
        return "State noise: {kind: proportional} in the measurement", False
    measurement = replace(record.measurement, noise=None, proportional=True)
    plain = replace(record, measurement=measurement, data=replace(record.data, given=None))
    try:
        weighted = FrfLikelihood((plain.first_weighted(),))
        noise_model, way = with_noise(weighted, refine(weighted, fit.eta))
        compared = compare_models(noise_model, way.fit)
        deviations = noise_model.information(way.fit, noise_model.likeliest(way.fit)).deviations()
        gain = likelihood.misfit(fit) - noise_model.misfit(way.fit)
    except _FAILURES:
        return None
    if not gain > _MIN_GAIN:
        return None
    explained = compared.explained and compared.lack_of_fit_p > LACK_OF_FIT.value
    p = p_text(compared.lack_of_fit_p, 1)
    if not explained:
        return f"With noise: {{kind: proportional}} the model lacks fit, too ({p})", False
    eta, unknowns = way.fit.eta, likelihood.unknowns
    rows = zip(likelihood.names, values(unknowns, eta), rates(unknowns, eta) * deviations, strict=True)
    estimates = [f"{name} = {with_error(value, error)}" for name, value, error in rows][:_NAMED]
    more = ", …" if len(unknowns) > _NAMED else ""
    return (
        "State noise: {kind: proportional} in the measurement: with that the model has no lack of fit "
        f"({p}), and {', '.join(estimates)}{more}"
    ), True
