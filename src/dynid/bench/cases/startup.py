"""Whole processes: commands and their imports, and modes of a plate from files.

Commands are measured beside the imports that they need, modes and SEREP of a plate beside what a user would
write instead. The plate is one of finite differences, whose eigenvalues are known exactly. Times include the
start of Python, reading the files and writing the result; those of dynid the proof that no mode is missed,
too.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from functools import cache, partial, reduce
from importlib.resources import files
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark, TimeLimit

#: The scenes of the README, which are beside the sources and not in the package.
_SCENES = [
    Path(__file__).resolve().parents[4] / "configs" / name
    for name in ("isolator.yaml", "suspension_noisy.yaml")
]


@cache
def _folder() -> Path:
    """Return a folder with the template scenes and their data, and those of the README."""
    from dynid.scene.files import file_places
    from dynid.scene.yaml.source import read_source

    folder = Path(tempfile.mkdtemp())
    for template in (files("dynid") / "templates").iterdir():
        if template.name.endswith((".yaml", ".csv")):
            (folder / template.name).write_text(template.read_text(encoding="utf-8"), encoding="utf-8")
    for scene in _SCENES:
        if scene.is_file():
            (folder / scene.name).write_text(scene.read_text(encoding="utf-8"), encoding="utf-8")
    for scene in folder.glob("*.yaml"):
        data = read_source(scene).data
        for path in file_places(data):
            (folder / str(reduce(getitem, path, data))).touch()
    return folder


def _expanded(arguments: Iterable[str]) -> list[str]:
    """Return arguments with all scenes in place of ``*``."""
    scenes = sorted(path.name for path in _folder().glob("*.yaml"))
    return [text for argument in arguments for text in (scenes if argument == "*" else [argument])]


def _ran(arguments: list[str]) -> list[str]:
    """Run Python in the folder of the scenes, and return the arguments."""
    compiled_once = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, *arguments]
    subprocess.run(command, cwd=_folder(), env=compiled_once, check=True, capture_output=True)
    return arguments


def _process(name: str, *arguments: str, **options: Any) -> Alternative:
    return Alternative(name, _ran, lambda _: _expanded(arguments), **options)


def _dynid(name: str, *arguments: str) -> Alternative:
    return _process(name, "-m", "dynid", *arguments)


def _on_result(command: str, kind: str, *arguments: str) -> Alternative:
    """Return a command on the result of the template scene of a kind, which is run before."""

    def problem(_: int) -> list[str]:
        _ran(["-m", "dynid", "run", f"{kind}.yaml", "-q"])
        return ["-m", "dynid", command, f"{kind}.h5", *arguments]

    return Alternative(command, _ran, problem)


def _imports_of(name: str, *arguments: str, of_dynid: bool) -> Alternative:
    """Return the import of the modules that a command loads; `of_dynid`: those of dynid and Python, too."""
    what = "modules" if of_dynid else "packages"

    def problem(_: int) -> list[str]:
        script = f"import sys; from dynid.cli import main; sys.argv = {['dynid', *_expanded(arguments)]!r}\n"
        script += "try: main()\nexcept SystemExit: pass\nprint('modules', *sys.modules)"
        ran = subprocess.run(
            [sys.executable, "-c", script], cwd=_folder(), check=True, capture_output=True, text=True
        )
        loaded = ran.stdout.split("modules ", 1)[1].split()
        without = {"__main__"} if of_dynid else {"__main__", "dynid", *sys.stdlib_module_names}
        names = [name for name in loaded if name.partition(".")[0] not in without and "-" not in name]
        listed = f"{name}-{what}.txt"
        (_folder() / listed).write_text("\n".join(names), encoding="utf-8")
        again = (
            "import importlib\n"
            f"for name in open({listed!r}).read().split():\n"
            "    try: importlib.import_module(name)\n"
            "    except ImportError: pass"
        )
        return ["-c", again]

    return Alternative(f"{what}-of-{name}", _ran, problem)


def _beside_imports(name: str, *arguments: str) -> tuple[Alternative, ...]:
    """Return a command, the import of the same modules, and of those of other packages alone."""
    return (
        _dynid(name, *arguments),
        _imports_of(name, *arguments, of_dynid=True),
        _imports_of(name, *arguments, of_dynid=False),
    )


def _run(scene: str) -> tuple[Alternative, ...]:
    return _beside_imports(f"run-{Path(scene).stem.replace('_', '-')}", "run", scene, "-q")


def _modules(_: int, arguments: Any) -> float:
    command = [sys.executable, "-X", "importtime", *arguments]
    said = subprocess.run(command, cwd=_folder(), check=True, capture_output=True, text=True).stderr
    return float(sum(line.startswith("import time:") for line in said.splitlines()) - 1)  # less the heading


BENCHMARK = Benchmark(
    title="Wall time of whole commands, beside the imports that they cannot do without",
    size="run",
    sizes=(1,),
    alternatives=(
        _dynid("help", "--help"),
        _process("import-click", "-c", "import click"),
        *_beside_imports("check", "check", "*"),
        _dynid("schema", "schema", "study"),
        _dynid("run-bond-graph", "run", "bond-graph.yaml", "-q"),
        *_run("identification.yaml"),
        *(alternative for scene in _SCENES if scene.is_file() for alternative in _run(scene.name)),
        _on_result("show", "bond-graph"),
        _on_result("report", "identification", "-q"),
        _process("import-matplotlib-numpy", "-c", "import matplotlib, numpy", needs=("matplotlib",)),
        _process("import-numpy-scipy-h5py", "-c", "import numpy, scipy.linalg, h5py, pydantic"),
    ),
    error=_modules,
    measure="modules imported",
    limits=(
        TimeLimit("help", "import-click", 1.3),
        TimeLimit("run-bond-graph", "import-numpy-scipy-h5py", 3.0),
        *(
            limit
            for name in ("check", "run-identification", "run-suspension-noisy", "run-isolator")
            for limit in (
                TimeLimit(name, f"modules-of-{name}", 1.25),
                TimeLimit(name, f"packages-of-{name}", 2.2),
            )
        ),
        TimeLimit("report", "import-matplotlib-numpy", 2.0),
    ),
)


_COUNT, _MANY, _RATIO = 10, 100, 1.3  # modes; height over width
_SEREP = f"reduction: [{{method: serep, modes: {{count: {_COUNT}}}}}]"
_READING = """\
import numpy as np
from scipy.io import mmread
from scipy.linalg import eigh, qr
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import LinearOperator, eigsh, splu
M, K = (mmread(name).tocsc() for name in ("M.mtx", "K.mtx"))
"""
_SEREP_SCRIPT = f"""\
values, shapes = eigsh(K, {_COUNT}, M, sigma=0.0)
masters = qr(shapes.T, pivoting=True, mode="economic")[2][:{_COUNT}]
T = shapes @ np.linalg.inv(shapes[masters])
np.savez("found.npz", T=T, mass=T.T @ (M @ T), stiffness=T.T @ (K @ T), frequencies=np.sqrt(values))
"""
#: Solve with a symmetric matrix and take its modes by SuperLU on its diagonal: half the time of its default.
_FACTORISING = """\
def factor(A):
    symmetric = dict(options=dict(SymmetricMode=True), diag_pivot_thresh=0.0)
    return splu(csc_matrix(A), permc_spec="MMD_AT_PLUS_A", **symmetric).solve
def modes(K, M, solve, count):
    return eigsh(K, count, M, sigma=0.0, OPinv=LinearOperator(K.shape, matvec=solve, dtype=float))
"""
_MODES_SCRIPT = f"""{_FACTORISING}\
values, shapes = modes(K, M, factor(K), {_MANY})
np.savez("found.npz", shapes=shapes, frequencies=np.sqrt(values))
"""
_MASTERS = 20
_BAMPTON_SCRIPT = f"""{_FACTORISING}\
size = K.shape[0]
masters = np.linspace(0, size - 1, {_MASTERS + 2}).astype(int)[1:-1]
slaves = np.setdiff1d(np.arange(size), masters)
inner, coupling = K[slaves][:, slaves], K[slaves][:, masters].toarray()
solve = factor(inner)
values, shapes = modes(inner, M[slaves][:, slaves], solve, {_COUNT})
T = np.zeros((size, {_MASTERS + _COUNT}))
T[masters, np.arange({_MASTERS})] = 1.0
T[slaves, :{_MASTERS}] = np.column_stack([-solve(column) for column in coupling.T])
T[slaves, {_MASTERS}:] = shapes
stiffness, mass = T.T @ (K @ T), T.T @ (M @ T)
frequencies = np.sqrt(eigh(stiffness, mass, eigvals_only=True))
np.savez("found.npz", T=T, mass=mass, stiffness=stiffness, frequencies=frequencies)
"""


def _side(dofs: int) -> int:
    return max(4, math.isqrt(dofs))


def _files(scene: str, script: str, dofs: int) -> Path:
    """Write the matrices of a simply supported plate, of deflections alone, into a folder of their own."""
    from scipy.io import mmwrite
    from scipy.sparse import coo_array, diags_array, eye_array, kron

    n = _side(dofs)
    second_difference = (
        diags_array([[2.0] * n, [-1.0] * (n - 1), [-1.0] * (n - 1)], offsets=[0, 1, -1]) * (n + 1) ** 2
    )
    curvature = kron(second_difference, eye_array(n)) + kron(eye_array(n), second_difference / _RATIO**2)
    folder, area = Path(tempfile.mkdtemp()), 1 / (n + 1) ** 2
    for name, matrix in (("K", curvature @ curvature * area), ("M", eye_array(n * n) * area)):
        mmwrite(folder / f"{name}.mtx", coo_array(matrix), symmetry="symmetric", precision=17)
    masters = np.linspace(0, n * n - 1, _MASTERS + 2).astype(int)[1:-1] + 1
    kind = scene.partition(":")[0].replace("analysis", "identification")
    matrices = "structure: {matrices: {mass: M.mtx, stiffness: K.mtx}}"
    text = f"dynid: 1\nkind: {kind}\n{matrices}\n{scene.replace('MASTERS', str(masters.tolist()))}\n"
    (folder / "plate.yaml").write_text(text, encoding="utf-8")
    (folder / "script.py").write_text(_READING + script, encoding="utf-8")
    return folder


def _by_dynid(path: str, folder: Path) -> Any:
    from dynid.store import read_result

    _ran_in(folder, "-m", "dynid", "run", "plate.yaml", "-q")
    return read_result(folder / "plate.h5")[path].data


def _by_script(folder: Path) -> Any:
    _ran_in(folder, "script.py")
    with np.load(folder / "found.npz") as arrays:
        return arrays["frequencies"]


def _ran_in(folder: Path, *arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True)


def _error(dofs: int, result: Any) -> float:
    n = _side(dofs)
    along = (2 * (n + 1) * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))) ** 2
    exact = np.sort((along[:, None] + along / _RATIO**2).ravel())
    count = min(len(result), _COUNT if len(result) == _COUNT + _MASTERS else len(result))
    return float(np.max(np.abs(np.sort(result)[:count] / exact[:count] - 1)))


def _of_plate(title: str, scene: str, script: str, path: str, remark: str) -> Benchmark:
    return Benchmark(
        title=f"{title} of a plate from Matrix Market files, a whole process",
        size="DOFs",
        sizes=(10_000,),
        full=(100_000,),
        alternatives=(
            Alternative("dynid", partial(_by_dynid, path)),
            Alternative("script", _by_script, peer=True),
        ),
        error=_error,
        problem=partial(_files, scene, script),
        measure="largest relative error of the frequencies, of a reduced plate the first ten",
        default=lambda _: "dynid",
        remark=f"dynid proves that no mode is missed, the script does not{remark}",
    )


_RESET = "; the memory of dynid is too low here, as it resets its peak to measure the cost of a reduction"
PLATE = _of_plate("Ten modes and SEREP", _SEREP, _SEREP_SCRIPT, "reduction/serep/frequencies", _RESET)
CRAIG_BAMPTON = _of_plate(
    "Craig-Bampton with 20 masters and ten modes",
    f"reduction: [{{method: craig-bampton, masters: MASTERS, modes: {{count: {_COUNT}}}}}]",
    _BAMPTON_SCRIPT,
    "reduction/craig-bampton/frequencies",
    _RESET,
)
MANY_MODES = _of_plate(
    "A hundred modes",
    f"analysis: {{modes: {{count: {_MANY}}}}}",
    _MODES_SCRIPT,
    "structure/modes/omega",
    "",
)
