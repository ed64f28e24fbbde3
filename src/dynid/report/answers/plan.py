"""What a plan says: which sensors and which forces tell most."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dynid.numerals import counted, span_text
from dynid.report.answers.blocks import Block, Grid, Note, Part
from dynid.report.answers.identifiability import bound_text, identifiability_parts
from dynid.result import Result

#: The most bands that are listed.
_BANDS = 12


def method(result: Result) -> str:  # noqa: ARG001 - every kind has one
    """Name the kind of analysis."""
    return "plan · D-optimal, greedy with exchange"


def parts(result: Result) -> Iterator[Part]:
    """Yield what a plan says."""
    yield Part("Sensors", tuple(_sensors(result)))
    if "plan/excitation/choice" in result:
        yield Part("Excitation", tuple(_excitation(result)))
    else:
        said = "The structure is driven by a prescribed motion: forces in its place are not ranked."
        yield Part("Excitation", (Note(said),))
    yield from identifiability_parts(result)


def gain_text(value: float) -> str:
    """Write by how much a choice makes the bounds smaller."""
    return f"× {value:.3g}" if math.isfinite(value) else ""


def reached(efficiency: float, what: str) -> str:
    """Say how near what is there comes to the best."""
    if efficiency < 1e-3:
        return f"{what} as they are tell next to nothing"
    if efficiency > 0.995:
        return f"{what} as they are: nothing better was found"
    share = f"{100 * efficiency:.2g} %"
    return f"{what} as they are reach {share} of that (best over present bounds, geometric mean)"


def _sensors(result: Result) -> Iterator[Block]:
    group = "plan/sensors"
    get = {name: result[f"{group}/{name}"].data for name in ("choice", "bound", "gain")}
    names = [str(name) for name in result[f"{group}/parameter"].data]
    rows = [
        (f"{'+ ' if k else ''}{name}", *map(bound_text, bounds), gain_text(gain))
        for k, (name, bounds, gain) in enumerate(zip(*get.values(), strict=True))
    ]
    present = ", ".join(map(str, result[f"{group}/present"].data))
    rows.append((f"now: {present}", *map(bound_text, result[f"{group}/present_bound"].data), ""))
    count = f"best {len(get['choice'])} of {counted(len(result[f'{group}/candidate'].data), 'sensor')}"
    yield Grid(("", *names, "gain"), tuple(rows), caption=f"{count}, in the order in which they help")
    yield Note(reached(result.value(f"{group}/efficiency"), "the sensors").capitalize())


def _excitation(result: Result) -> Iterator[Block]:
    group = "plan/excitation"
    names = [str(name) for name in result[f"{group}/parameter"].data]
    choice, gains = result[f"{group}/choice"].data, result[f"{group}/gain"].data
    blank = [""] * len(names)
    best = list(map(bound_text, result[f"{group}/best_bound"].data))
    rows = [
        (f"{'+ ' if k else ''}{name}", *(best if k == len(choice) - 1 else blank), gain_text(gain))
        for k, (name, gain) in enumerate(zip(choice, gains, strict=True))
    ]
    rows.append(("now", *map(bound_text, result[f"{group}/present_bound"].data), ""))
    sines = f"best {counted(len(choice), 'sine')} of {result.value(f'{group}/amplitude'):.3g} N"
    said = f"{sines} (the present force's RMS), as bounds go with the present sensors"
    yield Grid(("", *names, "gain"), tuple(rows), caption=said)
    yield Note(reached(result.value(f"{group}/efficiency"), "the forces").capitalize())
    if f"{group}/settling_time" in result:
        wait = result.value(f"{group}/settling_time")
        yield Note(f"Of settled motion: the slowest mode takes {wait:.2g} s to decay to a hundredth.")
    bands = {name: result[f"{group}/bands/{name}"].data[:_BANDS] for name in ("dof", "low", "high", "bound")}
    spans = tuple(
        (f"{dof}: {span_text(low, high)} rad/s", *map(bound_text, bounds))
        for dof, low, high, bounds in zip(*bands.values(), strict=True)
    )
    yield Grid(("", *names), spans, caption="best bands, the same force spread evenly over one")
