"""The screen of a bond-graph result."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from dynid.result import Result

#: Most zeros, poles or steps that are listed.
_MOST = 12


def method(result: Result) -> str:
    """Name the kind of analysis and its engine."""
    exact = any(attrs.get("engine") == "exact" for attrs in result.group_attrs.values())
    return "bond graph · exact engine" if exact else "bond graph"


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    need = result.group_attrs.get("bond_graph", {})
    said = [f"  {need.get('nodes')} nodes, {need.get('bonds')} bonds"]
    if need.get("dropped"):
        said.append(f"  not modelled, because no output depends on it: {need['dropped']}")
    said += [*_reduction(result), ""]
    for channel in _channels(result):
        said += [*_channel(result, *channel), ""]
    said += _responses(result)
    return said[:-1] if said and not said[-1] else said


def _reduction(result: Result) -> Iterable[str]:
    group = "bond_graph/reduction"
    if f"{group}/output" not in result:
        return
    letters = np.atleast_1d(result[f"{group}/prototype"].data)
    steps = result[f"{group}/steps"].data if f"{group}/steps" in result else None
    for place, output in enumerate(result[f"{group}/output"].data):
        reached = f"prototype {letters[place]}:  {result[f'{group}/prototype_equation'].data[place]}"
        own = [] if steps is None else [row for row in steps if row["output"] == output]
        yield f"  {output}: {f'reduced in {len(own) - 1} steps to ' if own else ''}{reached}"
        for part in ("system_a", "system_b"):
            yield f"      {result[f'{group}/{part}'].data[place]}"
        for number, row in enumerate(own[:_MOST] if place == 0 else [], 1):
            yield f"    {number:>2}. {row['rule']}: {row['equation']}"
        if place == 0 and len(own) > _MOST:
            yield f"    … {len(own) - _MOST} more steps in the file"


def _channels(result: Result) -> list[tuple[str, str]]:
    """List (output, input) of every channel with exact results."""
    prefixes = ("bond_graph/transfer_function/", "bond_graph/properties/")
    found = [path.split("/")[2:4] for path in result if path.startswith(prefixes)]
    return list(dict.fromkeys((output, source) for output, source in found))


def _channel(result: Result, output: str, source: str) -> Iterable[str]:
    group, properties = (
        f"bond_graph/transfer_function/{output}/{source}",
        f"bond_graph/properties/{output}/{source}",
    )
    formula = result.group_attrs.get(group, {}).get("symbolic")
    yield f"  {output} / {source}"
    if f"{group}/numerator" in result:
        numerator, denominator = result[f"{group}/numerator"].data, result[f"{group}/denominator"].data
        if len(numerator) + len(denominator) <= 12:
            yield f"    T(s) = ({_polynomial(numerator)}) / ({_polynomial(denominator)})"
    if formula:
        yield f"         = {formula}" if len(str(formula)) < 160 else "         (formula in the file)"
    if f"{group}/zeros" in result:
        verdict = (
            str(result[f"{properties}/zero_stability"].data)
            if f"{properties}/zero_stability" in result
            else ""
        )
        yield f"    zeros   {_roots(result[f'{group}/zeros'].data):<34} {verdict}".rstrip()
    if f"{group}/poles" in result:
        stable = (
            ("stable" if result.value(f"{properties}/stable") else "not stable")
            if f"{properties}/stable" in result
            else ""
        )
        yield f"    poles   {_roots(result[f'{group}/poles'].data):<34} {stable}".rstrip()
        yield from _modes(result[f"{group}/poles"].data)
    if f"{properties}/order" in result:
        get = {
            name: result.value(f"{properties}/{name}")
            for name in ("relative_degree", "dc_gain", "high_frequency_gain", "order")
        }
        yield (
            f"    order {get['order']} · relative degree {get['relative_degree']} · "
            f"T(0) = {get['dc_gain']:.6g} · T(∞) = {get['high_frequency_gain']:.6g}"
        )
    if f"{properties}/hidden_modes" in result and len(result[f"{properties}/hidden_modes"].data):
        yield f"    hidden modes (they cancel here)  {_roots(result[f'{properties}/hidden_modes'].data)}"


def _modes(poles: np.ndarray[Any, Any]) -> Iterable[str]:
    pairs = [pole for pole in poles if pole.imag > 0]
    if 0 < len(pairs) <= 4:
        shown = (f"ω_n = {abs(p):.4g} rad/s, ζ = {-p.real / abs(p):.4g}" for p in pairs)
        yield f"            {' · '.join(shown)}"


def _roots(roots: np.ndarray[Any, Any]) -> str:
    """Write roots, conjugate pairs as one."""
    if not len(roots):
        return "none"
    shown = [_root(root) for root in roots if root.imag >= 0]
    more = f", … ({len(roots)} in all)" if len(shown) > _MOST else ""
    return ", ".join(shown[:_MOST]) + more


def _root(root: complex) -> str:
    if root.imag == 0:
        return f"{root.real:.4g}"
    return f"± {root.imag:.4g}j" if root.real == 0 else f"{root.real:.4g} ± {root.imag:.4g}j"


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


def _responses(result: Result) -> Iterable[str]:
    group = "bond_graph/frequency_response"
    if f"{group}/omega" in result:
        omega = result[f"{group}/omega"].data
        yield f"  frequency response at {len(omega)} frequencies, {omega[0]:.4g} … {omega[-1]:.4g} rad/s"
        response, names = result[f"{group}/response"].data, result[f"{group}/output"].data
        for k, output in enumerate(names):
            for m, source in enumerate(result[f"{group}/input"].data):
                size = np.abs(response[:, k, m])
                peak = int(np.argmax(size))
                yield f"    |{output} / {source}| is largest at {omega[peak]:.4g} rad/s: {size[peak]:.4g}"
    group = "bond_graph/time_response"
    if f"{group}/time" in result:
        time, response = result[f"{group}/time"].data, result[f"{group}/response"].data
        yield f"  time response at {len(time)} instants, to {time[-1]:.4g} s"
        for k, output in enumerate(result[f"{group}/output"].data):
            column = response[:, k]
            yield f"    {output}: {column.min():.4g} … {column.max():.4g}, at the end {column[-1]:.4g}"
