"""Structures as their scenes describe them: geometry for drawings, and what is attached to the DOFs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from dynid.number_format import unit_text
from dynid.report.notation import short
from dynid.report.scenes import listed, readable
from dynid.report.svg import Point
from dynid.scene.schema.references import beam_labels, frame_labels
from dynid.structure.joints import unit_of
from dynid.structure.labels import DofNames, kind

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
        Own labels of the DOFs.
    masses
        Masses of a chain as text; empty for a beam or frame.
    members
        Nodes along every member; empty for a chain.
    supports
        Fixed directions, by node.
    carrying
        Nodes with a point mass.
    """

    points: Mapping[int, Point]
    labels: Sequence[Label]
    masses: Sequence[str] = ()
    members: Sequence[Sequence[int]] = ()
    supports: Mapping[int, Sequence[str]] = field(default_factory=dict)
    carrying: Sequence[int] = ()

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height, m."""
        xs, ys = zip(*self.points.values(), strict=True)
        return max(xs) - min(xs), max(ys) - min(ys)


def geometry_of(scene: PlainScene) -> StructureGeometry | None:
    """Return the geometry of the structure of a scene; None of several parts, or of matrices alone.

    Raises
    ------
    UsageError
        Where the scene cannot be read.
    """
    if "structure" not in scene.data:  # several parts
        return None
    with readable():
        structure = scene.data["structure"]
        if (chain := structure.get("lumped")) is not None:
            masses = [_value_text(scene, mass) for mass in chain["masses"]]
            masses = [text if text.endswith("?") else f"{text} kg" for text in masses]
            numbers = range(1, len(masses) + 1)
            return StructureGeometry({n: (float(n), 0.0) for n in numbers}, list(numbers), masses)
        for kind in ("beam", "frame"):
            if (part := structure.get(kind)) is None:
                continue
            supports: dict[int, tuple[str, ...]] = {}
            for support in listed(part.get("supports")):
                supports[support["node"]] = (*supports.get(support["node"], ()), *support["fix"])
            held = [(along, node) for node, fixed in supports.items() for along in fixed]
            if kind == "beam":
                size, count = part["length"], part["elements"]
                per_element = isinstance(size, list)
                steps = map(scene.number, size) if per_element else [scene.number(size) / count] * count
                ends = accumulate(steps, initial=0.0)
                points = {node: (x, 0.0) for node, x in enumerate(ends, 1)}
                members, labels = [list(points)], list[Label](beam_labels(count, held))
            else:
                points, members, labels = _frame(scene, part, held)
            carrying = [mass["node"] for mass in listed(part.get("masses"))]
            return StructureGeometry(points, labels, (), members, supports, carrying)
    return None


_Geometry = tuple[dict[int, Point], list[list[int]], list[Label]]


def _frame(scene: PlainScene, part: dict[str, Any], held: Iterable[tuple[str, int]]) -> _Geometry:
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
    ends = ((m["nodes"], m.get("hinges", ()), m.get("elements", 1)) for m in part["members"])
    turning = {mass["node"] for mass in listed(part.get("masses")) if scene.number(mass.get("J") or 0)}
    turning |= {spring["node"] for spring in listed(part.get("springs")) if spring["direction"] == "theta"}
    return points, members, list(frame_labels(given, ends, held, turning))


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
    """Attachments of a structure by the names of their DOFs in results: labels, or ``4:-y`` with a sign."""

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
    names = DofNames(labels)

    def named(dof: Label) -> Label:
        return labels[dof - 1] if isinstance(dof, int) and 0 < dof <= len(labels) else names.shown(dof)

    def tied(tie: dict[str, Any], dofs: Sequence[Label], joint: str = "") -> SpringDamper:
        own = tuple(map(named, dofs))
        return _spring(scene, tie, own, {"translation"} if masses else set(map(kind, own)), joint)

    with readable():
        data = scene.data
        masses = "lumped" in data["structure"]
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
            if isinstance(channel, dict)  # else those of a file
            for dof in channel.get("dofs") or [channel["dof"]]
        ]
        # Links, springs to ground, then joints.
        structure = data["structure"]
        ties = [tied(link, link["dofs"]) for link in listed((structure.get("lumped") or {}).get("links"))]
        for part in ("beam", "frame"):
            for item in listed((structure.get(part) or {}).get("springs")):
                ties.append(tied(item, [f"{item['direction']}_{item['node']}"]))
        for name, joint in (data.get("joints") or {}).items():
            ties.append(tied(joint, joint["dofs"], str(name)))
        return Attachments(
            tuple(ties),
            tuple(dict.fromkeys(map(named, driven))),
            tuple(dict.fromkeys(sensors)),
            tuple(dict.fromkeys(map(named, masters))),
        )


def _value_text(scene: PlainScene, raw: Any) -> str:
    """Return the value of a quantity; of one that is to be estimated its name or expression, with a mark."""
    return f"{raw} = ?" if scene.unknown(raw) else short(scene.number(raw))


def _spring(
    scene: PlainScene, tie: dict[str, Any], dofs: tuple[Label, ...], kinds: Collection[str], joint: str
) -> SpringDamper:
    """Return a spring and damper between DOFs of these kinds, with values that are known single numbers."""
    letters = [letter for letter in "kc" if tie.get(letter) is not None]
    texts = [joint] if joint else []
    for letter in letters:
        value = tie[letter]
        if isinstance(value, dict) and value.get("start") is not None:
            texts.append(f"{letter} = ?" if value.get("matrix") is None else f"{letter} = ? × matrix")
            continue
        value = value.get("value") if isinstance(value, dict) else value
        bare = value is None or isinstance(value, list)
        unit = "" if bare or scene.unknown(value) else unit_text(unit_of(letter, kinds))
        texts.append(letter if bare else f"{letter} = {_value_text(scene, value)} {unit}".rstrip())
    return SpringDamper(dofs, tuple(texts), "k" in letters, "c" in letters, bool(joint))
