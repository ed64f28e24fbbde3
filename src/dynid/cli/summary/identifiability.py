"""The screen of what a record can tell, before it is worked on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from dynid.numerals import quantity
from dynid.result import Result

GROUP = "identification/identifiability"
#: The most modes on the screen, and the least relative shift that is worth a number.
_MOST_MODES, _SHIFT = 8, 1e-6


def percent(value: float) -> str:
    """Write a relative bound."""
    if not math.isfinite(value):
        return "not told"
    return f"{100 * value:.2g} %" if value < 1 else f"{100 * value:.3g} %"


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterable[str]:
    """Yield aligned lines, the first column to the left."""
    cells = [list(headings), *[list(row) for row in rows]]
    widths = [max(len(row[k]) for row in cells) for k in range(len(headings))]
    for row in cells:
        right = "  ".join(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        yield f"    {row[0]:<{widths[0]}}  {right}".rstrip()


def identifiability_lines(result: Result) -> list[str]:
    """Return bounds, collinear parameters, and what the parameters do to the modes."""
    if f"{GROUP}/relative_bound" not in result:
        return []
    return [*_bounds(result), *_groups(result), "", *_modes(result), ""]


def _bounds(result: Result) -> Iterable[str]:
    get = {name: result[f"{GROUP}/{name}"].data for name in ("parameter", "unit", "value", "relative_bound")}
    known = result[f"{GROUP}/relative_bound_known_state"].data
    attrs = result.group_attrs[GROUP]
    place = "true values" if attrs["at"] == "true" else "start values"
    noise = "" if attrs["noise"] == "known" else "; noise assumed, 1 % of each channel"
    of_time = "identification/measurement/omega" not in result  # a frequency response has no initial state
    what = "record" if of_time else "frequency responses"
    state = ", initial state unknown" if of_time else ""
    yield f"  what the {what} can tell (Cramér–Rao bound at the {place}{state}{noise})"
    rows = [
        (
            f"{name} [{unit}]".removesuffix(" []"),
            quantity(value),
            percent(bound),
            *([percent(least)] if of_time else []),
        )
        for name, unit, value, bound, least in zip(*get.values(), known, strict=True)
    ]
    yield from table(("", "value", "bound", *(["state known"] if of_time else [])), rows)


def _groups(result: Result) -> Iterable[str]:
    group = f"{GROUP}/groups"
    bounds = dict(zip(result[f"{GROUP}/parameter"].data, result[f"{GROUP}/relative_bound"].data, strict=True))
    for names, seen in zip(result[f"{group}/parameters"].data, result[f"{group}/seen"].data, strict=True):
        told = all(math.isfinite(bounds[name]) for name in names.split(", "))
        how = "are hardly told apart" if told else "cannot be told apart"
        only = f": the record shows {'mostly' if told else 'only'} {seen}" if seen else ""
        yield f"    {names} {how}{only}"
    grouped = {name for names in result[f"{group}/parameters"].data for name in names.split(", ")}
    unseen = [name for name, bound in bounds.items() if not math.isfinite(bound) and name not in grouped]
    if unseen:
        yield f"    {', '.join(unseen)} cannot be seen: excite or measure where the joint works"


def _modes(result: Result) -> Iterable[str]:
    """Yield what one per cent of each parameter does to frequency and damping of each mode."""
    group = f"{GROUP}/modal_sensitivity"
    get = {name: result[f"{group}/{name}"].data for name in ("omega", "zeta")}
    names = result[f"{group}/parameter"].data
    values = result[f"{GROUP}/value"].data
    by_omega = result[f"{group}/omega_by_parameter"].data * values / get["omega"][:, None]
    by_zeta = result[f"{group}/zeta_by_parameter"].data * values
    yield "  what 1 % of a stiffness does to a mode's frequency, and 1 % of a damping to its damping ratio"
    rows = []
    for k in range(min(len(get["omega"]), _MOST_MODES)):
        moved = [
            _shift(by_omega[k, j]) if str(name).endswith(".k") else _shift(by_zeta[k, j], "ζ ")
            for j, name in enumerate(names)
        ]
        rows.append((f"{k + 1}", f"{get['omega'][k]:.5g}", f"{100 * get['zeta'][k]:.3g} %", *moved))
    yield from table(("mode", "rad/s", "damping", *map(str, names)), rows)
    if len(get["omega"]) > _MOST_MODES:
        yield f"    … up to {get['omega'][-1]:.5g} rad/s"


def _shift(part: float, what: str = "") -> str:
    if not np.isfinite(part):
        return "∞"
    return "-" if abs(part) < _SHIFT else f"{what}{part:+.2g} %"
