"""Commands on results: show, report, plot, compare and export."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import is_same, reads_results, refuse_missing_folders, refuse_unknown
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene
    from dynid.store.tables import ExportTable


@contextmanager
def _opened(file: str) -> Iterator[Result]:
    """Open a result, also of an interrupted study; of a study only what is used is read."""
    from dynid.store import loaded, open_stored

    with open_stored(file, partial=True) as stored:
        yield stored if stored.kind == "study" else loaded(stored)


@click.command()
@click.argument("file", type=click.Path())
@click.option("--all", "everything", is_flag=True, help="List every array, with its axes and units.")
@click.option("--trace", is_flag=True, help="Print the derivations, too: causality, reduction steps.")
@click.option("--json", "as_json", is_flag=True, help="Print the answer as one JSON object.")
@reads_results("file")
def show(file: str, everything: bool, trace: bool, as_json: bool) -> int:
    """Print the summary of a result: of a run, a plan, a study or a benchmark.

    For an interrupted study, the finished samples are summarized.
    """
    from dynid.cli.screen import contents, summary

    with _opened(file) as result:
        if as_json:
            from dynid.report import warnings
            from dynid.store.export import answer_json

            click.echo(answer_json(result, warnings(result)))
            return 0
        click.echo(summary(result, str(result.attrs.get("created", "")), trace=trace))
        if everything:
            click.echo("\n" + contents(result))
    return 0


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="The HTML file to write; default ./<file>.html.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors.")
@reads_results("file")
def report(file: str, output: str | None, quiet: bool) -> int:
    """Write an HTML report of a result: its summary, figures, tables, scene and provenance.

    The report is one file that needs no network. For an interrupted study, it shows the finished samples.
    """
    from dynid.cli.progress import showing

    target = output or f"{Path(file).stem}.html"
    if is_same(target, file):
        raise UsageError(f"the page would overwrite the result {file}", remedy="Name another file with -o.")
    refuse_missing_folders(target)
    with showing(quiet), _opened(file) as result:
        write_page(result, target)
    if not quiet:
        click.echo(f"wrote {target}")
    return 0


def write_page(result: Result, target: str) -> None:
    """Write the page of a result, whole or not at all."""
    from dynid.file_access import replace_file
    from dynid.report.page import page

    replace_file(target, page(result).encode())


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o",
    "--output",
    type=click.Path(),
    help="The folder for the figures, created if needed; default ./<FILE>-figures.",
)
@click.option(
    "--format", "form", type=click.Choice(["svg", "png", "pdf"]), default="svg", show_default=True,
    help="The file format.",
)  # fmt: skip
@click.option("--figure", "names", multiple=True, metavar="NAME", help="Write this figure only; repeatable.")
@click.option("--list", "listing", is_flag=True, help="List the figures.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors.")
@reads_results("file")
def plot(file: str, output: str | None, form: str, names: tuple[str, ...], listing: bool, quiet: bool) -> int:
    """Write the figures of a result, one file each."""
    from dynid.cli.progress import showing
    from dynid.file_access import file_names, remove_parts, replace_file
    from dynid.progress import tracked
    from dynid.report import figures
    from dynid.report.figure import as_file

    with _opened(file) as result:
        by_name = {figure.name: figure for figure in figures(result)}
        if listing:
            width = max(map(len, by_name), default=0)
            for figure in by_name.values():
                click.echo(f"  {figure.name:{width}}  {figure.title}")
            return 0
        folder = Path(output if output is not None else f"{Path(file).stem}-figures")
        for name in names:
            refuse_unknown(name, by_name, "figure", "List them with --list.")
        chosen = [by_name[name] for name in dict.fromkeys(names)] or list(by_name.values())
        files = file_names([figure.name for figure in chosen])
        targets = [folder / f"{name}.{form}" for name in files]
        remove_parts(folder)
        with showing(quiet):
            for figure, target in zip(tracked(chosen, "figure"), targets, strict=True):
                content = as_file(figure.svg, form)
                _made(folder, parents=True)
                replace_file(target, content)
    if not quiet:
        click.echo("\n".join(f"wrote {target}" for target in targets))
    return 0


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
@click.option(
    "--elementwise", is_flag=True, help="Compare each entry of arrays of one quantity by its own size, too."
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing; only the exit code reports differences.")
@reads_results("first", "second")
def compare(first: str, second: str, rtol: float, atol: float, elementwise: bool, quiet: bool) -> int:
    """List the differences between two results; exit code 1 if there are any.

    Numbers x and y agree where |x - y| <= A + R max(|x|, |y|). In arrays of one quantity (responses, shapes,
    MAC, matrices) the maximum is that of the whole array; parameters, frequencies, poles, zeros, coefficients
    and scalars are compared entry by entry, with --elementwise all.

    Provenance (versions, creation time, the scene's text) is not compared. Of two identifications of one
    record, the likelihood ratio and the BIC are printed, too: which model the record prefers, by how much.
    """
    from dynid.checks import compare as differences_between
    from dynid.checks.comparison import compare_identifications
    from dynid.cli.text import folded
    from dynid.number_format import counted
    from dynid.store import open_stored

    with open_stored(first) as one, open_stored(second) as second_result:
        differences = differences_between(one, second_result, rtol, atol, elementwise=elementwise)
        compared = compare_identifications(one, second_result) if differences and not quiet else []
    if not quiet:
        of_method = [one for one in differences if one.of_method]
        click.echo(counted(len(differences), "difference") if differences else "no differences")
        for difference in differences:
            if not difference.of_method:
                click.echo("\n".join(folded(f"  {difference}")))
        if of_method:
            click.echo(f"  {len(of_method)} in error bounds and in what was left out, which are not listed")
        if compared:
            click.echo("\n".join(["", *compared]))
    return 1 if differences else 0


#: Suffixes of scenes, of which some formats are.
_SCENES = (".yaml", ".yml")
#: Formats of systems (transfer functions, matrices, modes) instead of tables.
_SYSTEMS = ("json", "mat", "mtx", "uff")


@click.command()
@click.argument("file", type=click.Path())
@click.option("--csv", "form", flag_value="csv", help="Write CSV: units in the header, missing values empty.")
@click.option("--parquet", "form", flag_value="parquet", help="Write Parquet, with units in the metadata.")
@click.option("--json", "form", flag_value="json", help="Write the transfer functions as JSON.")
@click.option("--mat", "form", flag_value="mat", help="Write state equations and reduced models for MATLAB.")
@click.option("--mtx", "form", flag_value="mtx", help="Write the matrices of reduced models, one file each.")
@click.option(
    "--state-space",
    "form",
    flag_value="state-space",
    help="Write the state equations of a result, or of a scene, as .mat or .npz; delays in linear "
    "fractional form.",
)
@click.option("--c", "form", flag_value="c", help="Write the sampled controllers of a scene as C functions.")
@click.option(
    "--uff", "form", flag_value="uff", help="Write the modes of a modal analysis as a Universal File (55)."
)
@click.option(
    "--scene",
    "form",
    flag_value="scene",
    help="Write the identified or designed scene, with its values, or the bond graph of a synthesis.",
)
@click.option(
    "--form", "realisation", metavar="FORM", help="The form of a synthesis to write; default, its first."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(),
    help="The file to write, or the folder for several tables; default ./<FILE> with the new suffix.",
)
@click.option(
    "--long", "long", is_flag=True, help="For a study, too: one table per group, one row per entry."
)
@click.option("--table", "name", metavar="GROUP", help="Write only the table of this group.")
@reads_results("file")
def export(
    file: str, form: str | None, realisation: str | None, output: str | None, long: bool, name: str | None
) -> int:
    """Write a result in a format of other tools: as tables, as systems, or as a scene.

    A study gives one table with one row per sample. Any other result gives one table per group, with one row
    per entry of its arrays; complex numbers take two columns, .re and .im. Of an identification, --scene
    writes the scene with the estimates in place of the unknowns; of a design, the scene with the designed
    values; of a synthesis, the bond graph of a form. --state-space also takes a scene of a bond graph, which
    is run for its state equations; --c takes a scene, whose sampled controllers it writes. One of the
    formats --csv, --parquet, --json, --mat, --mtx, --uff, --state-space, --c and --scene is required.

    \b
    Examples:
      dynid export tolerances.h5 --csv
      dynid export isolator.h5 --csv --table bond_graph/frequency_response
      dynid export isolator.h5 --json
      dynid export joints.h5 --scene -o identified.yaml
      dynid export impedance.h5 --scene --form foster
      dynid export servo.yaml --state-space -o servo.npz
      dynid export motor_sampled.yaml --c -o controller.c
    """  # noqa: D301 - click's mark against wrapping
    if form is None:
        raise UsageError(
            "no format to export is given",
            remedy="Pass --csv, --parquet, --json, --mat, --mtx, --uff, --state-space, --c or --scene.",
        )
    if realisation is not None and form != "scene":
        raise UsageError("--form names the form of a scene", remedy="Pass --scene, too.")
    if form in _SYSTEMS:
        _export_systems(file, form, output)
        return 0
    if form == "scene":
        _export_scene(file, output, realisation)
        return 0
    if form == "state-space":
        _export_state_space(file, output)
        return 0
    if form == "c":
        _export_controllers(file, output)
        return 0
    from dynid.file_access import file_names, remove_parts
    from dynid.store import open_stored
    from dynid.store.tables import tables_of, write_csv, write_parquet

    write = write_csv if form == "csv" else write_parquet
    stem = Path(file).stem
    with open_stored(file, partial=True) as result:
        if name is not None:
            table = _table_named(tables_of(result), name)
            target = output or f"{file_names([table.name])[0]}.{form}"
        elif result.kind == "study" and not long:
            from dynid.study.analysis.table import StudyTable, flat_table

            table = flat_table(StudyTable(result), stem)
            target = output or f"{stem}.{form}"
        else:
            folder = _made(Path(output or stem))
            remove_parts(folder)
            tables = tables_of(result)
            for table, file_name in zip(tables, file_names([table.name for table in tables]), strict=True):
                target = str(folder / f"{file_name}.{form}")
                write(table, target)
                click.echo(f"wrote {target}")
            return 0
        _refuse_overwriting(target, file)
        remove_parts(Path(target).parent)
        write(table, target)
        click.echo(f"wrote {target}")
    return 0


def _export_scene(file: str, output: str | None, realisation: str | None) -> None:
    from dynid.file_access import replace_file
    from dynid.scene.identified import designed_scene_text, holds_design, identified_scene
    from dynid.store import read_result

    result, stem = read_result(file), Path(file).stem
    if result.kind == "synthesis":
        from dynid.scene.kinds.synthesis import exported_scene

        form, text = exported_scene(result, realisation)
        target, note = output or f"{stem}.{form}.yaml", f"the {form} form"
    elif realisation is not None:
        raise UsageError(f"{file} is no synthesis, which alone has forms", remedy="Leave --form out.")
    elif holds_design(result):
        text = designed_scene_text(result, file)
        target, note = output or f"{stem}.designed.yaml", "names of files in it are relative to its folder"
    else:
        text = identified_scene(result, file)
        target, note = output or f"{stem}.identified.yaml", "names of files in it are relative to its folder"
    _refuse_overwriting(target, file)
    replace_file(target, text.encode())
    click.echo(f"wrote {target}; {note}")


def _export_systems(file: str, form: str, output: str | None) -> None:
    from dynid.file_access import file_names, remove_parts, replace_file
    from dynid.store import export, read_result

    result, stem = read_result(file), Path(file).stem
    if form == "mtx":
        folder = _made(Path(output or stem))
        files = export.matrix_market_files(result)
        names = file_names([name.removesuffix(".mtx") for name in files])
        contents = {
            folder / f"{name}.mtx": content for name, content in zip(names, files.values(), strict=True)
        }
    else:
        target = output or f"{stem}.{form}"
        _refuse_overwriting(target, file)
        write = {
            "json": export.transfer_functions_json,
            "mat": export.matlab_file,
            "uff": export.universal_modes,
        }[form]
        contents = {Path(target): write(result)}
    for folder in {path.parent for path in contents}:
        remove_parts(folder)
    for path, content in contents.items():
        replace_file(path, content)
        click.echo(f"wrote {path}")


def _export_state_space(file: str, output: str | None) -> None:
    from dynid.file_access import remove_parts, replace_file
    from dynid.store import export, read_result

    target = Path(output or f"{Path(file).stem}.mat")
    if target.suffix not in (".mat", ".npz"):
        raise UsageError(f"state equations are not written as '{target.suffix}'", remedy="Use .mat or .npz.")
    if Path(file).suffix in _SCENES:
        from dynid.scene.load import load_scene
        from dynid.scene.run import run_scene

        _refuse_other_kinds(
            load_scene(file),
            "bond graphs have state equations",
            "Of a reduction export the matrices of its result: --mtx or --mat.",
        )
        result = run_scene(load_scene(file, ["analysis.results=[state_space]"]))
    else:
        result = read_result(file)
    content = export.state_space_file(result, target.suffix)
    _refuse_overwriting(str(target), file)
    remove_parts(target.parent)
    replace_file(target, content)
    click.echo(f"wrote {target}")


def _export_controllers(file: str, output: str | None) -> None:
    from dynid.file_access import replace_file

    if Path(file).suffix not in _SCENES:
        raise UsageError(
            f"{file} is no scene, which alone has controllers to write in C",
            remedy="Export the scene (.yaml); that of a design: dynid export RESULT --scene.",
        )
    from dynid.scene.load import load_scene

    scene = load_scene(file)
    _refuse_other_kinds(scene, "bond graphs have controllers", "Export a scene with 'control'.")
    from dynid.scene.kinds.controller_code import controller_code

    code, target = controller_code(scene), output or f"{Path(file).stem}.c"
    _refuse_overwriting(target, file)
    replace_file(target, code.encode())
    click.echo(f"wrote {target}")


def _refuse_other_kinds(scene: Scene, reason: str, remedy: str) -> None:
    """Raise where a scene is none of a bond graph."""
    if scene.kind != "bond-graph":
        raise UsageError(f"{scene.source.file} is a scene of kind {scene.kind}; {reason}", remedy=remedy)


def _table_named(tables: list[ExportTable], name: str) -> ExportTable:
    """Return the table of a name, or the only one of a group."""
    from dynid.suggestions import did_you_mean

    dotted = name.strip("/").replace("/", ".")
    matches = [table for table in tables if table.name == dotted]
    matches = matches or [table for table in tables if table.attrs["group"].replace("/", ".") == dotted]
    if len(matches) == 1:
        return matches[0]
    names = [table.name for table in matches or tables]
    if matches:
        raise UsageError(f"{name} has several tables", remedy=f"Name one of them: {', '.join(names)}.")
    raise UsageError(
        f"there is no table '{name}'{did_you_mean(dotted, names)}", remedy=f"There are: {', '.join(names)}."
    )


def _refuse_overwriting(output: str, file: str) -> None:
    if is_same(output, file):
        raise UsageError(f"the export would overwrite the result {file}", remedy="Name another file with -o.")
    refuse_missing_folders(output)


def _made(folder: Path, parents: bool = False) -> Path:
    try:
        folder.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        problem = f"{folder} cannot be made a folder: {error.strerror or error}"
        raise FileError(problem, remedy="Name another with -o.", names=[str(folder)]) from None
    return folder
