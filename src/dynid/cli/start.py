"""Commands of the first minutes: new, demo, doctor, help, library and schema."""

from __future__ import annotations

import json
import os
import platform
import re
import sys
import tempfile
from collections.abc import Mapping
from contextlib import chdir
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from textwrap import dedent, indent
from typing import TYPE_CHECKING

import click

from dynid._version import __version__
from dynid.cli.arguments import among, refuse_missing_folders, refuse_unknown
from dynid.errors import FileError, UsageError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

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

    folder = Path(output or tempfile.mkdtemp(prefix="dynid-demo-"))
    folder.mkdir(exist_ok=True)
    if any(folder.iterdir()):
        raise FileError(f"{folder} is not empty", remedy="Name another folder with -o.", names=[str(folder)])
    with chdir(folder):
        for text, command in _STEPS:
            click.echo(f"\n{text}\n\n$ dynid {command}")
            cli.main(command.split(), prog_name="dynid", standalone_mode=False)
    click.echo(
        f"\nThe files are in {folder}: open bond-graph.html in a browser, change a scene, run it again."
    )
    click.echo("Further: dynid new (templates), dynid help (manual), dynid library (models of machines)")
    return 0


#: Extras that are of use to users; the others are for development.
_EXTRAS = {
    "solvers": "faster factorisations of large structures",
    "formats": "Universal Files, Nastran files, Parquet",
    "laboratory": "meshes, NetCDF",
    "ansys": "matrices of Ansys (.full)",
    "figures": "figures as PDF and PNG",
    "pandas": "results as tables of pandas",
    "recorders": "files of recorders: TDMS, MF4, Parquet, .xlsx",
    "posterior": "checks of importance samples",
    "xarray": "results as datasets of xarray",
    "cluster": "studies on a cluster",
}
_REQUIREMENT = re.compile(r"(?P<name>[A-Za-z0-9_.-]+)(?:\[[^]]*\])?\s*(?P<bound>[^;]*)(?:;(?P<marker>.*))?")
_EXTRA = re.compile(r"""extra\s*==\s*['"](\w+)['"]""")


#: Modules of packages that have other names.
_MODULES = {"python-flint": "flint", "pyyaml": "yaml"}


@click.command()
def doctor() -> int:
    """Report versions, optional packages and folders, and what is wrong with them.

    Exit code 3: a required package is missing or cannot be loaded.
    """
    from dynid.cli.text import folded

    def echo(line: str) -> None:
        click.echo("\n".join(folded(line)))

    echo(f"dynid {__version__} on Python {platform.python_version()}, {platform.platform()}")
    echo(f"  {sys.executable}, {os.cpu_count()} processors\n")
    required, extras = _requirements()
    broken = []
    for name in required:
        cause = _import_fault(_MODULES.get(name, name))
        echo(f"  {name:<18} {_version(name) or 'MISSING'}{f' ({cause})' if cause else ''}")
        broken += [name] if cause else []
    click.echo("")
    for extra, use in _EXTRAS.items():
        lacking = [name for name in extras.get(extra, ()) if not _version(name)]
        state = f"not installed: pip install 'dynid[{extra}]'" if lacking else "installed"
        echo(f"  {extra:<18} {use}: {state}")
    click.echo("")
    folder = tempfile.gettempdir()
    try:
        with tempfile.TemporaryFile(dir=folder):
            fault = ""
    except OSError as error:
        fault = error.strerror or str(error)
    echo(f"  {'temporary files':<18} {folder}{f' (not writable: {fault})' if fault else ''}")
    echo(f"  {'compiled library':<18} {_library()}")
    click.echo(f"  {'threads':<18} {os.environ['OPENBLAS_NUM_THREADS']} for linear algebra\n")
    for name in broken:
        click.echo(f"  problem: {name} cannot be loaded: pip install --force-reinstall {name}")
    if fault:
        click.echo("  problem: no folder for temporary files: set TMPDIR to one that is writable")
    if not broken and not fault:
        click.echo("  no problems found")
    return 3 if broken else 0


def _requirements() -> tuple[list[str], dict[str, list[str]]]:
    """Return the names of the required packages, and those of each extra."""
    required: list[str] = []
    extras: dict[str, list[str]] = {}
    for text in requires("dynid") or ():
        parts = _REQUIREMENT.fullmatch(text)
        assert parts is not None
        extra = _EXTRA.search(parts["marker"] or "")
        names = required if extra is None else extras.setdefault(extra[1], [])
        if parts["name"] not in names:
            names.append(parts["name"])
    return required, extras


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _import_fault(module: str) -> str:
    """Return the reason why a module cannot be imported, or ''."""
    try:
        import_module(module)
    except Exception as error:  # a damaged installation fails in any way
        return " ".join(f"{type(error).__name__}: {error}".split())
    return ""


def _library() -> str:
    """Return where the library of compiled loops is, or what to do without it."""
    from dynid.native import found

    loaded = found()
    if loaded is None:
        return "absent, NumPy is used, which is slower: install dynid again where there is a C compiler"
    return f"{loaded._name}, made when dynid was installed: no run compiles anything"


#: Template that is generated, of any number of stages.
_CHAIN = "chain"
#: Schema file beside the scene, for completion in editors.
_SCHEMA = "dynid.schema.json"
#: Data files that templates read.
_COMPANIONS = {
    "record": ("record.csv",),
    "frf": ("frf.csv",),
    "modal-analysis": ("frf.csv",),
    "study": ("bond-graph.yaml",),
}


def _folder() -> Traversable:
    from importlib.resources import files

    return files("dynid.templates")


def _names() -> list[str]:
    files = (item.name for item in _folder().iterdir())
    return [*sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")), _CHAIN]


@click.command()
@click.argument("name", required=False, shell_complete=among("dynid.cli.start:_names"))
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
    bond-graph            transfer functions, poles and responses of a motor
    chain                 a bond graph: masses, springs and dampers in N stages
    structure             modes and responses of a chain of masses
    synthesis             bond graphs with a wanted driving-point impedance
    reduction             comparison of model reductions of a beam
    identification        joints of a chain of masses, from a simulated record
    identification-graph  values of a bond graph: motor, gear, flexible shaft
    record                joints from a measured record, its samples in record.csv
    frf                   joints from frequency responses, stored in frf.csv
    modal-analysis        modes with their covariance, from the same responses
    beam                  joints of a beam, identified on a reduced model
    study                 a parameter study of the motor, Latin hypercube
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
        schema, content = target.parent / _SCHEMA, f"{_schema_text()}\n".encode()
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


def _topics() -> dict[str, Traversable]:
    from importlib.resources import files

    texts = [item for item in files("dynid.topics").iterdir() if item.name.endswith(".md")]
    return {text.name.removesuffix(".md"): text for text in sorted(texts, key=lambda text: text.name)}


def _topic_names() -> list[str]:
    from dynid.cli import COMMANDS

    return [*_topics(), *COMMANDS]


def _topic_of(word: str, topics: Mapping[str, Traversable]) -> str:
    """Return the topic with a paragraph of a name, or the only one with a section of scenes; '' for none."""
    texts = {name: text.read_text("utf-8") for name, text in topics.items()}
    paragraph = [name for name, text in texts.items() if f"**{word.capitalize()}.**" in text]
    section = [name for name, text in texts.items() if f"\n{word}:" in text]
    return paragraph[0] if paragraph else section[0] if len(section) == 1 else ""


@click.command("help")
@click.argument("topic", required=False, shell_complete=among("dynid.cli.start:_topic_names"))
def help_(topic: str | None) -> int:
    """Print the manual of a TOPIC or the help of a command; without TOPIC, list the topics."""
    from dynid.cli import cli

    topics = _topics()
    if topic is not None and topic not in _topic_names():
        topic = _topic_of(topic, topics) or topic
    if topic is None:
        width = max(map(len, topics))
        click.echo("dynid help TOPIC, where TOPIC is a command, or\n")
        for name, text in topics.items():
            heading = text.read_text(encoding="utf-8").partition("\n")[0]
            click.echo(f"  {name:{width}}  {heading.lstrip('# ').strip()}")
    elif topic in topics:
        click.echo_via_pager(topics[topic].read_text(encoding="utf-8"))
    else:
        refuse_unknown(topic, _topic_names(), "topic")
        cli.main([topic, "--help"], prog_name="dynid", standalone_mode=False)
    return 0


@click.command()
@click.argument("name", required=False, shell_complete=among("dynid.scene.models:library_names"))
def library(name: str | None) -> int:
    """Print the model NAME with its ports, values and source; without NAME, list the models.

    A graph has it as a node `{model: NAME}`; to change it, write it to a file and `use:` that file.
    """
    from dynid.cli.text import described
    from dynid.scene.models import library_names, library_text
    from dynid.scene.yaml.source import parse_source

    if name is not None:
        refuse_unknown(name, library_names(), "model")
        click.echo(library_text(name), nl=False)
        return 0
    rows = []
    for model in library_names():
        (data,) = parse_source(library_text(model)).data["models"].values()
        rows.append((model, f"{data['title']}; ports {', '.join(data['ports'])}"))
    click.echo("\n".join(described(rows, "")))
    return 0


@click.command()
@click.argument("kind", required=False, shell_complete=among("dynid.scene.kind:KINDS"))
def schema(kind: str | None) -> int:
    """Print the JSON Schema of scenes: of one KIND, or of all."""
    from dynid.scene.kind import KINDS

    if kind is not None:
        refuse_unknown(kind, KINDS, "kind")
    click.echo(_schema_text(kind))
    return 0


def _schema_text(kind: str | None = None) -> str:
    """Return the JSON Schema (draft 7) of the scenes of a kind, or of all kinds."""
    from dynid.scene.kind import KINDS
    from dynid.scene.schema.json_schema import scene_schema

    schemas = [scene_schema(KINDS[name].load("model")) for name in ([kind] if kind else KINDS)]
    if len(schemas) == 1:
        document = schemas[0]
    else:
        definitions = {
            name: definition
            for model_schema in schemas
            for name, definition in model_schema.pop("$defs", {}).items()
        }
        document = {"oneOf": schemas, "$defs": definitions}
    return json.dumps({"$schema": "http://json-schema.org/draft-07/schema#", **document}, indent=2)
