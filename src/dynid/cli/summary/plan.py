"""The screen of a plan."""

from __future__ import annotations

from collections.abc import Iterable

from dynid.cli.summary.identifiability import identifiability_lines, table
from dynid.number_format import span_text
from dynid.report.content.identifiability import bound_text
from dynid.report.content.plan import chosen_lines, efficiency_text, gain_text
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: The most bands on the screen.
_BANDS = 5


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    said = [*identifiability_lines(result), *_sensors(result), "", *_excitation(result)]
    return said


def _sensors(result: Result) -> Iterable[str]:
    group = "plan/sensors"
    choice, present = result[f"{group}/choice"].data, result[f"{group}/present"].data
    names = [str(name) for name in result[f"{group}/parameter"].data]
    candidates = len(result[f"{group}/candidate"].data)
    yield f"  best {len(choice)} of {candidates} sensors, in the order in which they help"
    rows = [
        (f"{'+ ' if k else ''}{name}", *map(bound_text, bounds), gain_text(gain))
        for k, (name, bounds, gain) in enumerate(
            zip(choice, result[f"{group}/bound"].data, result[f"{group}/gain"].data, strict=True)
        )
    ]
    now = ("now: " + ", ".join(present), *map(bound_text, result[f"{group}/present_bound"].data), "")
    yield from table(("", *names, "gain"), [*rows, now])
    yield f"    {efficiency_text(result.value(f'{group}/efficiency'), 'the sensors')}"


def _excitation(result: Result) -> Iterable[str]:
    group = "plan/excitation"
    if f"{group}/choice" not in result:
        yield "  the structure is driven by a prescribed motion: forces in its place are not ranked"
        return
    names = [str(name) for name in result[f"{group}/parameter"].data]
    choice = chosen_lines(result)
    amplitude = result.value(f"{group}/amplitude")
    sines = f"{len(choice)} sine{'s' * (len(choice) != 1)} of {amplitude:.3g} N"
    yield f"  best {sines} (the present force's RMS), as bounds go with the present sensors"
    blank = [""] * len(names)
    last = len(choice) - 1
    best = list(map(bound_text, result[f"{group}/best_bound"].data))
    rows = [
        (f"{'+ ' if k else ''}{name}", *(best if k == last else blank), gain_text(gain))
        for k, (name, gain) in enumerate(zip(choice, result[f"{group}/gain"].data, strict=True))
    ]
    now = ("now", *map(bound_text, result[f"{group}/present_bound"].data), "")
    yield from table(("", *names, "gain"), [*rows, now])
    yield f"    {efficiency_text(result.value(f'{group}/efficiency'), 'the forces')}"
    if f"{group}/settling_time" in result:
        wait = result.value(f"{group}/settling_time")
        yield f"    of settled motion: the slowest mode takes {wait:.2g} s to decay to a hundredth"
    else:
        yield "    of settled motion, which an undamped structure does not come to by itself"
    yield from _bands(result, names)


def _bands(result: Result, names: list[str]) -> Iterable[str]:
    group, unit = "plan/excitation/bands", frequency_unit(result)
    get = {name: result[f"{group}/{name}"].data[:_BANDS] for name in ("dof", "low", "high", "bound")}
    yield ""
    yield "  best bands, the same force spread evenly over one (steady state)"
    rows = [
        (f"{dof}: {span_text(unit.factor * low, unit.factor * high)} {unit.name}", *map(bound_text, bounds))
        for dof, low, high, bounds in zip(*get.values(), strict=True)
    ]
    yield from table(("", *names), rows)
