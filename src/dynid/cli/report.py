"""`dynid report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.foreign import reads_results
from dynid.errors import UsageError

if TYPE_CHECKING:
    from dynid.result import Result


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="The page to write; default ./<file>.html.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
@reads_results("file")
def report(file: str, output: str | None, quiet: bool) -> int:
    """Write one HTML page of a result: its answer, figures, tables, scene and provenance.

    The page needs no other files and no network. Of a study that was interrupted it shows what is there.
    """
    from dynid.cli.progress import showing
    from dynid.cli.run import is_same, refuse_missing_folders
    from dynid.store import loaded, open_stored

    target = output or f"{Path(file).stem}.html"
    if is_same(target, file):
        raise UsageError(f"the page would overwrite the result {file}", remedy="Name another file with -o.")
    refuse_missing_folders(target)
    with showing(quiet), open_stored(file, partial=True) as stored:
        write_page(stored if stored.kind == "study" else loaded(stored), target)
    if not quiet:
        click.echo(f"wrote {target}")
    return 0


def write_page(result: Result, target: str) -> None:
    """Write the page of a result, whole or not at all."""
    from dynid.file_access import replace_file
    from dynid.report.page import page

    replace_file(target, page(result).encode())
