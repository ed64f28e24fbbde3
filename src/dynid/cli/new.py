"""`dynid new`."""

from __future__ import annotations

from pathlib import Path

import click

from dynid.errors import FileError, UsageError


@click.command()
@click.argument("name")
@click.option("-o", "--output", type=click.Path(), help="The file to write; default ./NAME.yaml.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
def new(name: str, output: str | None, force: bool) -> int:
    """Write a commented template scene to start from.

    \b
    bond-graph      transfer functions, zeros, poles and responses of a motor
    identification  joints of a chain of masses, from a record
    structure       frequency and time response of a chain of masses
    """  # noqa: D301 - click's mark against wrapping
    from importlib.resources import files

    from dynid.atomic import replace_file
    from dynid.words import did_you_mean

    folder = files("dynid.templates")
    names = sorted(
        item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")
    )
    if name not in names:
        raise UsageError(
            f"no template '{name}'{did_you_mean(name, names)}", remedy=f"There are {', '.join(names)}."
        )
    target = Path(output or f"{name}.yaml")
    if target.exists() and not force:
        raise FileError(
            f"{target} exists already", remedy="Name another file with -o, or replace it with --force."
        )
    replace_file(str(target), folder.joinpath(f"{name}.yaml").read_bytes())
    click.echo(f"wrote {target}; run it: dynid run {target}")
    return 0
