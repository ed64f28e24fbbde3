"""`dynid plot`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.foreign import reads_results
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from dynid.report.figure import Figure


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), help="The folder for the figures, made where it is missing."
)
@click.option(
    "--format", "form", type=click.Choice(["svg", "png", "pdf"]), default="svg", show_default=True,
    help="What the files are.",
)  # fmt: skip
@click.option("--figure", "names", multiple=True, metavar="NAME", help="Write this figure only; repeatable.")
@click.option("--list", "listing", is_flag=True, help="List the figures.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
@reads_results("file")
def plot(file: str, output: str | None, form: str, names: tuple[str, ...], listing: bool, quiet: bool) -> int:
    """Write the figures of a result as files, one each."""
    from dynid.cli.progress import showing
    from dynid.progress import tracked
    from dynid.report import figures
    from dynid.store import loaded, open_stored

    with open_stored(file, partial=True) as stored:
        every = figures(stored if stored.kind == "study" else loaded(stored))
        if listing:
            width = max((len(figure.name) for figure in every), default=0)
            for figure in every:
                click.echo(f"  {figure.name:{width}}  {figure.title}")
            return 0
        if output is None:
            raise UsageError("there is no folder for the figures", remedy="Name it with -o, or --list them.")
        chosen = _chosen(every, names)
        targets = [Path(output) / f"{figure.name}.{form}" for figure in chosen]
        with showing(quiet):
            for figure, target in zip(tracked(chosen, "figure"), targets, strict=True):
                _write(figure, target, form)
    if not quiet:
        click.echo("\n".join(f"wrote {target}" for target in targets))
    return 0


def _chosen(every: list[Figure], names: tuple[str, ...]) -> list[Figure]:
    from dynid.suggestions import did_you_mean

    known = {figure.name: figure for figure in every}
    for name in names:
        if name not in known:
            raise UsageError(
                f"there is no figure '{name}'{did_you_mean(name, known)}", remedy="List them with --list."
            )
    return [known[name] for name in dict.fromkeys(names)] or every


def _write(figure: Figure, target: Path, form: str) -> None:
    from dynid.file_access import replace_file
    from dynid.report.figure import as_file

    content = as_file(figure.svg, form)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"{target.parent} cannot be made a folder: {error.strerror}", remedy="Name another with -o."
        ) from error
    replace_file(target, content)
