"""`dynid plan`."""

from __future__ import annotations

import time
from pathlib import Path

import click

from dynid.cli.arguments import refuse_missing_folders, refuse_overwriting
from dynid.errors import FileError, NumericalError, UsageError


@click.command()
@click.argument("scene", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="Write the plan to this HDF5 file.")
@click.option(
    "--sensors",
    type=click.IntRange(1, 1000),
    metavar="N",
    help="Number of sensors; default: as many as the scene has.",
)
@click.option(
    "--lines",
    type=click.IntRange(1, 1000),
    metavar="N",
    help="Number of sines; default: as many as the scene has if all its forces are sines, else 3.",
)
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the scene; repeatable."
)
@click.option("-q", "--quiet", is_flag=True, help="Print only errors.")
def plan(
    scene: str,
    output: str | None,
    sensors: int | None,
    lines: int | None,
    overrides: tuple[str, ...],
    quiet: bool,
) -> int:
    """Rank sensors and excitation by the Cramér–Rao bounds they give.

    Prints the Cramér–Rao bound of each unknown parameter, before the measurement, and the sensors and the
    sines that would give the lowest bounds. Nothing is identified.

    \b
    Example:
      dynid plan suspension.yaml --sensors 3
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.progress import showing
    from dynid.cli.run import LocatedError
    from dynid.scene.kinds.planning import run_plan
    from dynid.scene.load import load_scene

    started = time.perf_counter()
    loaded = load_scene(scene, overrides)
    if output:
        refuse_overwriting(scene, output, None)
        refuse_missing_folders(output)
    try:
        with showing(quiet):
            result = run_plan(loaded, sensors, lines)
    except (NumericalError, UsageError, FileError) as error:
        raise LocatedError(loaded, error) from error
    if output:
        from dynid.store import write_result

        write_result(result, Path(output))
    if not quiet:
        from dynid.cli.summary import summary

        click.echo(summary(result, f"{time.perf_counter() - started:.2g} s"))
        if output:
            click.echo(f"\n  wrote {output}")
    return 0
