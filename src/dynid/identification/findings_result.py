"""What an identification found, as named arrays: parameters, stages, diagnostics."""

from __future__ import annotations

import numpy as np

from dynid.identification.diagnostics import is_coloured, is_settled, whiteness
from dynid.identification.findings import Findings
from dynid.identification.residuals import autocorrelation
from dynid.identification.verdict import CONTRADICTED, Facts, verdict, warnings
from dynid.result import Result
from dynid.structure.response import common_unit

# Errors of logarithms below this are rounding, of which a bound of clean data may say anything.
_ROUNDING = 1e-9
#: What the autocorrelation of the residuals is told by.
_AUTOCORRELATION = ("lag", "autocorrelation", "autocorrelation_band", "channel_whiteness_p")


def add_parameters(result: Result, found: Findings) -> None:
    """Add ``parameters/``: what was estimated, with error bars, bounds and correlations."""
    group, dims = "identification/parameters", ("parameter",)
    unknowns = found.ensemble.unknowns
    names = found.ensemble.names
    estimate = np.exp(found.final.logs)
    true = found.true
    result.add_axis(f"{group}/parameter", names)
    result.add(f"{group}/name", names, dims)
    result.add(f"{group}/unit", [unknown.unit for unknown in unknowns], dims)
    unit = _unit(found)
    result.add(f"{group}/start", [unknown.start for unknown in unknowns], dims, unit)
    result.add(f"{group}/true", true, dims, unit)
    result.add(f"{group}/estimate", estimate, dims, unit)
    result.add(f"{group}/standard_error", estimate * found.information.deviations(), dims, unit)
    if result.wants(f"{group}/cramer_rao"):
        result.add(f"{group}/cramer_rao", found.bound, dims, unit)
    knowledge = found.ensemble.knowledge
    result.add(f"{group}/at_bound", knowledge.at_bound(found.final.logs), dims)
    if knowledge.believed.any():
        result.add(f"{group}/cramer_rao_without_prior", found.bound_with(prior=False), dims, unit)
    result.add(f"{group}/error_percent", 100 * np.abs(estimate / true - 1), dims, "%")
    # An axis of its own: two axes of one name could not be told apart.
    result.add_axis(f"{group}/other", names)
    result.add(f"{group}/correlation", found.information.correlation(), ("parameter", "other"))


def _unit(found: Findings) -> str:
    """Return the unit that all parameters share, if they do."""
    return common_unit(unknown.unit for unknown in found.ensemble.unknowns)


def add_stages(result: Result, found: Findings) -> None:
    """Add ``stages/``: what each stage of the estimator led to."""
    group, stages = "identification/stages", found.estimation.stages
    result.annotate("identification", estimator=found.method)
    result.add_axis(f"{group}/stage", [stage.name for stage in stages])
    result.add_axis(f"{group}/parameter", [unknown.name for unknown in found.ensemble.unknowns])
    estimates = np.exp([stage.logs for stage in stages])
    unit = _unit(found)
    result.add(f"{group}/estimate", estimates, ("stage", "parameter"), unit)
    left = [np.max(stage.residual_ratio) for stage in stages]
    result.add(f"{group}/residual_ratio", left, ("stage",))
    result.add(f"{group}/iterations", [stage.iterations for stage in stages], ("stage",))
    chosen = [stage.logs is found.final.logs for stage in stages].index(True) + 1
    result.add(f"{group}/chosen", chosen)


def add_diagnostics(result: Result, found: Findings) -> None:
    """Add ``diagnostics/``: whether the estimate is at the optimum, and the residuals noise."""
    group = "identification/diagnostics"
    deviations = found.information.deviations()
    settled = is_settled(found.step, deviations)
    explained = found.explained
    result.add(f"{group}/converged", settled and explained)
    result.add(f"{group}/settled", settled)
    result.add(f"{group}/explained", explained)
    result.add_axis(f"{group}/parameter", [unknown.name for unknown in found.ensemble.unknowns])
    result.add(f"{group}/distance_to_optimum", np.abs(found.step) / deviations, ("parameter",))
    if found.ensemble.knowledge.believed.any():
        conflict = found.ensemble.knowledge.conflict(found.final.logs, deviations)
        result.add(f"{group}/prior_conflict", conflict, ("parameter",))
        result.add(f"{group}/prior_contradicted", conflict > CONTRADICTED, ("parameter",))
    result.add_axis(f"{group}/channel", [place.name for place in found.channels])
    unit = common_unit(place.unit for place in found.channels)
    result.add(f"{group}/residual_rms", found.residual_rms, ("channel",), unit)
    result.add(f"{group}/residual_ratio", found.residual_ratio, ("channel",))
    result.add(f"{group}/whiteness_p", found.whiteness_p)
    result.add(f"{group}/white", not is_coloured(found.whiteness_p))
    result.add(f"{group}/condition", found.information.condition())
    for name, fact in found.estimation.facts.items():
        result.add(f"{group}/{name}", fact)
    result.add(f"{group}/passes", len(found.estimation.histories))
    if any(result.wants(f"{group}/{name}") for name in _AUTOCORRELATION):
        _add_autocorrelation(result, found)
    if any(result.wants(f"{group}/{name}") for name in ("verdict", "warnings")):
        _add_words(result, found, settled=settled, explained=explained)


def _add_autocorrelation(result: Result, found: Findings) -> None:
    group = "identification/diagnostics"
    each = [autocorrelation(found.series(place)) for place in found.channels]
    lags = min(len(r) for r, _ in each)
    result.add_axis(f"{group}/lag", np.arange(1, lags + 1))
    # Of real and imaginary parts, which are alike, the mean.
    joined = np.column_stack([r[:lags].mean(axis=1) for r, _ in each])
    result.add(f"{group}/autocorrelation", joined, ("lag", "channel"))
    band = [float(np.mean(band) / np.sqrt(len(band))) for _, band in each]
    result.add(f"{group}/autocorrelation_band", band, ("channel",))
    p = [whiteness(found.series(place)) for place in found.channels]
    result.add(f"{group}/channel_whiteness_p", p, ("channel",))


def _add_words(result: Result, found: Findings, *, settled: bool, explained: bool) -> None:
    """Add the verdict and the warnings."""
    group, names = "identification/diagnostics", found.ensemble.names
    deviations, bound = found.information.deviations(), found.bound
    off = np.abs(np.exp(found.final.logs) - found.true)
    errors = np.where(bound > 0, off / np.maximum(bound, _ROUNDING), np.nan)
    correlation = found.information.correlation()
    judged = any(np.isnan(record.given).any() for record in found.ensemble.records)
    spare = found.information.freedom - len(names) if judged else None
    conflict = found.ensemble.knowledge.conflict(found.final.logs, deviations)
    facts = Facts(names, deviations, correlation, errors, found.sensors, found.consistency, spare, conflict)
    distance = np.abs(found.step) / deviations
    result.add(f"{group}/verdict", verdict(names, distance, settled=settled, explained=explained))
    said = [*warnings(facts), *found.remarks]
    if found.model_error is not None and found.model_error.warning:
        said.append(found.model_error.warning)
    result.add_axis(f"{group}/warnings", np.array(said, dtype=object))
