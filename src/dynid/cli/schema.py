"""`dynid schema`."""

from __future__ import annotations

import json
from collections.abc import Iterable

import click

from dynid.cli.completion import among
from dynid.errors import UsageError


def _kinds() -> Iterable[str]:
    from dynid.scene.kind import KINDS

    return KINDS


@click.command()
@click.argument("kind", required=False, shell_complete=among(_kinds))
def schema(kind: str | None) -> int:
    """Print the JSON Schema of scenes: of one KIND, or of all."""
    from dynid.scene.kind import KINDS
    from dynid.suggestions import did_you_mean

    if kind is not None and kind not in KINDS:
        raise UsageError(
            f"no kind '{kind}'{did_you_mean(kind, KINDS)}", remedy=f"There are {', '.join(KINDS)}."
        )
    click.echo(schema_text(kind))
    return 0


def schema_text(kind: str | None = None) -> str:
    """Return the JSON Schema of the scenes of a kind, or of all kinds, in the words of draft 7."""
    from dynid.scene.kind import KINDS
    from dynid.scene.schema.json_schema import scene_schema

    schemas = [scene_schema(KINDS[name].load("model")) for name in ([kind] if kind else KINDS)]
    if len(schemas) == 1:
        document = schemas[0]
    else:
        definitions = {name: part for one in schemas for name, part in one.pop("$defs", {}).items()}
        document = {"oneOf": schemas, "$defs": definitions}
    return json.dumps({"$schema": "http://json-schema.org/draft-07/schema#", **document}, indent=2)
