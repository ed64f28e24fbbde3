"""`dynid show`."""

from __future__ import annotations

import click

from dynid.cli.foreign import reads_results


@click.command()
@click.argument("file", type=click.Path())
@click.option("--all", "everything", is_flag=True, help="List every array, with its axes and units.")
@reads_results("file")
def show(file: str, everything: bool) -> int:
    """Print the summary of a result again: of a run, a plan, a study or a benchmark.

    Of a study that was interrupted it shows what is there.
    """
    from dynid.cli.summary import contents, summary
    from dynid.store import open_stored, read_result

    # Of a study only what the screen needs is read; it may be one that was interrupted.
    with open_stored(file, partial=True) as stored:
        result = stored if stored.kind == "study" else read_result(file)
        click.echo(summary(result, str(result.attrs.get("created", ""))))
        if everything:
            click.echo("\n" + contents(result))
    return 0
