"""Sections of a scene that are made ready when a scene has them: most scenes use few of many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, GetCoreSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from dynid.scene.kind import resolve


@dataclass(frozen=True)
class Later:
    """Annotation of a field whose model is made ready, and its module loaded, at the first value of it."""

    reference: str = ""  #: The model as ``module:name``; default: the annotated class.

    def model(self, annotated: Any = None) -> type[BaseModel]:
        """Return the model, loaded now."""
        model: type[BaseModel] = resolve(self.reference) or annotated
        return model

    def __get_pydantic_core_schema__(self, source: Any, _: GetCoreSchemaHandler) -> CoreSchema:
        def validated(raw: Any, info: ValidationInfo) -> BaseModel:
            return self.model(source).model_validate(raw, context=info.context)

        # The JSON Schema of scenes finds the model there.
        metadata = {"model": lambda: self.model(source)}
        return core_schema.with_info_plain_validator_function(validated, metadata=metadata)
