"""Frequency responses as their scenes wrote them: in Hz or rad/s."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.report.plot import Axis, Line, Panel
from dynid.report.plot.layers import hue
from dynid.report.scenes import plain_data

if TYPE_CHECKING:
    from dynid.report.plot.layers import Layer
    from dynid.result import Result

Floats = NDArray[np.float64]
#: Blocks of a scene that name frequencies with a unit.
_BLOCKS = frozenset({"frequency", "lines"})


@dataclass(frozen=True)
class Frequencies:
    """The frequencies of a response.

    Parameters
    ----------
    omega
        rad/s.
    hertz
        Whether they are shown in Hz.
    """

    omega: Floats
    hertz: bool

    @property
    def shown(self) -> Floats:
        """The values on the axis."""
        return self.omega / (2 * math.pi) if self.hertz else self.omega

    @property
    def axis(self) -> Axis:
        """The axis: logarithmic where it spans more than a decade."""
        values = self.omega[self.omega > 0]
        wide = bool(len(values)) and bool(values.max() > 10 * values.min()) and len(values) == len(self.omega)
        return Axis("frequency (Hz)" if self.hertz else "angular frequency (rad/s)", log=wide)

    @property
    def columns(self) -> dict[str, Floats]:
        """Their columns in a table."""
        found = {"angular frequency (rad/s)": self.omega}
        return found | ({"frequency (Hz)": self.shown} if self.hertz else {})


def frequencies(result: Result, path: str) -> Frequencies:
    """Return the frequencies at a path of a result."""
    return Frequencies(result[path].data, _in_hertz(str(result.attrs.get("scene", ""))))


@lru_cache(maxsize=4)
def _in_hertz(scene: str) -> bool:
    """Tell whether the text of a scene gives the frequencies of its responses in Hz."""
    if "Hz" not in scene:
        return False
    return _named_hertz(plain_data(scene))


def _named_hertz(data: Any) -> bool:
    if isinstance(data, dict):
        return any(
            (key in _BLOCKS and isinstance(value, dict) and value.get("unit") == "Hz") or _named_hertz(value)
            for key, value in data.items()
        )
    return isinstance(data, list) and any(map(_named_hertz, data))


def decibels(values: NDArray[np.complex128]) -> Floats:
    """Return 20 log10 |values|; NaN where it is not finite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 20 * np.log10(np.abs(values))
    return np.where(np.isfinite(found), found, np.nan)


def degrees(values: NDArray[np.complex128]) -> Floats:
    """Return the phase, unwrapped along the frequencies; NaN where there is none."""
    known = np.isfinite(values) & (values != 0)
    phase = np.full(len(values), np.nan)
    phase[known] = np.rad2deg(np.unwrap(np.angle(values[known])))
    return phase


def bode_panels(
    at: Frequencies,
    curves: Sequence[tuple[str, NDArray[np.complex128]]],
    magnitude: str,
    *,
    absolute: bool = False,
    height: float = 220.0,
    extra: Sequence[Layer] = (),
) -> list[Panel]:
    """Return the panels of magnitude and phase of some responses.

    Parameters
    ----------
    at
        The frequencies.
    curves
        Names and values.
    magnitude
        What the upper axis is called.
    absolute
        Magnitudes as they are, on a logarithmic axis; else in dB.
    extra
        More layers of the upper panel.
    """
    x = at.shown
    up = [
        Line(x, np.abs(values) if absolute else decibels(values), name, hue(place))
        for place, (name, values) in enumerate(curves)
    ]
    down = [Line(x, degrees(values), "", hue(place)) for place, (_, values) in enumerate(curves)]
    return [
        Panel(at.axis, Axis(magnitude, log=absolute), [*up, *extra], height=height),
        Panel(at.axis, Axis("phase (°)", step=15), down, height=0.7 * height),
    ]
