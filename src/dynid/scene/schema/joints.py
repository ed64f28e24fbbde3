"""Joints of a scene: springs, dampers and masses, or measured blocks, between the DOFs of a structure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from dynid.scene.schema.base import Dof, Section, by_form
from dynid.scene.schema.quantities import (
    Positive,
    Quantity,
    Start,
    Uncertain,
    UncertainNotNegative,
    UncertainSpring,
    Value,
    fault,
    raise_faults,
)
from dynid.scene.schema.references import Later, Path, sections
from dynid.scene.schema.structure import Direction, LinkModel, loss_factor


def _symmetric(rows: list[list[Quantity]]) -> list[list[Quantity]]:
    for i, row in enumerate(rows):
        if len(row) != len(rows):
            raise fault(f"a joint's matrix is square; row {i + 1} has {len(row)} entries")
    for i, row in enumerate(rows):
        for j in range(i):
            above, below = float(row[j]), float(rows[j][i])
            if abs(above - below) > 1e-9 * max(abs(above), abs(below)):
                raise fault(
                    f"a joint's matrix is symmetric; entry ({i + 1}, {j + 1}) is {above:g}, "
                    f"({j + 1}, {i + 1}) is {below:g}"
                )
            if not _slopes(rows[i][j]) == _slopes(rows[j][i]):
                raise fault(
                    f"a joint's matrix is symmetric for all values of the parameters; entries "
                    f"({i + 1}, {j + 1}) and ({j + 1}, {i + 1}) differ: write the same in both"
                )
    return rows


def _slopes(entry: Quantity) -> dict[str, float]:
    """Return the derivatives of an entry by the parameters that it depends on, to ten digits."""
    if entry.dependent is None:
        return {}
    return {name: float(f"{rate:.10g}") for name, rate in entry.dependent.at({}).slopes.items()}


_JointMatrix = Annotated[
    list[list[Uncertain]], Field(min_length=1, max_length=100), AfterValidator(_symmetric)
]


class PriorModel(Section):
    """Prior of an unknown parameter."""

    value: Positive
    relative_deviation: Positive


class LawPriorModel(Section):
    """Prior of an unknown parameter of a law."""

    value: Value
    relative_deviation: Positive


class _NumberModel(Section):
    """A parameter of a joint or of a law: known (`value`), or unknown (`start`)."""

    noun: ClassVar[str]

    @model_validator(mode="after")
    def _known_or_unknown(self) -> Self:
        stated, matrix = self.numbers, getattr(self, "matrix", None)
        if ("start" in stated) == ("value" in stated) and ("start" in stated or matrix is None):
            raise fault(f"{self.noun} has either a 'start' (to be identified) or a 'value' (known)")
        if "start" not in stated and (stated.keys() & {"true", "min", "max"} or getattr(self, "prior", None)):
            raise fault(
                "a known parameter has its 'value'; 'true', 'min', 'max' and 'prior' belong beside 'start'"
            )
        low, high = stated.get("min", -math.inf), stated.get("max", math.inf)
        if not low <= stated.get("start", low) <= high:
            raise fault("'start' does not lie between 'min' and 'max'")
        return self

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers that it states, by key."""
        stated = {key: getattr(self, key) for key in ("start", "value", "true", "min", "max")}
        return {key: float(number) for key, number in stated.items() if number is not None}


class ParameterModel(_NumberModel):
    """A joint's stiffness or damping, or the factor of its matrix: known (`value`), or unknown (`start`)."""

    noun = "a joint parameter"
    start: Start | None = None
    value: UncertainSpring | None = None
    true: Positive | None = None
    matrix: _JointMatrix | None = None
    min: Positive | None = None
    max: Positive | None = None
    prior: PriorModel | None = None

    @model_validator(mode="after")
    def _matrix_fits(self) -> Self:
        entries = [entry for row in self.matrix or () for entry in row]
        if self.start is not None and self.matrix is not None and not any(map(float, entries)):
            raise fault("the 'matrix' beside 'start' is zero: there is nothing to identify")
        if self.start is not None and any(entry.dependent for entry in entries):
            raise fault(
                "the 'matrix' beside 'start' is constant, and here depends on a parameter; leave 'start' out"
            )
        return self


class MassModel(Section):
    """A joint's mass: a number, shared equally between its DOFs, or a block over them."""

    value: UncertainNotNegative | None = None
    matrix: _JointMatrix | None = None


def _plain_is_known(raw: Any) -> Any:
    if isinstance(raw, list):
        return {"matrix": raw}
    return raw if isinstance(raw, dict) else {"value": raw}


_PLAIN = float | str | list[list[float | str]]
_JointValue = Annotated[
    ParameterModel, BeforeValidator(_plain_is_known, json_schema_input_type=ParameterModel | _PLAIN)
]
_JointMass = Annotated[MassModel, BeforeValidator(_plain_is_known, json_schema_input_type=MassModel | _PLAIN)]


def by_direction(raw: Any) -> bool:
    """Return True for the k or c of a joint between points that has values by direction."""
    return isinstance(raw, dict) and not raw.keys().isdisjoint(get_args(Direction))


def _by_directions(value: Any) -> set[str]:
    """Return the directions of the k or c of a joint between points."""
    return {*value} if isinstance(value, dict) else set()


_JointValues = Annotated[
    Annotated[_JointValue, Tag("whole")] | Annotated[dict[Direction, _JointValue], Tag("components")],
    Discriminator(lambda raw: "components" if by_direction(raw) else "whole"),
]
"""One value, or of a joint between points values by direction."""


def _loss_factors(value: Any) -> Any:
    for loss in value.values() if isinstance(value, dict) else [value]:
        if loss.matrix is not None:
            raise fault("'eta' is a number: the stiffness 'k' times it dissipates")
        for key in ("start", "value", "true", "min"):
            if (number := getattr(loss, key)) is not None:
                loss_factor(number)
    return value


_JointLoss = Annotated[_JointValues, AfterValidator(_loss_factors)]
"""Loss factor of a joint's stiffness, or of one between points by direction."""

Vector = Annotated[list[Value], Field(min_length=3, max_length=3)]


class AxesModel(Section):
    """Two or three directions of a frame; y is made orthogonal to x, and z to both."""

    x: Vector
    y: Vector
    z: Vector | None = None


Axes = Annotated[
    Annotated[Annotated[list[Vector], Field(min_length=3, max_length=3)], Tag("list")]
    | Annotated[AxesModel, Tag("mapping")],
    by_form("mapping", "list"),
]


class LawParameterModel(_NumberModel):
    """A parameter of a law: known (`value`), or unknown (`start`); one that may be negative has any sign."""

    noun = "a parameter of a law"
    start: Value | None = None
    value: Uncertain | None = None
    true: Value | None = None
    min: Value | None = None
    max: Value | None = None
    prior: LawPriorModel | None = None


def joint_parameters(
    holder: Any, path: Path = ()
) -> Iterator[tuple[Path, ParameterModel | LawParameterModel]]:
    """Yield the parameters of joints and of their laws within a section, each with its path."""
    yield from sections(holder, ParameterModel, path)
    yield from sections(holder, LawParameterModel, path)


LawValue = Annotated[
    LawParameterModel,
    BeforeValidator(_plain_is_known, json_schema_input_type=LawParameterModel | float | str),
]
"""A parameter of a law; a number or an expression alone is known."""


def kind(raw: Any) -> Any:
    """Return the kind of a law; faults name the key as this function."""
    return raw.get("kind") if isinstance(raw, dict) else getattr(raw, "kind", None)


_MODULE = "dynid.scene.schema.joint_laws"
_NOT_PRELOADED = ("jenkins", "bouc_wen", "iwan", "coulomb")
_Law = Annotated[
    Annotated[Any, Later(f"{_MODULE}:PowerLaw"), Tag("power")]
    | Annotated[Any, Later(f"{_MODULE}:CubicLaw"), Tag("cubic")]
    | Annotated[Any, Later(f"{_MODULE}:QuadraticDampingLaw"), Tag("quadratic_damping")]
    | Annotated[Any, Later(f"{_MODULE}:JenkinsLaw"), Tag("jenkins")]
    | Annotated[Any, Later(f"{_MODULE}:BoucWenLaw"), Tag("bouc_wen")]
    | Annotated[Any, Later(f"{_MODULE}:IwanLaw"), Tag("iwan")]
    | Annotated[Any, Later(f"{_MODULE}:CoulombLaw"), Tag("coulomb")]
    | Annotated[Any, Later(f"{_MODULE}:GapLaw"), Tag("gap")]
    | Annotated[Any, Later(f"{_MODULE}:ExpressionLaw"), Tag("expression")],
    Discriminator(kind),
]


class JointModel(LinkModel):
    """A joint between two DOFs, or from one to ground; with matrices, over any DOFs; or between points."""

    dofs: list[Dof] = Field(default=[], max_length=100)
    points: list[str] | None = Field(default=None, min_length=1, max_length=2)
    k: _JointValues | None = None  # type: ignore[assignment]
    c: _JointValues | None = None  # type: ignore[assignment]
    eta: _JointLoss | None = None  # type: ignore[assignment]
    m: _JointMass | None = None
    axes: Axes | None = None
    at: Vector | None = None
    laws: list[_Law] = Field(default=[], max_length=20)
    offset: LawValue | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if isinstance(self.eta, dict) and (
            self.points is None or not self.eta.keys() <= _by_directions(self.k)
        ):
            raise fault("'eta' has directions that 'k' has not")
        parts = {"k": self.k, "c": self.c, "m": self.m}
        values = {letter: value for letter, value in parts.items() if value is not None}
        if not (values or self.laws):
            raise fault("a joint has a stiffness 'k', a damping 'c', or both; or 'laws'")
        self._check_laws()
        if bool(self.dofs) == (self.points is not None):
            raise fault("a joint is between 'dofs', or between 'points'")
        if self.points is not None:
            self._check_points(values)
            return self
        if self.axes is not None or self.at is not None:
            raise fault("'axes' and 'at' are of joints between 'points'")
        for letter, value in values.items():
            if isinstance(value, dict):
                raise fault(f"'{letter}' has directions, which a joint between 'points' has")
            if value.matrix is None and len(self.dofs) > 2:
                raise fault(f"'{letter}' is a number, and 'dofs' names {len(self.dofs)}; it takes one or two")
            if value.matrix is not None and len(value.matrix) != len(self.dofs):
                size = f"{len(value.matrix)} x {len(value.matrix)}"
                raise fault(f"'{letter}' is {size}, but 'dofs' names {len(self.dofs)}")
        return self

    def _check_laws(self) -> None:
        """Refuse laws that do not suit the ends, and an offset without a law that it shifts."""
        if self.laws and len(self.dofs) > 2:
            raise fault(f"laws act on one deflection, and 'dofs' names {len(self.dofs)}; it takes one or two")
        if self.offset is not None and all(law.kind in _NOT_PRELOADED for law in self.laws):
            raise fault(
                "the 'offset' shifts no law here: sliders and hysteresis have a preload in their hidden state"
            )
        for index, law in enumerate(self.laws):
            if (law.component is None) != (self.points is None):
                said = (
                    "needs the 'component' of the joint that it acts along"
                    if self.points is not None
                    else ("has a 'component', which a joint between 'points' has")
                )
                raise_faults([(("laws", index), f"the law {said}")])

    def _check_points(self, values: Mapping[str, Any]) -> None:
        """Refuse a joint between points whose values are of other kinds."""
        assert self.points is not None
        if len(set(self.points)) < len(self.points):
            raise fault(f"both ends are the point '{self.points[0]}'")
        for letter, value in values.items():
            if letter == "m" or isinstance(value, dict):
                continue
            if value.matrix is None:
                raise fault(
                    f"a joint between points has its '{letter}' by direction: {letter}: {{x: …, rz: …}}"
                )
            sizes = sorted({3, 6, 6 * len(self.points)})
            if len(value.matrix) not in sizes:
                listed = " or ".join(f"{n} x {n}" for n in sizes)
                raise fault(
                    f"'{letter}' is {len(value.matrix)} x {len(value.matrix)}; between points it is {listed}"
                )
