"""`dynid check`."""

from __future__ import annotations

import click

from dynid.errors import FileError, SceneError


@click.command()
@click.argument("scenes", nargs=-1, required=True, type=click.Path())
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the scenes; repeatable."
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but faults.")
def check(scenes: tuple[str, ...], overrides: tuple[str, ...], quiet: bool) -> int:
    """Read and check scenes without running them.

    Prints every fault of every scene as FILE:LINE:COLUMN: message. Exit code 0: all are valid; 2: some are
    not; 4: a file could not be read.
    """
    from dynid.scene.load import load_scene

    code = faults = 0
    for name in scenes:
        try:
            scene = load_scene(name, overrides)
        except SceneError as error:
            click.echo(str(error), err=True)
            faults += len(error.faults)
            code = max(code, error.exit_code)
        except FileError as error:
            click.echo(str(error), err=True)
            code = max(code, error.exit_code)
        else:
            if not quiet:
                click.echo(f"{name}: valid ({scene.kind}: {scene.title})")
    if faults:
        click.echo(f"{faults} fault{'s' if faults > 1 else ''}", err=True)
    return code
