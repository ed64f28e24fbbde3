"""Numbers as people read them in a figure."""

from __future__ import annotations

import re

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: A space that does not break, between thousands.
_THIN = "\N{NARROW NO-BREAK SPACE}"


def raised(power: int) -> str:
    """Write a whole number as an exponent."""
    return str(power).translate(_RAISED)


def unit(text: str) -> str:
    """Write units as people do: `N.s/m` is N·s/m, `m/s2` m/s²."""
    text = text.replace(".", "·").replace("^0·5", "^½")
    return re.sub(r"(?<=[A-Za-z])\d", lambda found: found[0].translate(_RAISED), text)


def labelled(name: str, units: str = "") -> str:
    """Return what an axis or a column is called: its name with its units, if it has any (not so `1`)."""
    return f"{name} ({unit(units)})" if units not in ("", "1") else name


def in_decibels(name: str, units: str = "") -> str:
    """Return what an axis in dB is called, with the unit that 0 dB stands for where it is known."""
    known = {"": "dB, of SI units", "1": "dB"}.get(units, f"dB re {unit(units)}")
    return f"{name} ({known})"


def short(value: float, digits: int = 4) -> str:
    """Write a number with a few significant digits: 20 000, 0.0137, 1·10⁻⁸.

    Powers of ten are written out from 10⁶ on and below 10⁻³; thousands stand apart.
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
