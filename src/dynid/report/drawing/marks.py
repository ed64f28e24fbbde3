"""Causal strokes and half arrows: where they are on a bond."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.report.drawing.sketch import Link
from dynid.report.svg import Point

#: Distances from the node, px: where a bond begins and ends, its stroke, the tip of its arrow at the stroke.
START, STROKE, BEYOND = 2.0, 4.0, 8.0
#: Half a stroke's length; length and width of the half arrow, px.
HALF, BARB, WING = 8.0, 11.0, 7.0

Segment = tuple[Point, Point]


def towards(start: Point, end: Point, distance: float) -> Point:
    """Return the point at a distance from the start of a stretch."""
    length = max(abs(end[0] - start[0]) + abs(end[1] - start[1]), 1e-9)  # stretches at nodes are straight
    along = distance / length
    return start[0] + along * (end[0] - start[0]), start[1] + along * (end[1] - start[1])


def stroke_of(link: Link, route: Sequence[Point]) -> Segment | None:
    """Return the causal stroke of a bond, across it at one of its ends."""
    if not link.stroke:
        return None
    end, inner = (route[-1], route[-2]) if link.stroke == "head" else (route[0], route[1])
    x, y = towards(end, inner, STROKE)
    across = (0.0, HALF) if end[1] == inner[1] else (HALF, 0.0)
    return (x - across[0], y - across[1]), (x + across[0], y + across[1])


def barb_of(link: Link, route: Sequence[Point]) -> Segment | None:
    """Return the half arrow of a bond at its head, on the right of the way there."""
    if link.equation_only:
        return None
    at = _tip(link)
    tip, (x, y) = towards(route[-1], route[-2], at), towards(route[-1], route[-2], at + BARB)
    ahead = (route[-1][0] - route[-2][0], route[-1][1] - route[-2][1])
    right = (-_sign(ahead[1]), _sign(ahead[0]))
    return tip, (x + WING * right[0], y + WING * right[1])


def line_of(link: Link, route: Sequence[Point]) -> list[Point]:
    """Return the line of a bond: it keeps clear of the nodes, and ends in the tip of its arrow."""
    return [towards(route[0], route[1], START), *route[1:-1], towards(route[-1], route[-2], _tip(link))]


def _tip(link: Link) -> float:
    return BEYOND if link.stroke == "head" else START


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
