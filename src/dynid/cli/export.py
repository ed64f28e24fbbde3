"""`dynid export`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.foreign import reads_results
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.store.tables import ExportTable


#: Forms of systems, which are no tables.
_SYSTEMS = ("json", "mat", "mtx")


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "--csv", "form", flag_value="csv", help="Write CSV: units in the header, what is missing empty."
)
@click.option("--parquet", "form", flag_value="parquet", help="Write Parquet, with units in the metadata.")
@click.option("--json", "form", flag_value="json", help="Write the transfer functions as JSON.")
@click.option("--mat", "form", flag_value="mat", help="Write state equations and reduced models for MATLAB.")
@click.option("--mtx", "form", flag_value="mtx", help="Write the matrices of reduced models, one file each.")
@click.option(
    "-o",
    "--output",
    type=click.Path(),
    help="The file to write; of several tables the folder. Default: ./<FILE>, with its new ending.",
)
@click.option("--long", "long", is_flag=True, help="Of a study, too: a table a group, a row an entry.")
@click.option("--table", "name", metavar="GROUP", help="Write the table of one group only, to one file.")
@reads_results("file")
def export(file: str, form: str | None, output: str | None, long: bool, name: str | None) -> int:
    """Write a result for other tools: as tables, or its systems.

    A study is one table with a row for each sample. Any other result is a table for each group, with a row
    for each entry of its arrays; complex numbers are two columns, .re and .im.
    One of the forms is to be named.

    \b
    Examples:
      dynid export tolerances.h5 --csv
      dynid export isolator.h5 --csv --table bond_graph/frequency_response
      dynid export isolator.h5 --json
    """  # noqa: D301 - click's mark against wrapping
    if form is None:
        raise UsageError(
            "say in which form to export", remedy="Pass --csv, --parquet, --json, --mat or --mtx."
        )
    if form in _SYSTEMS:
        _write_systems(file, form, output)
        return 0
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


def _chosen(tables: list[ExportTable], name: str) -> ExportTable:
    """Return the table of a name, or the only one of a group."""
    from dynid.suggestions import did_you_mean

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


def _write_one(table: ExportTable, output: str, file: str, write: Callable[[ExportTable, str], None]) -> None:
    _refuse_overwriting(output, file)
    write(table, output)
    click.echo(f"wrote {output}")


def _refuse_overwriting(output: str, file: str) -> None:
    from dynid.cli.run import is_same, refuse_missing_folders

    if is_same(output, file):
        raise UsageError(f"the export would overwrite the result {file}", remedy="Name another file with -o.")
    refuse_missing_folders(output)


def _write_systems(file: str, form: str, output: str | None) -> None:
    from dynid.store import export, read_result

    result, stem = read_result(file), Path(file).stem
    if form == "mtx":
        folder = _made(Path(output or stem))
        for name, content in export.matrix_market_files(result).items():
            _replace(folder / name, content)
    else:
        write = {"json": export.transfer_functions_json, "mat": export.matlab_file}[form]
        target = output or f"{stem}.{form}"
        _refuse_overwriting(target, file)
        _replace(Path(target), write(result))


def _replace(target: Path, content: bytes) -> None:
    from dynid.file_access import replace_file

    replace_file(target, content)
    click.echo(f"wrote {target}")


def _write_all(result: Result, folder: Path, form: str, write: Callable[[ExportTable, str], None]) -> None:
    from dynid.store.tables import tables_of

    _made(folder)
    tables = tables_of(result)
    for table in tables:
        write(table, str(folder / f"{table.name}.{form}"))
        click.echo(f"wrote {folder / f'{table.name}.{form}'}")


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(
            f"{folder} cannot be made a folder: {error.strerror or error}", names=[str(folder)]
        ) from None
    return folder
