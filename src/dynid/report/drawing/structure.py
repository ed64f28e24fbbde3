"""The structure of a result as a schematic: masses, beams and frames with all that is fixed to them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from dynid.report.drawing.beams import draw_members
from dynid.report.drawing.lumped import draw_lumped
from dynid.report.drawing.mounting import Mounted, mounted_on
from dynid.report.drawing.shape import Shape, shape_of
from dynid.report.figure import Figure, Picture, Table
from dynid.report.scenes import scene_of
from dynid.report.svg import Point, Svg

if TYPE_CHECKING:
    from dynid.result import Result

#: Most masses in a row, and most nodes, that are drawn.
MASSES, NODES = 40, 2000


def figures(result: Result) -> Iterator[Figure]:
    """Yield the schematic of a result's structure, where the scene tells its shape."""
    scene = scene_of(result)
    shape = shape_of(scene)
    if shape is not None and len(shape.points) <= (MASSES if shape.masses else NODES):
        mounted = mounted_on(scene, shape.labels)
        yield Figure("structure", "Structure", lambda: _picture(result.title, shape, mounted))


def _picture(title: str, shape: Shape, mounted: Mounted) -> Picture:
    svg = Svg("structure", f"Structure of {title}", _about(mounted))
    if shape.masses:
        text = draw_lumped(svg, shape.masses, mounted)
    else:
        text = draw_members(svg, _placed(shape), shape.members, shape.supports, shape.carrying, mounted)
    rows = [
        (", ".join(map(str, f.dofs)), "joint" if f.joint else "link", ", ".join(f.texts))
        for f in mounted.fastenings
    ]
    rows += [(str(label), "force", "") for label in mounted.forces]
    rows += [(str(label), "sensor", quantity) for label, quantity in mounted.sensors]
    rows += [(str(label), "master", "") for label in mounted.masters]
    return Picture(text, _about(mounted), Table(("DOF", "what", "value"), tuple(rows)))


def _about(mounted: Mounted) -> str:
    """Say what the schematic shows."""
    joints = sum(fastening.joint for fastening in mounted.fastenings)
    parts = [
        f"{count} {what}{'s' * (count != 1)}"
        for count, what in (
            (joints, "joint"),
            (len(mounted.forces), "force"),
            (len(mounted.sensors), "sensor"),
            (len(mounted.masters), "master"),
        )
        if count
    ]
    return f"The structure with {', '.join(parts)}." if parts else "The structure."


def _placed(shape: Shape) -> dict[int, Point]:
    """Place the nodes on paper, px: a beam as long as its elements need, a frame within a square."""
    width, height = shape.extent
    beam = not height and len(shape.members) == 1
    paper = min(max(90.0 * (len(shape.points) - 1), 480.0), 1100.0) if beam else 640.0
    scale = paper / max(width, height, 1e-12)
    left, top = min(x for x, _ in shape.points.values()), max(y for _, y in shape.points.values())
    return {node: (scale * (x - left), scale * (top - y)) for node, (x, y) in shape.points.items()}
