"""`dynid help`, `dynid library` and `dynid schema`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import among, refuse_unknown

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


def _topics() -> dict[str, Traversable]:
    from importlib.resources import files

    texts = [item for item in files("dynid.topics").iterdir() if item.name.endswith(".md")]
    return {text.name.removesuffix(".md"): text for text in sorted(texts, key=lambda text: text.name)}


def _names() -> list[str]:
    from dynid.cli import COMMANDS

    return [*_topics(), *COMMANDS]


def _topic_of(word: str, topics: Mapping[str, Traversable]) -> str:
    """Return the topic with a paragraph of a name, or the only one with a section of scenes; '' for none."""
    texts = {name: text.read_text("utf-8") for name, text in topics.items()}
    paragraph = [name for name, text in texts.items() if f"**{word.capitalize()}.**" in text]
    section = [name for name, text in texts.items() if f"\n{word}:" in text]
    return paragraph[0] if paragraph else section[0] if len(section) == 1 else ""


@click.command("help")
@click.argument("topic", required=False, shell_complete=among("dynid.cli.help:_names"))
def help_(topic: str | None) -> int:
    """Print the manual of a TOPIC or the help of a command; without TOPIC, list the topics."""
    from dynid.cli import cli

    topics = _topics()
    if topic is not None and topic not in _names():
        topic = _topic_of(topic, topics) or topic
    if topic is None:
        width = max(map(len, topics))
        click.echo("dynid help TOPIC, where TOPIC is a command, or\n")
        for name, text in topics.items():
            heading = text.read_text(encoding="utf-8").partition("\n")[0]
            click.echo(f"  {name:{width}}  {heading.lstrip('# ').strip()}")
    elif topic in topics:
        click.echo_via_pager(topics[topic].read_text(encoding="utf-8"))
    else:
        refuse_unknown(topic, _names(), "topic")
        cli.main([topic, "--help"], prog_name="dynid", standalone_mode=False)
    return 0


@click.command()
@click.argument("name", required=False, shell_complete=among("dynid.scene.models:library_names"))
def library(name: str | None) -> int:
    """Print the model NAME with its ports, values and source; without NAME, list the models.

    A graph has it as a node `{model: NAME}`; to change it, write it to a file and `use:` that file.
    """
    from dynid.cli.text import described
    from dynid.scene.models import library_names, library_text
    from dynid.scene.yaml.source import parse_source

    if name is not None:
        refuse_unknown(name, library_names(), "model")
        click.echo(library_text(name), nl=False)
        return 0
    rows = []
    for model in library_names():
        (data,) = parse_source(library_text(model)).data["models"].values()
        rows.append((model, f"{data['title']}; ports {', '.join(data['ports'])}"))
    click.echo("\n".join(described(rows, "")))
    return 0


@click.command()
@click.argument("kind", required=False, shell_complete=among("dynid.scene.kind:KINDS"))
def schema(kind: str | None) -> int:
    """Print the JSON Schema of scenes: of one KIND, or of all."""
    from dynid.scene.kind import KINDS

    if kind is not None:
        refuse_unknown(kind, KINDS, "kind")
    click.echo(schema_text(kind))
    return 0


def schema_text(kind: str | None = None) -> str:
    """Return the JSON Schema (draft 7) of the scenes of a kind, or of all kinds."""
    from dynid.scene.kind import KINDS
    from dynid.scene.schema.json_schema import scene_schema

    schemas = [scene_schema(KINDS[name].load("model")) for name in ([kind] if kind else KINDS)]
    if len(schemas) == 1:
        document = schemas[0]
    else:
        definitions = {
            name: definition
            for model_schema in schemas
            for name, definition in model_schema.pop("$defs", {}).items()
        }
        document = {"oneOf": schemas, "$defs": definitions}
    return json.dumps({"$schema": "http://json-schema.org/draft-07/schema#", **document}, indent=2)
