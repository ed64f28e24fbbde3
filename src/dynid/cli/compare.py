"""`dynid compare`."""

from __future__ import annotations

import click

from dynid.cli.foreign import reads_results


@click.command()
@click.argument("first", type=click.Path())
@click.argument("second", type=click.Path())
@click.option(
    "--rtol",
    type=click.FloatRange(min=0),
    default=1e-9,
    metavar="R",
    show_default=True,
    help="Relative tolerance.",
)
@click.option(
    "--atol",
    type=click.FloatRange(min=0),
    default=0.0,
    metavar="A",
    show_default=True,
    help="Absolute tolerance.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing; the exit code tells.")
@reads_results("first", "second")
def compare(first: str, second: str, rtol: float, atol: float, quiet: bool) -> int:
    """List the differences between two results; exit code 1 if there are any.

    Provenance (versions, creation time, the scene's text) is not compared.
    """
    from dynid.checks import compare as differences_between
    from dynid.number_format import counted
    from dynid.store import open_stored

    with open_stored(first) as one, open_stored(second) as other:
        differences = differences_between(one, other, rtol, atol)
    if not quiet:
        for difference in differences:
            click.echo(str(difference))
        click.echo(counted(len(differences), "difference") if differences else "no differences")
    return 1 if differences else 0
