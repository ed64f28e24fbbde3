"""Wall time of whole commands, and of what Python itself needs to import for them."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark


def _process(*arguments: str) -> Callable[[int], Callable[[], Any]]:
    """Return work that runs a Python process, in a folder of its own."""

    def prepare(_: int) -> Callable[[], Any]:
        folder = tempfile.mkdtemp()
        command = [sys.executable, *arguments]

        def work() -> int:
            return subprocess.run(command, cwd=folder, check=False, capture_output=True).returncode

        if "{scene}" in arguments:
            scene = Path(folder) / "scene.yaml"
            scene.write_text(_template(arguments[-1]), encoding="utf-8")
            command[command.index("{scene}") :] = [str(scene)]
        return work

    return prepare


def _template(name: str) -> str:
    from importlib.resources import files

    return (files("dynid") / "templates" / f"{name}.yaml").read_text(encoding="utf-8")


def _error(_: int, code: Any) -> float:
    return float(code)


BENCHMARK = Benchmark(
    title="Wall time of commands, beside the imports that they cannot do without",
    size="run",
    sizes=(1,),
    alternatives=(
        Alternative("help", _process("-m", "dynid", "--help")),
        Alternative("import-click", _process("-c", "import click")),
        Alternative("check", _process("-m", "dynid", "check", "{scene}", "bond-graph")),
        Alternative("import-pydantic-yaml", _process("-c", "import pydantic, yaml")),
        Alternative("run-bond-graph", _process("-m", "dynid", "run", "{scene}", "bond-graph")),
        Alternative("run-identification", _process("-m", "dynid", "run", "{scene}", "identification")),
        Alternative("import-numpy-scipy-h5py", _process("-c", "import numpy, scipy.linalg, h5py, pydantic")),
    ),
    error=_error,
    measure="exit code",
)
