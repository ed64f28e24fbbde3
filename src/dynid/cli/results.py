"""Commands that read a result: `dynid show`, `report`, `plot` and `compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import is_same, reads_results, refuse_missing_folders, refuse_unknown
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from dynid.result import Result


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
    from dynid.cli.summary import contents, summary
    from dynid.store import open_stored, read_result

    # Of a study only what the screen needs is read; it may be one that was interrupted.
    with open_stored(file, partial=True) as stored:
        result = stored if stored.kind == "study" else read_result(file)
        if as_json:
            from dynid.report.content import warnings
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
    from dynid.file_access import replace_file
    from dynid.progress import tracked
    from dynid.report import figures
    from dynid.report.figure import as_file
    from dynid.store import loaded, open_stored

    with open_stored(file, partial=True) as stored:
        every = {
            figure.name: figure for figure in figures(stored if stored.kind == "study" else loaded(stored))
        }
        if listing:
            width = max(map(len, every), default=0)
            for figure in every.values():
                click.echo(f"  {figure.name:{width}}  {figure.title}")
            return 0
        folder = Path(output if output is not None else f"{Path(file).stem}-figures")
        for name in names:
            refuse_unknown(name, every, "figure", "List them with --list.")
        chosen = [every[name] for name in dict.fromkeys(names)] or list(every.values())
        targets = [folder / f"{figure.name}.{form}" for figure in chosen]
        with showing(quiet):
            for figure, target in zip(tracked(chosen, "figure"), targets, strict=True):
                content = as_file(figure.svg, form)
                try:
                    target.parent.mkdir(parents=True, exist_ok=True)
                except OSError as error:
                    raise FileError(
                        f"{target.parent} cannot be made a folder: {error.strerror}",
                        remedy="Name another with -o.",
                    ) from error
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
@click.option("-q", "--quiet", is_flag=True, help="Print nothing; only the exit code reports differences.")
@reads_results("first", "second")
def compare(first: str, second: str, rtol: float, atol: float, quiet: bool) -> int:
    """List the differences between two results; exit code 1 if there are any.

    Provenance (versions, creation time, the scene's text) is not compared. Of two identifications of one
    record, the likelihood ratio and the BIC are printed, too: which model the record prefers, by how much.
    """
    from dynid.checks import compare as differences_between
    from dynid.checks.likelihoods import compare_identifications
    from dynid.number_format import counted
    from dynid.store import open_stored

    with open_stored(first) as one, open_stored(second) as other:
        differences = differences_between(one, other, rtol, atol)
        compared = compare_identifications(one, other) if differences and not quiet else []
    if not quiet:
        for difference in differences:
            click.echo(str(difference))
        click.echo(counted(len(differences), "difference") if differences else "no differences")
        if compared:
            click.echo("\n".join(["", *compared]))
    return 1 if differences else 0
