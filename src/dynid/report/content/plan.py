"""Content of plans: the most informative sensors and excitations."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dynid.number_format import counted, span_text
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable
from dynid.report.content.identifiability import bound_text, calibration_sections, identifiability_sections
from dynid.report.scenes import frequency_unit
from dynid.result import Result
from dynid.units import FrequencyUnit


def method(result: Result) -> str:  # noqa: ARG001 - every kind has one
    """Return the kind of analysis and its method."""
    return "plan · D-optimal, greedy with exchange"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the content of a plan."""
    yield _sensors(result)
    if "plan/amplitude/bound" in result:
        yield _amplitudes(result)
    else:
        yield from _excitation(result)
    yield from identifiability_sections(result)
    yield from calibration_sections(result)


def _sensors(result: Result) -> ReportSection:
    """Return the best sensors with the bounds that they give, beside the present ones."""
    group = "plan/sensors"
    choice, bounds, gains = (result[f"{group}/{name}"].data for name in ("choice", "bound", "gain"))
    rows = [
        (f"{'+ ' if k else ''}{name}", *map(bound_text, bounds[k]), _gain_text(gains[k]))
        for k, name in enumerate(choice)
    ]
    present = ", ".join(map(str, result[f"{group}/present"].data))
    rows.append((f"present: {present}", *map(bound_text, result[f"{group}/present_bound"].data), ""))
    count, candidates = len(choice), len(result[f"{group}/candidate"].data)
    best = f"best {count} of {candidates} candidate sensors, most informative first"
    best = best if count > 1 else f"best sensor of {candidates} candidates"
    heads = ("", *map(str, result[f"{group}/parameter"].data), "gain")
    table = TextTable(heads, tuple(rows), caption=best, brief=ALL, most=ALL)
    return ReportSection("Sensors", (table, _efficiency(result, group, "sensors")), "answer", screen="")


def _amplitudes(result: Result) -> ReportSection:
    """Return the bounds with multiples of the present excitation, of structures with nonlinear joints."""
    group = "plan/amplitude"
    factors, bounds = result[f"{group}/factor"].data, result[f"{group}/bound"].data
    rows = tuple(
        (f"× {factor:g}", *("cannot be followed" if np.isnan(bound) else bound_text(bound) for bound in row))
        for factor, row in zip(factors, bounds, strict=True)
    )
    heads = ("excitation", *map(str, result[f"{group}/parameter"].data))
    caption = "bounds with a multiple of the present excitation, its noise and sensors as they are"
    table = TextTable(heads, rows, caption=caption, brief=ALL, most=ALL)
    note = "sines are not ranked: with nonlinear joints responses to them do not add up"
    return ReportSection("Excitation", (table, Statement(note)), "answer", screen="")


def _excitation(result: Result) -> Iterator[ReportSection]:
    """Yield the best sines and frequency bands with their bounds."""
    group = "plan/excitation"
    if f"{group}/choice" not in result:
        text = "the structure is excited by a prescribed motion: forces in its place are not ranked"
        yield ReportSection("Excitation", (Statement(text),), "answer", screen="")
        return
    driven = str(result.group_attrs.get(group, {}).get("driven", "force"))
    names, unit = tuple(map(str, result[f"{group}/parameter"].data)), frequency_unit(result)
    sines = _sines(result, names, driven, unit)
    efficiency = _efficiency(result, group, f"{driven}s")
    yield ReportSection("Excitation", (sines, efficiency), "answer", screen="")
    columns = (result[f"{group}/bands/{name}"].data for name in ("dof", "low", "high", "bound"))
    spans = []
    for dof, low, high, bounds in zip(*columns, strict=True):
        span = f"{span_text(unit.factor * low, unit.factor * high)} {unit.name}"
        spans.append((f"{_position_text(dof)}: {span}", *map(bound_text, bounds)))
    caption = f"best frequency bands, flat {driven} spectrum with the same RMS (steady state)"
    bands = TextTable(("", *names), tuple(spans), caption=caption, noun="band", brief=5, most=12)
    settling = result.get(f"{group}/settling_time")
    condition = ", which an undamped structure does not reach by itself"
    if settling is not None:
        condition = (
            f": the slowest mode needs {float(settling.data):.2g} s to decay to 1 %; "
            "bounds of a transient record are not comparable"
        )
    steady = Statement(f"assumes the steady state{condition}")
    yield ReportSection("Frequency bands", (steady, bands), screen="")


def _sines(result: Result, names: tuple[str, ...], driven: str, unit: FrequencyUnit) -> TextTable:
    """Return the table of the chosen sines with their gains; and of their set and the present with bounds."""
    group = "plan/excitation"
    dofs, omega = (result[f"{group}/choice_{name}"].data for name in ("dof", "omega"))
    choice = [
        f"{_position_text(dof)} at {unit.text(float(at), 4)}" for dof, at in zip(dofs, omega, strict=True)
    ]
    gains = [_gain_text(gain) for gain in result[f"{group}/gain"].data]
    best, present = (
        tuple(map(bound_text, result[f"{group}/{name}_bound"].data)) for name in ("best", "present")
    )
    rows = [(choice[0], *best, gains[0])]
    if len(choice) > 1:
        rows = [
            (f"{'+ ' if k else ''}{name}", *[""] * len(best), gain)
            for k, (name, gain) in enumerate(zip(choice, gains, strict=True))
        ]
        rows.append((f"all {len(choice)}", *best, ""))
    rows.append(("present", *present, ""))
    amplitude = result[f"{group}/amplitude"]
    size = f"{float(amplitude.data):.3g} {amplitude.units}".rstrip() + " each" * (len(choice) > 1)
    caption = (
        f"best {counted(len(choice), 'sine')}, amplitude {size} (same total RMS as the present {driven}); "
        "bounds with the present sensors"
    )
    # Each sine has the amplitude of the set, whatever their number.
    heads = ("", *names, "gain at equal amplitude")
    return TextTable(heads, tuple(rows), caption=caption, brief=ALL, most=ALL)


def _position_text(name: str) -> str:
    """Return where an excitation acts: a label or a source as it is, a number as that of a DOF."""
    return f"DOF {name}" if name.isdecimal() else name


def _gain_text(value: float) -> str:
    return f"× {value:.3g}" if math.isfinite(value) else ""


def _efficiency(result: Result, group: str, what: str) -> Statement:
    """Return the efficiency of the present sensors or forces, relative to the best."""
    efficiency = float(result.value(f"{group}/efficiency"))
    if efficiency < 1e-3:
        return Statement(f"the present {what} give almost no information")
    if efficiency > 0.995:
        return Statement(f"no better {what} were found than the present ones")
    share = f"{100 * efficiency:.2g} %"
    return Statement(
        f"efficiency of the present {what}: {share} (geometric mean of best bound / present bound)"
    )
