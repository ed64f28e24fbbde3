"""Every key of a scene has a sentence, and every sentence a key."""

import pytest
import yaml

from dynid.scene.kind import KINDS
from dynid.scene.schema import json_schema
from dynid.scene.schema.base import Section


def objects(kind):
    """Yield the name and the mapping of everything in a kind's schema that has keys."""
    schema = json_schema.scene_schema(KINDS[kind].load("model"))
    for name, part in {**schema["$defs"], KINDS[kind].load("model").__name__: schema}.items():
        yield from ((name, whole) for whole in (part, *part.get("anyOf", ())) if "properties" in whole)


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_says_what_it_means(kind):
    for name, part in objects(kind):
        for key, wanted in part["properties"].items():
            text = wanted["description"]
            assert text[0].isupper() or text.startswith("auto"), f"{name}.{key}"
            assert text.endswith(".")
            assert len(text) < 240


@pytest.mark.parametrize("kind", KINDS)
def test_a_reference_stands_alone_as_draft_7_wants_it(kind):
    for _, part in objects(kind):
        assert not any("$ref" in wanted for wanted in part["properties"].values())


def test_a_description_keeps_what_is_said_of_the_form():
    schema = json_schema.scene_schema(KINDS["bond-graph"].load("model"))
    value = schema["$defs"]["SineSignal"]["properties"]["frequency"]
    assert value["description"] == "Frequency (a number, a parameter or an expression)."
    assert value["exclusiveMinimum"] == 0


def test_a_default_is_written_as_in_a_scene():
    schema = json_schema.scene_schema(KINDS["bond-graph"].load("model"))
    assert schema["$defs"]["StepSignal"]["properties"]["amplitude"]["default"] == 1
    assert schema["$defs"]["FrequencyGrid"]["properties"]["points"]["default"] == 200


def test_no_sentence_is_left_from_a_key_that_went():
    for kind in KINDS:
        KINDS[kind].load("model")  # is imported
    parts = {part.__name__: part for part in json_schema._parts(Section)}
    for name, texts in json_schema._texts().items():
        kinds = [part for part in parts.values() if parts[name] in part.__mro__]
        known = {field.alias or key for part in kinds for key, field in part.model_fields.items()}
        assert texts.keys() <= known, name


def test_no_sentence_says_what_a_base_says_already():
    parts = {part.__name__: part for part in json_schema._parts(Section)}
    for name, texts in json_schema._texts().items():
        for base in parts[name].__mro__[1:]:
            shared = json_schema._texts().get(base.__name__, {})
            assert not {key for key in texts.keys() & shared.keys() if texts[key] == shared[key]}, name


def test_the_sentences_are_a_file_that_says_no_key_twice():
    from dynid.scene.yaml.source import parse_source

    text = (json_schema.resources.files("dynid.scene.schema") / "descriptions.yaml").read_text()
    assert parse_source(text).data == yaml.safe_load(text)
