"""`dynid demo`: a tour of the commands in a folder of its own."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

#: The steps: what they show, and the command.
_STEPS = (
    ("A scene of a motor that drives a load through a gear, as a bond graph:", "new bond-graph"),
    ("Its transfer function, poles, zeros and responses, and a report for a browser:",
     "run bond-graph.yaml --report bond-graph.html"),
    ("A study of what tolerances do to it:", "new study"),
    ("50 samples in one file; those that are done are kept if it is interrupted:", "study study.yaml"),
    ("A chain of masses with two unknown joints, and a simulated record of two sensors:",
     "new identification"),
    ("Stiffness and damping of the joints, with error bars and a verdict:", "run identification.yaml"),
)  # fmt: skip


@click.command()
@click.option(
    "-o", "--output", type=click.Path(), help="An empty folder for the files; default: a temporary one."
)
def demo(output: str | None) -> int:
    """Run a tour: write two scenes, run them, and show what comes out.

    The files stay, to be read and changed.
    """
    from dynid.cli import cli
    from dynid.errors import FileError

    folder = Path(output or tempfile.mkdtemp(prefix="dynid-demo-"))
    folder.mkdir(exist_ok=True)
    if any(folder.iterdir()):
        raise FileError(f"{folder} is not empty", remedy="Name another folder with -o.", names=[str(folder)])
    with _working_in(folder):
        for text, command in _STEPS:
            click.echo(f"\n{text}\n\n$ dynid {command}")
            cli.main(command.split(), prog_name="dynid", standalone_mode=False)
    click.echo(
        f"\nThe files are in {folder}: open bond-graph.html in a browser, change a scene, run it again."
    )
    click.echo("Further: dynid new (templates), dynid help (manual), dynid library (models of machines)")
    return 0


@contextmanager
def _working_in(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
