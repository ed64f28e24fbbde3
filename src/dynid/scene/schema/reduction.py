"""Reductions of structures in scenes of any kind; scenes of kind `reduction` and their checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import BaseModel, Discriminator, Field, Tag, model_validator

from dynid.defaults import MASTERS
from dynid.scene.schema.base import (
    AccuracyModel,
    Dof,
    FrequencyGrid,
    SceneModel,
    Section,
    SignedDof,
    accuracy_faults,
    by_form,
    once,
)
from dynid.scene.schema.joints import JointModel, joint_parameters
from dynid.scene.schema.measurement import ChannelModel, OutputModel
from dynid.scene.schema.quantities import AT_KEY, Located, NotNegative, Positive, fault, raise_faults
from dynid.scene.schema.references import dof_faults, sections
from dynid.scene.schema.structure import StructureModel

Unit = Literal["rad/s", "Hz"]


_DofList = Annotated[list[Dof], Field(min_length=1, max_length=100_000), once("DOF")]
_SignedDofList = Annotated[list[SignedDof], Field(min_length=1, max_length=100_000), once("DOF")]
_Numbers = Annotated[list[Annotated[int, Field(ge=1, strict=True)]], Field(min_length=1), once("mode")]


class MastersModel(Section):
    """Rule to choose masters; without a count, one for each mode."""

    count: int | None = Field(default=None, ge=1, strict=True)
    choose: Literal["qr", "effective-independence", "mass"] = MASTERS.value


class ModesModel(Section):
    """The lowest modes: a number, or all below a frequency."""

    count: int | None = Field(default=None, ge=0, strict=True)
    below: Positive | None = None
    unit: Unit = "rad/s"

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.count is None) == (self.below is None):
            raise fault("modes are given by their 'count', or as those 'below' a frequency")
        return self


Masters = Annotated[
    Annotated[_DofList, Tag("list")] | Annotated[MastersModel, Tag("mapping")], by_form("list", "mapping")
]
Modes = Annotated[
    Annotated[_Numbers, Tag("list")] | Annotated[ModesModel, Tag("mapping")], by_form("list", "mapping")
]


class _Mastered(Section):
    """Masters; default: from joints, sensors and loads."""

    masters: Masters | None = None


class _Modal(Section):
    """Modes; default: from the masters, or the band of excitation and response."""

    modes: Modes | None = None


_Residuals = Annotated[
    Annotated[list[Dof], Field(max_length=100_000), once("DOF"), Tag("list")]
    | Annotated[Literal["auto", "none"], Tag("text")],
    by_form("list", "text"),
]


class _OnModes(_Mastered, _Modal):
    """Masters, and the modes that are observable at them."""

    @model_validator(mode="after")
    def _enough_masters(self) -> Self:
        masters, modes = _count(self.masters), _count(self.modes)
        if masters is not None and modes is not None and modes > masters:
            raise fault(
                f"{modes} modes are more than {masters} master{'s' * (masters != 1)} can distinguish; "
                "take fewer modes or more masters"
            )
        if modes == 0:
            raise fault("at least one mode is needed")
        return self


def _count(choice: list[int] | list[Dof] | MastersModel | ModesModel | None) -> int | None:
    return len(choice) if isinstance(choice, list) else choice.count if choice is not None else None


class SerepModel(_OnModes):
    """SEREP, on modes of the structure without its joints."""

    method: Literal["serep"]


class JointAwareModel(_OnModes):
    """Modes of the structure with its joints at their current values, with residual vectors or at masters.

    By default an identification that names no masters has residual vectors, if its excitation ends at a
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
    """Dynamic condensation at a frequency; default: the middle of the band."""

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
    """Modes, with residual vectors for loads; default or ``auto``: at joints, sensors and loads."""

    method: Literal["modal"]
    residuals: _Residuals | None = None


ReductionModel = Annotated[
    SerepModel | GuyanModel | DynamicModel | IrsModel | CraigBamptonModel | ModalModel | JointAwareModel,
    Discriminator("method"),
]


def max_size(reduction: Section) -> int | None:
    """Return the most coordinates that a reduction can have; None where the scene does not say them."""
    masters = _count(getattr(reduction, "masters", None))
    if masters is not None and isinstance(reduction, CraigBamptonModel):
        modes = _count(reduction.modes)
        return None if modes is None else masters + modes
    return masters


def result_names(methods: list[str]) -> list[str]:
    """Return the names of reductions in a result: their methods, numbered from the second on."""
    seen: Counter[str] = Counter()
    names = []
    for method in methods:
        seen[method] += 1
        names.append(method if seen[method] == 1 else f"{method}_{seen[method]}")
    return names


class ReductionScene(SceneModel):
    """A structure, and reductions of it to compare."""

    kind: Literal["reduction"]
    accuracy: AccuracyModel | None = None
    structure: StructureModel
    joints: dict[str, JointModel] = {}
    reduction: list[ReductionModel] = Field(min_length=1, max_length=1000)
    frequency: FrequencyGrid | None = None
    inputs: _SignedDofList | None = None
    outputs: Annotated[list[OutputModel], Field(min_length=1), once("this output")] | None = None
    substructures: dict[str, _DofList] = {}
    compare: bool | None = None

    @model_validator(mode="after")
    def _responses_have_frequencies(self) -> Self:
        if self.frequency is None and (self.inputs or self.outputs):
            raise fault("'inputs' and 'outputs' are of frequency responses; these need the block 'frequency'")
        return self

    @model_validator(mode="after")
    def _fits(self) -> Self:
        message = "the joints of a comparison are known: give a 'value', or the number alone"
        started = (path for path, parameter in joint_parameters(self) if parameter.start is not None)
        unknown = [((*path, "start", AT_KEY), message) for path in started]
        raise_faults([*structure_faults(self, self.structure), *unknown, *accuracy_faults(self)])
        return self

    @property
    def aspects(self) -> set[str]:
        """The aspects in which it chooses between alternatives."""
        return {"modes", "basis"}


def structure_faults(holder: BaseModel, structure: StructureModel | None) -> Iterator[Located]:
    """Yield the DOFs that a section names and its structure lacks, and outputs, which are of graphs.

    Without a structure the names of its DOFs are known as the model is built.
    """
    from dynid.structure.labels import DofNames

    if structure is not None and (labels := structure.labels()):
        yield from dof_faults(holder, DofNames(labels))
    for path, channel in sections(holder, ChannelModel):
        if channel.output is not None:
            message = "a structure has DOFs, not outputs of nodes; write 'dof' and 'quantity'"
            yield (*path, "output", AT_KEY), message
