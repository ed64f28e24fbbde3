"""The screen of transfer functions: what each channel does, and what all of them share."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import wrap
from typing import Any

import numpy as np

from dynid.cli.summary.sensitivities import sensitivity_lines
from dynid.number_format import MOST_ROOTS, counted, limit, root_text, roots_text
from dynid.report.content.transfer_functions import (
    Channel,
    channel_unit,
    channels,
    numeric_forms,
    oscillation_text,
    same_poles,
)
from dynid.report.scenes import in_hertz
from dynid.result import Result

#: Most channels that are told in full, most rows of the table of the others, and longest formula shown.
_FULL, _ROWS, _LONGEST = 6, 30, 160

#: Columns of the screen.
_WIDTH = 110

#: The properties that are numbers.
_NUMBERS = ("order", "relative_degree", "dc_gain", "high_frequency_gain")


def channel_lines(result: Result) -> Iterable[str]:
    """Yield every channel: the poles that all share first, then each, then a table of what are too many."""
    every = channels(result)
    common = len(every) > 1 and same_poles(result, every)
    if common:
        yield "  every channel"
        yield from _poles(result, *every[0])
        yield ""
    for channel in every[:_FULL]:
        yield from _channel(result, *channel, alone=len(every) == 1, poles=not common)
        yield ""
    if len(every) > _FULL:
        yield from _table(result, every[_FULL:])
        yield ""


def _table(result: Result, several: list[Channel]) -> Iterable[str]:
    """Set what can be said of many channels in a word each in columns."""
    groups = [f"bond_graph/properties/{output}/{source}" for output, source in several]
    if not all(f"{group}/order" in result for group in groups):
        yield f"  … {counted(len(several), 'more channel')} in the file"
        return
    rows = [["", "order", "relative degree", "T(0)", "T(∞)", "zeros", "poles"]]
    for (output, source), group in zip(several[:_ROWS], groups, strict=False):
        numbers = (limit(result.value(f"{group}/{name}")) for name in _NUMBERS)
        words = (_word(result, f"{group}/{name}") for name in ("zero_stability", "stability"))
        rows.append([f"{output} / {source}", *numbers, *words])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = [
            cell.rjust(width) if 0 < column < 5 else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield f"  {'  '.join(cells)}".rstrip()
    if len(several) > _ROWS:
        yield f"  … {counted(len(several) - _ROWS, 'more channel')} in the file"


def _word(result: Result, path: str) -> str:
    """Return the verdict itself, without what decides it."""
    return str(result.value(path)).partition(":")[0] if path in result else ""


def _channel(result: Result, output: str, source: str, *, alone: bool, poles: bool) -> Iterable[str]:
    properties = f"bond_graph/properties/{output}/{source}"
    yield f"  {output} / {source}"
    yield from _formula(result, f"bond_graph/transfer_function/{output}/{source}", alone=alone)
    yield from _roots(result, output, source, "zeros", "zero_stability")
    if poles:
        yield from _poles(result, output, source)
    yield from _numbers(result, properties, channel_unit(result, output, source))
    yield from sensitivity_lines(result, f"bond_graph/sensitivities/{output}/{source}")


def _poles(result: Result, output: str, source: str) -> Iterable[str]:
    """Write the poles, their verdict, and what they are as oscillations."""
    yield from _roots(result, output, source, "poles", "stability")
    path = f"bond_graph/transfer_function/{output}/{source}/poles"
    if path in result:
        yield from _modes(result, result[path].data)


def _roots(result: Result, output: str, source: str, name: str, verdict: str) -> Iterable[str]:
    roots = result.get(f"bond_graph/transfer_function/{output}/{source}/{name}")
    said = f"bond_graph/properties/{output}/{source}/{verdict}"
    if roots is not None:
        yield from _hanging(f"    {name}   ", roots_text(roots.data, hertz=in_hertz(result)))
        yield from _wrapped(result, said)
    elif said in result:
        first, *rest = _wrapped(result, said)
        yield f"    {name}   {first.lstrip()}"
        yield from rest


def _formula(result: Result, group: str, *, alone: bool) -> Iterable[str]:
    """Write a short transfer function in numbers, and in symbols where they were kept."""
    written = [*numeric_forms(result, group)]
    formula = str(result.group_attrs.get(group, {}).get("symbolic", ""))
    if formula and written != ["0"] and (alone or len(formula) < _LONGEST):
        written.append(formula if len(formula) < _LONGEST else "(its formula is in the file)")
    for place, text in enumerate(written):
        yield from _hanging(f"    {'T(s)' if place == 0 else '    '} = ", text)
    if f"{group}/program" in result:
        program = str(result.value(f"{group}/program")).splitlines()
        yield f"    nested, in {counted(len(program), 'assignment')}:"
        yield from (f"      {line}" for line in program[:MOST_ROOTS])
        if len(program) > MOST_ROOTS:
            yield f"      … {len(program) - MOST_ROOTS} more in the file"
    for part in ("numerator", "denominator"):
        if f"{group}/symbolic_{part}" in result:
            terms = result[f"{group}/symbolic_{part}"].attrs["terms"]
            yield f"    expanded {part} of {counted(int(terms), 'term')} in the file"


def _numbers(result: Result, group: str, unit: str) -> Iterable[str]:
    if f"{group}/order" in result:
        order, relative, dc, high = (limit(result.value(f"{group}/{name}")) for name in _NUMBERS)
        yield f"    order {order} · relative degree {relative} · T(0) = {dc}{unit} · T(∞) = {high}{unit}"
    hidden = result.get(f"{group}/hidden_modes")
    if hidden is not None and len(hidden.data):
        head = "    hidden modes (natural modes that this channel does not show)  "
        yield from _hanging(head, roots_text(hidden.data, hertz=in_hertz(result)), indent=12)
        yield from _causes(result, group, hidden.data)


def _causes(result: Result, group: str, modes: np.ndarray[Any, Any]) -> Iterable[str]:
    """Say of each hidden mode why it is one and what holds its energy, where that was asked for."""
    if f"{group}/hidden_mode_cause" not in result:
        return
    causes, elements = (result[f"{group}/hidden_mode_{part}"].data for part in ("cause", "elements"))
    upper = [place for place, root in enumerate(modes) if root.imag >= 0]
    for place in upper[:MOST_ROOTS]:
        held = f"; its energy is in {elements[place]}" if elements[place] else ""
        root = root_text(modes[place], hertz=in_hertz(result))
        yield from (f"            {line}" for line in wrap(f"{root}: {causes[place]}{held}", 92))


def _hanging(head: str, text: str, *, indent: int | None = None) -> Iterable[str]:
    """Write a formula or a list of roots after its head, in further lines where it is long."""
    whole = text.replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}")
    left = " " * (len(head) if indent is None else indent)
    lines = wrap(
        head + whole,
        _WIDTH,
        subsequent_indent=left,
        break_long_words=False,
        break_on_hyphens=False,
    )
    yield from (line.replace("\N{NO-BREAK SPACE}", " ") for line in lines)


def _wrapped(result: Result, path: str) -> Iterable[str]:
    """Write a verdict in words below what it is about."""
    text = str(result[path].data) if path in result else ""
    yield from (f"            {line}" for line in wrap(text, 92))


def _modes(result: Result, poles: np.ndarray[Any, Any]) -> Iterable[str]:
    pairs = [pole for pole in poles if pole.imag > 0]
    if 0 < len(pairs) <= 4:
        yield f"            {' · '.join(oscillation_text(result, pole) for pole in pairs)}"
