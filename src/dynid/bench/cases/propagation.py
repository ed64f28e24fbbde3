"""Forward simulation of the five-mass suspension under three sampled sines."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import HOLD

_SAMPLE_STEP = 0.002
_OMEGA = (70.0, 110.0, 250.0)  # rad/s


@lru_cache(maxsize=1)
def _second_order() -> tuple[Any, Any, Any]:
    """Return M, C, K of Yang's suspension; each damper is a thousandth of its spring."""
    from dynid.structure.lumped import Link, lumped

    springs = {(1,): 2e4, (1, 2): 3e4, (2, 3): 2e4, (3, 4): 2e4, (4, 5): 2e4}
    links = [Link(dofs, k, k / 1000) for dofs, k in springs.items()]
    return lumped((2.0, 2.0, 1.5, 1.0, 1.0), links).dense()


@lru_cache(maxsize=1)
def _system() -> Any:
    from dynid.structure.state_space import state_space

    force, row = np.zeros((5, 1)), np.zeros((1, 5))
    force[4, 0] = row[0, 1] = 1.0
    return state_space(*_second_order(), force, row, [1])


def _times(samples: int) -> Any:
    return _SAMPLE_STEP * np.arange(samples)


def _force(t: Any) -> Any:
    return sum(100 * np.sin(omega * t) for omega in _OMEGA)


def _held(hold: str, samples: int) -> tuple[Any, Any]:
    from dynid.lti.noise import Sampled

    times = _times(samples)
    return Sampled(_force(times), _SAMPLE_STEP, hold), times


def _propagated(problem: tuple[Any, Any]) -> Any:
    from dynid.lti.time_response import propagate

    signal, times = problem
    return propagate(_system(), [signal], times).outputs[:, 0]


def _lsim(times: Any) -> Any:
    from scipy.signal import lsim

    system = _system()
    return lsim((system.A, system.B, system.C, system.D), _force(times), times)[1]


def _integrated(times: Any) -> Any:
    """Integrate with DOP853 at a tolerance of 1e-8, the force in closed form."""
    from scipy.integrate import solve_ivp

    system = _system()
    A, b = system.A, system.B[:, 0]

    def rate(t: float, x: Any) -> Any:
        return A @ x + b * _force(t)

    solved = solve_ivp(rate, (0, times[-1]), [0.0] * len(A), "DOP853", times, rtol=1e-8, atol=1e-12)
    return (system.C @ solved.y)[0]


def _runge_kutta(times: Any) -> Any:
    """Step with RK4, the force in closed form."""
    system = _system()
    A, b = system.A, system.B[:, 0]
    x, response = np.zeros(len(A)), np.zeros(len(times))
    starts, middles = _force(times), _force(times + _SAMPLE_STEP / 2)
    for index in range(len(times) - 1):
        k1 = A @ x + b * starts[index]
        k2 = A @ (x + _SAMPLE_STEP / 2 * k1) + b * middles[index]
        k3 = A @ (x + _SAMPLE_STEP / 2 * k2) + b * middles[index]
        k4 = A @ (x + _SAMPLE_STEP * k3) + b * starts[index + 1]
        x = x + _SAMPLE_STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        response[index + 1] = system.C[0] @ x
    return response


def _newmark(times: Any) -> Any:
    """Step with Newmark's average acceleration."""
    from scipy.linalg import lu_factor, lu_solve

    (M, C, K), h = _second_order(), _SAMPLE_STEP
    forces = _force(times)
    factor = lu_factor(M + h / 2 * C + h**2 / 4 * K)
    x, v, a = (np.zeros(5) for _ in range(3))
    response = np.zeros(len(times))
    for index in range(1, len(times)):
        ahead, faster = x + h * v + h**2 / 4 * a, v + h / 2 * a
        right = -C @ faster - K @ ahead
        right[4] += forces[index]
        a = lu_solve(factor, right)
        x, v = ahead + h**2 / 4 * a, faster + h / 2 * a
        response[index] = v[1]
    return response


@lru_cache(maxsize=2)
def _reference(samples: int) -> Any:
    """Return the response to the continuous sines, exactly."""
    from dynid.lti.waveforms import Multisine

    return _propagated((Multisine([100.0] * 3, list(_OMEGA)), _times(samples)))


def _error(samples: int, response: Any) -> float:
    true = _reference(samples)
    return float(np.sqrt(np.mean((response - true) ** 2) / np.mean(true**2)))


BENCHMARK = Benchmark(
    title="Forward simulation of a five-mass suspension under three sines",
    size="samples",
    sizes=(800, 8000),
    alternatives=(
        *(
            Alternative(f"exponential-{hold}", _propagated, partial(_held, hold))
            for hold in ("spline", "linear", "zero")
        ),
        Alternative("rk4", _runge_kutta, peer=True),
        Alternative("newmark", _newmark, peer=True),
        Alternative("lsim", _lsim, peer=True),
        Alternative("dop853", _integrated, peer=True),
    ),
    error=_error,
    problem=_times,
    measure="RMS of the error over that of the response",
    default=lambda _: f"exponential-{HOLD.value}",
    full=(80_000,),
)
