"""Margins of the feedback loops of a graph, each with the other loops closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from fractions import Fraction
from math import lcm

import numpy as np

from dynid.arithmetic.ldl import reference
from dynid.bondgraph.control import Loop, Polynomial, close_loops
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.plan import ReducedGraph
from dynid.lti.margins import Margins, margins
from dynid.result import Result

_GROUP = "bond_graph/margins"
_UNITS = {"phase": "deg", "delay": "s"}


def add_margins(result: Result, opened: BondGraph, loops: Sequence[Loop]) -> None:
    """Add the margins of every loop.

    Parameters
    ----------
    result
        Where to add them.
    opened
        The graph without feedback.
    loops
        The loops.
    """
    found = [_margins(opened, loops, place) for place in range(len(loops))]
    result.add_axis(f"{_GROUP}/loop", [f"{loop.measured} -> {loop.source}" for loop in loops])
    for name in (field.name for field in fields(Margins)):
        unit = _UNITS.get(name, "rad/s" if name.endswith(("crossover", "_at")) else "")
        result.add(f"{_GROUP}/{name}", np.array([getattr(one, name) for one in found]), ("loop",), unit)


def _margins(opened: BondGraph, loops: Sequence[Loop], place: int) -> Margins:
    """Return the margins of one loop: its controller times the graph in which it alone is open."""
    from flint import fmpz_poly

    own, probe = loops[place], "probe"
    while probe in opened.nodes or any(loop.reference == probe for loop in loops):
        probe += "_"
    opening = replace(own, numerator=[Fraction(0)], denominator=[Fraction(1)], reference=probe)
    closed = close_loops(opened, [*loops[:place], opening, *loops[place + 1 :]])
    output = closed.variables.get(own.measured, own.measured)
    reduced = ReducedGraph(closed.graph, [probe], [output], traced=False)
    (register,) = reduced.channels().values()
    numerator, denominator = reduced.rational([register])[register].lowest_terms()
    top, bottom = (fmpz_poly(_integers(part)) for part in _common(own.numerator, own.denominator))
    numerator, denominator = numerator * top, denominator * bottom
    shared = numerator.gcd(denominator)
    return margins(numerator // shared, denominator // shared)


def _common(numerator: Polynomial, denominator: Polynomial) -> tuple[list[Fraction], list[Fraction]]:
    """Return two polynomials times the common denominator of their coefficients."""
    top, bottom = ([Fraction(reference(c)) for c in part] for part in (numerator, denominator))
    factor = lcm(*(c.denominator for c in (*top, *bottom)))
    return [c * factor for c in top], [c * factor for c in bottom]


def _integers(descending: list[Fraction]) -> list[int]:
    return [int(c) for c in reversed(descending)]
