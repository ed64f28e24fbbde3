"""What is said of a graph decomposed at a port, on the page and on the screen."""

from __future__ import annotations

from collections.abc import Iterator

from dynid.numerals import roots_text
from dynid.result import Result

PORT = "bond_graph/port"


def port_items(result: Result, longest: int) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield both sides as equivalent sources, the prototype, its dynamics, and the operating points.

    Parameters
    ----------
    result
        Of a bond graph; nothing is said of one that was not cut.
    longest
        The longest formula that is written.

    Yields
    ------
    tuple
        What it is, and lines about it.
    """
    if f"{PORT}/prototype" not in result:
        return
    letter, equation = (result.value(f"{PORT}/{name}") for name in ("prototype", "prototype_equation"))
    yield "prototype", (f"{letter}:  {equation}",)
    yield "type", (str(result.value(f"{PORT}/type")),)
    for side in ("source", "load"):
        yield side, tuple(_side(result, side, longest))
    for name in ("zero dynamics", "pole dynamics"):
        group = f"{PORT}/{name.replace(' ', '_')}"
        found, missed = (result[f"{group}/{key}"].data for key in ("roots", "missed_roots"))
        more = (f"missed: at {roots_text(missed)}",) if len(missed) else ()
        yield name, (f"{result.value(f'{group}/equation')}:  {roots_text(found)}", *more)
    if f"{PORT}/natural_modes" in result:
        modes, power = (result[f"{PORT}/{name}"].data for name in ("natural_modes", "net_power"))
        net = (f"net power over the port {power.max():.1g} (eq 9)",) if len(power) else ()
        yield "natural modes", (roots_text(modes), *net)
    yield "at rest", tuple(_operating_points(result))


def _side(result: Result, side: str, longest: int) -> Iterator[str]:
    """Yield the nodes of a side, its equivalent source, and its form where that is ideal."""
    group = f"{PORT}/{side}"
    attrs = result.group_attrs[group]
    yield str(attrs["nodes"])
    exact = [
        path[len(group) + 1 : -len("/exact")]
        for path in result
        if path.startswith(f"{group}/") and path.endswith("/exact")
    ]
    form = "Z_eq" if "Z_eq" in exact else "Y_eq"
    letter = "e" if form == "Z_eq" else "f"
    for name in [form, *(name for name in exact if name.startswith(f"{letter}_eq/"))]:
        if name in exact:
            formula = str(result.group_attrs.get(f"{group}/{name}", {}).get("symbolic", ""))
            said = formula or str(result.value(f"{group}/{name}/exact"))
            variable, _, source = name.partition("/")
            driven = f" of {source}" if source else ""
            yield f"{variable}{driven} = {said if len(said) <= longest else '(in the file)'}"
    if str(attrs["form"]).startswith("an ideal"):
        yield str(attrs["form"])


def _operating_points(result: Result) -> Iterator[str]:
    """Yield effort and flow at the port at rest, for every input, or why there are none."""
    group = f"{PORT}/performance"
    if f"{group}/input" in result:
        for place, name in enumerate(result[f"{group}/input"].data):
            effort, flow = (result[f"{group}/operating_{key}"].data[place] for key in ("effort", "flow"))
            told = (
                f"{letter} = {value:.4g} {result[f'{group}/operating_{key}'].units}".rstrip()
                for letter, key, value in (("e", "effort", effort), ("f", "flow", flow))
            )
            yield f"{name} = 1 gives {', '.join(told)}"
    note = result.group_attrs.get(group, {}).get("note")
    if note:
        yield str(note)
