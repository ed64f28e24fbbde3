"""Several structures in one scene, and points of structures."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from dynid.number_format import counted
from dynid.scene.schema.base import Section, once
from dynid.scene.schema.joints import Vector
from dynid.scene.schema.quantities import Positive, fault, raise_faults
from dynid.scene.schema.reduction import ReductionModel
from dynid.scene.schema.references import dof_faults
from dynid.scene.schema.structure import StructureModel

PartName = Annotated[str, Field(pattern=r"^[^\W\d][^\s.:]*$", max_length=40)]
"""Name of a part or a point; ``PART.NODE:DIR`` and ``POINT:DIR`` name DOFs by it."""

#: The reduction of a part without a method.
_PART_METHOD = "craig-bampton"


def _with_method(raw: Any) -> Any:
    return {"method": _PART_METHOD, **raw} if isinstance(raw, dict) else raw


class PartModel(StructureModel):
    """A part of an assembly: a structure, full or reduced by itself."""

    reduction: (
        Annotated[ReductionModel, BeforeValidator(_with_method, json_schema_input_type=ReductionModel | Any)]
        | None
    ) = None

    @model_validator(mode="after")
    def _stands_alone(self) -> Self:
        if self.reduction is not None and self.reduction.method == "joint-aware":
            raise fault("'joint-aware' is of a whole assembly: write 'reduction' beside 'structures'")
        if self.lumped is not None:
            from dynid.structure.labels import DofNames

            faults = dof_faults(self.lumped, DofNames(self.lumped.labels()))
            raise_faults((("lumped", *path), message) for path, message in faults)
        return self


_NodeName = Annotated[int, Field(ge=1, strict=True)] | str


class PointModel(Section):
    """A node, or a set of nodes that moves as a whole, with three displacements and three rotations."""

    part: str | None = None
    node: _NodeName | None = None
    nodes: Annotated[list[_NodeName], Field(min_length=2, max_length=100_000), once("node")] | None = None
    set: str | None = None
    spread: Literal["rigid", "distributed"] = "distributed"
    at: Vector | None = None
    weights: list[Positive] | None = None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if sum(key is not None for key in (self.node, self.nodes, self.set)) != 1:
            raise fault("a point is one 'node', several 'nodes', or a 'set' of them")
        if self.weights is not None and (self.nodes is None or self.spread == "rigid"):
            raise fault("'weights' are of the 'nodes' of a distributed point, one for each")
        if self.weights is not None and len(self.weights) != len(self.nodes or ()):
            nodes = counted(len(self.nodes or ()), "node")
            raise fault(f"'weights' has {counted(len(self.weights), 'entry')} for {nodes}")
        return self
