"""Verdict and warnings of an identification, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from dynid.arrays import Array
from dynid.defaults import HEAVY_TAILS, LACK_OF_FIT, OFFSET
from dynid.identification.diagnosis.equivalent_optima import DECIDED, FLAT_DISTANCE
from dynid.identification.diagnosis.posterior import UNCERTAIN, Posterior
from dynid.identification.diagnosis.residuals import ChannelOfRecord
from dynid.identification.diagnosis.symmetry import interchangeable
from dynid.identification.residual_tests import ResidualShape, is_coloured, whiteness
from dynid.identification.statistics import chi_squared_tail
from dynid.number_format import frequency_text, p_text, quantity, share_text, short_percent
from dynid.parameters import Parameter, coordinates

if TYPE_CHECKING:
    from dynid.identification.likelihood.modal_record import ModalRecord

# Levels of the warnings: a correlation, an error in standard errors, a part of the samples that are missing
# or stand at the channel's extreme.
_CORRELATED, _OFF, _GAPS, _CLIPPED = 0.95, 5.0, 0.2, 0.01
#: How many deviations a prior and a record are apart that contradict each other: by chance one in 16,000.
CONTRADICTED = 4.0
# Residuals below this part of the signal are round-off and holds, whatever their colour.
_COLOUR_ROUND_OFF = 1e-6
# With fewer values than this beyond the unknowns the estimated noise is off by a quarter, as a rule.
_LEAST_SPARE = 10
# A channel that takes fewer values is not tested for clipping.
_MIN_CLIPPING_SAMPLES = 50
# Estimators whose filter is that of white noise.
_WHITE_ONLY = ("filter", "sigma-point", "invariant-imbedding")
#: What may be wrong where a model lacks fit: a joint that is not tested, or one that the score test excludes.
_POSSIBLE_CAUSES = (
    "Possible causes: a wrong mass or connection, or a nonlinear joint (friction, gap, a stiffness that "
    "depends on the amplitude), whose estimates differ between records of different amplitude"
)
_POSSIBLE_LINEAR_CAUSES = (
    "Possible causes: a wrong mass or connection, or a force that was another one between its samples "
    "(hold: linear or zero)"
)
#: What to do about a joint that is not linear.
_NEXT_LAWS = "to compare laws for it: estimator: {laws: [linear, cubic, jenkins, gap]}"
# Difference of the logarithm of the posterior below which optima are equally good.
_EQUAL_LOG_POSTERIOR = 0.1
# A parameter differs between optima from this part of a unit on; else priors move it a little.
_MOVED_UNITS = 0.01
# The most outliers that are named one by one.
_NAMED = 3
# An outlier or offset that makes up this part of a residual's mean square reduces the weight of its channel.
_DOMINANT = 0.5


def _optimum_text(posterior: Posterior) -> str:
    """Return how the estimate stands to the optima of the likelihood."""
    names, distance = posterior.likelihood.names, posterior.distance_to_optimum
    k = int(np.argmax(distance))
    if posterior.estimate.disputed and posterior.estimate.cut_off:
        return "the search was cut off, this may be a local optimum (start nearer to the true values)"
    if posterior.estimate.disputed:
        return "the starts end at different optima, this may be a local one (start nearer to the true values)"
    if not posterior.optimal:
        return f"{distance[k]:.2g} standard errors of {names[k]} from the optimum"
    parts = []
    if posterior.undetermined:
        lost = [name for name, yes in zip(names, posterior.identifiable, strict=True) if not yes]
        parts.append(f"{', '.join(lost)} {'are' if len(lost) > 1 else 'is'} not identifiable")
    if posterior.ambiguous:
        assert posterior.optima is not None
        count = int(np.count_nonzero(posterior.optima.undecided))
        well = _how_well(posterior)
        parts.append(f"{count} optima explain the {posterior.noun} {well}, this is one of them")
    return ", and ".join(parts) or "optimum found"


def verdict(posterior: Posterior) -> str:
    """Return the verdict in one line: convergence of the estimate, and fit of the model.

    It starts with `converged` only where the residuals do not contradict the model.
    """
    if posterior.rejection is not None:
        return f"rejected: {posterior.rejection.problem}"
    optimum, compared, noun = _optimum_text(posterior), posterior.comparison, posterior.noun
    if not compared.has_signal:
        fit = f"the {noun} shows no response, only noise ({p_text(compared.signal_p)})"
    elif not compared.explained:
        fit = (
            f"the model does not explain the {noun}: lack of fit {p_text(compared.lack_of_fit_p, 1)}, "
            f"{100 * compared.signal_explained:.3g} % of the signal explained"
        )
    elif compared.redundancy <= 0:
        fit = f"nothing in the {noun} could contradict the model (redundancy {compared.redundancy})"
    else:
        fit = f"the model explains the {noun}"
        if compared.lacks_fit:
            fit = (
                f"the model lacks fit ({p_text(compared.lack_of_fit_p, 1)}): it explains "
                f"{share_text(compared.signal_explained)} of the signal"
            )
            if posterior.optimal and not (posterior.ambiguous or posterior.undetermined):
                return f"{optimum}, but {fit}, and the intervals are nominal, as a rule too narrow"
        elif float(np.max(posterior.distance_to_optimum)) > _OFF and not posterior.optimal:
            return f"NOT converged: {optimum}"  # too far for a step to say what it explains
        if posterior.converged:
            if (optima := posterior.optima) is not None and len(optima) > 1:
                optimum += (
                    f" (of {len(optima)} that explain the {noun} equally well, priors and limits leave it)"
                )
            return f"converged: {optimum}, {fit}"
    return f"NOT converged: {optimum}; {fit}"


def warnings(posterior: Posterior) -> list[str]:
    """Return the warnings in words; none where all is well."""
    messages = [
        *_unique_warnings(posterior),
        *_estimate_warnings(posterior),
        *_record_warnings(posterior),
        *_noise_warnings(posterior),
    ]
    if posterior.model_error is not None and posterior.model_error.warning:
        messages.append(posterior.model_error.warning)
    return messages


def _unique_warnings(posterior: Posterior) -> Iterator[str]:
    """Warn of parameters that the records do not determine, or not uniquely."""
    if posterior.undetermined:
        yield from _undetermined(posterior)
    if posterior.ambiguous:
        yield _equivalent_optima(posterior)
    if posterior.optima is not None and (flat := posterior.optima.flat) is not None:
        k = int(np.argmax(np.abs(flat.away) / posterior.information.deviations()))
        unknown, eta = posterior.likelihood.unknowns[k], float(posterior.fit.eta[k] + flat.away[k])
        yield (
            "the error bars are by profile likelihood: those of the information are too narrow "
            f"({FLAT_DISTANCE:.0f} standard errors away, at {unknown.name} = {quantity(unknown.value(eta))}, "
            f"the logarithm of the likelihood is lower by {flat.rise:.2g}, where they predict "
            f"{flat.predicted:.2g}); measure longer or with less noise, or give a prior of {unknown.name}; "
            "posterior_check: true weighs the posterior"
        )


def nonlinear_step(posterior: Posterior) -> str:
    """Return which joint is not linear, and what to do about it; empty where the score test finds none."""
    tested = posterior.nonlinearity
    if tested is None or not tested.nonlinear:
        return ""
    return f"{tested.verdict}; {posterior.next_laws or _NEXT_LAWS}"


def _possible_causes(posterior: Posterior) -> str:
    """Return what may cause a lack of fit: estimates at a limit first, and the test of the joints."""
    causes = _POSSIBLE_CAUSES
    if step := nonlinear_step(posterior):
        causes = f"Possible causes: a wrong mass or connection; {step}"
    elif (tested := posterior.nonlinearity) is not None:
        causes = f"{_POSSIBLE_LINEAR_CAUSES}; {tested.verdict}"
    names, priors = posterior.likelihood.names, posterior.likelihood.priors
    held = np.flatnonzero(priors.at_bound(posterior.fit.eta) & ~priors.fixed)
    if not len(held):
        return causes
    limited = ", ".join(names[k] for k in held)
    return f"{limited} {'are' if len(held) > 1 else 'is'} at a limit: check it first. {causes}"


def _estimate_warnings(posterior: Posterior) -> Iterator[str]:
    """Warn of lack of fit, contradicted priors, and uncertain or hardly distinguishable parameters."""
    names, errors = posterior.likelihood.names, posterior.error_in_bounds
    yield from posterior.mistakes
    if posterior.estimate.cut_off:
        rows = "samples" if posterior.likelihood.records[0].sampling_step is not None else "lines"
        yield (
            f"the search for the optimum was cut off after {posterior.estimate.cut_off} evaluations, its "
            f"limit for so many {rows} and DOFs: start nearer to the true values, reduce the structure, "
            f"give fewer {rows}, or correct the noise model (measurement.noise) if residuals grow with the "
            "response"
        )
    yield from _lack_of_fit(posterior)
    if posterior.growing is not None:
        yield posterior.growing.statement
    for name, apart in zip(names, posterior.prior_conflict, strict=True):
        if apart > CONTRADICTED:
            yield (
                f"the prior of {name} and the {posterior.noun} contradict each other ({apart:.2g} deviations "
                "apart): correct its value, or give it a larger relative_deviation"
            )
    yield from _limited_warnings(posterior)
    correlation, relative = posterior.information.correlation(), posterior.relative_errors
    true_elsewhere = _true_optimum(posterior) > 0
    yield from _alike_damping(posterior)
    for k, name in enumerate(names):
        if errors[k] > _OFF and posterior.identifiable[k] and not true_elsewhere:
            yield f"error of {name}: {errors[k]:.2g} × Cramér–Rao bound"
        if relative[k] > UNCERTAIN and posterior.indistinguishable_from_zero[k]:
            yield (
                f"{name} is indistinguishable from 0: a thousandth of it explains the {posterior.noun} as "
                "well; leave it out, or estimate it with scale: linear, which allows 0"
            )
        elif relative[k] > UNCERTAIN and posterior.decided_by[k] != "limits":
            yield f"{name} is poorly known: its standard error is {100 * relative[k]:.0f} % of it"
        for j in range(k):
            rho = correlation[k, j]
            distinct = posterior.identifiable[[k, j]].all()
            by_limits = "limits" in (posterior.decided_by[k], posterior.decided_by[j])
            if abs(rho) > _CORRELATED and distinct and not by_limits:
                combination = "ratio" if rho > 0 else "product"
                yield (
                    f"{names[j]} and {name} are hardly distinguishable (correlation {rho:.3f}): "
                    f"the {posterior.noun} determines their {combination} better than either"
                )


def _lack_of_fit(posterior: Posterior) -> Iterator[str]:
    """Warn of a model that the residuals contradict, with what may be wrong."""
    compared = posterior.comparison
    if _fails(posterior):
        if posterior.rejection is None and (step := nonlinear_step(posterior)):
            yield step
    elif compared.lacks_fit:
        growing = posterior.growing
        explained = posterior.mistakes or (growing is not None and growing.explained)
        worst = posterior.channels[int(np.argmin(compared.channel_lack_of_fit_p))].name
        causes = _possible_causes(posterior)
        yield (
            f"the model lacks fit ({p_text(compared.lack_of_fit_p, 1)}), most of all in {worst}: it explains "
            f"{share_text(compared.signal_explained)} of the signal; standard errors are nominal"
            f"{_farthest_value(posterior)}"
            f"{'' if explained or posterior.likelihood.records[0].modal else f'. {causes}'}"
        )


def _alike_damping(posterior: Posterior) -> Iterator[str]:
    """Warn of dampers and loss factors of joints that the records hardly distinguish."""
    if any(".eta" in name for name in posterior.likelihood.names):
        from dynid.identification.diagnosis.damping_kinds import alike_damping  # of loss factors alone

        errors = np.where(posterior.identifiable, posterior.relative_errors, np.inf)
        yield from alike_damping(posterior.likelihood, posterior.information.correlation(), errors)


def _farthest_value(posterior: Posterior) -> str:
    """Return which frequency or damping ratio of a modal survey is farthest off, as a clause."""
    compared, records = posterior.comparison, posterior.likelihood.records
    k = next((k for k, record in enumerate(records) if record.modal), None)
    if k is None:
        return ""
    columns = [c for c, channel in enumerate(records[k].channels) if channel.name != "shape"]
    off = np.abs(compared.tables[0].studentised[:, columns])
    if np.isnan(off).all():
        return ""
    row, column = np.unravel_index(np.nanargmax(off), off.shape)
    squares, degrees = compared.chi_squared
    rest = chi_squared_tail(degrees - 1, max(squares - off[row, column] ** 2, 0.0)) if degrees > 1 else 1.0
    noun = cast("ModalRecord", records[k]).measurement.noun
    value = f"{records[k].channels[columns[column]].name} of {noun} {row + 1}"
    said = f"; farthest off is the {value}, by {off[row, column]:.2g} deviations of its residual"
    if rest <= LACK_OF_FIT.value:
        return said
    return f"{said}: without it the rest is scatter ({p_text(rest, 1)}): check it, and the model in it"


def _undetermined(posterior: Posterior) -> Iterator[str]:
    """Warn of parameters that the records do not determine, with the combinations that they do."""
    likelihood, noun = posterior.likelihood, posterior.noun
    grouped: set[str] = set()
    values = dict(zip(likelihood.names, posterior.values.tolist(), strict=True))
    information = replace(posterior.free_information, values=posterior.values, rates=posterior.rates)
    for group in information.groups():
        members = [likelihood.names[index] for index in group.places]
        held = [name for name in members if name in posterior.undetermined]
        only = f": the {noun} shows only {group.identifiable}" if group.identifiable else ""
        fixed = ", ".join(f"{name} is held at {quantity(values[name])}" for name in held)
        grouped.update(members)
        yield (
            f"{', '.join(members)} cannot be distinguished{only}; {fixed}, and the error bars of the others "
            f"are conditional on that; fix some of them, or add {likelihood.records[0].observed.more}"
        )
    left = [name for name in posterior.undetermined if name not in grouped]
    if left:
        several, at = len(left) > 1, ", ".join(quantity(values[name]) for name in left)
        yield (
            f"{', '.join(left)} {'are' if several else 'is'} not identifiable from this {noun}: held at "
            f"{at}, and the error bars of the others are conditional on that; "
            f"{likelihood.records[0].observed.where} "
            f"{'they act, or give priors' if several else 'it acts, or give a prior'}"
        )


def _true_optimum(posterior: Posterior) -> int:
    """Return which of the equivalent optima is next to the true values; 0, the estimate, if none is known."""
    optima = posterior.optima
    if optima is None or np.isnan(true := posterior.true).any():
        return 0
    away = (optima.eta - coordinates(posterior.likelihood.unknowns, true)) / posterior.likelihood.priors.units
    return int(np.argmin(np.linalg.norm(away, axis=1)))


def _equivalent_optima(posterior: Posterior) -> str:
    """Return which parameters are interchangeable, and what would decide between the optima."""
    optima, unknowns = posterior.optima, posterior.likelihood.unknowns
    assert optima is not None
    undecided = optima.eta[optima.undecided]
    count, names = len(undecided), posterior.likelihood.names
    away = np.ptp(undecided, axis=0) / posterior.likelihood.priors.units
    moved = np.flatnonzero(away > 0)
    # Priors and limits may leave fewer groups than the symmetries.
    apart = {names[k] for k in np.flatnonzero(away > _MOVED_UNITS)}
    sets = interchangeable(names, optima.permutations)
    left = [[group for group in groups if apart & set(group)] for groups in sets]
    left = [groups for groups in left if len(groups) > 1] or sets
    alike = "; ".join(map(interchange_text, left))
    if not alike:
        are = "is" if len(moved) == 1 else "are"
        alike = f"{', '.join(names[k] for k in moved)} {are} not determined uniquely"
    true = _true_optimum(posterior)
    at = f"; the true values are those of optimum {true + 1}" if true else ""
    remedy = deciding_text(unknowns, undecided, optima.sensors)
    return (
        f"{alike}: {count} optima explain the {posterior.noun} {_how_well(posterior)} "
        f"(identification/equivalent_optima{at}). To decide: {remedy}"
    )


def _how_well(posterior: Posterior) -> str:
    """Return how well the undecided optima explain the records beside the estimate, with the odds."""
    assert posterior.optima is not None
    min_log_posterior = float(posterior.optima.log_posterior[posterior.optima.undecided].min())
    if min_log_posterior > -_EQUAL_LOG_POSTERIOR:
        return "equally well"
    return f"nearly equally well (odds of {math.exp(-min_log_posterior):.2g} to 1 at the most)"


def interchange_text(groups: Sequence[Sequence[str]]) -> str:
    """Return that groups of parameters are interchangeable, as a clause."""
    written = [group[0] if len(group) == 1 else f"({', '.join(group)})" for group in groups]
    return f"{', '.join(written[:-1])} and {written[-1]} are interchangeable"


def deciding_text(
    unknowns: Sequence[Parameter], eta: Array, sensors: Sequence[tuple[str, ...]], *, guessed: bool = False
) -> str:
    """Return which sensor, prior or limit would decide between optima.

    `unknowns`: the parameters (p); `eta`: coordinates of the optima (optima x p). `sensors`: sensors, or
    sets of them, at which they differ; `guessed`: True where the coordinates are guesses, from which no
    numbers follow.
    """
    parts = []
    if sensors:
        *others, last = (" and ".join(names) for names in sensors)
        listed = f"{', '.join(others)} or {last}" if others else last
        several = "sensors" if len(sensors[0]) > 1 else "a sensor"
        structure = sensors[0][0].split()[0] == "DOF"
        parts.append(f"{several} at {listed}" if structure else f"measure {listed}, too")
    # The values that are farthest apart, of neighbours.
    ordered = np.sort(eta, axis=0)
    gaps = np.diff(ordered, axis=0) / [unknown.first_spread / 2 for unknown in unknowns]
    row, k = divmod(int(np.argmax(gaps)), gaps.shape[1])
    name, log = unknowns[k].name, unknowns[k].logarithmic
    if guessed:
        return f"{''.join(f'{clause}, ' for clause in parts)}a prior of {name}, or its min or max"
    lower, upper = (float(ordered[row + side, k]) for side in (0, 1))
    # A prior at one of two values excludes the other by gap^2 / (2 sigma^2) in the logarithm.
    sigma = (upper - lower) / math.sqrt(2 * DECIDED)
    relative = math.sqrt(math.expm1(min(sigma**2, math.log(2))))  # 1 at most: a prior need not be wider
    width = f"relative_deviation: {relative:.2g}" if log else f"deviation: {sigma:.2g}"
    some = "a prior of {} ({} or less)" if len(eta) == 2 else "priors such as of {} ({} or less)"
    parts.append(some.format(name, width))
    low, high = (unknowns[k].value(x) for x in (lower, upper))
    parts.append(f"min or max of {name} between {quantity(low)} and {quantity(high)}")
    return f"{', '.join(parts[:-1])}, or {parts[-1]}"


def _limited_warnings(posterior: Posterior) -> Iterator[str]:
    """Warn of parameters whose limits decide, not the data."""
    names, by = np.array(posterior.likelihood.names), np.array(posterior.decided_by)
    limited, decided = names[by == "limits"].tolist(), names[by == "data"].tolist()
    if limited:
        several = len(limited) > 1
        others = f"it decides {', '.join(decided)}" if decided else "it decides none by itself"
        yield (
            f"the {posterior.noun} does not decide {', '.join(limited)}: {'their' if several else 'its'} "
            f"interval{'s' * several} follow{'' if several else 's'} from the limits (min, max); {others}"
        )


def _record_warnings(posterior: Posterior) -> Iterator[str]:
    """Warn of how records were read, coloured residuals, few values, missing samples, clipped channels."""
    records = posterior.likelihood.records
    for k, record in enumerate(records, 1):
        for note in record.notes:
            yield f"record_{k}: {note}" if posterior.several else note
    yield from _coloured_residuals(posterior)
    if any(record.modelled for record in records) and posterior.method in _WHITE_ONLY:
        yield (
            f"{posterior.method} assumes white noise: its estimate is not the most likely one for coloured "
            "noise, which its error bars are for; method: auto finds that"
        )
    if any(np.isnan(record.stated_noise).any() for record in records):
        spare = posterior.information.freedom - len(posterior.likelihood.names)
        if spare < _LEAST_SPARE:
            left = "1 value is" if spare == 1 else f"{spare} values are"
            yield f"{left} left to estimate the noise from, beyond the unknowns: standard errors are rough"
    for channel in posterior.channels:
        if records[channel.record].sampling_step is None:
            continue
        record = records[channel.record]
        values = record.data.recorded[: int(record.sample_counts[channel.column]), channel.column]
        there = values[~np.isnan(values)]
        if len(there) < (1 - _GAPS) * len(values):
            yield f"{channel.name} has {100 * (1 - len(there) / len(values)):.0f} % of its samples missing"
        extreme = max(np.count_nonzero(there == there.min()), np.count_nonzero(there == there.max()))
        if len(there) >= _MIN_CLIPPING_SAMPLES and extreme > max(2, _CLIPPED * len(there)):
            yield f"{channel.name} stands at its extreme value in {extreme} samples: it may be clipped"


def _coloured_residuals(posterior: Posterior) -> Iterator[str]:
    """Warn of residuals that are not white, in one sentence for all channels of a record."""
    coloured: dict[int, list[tuple[str, str, str]]] = {}
    for channel in posterior.channels:
        record, fit = posterior.likelihood.records[channel.record], posterior.fit.parts[channel.record]
        ratio, series = record.unexplained(fit, channel.column)
        fitted = [int(record.noise_orders[channel.column])]
        if ratio >= _COLOUR_ROUND_OFF and is_coloured(whiteness(series, coefficients=fitted)):
            peak = frequency_text(record.residual_peak(fit, channel.column), 3)
            coloured.setdefault(channel.record, []).append((channel.name, short_percent(100 * ratio), peak))
    for k, channels in coloured.items():
        # A mistake of an instrument that explains the lack of fit has a remedy of its own.
        explained = posterior.mistakes or (posterior.growing is not None and posterior.growing.explained)
        remedy = "" if explained or _fails(posterior) else posterior.likelihood.records[k].noise_remedy
        if len(channels) == 1:
            name, size, peak = channels[0]
            yield (
                f"the residual of {name} ({size} of the signal) is not white noise; it is strongest at "
                f"{peak}{remedy}"
            )
            continue
        residuals = [f"{name} ({size} of the signal, strongest at {peak})" for name, size, peak in channels]
        yield f"the residuals of {', '.join(residuals)} are not white noise{remedy}"


def _noise_warnings(posterior: Posterior) -> Iterator[str]:
    """Warn of inconsistent innovations, a contradicted noise, offsets, outliers and heavy tails."""
    consistency = posterior.consistency
    if consistency is not None and not consistency.consistent:
        size = "larger" if consistency.overall > 1 else "smaller"
        yield (
            f"the filter's innovations are {size} than it assumes: mean square {consistency.overall:.3g}, "
            f"{consistency.overall_low:.3g} … {consistency.overall_high:.3g} expected"
        )
    places, test = posterior.contradicted_noise, posterior.noise_test
    modal = [posterior.likelihood.records[channel.record].modal for channel in posterior.channels]
    if posterior.comparison.lacks_fit:  # of modes, the lack of fit says that they are too large
        places = [k for k in places if not (modal[k] and test.ratio[k] > 1)]
    if places:
        ratios = [f"{posterior.channels[k].name} {_number(test.ratio[k])} times" for k in places]
        remedy = "correct measurement.noise or leave it out"
        if all(modal[k] for k in places):
            remedy = "correct the scatter of the survey (frequency_std, damping_std, shape_std, floor)"
        if all(test.ratio[k] > 1 for k in places):
            remedy += "; if it is right, the model leaves something unexplained"
        bars = "; standard_error_scaled has the error bars for the observed noise"
        yield (
            f"the residuals contradict the given noise ({p_text(test.p)}): observed are "
            f"{', '.join(ratios)} the given deviation: {remedy}{'' if posterior.robust else bars}"
        )
    for channel, shape in zip(posterior.channels, posterior.shapes, strict=True):
        if shape is not None:
            yield from _shape_warnings(posterior, channel, shape)


def _shape_warnings(posterior: Posterior, channel: ChannelOfRecord, shape: ResidualShape) -> Iterator[str]:
    """Warn of an offset, and of outliers or heavy tails, with channel and time or frequency."""
    record = posterior.likelihood.records[channel.record]
    if record.mean_is_offset and shape.mean_p < OFFSET.value:
        share = shape.mean**2 / float(np.nanmean(posterior.raw_residual(channel) ** 2))
        yield (
            f"the residual of {channel.name} has the mean {shape.mean:.3g} {channel.unit} "
            f"({p_text(shape.mean_p)}): an offset of the sensor?{_weight_lost(channel, share)} "
            "Remedy: prepare: [{detrend: constant}] in the measurement"
        )
    growing = posterior.growing
    if posterior.robust or (growing is not None and (channel.record, channel.column) in growing.channels):
        return
    if count := len(shape.outliers):
        labels = ", ".join(record.row_label(int(row)) for row in shape.outliers[:_NAMED])
        others = f" and at {count - _NAMED} more" if count > _NAMED else ""
        remedy = f", or use {record.outlier_remedy}" if record.outlier_remedy else ""
        many, it = ("an outlier", "it") if count == 1 else (f"{count} outliers", "them")
        fails = _fails(posterior)
        # Errors of the data are single values, without which little of the residual is left.
        neighbours = count > 1 and np.min(np.diff(np.sort(shape.outliers))) == 1
        if fails and (neighbours or shape.share < _DOMINANT):
            yield (
                f"the residual of {channel.name} is largest at {labels}{others}, up to "
                f"{_number(shape.largest)} of its standard deviations: the model does not explain the record "
                "there; correct it first"
            )
            return
        yield (
            f"{channel.name} has {many} at {labels}{others}: up to {_number(shape.largest)} standard "
            f"deviations of its residual.{_weight_lost(channel, shape.share)} Correct {it} or leave {it} out "
            f"(empty cells){remedy}"
        )
    elif shape.kurtosis_p < HEAVY_TAILS.value and record.outlier_remedy and not _fails(posterior):
        yield (
            f"the residual of {channel.name} has heavy tails (kurtosis {shape.kurtosis:.3g}, of Gaussian "
            f"noise 3; largest at {record.row_label(shape.at)}): estimator: {{loss: huber}} bounds "
            "the influence of large residuals"
        )


def _fails(posterior: Posterior) -> bool:
    """Return True if the model does not explain the records: no noise model makes up for that."""
    compared = posterior.comparison
    return posterior.rejection is not None or (compared.lacks_fit and not compared.explained)


def _weight_lost(channel: ChannelOfRecord, share: float) -> str:
    """Return a sentence on the weight that a channel loses by a part of its residual's mean square."""
    if share < _DOMINANT:
        return ""
    return (
        f" It makes up {100 * share:.0f} % of the residual's mean square, so that {channel.name} counts "
        f"{_number(1 / max(1 - share, 1e-6))} times less than its noise would let it."
    )


def _number(x: float) -> str:
    return f"{x:.2g}" if x < 100 else f"{x:,.0f}"
