"""The structure of a result as a schematic: masses, beams and frames with all that is fixed to them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from dynid.report.drawing.beams import draw_members
from dynid.report.drawing.lumped import draw_lumped
from dynid.report.drawing.mounting import Mounted, mounted_on
from dynid.report.drawing.scenes import scene_of
from dynid.report.figure import Figure, Picture, Table
from dynid.report.svg import Point, Svg

if TYPE_CHECKING:
    from dynid.result import Result

#: Most masses in a row, and most nodes, that are drawn.
MASSES, NODES = 40, 2000


def figures(result: Result) -> Iterator[Figure]:
    """Yield the schematic of a result's structure, where the scene tells its shape."""
    model: Any = scene_of(result).model
    structure = model.structure
    if structure.lumped is not None:
        drawable = len(structure.lumped.masses) <= MASSES
    elif structure.beam is not None:
        drawable = structure.beam.elements < NODES
    else:
        members = structure.frame.members if structure.frame is not None else ()
        drawable = 0 < sum(member.elements for member in members) < NODES
    if drawable:
        yield Figure("structure", "Structure", lambda: _picture(result.title, model))


def _picture(title: str, model: Any) -> Picture:
    mounted, structure = mounted_on(model), model.structure
    svg = Svg("structure", f"Structure of {title}", _about(mounted))
    if structure.lumped is not None:
        text = draw_lumped(svg, [float(mass) for mass in structure.lumped.masses], mounted)
    else:
        part = structure.beam or structure.frame
        points, members = beam_places(part) if structure.beam is not None else frame_places(part)
        supports = {support.node: tuple(support.fix) for support in part.supports}
        text = draw_members(svg, points, members, supports, [mass.node for mass in part.masses], mounted)
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


def beam_places(part: Any) -> tuple[dict[int, Point], list[list[int]]]:
    """Place the nodes of a beam from left to right."""
    given = part.length
    lengths = (
        [float(x) for x in given]
        if isinstance(given, list)
        else [float(given) / part.elements] * part.elements
    )
    width = min(max(90.0 * part.elements, 480.0), 1100.0)
    total = sum(lengths)
    places = [0.0, *accumulate(lengths)]
    points = {node: (width * place / total, 0.0) for node, place in enumerate(places, 1)}
    return points, [list(points)]


def frame_places(part: Any) -> tuple[dict[int, Point], list[list[int]]]:
    """Place the nodes of a frame by their coordinates, inner nodes of members after the given ones."""
    given = [(float(x), float(y)) for x, y in part.nodes]
    (left, right), (low, high) = ((min(axis), max(axis)) for axis in zip(*given, strict=True))
    scale = 640.0 / max(right - left, high - low, 1e-12)
    points = {n: (scale * (x - left), scale * (high - y)) for n, (x, y) in enumerate(given, 1)}
    members = []
    for member in part.members:
        a, b = (points[node] for node in member.nodes)
        inner = []
        for step in range(1, member.elements):
            share = step / member.elements
            inner.append(len(points) + 1)
            points[inner[-1]] = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        members.append([member.nodes[0], *inner, member.nodes[1]])
    return points, members
