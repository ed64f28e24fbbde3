"""`dynid new`."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent, indent
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import among, refuse_missing_folders, refuse_unknown
from dynid.cli.help import schema_text
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

#: Template that is generated, of any number of stages.
_CHAIN = "chain"
#: Schema file beside the scene, for completion in editors.
_SCHEMA = "dynid.schema.json"
#: Data files that templates read.
_COMPANIONS = {"record": ("record.csv",), "frf": ("frf.csv",), "study": ("bond-graph.yaml",)}


def _folder() -> Traversable:
    from importlib.resources import files

    return files("dynid.templates")


def _names() -> list[str]:
    """Return the names of the templates."""
    files = (item.name for item in _folder().iterdir())
    return [*sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")), _CHAIN]


@click.command()
@click.argument("name", required=False, shell_complete=among(_names))
@click.option("-o", "--output", type=click.Path(), help="The file to write; default ./NAME.yaml.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--no-schema", is_flag=True, help=f"Do not write {_SCHEMA}, from which editors complete keys.")
@click.option(
    "--from",
    "netlist",
    type=click.Path(),
    help="bond-graph: read the graph from a .bg netlist of BondGraphTools.",
)
@click.option(
    "--stages", type=click.IntRange(1, 10_000), metavar="N", help="chain: number of stages (default 10)."
)
@click.option("--distinct", is_flag=True, help="chain: different parameter values in every stage.")
def new(
    name: str | None,
    output: str | None,
    force: bool,
    no_schema: bool,
    netlist: str | None,
    stages: int | None,
    distinct: bool,
) -> int:
    """Write a commented template scene; without NAME, list the templates.

    \b
    bond-graph      transfer functions, zeros, poles and responses of a motor
    chain           a bond graph: masses, springs and dampers in N stages (--stages N)
    structure       modes and responses of a chain of masses with known joints
    synthesis       bond graphs with a wanted driving-point impedance
    reduction       comparison of model reductions of a beam
    identification  joints of a chain of masses, from a simulated record
    identification-graph  values of a bond graph: motor, gear, flexible shaft
    record          joints from a measured record, with its samples in record.csv
    frf             joints from measured frequency responses, stored in frf.csv
    beam            joints of a beam, identified on a reduced model
    study           a parameter study of the motor with Latin hypercube sampling
    """  # noqa: D301 - click's mark against wrapping
    from dynid.file_access import replace_file

    if name is None:
        assert new.help is not None
        click.echo("dynid new NAME, where NAME is one of\n")
        click.echo(indent(dedent(new.help.partition("\b\n")[2]).rstrip(), "  "))
        return 0
    refuse_unknown(name, _names(), "template")
    if name != _CHAIN and (stages is not None or distinct):
        raise UsageError(f"a template '{name}' has no stages", remedy=f"Use them with `dynid new {_CHAIN}`.")
    if name != "bond-graph" and netlist is not None:
        raise UsageError(
            f"a template '{name}' has no graph", remedy="Use `dynid new bond-graph --from FILE`."
        )
    target = Path(output or f"{name}.yaml")
    if target.exists() and not force:
        raise FileError(
            f"{target} exists already", remedy="Name another file with -o, or replace it with --force."
        )
    refuse_missing_folders(str(target))
    if name == _CHAIN:
        from dynid.templates.chain import chain_scene

        scene = chain_scene(stages or 10, vary=distinct).encode()
    elif netlist is not None:
        from dynid.scene.netlists import read_netlist

        scene = read_netlist(netlist).encode()
    else:
        scene = _folder().joinpath(f"{name}.yaml").read_bytes()
    if no_schema:
        replace_file(str(target), scene)
    else:
        replace_file(str(target), f"# yaml-language-server: $schema={_SCHEMA}\n".encode() + scene)
        schema, content = target.parent / _SCHEMA, f"{schema_text()}\n".encode()
        if not schema.is_file() or schema.read_bytes() != content:
            replace_file(str(schema), content)
            click.echo(f"wrote {schema} (key completion in editors)")
    for companion in (target.parent / file for file in _COMPANIONS.get(name, ())):
        if companion.exists():  # it may be the user's own file
            click.echo(f"kept {companion}, which is there already")
        else:
            replace_file(str(companion), _folder().joinpath(companion.name).read_bytes())
            click.echo(f"wrote {companion}, which the scene reads")
    click.echo(f"wrote {target}; run it: dynid {'study' if name == 'study' else 'run'} {target}")
    return 0
