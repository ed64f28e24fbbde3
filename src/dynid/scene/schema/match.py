"""The block `match`: where the nodes of a test lie in the model."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from dynid.scene.schema.base import FilePath, MotionQuantity, Section
from dynid.scene.schema.joints import Vector
from dynid.scene.schema.quantities import Positive, fault


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
