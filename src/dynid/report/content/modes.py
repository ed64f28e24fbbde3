"""Content of measured modes: frequencies and shapes of test and model, before and after an identification."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.number_format import counted
from dynid.report.content.blocks import ReportSection, Statement, TextTable
from dynid.result import Result

#: Group of the modes in a result.
GROUP = "identification/modes"


def has_modes(result: Result) -> bool:
    """Return True if a result has measured modes."""
    return f"{GROUP}/frequency_measured" in result


def modal_summary(result: Result) -> str:
    """Return the numbers of modes and sensors, and the span of frequencies."""
    measured = result[f"{GROUP}/frequency_measured"]
    span = f"{measured.data.min():.5g} … {measured.data.max():.5g} {measured.units}"
    sensors = len(result[f"{GROUP}/sensor"].data) if f"{GROUP}/sensor" in result else 0
    at = f", shapes at {counted(sensors, 'sensor')}" if sensors else ""
    return f"{counted(measured.data.size, 'measured mode')}, {span}{at}"


def modal_table(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the modes: frequency, its error and MAC before and after."""
    get = {path.removeprefix(f"{GROUP}/"): one.data for path, one in result.items() if path.startswith(GROUP)}
    unit = result[f"{GROUP}/frequency_measured"].units
    shapes, damping, left = "mac" in get, "damping_measured" in get, "left_out_error" in get
    heads = ["mode", f"measured {unit}", "model", "error at start", "error"]
    heads += ["left out"] * left + ["MAC at start", "MAC"] * shapes + ["ζ measured", "ζ"] * damping
    rows = []
    for k in range(len(get["mode"])):
        row = [str(k + 1), f"{get['frequency_measured'][k]:.5g}", f"{get['frequency'][k]:.5g}"]
        row += [_signed(get["frequency_error_start"][k]), _signed(get["frequency_error"][k])]
        row += [_signed(get["left_out_error"][k])] if left else []
        if shapes:
            row += [_criterion(get["mac_start"][k]), _criterion(get["mac"][k])]
        if damping:
            row += [_percent(get["damping_measured"][k]), _percent(get["damping"][k])]
        rows.append(tuple(row))
    return tuple(heads), rows


def modal_statements(result: Result) -> list[str]:
    """Return what follows from a fit to modes: errors of the model's form, what the data determine."""
    path = f"{GROUP}/statements"
    return [str(one) for one in result[path].data] if path in result else []


def _signed(part: float) -> str:
    return "–" if np.isnan(part) else f"{100 * part:+.2f} %"


def _percent(part: float) -> str:
    return "–" if np.isnan(part) else f"{100 * part:.3g} %"


def _criterion(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def modal_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the comparison of measured and computed modes."""
    if has_modes(result):
        heads, rows = modal_table(result)
        summary = Statement(f"{modal_summary(result)}.")
        said = [Statement(f"{one[0].upper()}{one[1:]}.") for one in modal_statements(result)]
        yield ReportSection("Measured modes", (summary, TextTable(heads, tuple(rows)), *said), "answer")
