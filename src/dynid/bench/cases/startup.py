"""Wall time of whole commands, and of the imports that they need."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache, reduce
from importlib.resources import files
from operator import getitem
from pathlib import Path
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark, TimeLimit


@cache
def _folder() -> Path:
    """Return a folder with the template scenes, and empty files in place of their data files."""
    from dynid.scene.files import file_places
    from dynid.scene.yaml.source import read_source

    folder = Path(tempfile.mkdtemp())
    for template in (files("dynid") / "templates").iterdir():
        if template.name.endswith(".yaml"):
            (folder / template.name).write_text(template.read_text(encoding="utf-8"), encoding="utf-8")
    for scene in folder.glob("*.yaml"):
        data = read_source(scene).data
        for place in file_places(data):
            (folder / str(reduce(getitem, place, data))).touch()
    return folder


def _process(*arguments: str) -> Callable[[int], Callable[[], Any]]:
    """Return the run of a Python process in the folder of the scenes; ``*`` stands for all of them."""

    def prepare(_: int) -> Callable[[], Any]:
        scenes = sorted(path.name for path in _folder().glob("*.yaml"))
        command = [part for given in arguments for part in (scenes if given == "*" else [given])]
        return lambda: _ran(command)

    return prepare


def _ran(arguments: list[str]) -> list[str]:
    """Run Python, and return the arguments."""
    compiled_once = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, *arguments]
    subprocess.run(command, cwd=_folder(), env=compiled_once, check=True, capture_output=True)
    return arguments


def _dynid(*arguments: str) -> Callable[[int], Callable[[], Any]]:
    return _process("-m", "dynid", *arguments)


def _on_result(command: str, kind: str, *arguments: str) -> Callable[[int], Callable[[], Any]]:
    """Return a command on the result of the template scene of a kind, which is run before."""

    def prepare(size: int) -> Callable[[], Any]:
        _dynid("run", f"{kind}.yaml", "-q")(size)()
        return _dynid(command, f"{kind}.h5", *arguments)(size)

    return prepare


def _imports_of(*arguments: str) -> Callable[[int], Callable[[], Any]]:
    """Return the import of all modules that a command of dynid loads, without its work."""

    def prepare(_: int) -> Callable[[], Any]:
        script = f"import sys; from dynid.cli import main; sys.argv = {['dynid', *arguments]!r}\n"
        script += "try: main()\nexcept SystemExit: pass\nprint('modules', *sys.modules)"
        ran = subprocess.run(
            [sys.executable, "-c", script], cwd=_folder(), check=True, capture_output=True, text=True
        )
        loaded = ran.stdout.split("modules ", 1)[1].split()
        names = [name for name in loaded if name != "__main__" and "-" not in name]
        (_folder() / "imported.txt").write_text("\n".join(names), encoding="utf-8")
        again = (
            "import importlib, pathlib\n"
            "for name in pathlib.Path('imported.txt').read_text().split():\n"
            "    try: importlib.import_module(name)\n"
            "    except ImportError: pass"
        )
        return lambda: _ran(["-c", again])

    return prepare


def _modules(_: int, arguments: Any) -> float:
    """Return the number of modules that the command imports."""
    command = [sys.executable, "-X", "importtime", *arguments]
    said = subprocess.run(command, cwd=_folder(), check=True, capture_output=True, text=True).stderr
    return float(sum(line.startswith("import time:") for line in said.splitlines()) - 1)  # less the heading


BENCHMARK = Benchmark(
    title="Wall time of whole commands, beside the imports that they cannot do without",
    size="run",
    sizes=(1,),
    alternatives=(
        Alternative("help", _dynid("--help")),
        Alternative("import-click", _process("-c", "import click")),
        Alternative("check", _dynid("check", "*")),
        Alternative("import-pydantic-yaml", _process("-c", "import pydantic, yaml")),
        Alternative("schema", _dynid("schema", "study")),
        Alternative("run-bond-graph", _dynid("run", "bond-graph.yaml", "-q")),
        Alternative("run-identification", _dynid("run", "identification.yaml", "-q")),
        Alternative("import-run-identification", _imports_of("run", "identification.yaml", "-q")),
        Alternative("show", _on_result("show", "bond-graph")),
        Alternative("report", _on_result("report", "identification", "-q")),
        Alternative(
            "import-matplotlib-numpy", _process("-c", "import matplotlib, numpy"), needs=("matplotlib",)
        ),
        Alternative("import-numpy-scipy-h5py", _process("-c", "import numpy, scipy.linalg, h5py, pydantic")),
    ),
    error=_modules,
    measure="modules imported",
    limits=(
        TimeLimit("help", "import-click", 1.3),
        TimeLimit("check", "import-pydantic-yaml", 5.0),
        TimeLimit("run-bond-graph", "import-numpy-scipy-h5py", 3.0),
        TimeLimit("run-identification", "import-run-identification", 1.25),
        TimeLimit("report", "import-matplotlib-numpy", 2.0),
    ),
)
