"""The JSON Schema of scenes with a sentence at every key, for editors and for the reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from importlib import resources
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from dynid.scene.schema.base import Section
from dynid.scene.schema.quantities import Quantity


class _OfScenes(GenerateJsonSchema):
    """Generator that describes sections which a scene makes ready later like any others."""

    def function_plain_schema(self, schema: core_schema.PlainValidatorFunctionSchema) -> JsonSchemaValue:
        if "model" not in schema.get("metadata", {}):
            return super().function_plain_schema(schema)
        model = schema["metadata"]["model"]()
        if hasattr(model, "model_rebuild"):
            model.model_rebuild()
        return self.generate_inner(TypeAdapter(model).core_schema)

    def field_title_should_be_set(self, schema: Any) -> bool:
        later = schema["type"] == "function-plain" and "model" in schema.get("metadata", {})
        return not later and super().field_title_should_be_set(schema)


def scene_schema(model: type[Section]) -> dict[str, Any]:
    """Return the JSON Schema (draft 7) of scenes of a kind, with a description of every key."""
    schema = model.model_json_schema(schema_generator=_OfScenes)
    quantity = {definition.name for definition in fields(Quantity)}
    classes = {definition.__name__: definition for definition in _parts(Section)}
    for name, definition in {**schema.get("$defs", {}), model.__name__: schema}.items():
        for variant in (definition, *definition.get("anyOf", ())):
            for key, entry in variant.get("properties", {}).items():
                text = sentence(classes[name], key)
                form, default = entry.get("description", ""), entry.get("default")
                if isinstance(default, dict) and default.keys() == quantity:
                    entry["default"] = default["value"]  # a quantity, as a scene writes it
                if "$ref" in entry:  # draft 7 ignores all keys beside a reference
                    entry["allOf"] = [{"$ref": entry.pop("$ref")}]
                entry["description"] = f"{text.removesuffix('.')} ({form})." if form else text
    return schema


def sentence(section: type[Section], key: str) -> str:
    """Return the description of a key of a section, which a base class may hold."""
    return next(texts[key] for base in section.__mro__ if key in (texts := _texts().get(base.__name__, {})))


@cache
def _texts() -> dict[str, dict[str, str]]:
    import yaml

    text = resources.files(__package__).joinpath("descriptions.yaml").read_text(encoding="utf-8")
    texts: dict[str, dict[str, str]] = yaml.safe_load(text)
    return texts


def _parts(section: type[Section]) -> Iterator[type[Section]]:
    for derived in section.__subclasses__():
        yield derived
        yield from _parts(derived)
