"""Structures of a scene: lumped masses, beams, frames, solids or imported matrices, and their damping."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from dynid.number_format import counted
from dynid.scene.schema.base import Dof, DofLabel, Entry, FilePath, OneOrList, Section, UnitName
from dynid.scene.schema.quantities import (
    Located,
    NotNegative,
    Positive,
    Quantity,
    Uncertain,
    UncertainNotNegative,
    UncertainPositive,
    UncertainSpring,
    Value,
    fault,
    raise_faults,
)
from dynid.scene.schema.references import FILE, NODE, Freedom, Later, beam_labels, frame_labels, node_faults
from dynid.units import unit_fits

#: The most elements and nodes that a scene may ask for.
MAX_ELEMENTS = 100_000

_NodeNumber = Annotated[int, Field(ge=1, strict=True), NODE]


PerElement = OneOrList[Positive]
PerElementOrZero = OneOrList[NotNegative]
_UncertainPerElement = OneOrList[UncertainPositive]
_UncertainPerElementOrZero = OneOrList[UncertainNotNegative]


def loss_factor(eta: Quantity) -> Quantity:
    """Refuse a loss factor that is no such."""
    if float(eta) > MAX_LOSS_FACTOR:
        raise fault(f"a loss factor lies between 0 and {MAX_LOSS_FACTOR:g}, not at {float(eta):g}")
    return eta


LossFactor = Annotated[UncertainNotNegative, AfterValidator(loss_factor)]
"""A loss factor of structural damping, which may depend on parameters."""

MAX_LOSS_FACTOR = 2.0
"""The largest loss factor that is taken for one: that of the most dissipative rubbers and foils is below."""


class EquivalentModel(Section):
    """The frequency at which dampers stand for structural damping."""

    at: Positive
    unit: Literal["rad/s", "Hz"] = "rad/s"


class DampingModel(Section):
    """Damping from mass and stiffness (alpha, beta, eta), or damping ratios of the modes."""

    alpha: UncertainNotNegative | None = None
    beta: UncertainNotNegative | None = None
    eta: LossFactor | None = None
    ratio: _UncertainPerElementOrZero | None = None
    equivalent: EquivalentModel | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        keys = (self.alpha, self.beta, self.eta, self.equivalent)
        of_matrices = any(key is not None for key in keys)
        if of_matrices == (self.ratio is not None):
            raise fault("damping is either proportional ('alpha', 'beta', 'eta') or modal ('ratio')")
        return self


class PointMassModel(Section):
    """A mass at a node."""

    node: _NodeNumber
    m: UncertainNotNegative | None = None
    J: UncertainNotNegative | None = None

    @model_validator(mode="after")
    def _has_something(self) -> Self:
        if self.m is None and self.J is None:
            raise fault("a mass has its 'm', a rotary inertia 'J', or both")
        return self


class BeamSupport(Section):
    """Support of a node of a beam."""

    node: _NodeNumber
    fix: list[Literal["w", "theta"]] = Field(min_length=1)


class FrameSupport(Section):
    """Support of a node of a frame."""

    node: _NodeNumber
    fix: list[Literal["u", "w", "theta"]] = Field(min_length=1)


def _needs_stiffness(spring: Any) -> None:
    if spring.eta is not None and spring.k is None:
        raise fault("'eta' is the loss factor of a stiffness 'k', which is absent")


class _Spring(Section):
    node: _NodeNumber
    k: UncertainSpring | None = None
    c: UncertainSpring | None = None
    eta: LossFactor | None = None

    @model_validator(mode="after")
    def _has_something(self) -> Self:
        _needs_stiffness(self)
        if self.k is None and self.c is None:
            raise fault("a spring has a stiffness 'k', a damping 'c', or both")
        return self


class BeamSpring(_Spring):
    """A spring and damper from a node of a beam to ground."""

    direction: Literal["w", "theta"]


class FrameSpring(_Spring):
    """A spring and damper from a node of a frame to ground."""

    direction: Literal["u", "w", "theta"]


class BeamModel(Section):
    """An Euler–Bernoulli beam of elements in a row; nodes count from 1."""

    elements: int = Field(ge=1, le=MAX_ELEMENTS, strict=True)
    length: _UncertainPerElement
    EI: _UncertainPerElement
    rhoA: _UncertainPerElementOrZero
    eta: OneOrList[LossFactor] | None = None
    supports: list[BeamSupport] = []
    masses: list[PointMassModel] = []
    springs: list[BeamSpring] = []
    damping: DampingModel | None = None

    @field_validator("length", "EI", "rhoA", "eta")
    @classmethod
    def _one_each(cls, values: Any, info: ValidationInfo) -> Any:
        count = info.data.get("elements")
        if isinstance(values, list) and count is not None and len(values) != count:
            entries = counted(len(values), "entry")
            raise fault(f"'{info.field_name}' has {entries} for {counted(count, 'element')}")
        return values

    def labels(self) -> list[int | str]:
        """Return the labels of the free degrees of freedom."""
        return beam_labels(self.elements, _held(self.supports))


class MemberModel(Section):
    """A straight member of a frame between two nodes."""

    nodes: list[_NodeNumber] = Field(min_length=2, max_length=2)
    EA: UncertainPositive
    EI: UncertainPositive
    rhoA: UncertainNotNegative
    eta: LossFactor | None = None
    elements: int = Field(default=1, ge=1, le=MAX_ELEMENTS, strict=True)
    hinges: list[Literal[1, 2]] = []


def _is_bounded(members: list[Any]) -> list[Any]:
    if sum(member.elements for member in members) > MAX_ELEMENTS:
        raise fault(f"the members have more than {MAX_ELEMENTS:,} elements together")
    return members


_Members = Annotated[list[Entry], Field(min_length=1, max_length=MAX_ELEMENTS), AfterValidator(_is_bounded)]


class FrameModel(Section):
    """A plane frame: nodes by their coordinates, members between them."""

    nodes: list[Annotated[list[Uncertain], Field(min_length=2, max_length=2)]] = Field(
        min_length=2, max_length=MAX_ELEMENTS
    )
    members: _Members[MemberModel]
    supports: list[FrameSupport] = []
    masses: list[PointMassModel] = []
    springs: list[FrameSpring] = []
    damping: DampingModel | None = None

    def labels(self) -> list[int | str]:
        """Return the labels of the free degrees of freedom, those at nodes within members last."""
        members = ((member.nodes, member.hinges, member.elements) for member in self.members)
        turning = {mass.node for mass in self.masses if mass.J and mass.J.real}
        turning |= {spring.node for spring in self.springs if spring.direction == "theta"}
        return frame_labels(len(self.nodes), members, _held(self.supports), turning)

    def member_faults(self) -> Iterator[Located]:
        """Yield the faults of members, each with its place in the frame."""
        for index, member in enumerate(self.members):
            if member.nodes[0] == member.nodes[1]:
                yield ("members", index, "nodes"), f"both ends are node {member.nodes[0]}"
        reached = {node for member in self.members for node in member.nodes}
        for node in range(1, len(self.nodes) + 1):
            if node not in reached:
                yield ("nodes", node - 1), f"node {node} belongs to no member"


def _held(supports: Iterable[BeamSupport | FrameSupport]) -> Iterable[Freedom]:
    return ((along, support.node) for support in supports for along in support.fix)


Direction = Literal["x", "y", "z", "rx", "ry", "rz"]
_UncertainVector = Annotated[list[Uncertain], Field(min_length=3, max_length=3)]


class SpaceMemberModel(Section):
    """A straight member of a frame in three dimensions between two nodes."""

    nodes: list[_NodeNumber] = Field(min_length=2, max_length=2)
    EA: UncertainPositive
    EIy: UncertainPositive
    EIz: UncertainPositive
    GJ: UncertainPositive
    rhoA: UncertainNotNegative
    rhoJ: UncertainNotNegative | None = None
    eta: LossFactor | None = None
    orientation: _UncertainVector | None = None
    offsets: Annotated[list[_UncertainVector], Field(min_length=2, max_length=2)] | None = None
    releases: Annotated[list[list[Direction]], Field(min_length=2, max_length=2)] | None = None
    elements: int = Field(default=1, ge=1, le=MAX_ELEMENTS, strict=True)


class SpaceSupport(Section):
    """Support of a node of a frame in three dimensions."""

    node: _NodeNumber
    fix: list[Direction] = Field(min_length=1)


class RigidMassModel(Section):
    """A rigid body at a node."""

    node: _NodeNumber
    m: UncertainNotNegative | None = None
    J: Annotated[list[UncertainNotNegative], Field(min_length=3, max_length=3)] | None = None
    offset: _UncertainVector | None = None

    @model_validator(mode="after")
    def _has_something(self) -> Self:
        if self.m is None and self.J is None:
            raise fault("a mass has its 'm', its moments of inertia 'J', or both")
        return self


class SpaceSpring(_Spring):
    """A spring and damper from a node of a frame in three dimensions to ground."""

    direction: Direction


class SpaceFrameModel(Section):
    """A frame in three dimensions: nodes by their coordinates, members between them."""

    nodes: list[_UncertainVector] = Field(min_length=2, max_length=MAX_ELEMENTS)
    members: _Members[SpaceMemberModel]
    supports: list[SpaceSupport] = []
    masses: list[RigidMassModel] = []
    springs: list[SpaceSpring] = []
    damping: DampingModel | None = None


class LinkModel(Section):
    """A spring and a damper between two DOFs, or from one DOF to ground."""

    dofs: list[Dof] = Field(min_length=1, max_length=2)
    k: UncertainSpring | None = None
    c: UncertainSpring | None = None
    eta: LossFactor | None = None

    @model_validator(mode="after")
    def _has_stiffness(self) -> Self:
        _needs_stiffness(self)
        return self

    @field_validator("dofs")
    @classmethod
    def _differ(cls, dofs: list[int | str]) -> list[int | str]:
        twice = next((dof for index, dof in enumerate(dofs) if dof in dofs[:index]), None)
        if twice is not None:
            raise fault(f"both ends are DOF {twice}" if len(dofs) == 2 else f"DOF {twice} is named twice")
        return dofs


class LumpedModel(Section):
    """Point masses, each with one degree of freedom, and the links between them."""

    masses: list[UncertainNotNegative] = Field(min_length=1, max_length=2000)
    links: list[LinkModel] = []
    damping: DampingModel | None = None

    def labels(self) -> list[int | str]:
        """Return the labels of the degrees of freedom."""
        return list(range(1, len(self.masses) + 1))


def _poisson(nu: Quantity) -> Quantity:
    if not -1 < nu.value < 0.5:
        raise fault(f"Poisson's ratio lies between -1 and 0.5, not at {float(nu):g}")
    return nu


class MaterialModel(Section):
    """An isotropic elastic material."""

    E: UncertainPositive
    nu: Annotated[Value, AfterValidator(_poisson)]
    rho: UncertainNotNegative
    eta: LossFactor | None = None


class SetSupportModel(Section):
    """Support of all nodes of a set of a mesh, or of one node."""

    set: str | None = None
    node: int | None = Field(default=None, ge=0, strict=True)
    fix: list[Literal["x", "y", "z"]] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.set is None) == (self.node is None):
            raise fault("a support is at a 'set' of nodes of the mesh, or at one 'node'")
        return self

    @property
    def place(self) -> str | int:
        """The name of the set, or the number of the node."""
        place = self.node if self.set is None else self.set
        assert place is not None
        return place


def _set_as_text(raw: Any) -> Any:
    """Return a support whose set is written as a number, that of a group without a name."""
    if isinstance(raw, dict) and type(raw.get("set")) is int:
        return {**raw, "set": str(raw["set"])}
    return raw


def _names_as_texts(raw: Any) -> Any:
    return {str(name): value for name, value in raw.items()} if isinstance(raw, dict) else raw


def _is_length(unit: str) -> str:
    if not unit_fits(unit, ["m"]):
        raise fault(f"'{unit}' is no unit of length")
    return unit


def _one_material_or_groups(raw: Any) -> str:
    single = not isinstance(raw, dict) or any(not isinstance(value, dict) for value in raw.values())
    return "one" if single else "groups"


class SolidModel(Section):
    """A solid from a mesh of elements."""

    mesh: FilePath
    includes: list[FilePath] = []
    unit: Annotated[UnitName, AfterValidator(_is_length)] = "m"
    materials: Annotated[
        Annotated[MaterialModel, Tag("one")]
        | Annotated[
            dict[str, MaterialModel], Field(min_length=1), BeforeValidator(_names_as_texts), Tag("groups")
        ],
        Discriminator(_one_material_or_groups),
    ]
    supports: list[Annotated[SetSupportModel, BeforeValidator(_set_as_text)]] = []
    damping: DampingModel | None = None


def path_alone(raw: Any) -> Any:
    """Return a file given by its path alone as a mapping."""
    return {"path": raw} if isinstance(raw, str) else raw


class FileModel(Section):
    """A file, the matrix in it where it holds several (in HDF5 also as `file.h5:/path`), and its factor."""

    path: FilePath
    name: str | None = None
    factor: UncertainSpring | None = None


class StateSpaceModel(Section):
    """A file with a state space, and its names of A, B and C."""

    path: FilePath
    A: str | None = None
    B: str | None = None
    C: str | None = None


Parts = Annotated[
    list[Annotated[FileModel, FILE]],
    Field(min_length=1, max_length=1000),
    BeforeValidator(
        lambda raw: list(map(path_alone, raw if isinstance(raw, list) else [raw])),
        json_schema_input_type=FileModel | str | list[FileModel | str],
    ),
    FILE,
]
_StateSpaceFile = Annotated[
    StateSpaceModel, BeforeValidator(path_alone, json_schema_input_type=StateSpaceModel | str), FILE
]
_DampingMatrix = Annotated[
    Annotated[Parts, Tag("file")] | Annotated[DampingModel, Tag("law")],
    Discriminator(
        lambda raw: (
            "file" if isinstance(raw, str | list) or (isinstance(raw, dict) and "path" in raw) else "law"
        )
    ),
]


class MatricesModel(Section):
    """Matrices in files, each whole or as the sum of its parts, or the state space that they make."""

    mass: Parts | None = None
    stiffness: Parts | None = None
    damping: _DampingMatrix | None = None
    structural: Parts | None = None
    gyroscopic: Parts | None = None
    circulatory: Parts | None = None
    speed: NotNegative | None = None
    labels: list[DofLabel] | FilePath | None = None
    nodes: FilePath | None = None
    model: FilePath | None = None
    state_space: _StateSpaceFile | None = None

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        if self.model is not None and (self.mass or self.stiffness or self.state_space):
            raise fault("a 'model' holds mass and stiffness; name no other file of these")
        complete = self.model is not None or self.state_space is not None
        if not complete and (self.mass is None or self.stiffness is None):
            raise fault(
                "the matrices are 'mass' and 'stiffness' (and 'damping'), a 'model' or a 'state_space'"
            )
        if self.state_space is not None and (self.mass or self.stiffness or self.damping or self.structural):
            raise fault("a 'state_space' holds mass, stiffness and damping; name no file of these")
        if self.state_space is not None and self.nodes is not None:
            raise fault("a 'state_space' has no 'nodes'; give 'labels'")
        if (self.gyroscopic is None) != (self.speed is None):
            raise fault("a 'gyroscopic' matrix goes with the 'speed' of rotation, rad/s, that multiplies it")
        if not complete:
            return self
        if self.gyroscopic is not None or self.circulatory is not None:
            raise fault("'gyroscopic' and 'circulatory' go with 'mass' and 'stiffness', one file each")
        return self


class StructureModel(Section):
    """The structure without its joints: one of six kinds."""

    lumped: Annotated[LumpedModel, Later()] | None = None
    beam: Annotated[BeamModel, Later()] | None = None
    frame: Annotated[FrameModel, Later()] | None = None
    space_frame: Annotated[SpaceFrameModel, Later()] | None = None
    solid: Annotated[SolidModel, Later()] | None = None
    matrices: Annotated[MatricesModel, Later()] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = list(StructureModel.model_fields)
        if sum(getattr(self, kind) is not None for kind in kinds) != 1:
            raise fault(f"a structure is one of {', '.join(kinds)}")
        faults: list[Located] = list(node_faults(self, self.nodes))
        if self.frame is not None:
            faults += ((("frame", *path), message) for path, message in self.frame.member_faults())
        model = self.beam or self.frame
        if model is not None and not model.labels():
            faults.append(
                (("beam" if self.beam else "frame", "supports"), "the supports leave nothing to move")
            )
        raise_faults(faults)
        return self

    def labels(self) -> list[int | str] | None:
        """Return the labels of the degrees of freedom, where the scene alone determines them."""
        model = self.lumped or self.beam or self.frame
        return model.labels() if model else None

    @property
    def kind(self) -> str:
        """The kind of structure that it is."""
        return next(kind for kind in StructureModel.model_fields if getattr(self, kind) is not None)

    @property
    def nodes(self) -> int:
        """The number of nodes of a beam or frame that may be named; 0 of other structures."""
        frame = self.frame or self.space_frame
        return self.beam.elements + 1 if self.beam else len(frame.nodes) if frame else 0
