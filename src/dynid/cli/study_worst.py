"""`dynid study-worst`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from dynid.study.analysis.worst import Direction


@click.command()
@click.argument("file", type=click.Path())
@click.argument("path")
@click.option("-o", "--output", type=click.Path(), required=True, help="The scene to write.")
@click.option("--max", "direction", flag_value="max", default=True, help="The largest is worst (default).")
@click.option("--min", "direction", flag_value="min", help="The smallest is worst.")
@click.option("--abs", "direction", flag_value="abs", help="What is farthest from 0 is worst.")
def study_worst(file: str, path: str, output: str, direction: Direction) -> int:
    """Write the scene of the worst sample of a study, to be run alone.

    PATH is what is judged: a number that the study gathered, as in study/results, an array of them, or one
    entry of it as PATH[LABEL].
    """
    from dynid.atomic import replace_file
    from dynid.cli.run import is_same, refuse_missing_folders
    from dynid.errors import UsageError
    from dynid.store import open_stored
    from dynid.study.worst import worst_scene

    if is_same(output, file):
        raise UsageError(f"the scene would overwrite the study {file}", remedy="Name another file with -o.")
    refuse_missing_folders(output)
    chosen = "" if direction == "max" else f" --{direction}"
    command = f"dynid study-worst {Path(file).name} {path}{chosen}"
    with open_stored(file, partial=True) as result:
        text = worst_scene(result, path, direction, Path(output).parent, command)
    replace_file(output, text.encode())
    click.echo("\n".join(line[2:] for line in text.splitlines()[:1]))
    click.echo(f"wrote {output}; run it with: dynid run {output}")
    return 0
