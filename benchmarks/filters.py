"""A filter pass and the default estimator beside filterpy and dynamax, on the same record, in one go.

The suspension of five masses (Yang, Table 2): four unknown joint parameters, 10 + 4 states, two velocities
with 5 % noise, start at half the true values. The peers' process is what their users write: the states'
derivative integrated by Runge–Kutta 4, its Jacobian through the same stages (filterpy) or by automatic
differentiation (dynamax). Each figure is the least of several runs, compilation not counted; `error` is the
largest error of a parameter over its Cramér–Rao bound.

Run with `python benchmarks/filters.py [SAMPLES]...`. Peers that are not installed are named as missing.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.identification.augmented import augmented
from dynid.identification.ensemble import Ensemble
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.passes import first_noise, run_passes
from dynid.identification.fit import fitter
from dynid.identification.kernels.compiled import VARIABLE
from dynid.identification.measurement import Measurement, Simulation, data
from dynid.lti.signals import Multisine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.matrices import as_array
from dynid.structure.response import Channel, Load

Array = NDArray[np.float64]

STEP, SAMPLES, RUNS, LONGEST = 0.002, (800, 8_000), 7, 20.0
FREQUENCIES = (70.0, 110.0, 250.0)
CHANNELS = (Channel(2, "velocity"), Channel(3, "velocity"))


class Case(NamedTuple):
    """The record, and the model in SI as a peer's user has it."""

    ensemble: Ensemble
    start: Array
    A: Array
    slopes: Array
    b: Array
    bound: Array
    truth: Array


def case(samples: int) -> Case:
    """Return the case with a record of this length."""
    joints = [
        Joint(name, dofs, JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0))
        for name, dofs in (("upper", (2, 3)), ("lower", (3, 4)))
    ]
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    model = lumped((2, 2, 1.5, 1, 1), links, joints)
    loads = [Load(5, Multisine([100.0] * 3, list(FREQUENCIES)))]
    measurement = Measurement(STEP, samples, CHANNELS, Simulation(0.05, 1, 10.0))
    record = data(model, loads, measurement)
    joint = augmented(model, loads, CHANNELS, measurement.record.times)
    ensemble = Ensemble((fitter(joint, model, CHANNELS, record),))
    M, C, K = model.dense({unknown.name: 0.0 for unknown in model.unknowns})
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    slopes = np.zeros((4, 10, 10))
    for slope, unknown in zip(slopes, model.unknowns, strict=True):
        here = slice(0, 5) if unknown.letter == "k" else slice(5, 10)
        slope[5:, here] = -np.linalg.solve(M, as_array(unknown.pattern))
    b = np.concatenate([np.zeros(5), np.linalg.inv(M)[:, 4]])
    truth = np.log([unknown.true for unknown in model.unknowns])
    assert record.noise is not None
    best = ensemble.fit(truth)
    bound = ensemble.information(best, [record.noise]).deviations()
    start = np.log([unknown.start for unknown in model.unknowns])
    return Case(ensemble, start, A, slopes, b, bound, truth)


def forces(case: Case) -> Array:
    """Return the force at the begin, the middle and the end of each interval (intervals x 3)."""
    times = case.ensemble.records[0].model.line.nodes
    at = times[:-1, None] + STEP * np.array([0.0, 0.5, 1.0])
    return np.asarray(100 * np.sin(at[..., None] * np.array(FREQUENCIES)).sum(axis=-1))


def first_covariance(case: Case) -> Array:
    """Return the covariance that every filter starts with, in SI."""
    record = case.ensemble.records[0]
    root = record.wide_prior(case.start).root * np.append(record.model.scale, np.ones(4))[:, None]
    return root @ root.T


def by_dynid(case: Case, wish: str) -> Callable[[], Array]:
    """Return our pass, compiled or not."""

    def work() -> Array:
        os.environ[VARIABLE] = wish
        return run_passes(case.ensemble, 1, case.start)[-1][-1].logs[-1]

    return work


def by_auto(case: Case, wish: str) -> Callable[[], Array]:
    """Return the default estimator, from the start to the optimum."""

    def work() -> Array:
        os.environ[VARIABLE] = wish
        return Auto().run(case.ensemble, case.start).fit.logs

    return work


def by_filterpy(case: Case) -> Callable[[], Array]:
    """Return filterpy's extended Kalman filter."""
    from filterpy.kalman import ExtendedKalmanFilter

    values, force, first = case.ensemble.records[0].data.values, forces(case), first_covariance(case)
    noise = first_noise(case.ensemble)[0]
    H = np.zeros((2, 14))
    H[0, 6] = H[1, 7] = 1.0

    def rate(z: Array, V: Array, u: float) -> tuple[Array, Array]:
        values = np.exp(z[10:])
        J = np.zeros((14, 14))
        J[:10, :10] = case.A + np.tensordot(values, case.slopes, 1)
        J[:10, 10:] = (values[:, None] * (case.slopes @ z[:10])).T
        return np.append(J[:10, :10] @ z[:10] + case.b * u, np.zeros(4)), J @ V

    class Filter(ExtendedKalmanFilter):  # type: ignore[misc]
        def predict_x(self, u: Array) -> None:
            z, V, h = self.x, np.eye(14), STEP
            k1, K1 = rate(z, V, u[0])
            k2, K2 = rate(z + h / 2 * k1, V + h / 2 * K1, u[1])
            k3, K3 = rate(z + h / 2 * k2, V + h / 2 * K2, u[1])
            k4, K4 = rate(z + h * k3, V + h * K3, u[2])
            self.x = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            self.F = V + h / 6 * (K1 + 2 * K2 + 2 * K3 + K4)

    def work() -> Array:
        run = Filter(14, 2)
        run.x, run.P = np.append(np.zeros(10), case.start), first.copy()
        run.Q = np.zeros((14, 14))
        for k, value in enumerate(values):
            if k:
                run.predict(force[k - 1])
            run.update(value, lambda _: H, lambda z: H @ z, np.diag(noise[k] ** 2))
        return np.asarray(run.x[10:])

    return work


def by_dynamax(case: Case) -> Callable[[], Array]:
    """Return dynamax' extended Kalman filter, in double precision."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter

    record = case.ensemble.records[0]
    force = forces(case)
    force = jnp.asarray(np.concatenate([force[:1], force]))  # an input leads to its own sample
    A, slopes, b = jnp.asarray(case.A), jnp.asarray(case.slopes), jnp.asarray(case.b)

    def rate(z, u):  # type: ignore[no-untyped-def]
        matrix = A + jnp.tensordot(jnp.exp(z[10:]), slopes, 1)
        return jnp.append(matrix @ z[:10] + b * u, jnp.zeros(4))

    def step(z, u):  # type: ignore[no-untyped-def]
        h = STEP
        k1 = rate(z, u[0])
        k2 = rate(z + h / 2 * k1, u[1])
        k3 = rate(z + h / 2 * k2, u[1])
        return z + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(z + h * k3, u[2]))

    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(np.append(np.zeros(10), case.start)),
        initial_covariance=jnp.asarray(first_covariance(case)),
        dynamics_function=step,
        dynamics_covariance=jnp.zeros((14, 14)),
        emission_function=lambda z, _: z[jnp.array([6, 7])],
        emission_covariance=jnp.asarray(first_noise(case.ensemble)[0][:, :, None] ** 2 * np.eye(2)),
    )
    values = jnp.asarray(record.data.values)
    run = jax.jit(lambda y, u: extended_kalman_filter(params, y, inputs=u).filtered_means[-1, 10:])
    return lambda: np.asarray(run(values, force).block_until_ready())


def timed(works: dict[str, Callable[[], Array]]) -> dict[str, float]:
    """Return the least wall time of each; they take turns, so that a drift of the machine hits all."""
    times = {name: float("inf") for name in works}
    started = perf_counter()
    for _ in range(RUNS):
        for name, work in works.items():
            begin = perf_counter()
            work()
            times[name] = min(times[name], perf_counter() - begin)
        if perf_counter() - started > LONGEST:
            break
    return times


def main() -> None:
    """Print the figures."""
    for samples in [int(word) for word in sys.argv[1:]] or SAMPLES:
        this = case(samples)
        works = {
            "dynid pass, NumPy": by_dynid(this, "0"),
            "dynid pass, compiled": by_dynid(this, "1"),
            "dynid auto, NumPy": by_auto(this, "0"),
            "dynid auto, compiled": by_auto(this, "1"),
        }
        for name, make in (("filterpy EKF", by_filterpy), ("dynamax EKF", by_dynamax)):
            try:
                works[name] = make(this)
            except ImportError:
                print(f"{name}: not installed")
        errors = {name: np.abs((work() - this.truth) / this.bound).max() for name, work in works.items()}
        times = timed(works)
        peers = [name for name in works if not name.startswith("dynid")]
        print(f"\n{samples:,} samples           time    error" + "".join(f"   {peer} /" for peer in peers))
        for name, time in times.items():
            ratios = "".join(f"{times[peer] / time:>{len(peer) + 5}.2f}" for peer in peers)
            print(f"{name:<22} {time * 1e3:>8.2f} ms {errors[name]:>6.2f}{ratios}")


if __name__ == "__main__":
    main()
