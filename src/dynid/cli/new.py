"""`dynid new`."""

from __future__ import annotations

from pathlib import Path

import click

from dynid.errors import FileError, UsageError

#: The template that is generated, of any length.
_CHAIN = "chain"
#: What editors complete keys from, beside the scene.
_SCHEMA = "dynid.schema.json"


@click.command()
@click.argument("name")
@click.option("-o", "--output", type=click.Path(), help="The file to write; default ./NAME.yaml.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--no-schema", is_flag=True, help=f"Write no {_SCHEMA}, which editors complete keys from.")
@click.option(
    "--from", "netlist", type=click.Path(), help="bond-graph: the graph of a .bg netlist of BondGraphTools."
)
@click.option("--stages", type=click.IntRange(1, 10_000), help="chain: how many stages (default 10).")
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
    identification  joints of a chain of masses, from a record
    reduction       reductions of a beam, compared
    structure       frequency and time response of a chain of masses
    study           many runs of the scene bond-graph, with other values
    chain           a bond graph of any length: --stages N masses, springs and dampers
    """  # noqa: D301 - click's mark against wrapping
    from importlib.resources import files

    from dynid.atomic import replace_file
    from dynid.words import did_you_mean

    folder = files("dynid.templates")
    names = sorted(
        item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")
    )
    names.append(_CHAIN)
    if name not in names:
        raise UsageError(
            f"no template '{name}'{did_you_mean(name, names)}", remedy=f"There are {', '.join(names)}."
        )
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
    if name == _CHAIN:
        from dynid.templates.chain import chain_scene

        written = chain_scene(stages or 10, vary=distinct).encode()
    elif netlist is not None:
        from dynid.scene.netlists import read_netlist

        written = read_netlist(netlist).encode()
    else:
        written = folder.joinpath(f"{name}.yaml").read_bytes()
    if no_schema:
        replace_file(str(target), written)
    else:
        replace_file(str(target), f"# yaml-language-server: $schema={_SCHEMA}\n".encode() + written)
        _write_schema(target.parent / _SCHEMA)
    click.echo(f"wrote {target}; run it: dynid {'study' if name == 'study' else 'run'} {target}")
    return 0


def _write_schema(target: Path) -> None:
    """Write the schema that the scene names, unless it stands there as it is."""
    from dynid.atomic import replace_file
    from dynid.cli.schema import schema_text

    written = f"{schema_text()}\n".encode()
    if not target.is_file() or target.read_bytes() != written:
        replace_file(str(target), written)
        click.echo(f"wrote {target}, from which editors complete its keys")
