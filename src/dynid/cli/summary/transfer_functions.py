"""Transfer functions on the screen: poles, zeros, gains; and their derivation, causality and reduction."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dynid.cli.summary.common import aligned, columns, wrapped
from dynid.number_format import MOST_ROOTS, counted, limit, root_text, roots_text, unbroken
from dynid.report.content.transfer_functions import (
    POLE,
    Channel,
    approximate,
    channel_unit,
    channels,
    characteristics,
    first_sensitivities,
    influence,
    numeric_forms,
    oscillation_text,
    same_poles,
    sensitivity_columns,
    sensitivity_text,
    symbolic_text,
)
from dynid.report.scenes import in_hertz
from dynid.result import Result

#: Most channels shown in full, most rows of the table of the others, and longest formula shown.
_FULL, _ROWS, _LONGEST = 6, 30, 160
#: Most parameters and roots in the table of sensitivities.
_PARAMETERS, _ROOTS = 8, 4

#: Columns of the screen.
_WIDTH = 110

#: The properties that are numbers.
_NUMBERS = ("order", "relative_degree", "dc_gain", "high_frequency_gain")


def channel_lines(result: Result) -> Iterable[str]:
    """Yield the poles if all channels share them, then each channel; from the seventh on, a table."""
    every = channels(result)
    common = len(every) > 1 and same_poles(result, every)
    if common:
        yield "  every channel"
        yield from _poles(result, *every[0])
        yield from _sensitivities(result, first_sensitivities(result, every), only=POLE)
        yield ""
    for output, source in every[:_FULL]:
        yield f"  {output} / {source}"
        group = f"bond_graph/transfer_function/{output}/{source}"
        written = [*numeric_forms(result, group)]
        formula = symbolic_text(result, group)
        if formula and written != ["0"] and (len(every) == 1 or len(formula) < _LONGEST):
            written.append(formula if len(formula) < _LONGEST else "(its formula is in the file)")
        if written:
            written[-1] += approximate(result, f"{group}/denominator", f"{group}/gain")
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
        yield from _roots(result, output, source, "zeros", "zero_stability", hertz=in_hertz(result))
        if not common:
            yield from _poles(result, output, source)
        yield from _properties(result, output, source)
        yield from _sensitivities(
            result, f"bond_graph/sensitivities/{output}/{source}", without=POLE if common else None
        )
        yield ""
    if len(every) > _FULL:
        yield from _table(result, every[_FULL:])
        yield ""


def _table(result: Result, several: list[Channel]) -> Iterable[str]:
    """Yield a table of order, gains and stability, one channel per row."""
    groups = [f"bond_graph/properties/{output}/{source}" for output, source in several]
    if not all(f"{group}/order" in result for group in groups):
        yield f"  … {counted(len(several), 'more channel')} in the file"
        return
    about = approximate(result, *(f"{group}/order" for group in groups))
    rows = [["", f"order{about}", "relative degree", "T(0)", "T(∞)", f"zeros{about}", "poles"]]
    for (output, source), group in zip(several[:_ROWS], groups, strict=False):
        numbers = (limit(result.value(f"{group}/{name}")) for name in _NUMBERS)
        # The verdict alone, without its reason after the colon.
        verdicts = (
            str(result.value(f"{group}/{name}")).partition(":")[0] if f"{group}/{name}" in result else ""
            for name in ("zero_stability", "stability")
        )
        rows.append([f"{output} / {source}", *numbers, *verdicts])
    yield from aligned(rows, "  ", left=(0, 5, 6))
    if len(several) > _ROWS:
        yield f"  … {counted(len(several) - _ROWS, 'more channel')} in the file"


def _poles(result: Result, output: str, source: str) -> Iterable[str]:
    """Yield the poles, their stability, and frequency and damping of up to four oscillatory pairs."""
    path = f"bond_graph/transfer_function/{output}/{source}/poles"
    pairs = [pole for pole in result[path].data if pole.imag > 0] if path in result else []
    beside = 0 < len(pairs) <= 4
    # Natural frequencies are written once: with the poles, or with the damping ratios below them.
    yield from _roots(result, output, source, "poles", "stability", hertz=in_hertz(result) and not beside)
    if beside:
        yield f"            {' · '.join(oscillation_text(result, pole) for pole in pairs)}"


def _roots(
    result: Result, output: str, source: str, name: str, verdict: str, *, hertz: bool
) -> Iterable[str]:
    roots = result.get(f"bond_graph/transfer_function/{output}/{source}/{name}")
    path = f"bond_graph/properties/{output}/{source}/{verdict}"
    text = str(result[path].data) + approximate(result, path) if path in result else ""
    reasons = [f"            {line}" for line in wrapped(text, 92)]
    if roots is not None:
        about = approximate(result, f"bond_graph/transfer_function/{output}/{source}/{name}")
        yield from _hanging(f"    {name}   ", roots_text(roots.data, hertz=hertz) + about)
        yield from reasons
    elif path in result:
        yield f"    {name}   {reasons[0].lstrip()}"
        yield from reasons[1:]


def _properties(result: Result, output: str, source: str) -> Iterable[str]:
    """Yield order, relative degree and gains, and the hidden modes with their causes if requested."""
    group, hertz = f"bond_graph/properties/{output}/{source}", in_hertz(result)
    if f"{group}/order" in result:
        unit = channel_unit(result, output, source)
        order, relative, dc, high = (limit(result.value(f"{group}/{name}")) for name in _NUMBERS)
        order += approximate(result, f"{group}/order")
        yield f"    order {order} · relative degree {relative} · T(0) = {dc}{unit} · T(∞) = {high}{unit}"
    for title, text in characteristics(result, output, source):
        yield from _hanging(f"    {title}: ", text, indent=12)
    hidden = result.get(f"{group}/hidden_modes")
    if hidden is None or not len(hidden.data):
        return
    head = "    hidden modes (uncontrollable or unobservable in this channel)  "
    text = roots_text(hidden.data, hertz=hertz) + approximate(result, f"{group}/hidden_modes")
    yield from _hanging(head, text, indent=12)
    note = str(result.group_attrs.get(group, {}).get("hidden_mode_note", ""))
    yield from (f"            {line}" for line in wrapped(note, 92))
    if f"{group}/hidden_mode_cause" not in result:
        return
    causes, elements = (result[f"{group}/hidden_mode_{part}"].data for part in ("cause", "elements"))
    upper = [place for place, root in enumerate(hidden.data) if root.imag >= 0]
    for place in upper[:MOST_ROOTS]:
        energy = f"; its energy is in {elements[place]}" if elements[place] else ""
        root = root_text(hidden.data[place], hertz=hertz)
        yield from (f"            {line}" for line in wrapped(f"{root}: {causes[place]}{energy}", 92))


def _hanging(head: str, text: str, *, indent: int | None = None) -> Iterable[str]:
    """Yield a formula or a list of roots after its heading, wrapped with a hanging indent."""
    whole = unbroken(text)
    left = " " * (len(head) if indent is None else indent)
    lines = wrapped(
        head + whole,
        _WIDTH,
        subsequent_indent=left,
        break_long_words=False,
        break_on_hyphens=False,
    )
    yield from (line.replace("\N{NO-BREAK SPACE}", " ") for line in lines)


def _sensitivities(
    result: Result, group: str, *, only: str = "", without: str | None = None
) -> Iterable[str]:
    """Yield a table of the changes of zeros, poles and gains of a channel per 1 % of the main parameters.

    `only`, `without`: as of `sensitivity_columns`.
    """
    if f"{group}/parameter" not in result:
        return
    every = sensitivity_columns(result, group, only=only, without=without)
    if not every:
        return
    yield f"    a parameter larger by 1 % moves{approximate(result, f'{group}/poles')}"
    shown = every[:_ROOTS]
    names = result[f"{group}/parameter"].data
    weight = influence(every)
    order = [place for place in np.argsort(-weight, kind="stable") if weight[place]]
    rows = [
        [str(names[place]), *(sensitivity_text(moved[place] / 100) for _, moved in shown)]
        for place in order[:_PARAMETERS]
    ]
    yield from aligned([["", *(f"{title:>20}" for title, _ in shown)], *rows], "      ")
    if len(every) > _ROOTS or len(order) > _PARAMETERS:
        yield "      … more in the file"


#: Most states, remarks of a kind, and bonds that are listed.
_STATES, _REMARKS, _BONDS = 12, 6, 24
#: Most steps, and prototypes, that are listed.
_MOST, _MOST_OUTPUTS = MOST_ROOTS, 6
#: Longest formula of a part of a prototype, and what is shown of longer ones.
_LONGEST_SYSTEM, _LONGEST_MEANING = 1000, 70


def derivation_lines(result: Result) -> list[str]:
    """Return the causality of a graph, and its reduction to a prototype, line by line."""
    return [*causality_lines(result), *_reduction(result)]


def causality_lines(result: Result) -> Iterable[str]:
    """Yield the states, conflicts, derivative causality, loops, causal strokes and zero dynamics."""
    group = "bond_graph/causality"
    if f"{group}/bonds" not in result:
        return
    states = [str(name) for name in result[f"{group}/states"].data["name"]]
    more = f", … ({len(states)} in all)" if len(states) > _STATES else ""
    order = counted(len(states), "state")
    yield f"  causality: {order}{': ' if states else ''}{', '.join(states[:_STATES])}{more}"
    for table, title in (("conflicts", "conflict"), ("dependent_storages", "derivative"), ("loops", "loop")):
        meanings = [str(text) for text in result[f"{group}/{table}"].data["meaning"]]
        for meaning in meanings[:_REMARKS]:
            yield from _titled(title, meaning)
        if len(meanings) > _REMARKS:
            yield f"    … {len(meanings) - _REMARKS} more in the file"
    note = result.group_attrs.get(group, {}).get("note")
    if note:
        yield from _titled("note", str(note))
    # Causal strokes: |-> with the stroke at the tail, ->| at the head.
    bonds = result[f"{group}/bonds"].data
    cells = [
        f"{bond['tail']} {'|->' if bond['stroke'] == 'tail' else '->|'} {bond['head']}"
        for bond in bonds[:_BONDS]
    ]
    if len(bonds) > _BONDS:
        cells.append(f"… ({len(bonds)} in all)")
    yield "    bonds (bar: causal stroke):"
    width = max(map(len, cells)) + 3
    count = max(1, min(94, columns() - 16) // width)
    for start in range(0, len(cells), count):
        yield f"      {''.join(cell.ljust(width) for cell in cells[start : start + count])}".rstrip()
    yield from _zero_dynamics(result, f"{group}/zero_dynamics/")


def _zero_dynamics(result: Result, prefix: str) -> Iterable[str]:
    """Yield the zero dynamics of each channel, its number of zeros and its relative degree."""
    channels = [path.removesuffix("/meaning") for path in result if path.startswith(prefix)]
    groups = [path for path in channels if f"{path}/meaning" in result]
    for place, group in enumerate(groups[:_REMARKS]):
        yield from _titled("zeros" if place == 0 else "", str(result[f"{group}/meaning"].data))
        counts = {
            kind: f"{counted(result.value(f'{group}/zeros_{kind}'), 'zero')}, relative degree "
            f"{result.value(f'{group}/relative_degree_{kind}')}"
            for kind in ("structural", "exact")
            if f"{group}/zeros_{kind}" in result
        }
        if len(counts) == 2 and len(set(counts.values())) == 1:
            yield f"{'':15}{counts['exact']}"
        elif counts:
            yield f"{'':15}{' · '.join(f'{kind}: {count}' for kind, count in counts.items())}"
        note = result.group_attrs.get(group, {}).get("note")
        if note:
            yield from _titled("", str(note))
    if len(groups) > _REMARKS:
        yield f"{'':15}… {counted(len(groups) - _REMARKS, 'more channel')} in the file"


def _reduction(result: Result) -> Iterable[str]:
    """Yield the prototype of each output, and the steps of its reduction."""
    group = "bond_graph/reduction"
    if f"{group}/output" not in result:
        return
    letters = np.atleast_1d(result[f"{group}/prototype"].data)
    steps = result[f"{group}/steps"].data if f"{group}/steps" in result else None
    outputs = result[f"{group}/output"].data
    for place, output in enumerate(outputs[:_MOST_OUTPUTS]):
        reached = f"prototype {letters[place]}:  {result[f'{group}/prototype_equation'].data[place]}"
        own = [] if steps is None else [row for row in steps if row["output"] == output]
        count = len(own) - 1
        how = f"reduced in {counted(count, 'step')} to " if count > 0 else ""
        yield f"  {output}: {how}{reached}"
        for part in ("system_a", "system_b"):
            system = str(result[f"{group}/{part}"].data[place])
            cut = f"{system[:_LONGEST_MEANING]}… (in the file)"
            yield f"      {system if len(system) <= _LONGEST_SYSTEM else cut}"
        for number, row in enumerate(own[:_MOST] if place == 0 else [], 1):
            first, *rest = wrapped(f"{row['rule']}: {row['equation']}", 92, break_long_words=False)
            # The last row is the prototype itself, not a step.
            yield f"    {number:>2}. {first}" if number <= count else f"        {first}"
            yield from (f"          {line}" for line in rest)
        if place == 0 and len(own) > _MOST:
            yield f"    … {counted(len(own) - _MOST, 'more step')} in the file"
    if len(outputs) > _MOST_OUTPUTS:
        yield f"  … {counted(len(outputs) - _MOST_OUTPUTS, 'more output')} in the file"


def equation_lines(result: Result, group: str) -> Iterable[str]:
    """Yield the state equations, if they are few."""
    if f"{group}/equations" not in result:
        return
    lines = [
        str(line)
        for name in ("definitions", "equations", "output_equations")
        if f"{group}/{name}" in result
        for line in result[f"{group}/{name}"].data
    ]
    yield f"  state equations{approximate(result, f'{group}/A')}"
    if len(lines) > _STATES:
        yield f"    {len(lines)} lines, in the file"
    else:
        for line in lines:
            first, *rest = wrapped(line, 92, break_long_words=False, break_on_hyphens=False)
            yield f"    {first}"
            yield from (f"        {more}" for more in rest)
    yield ""


def _titled(title: str, text: str) -> Iterable[str]:
    first, *rest = wrapped(text, 85)
    yield f"    {title:<10} {first}"
    yield from (f"{'':15}{line}" for line in rest)
