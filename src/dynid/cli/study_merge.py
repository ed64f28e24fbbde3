"""`dynid study-merge`."""

from __future__ import annotations

import click


@click.command("study-merge")
@click.argument("files", nargs=-1, required=True, type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), help="The HDF5 file to write.")
@click.option("--partial", is_flag=True, help="Write the file also where samples are missing.")
def study_merge(files: tuple[str, ...], output: str, partial: bool) -> int:
    """Put the shards of a study (dynid study --shard I/N) into one file.

    The file is the same as if the study had been run in one piece.
    """
    from dynid.cli.run import refuse_missing_folders
    from dynid.study.merge import merge_studies

    refuse_missing_folders(output)
    count = merge_studies(files, output, partial)
    click.echo(f"wrote {output}: {count} samples of {len(files)} file{'s' if len(files) > 1 else ''}")
    return 0
