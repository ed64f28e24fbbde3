"""Structures as their scenes describe them: geometry for drawings, and what is attached to the DOFs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from dynid.report.labels import short
from dynid.report.scenes import listed, readable
from dynid.report.svg import Point
from dynid.scene.schema.dof_labels import beam_labels, frame_labels

if TYPE_CHECKING:
    from dynid.report.scenes import PlainScene

Label = int | str


@dataclass(frozen=True)
class StructureGeometry:
    """Geometry of a structure: a chain of masses, a beam or a plane frame.

    Parameters
    ----------
    points
        Coordinates of every node, m, y upwards; of the masses of a chain only their order.
    labels
        Labels of the DOFs.
    masses
        Masses of a chain, kg; empty for a beam or frame.
    members
        Nodes along every member; empty for a chain.
    supports
        Fixed directions, by node.
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
        """Width and height, m."""
        xs, ys = zip(*self.points.values(), strict=True)
        return max(xs) - min(xs), max(ys) - min(ys)


def geometry_of(scene: PlainScene) -> StructureGeometry | None:
    """Return the geometry of the structure of a scene; None where only matrices are given.

    Raises
    ------
    UsageError
        Where the scene cannot be read.
    """
    with readable():
        structure = scene.data["structure"]
        if (chain := structure.get("lumped")) is not None:
            masses = [scene.number(mass) for mass in chain["masses"]]
            numbers = range(1, len(masses) + 1)
            return StructureGeometry({n: (float(n), 0.0) for n in numbers}, list(numbers), masses)
        for kind in ("beam", "frame"):
            if (part := structure.get(kind)) is None:
                continue
            supports: dict[int, tuple[str, ...]] = {}
            for support in listed(part.get("supports")):
                supports[support["node"]] = (*supports.get(support["node"], ()), *support["fix"])
            points, members, labels = (_beam if kind == "beam" else _frame)(scene, part, supports)
            carrying = [mass["node"] for mass in listed(part.get("masses"))]
            return StructureGeometry(points, labels, (), members, supports, carrying)
    return None


_Geometry = tuple[dict[int, Point], list[list[int]], Sequence[Label]]


def _beam(scene: PlainScene, part: dict[str, Any], supports: Mapping[int, Sequence[str]]) -> _Geometry:
    """Return points, the one member, and labels of a beam."""
    given, count = part["length"], part["elements"]
    lengths = map(scene.number, given) if isinstance(given, list) else [scene.number(given) / count] * count
    points = {node: (place, 0.0) for node, place in enumerate(accumulate(lengths, initial=0.0), 1)}
    held = ((along, node) for node, fixed in supports.items() for along in fixed)
    return points, [list(points)], beam_labels(count, held)


def _frame(scene: PlainScene, part: dict[str, Any], supports: Mapping[int, Sequence[str]]) -> _Geometry:
    """Return points, members and labels of a frame; inner nodes of members follow the given ones."""
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
    held = ((along, node) for node, fixed in supports.items() for along in fixed)
    ends = ((m["nodes"], m.get("hinges", ()), m.get("elements", 1)) for m in part["members"])
    turning = {mass["node"] for mass in listed(part.get("masses")) if scene.number(mass.get("J") or 0)}
    turning |= {spring["node"] for spring in listed(part.get("springs")) if spring["direction"] == "theta"}
    return points, members, frame_labels(given, ends, held, turning)


@dataclass(frozen=True)
class SpringDamper:
    """A spring, a damper, or both, between DOFs or from one DOF to ground.

    Parameters
    ----------
    dofs
        Labels of its DOFs.
    texts
        Its name if it is a joint, and its values.
    stiff, damped
        True if it has a spring, a damper.
    joint
        True if it is a joint, which is highlighted.
    """

    dofs: tuple[Label, ...]
    texts: tuple[str, ...]
    stiff: bool
    damped: bool
    joint: bool

    @property
    def text_class(self) -> str:
        """Class of its texts in a drawing."""
        return "small marked" if self.joint else "small"


@dataclass(frozen=True)
class Attachments:
    """Attachments of a structure; forces, sensors and masters by the labels of their DOFs."""

    springs: tuple[SpringDamper, ...]
    forces: tuple[Label, ...]
    sensors: tuple[tuple[Label, str], ...]
    masters: tuple[Label, ...]


def attachments_of(scene: PlainScene, labels: Sequence[Label]) -> Attachments:
    """Return the attachments of the structure of a scene.

    Parameters
    ----------
    scene
        The scene.
    labels
        The labels of the structure's DOFs, in their order.

    Raises
    ------
    UsageError
        Where the scene cannot be read.
    """

    def named(dof: Label) -> Label:
        return labels[dof - 1] if isinstance(dof, int) and 0 < dof <= len(labels) else dof

    with readable():
        data = scene.data
        driven = [signal["dof"] for signal in listed(data.get("excitation")) if "dof" in signal]
        driven += listed(data.get("inputs"))
        given = [reduction.get("masters") for reduction in listed(data.get("reduction"))]
        masters = [dof for dofs in given if isinstance(dofs, list) for dof in dofs]
        measurement = data.get("measurement") or {}
        shared = listed(measurement.get("channels"))
        sensors = [
            (named(dof), channel.get("quantity", "displacement"))
            for record in listed(measurement.get("records")) or [{}]
            for channel in [*(listed(record.get("channels")) or shared), *listed(data.get("outputs"))]
            for dof in channel.get("dofs") or [channel["dof"]]
        ]
        return Attachments(
            tuple(replace(s, dofs=tuple(map(named, s.dofs))) for s in _springs(scene)),
            tuple(dict.fromkeys(map(named, driven))),
            tuple(dict.fromkeys(sensors)),
            tuple(dict.fromkeys(map(named, masters))),
        )


def _springs(scene: PlainScene) -> Iterator[SpringDamper]:
    """Yield links, springs to ground, then joints."""
    structure = scene.data["structure"]
    for link in listed((structure.get("lumped") or {}).get("links")):
        yield _spring(scene, link, link["dofs"])
    for kind in ("beam", "frame"):
        for item in listed((structure.get(kind) or {}).get("springs")):
            yield _spring(scene, item, [f"{item['direction']}_{item['node']}"])
    for name, joint in (scene.data.get("joints") or {}).items():
        yield _spring(scene, joint, joint["dofs"], str(name))


def _spring(scene: PlainScene, tie: dict[str, Any], dofs: Sequence[Label], joint: str = "") -> SpringDamper:
    """Return a spring and damper, with its values where they are single numbers and known."""
    letters = [letter for letter in "kc" if tie.get(letter) is not None]
    texts = [joint] if joint else []
    for letter in letters:
        value = tie[letter]
        if isinstance(value, dict) and value.get("start") is not None:
            texts.append(f"{letter} = ?" if value.get("matrix") is None else f"{letter} = ? × matrix")
            continue
        value = value.get("value") if isinstance(value, dict) else value
        bare = value is None or isinstance(value, list)
        texts.append(letter if bare else f"{letter} = {short(scene.number(value))}")
    return SpringDamper(tuple(dofs), tuple(texts), "k" in letters, "c" in letters, bool(joint))
