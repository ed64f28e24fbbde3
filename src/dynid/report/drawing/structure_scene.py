"""Structures as their scenes describe them: geometry for drawings, and what is attached to the DOFs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from dynid.number_format import unit_text
from dynid.report.notation import short
from dynid.report.svg import Point
from dynid.scene.schema.joints import ParameterModel
from dynid.structure.joints import unit_of
from dynid.structure.labels import DofNames, kind

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.quantities import Quantity
    from dynid.scene.schema.reduction import ReductionScene
    from dynid.scene.schema.structure import FrameModel

Label = int | str


@dataclass(frozen=True)
class StructureGeometry:
    """Geometry of a structure: a chain of masses, a beam or a plane frame.

    Points are in m, y upwards; of a chain, whose masses are texts, they have the order only. Members are the
    nodes along them; supports the fixed directions by node; `carrying` the nodes with a point mass.
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


def geometry_of(scene: Scene) -> StructureGeometry | None:
    """Return the geometry of the structure of a scene.

    None of several parts, of named points, of matrices, solids or frames in three dimensions.
    """
    structure = getattr(scene.model, "structure", None)
    if structure is None or getattr(scene.model, "points", None):
        return None
    if (chain := structure.lumped) is not None:
        masses = [_value_text(scene, mass) for mass in chain.masses]
        masses = [text if text.endswith("?") else f"{text} kg" for text in masses]
        labels = chain.labels()
        return StructureGeometry({n: (float(n), 0.0) for n in labels}, labels, masses)
    members_model = structure.beam or structure.frame
    if members_model is None:
        return None
    supports: dict[int, tuple[str, ...]] = {}
    for support in members_model.supports:
        supports[support.node] = (*supports.get(support.node, ()), *support.fix)
    if structure.beam is not None:
        size, count = members_model.length, members_model.elements
        steps = map(float, size) if isinstance(size, list) else [float(size) / count] * count
        points = {node: (x, 0.0) for node, x in enumerate(accumulate(steps, initial=0.0), 1)}
        members = [list(points)]
    else:
        points, members = _frame(members_model)
    carrying = [mass.node for mass in members_model.masses]
    return StructureGeometry(points, members_model.labels(), (), members, supports, carrying)


def _frame(frame: FrameModel) -> tuple[dict[int, Point], list[list[int]]]:
    """Return points and members of a frame; inner nodes of members follow the others."""
    points = {n: (float(x), float(y)) for n, (x, y) in enumerate(frame.nodes, 1)}
    members = []
    for member in frame.members:
        (start, end), count = member.nodes, member.elements
        (x, y), (x2, y2) = points[start], points[end]
        inner = range(len(points) + 1, len(points) + count)
        for step, node in enumerate(inner, 1):
            share = step / count
            points[node] = (x + share * (x2 - x), y + share * (y2 - y))
        members.append([start, *inner, end])
    return points, members


@dataclass(frozen=True)
class SpringDamper:
    """A spring, a damper, or both, between DOFs or from one DOF to ground; a joint is highlighted.

    Its texts are the name of a joint, and its values.
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


def attachments_of(
    scene: Scene, labels: Sequence[Label], estimates: Mapping[str, float] | None = None
) -> Attachments:
    """Return the attachments of the structure of a scene, whose DOFs have these labels.

    Unknown values are those of the `estimates`, by name, or a question mark.
    """
    model, names = scene.model, DofNames(labels)
    structure = model.structure

    def named(dof: Label) -> Label:
        return labels[dof - 1] if isinstance(dof, int) and 0 < dof <= len(labels) else names.display_name(dof)

    def tied(tie: Any, dofs: Sequence[Label], joint: str = "") -> SpringDamper:
        ends = tuple(map(named, dofs))
        kinds = {"translation"} if structure.lumped is not None else set(map(kind, ends))
        return _spring(scene, tie, ends, kinds, joint, estimates or {})

    ties = [tied(link, link.dofs) for link in (structure.lumped.links if structure.lumped else ())]
    for sprung in filter(None, (structure.beam, structure.frame)):
        ties += [tied(spring, [f"{spring.direction}_{spring.node}"]) for spring in sprung.springs]
    ties += [tied(joint, joint.dofs, name) for name, joint in model.joints.items()]
    driven = [signal.dof for signal in getattr(model, "excitation", ()) if signal.dof is not None]
    driven += getattr(model, "inputs", None) or ()
    reductions = model.reduction if isinstance(model.reduction, list) else [model.reduction]
    bases = (getattr(reduction, "masters", None) for reduction in reductions)
    masters = [dof for dofs in bases if isinstance(dofs, list) for dof in dofs]
    return Attachments(
        tuple(ties),
        tuple(dict.fromkeys(map(named, driven))),
        tuple(dict.fromkeys((named(dof), quantity) for dof, quantity in _sensors(model))),
        tuple(dict.fromkeys(map(named, masters))),
    )


def _sensors(model: IdentificationScene | ReductionScene) -> Iterator[tuple[Label, str]]:
    """Yield DOF and quantity of the channels of all records, and of outputs of a comparison."""
    measurement = getattr(model, "measurement", None)
    records = measurement.each if measurement is not None else ()
    channels = [channel for record in records for channel in record.channels or ()]
    for channel in [*channels, *(getattr(model, "outputs", None) or ())]:
        for dof in channel.dofs or [channel.dof]:
            yield dof, channel.quantity or "displacement"


def _value_text(scene: Scene, quantity: Quantity) -> str:
    """Return the value of a quantity; of one that is to be estimated its name or expression, with a mark."""
    if quantity.expression is not None and _unknown(scene, quantity):
        return f"{quantity.expression.text} = ?"
    return short(float(quantity))


def _unknown(scene: Scene, quantity: Quantity) -> bool:
    """Return True for a quantity that depends on a parameter which is to be estimated."""
    names = quantity.dependent.names if quantity.dependent is not None else ()
    return any(getattr(scene.model.parameters.get(name), "start", None) is not None for name in names)


def _spring(
    scene: Scene,
    tie: Any,
    dofs: tuple[Label, ...],
    kinds: Collection[str],
    joint: str,
    estimates: Mapping[str, float],
) -> SpringDamper:
    """Return a spring and damper between DOFs of these kinds, with known single values and kinds of laws."""
    values = {letter: value for letter in "kc" if (value := getattr(tie, letter)) is not None}
    texts = [joint] if joint else []
    for letter, value in values.items():
        parameter = isinstance(value, ParameterModel)
        expression = getattr(value.value if parameter else value, "expression", None)
        name = expression.text if expression is not None else f"{joint}.{letter}"
        if name in estimates:
            texts.append(f"{letter} ≈ {short(estimates[name])} {unit_text(unit_of(letter, kinds))}".rstrip())
        elif parameter and value.start is not None:
            texts.append(f"{letter} = ?" if value.matrix is None else f"{letter} = ? × matrix")
        elif (quantity := value.value if parameter else value) is None:
            texts.append(letter)
        else:
            unit = "" if _unknown(scene, quantity) else unit_text(unit_of(letter, kinds))
            texts.append(f"{letter} = {_value_text(scene, quantity)} {unit}".rstrip())
    texts += [law.kind for law in getattr(tie, "laws", None) or ()]
    alone = not values  # a joint of laws alone is drawn as a spring
    return SpringDamper(dofs, tuple(texts), "k" in values or alone, "c" in values, bool(joint))
