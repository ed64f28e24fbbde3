"""Screens of identifications, their plans, and comparisons of reductions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from dynid.cli.summary.common import aligned, paragraph, response_lines, wrapped
from dynid.number_format import counted, significant, span_text
from dynid.report.content.identifiability import (
    GROUP,
    bound_table,
    bound_text,
    calibration_sentences,
    collinear_groups,
    first_modes,
    interchangeable,
    known_parts_table,
    modal_heading,
    modal_shifts,
)
from dynid.report.content.identification import (
    has_estimates,
    parameter_table,
    preparation,
    record_summary,
    verdict_sentences,
)
from dynid.report.content.modes import (
    derived_table,
    has_modes,
    is_requested,
    modal_statements,
    modal_table,
    statements,
)
from dynid.report.content.plan import (
    GAIN_OF_SINES,
    PRESCRIBED,
    best_bands_text,
    best_sensors_text,
    best_sines_text,
    driven,
    efficiency_text,
    gain_text,
    place_text,
    sine_rows,
    steady_state_text,
)
from dynid.report.content.reduction import method_table, remarks, seconds_text
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Most modes, modes with sensitivities, massless DOFs and frequency bands on a screen.
_MODES, _SHIFTS, _MASSLESS, _BANDS = 20, 8, 8, 5


def lines(result: Result) -> list[str]:
    """Return the screen of an identification, line by line."""
    screen: list[str] = []
    if has_estimates(result):
        columns, rows = parameter_table(result)
        screen += [
            *paragraph(record_summary(result)),
            *(part for line in preparation(result) for part in paragraph(line)),
            "",
            *aligned([columns, *rows], gap=4, left=_texts(columns)),
            "",
            *_known_parts(result),
            *(line for sentence in verdict_sentences(result) for line in paragraph(sentence)),
            *(line for sentence in calibration_sentences(result) for line in paragraph(sentence)),
            "",
            *_measured_modes(result),
            *_derived(result),
        ]
    screen += identifiability_lines(result)
    if "structure/modes/omega" in result:
        screen += [*_modes(result), ""]
    screen += response_lines(result, "structure")
    if "bond_graph" in result.group_attrs:
        from dynid.cli.summary.bond_graph import lines as lines_of_graph

        screen += lines_of_graph(result)
    return screen[:-1] if not screen[-1] else screen


def _known_parts(result: Result) -> Iterable[str]:
    """Yield the biases by what is known, beside the standard errors."""
    heads, rows, remarks = known_parts_table(result)
    if rows:
        yield from aligned([heads, *rows], gap=4, left=[0])
        for remark in remarks:
            yield from paragraph(remark, "    ")
        yield ""


def _measured_modes(result: Result) -> Iterable[str]:
    """Yield measured modes beside those of the model."""
    if has_modes(result):
        columns, rows = modal_table(result)
        yield from aligned([columns, *rows[:_MODES]], "   ", left=_texts(columns))
        if len(rows) > _MODES:
            yield f"    … {counted(len(rows) - _MODES, 'more mode')} in the file"
        yield ""
        for sentence in (said := modal_statements(result)):
            yield from wrapped(f"  {sentence}", 110, subsequent_indent="    ")
        if said:
            yield ""


def _derived(result: Result) -> Iterable[str]:
    """Yield what follows from the estimate, as far as it was requested."""
    if is_requested(result):
        columns, rows = derived_table(result)
        if rows:
            yield from aligned([columns, *rows[:_MODES]], gap=4, left=_texts(columns))
            if len(rows) > _MODES:
                yield f"    … {counted(len(rows) - _MODES, 'more row')} in the file"
            yield ""
    for sentence in (said := list(statements(result))):
        yield from wrapped(f"  {sentence}", 110, subsequent_indent="    ")
    if said:
        yield ""


def identifiability_lines(result: Result, *, planned: bool = False) -> list[str]:
    """Return the Cramér–Rao bounds, collinear parameters, and the sensitivities of the modes.

    Parameters
    ----------
    result
        The result.
    planned
        True for a plan, which has no record yet.
    """
    if f"{GROUP}/relative_bound" not in result:
        return []
    found = bound_table(result)
    place, noise = found.where
    source = " from the record" if found.of_time else " from the frequency responses"
    state = ", initial state unknown" if found.of_time else ""
    heading = f"  identifiability{'' if planned else source} (Cramér–Rao bounds at the {place}{state}{noise})"
    screen = [
        *wrapped(heading, 110, subsequent_indent="    "),
        *aligned([found.heads, *found.rows]),
        *(part for line in collinear_groups(result) for part in paragraph(line, "    ")),
        *(part for line in interchangeable(result) for part in paragraph(line, "    ")),
    ]
    # An identification has the calibration below its estimates.
    if not has_estimates(result):
        screen += [line for sentence in calibration_sentences(result) for line in paragraph(sentence, "    ")]
    columns, rows = modal_shifts(result)
    shown, count = first_modes(rows, _SHIFTS)
    screen += [
        "",
        *wrapped(f"  {modal_heading(result)}", 110, subsequent_indent="    "),
        *aligned([columns, *shown]),
    ]
    if count > _SHIFTS:
        screen.append(f"    … up to {next(row[1] for row in reversed(rows) if row[0])} {columns[1]}")
    return [*screen, ""]


def _modes(result: Result) -> Iterable[str]:
    """Yield the modes, one per line, and the number of rigid-body modes and massless DOFs."""
    group = "structure/modes"
    omega, damping, name = (result[f"{group}/{part}"].data for part in ("omega", "damping", "name"))
    massless = list(result[f"{group}/massless"].data) if f"{group}/massless" in result else []
    counts = (
        counted(number, what) if number else f"no {what}s"
        for number, what in (
            (int(result.value(f"{group}/rigid")), "rigid-body mode"),
            (len(massless), "massless DOF"),
        )
    )
    size = counted(len(result[f"{group}/dof"].data), "DOF")
    yield f"  {counted(len(omega), 'mode')} of {size}; {', '.join(counts)}"
    if massless:
        more = f" … {massless[-1]}" if len(massless) > _MASSLESS else ""
        yield f"    massless: {', '.join(massless[:_MASSLESS])}{more}"
    yield f"    {'mode':>4}  {'rad/s':>10}  {'Hz':>10}  {'ζ':>9}"
    for k in range(min(len(omega), _MODES)):
        hertz, percent = omega[k] / (2 * math.pi), 100 * damping[k]
        sizes = "  ".join(f"{significant(value, 5):>10}" for value in (omega[k], hertz))
        row = f"    {k + 1:>4}  {sizes}  {percent:>7.3g} %  {name[k]}"
        yield row.rstrip()
    if len(omega) > _MODES:
        unit = frequency_unit(result)
        yield f"    … up to {unit.factor * omega[-1]:.5g} {unit.name}"


def reduction_lines(result: Result) -> list[str]:
    """Return the screen of a comparison of reductions, line by line."""
    size = len(result["reduction/dof"].data)
    took = seconds_text(result.group_attrs.get("reduction", {}).get("seconds"))
    effort = f"; its modes took {took}" if took else ""
    columns, rows = method_table(result)
    table = aligned([columns, *rows], "   ", left=_texts(columns))
    notes = (line for note in remarks(result) for line in paragraph(note))
    return [*table, "", f"  {size} DOFs{effort}", *notes]


def _texts(columns: Sequence[str]) -> list[int]:
    """Return which columns have no heading: texts, aligned to the left."""
    return [k for k, heading in enumerate(columns) if not heading]


def plan_lines(result: Result) -> list[str]:
    """Return the screen of a plan of sensors and excitation, line by line."""
    group = "plan/sensors"
    choice, present = result[f"{group}/choice"].data, result[f"{group}/present"].data
    names = [str(name) for name in result[f"{group}/parameter"].data]
    candidates = len(result[f"{group}/candidate"].data)
    bounds, gains = result[f"{group}/bound"].data, result[f"{group}/gain"].data
    rows = [
        (f"{'+ ' if k else ''}{name}", *map(bound_text, bounds[k]), gain_text(gains[k]))
        for k, name in enumerate(choice)
    ]
    now = (f"present: {', '.join(present)}", *map(bound_text, result[f"{group}/present_bound"].data), "")
    return [
        f"  {best_sensors_text(len(choice), candidates)}",
        *aligned([("", *names, "gain"), *rows, now]),
        f"    {efficiency_text(result.value(f'{group}/efficiency'), 'sensors')}",
        "",
        *_excitation(result),
        "",
        *identifiability_lines(result, planned=True),
    ]


def _excitation(result: Result) -> Iterable[str]:
    """Yield the best sines and frequency bands of a plan, with their bounds."""
    group = "plan/excitation"
    if f"{group}/choice" not in result:
        yield f"  {PRESCRIBED}"
        return
    names = [str(name) for name in result[f"{group}/parameter"].data]
    yield from wrapped(f"  {best_sines_text(result)}", 110, subsequent_indent="    ")
    yield from aligned([("", *names, GAIN_OF_SINES), *sine_rows(result)])
    yield f"    {efficiency_text(result.value(f'{group}/efficiency'), f'{driven(result)}s')}"
    yield from wrapped(f"    {steady_state_text(result)}", 110, subsequent_indent="      ")
    group, unit = f"{group}/bands", frequency_unit(result)
    bands = zip(
        *(result[f"{group}/{name}"].data[:_BANDS] for name in ("dof", "low", "high", "bound")), strict=True
    )
    rows = [
        (
            f"{place_text(dof)}: {span_text(unit.factor * low, unit.factor * high)} {unit.name}",
            *map(bound_text, bound),
        )
        for dof, low, high, bound in bands
    ]
    yield ""
    yield f"  {best_bands_text(result)}"
    yield from aligned([("", *names), *rows])
