"""Alternatives of `dynid bench` by other projects, with packages that dynid itself does not use.

`python -m dynid bench`, run from the root of the sources, loads them where `DYNID_PEER_MODULE` is
`benchmarks.peers`; `DYNID_PEERS` names a Python with these packages and dynid. The Kalman filters of filterpy
and dynamax are written as their users would: the derivative of the states integrated by Runge–Kutta 4, its
Jacobian through the same stages or by automatic differentiation; prior and assumed noise are those of dynid's
pass.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from operator import call
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative
from dynid.bench.cases.estimators import (
    OMEGA,
    STEP,
    SuspensionRecord,
    assumed_noise,
    case,
    each_record,
    first_covariance,
)
from dynid.bench.cases.zeros_poles import controlled
from dynid.templates.chain import distinct


def _forces(this: SuspensionRecord) -> Any:
    """Return the force at the start, the middle and the end of each interval (intervals x 3)."""
    times = this.ensemble.records[0].model.line.nodes
    at = times[:-1, None] + STEP * np.array([0.0, 0.5, 1.0])
    return 100 * np.sin(at[..., None] * np.array(OMEGA)).sum(axis=-1)


def by_filterpy(this: SuspensionRecord) -> Callable[[], Any]:
    """Return filterpy's extended Kalman filter; the work returns the last logarithms."""
    from filterpy.kalman import ExtendedKalmanFilter  # type: ignore[import-not-found,unused-ignore]

    values, force, first = this.ensemble.records[0].data.values, _forces(this), first_covariance(this)
    noise = assumed_noise(this)
    H = np.zeros((2, 14))
    H[0, 6] = H[1, 7] = 1.0

    def rate(z: Any, V: Any, u: float) -> tuple[Any, Any]:
        parameters = np.exp(z[10:])
        J = np.zeros((14, 14))
        J[:10, :10] = this.A + np.tensordot(parameters, this.slopes, 1)
        J[:10, 10:] = (parameters[:, None] * (this.slopes @ z[:10])).T
        return np.append(J[:10, :10] @ z[:10] + this.b * u, np.zeros(4)), J @ V

    class Filter(ExtendedKalmanFilter):  # type: ignore[misc,unused-ignore]
        def predict_x(self, u: Any) -> None:
            state: Any = self
            z, V, h = state.x, np.eye(14), STEP
            k1, K1 = rate(z, V, u[0])
            k2, K2 = rate(z + h / 2 * k1, V + h / 2 * K1, u[1])
            k3, K3 = rate(z + h / 2 * k2, V + h / 2 * K2, u[1])
            k4, K4 = rate(z + h * k3, V + h * K3, u[2])
            self.x = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            self.F = V + h / 6 * (K1 + 2 * K2 + 2 * K3 + K4)

    def work() -> Any:
        run = Filter(14, 2)
        run.x, run.P = np.append(np.zeros(10), this.start), first.copy()
        run.Q = np.zeros((14, 14))
        for k, value in enumerate(values):
            if k:
                run.predict(force[k - 1])
            run.update(value, lambda _: H, lambda z: H @ z, np.diag(noise[k] ** 2))
        return np.asarray(run.x[10:])

    return work


def by_dynamax(this: SuspensionRecord) -> Callable[[], Any]:
    """Return dynamax' extended Kalman filter, in double precision; the work returns the last logarithms."""
    import jax  # type: ignore[import-not-found,unused-ignore]
    import jax.numpy as jnp  # type: ignore[import-not-found,unused-ignore]

    jax.config.update("jax_enable_x64", True)
    from dynamax.nonlinear_gaussian_ssm import (  # type: ignore[import-not-found,unused-ignore]
        ParamsNLGSSM,
        extended_kalman_filter,
    )

    force = _forces(this)
    force = jnp.asarray(np.concatenate([force[:1], force]))  # an input leads to its own sample
    A, slopes, b = jnp.asarray(this.A), jnp.asarray(this.slopes), jnp.asarray(this.b)

    def rate(z: Any, u: Any) -> Any:
        matrix = A + jnp.tensordot(jnp.exp(z[10:]), slopes, 1)
        return jnp.append(matrix @ z[:10] + b * u, jnp.zeros(4))

    def step(z: Any, u: Any) -> Any:
        h = STEP
        k1 = rate(z, u[0])
        k2 = rate(z + h / 2 * k1, u[1])
        k3 = rate(z + h / 2 * k2, u[1])
        return z + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(z + h * k3, u[2]))

    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(np.append(np.zeros(10), this.start)),
        initial_covariance=jnp.asarray(first_covariance(this)),
        dynamics_function=step,
        dynamics_covariance=jnp.zeros((14, 14)),
        emission_function=lambda z, _: z[jnp.array([6, 7])],
        emission_covariance=jnp.asarray(assumed_noise(this)[:, :, None] ** 2 * np.eye(2)),
    )
    values = jnp.asarray(this.ensemble.records[0].data.values)
    run = jax.jit(lambda y, u: extended_kalman_filter(params, y, inputs=u).filtered_means[-1, 10:])
    return lambda: np.asarray(run(values, force).block_until_ready())


def lcapy(stages: int) -> Any:
    """Solve the equivalent circuit (currents are forces, voltages velocities) symbolically."""
    circuit = import_module("lcapy").Circuit()
    for k, (m, spring, damper) in enumerate(distinct(stages), 1):
        end = k + 1 if k < stages else 0
        circuit.add(f"C{k} {k} 0 {{{m}}}")
        circuit.add(f"L{k} {k} {end} {{{1 / spring}}}")
        circuit.add(f"R{k} {k} {end} {{{1 / damper}}}")
    transfer = circuit.transimpedance(1, 0, stages, 0)
    return tuple(
        np.array([root.cval for root, count in roots.items() for _ in range(int(count.cval.real))])
        for roots in (transfer.zeros(), transfer.poles())
    )


def of_record(name: str, make: Callable[[SuspensionRecord], Callable[[], Any]]) -> Alternative:
    """Return the filter pass of a peer over one record."""
    return Alternative(name, call, lambda samples: make(case(samples)), needs=(name,), peer=True)


def of_records(name: str, make: Callable[[SuspensionRecord], Callable[[], Any]]) -> Alternative:
    """Return the filter passes of a peer over all records."""
    return Alternative(
        name, lambda works: [work() for work in works], each_record(make), needs=(name,), peer=True
    )


#: Alternatives by the name of their benchmark.
ALTERNATIVES = {
    "filters": (of_record("filterpy", by_filterpy), of_record("dynamax", by_dynamax)),
    "estimators": (of_records("filterpy", by_filterpy), of_records("dynamax", by_dynamax)),
    "zeros-poles": (
        Alternative("control-slycot", controlled, needs=("control", "slycot"), peer=True),
        Alternative("lcapy", lcapy, needs=("lcapy",), max_size=2, peer=True),
    ),
}
