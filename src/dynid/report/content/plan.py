"""Content of plans: the most informative sensors and excitations."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dynid.number_format import counted, span_text
from dynid.report.content.blocks import Block, ReportSection, Statement, TextTable
from dynid.report.content.identifiability import bound_text, calibration_sections, identifiability_sections
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Most bands that are listed.
_BANDS = 12


def method(result: Result) -> str:  # noqa: ARG001 - every kind has one
    """Return the kind of analysis and its method."""
    return "plan · D-optimal, greedy with exchange"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the content of a plan."""
    group = "plan/sensors"
    get = {name: result[f"{group}/{name}"].data for name in ("choice", "bound", "gain")}
    rows = [
        (f"{'+ ' if k else ''}{name}", *map(bound_text, bounds), gain_text(gain))
        for k, (name, bounds, gain) in enumerate(zip(*get.values(), strict=True))
    ]
    present = ", ".join(map(str, result[f"{group}/present"].data))
    rows.append((f"now: {present}", *map(bound_text, result[f"{group}/present_bound"].data), ""))
    count = f"best {len(get['choice'])} of {counted(len(result[f'{group}/candidate'].data), 'sensor')}"
    heads = ("", *map(str, result[f"{group}/parameter"].data), "gain")
    table = TextTable(heads, tuple(rows), caption=f"{count}, the most informative first")
    yield ReportSection("Sensors", (table, _efficiency(result, group, "sensors")))
    group = "plan/excitation"
    if f"{group}/choice" not in result:
        text = "The structure is excited by a prescribed motion: forces in its place are not ranked."
        yield ReportSection("Excitation", (Statement(text),))
    else:
        choice, gains = chosen_lines(result), result[f"{group}/gain"].data
        blank = [""] * (len(heads) - 2)
        best = list(map(bound_text, result[f"{group}/best_bound"].data))
        rows = [
            (f"{'+ ' if k else ''}{name}", *(best if k == len(choice) - 1 else blank), gain_text(gain))
            for k, (name, gain) in enumerate(zip(choice, gains, strict=True))
        ]
        rows.append(("now", *map(bound_text, result[f"{group}/present_bound"].data), ""))
        sines = f"best {counted(len(choice), 'sine')} of {result.value(f'{group}/amplitude'):.3g} N"
        caption = f"{sines} (the present force's RMS), bounds with the present sensors"
        blocks: list[Block] = [TextTable(heads, tuple(rows), caption=caption)]
        blocks.append(_efficiency(result, group, "forces"))
        if f"{group}/settling_time" in result:
            wait = f"the slowest mode takes {result.value(f'{group}/settling_time'):.2g} s"
            blocks.append(Statement(f"In the steady state: {wait} to decay to a hundredth."))
        bands = [result[f"{group}/bands/{name}"].data[:_BANDS] for name in ("dof", "low", "high", "bound")]
        unit = frequency_unit(result)
        spans = tuple(
            (
                f"{dof}: {span_text(unit.factor * low, unit.factor * high)} {unit.name}",
                *map(bound_text, bounds),
            )
            for dof, low, high, bounds in zip(*bands, strict=True)
        )
        caption = "Best bands, the same force spread evenly over one"
        blocks.append(TextTable(heads[:-1], spans, caption=caption))
        yield ReportSection("Excitation", tuple(blocks))
    yield from identifiability_sections(result)
    yield from calibration_sections(result)


def chosen_lines(result: Result) -> list[str]:
    """Return DOF and frequency of the chosen sines, in the unit of the scene."""
    unit = frequency_unit(result)
    dofs, omega = (result[f"plan/excitation/choice_{name}"].data for name in ("dof", "omega"))
    return [f"{dof} at {unit.text(float(at), 5)}" for dof, at in zip(dofs, omega, strict=True)]


def gain_text(value: float) -> str:
    """Return the factor by which a choice reduces the bounds."""
    return f"× {value:.3g}" if math.isfinite(value) else ""


def efficiency_text(efficiency: float, what: str) -> str:
    """Return the efficiency of the present sensors or forces, relative to the best."""
    if efficiency < 1e-3:
        return f"{what} as they are give almost no information"
    if efficiency > 0.995:
        return f"{what} as they are: nothing better was found"
    share = f"{100 * efficiency:.2g} %"
    return f"{what} as they are reach {share} of that (best over present bounds, geometric mean)"


def _efficiency(result: Result, group: str, what: str) -> Statement:
    return Statement(efficiency_text(result.value(f"{group}/efficiency"), f"the {what}").capitalize())
