"""Forward simulation of the five-mass suspension under three sampled sines."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import HOLD

_SAMPLE_STEP = 0.002
_OMEGA = (70.0, 110.0, 250.0)  # rad/s
_MASSES = (2.0, 2.0, 1.5, 1.0, 1.0)
_LINKS = (((0,), 2e4), ((0, 1), 3e4), ((1, 2), 2e4), ((2, 3), 2e4), ((3, 4), 2e4))


@lru_cache(maxsize=1)
def _second_order() -> tuple[Any, Any, Any]:
    """Return M, C, K of Yang's suspension; each damper is a thousandth of its spring."""
    import numpy as np

    K = np.zeros((5, 5))
    for dofs, k in _LINKS:
        row = np.zeros(5)
        row[list(dofs)] = [1.0, -1.0][: len(dofs)]
        K += k * np.outer(row, row)
    return np.diag(_MASSES), 1e-3 * K, K


@lru_cache(maxsize=1)
def _system() -> Any:
    import numpy as np

    from dynid.structure.state_space import state_space

    force, row = np.zeros((5, 1)), np.zeros((1, 5))
    force[4, 0] = row[0, 1] = 1.0
    return state_space(*_second_order(), force, row, [1])


def _times(samples: int) -> Any:
    import numpy as np

    return _SAMPLE_STEP * np.arange(samples)


def _force(t: Any) -> Any:
    import numpy as np

    return sum(100 * np.sin(omega * t) for omega in _OMEGA)


def _by_hold(hold: str) -> Callable[[int], Callable[[], Any]]:
    def prepare(samples: int) -> Callable[[], Any]:
        from dynid.lti.noise import Sampled
        from dynid.lti.time_response import propagate

        times = _times(samples)
        signal = Sampled(_force(times), _SAMPLE_STEP, hold)
        return lambda: propagate(_system(), [signal], times).outputs[:, 0]

    return prepare


def _lsim(samples: int) -> Callable[[], Any]:
    from scipy.signal import lsim

    system, times = _system(), _times(samples)
    matrices = system.A, system.B, system.C, system.D
    return lambda: lsim(matrices, _force(times), times)[1]


def _integrated(samples: int) -> Callable[[], Any]:
    """Integrate with DOP853 at a tolerance of 1e-8, the force in closed form."""
    from scipy.integrate import solve_ivp

    system, times = _system(), _times(samples)
    A, b = system.A, system.B[:, 0]

    def rate(t: float, x: Any) -> Any:
        return A @ x + b * _force(t)

    def work() -> Any:
        solved = solve_ivp(rate, (0, times[-1]), [0.0] * len(A), "DOP853", times, rtol=1e-8, atol=1e-12)
        return (system.C @ solved.y)[0]

    return work


def _runge_kutta(samples: int) -> Callable[[], Any]:
    """Step with RK4, the force in closed form."""
    import numpy as np

    system, times = _system(), _times(samples)
    A, b = system.A, system.B[:, 0]

    def work() -> Any:
        x, response = np.zeros(len(A)), np.zeros(samples)
        starts, middles = _force(times), _force(times + _SAMPLE_STEP / 2)
        for index in range(samples - 1):
            k1 = A @ x + b * starts[index]
            k2 = A @ (x + _SAMPLE_STEP / 2 * k1) + b * middles[index]
            k3 = A @ (x + _SAMPLE_STEP / 2 * k2) + b * middles[index]
            k4 = A @ (x + _SAMPLE_STEP * k3) + b * starts[index + 1]
            x = x + _SAMPLE_STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            response[index + 1] = system.C[0] @ x
        return response

    return work


def _newmark(samples: int) -> Callable[[], Any]:
    """Step with Newmark's average acceleration."""
    import numpy as np
    from scipy.linalg import lu_factor, lu_solve

    M, C, K = _second_order()
    forces = _force(_times(samples))

    def work() -> Any:
        h = _SAMPLE_STEP
        factor = lu_factor(M + h / 2 * C + h**2 / 4 * K)
        x, v, a = (np.zeros(5) for _ in range(3))
        response = np.zeros(samples)
        for index in range(1, samples):
            ahead, faster = x + h * v + h**2 / 4 * a, v + h / 2 * a
            right = -C @ faster - K @ ahead
            right[4] += forces[index]
            a = lu_solve(factor, right)
            x, v = ahead + h**2 / 4 * a, faster + h / 2 * a
            response[index] = v[1]
        return response

    return work


@lru_cache(maxsize=2)
def _reference(samples: int) -> Any:
    """Return the response to the continuous sines, exactly."""
    from dynid.lti.time_response import propagate
    from dynid.lti.waveforms import Multisine

    force = Multisine([100.0] * 3, list(_OMEGA))
    return propagate(_system(), [force], _times(samples)).outputs[:, 0]


def _error(samples: int, response: Any) -> float:
    import numpy as np

    true = _reference(samples)
    return float(np.sqrt(np.mean((response - true) ** 2) / np.mean(true**2)))


BENCHMARK = Benchmark(
    title="Forward simulation of a five-mass suspension under three sines",
    size="samples",
    sizes=(800, 8000),
    alternatives=(
        Alternative("exponential-spline", _by_hold("spline")),
        Alternative("exponential-linear", _by_hold("linear")),
        Alternative("exponential-zero", _by_hold("zero")),
        Alternative("rk4", _runge_kutta, peer=True),
        Alternative("newmark", _newmark, peer=True),
        Alternative("lsim", _lsim, peer=True),
        Alternative("dop853", _integrated, peer=True),
    ),
    error=_error,
    measure="RMS of the error over that of the response",
    default=lambda _: f"exponential-{HOLD.value}",
    full=(80_000,),
)
