"""What is said of an identification: parameters with their intervals, and how far to trust them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dynid.numerals import counted, percent, quantity, span_text, with_error
from dynid.report.answers.blocks import Block, Grid, Note, Part
from dynid.report.answers.common import more
from dynid.report.answers.identifiability import identifiability_parts
from dynid.result import Result

#: The most modes and massless DOFs that are listed.
_MOST_MODES, _SHOWN = 60, 20
#: Half width of a 95 % interval in standard errors.
_WIDE = 1.959963984540054
#: Condition of the information above which parameters are told apart badly.
_BADLY = 1e3
_MEASURED = "identification/measurement"


def method(result: Result) -> str:
    """Name the kind of analysis, and how the estimate was come by."""
    if "identification/diagnostics/passes" not in result:
        return "structure"
    passes = result.value("identification/diagnostics/passes")
    stages = result["identification/stages/stage"].data
    way = "from" if f"{_MEASURED}/omega" in result else "after"
    chosen = result.value("identification/stages/chosen")
    how = {
        "filter": f"{passes} filter pass{'es' if passes > 1 else ''}",
        "output-error": "maximum likelihood",
        "invariant-imbedding": "invariant imbedding",
        "auto": f"maximum likelihood {way} {stages[chosen - 1]}",
    }
    return f"identification · {how[str(result.group_attrs['identification']['estimator'])]}"


def parts(result: Result) -> Iterator[Part]:
    """Yield what is said of an identification, or of the responses of a structure."""
    if "identification/parameters/name" in result:
        yield Part("Parameters", tuple(_parameters(result)))
    yield from identifiability_parts(result)
    if "structure/modes/omega" in result:
        yield Part("Modes", tuple(_modes(result)))


def _parameters(result: Result) -> Iterator[Block]:
    yield Note(f"{record(result)}.")
    yield from (Note(f"{line[0].upper()}{line[1:]}.") for line in prepared(result))
    columns, rows = parameters(result)
    yield Grid(columns, tuple(rows))
    good = bool(result.value("identification/diagnostics/converged"))
    sound = good and bool(result.value("identification/diagnostics/white"))
    for place, sentence in enumerate(verdict(result)):
        bad = sentence.startswith(("beware", "at a bound", "error bars")) or not good
        tone = ("good" if sound else "bad" if not good else "") if place == 0 else "bad" if bad else ""
        yield Note(sentence[0].upper() + sentence[1:], tone)


def _modes(result: Result) -> Iterator[Block]:
    group = "structure/modes"
    get = {name: result[f"{group}/{name}"].data for name in ("omega", "damping", "name")}
    count, size = len(get["omega"]), len(result[f"{group}/dof"].data)
    without = list(result[f"{group}/massless"].data) if f"{group}/massless" in result else []
    rows = tuple(
        (
            str(k + 1),
            f"{omega:.5g}",
            f"{omega / (2 * math.pi):.5g}",
            f"{100 * damping + 0.0:.3g} %",
            str(name),
        )
        for k, (omega, damping, name) in enumerate(zip(*get.values(), strict=True))
        if k < _MOST_MODES
    )
    rigid = int(result.value(f"{group}/rigid"))
    said = f"{counted(count, 'mode')} of {counted(size, 'DOF')}, {rigid or 'none'} of the rigid body"
    yield Grid(("mode", "rad/s", "Hz", "damping", ""), rows, caption=said)
    yield from more(count, _MOST_MODES, "mode")
    if without:
        shown = ", ".join(map(str, without[:_SHOWN]))
        yield Note(f"{len(without)} massless: {shown}{', …' if len(without) > _SHOWN else ''}")


def parameters(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the parameters: start, estimate with its error, interval; truth, error and bound where known.

    Logarithms are estimated, so the 95 % interval is the estimate times exp(±1.96 times the deviation of the
    logarithm, which is standard error / estimate): it is never negative. Error and bound are relative to the
    truth. Where a true value is not known the bound is taken at the estimate and says what the standard
    error does: it is left out.
    """
    get = {
        name.rpartition("/")[2]: v.data
        for name, v in result.items()
        if name.startswith("identification/parameters/")
    }
    known, bounded = bool(np.isfinite(get["true"]).any()), bool(np.isfinite(get["true"]).all())
    truths = (*(("true", "error") if known else ()), *(("bound",) if bounded else ()))
    rows = []
    for k, name in enumerate(get["name"]):
        estimate, error, true = (float(get[part][k]) for part in ("estimate", "standard_error", "true"))
        factor = math.exp(_WIDE * error / estimate)
        truth = (quantity(true), percent(get["error_percent"][k])) if known else ()
        bound = (percent(100 * float(get["cramer_rao"][k]) / true),) if bounded else ()
        rows.append(
            (
                f"{name} [{get['unit'][k]}]".removesuffix(" []"),
                quantity(get["start"][k]),
                with_error(estimate, error),
                f"{quantity(estimate / factor, error)} … {quantity(estimate * factor, error)}",
                *truth,
                *bound,
            )
        )
    return ("", "start", "estimate", "95 % interval", *truths), rows


def record(result: Result) -> str:
    """Say what was measured."""
    group = _MEASURED
    several = [path for path in result if path.startswith(f"{group}/record_") and path.endswith("/measured")]
    every = [path.removesuffix("/measured") for path in several] or [group]
    measured = [result[f"{path}/measured"].data for path in every]
    lists = dict.fromkeys(", ".join(result[f"{path}/channel"].data) for path in every)
    missing = sum(int(np.isnan(values).sum()) for values in measured)
    gaps = f", {missing} missing" if missing else ""
    if f"{group}/omega" in result:
        return _responses(result, next(iter(lists)) + gaps)
    states = len(result[f"{every[0].replace('measurement', 'history')}/component"].data)
    unknowns = len(result["identification/parameters/name"].data)
    records = f"{counted(len(every), 'record')}, " if several else ""
    return (
        f"{counted(states, 'physical state')}, {counted(unknowns, 'unknown parameter')}; "
        f"{records}{counted(sum(map(len, measured)), 'sample')} of {'; '.join(lists)}{gaps}"
    )


def _responses(result: Result, said: str) -> str:
    """Say what frequency responses were measured, and where."""
    omega = result[f"{_MEASURED}/omega"].data
    unknowns = len(result["identification/parameters/name"].data)
    lines = f"{counted(len(omega), 'line')}, {span_text(omega[0], omega[-1], 5)} rad/s"
    return f"{counted(unknowns, 'unknown parameter')}; {lines}, of the frequency responses {said}"


def prepared(result: Result) -> Iterator[str]:
    """Yield what was done to the records before, one line for all that were treated alike."""
    attrs = (attrs for group, attrs in result.group_attrs.items() if _MEASURED in group)
    yield from dict.fromkeys(f"prepared: {found['prepared']}" for found in attrs if "prepared" in found)


def farthest(result: Result) -> tuple[str, float]:
    """Return the parameter that is farthest from the optimum of the record, and its standard errors away."""
    distance = result["identification/diagnostics/distance_to_optimum"].data
    k = int(np.argmax(distance))
    return str(result["identification/diagnostics/parameter"].data[k]), float(distance[k])


def contradicted(result: Result) -> list[str]:
    """Return the parameters whose priors the record contradicts."""
    group = "identification/diagnostics"
    told = result.get(f"{group}/prior_contradicted")
    return [] if told is None else [str(name) for name in result[f"{group}/parameter"].data[told.data]]


def verdict(result: Result) -> Iterator[str]:
    """Yield how far the estimate can be trusted, a sentence each."""
    group = "identification/diagnostics"
    p = result.value(f"{group}/whiteness_p")
    ratio = 100 * result[f"{group}/residual_ratio"].data
    left = f"residual {', '.join(f'{value:.2g} %' for value in ratio)} of the signal"
    yield f"{result.value(f'{group}/verdict')} · {left} · white with p = {p:.2g}"
    if result.value(f"{group}/converged") and not result.value(f"{group}/white"):
        yield "error bars are nominal: what is left is no noise"
    bounds, known = "identification/parameters/at_bound", result["identification/parameters/name"].data
    held = ", ".join(known[result[bounds].data]) if bounds in result else ""
    if held:
        yield f"at a bound: {held}; without it the records would go on"
    condition = result.value(f"{group}/condition")
    relative = (
        result["identification/parameters/standard_error"].data
        / result["identification/parameters/estimate"].data
    )
    names = result["identification/parameters/name"].data
    least = (
        f"least certain: {names[int(np.argmax(relative))]} (standard error {percent(100 * relative.max())})"
    )
    told = f"parameters {'badly' if condition > _BADLY else 'well'} told apart (condition {condition:.2g})"
    yield f"{told} · {least}" if len(names) > 1 else least
    for warning in result[f"{group}/warnings"].data:
        yield f"beware: {warning}"
