"""Units of functions in Universal Files: those of the record of units (164), and the labels of their axes.

Values are in the units of the record. Many programs write none, or other values with a label that says so;
where label and record contradict each other the unit is in doubt.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dynid.units import UnknownUnitError, readings, si_factor, unit_fits

#: How many units are one metre, and one newton.
_LENGTHS = {name: 1 / si_factor(name, ["m"]) for name in ("m", "cm", "mm", "um", "in", "ft")}
_FORCES = {name: 1 / si_factor(name, ["N"]) for name in ("N", "cN", "mN", "kN", "kgf", "lbf", "poundal")}
#: Units by their code in a record 164; 9 is any.
_CODES = {
    1: ("m", "N"),
    2: ("ft", "lbf"),
    3: ("m", "kgf"),
    4: ("ft", "poundal"),
    5: ("mm", "mN"),
    6: ("cm", "cN"),
    7: ("in", "lbf"),
    8: ("mm", "kgf"),
    10: ("mm", "N"),
}
#: Factors have six digits at least.
_DIGITS = 1e-5
_PER_TIME = {"displacement": "", "velocity": "/s", "acceleration": "/s2"}


class FileUnits(NamedTuple):
    """Units of a file: how many of them are one metre, and one newton; and whether a record 164 says so."""

    length: float = 1.0
    force: float = 1.0
    recorded: bool = False

    @property
    def names(self) -> tuple[str, str]:
        """Names of the units of length and force; empty of uncommon ones."""
        return _name(_LENGTHS, self.length), _name(_FORCES, self.force)

    def fault(self, code: int) -> str:
        """Return what is wrong with a record of these factors and this code; empty if nothing is."""
        if not all(math.isfinite(factor) and factor > 0 for factor in (self.length, self.force)):
            return f"its record of units (164) has the factors {self.length:g}, {self.force:g}"
        if code in _CODES and self.names != _CODES[code]:
            said = " and ".join(_CODES[code])
            return (
                f"its record of units (164) says {said} (code {code}), but has the factors {self.length:g}, "
                f"{self.force:g}"
            )
        return ""


class FunctionUnits(NamedTuple):
    """Unit of a function by its `label` and by the `record` of units; `doubt` where these contradict.

    Texts are empty where the file says nothing.
    """

    label: str = ""
    record: str = ""
    doubt: str = ""

    @property
    def stated(self) -> str:
        """The unit; empty where it is not stated, or in doubt."""
        return "" if self.doubt else self.label or self.record


def function_units(
    quantity: str, along: str, over: str, across: str, labels: tuple[str, str], units: FileUnits
) -> FunctionUnits:
    """Return the unit of a function.

    Parameters
    ----------
    quantity, over
        Those of ordinate and denominator, as of `UniversalFunction`; a record has no denominator.
    along, across
        Their directions: ``x``, ``-rz``, ….
    labels
        Their units as the axes are labelled.
    units
        Those of the file.
    """
    label = _labelled(labels)
    if not quantity:
        plain = units.length == units.force == 1
        doubt = "" if label or plain else "its type does not say what it is, and its file is not in SI units"
        return FunctionUnits(label, "", doubt)
    si = _unit(quantity, along, over, across, ("m", "N"))
    if label and not unit_fits(label, [si]):
        whole = _quotient(label, _unit(over, across, "", "", ("m", "N"))) if over else ""
        if not (whole and unit_fits(whole, [si])):
            return FunctionUnits(
                label, "", f"its type says {quantity}{f' over {over}' if over else ''}, its label {label}"
            )
        label = whole
    if not units.recorded:
        return FunctionUnits(label)
    if not all(units.names):
        doubt = (
            "" if label else f"of its units {units.length:g} are one metre, and {units.force:g} one newton"
        )
        return FunctionUnits(label, "", doubt)
    record = _unit(quantity, along, over, across, units.names)
    doubt = f"its label says {label}, the record of units (164) {record}"
    return FunctionUnits(label, record, "" if not label or _same(label, record, si) else doubt)


def _name(known: dict[str, float], factor: float) -> str:
    return next((name for name, one in known.items() if abs(factor / one - 1) < _DIGITS), "")


def _unit(quantity: str, along: str, over: str, across: str, names: tuple[str, str]) -> str:
    """Return the unit of a quantity, over that of another, made of units of length and force."""
    length, force = names
    turning = along.lstrip("-").startswith("r")
    if quantity == "force":
        above = f"{force}.{length}" if turning else force
    else:
        above = f"{'rad' if turning else length}{_PER_TIME[quantity]}"
    return _quotient(above, _unit(over, across, "", "", names)) if over else above


def _quotient(above: str, below: str) -> str:
    return f"({above})/({below})"


def _labelled(labels: tuple[str, str]) -> str:
    """Return the unit that the labels of the axes are; empty where they are none."""
    above, below = labels
    text = _quotient(above, below) if above and below else above
    try:
        readings(text)
    except UnknownUnitError:
        return ""
    return text


def _same(one: str, other: str, si: str) -> bool:
    """Return True if two units of the dimension of a third are the same."""
    factors = [
        [unit.factor for unit in readings(text) if any(unit.dimension == of.dimension for of in readings(si))]
        for text in (one, other)
    ]
    return any(abs(a / b - 1) < _DIGITS for a in factors[0] for b in factors[1])
