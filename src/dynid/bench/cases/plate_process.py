"""Modes and SEREP of a plate from files, as a whole process: dynid, and what a user would write instead.

The plate is one of finite differences, whose eigenvalues are known exactly. Times include the start of
Python, reading the files and writing the result; those of dynid the proof that no mode is missed, too.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark

_COUNT, _RATIO = 10, 1.3  # modes; height over width
_SCENE = f"""\
dynid: 1
kind: reduction
structure: {{matrices: {{mass: M.mtx, stiffness: K.mtx}}}}
reduction: [{{method: serep, modes: {{count: {_COUNT}}}}}]
"""
_SCRIPT = f"""\
import numpy as np
from scipy.io import mmread
from scipy.linalg import qr
from scipy.sparse.linalg import eigsh
M, K = (mmread(name).tocsc() for name in ("M.mtx", "K.mtx"))
values, shapes = eigsh(K, {_COUNT}, M, sigma=0.0)
masters = qr(shapes.T, pivoting=True, mode="economic")[2][:{_COUNT}]
T = shapes @ np.linalg.inv(shapes[masters])
np.savez("found.npz", T=T, mass=T.T @ (M @ T), stiffness=T.T @ (K @ T), frequencies=np.sqrt(values))
"""


def _side(dofs: int) -> int:
    return max(4, math.isqrt(dofs))


def _files(dofs: int) -> Path:
    """Write the matrices of a simply supported plate, of deflections alone, into a folder of their own."""
    from scipy.io import mmwrite
    from scipy.sparse import coo_array, diags_array, eye_array, kron

    n = _side(dofs)
    one = diags_array([[2.0] * n, [-1.0] * (n - 1), [-1.0] * (n - 1)], offsets=[0, 1, -1]) * (n + 1) ** 2
    curvature = kron(one, eye_array(n)) + kron(eye_array(n), one / _RATIO**2)
    folder, area = Path(tempfile.mkdtemp()), 1 / (n + 1) ** 2
    for name, matrix in (("K", curvature @ curvature * area), ("M", eye_array(n * n) * area)):
        mmwrite(folder / f"{name}.mtx", coo_array(matrix), symmetry="symmetric", precision=17)
    (folder / "plate.yaml").write_text(_SCENE, encoding="utf-8")
    (folder / "script.py").write_text(_SCRIPT, encoding="utf-8")
    return folder


def _process(command: list[str], frequencies: Callable[[Path], Any]) -> Callable[[int], Callable[[], Any]]:
    def prepare(dofs: int) -> Callable[[], Any]:
        folder = _files(dofs)

        def work() -> Any:
            subprocess.run([sys.executable, *command], cwd=folder, check=True, capture_output=True)
            return frequencies(folder)

        return work

    return prepare


def _by_dynid(folder: Path) -> Any:
    from dynid.store import read_result

    return read_result(folder / "plate.h5")["reduction/serep/frequencies"].data


def _by_script(folder: Path) -> Any:
    import numpy as np

    with np.load(folder / "found.npz") as found:
        return found["frequencies"]


def _error(dofs: int, found: Any) -> float:
    import numpy as np

    n = _side(dofs)
    along = (2 * (n + 1) * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))) ** 2
    exact = np.sort((along[:, None] + along / _RATIO**2).ravel())[:_COUNT]
    return float(np.max(np.abs(np.sort(found) / exact - 1)))


BENCHMARK = Benchmark(
    title="Ten modes and SEREP of a plate from Matrix Market files, a whole process",
    size="DOFs",
    sizes=(10_000,),
    full=(100_000,),
    alternatives=(
        Alternative("dynid", _process(["-m", "dynid", "run", "plate.yaml", "-q"], _by_dynid)),
        Alternative("script", _process(["script.py"], _by_script), peer=True),
    ),
    error=_error,
    measure="largest relative error of the frequencies of the reduced plate",
    default=lambda _: "dynid",
    remark="dynid proves that no mode is missed, the script does not; the memory of dynid is too low here, "
    "as it resets its peak to measure the cost of a reduction",
)
