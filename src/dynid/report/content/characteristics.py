"""Texts of step response, bandwidth, energy shares and the performance of sources."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from dynid.number_format import MOST_ROOTS, root_text
from dynid.report.scenes import in_hertz
from dynid.result import Result

_ENERGY, _SOURCES = "bond_graph/energy", "bond_graph/source_performance"
#: Most elements named in a list of shares, and the smallest share.
_ELEMENTS, _LEAST = 4, 0.005

Line = tuple[str, str]


def frequency(result: Result, omega: float) -> str:
    """Return a frequency in the unit of the scene."""
    return f"{omega / math.tau:.4g} Hz" if in_hertz(result) else f"{omega:.4g} rad/s"


def characteristics(result: Result, output: str, source: str) -> Iterator[Line]:
    """Yield the characteristics of the step response, and the bandwidth of a channel, each with its title."""
    group = f"bond_graph/properties/{output}/{source}"
    get = _Values(result, group)
    if f"{group}/step_status" in result:
        parts = []
        if "rise_time" in get:
            parts.append(f"rise time {get['rise_time']} s (10 to 90 %)")
            parts.append(f"settling time {get['settling_time']} s (2 %)")
            parts.append(f"overshoot {get['overshoot']} %")
            if get.number("undershoot") > 0:
                parts.append(f"undershoot {get['undershoot']} %")
        if "peak" in get:
            when = "" if math.isinf(get.number("peak_time")) else f" at {get['peak_time']} s"
            parts.append(f"peak {get['peak']}{when}")
        status = str(result.value(f"{group}/step_status"))
        yield "step response", " · ".join([*parts, *([] if status == "defined" else [status])])
    if f"{group}/bandwidth_status" in result:
        parts = []
        if "bandwidth" in get:
            band = get.number("bandwidth")
            parts.append(
                "no upper limit" if math.isinf(band) else f"{frequency(result, band)} (-3 dB of T(0))"
            )
        if "peak_gain" in get:
            at = get.number("peak_frequency")
            where = "at high frequencies" if math.isinf(at) else f"at {frequency(result, at)}"
            parts.append(f"largest |T| {get['peak_gain']} {where}")
        status = str(result.value(f"{group}/bandwidth_status"))
        yield "bandwidth", " · ".join([*parts, *([] if status == "defined" else [status])])


class _Values:
    """Numbers of a group as text."""

    def __init__(self, result: Result, group: str) -> None:
        self._result, self._group = result, group

    def __contains__(self, name: str) -> bool:
        return f"{self._group}/{name}" in self._result

    def number(self, name: str) -> float:
        """Return a number."""
        return float(self._result.value(f"{self._group}/{name}"))

    def __getitem__(self, name: str) -> str:
        return f"{self.number(name):.4g}"


def energy_lines(result: Result) -> Iterator[Line]:
    """Yield where every mode has its energy, and what damps it."""
    if f"{_ENERGY}/status" not in result:
        return
    status = str(result.value(f"{_ENERGY}/status"))
    if status != "defined":
        yield "energy", status
        return
    poles = result[f"{_ENERGY}/poles"].data
    stored, lost = (result[f"{_ENERGY}/{name}_share"].data for name in ("stored", "dissipated"))
    storages, resistors = (result[f"{_ENERGY}/{name}"].data for name in ("storage", "resistor"))
    for place, pole in enumerate(poles[:MOST_ROOTS]):
        text = f"energy in {_shares(storages, stored[place])}"
        if lost[place].any():
            text += f"; dissipated in {_shares(resistors, lost[place])}"
        else:
            text += "; no resistor damps it"
        yield root_text(pole, hertz=in_hertz(result)), text
    if len(poles) > MOST_ROOTS:
        yield "…", f"{len(poles) - MOST_ROOTS} more in the file"


def _shares(names: Any, shares: Any) -> str:
    """Return the largest shares in words."""
    order = [int(k) for k in np.argsort(-shares, kind="stable") if shares[k] >= _LEAST]
    parts = [f"{names[k]} {100 * shares[k]:.3g} %" for k in order[:_ELEMENTS]]
    return ", ".join(parts) + (", …" if len(order) > _ELEMENTS else "")


def source_lines(result: Result) -> Iterator[Line]:
    """Yield the largest power that every input gives over the band, and its impedance there."""
    if f"{_SOURCES}/omega" not in result:
        return
    omega = result[f"{_SOURCES}/omega"].data
    for path in result:
        if path.startswith(f"{_SOURCES}/") and path.endswith("/active_power"):
            group = path.removesuffix("/active_power")
            power, impedance = result[path].data, result[f"{group}/impedance"]
            at = int(np.argmax(power))
            size, unit = abs(impedance.data[at]), impedance.units
            name = group.removeprefix(f"{_SOURCES}/")
            text = f"at an amplitude of 1 at most {power[at]:.4g} {result[path].units or 'W'}"
            where = frequency(result, omega[at])
            yield (
                name,
                f"{text} at {where}, where |Z| = {size:.4g}{f' {unit}' if unit not in ('', '1') else ''}",
            )
