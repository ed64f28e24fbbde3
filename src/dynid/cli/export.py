"""`dynid export`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.store.tables import Table


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "--csv", "form", flag_value="csv", help="Write CSV: units in the header, what is missing empty."
)
@click.option("--parquet", "form", flag_value="parquet", help="Write Parquet, with units in the metadata.")
@click.option(
    "-o",
    "--output",
    type=click.Path(),
    help="The file to write; of several tables the folder. Default: ./<FILE>, with its new ending.",
)
@click.option("--long", "long", is_flag=True, help="Of a study, too: a table a group, a row an entry.")
@click.option("--table", "name", metavar="GROUP", help="Write the table of one group only, to one file.")
def export(file: str, form: str | None, output: str | None, long: bool, name: str | None) -> int:
    """Write a result as tables for other tools.

    A study is one table with a row for each sample. Any other result is a table for each group, with a row
    for each entry of its arrays; complex numbers are two columns, .re and .im.
    """
    if form is None:
        raise UsageError("say in which form to export", remedy="Pass --csv or --parquet.")
    from dynid.store import open_stored
    from dynid.store.tables import tables_of, write_csv, write_parquet

    write = write_csv if form == "csv" else write_parquet
    stem = Path(file).stem
    with open_stored(file, partial=True) as result:
        if result.kind == "study" and not long and name is None:
            from dynid.study.analysis.table import StudyTable
            from dynid.study.flat import flat_table

            _write_one(flat_table(StudyTable(result), stem), output or f"{stem}.{form}", file, write)
        elif name is not None:
            chosen = _chosen(tables_of(result), name)
            _write_one(chosen, output or f"{chosen.name}.{form}", file, write)
        else:
            _write_all(result, Path(output or stem), form, write)
    return 0


def _chosen(tables: list[Table], name: str) -> Table:
    """Return the table of a name, or the only one of a group."""
    from dynid.words import did_you_mean

    wanted = name.strip("/").replace("/", ".")
    found = [table for table in tables if table.name == wanted]
    found = found or [table for table in tables if table.attrs["group"].replace("/", ".") == wanted]
    if len(found) == 1:
        return found[0]
    names = [table.name for table in found or tables]
    if found:
        raise UsageError(f"{name} has several tables", remedy=f"Name one of them: {', '.join(names)}.")
    raise UsageError(
        f"there is no table '{name}'{did_you_mean(wanted, names)}", remedy=f"There are: {', '.join(names)}."
    )


def _write_one(table: Table, output: str, file: str, write: Callable[[Table, str], None]) -> None:
    from dynid.cli.run import is_same, refuse_missing_folders

    if is_same(output, file):
        raise UsageError(f"the table would overwrite the result {file}", remedy="Name another file with -o.")
    refuse_missing_folders(output)
    write(table, output)
    click.echo(f"wrote {output}")


def _write_all(result: Result, folder: Path, form: str, write: Callable[[Table, str], None]) -> None:
    from dynid.store.tables import tables_of

    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(
            f"{folder} cannot be made a folder: {error.strerror or error}", names=[str(folder)]
        ) from None
    tables = tables_of(result)
    for table in tables:
        write(table, str(folder / f"{table.name}.{form}"))
        click.echo(f"wrote {folder / f'{table.name}.{form}'}")
