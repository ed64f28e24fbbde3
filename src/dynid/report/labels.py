"""Numbers, units and labels in the notation of figures."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.result import Result

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Separator of thousands.
_THIN = "\N{NARROW NO-BREAK SPACE}"


def raised(power: int) -> str:
    """Return an integer as superscript digits."""
    return str(power).translate(_RAISED)


def unit(text: str) -> str:
    """Return units in mathematical notation: `N.s/m` is N·s/m, `m/s2` is m/s²."""
    text = text.replace(".", "·").replace("^0·5", "^½")
    return re.sub(r"(?<=[A-Za-z])\d", lambda found: found[0].translate(_RAISED), text)


def labelled(name: str, units: str = "") -> str:
    """Return the label of an axis or a column: its name with its units, if there are any (`1` is none)."""
    return f"{name} ({unit(units)})" if units not in ("", "1") else name


def in_decibels(name: str, units: str = "") -> str:
    """Return the label of an axis in dB, with the reference unit of 0 dB where it is known."""
    known = {"": "dB, of SI units", "1": "dB"}.get(units, f"dB re {unit(units)}")
    return f"{name} ({known})"


def short(value: float, digits: int = 4) -> str:
    """Return a number with a few significant digits: 20 000, 0.0137, 10⁻⁸.

    Powers of ten are used from 10⁶ on and below 10⁻³; thousands are separated.
    """
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    if not power:  # inf and nan
        return {"inf": "∞", "-inf": "−∞"}.get(mantissa, mantissa)
    if value and not -3 <= int(power) < 6:
        mantissa = mantissa.rstrip("0").rstrip(".")
        times = {"1": "", "-1": "−"}.get(mantissa, f"{mantissa}·")
        return f"{times}10{raised(int(power))}".replace("-", "−")
    text = f"{float(f'{value:.{digits}g}'):.12g}"
    whole, dot, rest = text.partition(".")
    sign, figures = ("−", whole[1:]) if whole.startswith("-") else ("", whole)
    if len(figures) > 4:
        figures = f"{int(figures):,}".replace(",", _THIN)
    return f"{sign}{figures}{dot}{rest}"


def texts(result: Result, path: str) -> list[str]:
    """Return an array of texts of a result; empty where there is none."""
    return list(map(str, result[path].data)) if path in result else []


def labels_with_units(result: Result, group: str, axis: str, count: int, units: str = "") -> list[str]:
    """Return the labels of an axis, each with its units: those of `unit` in the group, or the given ones."""
    names = texts(result, f"{group}/{axis}") or [str(place + 1) for place in range(count)]
    own = texts(result, f"{group}/unit") or [units] * count
    return [labelled(name, unit) for name, unit in zip(names, own, strict=True)]
