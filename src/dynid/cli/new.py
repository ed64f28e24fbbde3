"""`dynid new`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.completion import among
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

#: The template that is generated, of any length.
_CHAIN = "chain"
#: Schema file beside the scene, for completion in editors.
_SCHEMA = "dynid.schema.json"
#: Data files that templates read.
_COMPANIONS = {"record": ("record.csv",), "frf": ("frf.csv",), "study": ("bond-graph.yaml",)}


def _names() -> list[str]:
    """Return the templates there are."""
    files = (item.name for item in _folder().iterdir())
    return [*sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")), _CHAIN]


@click.command()
@click.argument("name", shell_complete=among(_names))
@click.option("-o", "--output", type=click.Path(), help="The file to write; default ./NAME.yaml.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--no-schema", is_flag=True, help=f"Write no {_SCHEMA}, which editors complete keys from.")
@click.option(
    "--from", "netlist", type=click.Path(), help="bond-graph: the graph of a .bg netlist of BondGraphTools."
)
@click.option(
    "--stages", type=click.IntRange(1, 10_000), metavar="N", help="chain: how many stages (default 10)."
)
@click.option("--distinct", is_flag=True, help="chain: every stage with values of its own.")
def new(
    name: str,
    output: str | None,
    force: bool,
    no_schema: bool,
    netlist: str | None,
    stages: int | None,
    distinct: bool,
) -> int:
    """Write a commented template scene to start from.

    \b
    bond-graph      transfer functions, zeros, poles and responses of a motor
    chain           a bond graph of any length: --stages N masses, springs and dampers
    structure       modes and responses of a chain of masses whose joints are known
    reduction       reductions of a beam, compared
    identification  joints of a chain of masses, from a simulated record
    record          joints from a measured record, with its samples in record.csv
    frf             joints from measured frequency responses, with these in frf.csv
    beam            joints of a beam, identified on a reduced model
    study           one scene, many values: a Latin hypercube over the motor
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.run import refuse_missing_folders
    from dynid.file_access import replace_file

    _refuse_options(name, netlist, chained=stages is not None or distinct)
    target = Path(output or f"{name}.yaml")
    if target.exists() and not force:
        raise FileError(
            f"{target} exists already", remedy="Name another file with -o, or replace it with --force."
        )
    refuse_missing_folders(str(target))
    written = _scene(name, netlist, stages or 10, vary=distinct)
    if no_schema:
        replace_file(str(target), written)
    else:
        replace_file(str(target), f"# yaml-language-server: $schema={_SCHEMA}\n".encode() + written)
        _write_schema(target.parent / _SCHEMA)
    for companion in _COMPANIONS.get(name, ()):
        _write_companion(target.parent / companion)
    click.echo(f"wrote {target}; run it: dynid {'study' if name == 'study' else 'run'} {target}")
    return 0


def _refuse_options(name: str, netlist: str | None, *, chained: bool) -> None:
    """Refuse a template that is not there, and options that are another's."""
    names = _names()
    if name not in names:
        from dynid.suggestions import did_you_mean

        raise UsageError(
            f"no template '{name}'{did_you_mean(name, names)}", remedy=f"There are {', '.join(names)}."
        )
    if name != _CHAIN and chained:
        raise UsageError(f"a template '{name}' has no stages", remedy=f"Use them with `dynid new {_CHAIN}`.")
    if name != "bond-graph" and netlist is not None:
        raise UsageError(
            f"a template '{name}' has no graph", remedy="Use `dynid new bond-graph --from FILE`."
        )


def _scene(name: str, netlist: str | None, stages: int, *, vary: bool) -> bytes:
    """Return the text of a template."""
    if name == _CHAIN:
        from dynid.templates.chain import chain_scene

        return chain_scene(stages, vary=vary).encode()
    if netlist is not None:
        from dynid.scene.netlists import read_netlist

        return read_netlist(netlist).encode()
    return _folder().joinpath(f"{name}.yaml").read_bytes()


def _folder() -> Traversable:
    from importlib.resources import files

    return files("dynid.templates")


def _write_companion(target: Path) -> None:
    """Write a file that a template reads; one that is there may be the user's own, and stays."""
    from dynid.file_access import replace_file

    if target.exists():
        click.echo(f"kept {target}, which is there already")
        return
    replace_file(str(target), _folder().joinpath(target.name).read_bytes())
    click.echo(f"wrote {target}, which the scene reads")


def _write_schema(target: Path) -> None:
    """Write the schema that the scene names, unless it stands there as it is."""
    from dynid.cli.schema import schema_text
    from dynid.file_access import replace_file

    written = f"{schema_text()}\n".encode()
    if not target.is_file() or target.read_bytes() != written:
        replace_file(str(target), written)
        click.echo(f"wrote {target}, from which editors complete its keys")
