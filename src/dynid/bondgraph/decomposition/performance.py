"""The performance characteristic of a source at its port: effort against flow, with the load's line on it.

At s -> 0 either side is a straight line, a e + b f = c for a unit value of an input. It is taken from the
exact equivalents, so that an infinite impedance is a vertical line and no division by zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from dynid.bondgraph.decomposition.equivalents import Decomposition
from dynid.bondgraph.decomposition.one_port_equivalent import OnePortEquivalent
from dynid.bondgraph.exact_engine import TransferFunction

FlowEffort = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class StaticLine:
    """The points (f, e) with effort * e + flow * f = right."""

    effort: Fraction
    flow: Fraction
    right: Fraction

    def meets(self, other: StaticLine) -> FlowEffort | None:
        """Return the point (f, e) that two lines share, None where they are parallel."""
        determinant = self.effort * other.flow - self.flow * other.effort
        if determinant == 0:
            return None
        effort = (self.right * other.flow - self.flow * other.right) / determinant
        flow = (self.effort * other.right - self.right * other.effort) / determinant
        return flow, effort

    def ends(self, box: tuple[FlowEffort, FlowEffort]) -> tuple[FlowEffort, FlowEffort]:
        """Return where the line enters and leaves a box, given by two corners."""
        (left, low), (right, high) = box
        sides = [StaticLine(Fraction(0), Fraction(1), left), StaticLine(Fraction(0), Fraction(1), right)]
        sides += [StaticLine(Fraction(1), Fraction(0), low), StaticLine(Fraction(1), Fraction(0), high)]
        crossings = [point for side in sides if (point := self.meets(side)) is not None]
        inside = sorted(point for point in crossings if left <= point[0] <= right and low <= point[1] <= high)
        return inside[0], inside[-1]


@dataclass(frozen=True)
class StaticCharacteristic:
    """The static characteristic for one input of value 1.

    Parameters
    ----------
    source, load
        The ends (f, e) of both lines, within a box that shows their intercepts and the operating point.
    operating
        The operating point (f, e).
    """

    source: tuple[FlowEffort, FlowEffort]
    load: tuple[FlowEffort, FlowEffort]
    operating: FlowEffort


def static_characteristics(parts: Decomposition) -> dict[str, StaticCharacteristic]:
    """Return the static characteristic for every input that has one.

    It has none where a side has no finite line at s -> 0 (an input that is integrated without end), or where
    the lines are parallel (a motion that nothing stops).
    """
    lines = {name: _lines(parts, name) for name in parts.sources}
    found = {}
    for name, (source, load) in lines.items():
        operating = source.meets(load) if source is not None and load is not None else None
        if source is None or load is None or operating is None:
            continue
        box = _box(source, load, operating)
        found[name] = StaticCharacteristic(source.ends(box), load.ends(box), operating)
    return found


def _lines(parts: Decomposition, name: str) -> tuple[StaticLine | None, StaticLine | None]:
    return _line(parts, parts.source, name, 1), _line(parts, parts.load, name, -1)


def _line(parts: Decomposition, side: OnePortEquivalent, name: str, outward: int) -> StaticLine | None:
    """Return e + Z_eq f = e_eq, or Y_eq e + f = f_eq, at s -> 0, f counted into the load."""
    given = side.flow if side.impedance is None else side.effort
    immittance = side.admittance if side.impedance is None else side.impedance
    assert given is not None
    assert immittance is not None
    registers = [immittance, given.get(name, parts.program.zero)]
    ratios = parts.rational(registers)
    own, drive = (TransferFunction.of(ratios[register]) for register in registers)
    common = own.denominator * drive.denominator // own.denominator.gcd(drive.denominator)
    raw = {
        "one": common,
        "own": own.numerator * (common // own.denominator),
        "drive": drive.numerator * (common // drive.denominator),
    }
    values = _at_zero(raw)
    effort, flow = ("own", "one") if side.impedance is None else ("one", "own")
    if values[effort] == values[flow] == 0:
        return None
    return StaticLine(values[effort], outward * values[flow], values["drive"])


def _at_zero(polynomials: Mapping[str, object]) -> dict[str, Fraction]:
    """Return integer polynomials without a common power of s at s = 0."""
    coefficients = {name: [int(c) for c in polynomial.coeffs()] for name, polynomial in polynomials.items()}  # type: ignore[attr-defined]
    lowest = min(next(k for k, c in enumerate(row) if c) for row in coefficients.values() if row)
    return {name: Fraction(row[lowest] if lowest < len(row) else 0) for name, row in coefficients.items()}


def _box(source: StaticLine, load: StaticLine, operating: FlowEffort) -> tuple[FlowEffort, FlowEffort]:
    """Return a box around the origin, the operating point and the intercepts of both lines."""
    zero = Fraction(0)
    axes = StaticLine(Fraction(1), zero, zero), StaticLine(zero, Fraction(1), zero)
    points = [operating, (zero, zero)]
    points += [point for line in (source, load) for axis in axes if (point := line.meets(axis)) is not None]
    corners = []
    for place in (0, 1):
        low, high = min(point[place] for point in points), max(point[place] for point in points)
        margin = (high - low) / 10 or Fraction(1)
        corners.append((low - margin, high + margin))
    (left, right), (low, high) = corners
    return (left, low), (right, high)
