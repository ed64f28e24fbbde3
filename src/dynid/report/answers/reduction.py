"""What a comparison of reductions says: frequencies, errors and costs of every method."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.numerals import counted, quantity
from dynid.report.answers.blocks import Grid, Note, Part
from dynid.result import Result

#: Frequencies that a row still shows.
_SHOWN = 4


def method(result: Result) -> str:
    """Name the kind of analysis."""
    count = len(_names(result))
    return f"reduction · {count} method{'s' * (count != 1)}"


def parts(result: Result) -> Iterator[Part]:
    """Yield what a comparison of reductions says."""
    columns, rows = methods(result)
    size = counted(len(result["reduction/dof"].data), "DOF")
    said = (Note(sentence) for sentence in notes(result))
    yield Part("Methods", (Grid(columns, tuple(rows), frozenset({0}), f"of {size}"), *said))


def _names(result: Result) -> list[str]:
    return list(result["reduction/method"].data)


def methods(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return one row a method: natural frequencies with the joints, what is wrong with them, and the cost."""
    reference, common = _reference(result), _common(result)
    elastic = [number for number in sorted(reference) if reference[number]]
    shown = (elastic or sorted(reference))[:_SHOWN]
    frac = ["least FRAC"] if "reduction/frf/frac" in result else []
    columns = ["", "size", *(f"ω{number}" for number in shown), "worst error", "least MAC", *frac]
    full = ["full", str(len(result["reduction/dof"].data)), *(_omega(reference[k]) for k in shown)]
    rows = [(*full, *[""] * (5 + len(frac)))]
    for place, name in enumerate(_names(result)):
        row = [name, *_row(result, name, shown, common), *_fractions(result, place), *_cost(result, name)]
        rows.append(tuple(row))
    return (*columns, "condition", "time", "memory"), rows


def _reference(result: Result) -> dict[int, float]:
    """Return the full structure's natural frequencies that methods are compared with, by number."""
    return {
        int(number): float(omega)
        for name in _names(result)
        for number, omega in zip(_of(result, name, "mode"), _of(result, name, "reference"), strict=True)
    }


def _common(result: Result) -> set[int]:
    """Return the numbers of the modes that all methods have; where they share none, of all modes."""
    numbers = [set(_of(result, name, "mode").tolist()) for name in _names(result)]
    return set.intersection(*numbers) or set.union(*numbers)


def _row(result: Result, name: str, shown: Iterable[int], common: set[int]) -> list[str]:
    found = dict(zip(_of(result, name, "mode").tolist(), _of(result, name, "frequencies"), strict=True))
    counted = np.isin(_of(result, name, "mode"), sorted(common))
    error = np.abs(_of(result, name, "frequency_error"))[counted]
    agreement = np.diagonal(_of(result, name, "mac"))[counted]
    return [
        str(len(_of(result, name, "coordinate"))),
        *(_omega(found[k]) if k in found else "" for k in shown),
        f"{100 * error.max():.2g} %" if len(error) else "",
        f"{agreement.min():.3f}" if len(agreement) else "",
    ]


def _fractions(result: Result, place: int) -> list[str]:
    if "reduction/frf/frac" not in result:
        return []
    return [f"{result['reduction/frf/frac'].data[place].min():.3f}"]


def _cost(result: Result, name: str) -> list[str]:
    attrs = result.group_attrs.get(f"reduction/{name}", {})
    peak = attrs.get("peak_megabytes")
    condition = result.get(f"reduction/{name}/condition")
    return [
        "" if condition is None else f"{condition.data.item():.2g}",
        seconds_text(attrs.get("seconds")),
        f"{peak:.1f} MB" if isinstance(peak, float) else "",
    ]


def notes(result: Result) -> Iterator[str]:
    """Yield what the table does not say."""
    common = sorted(_common(result))
    yield f"ω in rad/s, joints included; worst error and least MAC of {_span(common)}"
    rigid = [number for number, omega in sorted(_reference(result).items()) if not omega]
    if rigid:
        yield f"{_span(rigid)}: of the rigid body, ω = 0"
    for name in _names(result):
        masters = _of(result, name, "masters")
        if len(masters):
            dofs = result["reduction/dof"].data[masters - 1]
            few = ", ".join(map(str, dofs[:12])) + (", …" if len(masters) > 12 else "")
            yield f"{name}: {'master' if len(masters) == 1 else 'masters'} {few}"


def _span(numbers: list[int]) -> str:
    return f"modes {numbers[0]} … {numbers[-1]}" if len(numbers) > 1 else f"mode {numbers[0]}"


def _of(result: Result, name: str, part: str) -> NDArray[Any]:
    return result[f"reduction/{name}/{part}"].data


def _omega(value: float) -> str:
    return quantity(value) if value else "0"


def seconds_text(value: object) -> str:
    """Write a time, where one is known."""
    if not isinstance(value, float):
        return ""
    unit, size = ("s", value) if value >= 1 else ("ms", 1000 * value)
    return f"{size:.0f} {unit}" if size >= 10 else f"{size:.2g} {unit}"
