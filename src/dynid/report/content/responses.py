"""Content of responses: peaks of frequency responses, ranges of time responses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dynid.number_format import counted, general, span_text
from dynid.report.content.blocks import ReportSection, Statement, TextTable
from dynid.report.scenes import frequency_span, peak_responses, time_courses
from dynid.result import Result

#: Most channels and outputs on a screen, and on a page.
_BRIEF, _MOST = 12, 30
#: Part of the largest value of a response below which a value is round-off.
_RESPONSE_ROUND_OFF = 1e-12


def response_sections(result: Result, base: str) -> Iterator[ReportSection]:
    """Yield the peaks of the frequency responses and the ranges of the time responses of a group."""
    group = f"{base}/frequency_response"
    if f"{group}/omega" in result:
        (low, high, unit), peaks = frequency_span(result, group), peak_responses(result, group)
        rows = []
        for k, output in enumerate(result[f"{group}/output"].data):
            for m, source in enumerate(result[f"{group}/input"].data):
                size = peaks.magnitude[k, m]
                where = f"{general(peaks.at[k, m])}{peaks.note[k, m]}" if size else "all"
                rows.append((f"{output} / {source}", general(size), where))
        span = f"{counted(len(result[f'{group}/omega'].data), 'frequency')}, {span_text(low, high)} {unit}"
        table = TextTable(
            ("", "peak magnitude", f"frequency ({unit})"),
            tuple(rows),
            caption=span,
            noun="channel",
            brief=_BRIEF,
            most=_MOST,
        )
        yield ReportSection("Frequency response", (table, *_note(result, group)), screen="frequency response")
    group = f"{base}/time_response"
    if f"{group}/time" in result:
        courses, outputs = time_courses(result, group), result[f"{group}/output"].data
        time, sources, inputs = (result[f"{group}/{name}"].data for name in ("time", "source", "input"))
        driven = ", ".join(str(name) for name, column in zip(sources, inputs.T, strict=True) if column.any())
        alone = ", each alone" if result[f"{group}/response"].data.ndim == 3 else ""
        to = f"to {driven}{alone}, " if driven else ""
        table = TextTable(
            ("", "min", "max", "final"),
            tuple((name, *extremes(course)) for name, course in courses),
            caption=f"{to}{time[0]:.4g} … {time[-1]:.4g} s, {counted(len(time), 'sample')}",
            noun="output" if len(courses) == len(outputs) else "response",
            brief=_BRIEF,
            most=_MOST,
        )
        yield ReportSection("Time response", (table, *_note(result, group)), screen="time response")
    if f"{base}/joints/force" in result:
        yield _joints(result, f"{base}/joints")


def _note(result: Result, group: str) -> tuple[Statement, ...]:
    """Return the note of a group, if it has one."""
    note = result.group_attrs.get(group, {}).get("note")
    return (Statement(f"note: {note}"),) if note else ()


def _joints(result: Result, group: str) -> ReportSection:
    """Return the ranges of joints with nonlinear laws, and how often their regimes change."""
    names = [str(name) for name in result[f"{group}/joint"].data]
    largest = [np.abs(result[f"{group}/{name}"].data).max(axis=0) for name in ("deflection", "force")]
    work = result[f"{group}/work"].data[-1]
    rows = [(name, *map(general, numbers)) for name, *numbers in zip(names, *largest, work, strict=True)]
    events = int(result.group_attrs[group]["events"])
    table = TextTable(
        ("", "max |deflection| (m)", "max |force| (N)", "work (J)"),
        tuple(rows),
        caption=f"forces of nonlinear laws, {counted(events, 'change')} of regime",
        noun="joint",
        brief=_BRIEF,
        most=_MOST,
    )
    return ReportSection("Nonlinear joints", (table,), screen="nonlinear joints")


def extremes(column: NDArray[np.float64]) -> tuple[str, str, str]:
    """Return the smallest, the largest and the last value of a response; what is round-off of it as 0."""
    round_off = _RESPONSE_ROUND_OFF * float(np.abs(column).max())
    low, high, final = (
        general(0.0 if abs(value) <= round_off < math.inf else value)
        for value in (column.min(), column.max(), column[-1])
    )
    return low, high, final
