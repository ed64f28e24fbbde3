"""Symbols of schematics: springs, dampers, ground, supports, forces, sensors and masters."""

from __future__ import annotations

from dynid.report.svg import Point, Svg

_WIND, _TURNS = 6.0, 5


def spring(svg: Svg, start: Point, end: Point, cls: str = "line") -> None:
    """Draw a spring between two points."""
    points = [_offset(start, end, 0, 0), _offset(start, end, 0.2, 0)]
    for turn in range(2 * _TURNS):
        side = _WIND if turn % 2 else -_WIND
        points.append(_offset(start, end, 0.2 + 0.6 * (turn + 0.5) / (2 * _TURNS), side))
    svg.line(*points, _offset(start, end, 0.8, 0), _offset(start, end, 1, 0), cls=cls)


def damper(svg: Svg, start: Point, end: Point, cls: str = "line") -> None:
    """Draw a dashpot between two points."""
    cup = [(0.66, -_WIND), (0.38, -_WIND), (0.38, _WIND), (0.66, _WIND)]
    svg.line(_offset(start, end, 0, 0), _offset(start, end, 0.38, 0), cls=cls)
    svg.line(*(_offset(start, end, *place) for place in cup), cls=cls)
    svg.line(_offset(start, end, 0.54, -_WIND + 2), _offset(start, end, 0.54, _WIND - 2), cls=cls)
    svg.line(_offset(start, end, 0.54, 0), _offset(start, end, 1, 0), cls=cls)


def turning_spring(svg: Svg, x: float, y: float, cls: str = "line") -> None:
    """Draw a rotational spring around a point: a spiral down to ground."""
    svg.element(
        "path", cls, d=f"M{x:.1f} {y:.1f} m-2 0 a5 5 0 1 1 7 5 a11 11 0 1 1 7 -12 a17 17 0 0 1 -10 22"
    )


def ground(svg: Svg, at: Point, side: str) -> None:
    """Draw hatched ground to the `left`, to the `right` or `below` a point."""
    x, y = at
    reach = 16.0
    if side == "below":
        svg.line((x - reach, y), (x + reach, y), cls="line")
        for step in range(5):
            a = x - reach + 4 + 7 * step
            svg.line((a, y), (a - 5, y + 7), cls="hair")
        return
    out = -6.0 if side == "left" else 6.0
    svg.line((x, y - reach), (x, y + reach), cls="line")
    for step in range(5):
        b = y - reach + 2 + 7 * step
        svg.line((x, b), (x + out, b + 6), cls="hair")


def pin(svg: Svg, x: float, y: float) -> None:
    """Draw a pinned support under a point."""
    svg.polygon((x, y + 3), (x - 10, y + 19), (x + 10, y + 19), cls="line")
    ground(svg, (x, y + 19), "below")


def clamp(svg: Svg, x: float, y: float, side: str) -> None:
    """Draw a clamped end at a point, with the ground to its `left`, to its `right` or `below`."""
    ground(svg, (x, y), side)
    svg.rect(*((x - 16, y - 2, 32, 4) if side == "below" else (x - 2, y - 16, 4, 32)), "solid")


def guide(svg: Svg, x: float, y: float) -> None:
    """Draw a support that fixes the rotation only: two rails."""
    for out in (-5, 5):
        svg.line((x + out, y - 12), (x + out, y + 12), cls="line")


def force(svg: Svg, start: Point, end: Point) -> None:
    """Draw a force as an arrow."""
    svg.line(start, end, cls="bond s2")
    left, right = (_offset(end, start, 0, 0, along=9, across=across) for across in (4, -4))
    svg.polygon(end, left, right, cls="s2 dot")


def sensor(svg: Svg, x: float, y: float) -> None:
    """Draw a sensor: a triangle that points down at its node."""
    svg.polygon((x, y), (x - 6, y - 10), (x + 6, y - 10), cls="s3 dot")


def master(svg: Svg, x: float, y: float) -> None:
    """Draw the mark of a master DOF of a reduction."""
    svg.rect(x - 4, y - 4, 8, 8, "s1 dot")


def _offset(
    start: Point, end: Point, part: float, aside: float, *, along: float = 0.0, across: float = 0.0
) -> Point:
    """Return the point at a part of a line and an offset aside, or at px along and across it."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = max((dx * dx + dy * dy) ** 0.5, 1e-9)
    way, off = part * length + along, aside + across
    return start[0] + (dx * way - dy * off) / length, start[1] + (dy * way + dx * off) / length
