"""Content of plans: the most informative sensors and excitations."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dynid.number_format import counted, span_text
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable
from dynid.report.content.identifiability import bound_text, calibration_sections, identifiability_sections
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Most bands that are listed.
_BANDS = 12
#: Heading of the gains of sines: each has the amplitude of the set, whatever their number.
_GAIN_OF_SINES = "gain at equal amplitude"
_PRESCRIBED = "the structure is excited by a prescribed motion: forces in its place are not ranked"


def method(result: Result) -> str:  # noqa: ARG001 - every kind has one
    """Return the kind of analysis and its method."""
    return "plan · D-optimal, greedy with exchange"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the content of a plan."""
    group = "plan/sensors"
    choice, bounds, gains = (result[f"{group}/{name}"].data for name in ("choice", "bound", "gain"))
    rows = [
        (f"{'+ ' if k else ''}{name}", *map(bound_text, bounds[k]), _gain_text(gains[k]))
        for k, name in enumerate(choice)
    ]
    present = ", ".join(map(str, result[f"{group}/present"].data))
    rows.append((f"present: {present}", *map(bound_text, result[f"{group}/present_bound"].data), ""))
    names = tuple(map(str, result[f"{group}/parameter"].data))
    count = _best_sensors_text(len(choice), len(result[f"{group}/candidate"].data))
    table = TextTable(("", *names, "gain"), tuple(rows), caption=count, brief=ALL, most=ALL)
    efficiency = Statement(_efficiency_text(result.value(f"{group}/efficiency"), "sensors"))
    yield ReportSection("Sensors", (table, efficiency), "answer", screen="")
    yield from _excitation(result, names)
    yield from identifiability_sections(result)
    yield from calibration_sections(result)


def _excitation(result: Result, names: tuple[str, ...]) -> Iterator[ReportSection]:
    """Yield the best sines and frequency bands with their bounds."""
    group, unit = "plan/excitation", frequency_unit(result)
    if f"{group}/choice" not in result:
        yield ReportSection("Excitation", (Statement(_PRESCRIBED),), "answer", screen="")
        return
    caption = _best_sines_text(result)
    heads = ("", *names, _GAIN_OF_SINES)
    sines = TextTable(heads, tuple(_sine_rows(result)), caption=caption, brief=ALL, most=ALL)
    efficiency = Statement(_efficiency_text(result.value(f"{group}/efficiency"), f"{driven(result)}s"))
    yield ReportSection("Excitation", (sines, efficiency), "answer", screen="")
    columns = (result[f"{group}/bands/{name}"].data for name in ("dof", "low", "high", "bound"))
    spans = tuple(
        (
            f"{_place_text(dof)}: {span_text(unit.factor * low, unit.factor * high)} {unit.name}",
            *map(bound_text, bounds),
        )
        for dof, low, high, bounds in zip(*columns, strict=True)
    )
    bands = TextTable(
        ("", *names), spans, caption=_best_bands_text(result), noun="band", brief=5, most=_BANDS
    )
    yield ReportSection("Frequency bands", (Statement(_steady_state_text(result)), bands), screen="")


def _place_text(name: str) -> str:
    """Return where an excitation acts: a label or a source as it is, a number as that of a DOF."""
    return f"DOF {name}" if name.isdecimal() else name


def _chosen_lines(result: Result) -> list[str]:
    """Return DOF and frequency of the chosen sines, in the unit of the scene."""
    unit = frequency_unit(result)
    dofs, omega = (result[f"plan/excitation/choice_{name}"].data for name in ("dof", "omega"))
    return [f"{_place_text(dof)} at {unit.text(float(at), 4)}" for dof, at in zip(dofs, omega, strict=True)]


def _sine_rows(result: Result) -> list[tuple[str, ...]]:
    """Return the rows of the chosen sines with their gains; and of their set and the present with bounds."""
    group, choice = "plan/excitation", _chosen_lines(result)
    gains = [_gain_text(gain) for gain in result[f"{group}/gain"].data]
    best, present = (
        list(map(bound_text, result[f"{group}/{name}_bound"].data)) for name in ("best", "present")
    )
    if len(choice) == 1:
        rows = [(choice[0], *best, gains[0])]
    else:
        blank = [""] * len(best)
        rows = [
            (f"{'+ ' if k else ''}{name}", *blank, gain)
            for k, (name, gain) in enumerate(zip(choice, gains, strict=True))
        ]
        rows.append((f"all {len(choice)}", *best, ""))
    return [*rows, ("present", *present, "")]


def _best_sensors_text(count: int, candidates: int) -> str:
    """Return the heading of the table of sensors."""
    if count == 1:
        return f"best sensor of {candidates} candidates"
    return f"best {count} of {candidates} candidate sensors, most informative first"


def _best_sines_text(result: Result) -> str:
    """Return the heading of the table of sines."""
    group = "plan/excitation"
    count, amplitude = len(result[f"{group}/choice_dof"].data), result.value(f"{group}/amplitude")
    unit = f" {variable.units}" if (variable := result[f"{group}/amplitude"]).units else ""
    sines = f"best {counted(count, 'sine')}, amplitude {amplitude:.3g}{unit}{' each' if count > 1 else ''}"
    return f"{sines} (same total RMS as the present {driven(result)}); bounds with the present sensors"


def driven(result: Result) -> str:
    """Return what excites: a force, or a source of a graph."""
    return str(result.group_attrs.get("plan/excitation", {}).get("driven", "force"))


def _best_bands_text(result: Result) -> str:
    """Return the heading of the table of frequency bands."""
    return f"best frequency bands, flat {driven(result)} spectrum with the same RMS (steady state)"


def _steady_state_text(result: Result) -> str:
    """Return the condition under which the bounds of sines hold."""
    settling = result.get("plan/excitation/settling_time")
    if settling is None:
        return "assumes the steady state, which an undamped structure does not reach by itself"
    return (
        f"assumes the steady state: the slowest mode needs {float(settling.data):.2g} s to decay to 1 %; "
        "bounds of a transient record are not comparable"
    )


def _gain_text(value: float) -> str:
    """Return the factor by which a choice reduces the bounds."""
    return f"× {value:.3g}" if math.isfinite(value) else ""


def _efficiency_text(efficiency: float, what: str) -> str:
    """Return the efficiency of the present sensors or forces, relative to the best."""
    if efficiency < 1e-3:
        return f"the present {what} give almost no information"
    if efficiency > 0.995:
        return f"no better {what} were found than the present ones"
    share = f"{100 * efficiency:.2g} %"
    return f"efficiency of the present {what}: {share} (geometric mean of best bound / present bound)"
