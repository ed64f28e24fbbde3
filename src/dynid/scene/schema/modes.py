"""The block `measurement.modes`: measured frequencies, damping ratios and mode shapes; nodes of tests."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, Tag, model_validator

from dynid.scene.schema.base import FilePath, MotionQuantity, Section, SignedDof, by_form
from dynid.scene.schema.joints import Vector
from dynid.scene.schema.measurement import OutputModel
from dynid.scene.schema.quantities import NotNegative, Positive, Value, fault, raise_faults
from dynid.scene.schema.structure import path_alone


class MatchModel(Section):
    """Nodes of a test, which a Universal File names, matched to nodes of the model."""

    by: Literal["number", "position"] = "number"
    tolerance: Positive | None = None
    geometry: FilePath | None = None
    origin: Vector | None = None
    axes: list[Vector] | None = Field(default=None, min_length=3, max_length=3)
    nodes: dict[int, int | str] = {}
    quantity: MotionQuantity | None = None
    units: Literal["labels", "record"] | None = None

    @model_validator(mode="after")
    def _origin_counts(self) -> Self:
        if self.origin is not None and self.by == "number" and self.tolerance is None:
            raise fault(
                "'origin' says nothing of nodes with the same numbers; give a tolerance to check them"
            )
        return self


Component = (
    Annotated[Value, Tag("one")] | Annotated[list[Value], Field(min_length=2, max_length=2), Tag("list")]
)
"""A component of a shape, or [real, imaginary] of a complex one."""


_ShapeStd = Annotated[
    Annotated[NotNegative, Tag("one")] | Annotated[dict[SignedDof, NotNegative], Tag("mapping")],
    by_form("one", "mapping"),
]


class ModeModel(Section):
    """One measured mode: its frequency, damping ratio and shape at sensors, each with its scatter.

    With an `amplitude` a point of a backbone: of the structure's `mode` at this amplitude.
    """

    amplitude: Positive | None = None
    mode: Annotated[int, Field(ge=1, strict=True)] | None = None
    frequency: Positive
    frequency_std: NotNegative | None = None
    damping: Value | None = None
    damping_std: NotNegative | None = None
    shape: dict[SignedDof, Annotated[Component, by_form("one", "list")]] = {}
    shape_std: _ShapeStd | None = None

    @model_validator(mode="after")
    def _scatter_is_of_something(self) -> Self:
        if self.damping is None and self.damping_std is not None:
            raise fault("'damping_std' is the scatter of a 'damping'")
        if not self.shape and self.shape_std is not None:
            raise fault("'shape_std' is the scatter of a 'shape'")
        if self.amplitude is None and self.mode is not None:
            raise fault("'mode' is that of a backbone, whose points have an 'amplitude'; others are paired")
        if self.amplitude is not None and self.shape:
            raise fault("a mode at an 'amplitude' has no 'shape'")
        if isinstance(self.shape_std, dict):
            for dof in self.shape_std:
                if dof not in self.shape:
                    raise fault(f"'shape_std' names {dof}, which the shape does not")
        return self


class SensorFileModel(Section):
    """A MATLAB file with the numbers of the sensors' DOFs."""

    path: FilePath
    name: str


class ModesFileModel(Section):
    """A file of measured modes, and the names of quantities in it where they are not the usual ones."""

    path: FilePath
    amplitude: str | None = None
    mode: str | None = None
    frequency: str | None = None
    frequency_std: str | None = None
    frequency_tests: str | None = None
    eigenvalue: str | None = None
    eigenvalue_std: str | None = None
    damping: str | None = None
    damping_std: str | None = None
    shape: str | None = None
    shape_std: str | None = None
    tests: str | None = None
    dofs: str | None = None
    modes: list[Annotated[int, Field(ge=1, strict=True)]] | None = Field(default=None, min_length=1)

    @property
    def names(self) -> dict[str, str]:
        """The names of quantities that are given."""
        keys = self.model_fields_set - {"path", "modes"}
        return {key: name for key in keys if (name := getattr(self, key)) is not None}


class ScatterModel(Section):
    """Standard deviations relative to frequency, damping ratio, and the largest component of a shape."""

    frequency: NotNegative | None = None
    damping: NotNegative | None = None
    shape: NotNegative | None = None


class MeasuredModesModel(Section):
    """Measured modes, listed or in a file; with `amplitude_of` points of backbones."""

    unit: Literal["rad/s", "Hz"] | None = None
    amplitude_of: OutputModel | None = None
    values: list[ModeModel] = []
    file: (
        Annotated[
            ModesFileModel, BeforeValidator(path_alone, json_schema_input_type=ModesFileModel | FilePath)
        ]
        | None
    ) = None
    sensors: list[SignedDof] | SensorFileModel | None = None
    match: MatchModel | None = None
    floor: ScatterModel = ScatterModel()
    model_error: ScatterModel = ScatterModel()

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if bool(self.values) == (self.file is not None):
            raise fault("measured modes are either listed as 'values' or read from a 'file'")
        if self.sensors is not None and self.file is None:
            raise fault("'sensors' are those of the rows in a 'file'; listed shapes name their DOFs")
        of = self.amplitude_of
        if of is not None and (of.output is not None or of.frame == "absolute"):
            raise fault("'amplitude_of' is a motion at a DOF of the structure, or between two")
        if of is not None and (self.sensors is not None or self.match is not None):
            raise fault("modes at amplitudes have no shapes: 'sensors' and 'match' say nothing")
        said = "either all modes have an 'amplitude', with 'amplitude_of', or none"
        odd = (k for k, mode in enumerate(self.values) if (mode.amplitude is None) != (of is None))
        raise_faults((("values", k), said) for k in odd)
        if self.match is not None and (self.file is None or self.sensors is not None):
            raise fault("'match' finds the nodes of a file in the model; here the scene names the DOFs")
        if self.match is not None and (self.match.quantity or self.match.units):
            raise fault("'quantity' and 'units' are those of channels; leave them out")
        return self
