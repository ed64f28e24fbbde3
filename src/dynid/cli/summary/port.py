"""Screen of a graph decomposed at a port."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import wrap

from dynid.report.content.bond_graph import PORT, port_items
from dynid.result import Result

#: Longest formula that is shown, and how wide its name stands.
_LONGEST, _WIDTH = 70, 16


def port_lines(result: Result) -> Iterable[str]:
    """Yield both sides as equivalent sources, the prototype, its dynamics, and the operating points."""
    items = dict(port_items(result, _LONGEST))
    if not items:
        return
    yield f"  port {result.group_attrs[PORT]['bond']}: prototype {items.pop('prototype')[0]}"
    yield from (f"      {line}" for line in wrap(items.pop("type")[0], 92))
    for name, lines in items.items():
        yield from _named(name, lines)
    yield ""


def _named(name: str, lines: Sequence[str]) -> Iterable[str]:
    """Yield lines behind their name: those of a side or a sentence below each other, else on one line."""
    if name == "loop":
        lines = wrap(lines[0], 92 - _WIDTH)
    if name in ("source", "load", "loop"):
        names: Sequence[str] = (name, *("" for _ in lines[1:]))
    elif name == "at rest":
        names = (name,) * len(lines)
    else:
        names, lines = (name,), ("   ".join(lines),)
    yield from (f"      {own:<{_WIDTH}}{line}" for own, line in zip(names, lines, strict=True))
