"""Structures of a scene: lumped, beam, frame or imported matrices."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator, model_validator

from dynid.scene.schema.beams import BeamModel, DampingModel, FrameModel, Path
from dynid.scene.schema.common import Dof, Part
from dynid.scene.schema.quantities import NotNegative, Positive, fault


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
