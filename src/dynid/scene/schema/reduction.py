"""Scenes of kind `reduction`."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from dynid.scene.schema.accuracy import AccuracyModel
from dynid.scene.schema.common import FrequencyGrid, SceneModel
from dynid.scene.schema.identification import OutputModel
from dynid.scene.schema.joints import JointModel
from dynid.scene.schema.quantities import fault
from dynid.scene.schema.reductions import DofList, Reduction, once
from dynid.scene.schema.structure import StructureModel


def result_names(methods: list[str]) -> list[str]:
    """Return the names of reductions in a result: their methods, numbered where one stands again."""
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
    reduction: list[Reduction] = Field(min_length=1, max_length=1000)
    frequency: FrequencyGrid | None = None
    inputs: DofList | None = None
    outputs: Annotated[list[OutputModel], Field(min_length=1), once("this output")] | None = None
    substructures: dict[str, DofList] = {}

    @model_validator(mode="after")
    def _responses_have_frequencies(self) -> Self:
        if self.frequency is None and (self.inputs or self.outputs):
            raise fault("'inputs' and 'outputs' are of frequency responses; these need the block 'frequency'")
        return self
