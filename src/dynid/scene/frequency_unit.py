"""The unit of the frequencies of a scene, in which its results are shown, too."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

#: Blocks that describe a frequency axis: where there is one, its unit is that of the scene.
_AXES = frozenset({"frequency", "lines", "frf"})


class FrequencyUnit(NamedTuple):
    """A unit of frequencies, the symbol of a frequency in it, and the factor to it from rad/s."""

    name: str
    symbol: str
    factor: float

    def text(self, omega: float, digits: int = 4) -> str:
        """Write an angular frequency (rad/s) in this unit."""
        return f"{self.factor * omega:.{digits}g} {self.name}"


RADIANS = FrequencyUnit("rad/s", "ω", 1.0)
HERTZ = FrequencyUnit("Hz", "f", 1 / (2 * math.pi))


def unit_of_frequencies(data: Any) -> FrequencyUnit:
    """Return the unit of the frequency axes of a scene; without any, Hz where anything is given in Hz.

    Parameters
    ----------
    data
        The scene as plain data.
    """
    found = list(_units(data, ""))
    axes = [unit for block, unit in found if block in _AXES] or [unit for _, unit in found]
    return HERTZ if "Hz" in axes else RADIANS


def _units(data: Any, block: str) -> Iterator[tuple[str, str]]:
    """Yield the blocks that have a unit of frequencies, or are axes, with it."""
    if isinstance(data, dict):
        unit = data.get("unit")
        holds_axes = "simulate" in data or "file" in data  # or a file that says its unit itself
        if unit in ("Hz", "rad/s") or (block in _AXES and not holds_axes):
            yield block, unit or "rad/s"
        for key, value in data.items():
            yield from _units(value, str(key))
    elif isinstance(data, list):
        for item in data:
            yield from _units(item, block)
