"""Content of transfer functions: formulas, poles, zeros, gains, sensitivities, steps, energy shares."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.number_format import MOST_ROOTS, counted, general, limit, root_text, roots_text, unit_text
from dynid.report.content.blocks import Formula, ReportSection, TextTable, definitions
from dynid.report.scenes import in_hertz
from dynid.result import Result

#: Most channels shown in full, and columns of sensitivities.
_FULL, _COLUMNS = 6, 6
#: Most roots of a channel in the table of all.
_ROOTS = 2
#: Properties that are numbers, with their headings.
_NUMBERS = {
    "order": "order",
    "relative_degree": "relative degree",
    "dc_gain": "T(0)",
    "high_frequency_gain": "T(∞)",
}

Channel = tuple[str, str]
Definition = tuple[str, tuple[str, ...]]


def channels(result: Result) -> list[Channel]:
    """Return (output, input) of every channel with results, in the scene's order."""
    prefixes = ("bond_graph/transfer_function/", "bond_graph/properties/", "bond_graph/sensitivities/")
    pairs = dict.fromkeys(tuple(path.split("/")[2:4]) for path in result if path.startswith(prefixes))
    request = result.group_attrs.get("bond_graph", {})
    outputs, inputs = (str(request.get(key, "")).split(", ") for key in ("outputs", "inputs"))
    ordered = [(output, source) for output in outputs for source in inputs if (output, source) in pairs]
    return list(dict.fromkeys([*ordered, *((output, source) for output, source in pairs)]))


def _same_poles(result: Result, channels: list[Channel]) -> bool:
    """Return True if all channels have the same poles and the same verdict on stability."""
    first, *rest = (
        (
            result.get(f"bond_graph/transfer_function/{output}/{source}/poles"),
            result.get(f"bond_graph/properties/{output}/{source}/stability"),
        )
        for output, source in channels
    )
    return first[0] is not None and all(
        (a is b is None) or (a is not None and b is not None and np.array_equal(a.data, b.data))
        for channel in rest
        for a, b in zip(first, channel, strict=True)
    )


def _channel_unit(result: Result, output: str, source: str) -> str:
    """Return the unit of a channel after a space; empty where it is unknown or 1."""
    unit = str(result.group_attrs.get(f"bond_graph/transfer_function/{output}/{source}", {}).get("unit", "1"))
    return f" {unit_text(unit)}".rstrip()


def approximate(result: Result, *paths: str) -> str:
    """Return the mark of what is computed from approximants of delays: empty unless an array says so."""
    attributes = (result[path].attrs for path in paths if path in result)
    return " (approximate)" if any("approximate" in attrs for attrs in attributes) else ""


def numeric_forms(result: Result, group: str) -> Iterable[str]:
    """Yield a short transfer function with numeric coefficients."""
    if f"{group}/gain" in result:
        gain = result.value(f"{group}/gain")
        yield f"{gain:.6g} ∏(s − zeros) / ∏(s − poles)" if gain else "0"
    if f"{group}/numerator" not in result:
        return
    numerator, denominator = result[f"{group}/numerator"].data, result[f"{group}/denominator"].data
    if not numerator.any():
        yield "0"
    elif len(numerator) + len(denominator) <= 12:
        top, bottom = (
            f"({text})" if " + " in text or " - " in text else text
            for text in map(_polynomial, (numerator, denominator))
        )
        yield _polynomial(numerator) if bottom == "1" else f"{top} / {bottom}"


def _polynomial(coefficients: NDArray[Any]) -> str:
    degree = len(coefficients) - 1
    terms: list[str] = []
    for index, value in enumerate(coefficients):
        if value == 0 and degree > 0:
            continue
        power = degree - index
        variable = {0: "", 1: "s"}.get(power, f"s^{power}")
        number = "" if abs(value) == 1 and power else f"{abs(value):.4g}"
        sign = (" - " if value < 0 else " + ") if terms else ("-" if value < 0 else "")
        terms.append(f"{sign}{' '.join(factor for factor in (number, variable) if factor)}")
    return "".join(terms)


def channel_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the common poles of all channels, the first channels in full, and a table of the others."""
    pairs = channels(result)
    common = len(pairs) > 1 and _same_poles(result, pairs)
    if common:
        poles = definitions(("poles", _poles(result, *pairs[0])))
        yield ReportSection("Every channel", (poles,), "answer", screen="every channel")
        # Those of the poles are the same in all channels that have some.
        groups = [f"bond_graph/sensitivities/{output}/{source}" for output, source in pairs]
        group = next((group for group in groups if f"{group}/parameter" in result), groups[0])
        if moved := tuple(_sensitivities(result, group, only=POLE)):
            yield ReportSection("Sensitivities of the poles", moved, screen="")
    if len(pairs) > 1:
        table = _channel_table(result, pairs, poles=not common)
        yield ReportSection("Channels", (table,), "answer")
    for output, source in pairs[:_FULL]:
        name, place = f"{output} / {source}", "details" if len(pairs) > 1 else "answer"
        items = definitions(*_channel_items(result, output, source, poles=not common))
        yield ReportSection(name, (items,), place, screen=name)
        group = f"bond_graph/sensitivities/{output}/{source}"
        if moved := tuple(_sensitivities(result, group, without=POLE if common else None)):
            title = name if place == "details" else f"Sensitivities of {name}"
            yield ReportSection(title, moved, screen="")
    if others := pairs[_FULL:]:
        table = replace(_channel_table(result, others, poles=not common), brief=30)
        yield ReportSection("Other channels", (table,), "", screen="")


def _channel_table(result: Result, pairs: list[Channel], *, poles: bool) -> TextTable:
    """Return the table of the channels: zeros, poles unless all have the same, gains, verdicts."""
    hertz, rows = in_hertz(result), []
    kinds, verdicts = (
        ["zeros", *(["poles"] if poles else [])],
        ["zero_stability", *(["stability"] if poles else [])],
    )
    for output, source in pairs:
        roots = f"bond_graph/transfer_function/{output}/{source}"
        group = f"bond_graph/properties/{output}/{source}"
        unit = _channel_unit(result, output, source)
        cells = [f"{output} / {source}"]
        for path in (f"{roots}/{kind}" for kind in kinds):
            if path not in result:
                cells.append("")
                continue
            values = result[path].data
            upper = values[values.imag >= 0]
            more = f", … ({len(values)})" if len(upper) > _ROOTS else ""
            text = roots_text(upper[:_ROOTS] if more else values, hertz=hertz)
            cells.append(f"{text}{more}{approximate(result, path)}")
        for name, title in _NUMBERS.items():
            path = f"{group}/{name}"
            number = limit(result.value(path)) if path in result else ""
            suffix = unit if title.startswith("T") else approximate(result, path)
            cells.append(f"{number}{suffix if number else ''}")
        for path in (f"{group}/{verdict}" for verdict in verdicts):  # without its reason after the colon
            text = str(result.value(path)).partition(":")[0] if path in result else ""
            cells.append(text + approximate(result, path))
        rows.append(tuple(cells))
    heads = ("", *kinds, *_NUMBERS.values(), "zero dynamics", *(["stability"] if poles else []))
    return TextTable(heads, tuple(rows), noun="channel").filled()


def _channel_items(result: Result, output: str, source: str, *, poles: bool) -> Iterator[Definition]:
    """Yield formula, zeros, poles, properties and hidden modes of a channel."""
    group = f"bond_graph/transfer_function/{output}/{source}"
    formulas = [*numeric_forms(result, group)]
    if (symbolic := str(result.group_attrs.get(group, {}).get("symbolic", ""))) and formulas != ["0"]:
        formulas.append(symbolic.replace("**", "^"))
    if formulas:
        formulas[-1] += approximate(result, f"{group}/denominator", f"{group}/gain")
    lines: list[str] = [Formula(f"= {formula}") for formula in formulas]
    if f"{group}/program" in result:
        program = str(result.value(f"{group}/program")).splitlines()
        lines += [f"nested, in {counted(len(program), 'assignment')}:", *program[:MOST_ROOTS]]
        if len(program) > MOST_ROOTS:
            lines.append(f"… {len(program) - MOST_ROOTS} more in the file")
    for polynomial in ("numerator", "denominator"):
        if f"{group}/symbolic_{polynomial}" in result:
            terms = counted(int(result[f"{group}/symbolic_{polynomial}"].attrs["terms"]), "term")
            lines.append(f"expanded {polynomial} of {terms} in the file")
    yield "T(s)", tuple(lines)
    zeros = _roots(result, output, source, "zeros", "zero_stability", hertz=in_hertz(result))
    yield "zeros", tuple(zeros)
    if poles:
        yield "poles", _poles(result, output, source)
    group, unit = f"bond_graph/properties/{output}/{source}", _channel_unit(result, output, source)
    numbers = (
        f"{title} = {limit(result.value(f'{group}/{name}'))}{unit}"
        if title.startswith("T")
        else f"{title} {limit(result.value(f'{group}/{name}'))}{approximate(result, f'{group}/{name}')}"
        for name, title in _NUMBERS.items()
        if f"{group}/{name}" in result
    )
    yield "properties", (" · ".join(numbers),)
    yield from ((title, (text,)) for title, text in characteristics(result, output, source))
    yield "hidden modes", tuple(_hidden_modes(result, group))


def _hidden_modes(result: Result, group: str) -> Iterator[str]:
    """Yield the modes that a channel does not show, with their causes."""
    hidden, hertz = result.get(f"{group}/hidden_modes"), in_hertz(result)
    if hidden is None or not len(hidden.data):
        return
    roots = roots_text(hidden.data, hertz=hertz) + approximate(result, f"{group}/hidden_modes")
    yield f"{roots} (uncontrollable or unobservable in this channel)"
    if note := str(result.group_attrs.get(group, {}).get("hidden_mode_note", "")):
        yield note
    if f"{group}/hidden_mode_cause" not in result:
        return
    causes, elements = (result[f"{group}/hidden_mode_{column}"].data for column in ("cause", "elements"))
    upper = [index for index, root in enumerate(hidden.data) if root.imag >= 0]
    for index in upper[:MOST_ROOTS]:
        energy = f"; its energy is in {elements[index]}" if elements[index] else ""
        yield f"{root_text(hidden.data[index], hertz=hertz)}: {causes[index]}{energy}"


def _roots(
    result: Result, output: str, source: str, name: str, verdict: str, *, hertz: bool
) -> Iterator[str]:
    """Yield the roots and the verdict on their stability."""
    path = f"bond_graph/transfer_function/{output}/{source}/{name}"
    if path in result:
        yield roots_text(result[path].data, hertz=hertz) + approximate(result, path)
    path = f"bond_graph/properties/{output}/{source}/{verdict}"
    if path in result:
        yield str(result.value(path)) + approximate(result, path)


def _poles(result: Result, output: str, source: str) -> tuple[str, ...]:
    """Return the poles with their natural frequencies and damping ratios."""
    path = f"bond_graph/transfer_function/{output}/{source}/poles"
    pairs = [pole for pole in result[path].data if pole.imag > 0] if path in result else []
    oscillates = 0 < len(pairs) <= MOST_ROOTS
    hertz = in_hertz(result) and not oscillates  # natural frequencies are written once
    lines = list(_roots(result, output, source, "poles", "stability", hertz=hertz))
    if oscillates:
        symbol = "f_n" if in_hertz(result) else "ω_n"
        oscillations = (
            f"{symbol} = {frequency(result, abs(pole))}, ζ = {-pole.real / abs(pole) or 0.0:.4g}"
            for pole in pairs
        )
        lines.append(" · ".join(oscillations))
    return tuple(lines)


def _sensitivities(
    result: Result, group: str, *, only: str = "", without: str | None = None
) -> Iterator[TextTable]:
    """Yield the table of sensitivities of a channel, the most influential parameter first.

    `only`, `without`: as of `_sensitivity_columns`.
    """
    if f"{group}/parameter" not in result:
        return
    columns = _sensitivity_columns(result, group, only=only, without=without)
    if not columns:
        return
    names, weight = result[f"{group}/parameter"].data, influence(columns)
    rows = tuple(
        (str(names[k]), *(sensitivity_text(moved[k] / 100) for _, moved in columns[:_COLUMNS]))
        for k in np.argsort(-weight, kind="stable")
        if weight[k]
    )
    more = (
        f", the first {_COLUMNS} of {len(columns)} zeros, poles and gains" if len(columns) > _COLUMNS else ""
    )
    yield TextTable(
        ("", *(title for title, _ in columns[:_COLUMNS])),
        rows,
        caption=f"changes if a parameter is larger by 1 %{more}",
        noun="parameter",
        brief=8,
        brief_columns=5,
    )


#: First word of the titles of columns of poles.
POLE = "pole"


def _sensitivity_columns(
    result: Result, group: str, *, only: str = "", without: str | None = None
) -> list[tuple[str, NDArray[Any]]]:
    """Return titles and relative sensitivities of the poles, zeros and gains that depend on a parameter.

    `only`, `without`: the beginning of the titles of the columns that are wanted, or are not.
    """
    columns = []
    unit = " rad/s" if in_hertz(result) else ""
    late = bool(approximate(result, f"{group}/poles"))  # approximants have other roots, but the same T(0)
    for name in () if late else (POLE, "zero"):
        moved = result[f"{group}/{name}_sensitivity_relative"].data
        for index, root in enumerate(result[f"{group}/{name}s"].data):
            if root.imag >= 0:
                columns.append((f"{name} {root_text(root)}{unit}", moved[index]))
    for title, name in (("T(0)", "dc_gain"), ("T(∞)", "high_frequency_gain"))[: 1 if late else 2]:
        columns.append((title, result[f"{group}/{name}_sensitivity_relative"].data))
    return [
        (title, moved)
        for title, moved in columns
        if moved.any() and title.startswith(only) and not (without and title.startswith(without))
    ]


def influence(columns: list[tuple[str, NDArray[Any]]]) -> NDArray[np.float64]:
    """Return the influence of each parameter: its sensitivity over the largest, maximum of all columns."""
    shares = []
    for _, moved in columns:
        sizes = np.where(np.isfinite(moved), np.abs(moved), 0.0)
        shares.append(sizes / (sizes.max() or 1.0))
    return np.asarray(np.max(shares, axis=0), dtype=float)


def sensitivity_text(moved: complex) -> str:
    """Return a change as text."""
    if not np.isfinite(moved):
        return "∞"
    if isinstance(moved, complex | np.complexfloating) and moved.imag:
        sign, size = "+" if moved.imag > 0 else "-", f"{abs(moved.imag):.3g}j"
        return f"{moved.real:+.3g} {sign} {size}" if moved.real else f"{sign}{size}"
    return f"{moved.real:+.3g}" if moved else "0"


_ENERGY, _SOURCES = "bond_graph/energy", "bond_graph/source_performance"
#: Most elements named in a list of shares, and the smallest share.
_ELEMENTS, _LEAST = 4, 0.005

Line = tuple[str, str]


def frequency(result: Result, omega: float) -> str:
    """Return a frequency in the unit of the scene."""
    return f"{omega / math.tau:.4g} Hz" if in_hertz(result) else f"{omega:.4g} rad/s"


def characteristics(result: Result, output: str, source: str) -> Iterator[Line]:
    """Yield the characteristics of the step response, and the bandwidth of a channel, each with its title."""
    group = f"bond_graph/properties/{output}/{source}"
    get = {
        path.rpartition("/")[2]: float(variable.data)
        for path, variable in result.items()
        if path.startswith(f"{group}/") and variable.dims == () and variable.dtype.kind in "fi"
    }

    def number(name: str) -> str:
        return general(get[name])

    if f"{group}/step_status" in result:
        parts = []
        if "rise_time" in get:
            parts.append(f"rise time {number('rise_time')} s (10 to 90 %)")
            parts.append(f"settling time {number('settling_time')} s (2 %)")
            parts.append(f"overshoot {number('overshoot')} %")
            if get["undershoot"] > 0:
                parts.append(f"undershoot {number('undershoot')} %")
        if "peak" in get:
            when = "" if math.isinf(get["peak_time"]) else f" at {number('peak_time')} s"
            parts.append(f"peak {number('peak')}{when}")
        yield "step response", _defined(result, f"{group}/step_status", parts)
    if f"{group}/bandwidth_status" in result:
        parts = []
        if "bandwidth" in get:
            band = get["bandwidth"]
            parts.append(
                "no upper limit" if math.isinf(band) else f"{frequency(result, band)} (-3 dB of T(0))"
            )
        if "peak_gain" in get:
            at = get["peak_frequency"]
            where = "at high frequencies" if math.isinf(at) else f"at {frequency(result, at)}"
            parts.append(f"largest |T| {number('peak_gain')} {where}")
        yield "bandwidth", _defined(result, f"{group}/bandwidth_status", parts)


def _defined(result: Result, status: str, parts: list[str]) -> str:
    """Return characteristics, marked where they are approximate, and why others are not defined."""
    reason = str(result.value(status))
    values = [" · ".join(parts) + approximate(result, status)] if parts else []
    return " · ".join([*values, *([] if reason == "defined" else [reason])])


def energy_sections(result: Result) -> Iterator[ReportSection]:
    """Yield where the modes have their energy, and what the sources give."""
    sources = f"Sources{approximate(result, f'{_SOURCES}/omega')}"
    for title, lines in (("Energy of the modes", _energy_lines(result)), (sources, _source_lines(result))):
        if rows := list(lines):
            yield ReportSection(title, (definitions(*rows),), screen=title.lower())


def _energy_lines(result: Result) -> Iterator[Line]:
    """Yield where every mode has its energy, and what damps it."""
    if f"{_ENERGY}/status" not in result:
        return
    status = str(result.value(f"{_ENERGY}/status"))
    if status != "defined":
        yield "energy", status
        return
    poles = result[f"{_ENERGY}/poles"].data
    stored, lost = (result[f"{_ENERGY}/{name}_share"].data for name in ("stored", "dissipated"))
    storages, resistors = (result[f"{_ENERGY}/{name}"].data for name in ("storage", "resistor"))
    for index, pole in enumerate(poles[:MOST_ROOTS]):
        text = f"energy in {_shares(storages, stored[index])}"
        if lost[index].any():
            text += f"; dissipated in {_shares(resistors, lost[index])}"
        else:
            text += "; no resistor damps it"
        yield root_text(pole, hertz=in_hertz(result)), text
    if len(poles) > MOST_ROOTS:
        yield "…", f"{len(poles) - MOST_ROOTS} more in the file"


def _shares(names: Any, shares: Any) -> str:
    """Return the largest shares in words."""
    order = [int(k) for k in np.argsort(-shares, kind="stable") if shares[k] >= _LEAST]
    parts = [f"{names[k]} {100 * shares[k]:.3g} %" for k in order[:_ELEMENTS]]
    return ", ".join(parts) + (", …" if len(order) > _ELEMENTS else "")


def _source_lines(result: Result) -> Iterator[Line]:
    """Yield the largest power that every input gives over the band, and its impedance there."""
    if f"{_SOURCES}/omega" not in result:
        return
    omega = result[f"{_SOURCES}/omega"].data
    for path in result:
        if path.startswith(f"{_SOURCES}/") and path.endswith("/active_power"):
            group = path.removesuffix("/active_power")
            power, impedance = result[path].data, result[f"{group}/impedance"]
            at = int(np.argmax(power))
            size, unit = abs(impedance.data[at]), unit_text(impedance.units)
            name = group.removeprefix(f"{_SOURCES}/")
            text = f"at an amplitude of 1 at most {power[at]:.4g} {result[path].units or 'W'}"
            where = frequency(result, omega[at])
            yield name, f"{text} at {where}, where |Z| = {size:.4g} {unit}".rstrip()
