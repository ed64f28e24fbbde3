"""Reductions of structures, in scenes of any kind that has one."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from dynid.choices import MASTERS
from dynid.scene.schema.common import Dof, Part
from dynid.scene.schema.quantities import NotNegative, Positive, fault

Unit = Literal["rad/s", "Hz"]


def once(what: str) -> AfterValidator:
    """Check that a list names nothing twice."""

    def check(listed: list[Any]) -> list[Any]:
        twice = next((item for place, item in enumerate(listed) if item in listed[:place]), None)
        if twice is not None:
            raise fault(f"{what}{f' {twice}' if isinstance(twice, int | str) else ''} stands twice")
        return listed

    return AfterValidator(check)


def _form(raw: Any) -> str:
    return "mapping" if isinstance(raw, dict) else "list"


def _listed(raw: Any) -> str:
    return "text" if isinstance(raw, str) else "list"


DofList = Annotated[list[Dof], Field(min_length=1, max_length=100_000), once("DOF")]
_Numbers = Annotated[list[Annotated[int, Field(ge=1, strict=True)]], Field(min_length=1), once("mode")]


class MastersModel(Part):
    """How to choose masters; without a count, one a mode."""

    count: int | None = Field(default=None, ge=1, strict=True)
    choose: Literal["qr", "effective-independence", "mass"] = MASTERS.value


class ModesModel(Part):
    """The lowest modes: so many, or all below a frequency."""

    count: int | None = Field(default=None, ge=0, strict=True)
    below: Positive | None = None
    unit: Unit = "rad/s"

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.count is None) == (self.below is None):
            raise fault("modes are given by their 'count', or as those 'below' a frequency")
        return self


Masters = Annotated[
    Annotated[DofList, Tag("list")] | Annotated[MastersModel, Tag("mapping")], Discriminator(_form)
]
Modes = Annotated[
    Annotated[_Numbers, Tag("list")] | Annotated[ModesModel, Tag("mapping")], Discriminator(_form)
]


class _Mastered(Part):
    """Masters; absent: from joints, sensors and loads."""

    masters: Masters | None = None


class _Modal(Part):
    """Modes; absent: from the masters, or the band of excitation and response."""

    modes: Modes | None = None


_Residuals = Annotated[
    Annotated[list[Dof], Field(max_length=100_000), once("DOF"), Tag("list")]
    | Annotated[Literal["auto", "none"], Tag("text")],
    Discriminator(_listed),
]


class _OnModes(_Mastered, _Modal):
    """Masters and the modes that they see."""

    @model_validator(mode="after")
    def _enough_masters(self) -> Self:
        masters, modes = _count(self.masters), _count(self.modes)
        if masters is not None and modes is not None and modes > masters:
            raise fault(
                f"{modes} modes are more than {masters} master{'s' * (masters != 1)} can tell apart; "
                "take fewer modes or more masters"
            )
        if modes == 0:
            raise fault("at least one mode is needed")
        return self


def _count(given: list[int] | list[Dof] | MastersModel | ModesModel | None) -> int | None:
    return len(given) if isinstance(given, list) else given.count if given is not None else None


class SerepModel(_OnModes):
    """SEREP, on modes of the structure without its joints."""

    method: Literal["serep"]


class JointAwareModel(_OnModes):
    """Modes of the structure with its joints at their current values, with residual vectors or at masters.

    Absent, an identification that names no masters has residual vectors, if its excitation ends at a
    frequency below half the sampling rate. A comparison takes the basis as it is named.
    """

    method: Literal["joint-aware"]
    residuals: _Residuals | None = None

    @model_validator(mode="after")
    def _masters_or_residuals(self) -> Self:
        if self.residuals not in (None, [], "none") and self.masters is not None:
            raise fault(
                "with residual vectors the coordinates are modal: give 'masters' or 'residuals', not both"
            )
        return self


class GuyanModel(_Mastered):
    """Static condensation."""

    method: Literal["guyan"]


class DynamicModel(_Mastered):
    """Dynamic condensation at a frequency; absent: the middle of the band."""

    method: Literal["dynamic"]
    frequency: NotNegative | None = None
    unit: Unit = "rad/s"


class IrsModel(_Mastered):
    """The improved reduced system; with more iterations the iterated one."""

    method: Literal["irs"]
    iterations: int = Field(default=1, ge=1, le=10_000, strict=True)


class CraigBamptonModel(_Mastered, _Modal):
    """Static condensation on a boundary, the masters, with modes of the structure between."""

    method: Literal["craig-bampton"]


class ModalModel(_Modal):
    """Modes, with residual vectors for loads; absent or ``auto``: at joints, sensors and loads."""

    method: Literal["modal"]
    residuals: _Residuals | None = None


Reduction = Annotated[
    SerepModel | GuyanModel | DynamicModel | IrsModel | CraigBamptonModel | ModalModel | JointAwareModel,
    Discriminator("method"),
]


def in_radians(value: float, unit: Unit) -> float:
    """Return a frequency in rad/s."""
    return value * (2 * math.pi if unit == "Hz" else 1.0)
