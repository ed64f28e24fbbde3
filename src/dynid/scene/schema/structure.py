"""Structures of a scene: lumped, beam, frame or imported matrices, and the joints between their DOFs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from dynid.scene.schema.common import Dof, Part
from dynid.scene.schema.quantities import NotNegative, Positive, Quantity, Value, fault

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


# --- lumped ----------------------------------------------------------------------------------------


class LinkModel(Part):
    """A spring and a damper between two DOFs, or from one DOF to ground."""

    dofs: list[Dof] = Field(min_length=1, max_length=2)
    k: NotNegative | None = None
    c: NotNegative | None = None

    @field_validator("dofs")
    @classmethod
    def _differ(cls, dofs: list[int | str]) -> list[int | str]:
        twice = next((dof for place, dof in enumerate(dofs) if dof in dofs[:place]), None)
        if twice is not None:
            raise fault(f"both ends are DOF {twice}" if len(dofs) == 2 else f"DOF {twice} is named twice")
        return dofs


class LumpedModel(Part):
    """Point masses, each with one degree of freedom, and the links between them."""

    masses: list[Positive] = Field(min_length=1, max_length=2000)
    links: list[LinkModel] = []

    def labels(self) -> list[int | str]:
        """Return the labels of the degrees of freedom."""
        return list(range(1, len(self.masses) + 1))


# --- beams and frames ------------------------------------------------------------------------------


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
        fixed: set[tuple[str, int]] = {
            (along, support.node) for support in self.supports for along in support.fix
        }
        return _free(self.elements + 1, ("w", "theta"), fixed)

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
        given = len(self.nodes)
        inner = sum(member.elements - 1 for member in self.members)
        fixed: set[tuple[str, int]] = {
            (along, support.node) for support in self.supports for along in support.fix
        }
        carried = {
            node
            for member in self.members
            for end, node in enumerate(member.nodes, 1)
            if end not in member.hinges
        }
        carried |= {mass.node for mass in self.masses if mass.J and float(mass.J)}
        carried |= {spring.node for spring in self.springs if spring.direction == "theta"}
        fixed |= {("theta", node) for node in range(1, given + 1) if node not in carried}
        return _free(given + inner, ("u", "w", "theta"), fixed)

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


def _free(nodes: int, directions: Sequence[str], fixed: Set[tuple[str, int]]) -> list[int | str]:
    return [f"{d}_{node}" for node in range(1, nodes + 1) for d in directions if (d, node) not in fixed]


def _node_faults(holder: BeamModel | FrameModel, count: int) -> Iterable[tuple[Path, str]]:
    for key in ("supports", "masses", "springs"):
        for place, item in enumerate(getattr(holder, key)):
            if item.node > count:
                yield (key, place, "node"), _no_node(item.node, count)
    if not holder.labels():
        yield ("supports",), "the supports leave nothing to move"


def _no_node(node: int, count: int) -> str:
    return f"there is no node {node}; there are {count}"


# --- matrices --------------------------------------------------------------------------------------


def _path_alone(raw: Any) -> Any:
    return {"path": raw} if isinstance(raw, str) else raw


class FileModel(Part):
    """A file, and the matrix in it where it holds several (in HDF5 also as `file.h5:/path`)."""

    path: str
    name: str | None = None


class StateSpaceModel(Part):
    """A file with a state space, and what it calls A, B and C."""

    path: str
    A: str | None = None
    B: str | None = None
    C: str | None = None


def _file_or_law(raw: Any) -> str:
    return "file" if isinstance(raw, str) or (isinstance(raw, dict) and "path" in raw) else "law"


File = Annotated[FileModel, BeforeValidator(_path_alone, json_schema_input_type=FileModel | str)]
StateSpaceFile = Annotated[
    StateSpaceModel, BeforeValidator(_path_alone, json_schema_input_type=StateSpaceModel | str)
]
DampingMatrix = Annotated[
    Annotated[File, Tag("file")] | Annotated[DampingModel, Tag("law")], Discriminator(_file_or_law)
]


class MatricesModel(Part):
    """Matrices in files, or the state space that they make."""

    mass: File | None = None
    stiffness: File | None = None
    damping: DampingMatrix | None = None
    labels: list[Dof] | str | None = None
    state_space: StateSpaceFile | None = None

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        if self.state_space is None and (self.mass is None or self.stiffness is None):
            raise fault("the matrices are 'mass' and 'stiffness' (and 'damping'), or a 'state_space'")
        if self.state_space is not None and (self.mass or self.stiffness or self.damping):
            raise fault("a 'state_space' holds mass, stiffness and damping; name no file of these")
        return self


class StructureModel(Part):
    """The structure without its joints: one of four kinds."""

    lumped: LumpedModel | None = None
    beam: BeamModel | None = None
    frame: FrameModel | None = None
    matrices: MatricesModel | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = list(type(self).model_fields)
        if sum(getattr(self, kind) is not None for kind in kinds) != 1:
            raise fault(f"a structure is one of {', '.join(kinds)}")
        return self

    def labels(self) -> list[int | str] | None:
        """Return the labels of the degrees of freedom, where the scene alone tells them."""
        part = self.lumped or self.beam or self.frame
        return part.labels() if part else None

    def faults(self) -> Iterable[tuple[Path, str]]:
        """Yield what is wrong with nodes, each with its place in the structure."""
        for kind in ("beam", "frame"):
            part = getattr(self, kind)
            if part is not None:
                yield from (((kind, *path), message) for path, message in part.faults())


# --- joints ----------------------------------------------------------------------------------------


class ParameterModel(Part):
    """A joint's stiffness or damping: known (`value`), or to be identified from `start`."""

    start: Positive | None = None
    value: NotNegative | None = None
    true: Positive | None = None
    matrix: list[list[Value]] | None = Field(default=None, min_length=1, max_length=100)

    @model_validator(mode="after")
    def _known_or_unknown(self) -> Self:
        if (self.start is None) == (self.value is None and self.matrix is None):
            raise fault("a joint parameter has either a 'start' (to be identified) or a 'value' (known)")
        if self.start is None and self.true is not None:
            raise fault("a known parameter has its 'value'; 'true' belongs beside 'start'")
        if self.start is not None and self.value is not None:
            raise fault("a joint parameter has either a 'start' (to be identified) or a 'value' (known)")
        return self

    @field_validator("matrix")
    @classmethod
    def _symmetric(cls, rows: list[list[Quantity]] | None) -> list[list[Quantity]] | None:
        for i, row in enumerate(rows or []):
            if len(row) != len(rows or []):
                raise fault(f"a joint's matrix is square; row {i + 1} has {len(row)} entries")
        for i, row in enumerate(rows or []):
            for j in range(i):
                one, other = float(row[j]), float((rows or [])[j][i])
                if abs(one - other) > 1e-9 * max(abs(one), abs(other)):
                    raise fault(
                        f"a joint's matrix is symmetric; entry ({i + 1}, {j + 1}) is {one:g}, "
                        f"({j + 1}, {i + 1}) is {other:g}"
                    )
        return rows


class MassModel(Part):
    """A joint's mass: a number, shared equally between its DOFs, or a block over them."""

    value: NotNegative | None = None
    matrix: list[list[Value]] | None = Field(default=None, min_length=1, max_length=100)

    _symmetric = field_validator("matrix")(ParameterModel._symmetric.__func__)  # type: ignore[attr-defined]


def _plain_is_known(raw: Any) -> Any:
    if isinstance(raw, list):
        return {"matrix": raw}
    return raw if isinstance(raw, dict) else {"value": raw}


_PLAIN = float | str | list[list[float | str]]
JointValue = Annotated[
    ParameterModel, BeforeValidator(_plain_is_known, json_schema_input_type=ParameterModel | _PLAIN)
]
JointMass = Annotated[MassModel, BeforeValidator(_plain_is_known, json_schema_input_type=MassModel | _PLAIN)]


class JointModel(LinkModel):
    """A joint between two DOFs, or from one to ground; with matrices, over any DOFs."""

    dofs: list[Dof] = Field(min_length=1, max_length=100)
    k: JointValue | None = None  # type: ignore[assignment]
    c: JointValue | None = None  # type: ignore[assignment]
    m: JointMass | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        parts = {"k": self.k, "c": self.c, "m": self.m}
        given = {letter: part for letter, part in parts.items() if part is not None}
        if not given:
            raise fault("a joint has a stiffness 'k', a damping 'c', or both")
        for letter, part in given.items():
            if part.matrix is None and len(self.dofs) > 2:
                raise fault(f"'{letter}' is a number, and 'dofs' names {len(self.dofs)}; it takes one or two")
            if part.matrix is not None and len(part.matrix) != len(self.dofs):
                size = f"{len(part.matrix)} x {len(part.matrix)}"
                raise fault(f"'{letter}' is {size}, but 'dofs' names {len(self.dofs)}")
        return self
