"""Content of identifications: estimates with intervals, their verdict, modes, and the record."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from dynid.defaults import SIGNAL, WHITENESS
from dynid.number_format import (
    counted,
    headed,
    p_text,
    percent,
    quantity,
    short_percent,
    significant,
    span_text,
    with_error,
)
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable, joined
from dynid.report.content.identifiability import (
    calibration_caveats,
    calibration_sections,
    identifiability_sections,
)
from dynid.report.content.responses import (
    derived_sections,
    has_modes,
    is_backbone,
    modal_sections,
    modal_summary,
    response_sections,
    rotor_sections,
    steady_sections,
)
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Most massless DOFs that are listed.
_MASSLESS_DOFS = 12
#: Redundancy below which errors in masses and stiffnesses tend to stay unseen.
_LITTLE = 10
#: Most channels whose residuals a sentence lists.
_CHANNELS = 3
# Most coefficients of a noise in a sentence.
_COEFFICIENTS = 4
#: Half width of a 95 % interval in standard errors.
_HALF_WIDTH = 1.959963984540054
#: Condition number of the information above which parameters are badly conditioned.
_BADLY = 1e3
#: Residuals, relative to the signal, below which they are rounding of doubles over thousands of steps.
_FIT_ROUND_OFF = 1e-11
_MEASURED, _DIAGNOSTICS = "identification/measurement", "identification/diagnostics"
_PARAMETERS, _REJECTED = "identification/parameters", "identification/rejected"
_NONLINEARITY, _LAWS = "identification/nonlinearity", "identification/laws"


def method(result: Result) -> str:
    """Return the kind of analysis and the method of the estimate."""
    if f"{_DIAGNOSTICS}/passes" not in result:
        return "bond graph" if "bond_graph" in result.group_attrs else "structure"
    passes = result.value(f"{_DIAGNOSTICS}/passes")
    stages = result["identification/stages/stage"].data
    stage = stages[result.value("identification/stages/chosen") - 1]
    if stage in ("a filter pass", "output error"):  # the latter: a rebuilt basis is fitted from the estimate
        start = ", started by an EKF pass" * (stage == "a filter pass")
    else:
        begun = stage == "the start" or f"{_MEASURED}/omega" in result or has_modes(result)
        stage = str(stage).replace("start ", "the multi-start grid, start ")
        start = f" from {stage}" if begun else f" after {stage}"
    how = {
        "filter": f"{passes} filter pass{'es' if passes > 1 else ''}",
        "sigma-point": f"{passes} filter pass{'es' if passes > 1 else ''}, sigma points",
        "output-error": "maximum likelihood",
        "invariant-imbedding": "invariant imbedding",
        "auto": f"maximum likelihood{start}",
    }
    attrs = result.group_attrs["identification"]
    if attrs.get("loss") == "huber":
        return "identification · maximum likelihood with Huber's loss"
    return f"identification · {how[str(attrs['estimator'])]}"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the content of an identification, or of the responses of a structure."""
    if _has_estimates(result):
        yield from _estimate_sections(result)
    yield from modal_sections(result)
    yield from derived_sections(result)
    yield from calibration_sections(result)
    yield from identifiability_sections(result)
    if "structure/modes/omega" in result:
        yield _computed_modes(result)
    yield from rotor_sections(result)
    yield from response_sections(result, "structure")
    yield from steady_sections(result)
    if "bond_graph" in result.group_attrs:
        from dynid.report.content.bond_graph import sections as graph_sections

        for section in graph_sections(result):
            aside = _has_estimates(result) and section.place == "answer"
            yield replace(section, place="details") if aside else section


def _estimate_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the record, the estimates with what is doubtful of them, and the tests of the fit."""
    title = "Record and residuals"
    attributes = (attrs for group, attrs in result.group_attrs.items() if _MEASURED in group)
    prepared = dict.fromkeys(f"prepared: {attrs['prepared']}" for attrs in attributes if "prepared" in attrs)
    yield ReportSection(title, tuple(map(Statement, (_record_summary(result), *prepared))), screen="")
    verdict, *statements = verdict_statements(result)
    doubts = (statement for statement in statements if statement.tone == "bad")
    yield ReportSection("Parameters", (_parameter_table(result),), "answer", screen="")
    caveats = calibration_caveats(result)  # the verdict does not stand alone on a page
    yield ReportSection("Parameters", (verdict, *caveats, *doubts), "answer", screen="")
    yield ReportSection(title, tuple(said for said in statements if said.tone != "bad"), screen="")
    if f"{_LAWS}/name" in result:
        yield _compared_laws(result)


def _compared_laws(result: Result) -> ReportSection:
    """Return the candidates for the laws of joints."""
    names, log_likelihood, bic, p, apart = (
        result[f"{_LAWS}/{column}"].data
        for column in ("name", "log_likelihood", "bic", "p", "distinguishable")
    )
    estimates = result[f"{_LAWS}/estimates"].data if f"{_LAWS}/estimates" in result else [""] * len(names)
    best = float(np.nanmin(bic))
    rows = tuple(
        (
            str(names[k]),
            "-" if np.isnan(log_likelihood[k]) else f"{log_likelihood[k]:.1f}",
            "-" if np.isnan(bic[k]) else f"{bic[k] - best:.1f}",
            "" if np.isnan(p[k]) else p_text(p[k]).removeprefix("p ").removeprefix("= "),
            "yes" if apart[k] else "no",
            str(estimates[k]),
        )
        for k in range(len(names))
    )
    heads = ("law", "log likelihood", "BIC - least", "p against linear", "distinguishable", "estimates")
    verdict = Statement(str(result.group_attrs[_LAWS]["verdict"]))
    table = TextTable(heads, rows, brief=ALL).filled()
    return ReportSection("Laws of joints", (table, verdict), "answer", screen="")


def _computed_modes(result: Result) -> ReportSection:
    """Return the modes of the structure with its masses without inertia."""
    group = "structure/modes"
    omega, damping, names = (result[f"{group}/{column}"].data for column in ("omega", "damping", "name"))
    rows = tuple(
        (
            str(k),
            significant(size, 5),
            significant(size / math.tau, 5),
            f"{100 * ratio + 0.0:.3g} %",
            str(name),
        )
        for k, (size, ratio, name) in enumerate(zip(omega, damping, names, strict=True), 1)
    )
    massless = [str(dof) for dof in result[f"{group}/massless"].data] if f"{group}/massless" in result else []
    rigid, size = int(result.value(f"{group}/rigid")), len(result[f"{group}/dof"].data)
    counts = [
        counted(count, what) if count else f"no {what}s"
        for count, what in ((rigid, "rigid-body mode"), (len(massless), "massless DOF"))
    ]
    caption = f"{counted(len(omega), 'mode')} of {counted(size, 'DOF')}; {', '.join(counts)}"
    table = TextTable(("mode", "rad/s", "Hz", "ζ", ""), rows, caption=caption, noun="mode").filled()
    remark = [Statement(f"massless: {joined(massless, _MASSLESS_DOFS)}")] if massless else []
    if note := result.group_attrs.get(group, {}).get("note"):
        remark.append(Statement(f"note: {note}"))
    asked = not _has_estimates(result) and "bond_graph" not in result.group_attrs
    return ReportSection("Modes", (table, *remark), "answer" if asked else "details", screen="")


def _estimates_group(result: Result) -> str:
    """Return the group of the estimates: a group of their own where they are rejected."""
    return _REJECTED if result.rejected else _PARAMETERS


def _has_estimates(result: Result) -> bool:
    return f"{_estimates_group(result)}/name" in result


def linear_parameters(result: Result) -> list[bool]:
    """Return for each parameter True if it is estimated itself, not by its logarithm."""
    group = _estimates_group(result)
    if f"{group}/scale" in result:
        return [scale == "linear" for scale in result[f"{group}/scale"].data]
    return [False] * len(result[f"{group}/name"].data)


def interval(estimate: float, error: float, linear: bool) -> tuple[float, float]:
    """Return the 95 % interval of an estimate with a standard error.

    Where the logarithm is estimated, it is the estimate times exp(±1.96 times the deviation of the logarithm,
    which is standard error / estimate): it is never negative.
    """
    if linear:
        return estimate - _HALF_WIDTH * error, estimate + _HALF_WIDTH * error
    factor = math.exp(_HALF_WIDTH * error / estimate)
    return estimate / factor, estimate * factor


def _parameter_table(result: Result) -> TextTable:
    """Return the table of the parameters: start, estimate with error, interval, true value, bound.

    Intervals are nominal where the residuals contradict the model.
    Error and bound are relative to the true value; of a true value of 0 the bound is absolute. Where a true
    value is unknown, the bound is that at the estimate, which equals the standard error, and is omitted.
    Where residuals are round-off there is neither an interval nor a bound.
    Where the residuals contradict the given noise, a column has the standard error for the noise of the
    residuals.
    """
    group = _estimates_group(result)
    get = {
        name.rpartition("/")[2]: variable.data
        for name, variable in result.items()
        if name.startswith(f"{group}/")
    }
    compared, exact = bool(np.isfinite(get["true"]).any()), _is_round_off(result)
    barred = not (exact or is_rejected(result))
    bounded = barred and bool(np.isfinite(get["true"]).all())
    contradicted = f"{_DIAGNOSTICS}/noise_contradicted"
    scaled = get.get("standard_error_scaled") if result.get(contradicted) is not None else None
    if scaled is not None and not (barred and result.value(contradicted)):
        scaled = None
    heading = "nominal 95 % interval" if lacks_fit(result) else "95 % interval"
    bars = (heading, *(() if scaled is None else ("for residual noise",))) if barred else ()
    truths = (*(("true", "error") if compared else ()), *(("CR bound",) if bounded else ()))
    rows, linear = [], linear_parameters(result)
    for k, name in enumerate(get["name"]):
        estimate, true = (float(get[column][k]) for column in ("estimate", "true"))
        error = float(get["standard_error"][k]) if barred else math.nan
        shown: tuple[str, ...] = (quantity(estimate, abs(estimate) * 1e-4 if exact else None),)
        if barred and not math.isfinite(error):
            shown = (quantity(estimate), "not identifiable")
        elif barred:
            low, high = (
                (float(get["low"][k]), float(get["high"][k]))
                if "low" in get
                else interval(estimate, error, linear[k])
            )
            shown = (with_error(estimate, error), f"{quantity(low, error)} … {quantity(high, error)}")
        residual_noise: tuple[str, ...] = ()
        if scaled is not None:
            residual_noise = (with_error(estimate, scaled[k]) if math.isfinite(scaled[k]) else "-",)
        off = percent(get["error_percent"][k]) if true else "-"
        truth = (quantity(true), off) if compared else ()
        bound_size = float(get["cramer_rao"][k]) if bounded else 0.0
        bound = (percent(100 * bound_size / abs(true)) if true else quantity(bound_size),) if bounded else ()
        first = (headed(name, get["unit"][k]), quantity(get["start"][k]))
        rows.append((*first, *shown, *residual_noise, *truth, *bound))
    heads = ("", "start", "rejected estimate" if result.rejected else "estimate", *bars, *truths)
    return TextTable(heads, tuple(rows), brief=ALL, most=ALL)


def _record_summary(result: Result) -> str:
    """Return the number of states, unknowns, records and samples, and the channels."""
    group = _MEASURED
    several = [path for path in result if path.startswith(f"{group}/record_") and path.endswith("/measured")]
    groups = [path.removesuffix("/measured") for path in several] or [group]
    unknowns = counted(len(result[f"{_estimates_group(result)}/name"].data), "unknown parameter")
    if f"{groups[0]}/measured" not in result:
        return f"{unknowns}; {modal_summary(result)}" if has_modes(result) else unknowns
    measured = [result[f"{path}/measured"].data for path in groups]
    lists = list(dict.fromkeys(", ".join(result[f"{path}/channel"].data) for path in groups))
    missing = sum(int(np.isnan(values).sum()) for values in measured)
    times = [result[path].data for name in groups if (path := f"{name}/channel_time") in result]
    missing -= sum(int(np.isnan(values).sum()) for values in times)  # shorter channels
    gaps = f", {missing} missing" if missing else ""
    paths = [path for name in groups if (path := f"{name}/samples_left_out") in result]
    left_out = sum(int(result.value(path)) for path in paths)
    if left_out:
        gaps += f"; {counted(left_out, 'sample')} left out, at which not every input is known (delays)"
    if f"{group}/omega" in result:
        omega, unit = result[f"{group}/omega"].data, frequency_unit(result)
        span = span_text(unit.factor * omega[0], unit.factor * omega[-1], 5)
        lines = f"{counted(len(omega), 'line')}, {span} {unit.name}"
        return f"{unknowns}; {lines}, of the frequency responses {lists[0]}{gaps}"
    records = f"{counted(len(groups), 'record')}, " if several else ""
    samples = counted(sum(map(len, measured)), "sample")
    record = f"{unknowns}; {records}{samples} of {'; '.join(lists)}{gaps}"
    if result.rejected:
        return record
    states = len(result[f"{groups[0].replace('measurement', 'history')}/component"].data)
    scope = result.get("identification/need/part")
    reduced = scope is not None and "coordinates" in scope.data
    size = (
        f"{counted(states, 'state')} of the reduced model" if reduced else counted(states, "physical state")
    )
    return f"{size}, {record}"


def is_rejected(result: Result) -> bool:
    """Return True if an estimate is not converged and rejected, so that its standard errors are invalid."""
    converged = result.get(f"{_DIAGNOSTICS}/converged")
    if converged is None or bool(converged.data):
        return False
    return not (is_open(result) or _is_left_to_limits(result))


def _flags(result: Result) -> dict[str, Any]:
    """Return the flags of an estimate, and its redundancy; empty if it is rejected, or lacks one of them."""
    names = ("converged", "optimum", "explained", "redundancy")
    if result.rejected or any(f"{_DIAGNOSTICS}/{name}" not in result for name in names):
        return {}
    return {name: result.value(f"{_DIAGNOSTICS}/{name}") for name in names}


def is_open(result: Result) -> bool:
    """Return True if an estimate lacks no more than parameters that the records leave undetermined.

    Those are not identifiable, or interchangeable; the standard errors of the others are valid beside them.
    """
    flags = _flags(result)
    sound = bool(flags and flags["optimum"] and flags["explained"])
    return sound and not flags["converged"] and bool(flags["redundancy"] > 0)


def _is_left_to_limits(result: Result) -> bool:
    """Return True if limits decide parameters, so that an optimum lacks no more than redundancy.

    Its intervals follow from the limits, and are valid if the model is right.
    """
    flags, decided = _flags(result), result.get(f"{_PARAMETERS}/decided_by")
    few = bool(flags and flags["optimum"] and flags["explained"] and flags["redundancy"] <= 0)
    return few and decided is not None and "limits" in decided.data.tolist()


def _is_modal(result: Result) -> bool:
    return has_modes(result) and f"{_DIAGNOSTICS}/autocorrelation" not in result


def lacks_fit(result: Result) -> bool:
    """Return True if the residuals contradict the model, also where it explains most of the signal."""
    flag = result.get(f"{_DIAGNOSTICS}/lacks_fit")
    return flag is not None and bool(flag.data)


def _is_round_off(result: Result) -> bool:
    """Return True if all residuals are round-off, as of a record without noise."""
    ratio = result.get(f"{_DIAGNOSTICS}/residual_ratio")
    return ratio is not None and not is_rejected(result) and bool(np.all(ratio.data < _FIT_ROUND_OFF))


def cautions(result: Result) -> Iterator[str]:
    """Yield the rejection of a result with its remedy, and the warnings, a sentence each."""
    if f"{_DIAGNOSTICS}/converged" not in result:
        return
    if is_rejected(result) or _is_left_to_limits(result):
        signal, redundancy = result.get(f"{_DIAGNOSTICS}/signal_p"), result.get(f"{_DIAGNOSTICS}/redundancy")
        if signal is not None and not float(signal.data) < SIGNAL.value:
            remedy = "excite more, or measure elsewhere, longer or with less noise"
        elif not result.value(f"{_DIAGNOSTICS}/explained"):
            flags = result.get(f"{_DIAGNOSTICS}/prior_contradicted")
            names = () if flags is None else result[f"{_DIAGNOSTICS}/parameter"].data[flags.data]
            priors = "".join(f"the prior of {name}, " for name in names)
            remedy = f"check {priors}model, units, signs and starts, and whether a joint is nonlinear"
        elif redundancy is not None and int(redundancy.data) <= 0:
            more = "modes or sensors" if _is_modal(result) else "channels or excitation frequencies"
            more = "amplitudes" if is_backbone(result) else more
            remedy = f"add {more}, or fix a parameter"
        else:
            of_modes = _is_modal(result)
            remedy = "start nearer to the true values" if of_modes else "use method auto, or more passes"
        if not result.rejected:  # else the error of the run says it
            yield f"not converged: {_reason(result)}: {remedy}"
    elif is_open(result):  # the warnings have the remedies
        yield f"not converged: {_reason(result)}"
    yield from (str(warning) for warning in result[f"{_DIAGNOSTICS}/warnings"].data)


def _reason(result: Result) -> str:
    return str(result.value(f"{_DIAGNOSTICS}/verdict")).removeprefix("NOT converged: ")


def noise_sentences(result: Result) -> Iterator[str]:
    """Yield the model of a noise that is not white, in one sentence."""
    group = "identification/noise"
    if f"{group}/channel" not in result:
        return
    names = [str(name) for name in result[f"{group}/channel"].data]
    if f"{group}/ratio" in result:
        ratios = 100 * result[f"{group}/ratio"].data
        channels = [f"{short_percent(ratio)} in {name}" for ratio, name in zip(ratios, names, strict=True)]
        title = "noise in proportion to the response: "
    else:
        orders, coefficients = result[f"{group}/order"].data, result[f"{group}/coefficients"].data
        channels = []
        for name, order, row in zip(names, orders, coefficients, strict=True):
            shown = ", ".join(f"{a:.3g}" for a in row[: min(order, _COEFFICIENTS)])
            more = ", …" if order > _COEFFICIENTS else ""
            channels.append(f"{name} of order {order} ({shown}{more})" if order else f"{name} white")
        title = "coloured noise (autoregression): "
    yield f"{title}{', '.join(channels[:_CHANNELS])}{', …' if len(channels) > _CHANNELS else ''}"


def _error_bars(result: Result, *, sound: bool) -> Iterator[Statement]:
    """Yield what is to be known of the error bars; `sound`: the residuals give no reason to."""
    if is_open(result):
        if bars := result.group_attrs.get(_PARAMETERS, {}).get("error_bars"):
            yield Statement(f"error bars are {bars}", "bad")
    elif is_rejected(result):
        text = "error bars are not printed: the estimate is not converged (those in the file are nominal)"
        if result.rejected:
            text = (
                "the fit does not explain the record: its estimates are no answers, and stand in "
                "identification/rejected alone; the figures of the fit show where it fails"
            )
        yield Statement(text, "bad")
    elif not sound:  # else the verdict says it
        yield Statement("error bars are nominal: the residuals are not white noise", "bad")


def _largest_error(result: Result) -> Iterator[Statement]:
    """Yield the largest relative standard error that is finite; of signed parameters, of those off zero."""
    size = np.abs(result[f"{_PARAMETERS}/estimate"].data)
    error = result[f"{_PARAMETERS}/standard_error"].data
    may_be_zero = linear_parameters(result) & ~(size > 3 * error)
    relative = np.where(may_be_zero | ~np.isfinite(error), 0.0, error)
    relative = relative / np.where(size > 0, size, 1.0)
    if relative.any():
        name = result[f"{_PARAMETERS}/name"].data[int(np.argmax(relative))]
        yield Statement(f"largest relative standard error: {percent(100 * relative.max())} ({name})")


def verdict_statements(result: Result) -> Iterator[Statement]:
    """Yield the verdict on an estimate: residuals, limits, conditioning, worst parameter, warnings."""
    white, exact = bool(result.value(f"{_DIAGNOSTICS}/white")), _is_round_off(result)
    good = not (is_rejected(result) or is_open(result) or lacks_fit(result))
    tone = "bad" if not good else "good" if white else ""
    yield Statement(str(result.value(f"{_DIAGNOSTICS}/verdict")), tone)
    yield from _residuals(result, white=white)
    if tested := result.group_attrs.get(_NONLINEARITY):
        yield Statement(str(tested["verdict"]), "bad" if tested["nonlinear"] else "")
    yield from map(Statement, noise_sentences(result))
    yield from _error_bars(result, sound=white or exact or lacks_fit(result))
    group = _estimates_group(result)
    names, bounds = result[f"{group}/name"].data, f"{group}/at_bound"
    held = ", ".join(names[result[bounds].data]) if bounds in result else ""
    if held:
        yield Statement(f"at a limit (min or max): {held}; the likelihood increases beyond it", "bad")
    if len(names) > 1 and not is_open(result):
        condition = result.value(f"{_DIAGNOSTICS}/condition")
        number = f"(condition number {condition:.2g})"
        if condition > _BADLY:
            yield Statement(f"badly conditioned; the parameters are hardly distinguishable {number}", "bad")
        else:
            yield Statement(f"well conditioned; the parameters are distinguishable {number}")
    if not (is_rejected(result) or exact):
        yield from _largest_error(result)
    if f"{_DIAGNOSTICS}/warnings" in result:
        for warning in result[f"{_DIAGNOSTICS}/warnings"].data:
            yield Statement(f"warning: {warning}", "bad")


def _residuals(result: Result, *, white: bool) -> Iterator[Statement]:
    """Yield the redundancy, the sizes of the residuals, and their whiteness."""
    path = f"{_DIAGNOSTICS}/redundancy"
    if path in result and not result.rejected:
        count = int(result.value(path))
        little = ": few, an error in what is known may stay unseen" if 0 < count < _LITTLE else ""
        yield Statement(f"redundancy {count}{little}")
    ratio = 100 * result[f"{_DIAGNOSTICS}/residual_ratio"].data
    if len(ratio) > 1:
        channels = result[f"{_DIAGNOSTICS}/channel"].data
        parts = [f"{short_percent(value)} of {name}" for value, name in zip(ratio, channels, strict=True)]
        more = ", …" if len(parts) > _CHANNELS else ""
        yield Statement(f"RMS residual: {', '.join(parts[:_CHANNELS])}{more}")
    else:
        yield Statement(f"RMS residual {short_percent(ratio[0])} of the signal")
    if (path := "identification/held_out/residual_ratio") in result:
        names = result["identification/held_out/channel"].data
        held_out = zip(100 * result[path].data, names, strict=True)
        parts = [f"{short_percent(value)} of {name}" for value, name in held_out]
        more = ", …" if len(parts) > _CHANNELS else ""
        yield Statement(f"held out, unexplained: {', '.join(parts[:_CHANNELS])}{more}")
    p = p_text(result.value(f"{_DIAGNOSTICS}/whiteness_p"))
    if _is_modal(result):  # modes alone have no order
        return
    if _is_round_off(result):
        yield Statement(
            "the residuals are round-off: the record has no noise, and the estimates no error bars"
        )
    elif white:
        level = f"{WHITENESS.value:.0e}".replace("e-0", "e-")
        yield Statement(f"the residuals are white ({p}; level {level})")
    else:
        yield Statement(f"the residuals are not white ({p})", "bad")
