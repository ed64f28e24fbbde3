"""`dynid inspect`: what is in a file, and the lines of a scene that read it."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command()
@click.argument("file", type=click.Path())
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def inspect(file: str, as_json: bool) -> int:
    """List what is in a data file: channels, matrices, nodes, meshes, frequency responses, modes.

    Each has its size; channels also their unit, sampling step and first time (s). Below stand lines of a
    scene that read the file, to be completed where they have … . The file is one of any format that scenes
    name: tables, recordings, Universal Files, MATLAB, HDF5 with results of dynid, matrices and meshes of FE
    programs. Exit code 4: it cannot be read.

    \b
    Examples:
      dynid inspect run.tdms
      dynid inspect model.mat --json
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.text import aligned, folded
    from dynid.files.contents import contents_of
    from dynid.number_format import general
    from dynid.suggestions import printable

    contents = contents_of(Path(file))
    if as_json:
        entries = [
            {key: value for key, value in entry._asdict().items() if value not in ("", None)}
            for entry in contents.entries
        ]
        content = {"file": file, **contents._asdict(), "entries": entries}
        click.echo(json.dumps(content, ensure_ascii=False, indent=2))
        return 0
    click.echo(f"{file}: {contents.format}\n")
    rows = [
        [
            printable(entry.name),
            entry.what,
            entry.size,
            entry.unit,
            "" if entry.step is None else f"{entry.step:.9g}",
            "" if entry.start is None else general(entry.start, 9),
            printable(entry.note),
        ]
        for entry in contents.entries
    ]
    rows.insert(0, ["name", "what", "size", "unit", "step [s]", "start [s]", ""])
    used = [k for k in range(len(rows[0])) if any(row[k] for row in rows[1:])]
    click.echo("\n".join(aligned([[row[k] for k in used] for row in rows], "  ", {0, 1, 3, len(used) - 1})))
    if contents.scene:
        click.echo("\nIn a scene:\n")
        for line in "\n".join(contents.scene).split("\n"):
            click.echo(f"  {line}")
    for fault in contents.faults:
        click.echo("\n".join(folded(f"\nnot read: {fault}")))
    return 0
