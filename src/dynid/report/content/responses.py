"""Content of responses and modes: peaks, ranges in time, modes of test and model, derived values."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dynid.number_format import counted, general, quantity, significant, span_text
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable, on_page
from dynid.report.notation import texts
from dynid.report.scenes import frequency_span, frequency_unit, peak_responses, time_courses
from dynid.result import Result

#: Group of the modes in a result.
GROUP = "identification/modes"
# Negative damping ratio that is rounding of an undamped rotor, and circularity below which a whirl is a line.
_UNSTABLE, _LINE = 1e-12, 5e-3


def has_modes(result: Result) -> bool:
    """Return True if a result has measured modes."""
    return f"{GROUP}/frequency_measured" in result


def is_backbone(result: Result) -> bool:
    """Return True if a result has modes measured at amplitudes."""
    return f"{GROUP}/amplitude" in result


def modal_summary(result: Result) -> str:
    """Return the numbers of modes and sensors, and the span of frequencies."""
    measured = result[f"{GROUP}/frequency_measured"]
    span = f"{measured.data.min():.5g} … {measured.data.max():.5g} {measured.units}"
    sensors = len(result[f"{GROUP}/sensor"].data) if f"{GROUP}/sensor" in result else 0
    at = f", shapes at {counted(sensors, 'sensor')}" if sensors else ""
    what = "backbone point" if is_backbone(result) else "measured mode"
    return f"{counted(measured.data.size, what)}, {span}{at}"


def modal_table(result: Result) -> TextTable:
    """Return the table of the modes: frequency, its error and MAC before and after."""
    get = {
        path.removeprefix(f"{GROUP}/"): variable.data
        for path, variable in result.items()
        if path.startswith(GROUP)
    }
    unit = result[f"{GROUP}/frequency_measured"].units
    shapes, damping, left = "mac" in get, "damping_measured" in get, "left_out_error" in get
    sizes = result[f"{GROUP}/amplitude"] if "amplitude" in get else None
    heads = ["mode"] if sizes is None else ["point", "mode", f"amplitude {sizes.units}"]
    heads += [f"measured {unit}", "model", "error at start", "error"]
    heads += ["left out"] * left + ["MAC at start", "MAC"] * shapes + ["ζ measured", "ζ"] * damping
    rows = []
    for k in range(len(get["mode"])):
        row = [str(k + 1)]
        if sizes is not None:
            row += [str(get["model_mode"][k]), general(float(sizes.data[k]))]
        row += [f"{get['frequency_measured'][k]:.5g}", f"{get['frequency'][k]:.5g}"]
        errors = ("frequency_error_start", "frequency_error", *(["left_out_error"] if left else []))
        row += [_text(100 * get[name][k], "{:+.2f} %") for name in errors]
        row += [_text(get[name][k], "{:.3f}") for name in ("mac_start", "mac") if shapes]
        row += [_text(100 * get[name][k], "{:.3g} %") for name in ("damping_measured", "damping") if damping]
        rows.append(tuple(row))
    return TextTable(tuple(heads), tuple(rows), noun="mode", most=ALL)


def _text(value: float, form: str) -> str:
    return "-" if np.isnan(value) else form.format(value)


def modal_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the comparison of measured and computed modes."""
    if has_modes(result):
        # Errors of the model's form, and what the data determine.
        statements = map(Statement, texts(result, f"{GROUP}/statements"))
        blocks = (on_page(Statement(modal_summary(result))), modal_table(result), *statements)
        title = "Measured backbones" if is_backbone(result) else "Measured modes"
        yield ReportSection(title, blocks, "answer", screen="")


DERIVED, _POSTERIOR = "identification/derived", "identification/posterior"


def is_requested(result: Result) -> bool:
    """Return True if derived quantities were requested; those of small systems are in the file alone."""
    return bool(result.group_attrs.get(DERIVED, {}).get("requested", False))


def derived_table(result: Result) -> TextTable:
    """Return the table of the oscillating modes and zeros with their 95 % bands."""
    unit, rows = frequency_unit(result), list[tuple[str, ...]]()
    for path in result:
        if not path.startswith(DERIVED) or not path.endswith("/frequency/value"):
            continue
        group = path.removesuffix("/frequency/value")
        kind, _, channel = group.removeprefix(f"{DERIVED}/").partition("/")
        get = {
            (name, end): result[f"{group}/{name}/{end}"].data
            for name in ("frequency", "damping")
            for end in ("value", "low", "high")
        }
        for k in range(len(result[path].data)):
            cells = [f"{'zero' if kind == 'zeros' else 'mode'} {k + 1}{f' of {channel}' if channel else ''}"]
            for name, factor in (("frequency", unit.factor), ("damping", 100.0)):
                value, low, high = (factor * float(get[name, end][k]) for end in ("value", "low", "high"))
                error = (high - low) / 4
                ends = f"{quantity(low, error)} … {quantity(high, error)}" if error else "for all values"
                cells += [quantity(value, error or None), ends]
            rows.append(tuple(cells))
    return TextTable(("", unit.name, "95 % band", "ζ in %", "95 % band"), tuple(rows), most=20)


def statements(result: Result) -> Iterator[str]:
    """Yield the verdicts on the identified model, and that on its posterior."""
    group = f"{DERIVED}/verdicts"
    if f"{group}/verdict" in result and is_requested(result):
        names, texts = (result[f"{group}/{column}"].data for column in ("verdict", "statement"))
        for name, text in zip(names, texts, strict=True):
            channel = str(name).partition("minimum phase ")[2]
            yield f"{channel}: {text}" if channel else str(text)
    if f"{_POSTERIOR}/k_hat" in result:
        word = "is" if result.value(f"{_POSTERIOR}/gaussian") else "is not"
        yield (
            f"the posterior {word} Gaussian (k = {result.value(f'{_POSTERIOR}/k_hat'):.2f}, "
            f"{result.value(f'{_POSTERIOR}/effective_samples'):.0f} effective samples of "
            f"{result.group_attrs[_POSTERIOR]['samples']})"
        )


def derived_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the section on what follows from the estimate."""
    table = derived_table(result) if is_requested(result) else None
    tables = (table,) if table is not None and table.rows else ()
    if blocks := (*tables, *map(Statement, statements(result))):
        yield ReportSection("What follows from the estimate", blocks, "answer", screen="")


#: Group of the steady states in a result.
STEADY, BACKBONE = "response/harmonic_balance", "response/backbone"


def rotor_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the modes of a rotor."""
    group = "structure/complex_modes"
    if f"{group}/whirl" not in result:
        return
    columns = (result[f"{group}/{name}"].data for name in ("omega", "damping", "whirl"))
    rows = tuple(
        (str(k), significant(w, 5), significant(w / math.tau, 5), f"{100 * ratio + 0.0:.3g} %", _sense(turn))
        for k, (w, ratio, turn) in enumerate(zip(*columns, strict=True), 1)
    )
    caption = f"{counted(len(rows), 'mode')} of {counted(len(result[f'{group}/dof'].data), 'DOF')}"
    table = TextTable(("mode", "rad/s", "Hz", "ζ", "whirl"), rows, caption=caption, noun="mode").filled()
    unstable = [
        row[0] for row, ratio in zip(rows, result[f"{group}/damping"].data, strict=True) if ratio < -_UNSTABLE
    ]
    remark = [Statement(f"unstable: mode {', '.join(unstable)}", "bad")] if unstable else []
    yield ReportSection("Modes of the rotor", (table, *remark), "answer", screen="")


def _sense(turn: float) -> str:
    """Return the sense of a whirl, and how circular it is."""
    if math.isnan(turn):
        return "—"
    return f"{'forward' if turn > 0 else 'backward'} {abs(turn):.2f}" if abs(turn) > _LINE else "line"


def steady_sections(result: Result) -> Iterator[ReportSection]:
    """Yield what a curve of steady states shows: its peak, its folds, how many states are unstable."""
    if f"{STEADY}/omega" not in result:
        return
    unit, about = frequency_unit(result), result.group_attrs[STEADY]
    omega, amplitude = (result[f"{STEADY}/{name}"] for name in ("omega", "amplitude"))
    top = int(amplitude.data.argmax())
    said = (
        f"displacement of {about['output']} under the force {general(float(about['force']))} cos ωt at "
        f"{about['dof']}: "
        f"{counted(len(omega.data), 'steady state')}, largest amplitude {general(amplitude.data[top])} "
        f"{amplitude.units} at {general(unit.factor * omega.data[top])} {unit.name}"
    )
    rows = [said, f"{counted(int(about['folds']), 'fold')} of the curve"]
    if f"{STEADY}/stable" in result:
        unstable = int(np.count_nonzero(~result[f"{STEADY}/stable"].data))
        rows[-1] += f", {counted(unstable, 'unstable state')}"
        kinds = Counter(name for name in result[f"{STEADY}/instability"].data.tolist() if name)
        if kinds and set(kinds) != {"fold"}:
            rows[-1] += f" ({', '.join(f'{name}: {count}' for name, count in kinds.items())})"
    if f"{BACKBONE}/omega" in result and len(result[f"{BACKBONE}/omega"].data):
        mode, ratio = result[f"{BACKBONE}/omega"].data, 100 * result[f"{BACKBONE}/damping"].data
        size, number = result[f"{BACKBONE}/amplitude"].data, result.group_attrs[BACKBONE]["mode"]
        rows.append(
            f"backbone of mode {number}: {general(unit.factor * mode[0])} {unit.name}, damping "
            f"{general(ratio[0])} % at {general(size[0])} {amplitude.units}; "
            f"{general(unit.factor * mode[-1])} {unit.name}, {general(ratio[-1])} % at {general(size[-1])} "
            f"{amplitude.units}"
        )
    if note := about.get("note"):
        rows.append(str(note))
    if note := result.group_attrs.get(BACKBONE, {}).get("note"):
        rows.append(f"the backbone is {note}")
    yield ReportSection("Steady states", tuple(map(Statement, rows)), "answer", screen="")


#: Most channels and outputs on a screen, and on a page.
_BRIEF, _MOST = 12, 30
#: Part of the largest value of a response below which a value is round-off.
_RESPONSE_ROUND_OFF = 1e-12


def response_sections(result: Result, base: str) -> Iterator[ReportSection]:
    """Yield the peaks of the frequency responses and the ranges of the time responses of a group."""
    group = f"{base}/frequency_response"
    if f"{group}/omega" in result:
        (low, high, unit), peaks = frequency_span(result, group), peak_responses(result, group)
        rows = []
        for k, output in enumerate(result[f"{group}/output"].data):
            for m, source in enumerate(result[f"{group}/input"].data):
                size = peaks.magnitude[k, m]
                where = f"{general(peaks.at[k, m])}{peaks.note[k, m]}" if size else "all"
                rows.append((f"{output} / {source}", general(size), where))
        span = f"{counted(len(result[f'{group}/omega'].data), 'frequency')}, {span_text(low, high)} {unit}"
        table = TextTable(
            ("", "peak magnitude", f"frequency ({unit})"),
            tuple(rows),
            caption=span,
            noun="channel",
            brief=_BRIEF,
            most=_MOST,
        )
        yield ReportSection("Frequency response", (table, *_note(result, group)), screen="frequency response")
    group = f"{base}/time_response"
    if f"{group}/time" in result:
        courses, outputs = time_courses(result, group), result[f"{group}/output"].data
        time, sources, inputs = (result[f"{group}/{name}"].data for name in ("time", "source", "input"))
        driven = ", ".join(str(name) for name, column in zip(sources, inputs.T, strict=True) if column.any())
        alone = ", each alone" if result[f"{group}/response"].data.ndim == 3 else ""
        to = f"to {driven}{alone}, " if driven else ""
        table = TextTable(
            ("", "min", "max", "final"),
            tuple((name, *extremes(course)) for name, course in courses),
            caption=f"{to}{time[0]:.4g} … {time[-1]:.4g} s, {counted(len(time), 'sample')}",
            noun="output" if len(courses) == len(outputs) else "response",
            brief=_BRIEF,
            most=_MOST,
        )
        yield ReportSection("Time response", (table, *_note(result, group)), screen="time response")
    if f"{base}/joints/force" in result:
        yield _joints(result, f"{base}/joints")


def _note(result: Result, group: str) -> tuple[Statement, ...]:
    """Return the note of a group, if it has one."""
    note = result.group_attrs.get(group, {}).get("note")
    return (Statement(f"note: {note}"),) if note else ()


def _joints(result: Result, group: str) -> ReportSection:
    """Return the ranges of joints with nonlinear laws, and how often their regimes change."""
    names = [str(name) for name in result[f"{group}/joint"].data]
    largest = [np.abs(result[f"{group}/{name}"].data).max(axis=0) for name in ("deflection", "force")]
    work = result[f"{group}/work"].data[-1]
    rows = [(name, *map(general, numbers)) for name, *numbers in zip(names, *largest, work, strict=True)]
    events = int(result.group_attrs[group]["events"])
    table = TextTable(
        ("", "max |deflection| (m)", "max |force| (N)", "work (J)"),
        tuple(rows),
        caption=f"forces of nonlinear laws, {counted(events, 'change')} of regime",
        noun="joint",
        brief=_BRIEF,
        most=_MOST,
    )
    return ReportSection("Nonlinear joints", (table, *_note(result, group)), screen="nonlinear joints")


def extremes(column: NDArray[np.float64]) -> tuple[str, str, str]:
    """Return the smallest, the largest and the last value of a response; what is round-off of it as 0."""
    round_off = _RESPONSE_ROUND_OFF * float(np.abs(column).max())
    low, high, final = (
        general(0.0 if abs(value) <= round_off < math.inf else value)
        for value in (column.min(), column.max(), column[-1])
    )
    return low, high, final
