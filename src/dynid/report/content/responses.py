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
        yield ReportSection("Frequency response", (table,), screen="frequency response")
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
        note = result.group_attrs.get(group, {}).get("note")
        remark = (Statement(f"note: {note}"),) if note else ()
        yield ReportSection("Time response", (table, *remark), screen="time response")


def extremes(column: NDArray[np.float64]) -> tuple[str, str, str]:
    """Return the smallest, the largest and the last value of a response; what is round-off of it as 0."""
    round_off = _RESPONSE_ROUND_OFF * float(np.abs(column).max())
    low, high, final = (
        general(0.0 if abs(value) <= round_off < math.inf else value)
        for value in (column.min(), column.max(), column[-1])
    )
    return low, high, final
