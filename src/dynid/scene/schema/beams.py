"""Beams and frames of a scene, what they carry, and their damping."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from dynid.scene.schema.common import Part
from dynid.scene.schema.freedoms import Freedom, beam_labels, frame_labels
from dynid.scene.schema.quantities import NotNegative, Positive, Value, fault

#: The most elements and nodes that a scene may ask for.
MOST_ELEMENTS = 100_000

Count = Annotated[int, Field(ge=1, strict=True)]
Path = tuple[Any, ...]


def _one_or_each(raw: Any) -> str:
    return "each" if isinstance(raw, list) else "one"


PerElement = Annotated[
    Annotated[Positive, Tag("one")] | Annotated[list[Positive], Tag("each")], Discriminator(_one_or_each)
]
PerElementOrZero = Annotated[
    Annotated[NotNegative, Tag("one")] | Annotated[list[NotNegative], Tag("each")],
    Discriminator(_one_or_each),
]


class DampingModel(Part):
    """Damping from mass and stiffness (alpha, beta), or damping ratios of the modes."""

    alpha: NotNegative | None = None
    beta: NotNegative | None = None
    ratio: PerElementOrZero | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        proportional = self.alpha is not None or self.beta is not None
        if proportional == (self.ratio is not None):
            raise fault("damping is either proportional ('alpha', 'beta') or modal ('ratio')")
        return self


class PointMassModel(Part):
    """A mass at a node."""

    node: Count
    m: NotNegative | None = None
    J: NotNegative | None = None

    @model_validator(mode="after")
    def _has_something(self) -> Self:
        if self.m is None and self.J is None:
            raise fault("a mass has its 'm', a rotary inertia 'J', or both")
        return self


class BeamSupport(Part):
    """What a node of a beam cannot do."""

    node: Count
    fix: list[Literal["w", "theta"]] = Field(min_length=1)


class FrameSupport(Part):
    """What a node of a frame cannot do."""

    node: Count
    fix: list[Literal["u", "w", "theta"]] = Field(min_length=1)


class _Spring(Part):
    node: Count
    k: NotNegative | None = None
    c: NotNegative | None = None

    @model_validator(mode="after")
    def _has_something(self) -> Self:
        if self.k is None and self.c is None:
            raise fault("a spring has a stiffness 'k', a damping 'c', or both")
        return self


class BeamSpring(_Spring):
    """A spring and damper from a node of a beam to ground."""

    direction: Literal["w", "theta"]


class FrameSpring(_Spring):
    """A spring and damper from a node of a frame to ground."""

    direction: Literal["u", "w", "theta"]


class BeamModel(Part):
    """An Euler–Bernoulli beam of elements in a row; nodes count from 1."""

    elements: int = Field(ge=1, le=MOST_ELEMENTS, strict=True)
    length: PerElement
    EI: PerElement
    rhoA: PerElementOrZero
    supports: list[BeamSupport] = []
    masses: list[PointMassModel] = []
    springs: list[BeamSpring] = []
    damping: DampingModel | None = None

    @field_validator("length", "EI", "rhoA")
    @classmethod
    def _one_each(cls, given: Any, info: ValidationInfo) -> Any:
        count = info.data.get("elements")
        if isinstance(given, list) and count is not None and len(given) != count:
            raise fault(f"'{info.field_name}' has {len(given)} entries for {count} elements")
        return given

    def labels(self) -> list[int | str]:
        """Return the labels of the free degrees of freedom."""
        return beam_labels(self.elements, _held(self.supports))

    def faults(self) -> Iterable[tuple[Path, str]]:
        """Yield what is wrong with nodes, each with its place in the beam."""
        yield from _node_faults(self, self.elements + 1)


class MemberModel(Part):
    """A straight member of a frame between two nodes."""

    nodes: list[Count] = Field(min_length=2, max_length=2)
    EA: Positive
    EI: Positive
    rhoA: NotNegative
    elements: int = Field(default=1, ge=1, le=MOST_ELEMENTS, strict=True)
    hinges: list[Literal[1, 2]] = []


class FrameModel(Part):
    """A plane frame: nodes by their coordinates, members between them."""

    nodes: list[Annotated[list[Value], Field(min_length=2, max_length=2)]] = Field(
        min_length=2, max_length=MOST_ELEMENTS
    )
    members: list[MemberModel] = Field(min_length=1, max_length=MOST_ELEMENTS)
    supports: list[FrameSupport] = []
    masses: list[PointMassModel] = []
    springs: list[FrameSpring] = []
    damping: DampingModel | None = None

    @model_validator(mode="after")
    def _is_bounded(self) -> Self:
        if sum(member.elements for member in self.members) > MOST_ELEMENTS:
            raise fault(f"the members have more than {MOST_ELEMENTS:,} elements together")
        return self

    def labels(self) -> list[int | str]:
        """Return the labels of the free degrees of freedom, those at nodes within members last."""
        members = ((member.nodes, member.hinges, member.elements) for member in self.members)
        turning = {mass.node for mass in self.masses if mass.J and float(mass.J)}
        turning |= {spring.node for spring in self.springs if spring.direction == "theta"}
        return frame_labels(len(self.nodes), members, _held(self.supports), turning)

    def faults(self) -> Iterable[tuple[Path, str]]:
        """Yield what is wrong with nodes, each with its place in the frame."""
        count = len(self.nodes)
        for place, member in enumerate(self.members):
            for end, node in enumerate(member.nodes):
                if node > count:
                    yield ("members", place, "nodes", end), _no_node(node, count)
            if member.nodes[0] == member.nodes[1]:
                yield ("members", place, "nodes"), f"both ends are node {member.nodes[0]}"
        reached = {node for member in self.members for node in member.nodes}
        for node in range(1, count + 1):
            if node not in reached:
                yield ("nodes", node - 1), f"node {node} belongs to no member"
        yield from _node_faults(self, count)


def _held(supports: Iterable[BeamSupport | FrameSupport]) -> Iterable[Freedom]:
    return ((along, support.node) for support in supports for along in support.fix)


def _node_faults(holder: BeamModel | FrameModel, count: int) -> Iterable[tuple[Path, str]]:
    for key in ("supports", "masses", "springs"):
        for place, item in enumerate(getattr(holder, key)):
            if item.node > count:
                yield (key, place, "node"), _no_node(item.node, count)
    if not holder.labels():
        yield ("supports",), "the supports leave nothing to move"


def _no_node(node: int, count: int) -> str:
    return f"there is no node {node}; there are {count}"
