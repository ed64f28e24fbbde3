"""Frequency response of a plate at few to many frequencies: solved at each one, or by its modes."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import FEW_FREQUENCIES

#: Approximate number of DOFs, modes in the band, and most frequencies at which the error is evaluated.
_DOFS, _MODES, _PLACES = 1000, 10, 8


class _Plate(NamedTuple):
    """Mass, damping and stiffness, a force and an output (ports), and the highest frequency, rad/s."""

    M: Any
    C: Any
    K: Any
    ports: Any
    top: float


@lru_cache(maxsize=1)
def _plate() -> _Plate:
    import numpy as np
    from scipy.sparse import csc_array

    from dynid.bench.meshes import deflections, plate
    from dynid.structure.frf import Ports

    side = round((_DOFS / 3) ** 0.5)
    K, M = plate(side)
    places = deflections(side) - 1
    ends = np.zeros((2, K.shape[0]))
    ends[[0, 1], [places[len(places) // 3], places[len(places) // 2]]] = 1.0
    top = float(np.sqrt(_lowest(K, M)[0][-1]))
    return _Plate(M, csc_array(1e-5 * K + 0.1 * M), K, Ports(ends[:1].T, ends[1:], [0]), top)


def _lowest(K: Any, M: Any) -> Any:
    from scipy.sparse.linalg import eigsh

    return eigsh(K, _MODES, M, sigma=0.0)


def _frequencies(count: int) -> Any:
    import numpy as np

    return np.linspace(_plate().top / count, _plate().top, count)


def _places(count: int) -> Any:
    import numpy as np

    return np.unique(np.linspace(0, count - 1, _PLACES).astype(int))


def _by_method(method: str) -> Callable[[int], Callable[[], Any]]:
    def prepare(count: int) -> Callable[[], Any]:
        from dynid.structure.frf import frequency_response_functions

        M, C, K, ports, _ = _plate()
        omega = _frequencies(count)

        def work() -> Any:
            found = frequency_response_functions(M, C, K, ports, omega, method=method)
            return found.response[:, 0, 0]

        return work

    return prepare


def _spsolve(count: int) -> Callable[[], Any]:
    """Solve at every frequency by SciPy, without checks of condition or residual."""
    import numpy as np
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import spsolve

    M, C, K, ports, _ = _plate()
    force, row = ports.forces[:, 0].astype(complex), ports.rows[0]
    omega = _frequencies(count)
    return lambda: np.array([row @ spsolve(csc_array(K + 1j * w * C - w**2 * M), force) for w in omega])


def _superposed(count: int) -> Callable[[], Any]:
    """Superpose the modes of the band, without the others."""
    M, C, K, ports, _ = _plate()
    omega = _frequencies(count)[:, None]

    def work() -> Any:
        square, shapes = _lowest(K, M)
        damping = (shapes * (C @ shapes)).sum(axis=0)
        parts = (ports.rows @ shapes) * (shapes.T @ ports.forces).T
        return (parts / (square + 1j * omega * damping - omega**2)).sum(axis=1)

    return work


@lru_cache(maxsize=1)
def _true(count: int) -> Any:
    """Return the response at some frequencies, refined by residuals in extended precision."""
    import numpy as np
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    M, C, K, ports, _ = _plate()
    wide, found = [part.astype(np.longdouble) for part in (M, C, K)], []
    for w in _frequencies(count)[_places(count)].astype(np.longdouble):
        Z = [wide[2] - w**2 * wide[0], w * wide[1]]
        factor = splu(csc_array(Z[0].astype(float) + 1j * Z[1].astype(float)))
        x = np.zeros(K.shape[0], dtype=np.clongdouble)
        for _ in range(4):
            product = Z[0] @ x.real - Z[1] @ x.imag + 1j * (Z[1] @ x.real + Z[0] @ x.imag)
            x += factor.solve((ports.forces[:, 0] - product).astype(complex))
        found.append(ports.rows[0] @ x)
    return np.array(found)


def _error(count: int, found: Any) -> float:
    import numpy as np

    true = _true(count)
    return float(np.max(np.abs(found[_places(count)] - true) / (np.abs(true) + np.median(np.abs(true)))))


BENCHMARK = Benchmark(
    title="Response of a plate of 1,000 DOFs at some frequencies of its first ten modes",
    size="frequencies",
    sizes=(2, 6, 32),
    full=(4, 8, 128, 512),
    alternatives=(
        Alternative("modal", _by_method("modal")),
        Alternative("direct", _by_method("direct")),
        Alternative("spsolve", _spsolve, peer=True),
        Alternative("superposition", _superposed, peer=True),
    ),
    error=_error,
    measure="largest error, relative to the sum of the response and its median",
    default=lambda count: "modal" if count > FEW_FREQUENCIES.value else "direct",
    remark="modal responses are computed to 1e-8; spsolve checks neither condition nor residual",
)
