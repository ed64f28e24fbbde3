"""Content of reductions: frequencies, errors and costs of every method."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.number_format import counted, percent, quantity
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable
from dynid.report.scenes import frequency_unit
from dynid.result import Result
from dynid.units import FrequencyUnit

#: Most frequencies of a row.
_FREQUENCIES = 4
#: Error and MAC up to which a reduced mode is that of the full structure, as in correlations with tests.
_MAX_FREQUENCY_ERROR, _MIN_MAC = 0.01, 0.9


def method(result: Result) -> str:
    """Return the kind of analysis and the number of methods."""
    return f"reduction · {counted(len(_names(result)), 'method')}"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the comparison of the methods."""
    unit, *others = remarks(result)
    yield ReportSection("Methods", (_method_table(result), unit, *_verdict(result)), "answer", screen="")
    if others:
        yield ReportSection("Masters and rigid-body modes", tuple(others), screen="")


def _method_table(result: Result) -> TextTable:
    """Return the table of the methods: natural frequencies with the joints, errors and costs."""
    reference, common, unit = _reference(result), _common(result), frequency_unit(result)
    elastic = [number for number in sorted(reference) if reference[number]]
    shown = (elastic or sorted(reference) or sorted(common))[:_FREQUENCIES]
    with_frac = "reduction/frf/frac" in result
    frequencies = (f"{unit.symbol}{number}" for number in shown)
    columns = ["", "size", *frequencies, "worst error", "least MAC", *(["least FRAC"] if with_frac else [])]
    known = (_frequency(reference[k], unit) if k in reference else "" for k in shown)
    full = ["full", str(len(result["reduction/dof"].data)), *known]
    rows = [(*full, *[""] * (5 + with_frac))]
    for index, name in enumerate(_names(result)):
        modes = _of(result, name, "mode")
        frequency_of = dict(zip(modes.tolist(), _of(result, name, "frequencies"), strict=True))
        compared = np.isin(modes, sorted(common))
        if f"reduction/{name}/mac" not in result:
            compared[:] = False
        error = np.abs(_of(result, name, "frequency_error"))[compared] if compared.any() else np.zeros(0)
        agreement = np.diagonal(_of(result, name, "mac"))[compared] if compared.any() else np.zeros(0)
        frac = [f"{result['reduction/frf/frac'].data[index].min():.3f}"] if with_frac else []
        attrs, conditioning = result.group_attrs.get(f"reduction/{name}", {}), ""
        if (condition := result.get(f"reduction/{name}/condition")) is not None:
            number = condition.data.item()
            conditioning = f"{number:,.0f}".replace(",", " ") if 100 <= number < 1e6 else f"{number:.2g}"
        peak = attrs.get("peak_megabytes")
        frequencies = (_frequency(frequency_of[k], unit) if k in frequency_of else "" for k in shown)
        worst = percent(100 * error.max()) if len(error) else ""
        least = f"{agreement.min():.3f}" if len(agreement) else ""
        memory = "" if not isinstance(peak, float) else f"{peak:.1f} MB" if peak >= 0.1 else "-"
        effort = (conditioning, seconds_text(attrs.get("seconds")), memory)
        size = str(len(_of(result, name, "coordinate")))
        rows.append((name, size, *frequencies, worst, least, *frac, *effort))
    took = seconds_text(result.group_attrs.get("reduction", {}).get("seconds"))
    caption = counted(len(result["reduction/dof"].data), "DOF") + (f"; its modes took {took}" if took else "")
    heads = (*columns, "condition", "time", "memory")
    return TextTable(heads, tuple(rows), frozenset({0}), caption, brief=ALL)


def _names(result: Result) -> list[str]:
    return list(result["reduction/method"].data)


def _of(result: Result, name: str, array: str) -> NDArray[Any]:
    return result[f"reduction/{name}/{array}"].data


def _reference(result: Result) -> dict[int, float]:
    """Return the natural frequencies of the full structure, with which methods are compared, by number."""
    return {
        int(number): float(omega)
        for name in _names(result)
        if f"reduction/{name}/reference" in result
        for number, omega in zip(_of(result, name, "mode"), _of(result, name, "reference"), strict=True)
    }


def _common(result: Result) -> set[int]:
    """Return the mode numbers that all methods have; all of them, where they have none in common."""
    numbers = [set(_of(result, name, "mode").tolist()) for name in _names(result)]
    return set.intersection(*numbers) or set.union(*numbers)


def _verdict(result: Result) -> Iterator[Statement]:
    """Yield up to which mode, and frequency, each method agrees with the full structure."""
    unit, parts = frequency_unit(result), []
    for name in _names(result):
        if f"reduction/{name}/mac" not in result:
            continue
        modes, omega, error = (_of(result, name, array) for array in ("mode", "reference", "frequency_error"))
        agreement = np.diagonal(_of(result, name, "mac"))
        good = (omega == 0) | (np.abs(error) <= _MAX_FREQUENCY_ERROR) & (agreement >= _MIN_MAC)
        good &= modes == np.arange(1, len(modes) + 1)
        count = int(np.argmin([*good, False]))
        if count:
            span = f"{_span(modes[:count].tolist())} ({_frequency(omega[count - 1], unit)} {unit.name})"
        parts.append(f"{name} {span if count else 'no mode'}")
    if parts:
        limits = f"frequencies within {100 * _MAX_FREQUENCY_ERROR:g} %, MAC {_MIN_MAC:g} or more"
        yield Statement(f"as the full structure from the first mode on ({limits}): {'; '.join(parts)}")


def remarks(result: Result) -> Iterator[Statement]:
    """Yield the remarks on the table: units, rigid-body modes, masters."""
    common, unit = sorted(_common(result)), frequency_unit(result)
    sizes = f"natural frequencies {unit.symbol} in {unit.name}, joints included"
    yield Statement(f"{sizes}; worst error and least MAC of {_span(common)}")
    rigid = [number for number, omega in sorted(_reference(result).items()) if not omega]
    if rigid:
        yield Statement(f"{_span(rigid)}: of the rigid body, {unit.symbol} = 0")
    for name in _names(result):
        if f"reduction/{name}/reference" not in result:
            said = "not compared with modes of the full structure, which are not computed (compare: true)"
            yield Statement(said, head=f"{name}:")
        masters, coordinates = (_of(result, name, array) for array in ("masters", "coordinate"))
        residuals = sum(str(coordinate).startswith("residual_") for coordinate in coordinates)
        if residuals:
            modes = counted(len(coordinates) - len(masters) - residuals, "mode")
            vectors = counted(residuals, "residual vector")
            text = f"{modes} and {vectors}, of loads on joints, sensors and inputs (residuals: [] for none)"
            yield Statement(text, head=f"{name}:")
        if len(masters):
            dofs = result["reduction/dof"].data[masters - 1]
            few = ", ".join(map(str, dofs[:12])) + (", …" if len(masters) > 12 else "")
            yield Statement(f"{'master' if len(masters) == 1 else 'masters'} {few}", head=f"{name}:")


def _span(numbers: list[int]) -> str:
    return f"modes {numbers[0]} … {numbers[-1]}" if len(numbers) > 1 else f"mode {numbers[0]}"


def _frequency(value: float, unit: FrequencyUnit) -> str:
    return quantity(unit.factor * value) if value else "0"


def seconds_text(value: object) -> str:
    """Return a time as text; empty where it is unknown."""
    if not isinstance(value, float):
        return ""
    unit, size = ("s", value) if value >= 1 else ("ms", 1000 * value)
    return f"{size:.0f} {unit}" if size >= 10 else f"{size:.2g} {unit}"
