"""What is said of transfer functions: what each channel does, and what all of them share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from dynid.numerals import MOST_ROOTS, limit, root_text, roots_text
from dynid.report.answers.blocks import Block, Grid, Part, facts
from dynid.report.answers.common import more
from dynid.report.answers.sensitivities import cell, columns, influence
from dynid.result import Result

#: Most channels that are told in full, most rows of tables, most columns of sensitivities, longest formula.
_FULL, _ROWS, _COLUMNS, _LONGEST = 6, 60, 6, 400
#: The properties that are numbers.
_NUMBERS = ("order", "relative_degree", "dc_gain", "high_frequency_gain")

Channel = tuple[str, str]


def channels(result: Result) -> list[Channel]:
    """List (output, input) of every channel with results, in the scene's order."""
    prefixes = ("bond_graph/transfer_function/", "bond_graph/properties/", "bond_graph/sensitivities/")
    found = dict.fromkeys(tuple(path.split("/")[2:4]) for path in result if path.startswith(prefixes))
    asked = result.group_attrs.get("bond_graph", {})
    outputs, inputs = (str(asked.get(key, "")).split(", ") for key in ("outputs", "inputs"))
    ordered = [(output, source) for output in outputs for source in inputs if (output, source) in found]
    return list(dict.fromkeys([*ordered, *((output, source) for output, source in found)]))


def same_poles(result: Result, channels: list[Channel]) -> bool:
    """Tell whether all channels have the same poles, and the same is said of them."""
    first, *rest = (
        (
            result.get(f"bond_graph/transfer_function/{output}/{source}/poles"),
            result.get(f"bond_graph/properties/{output}/{source}/stability"),
        )
        for output, source in channels
    )
    return first[0] is not None and all(
        (a is b is None) or (a is not None and b is not None and np.array_equal(a.data, b.data))
        for other in rest
        for a, b in zip(first, other, strict=True)
    )


def unit_of(result: Result, output: str, source: str) -> str:
    """Return the unit of a channel, a space before it; nothing where no domain tells it, or it has none."""
    unit = str(result.group_attrs.get(f"bond_graph/transfer_function/{output}/{source}", {}).get("unit", "1"))
    return "" if unit == "1" else f" {unit}"


def in_numbers(result: Result, group: str) -> Iterable[str]:
    """Write a short transfer function in numbers."""
    if f"{group}/gain" in result:
        gain = result.value(f"{group}/gain")
        yield f"{gain:.6g} ∏(s − zeros) / ∏(s − poles)" if gain else "0"
    if f"{group}/numerator" not in result:
        return
    numerator, denominator = result[f"{group}/numerator"].data, result[f"{group}/denominator"].data
    if not numerator.any():
        yield "0"
    elif len(numerator) + len(denominator) <= 12:
        top, bottom = _polynomial(numerator), _polynomial(denominator)
        yield top if bottom == "1" else f"{_bracketed(top)} / {_bracketed(bottom)}"


def _bracketed(polynomial: str) -> str:
    return f"({polynomial})" if " + " in polynomial or " - " in polynomial else polynomial


def _polynomial(coefficients: np.ndarray[Any, Any]) -> str:
    degree = len(coefficients) - 1
    terms: list[str] = []
    for place, value in enumerate(coefficients):
        if value == 0 and degree > 0:
            continue
        power = degree - place
        variable = {0: "", 1: "s"}.get(power, f"s^{power}")
        number = "" if abs(value) == 1 and power else f"{abs(value):.4g}"
        sign = (" - " if value < 0 else " + ") if terms else ("-" if value < 0 else "")
        terms.append(f"{sign}{' '.join(part for part in (number, variable) if part)}")
    return "".join(terms)


def channel_parts(result: Result) -> Iterator[Part]:
    """Yield every channel: the poles that all share first, then each, then a table of what are too many."""
    every = channels(result)
    common = len(every) > 1 and same_poles(result, every)
    if common:
        yield Part("Every channel", (facts(*_poles(result, *every[0])),))
    for channel in every[:_FULL]:
        yield Part(" / ".join(channel), tuple(_channel(result, *channel, poles=not common)))
    if len(every) > _FULL:
        yield Part("Further channels", tuple(_table(result, every[_FULL:])))


def _channel(result: Result, output: str, source: str, *, poles: bool) -> Iterator[Block]:
    transfer = f"bond_graph/transfer_function/{output}/{source}"
    properties = f"bond_graph/properties/{output}/{source}"
    items = [
        ("T(s)", tuple(_formula(result, transfer))),
        ("zeros", tuple(_roots(result, output, source, "zeros", "zero_stability"))),
        *(_poles(result, output, source) if poles else ()),
        *_degrees(result, properties, unit_of(result, output, source)),
        ("hidden modes", tuple(_hidden(result, properties))),
    ]
    yield facts(*items)
    yield from _sensitivities(result, f"bond_graph/sensitivities/{output}/{source}")


def _formula(result: Result, group: str) -> Iterator[str]:
    yield from in_numbers(result, group)
    symbolic = str(result.group_attrs.get(group, {}).get("symbolic", ""))
    if symbolic:
        yield symbolic if len(symbolic) < _LONGEST else "its formula is in the file"
    if f"{group}/program" in result:
        lines = str(result.value(f"{group}/program")).splitlines()
        yield from lines[:MOST_ROOTS]
        if len(lines) > MOST_ROOTS:
            yield f"… {len(lines) - MOST_ROOTS} more in the file"


def _roots(result: Result, output: str, source: str, name: str, verdict: str) -> Iterator[str]:
    path = f"bond_graph/transfer_function/{output}/{source}/{name}"
    if path in result:
        yield roots_text(result[path].data)
    said = f"bond_graph/properties/{output}/{source}/{verdict}"
    if said in result:
        yield str(result.value(said))


def _poles(result: Result, output: str, source: str) -> list[tuple[str, tuple[str, ...]]]:
    lines = list(_roots(result, output, source, "poles", "stability"))
    path = f"bond_graph/transfer_function/{output}/{source}/poles"
    pairs = [pole for pole in result[path].data if pole.imag > 0] if path in result else []
    if 0 < len(pairs) <= MOST_ROOTS:
        lines += [f"ω_n = {abs(p):.4g} rad/s, ζ = {-p.real / abs(p) or 0.0:.4g}" for p in pairs]
    return [("poles", tuple(lines))]


def _degrees(result: Result, group: str, unit: str) -> list[tuple[str, tuple[str, ...]]]:
    titles = ("order", "relative degree", "T(0)", "T(∞)")
    return [
        (title, (f"{limit(result.value(f'{group}/{name}'))}{unit if title.startswith('T') else ''}",))
        for title, name in zip(titles, _NUMBERS, strict=True)
        if f"{group}/{name}" in result
    ]


def _hidden(result: Result, group: str) -> Iterator[str]:
    """Say which natural modes a channel does not show, and why where that was asked for."""
    path = f"{group}/hidden_modes"
    if path not in result or not len(result[path].data):
        return
    modes = result[path].data
    yield f"{roots_text(modes)} (natural modes that this channel does not show)"
    if f"{group}/hidden_mode_cause" in result:
        causes, elements = (result[f"{group}/hidden_mode_{part}"].data for part in ("cause", "elements"))
        upper = [place for place, root in enumerate(modes) if root.imag >= 0]
        for place in upper[:MOST_ROOTS]:
            held = f"; its energy is in {elements[place]}" if elements[place] else ""
            yield f"{root_text(modes[place])}: {causes[place]}{held}"


def _sensitivities(result: Result, group: str) -> Iterator[Block]:
    if f"{group}/parameter" not in result:
        return
    every = columns(result, group)
    shown = every[:_COLUMNS]
    names = result[f"{group}/parameter"].data
    weight = influence(every) if every else np.zeros(len(names))
    order = [int(place) for place in np.argsort(-weight, kind="stable") if weight[place]]
    rows = tuple(
        (str(names[place]), *(cell(moved[place] / 100) for _, moved in shown)) for place in order[:_ROWS]
    )
    if rows:
        heads = ("", *(title for title, _ in shown))
        yield Grid(heads, rows, caption="What a parameter larger by 1 % moves")
        yield from more(len(every), _COLUMNS, "column")


def _table(result: Result, several: list[Channel]) -> Iterator[Block]:
    """Set what can be said of many channels in a word each in columns."""
    rows = []
    for output, source in several[:_ROWS]:
        group = f"bond_graph/properties/{output}/{source}"
        numbers = (
            limit(result.value(f"{group}/{name}")) if f"{group}/{name}" in result else "" for name in _NUMBERS
        )
        words = (
            str(result.value(f"{group}/{name}")).partition(":")[0] if f"{group}/{name}" in result else ""
            for name in ("zero_stability", "stability")
        )
        rows.append((f"{output} / {source}", *numbers, *words))
    yield Grid(("", "order", "relative degree", "T(0)", "T(∞)", "zeros", "poles"), tuple(rows))
    yield from more(len(several), _ROWS, "channel")
