"""Model updating: rigidities of the fields of a plate from its measured frequencies.

The plate of finite elements has 5 x 4 fields of unequal widths, each with an unknown rigidity, which is 1
with a standard deviation of 0.2 a priori. The lowest frequencies are measured with random errors. The peer
minimises the weighted deviations by SciPy's least squares, with shift-invert Lanczos for the modes and the
derivatives of the frequencies by the modes (Fox & Kapoor 1968). Of 7,000 DOFs it ends at another optimum than
the likeliest one, which the search of dynid reaches, and which SciPy reaches from the true rigidities. The
peer has the matrices before the clock starts; dynid reads them from files.
"""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark

#: Edges of the fields, as fractions of the width and the height.
_ACROSS, _UP = (0.15, 0.35, 0.5, 0.75, 1.0), (0.2, 0.5, 0.7, 1.0)
_FIELDS = len(_ACROSS) * len(_UP)
_TRUE = np.random.default_rng(1).uniform(0.7, 1.4, _FIELDS)
_MODES, _NOISE, _PRIOR = 40, 1e-3, 0.2  # noise of a frequency, relative; deviation a priori
_UNKNOWN = f"{{start: 1, scale: linear, prior: {{value: 1, std: {_PRIOR}}}}}"


class _Problem(NamedTuple):
    """The stiffness of each field at a rigidity of 1, the mass, measured frequencies (rad/s), the scene."""

    parts: list[Any]
    M: Any
    measured: Any
    scene: Any


@lru_cache(maxsize=1)
def _problem(dofs: int) -> _Problem:
    from scipy.io import mmwrite
    from scipy.sparse import coo_array

    from dynid.bench.meshes import plate
    from dynid.scene.load import load_scene

    side = round((dofs / 3) ** 0.5)
    x, y = (np.arange(side * side) // side + 0.5) / side, (np.arange(side * side) % side + 0.5) / side
    field = np.searchsorted(_ACROSS, x) * len(_UP) + np.searchsorted(_UP, y)
    parts = [plate(side, rigidities=(field == number).astype(float))[0] for number in range(_FIELDS)]
    for part in parts:
        part.eliminate_zeros()
    M = plate(side)[1]
    noise = np.random.default_rng(2).standard_normal(_MODES)
    measured = np.sqrt(_modes(parts, M, _TRUE)[0]) * (1 + _NOISE * noise)
    folder = Path(tempfile.mkdtemp())
    for name, matrix in (("M", M), *((f"K{number}", part) for number, part in enumerate(parts))):
        mmwrite(folder / f"{name}.mtx", coo_array(matrix), symmetry="symmetric", precision=17)
    stiffness = [{"path": f"K{number}.mtx", "factor": f"t{number}"} for number in range(_FIELDS)]
    values = [{"frequency": w, "frequency_std": _NOISE * w} for w in measured.tolist()]
    lines = [
        "dynid: 1\nkind: identification",
        f"parameters: {{{', '.join(f't{number}: {_UNKNOWN}' for number in range(_FIELDS))}}}",
        f"structure: {{matrices: {{mass: M.mtx, stiffness: {stiffness}}}}}",
        f"measurement: {{modes: {{unit: rad/s, values: {values}}}}}",
    ]
    (folder / "plate.yaml").write_text("\n".join(lines).replace("'", ""), encoding="utf-8")
    return _Problem(parts, M, measured, load_scene(folder / "plate.yaml"))


def _modes(parts: list[Any], M: Any, rigidities: Any) -> tuple[Any, Any]:
    """Return squares of the lowest frequencies, and their modes of unit modal mass."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    K = csc_array(sum(value * part for value, part in zip(rigidities, parts, strict=True)))
    options = {"SymmetricMode": True}
    factor = splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    inverse = LinearOperator(K.shape, matvec=factor.solve, dtype=float)
    start = np.ones(K.shape[0])
    squares, shapes = eigsh(K, _MODES, M, sigma=0.0, OPinv=inverse, v0=start)
    return squares, shapes


def _by_dynid(problem: _Problem) -> Any:
    from dynid.scene.run import run_scene

    return run_scene(problem.scene)["identification/parameters/estimate"].data


def _by_scipy(problem: _Problem) -> Any:
    return _optimum(problem, np.ones(_FIELDS), 1e-8).x


def _optimum(problem: _Problem, start: Any, tolerance: float) -> Any:
    """Return SciPy's solution from a start."""
    from scipy.optimize import least_squares

    parts, M, measured, _ = problem
    kept: dict[bytes, tuple[Any, Any]] = {}

    def at(values: Any) -> tuple[Any, Any]:
        """Return frequencies and modes, computed once at a point."""
        key = values.tobytes()
        if key not in kept:
            kept.clear()
            squares, shapes = _modes(parts, M, values)
            kept[key] = np.sqrt(squares), shapes
        return kept[key]

    def residuals(values: Any) -> Any:
        return np.concatenate([(at(values)[0] / measured - 1) / _NOISE, (values - 1) / _PRIOR])

    def slopes(values: Any) -> Any:
        frequencies, shapes = at(values)
        squares = np.array([(shapes * (part @ shapes)).sum(axis=0) for part in parts]).T
        of_frequencies = squares / (2 * frequencies * measured)[:, None] / _NOISE
        return np.concatenate([of_frequencies, np.eye(_FIELDS) / _PRIOR])

    return least_squares(
        residuals, start, slopes, method="lm", ftol=tolerance, xtol=tolerance, gtol=tolerance
    )


@lru_cache(maxsize=1)
def _likeliest(dofs: int) -> Any:
    """Return the better one of the optima that are reached from the start and from the true rigidities."""
    optima = [_optimum(_problem(dofs), start, 1e-14) for start in (np.ones(_FIELDS), _TRUE)]
    return min(optima, key=lambda optimum: float(optimum.cost)).x


def _error(dofs: int, estimates: Any) -> float:
    return float(np.max(np.abs(estimates / _likeliest(dofs) - 1)))


BENCHMARK = Benchmark(
    title=f"Rigidities of {_FIELDS} fields of a plate from its lowest {_MODES} frequencies",
    size="DOFs",
    sizes=(700,),
    full=(7000,),
    alternatives=(Alternative("dynid", _by_dynid), Alternative("least-squares", _by_scipy, peer=True)),
    error=_error,
    problem=_problem,
    measure="largest relative distance of a rigidity from the optimum",
    default=lambda _: "dynid",
    remark="error bars, other optima and tests of residuals by dynid alone, which reads the matrices, too",
)
