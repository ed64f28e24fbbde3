"""Screen of derivations: causality, the steps of the reduction, state equations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dynid.cli.summary.common import columns, wrapped
from dynid.number_format import MOST_ROOTS, counted
from dynid.result import Result

#: Most states, remarks of a kind, and bonds that are listed.
_STATES, _REMARKS, _BONDS = 12, 6, 24
#: Most steps, and prototypes, that are listed.
_MOST, _MOST_OUTPUTS = MOST_ROOTS, 6
#: Longest formula of a part of a prototype, and what is shown of longer ones.
_LONGEST_SYSTEM, _LONGEST = 1000, 70


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
            yield from _hanging(title, meaning)
        if len(meanings) > _REMARKS:
            yield f"    … {len(meanings) - _REMARKS} more in the file"
    note = result.group_attrs.get(group, {}).get("note")
    if note:
        yield from _hanging("note", str(note))
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
        yield from _hanging("zeros" if place == 0 else "", str(result[f"{group}/meaning"].data))
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
            yield from _hanging("", str(note))
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
            cut = f"{system[:_LONGEST]}… (in the file)"
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
    yield "  state equations"
    if len(lines) > _STATES:
        yield f"    {len(lines)} lines, in the file"
    else:
        for line in lines:
            first, *rest = wrapped(line, 92, break_long_words=False, break_on_hyphens=False)
            yield f"    {first}"
            yield from (f"        {more}" for more in rest)
    yield ""


def _hanging(title: str, text: str) -> Iterable[str]:
    first, *rest = wrapped(text, 85)
    yield f"    {title:<10} {first}"
    yield from (f"{'':15}{line}" for line in rest)
