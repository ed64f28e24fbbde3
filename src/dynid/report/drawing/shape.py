"""The shape of a structure as its scene gives it: masses in a row, or members between nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from dynid.report.scenes import listed, readable
from dynid.report.svg import Point
from dynid.scene.schema.freedoms import beam_labels, frame_labels

if TYPE_CHECKING:
    from dynid.report.scenes import PlainScene

Label = int | str


@dataclass(frozen=True)
class Shape:
    """Where a structure is.

    Parameters
    ----------
    points
        The place of every node, m, y up; of the masses of a chain only their order.
    labels
        The labels of its DOFs.
    masses
        The masses of a chain; none of a beam or frame.
    members
        The nodes along every member; none of a chain.
    supports
        The directions that are held, by node.
    carrying
        Nodes with a point mass.
    """

    points: Mapping[int, Point]
    labels: Sequence[Label]
    masses: Sequence[float] = ()
    members: Sequence[Sequence[int]] = ()
    supports: Mapping[int, Sequence[str]] = field(default_factory=dict)
    carrying: Sequence[int] = ()

    @property
    def extent(self) -> tuple[float, float]:
        """Its width and height, m."""
        xs, ys = zip(*self.points.values(), strict=True)
        return max(xs) - min(xs), max(ys) - min(ys)


def shape_of(scene: PlainScene) -> Shape | None:
    """Return the shape of the structure of a scene; None where only matrices are given.

    Raises
    ------
    UsageError
        Where the scene cannot be read.
    """
    with readable():
        structure = scene.data["structure"]
        for kind, read in (("lumped", _chain), ("beam", _beam), ("frame", _frame)):
            if structure.get(kind) is not None:
                return read(scene, structure[kind])
    return None


def _chain(scene: PlainScene, part: dict[str, Any]) -> Shape:
    masses = [scene.number(mass) for mass in part["masses"]]
    numbers = range(1, len(masses) + 1)
    return Shape({n: (float(n), 0.0) for n in numbers}, list(numbers), masses)


def _beam(scene: PlainScene, part: dict[str, Any]) -> Shape:
    given, count = part["length"], part["elements"]
    lengths = map(scene.number, given) if isinstance(given, list) else [scene.number(given) / count] * count
    points = {node: (place, 0.0) for node, place in enumerate(accumulate(lengths, initial=0.0), 1)}
    supports = _supports(part)
    held = ((along, node) for node, fixed in supports.items() for along in fixed)
    labels = beam_labels(count, held)
    return Shape(points, labels, (), [list(points)], supports, _carrying(part))


def _frame(scene: PlainScene, part: dict[str, Any]) -> Shape:
    """Place the nodes of a frame, inner nodes of members after the given ones."""
    points = {n: (scene.number(x), scene.number(y)) for n, (x, y) in enumerate(part["nodes"], 1)}
    given, members = len(points), []
    for member in part["members"]:
        (start, end), count = member["nodes"], member.get("elements", 1)
        (x, y), (x2, y2) = points[start], points[end]
        inner = range(len(points) + 1, len(points) + count)
        for step, node in enumerate(inner, 1):
            share = step / count
            points[node] = (x + share * (x2 - x), y + share * (y2 - y))
        members.append([start, *inner, end])
    supports = _supports(part)
    held = ((along, node) for node, fixed in supports.items() for along in fixed)
    ends = ((m["nodes"], m.get("hinges", ()), m.get("elements", 1)) for m in part["members"])
    turning = {mass["node"] for mass in listed(part.get("masses")) if scene.number(mass.get("J") or 0)}
    turning |= {spring["node"] for spring in listed(part.get("springs")) if spring["direction"] == "theta"}
    labels = frame_labels(given, ends, held, turning)
    return Shape(points, labels, (), members, supports, _carrying(part))


def _supports(part: dict[str, Any]) -> dict[int, tuple[str, ...]]:
    found: dict[int, tuple[str, ...]] = {}
    for support in listed(part.get("supports")):
        found[support["node"]] = (*found.get(support["node"], ()), *support["fix"])
    return found


def _carrying(part: dict[str, Any]) -> list[int]:
    return [mass["node"] for mass in listed(part.get("masses"))]
