"""Frequency and time responses on the screens of results."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import wrap

from dynid.number_format import counted, span_text
from dynid.report.scenes import frequency_span, peak_responses
from dynid.result import Result

#: Most channels and outputs that are listed.
_MOST = 12


def response_lines(result: Result, group: str) -> Iterable[str]:
    """Yield the peaks of the frequency response and the range of the time response below a group."""
    yield from _frequency(result, f"{group}/frequency_response")
    yield from _time(result, f"{group}/time_response")


def _frequency(result: Result, group: str) -> Iterable[str]:
    if f"{group}/omega" not in result:
        return
    low, high, unit = frequency_span(result, group)
    count = counted(len(result[f"{group}/omega"].data), "frequency")
    yield f"  frequency response at {count}, {span_text(low, high)} {unit}"
    top = peak_responses(result, group)
    outputs, inputs = (result[f"{group}/{axis}"].data for axis in ("output", "input"))
    channels = [(k, m) for k in range(len(outputs)) for m in range(len(inputs))]
    for k, m in channels[:_MOST]:
        size = f"{top.magnitude[k, m]:.4g}".replace("inf", "∞")
        said = f"is largest, {size} at {top.at[k, m]:.4g} {unit}"
        said = said if top.magnitude[k, m] else "is 0 at all of them"
        yield f"    |{outputs[k]} over {inputs[m]}| {said}"
    if len(channels) > _MOST:
        yield f"    … {counted(len(channels) - _MOST, 'more channel')} in the file"


def _time(result: Result, group: str) -> Iterable[str]:
    if f"{group}/time" not in result:
        return
    time, response = result[f"{group}/time"].data, result[f"{group}/response"].data
    yield f"  time response at {counted(len(time), 'instant')}, to {time[-1]:.4g} s"
    note = result.group_attrs.get(group, {}).get("note")
    if note:
        yield from (f"    {line}" for line in wrap(f"Note: {note}.", 96))
    outputs = result[f"{group}/output"].data
    for k, output in enumerate(outputs[:_MOST]):
        column = response[:, k]
        yield f"    {output}: {column.min():.4g} … {column.max():.4g}, at the end {column[-1]:.4g}"
    if len(outputs) > _MOST:
        yield f"    … {counted(len(outputs) - _MOST, 'more output')} in the file"
