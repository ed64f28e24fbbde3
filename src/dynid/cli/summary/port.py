"""What the screen says of a graph decomposed at a port."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import wrap

from dynid.numerals import roots_text
from dynid.result import Result

_GROUP = "bond_graph/port"
#: Longest formula that is shown, and how wide its name stands.
_LONGEST, _WIDTH = 70, 16


def port_lines(result: Result) -> Iterable[str]:
    """Yield both sides as equivalent sources, the prototype, its dynamics, and the operating points."""
    if f"{_GROUP}/prototype" not in result:
        return
    attrs = result.group_attrs[_GROUP]
    letter, equation = (result.value(f"{_GROUP}/{name}") for name in ("prototype", "prototype_equation"))
    yield f"  port {attrs['bond']}: prototype {letter}:  {equation}"
    yield from (f"      {line}" for line in wrap(str(result.value(f"{_GROUP}/type")), 92))
    for side in ("source", "load"):
        yield from _side(result, side)
    for name in ("zero dynamics", "pole dynamics"):
        group = f"{_GROUP}/{name.replace(' ', '_')}"
        found, missed = (result[f"{group}/{key}"].data for key in ("roots", "missed_roots"))
        more = f"   missed: at {roots_text(missed)}" if len(missed) else ""
        yield f"      {name:<{_WIDTH}}{result.value(f'{group}/equation')}:  {roots_text(found)}{more}"
    if f"{_GROUP}/natural_modes" in result:
        modes, power = (result[f"{_GROUP}/{name}"].data for name in ("natural_modes", "net_power"))
        net = f"   net power over the port {power.max():.1g} (eq 9)" if len(power) else ""
        yield f"      {'natural modes':<{_WIDTH}}{roots_text(modes)}{net}"
    yield from _operating(result)
    yield ""


def _side(result: Result, side: str) -> Iterable[str]:
    group = f"{_GROUP}/{side}"
    attrs = result.group_attrs[group]
    yield f"      {side:<{_WIDTH}}{attrs['nodes']}"
    prefix = f"{group}/"
    shown = [path.removeprefix(prefix).removesuffix("/exact") for path in result if path.startswith(prefix)]
    form = "Y_eq" if f"{group}/Z_eq/exact" not in result else "Z_eq"
    names = [form, *(name for name in shown if name.startswith(f"{'f' if form == 'Y_eq' else 'e'}_eq/"))]
    for name in dict.fromkeys(name for name in names if f"{group}/{name}/exact" in result):
        formula = str(result.group_attrs.get(f"{group}/{name}", {}).get("symbolic", ""))
        text = formula or str(result.value(f"{group}/{name}/exact"))
        variable, _, source = name.partition("/")
        driven = f" of {source}" if source else ""
        yield f"{'':{_WIDTH + 6}}{variable}{driven} = {text if len(text) <= _LONGEST else '(in the file)'}"
    if str(attrs["form"]).startswith("an ideal"):
        yield f"{'':{_WIDTH + 6}}{attrs['form']}"


def _operating(result: Result) -> Iterable[str]:
    from dynid.report.answers.bond_graph import operating_points

    for line in operating_points(result):
        yield f"      {'at rest':<{_WIDTH}}{line}"
