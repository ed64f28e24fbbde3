"""`dynid doctor`: the state of the installation."""

from __future__ import annotations

import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import click

from dynid._version import __version__

#: Extras that are of use to users; the others are for development.
_EXTRAS = {
    "solvers": "faster factorisations of large structures",
    "formats": "Universal Files, Nastran files, Parquet",
    "laboratory": "meshes, NetCDF",
    "figures": "figures as PDF and PNG",
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
    click.echo(f"dynid {__version__} on Python {platform.python_version()}, {platform.platform()}")
    click.echo(f"  {sys.executable}, {os.cpu_count()} processors\n")
    required, extras = _requirements()
    broken = []
    for name in required:
        fault = _import_fault(_MODULES.get(name, name))
        click.echo(f"  {name:<18} {_version(name) or 'MISSING'}{f' ({fault})' if fault else ''}")
        broken += [name] if fault else []
    click.echo("")
    for extra, use in _EXTRAS.items():
        lacking = [name for name in extras.get(extra, ()) if not _version(name)]
        state = f"not installed: pip install 'dynid[{extra}]'" if lacking else "installed"
        click.echo(f"  {extra:<18} {use}: {state}")
    click.echo("")
    unwritable = []
    for what, folder, variable in _folders():
        fault = _unwritable(folder)
        click.echo(f"  {what:<18} {folder}{f' (not writable: {fault})' if fault else ''}")
        unwritable += [(what, variable)] if fault else []
    click.echo(f"  {'compiled library':<18} {_library()}")
    click.echo(f"  {'threads':<18} {os.environ['OPENBLAS_NUM_THREADS']} for linear algebra\n")
    for name in broken:
        click.echo(f"  problem: {name} cannot be loaded: pip install --force-reinstall {name}")
    for what, variable in unwritable:
        click.echo(f"  problem: no folder for {what}: set {variable} to one that is writable")
    if not broken and not unwritable:
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
    """Return the version of an installed package, or ''."""
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


def _folders() -> Iterator[tuple[str, Path, str]]:
    """Yield folders that dynid writes to unasked: their use, place, and the variable that sets it."""
    yield "temporary files", Path(tempfile.gettempdir()), "TMPDIR"


def _unwritable(folder: Path) -> str:
    """Return the reason why no file can be written to a folder, or ''."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return error.strerror or str(error)
