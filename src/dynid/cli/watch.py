"""`dynid watch`."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("scene", type=click.Path())
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="N",
    help="The port of the page; default a free one.",
)
@click.option("--no-browser", is_flag=True, help="Open no browser; the address is printed.")
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the scene; repeatable."
)
@click.option("-o", "--output", type=click.Path(), help="Write the last good result to this HDF5 file, too.")
def watch(scene: str, port: int, no_browser: bool, overrides: tuple[str, ...], output: str | None) -> int:
    """Run a scene whenever it or a file that it reads changes, and show its page in the browser.

    The page is served on this machine only, until Ctrl-C. A scene with faults leaves the last good result on
    the page, with the faults and their places above it. Of a study some samples are run, evenly over its
    plan, as many as a few seconds allow.
    """
    from dynid.cli.run import refuse_missing_folders, refuse_overwriting
    from dynid.cli.watching.loop import Watch
    from dynid.cli.watching.server import serving

    if not Path(scene).is_file():
        from dynid.scene.yaml.source import read_source

        read_source(scene)  # which says what is wrong
    if output:
        refuse_overwriting(scene, output, None)
        refuse_missing_folders(output)
    with serving(port) as server:
        click.echo(f"watching {scene} at {server.address} (Ctrl-C ends)", err=True)
        if not no_browser:
            click.launch(server.address)
        Watch(scene, overrides, output, server.board).run()
    return 0
