"""The suspension of five masses (Yang, Table 2) with four unknown parameters: records, and peers' filters.

Two velocities with 5 % noise, 10 + 4 states, started at half the true values. The peers' process is what
their users write: the states' derivative integrated by Runge–Kutta 4, its Jacobian through the same stages
(filterpy) or by automatic differentiation (dynamax); prior and assumed noise are those of the house's pass.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from dynid.identification.ensemble import Ensemble
    from dynid.identification.filtering.filter import Prior
    from dynid.structure.model import StructuralModel

STEP = 0.002
_OMEGA = (70.0, 110.0, 250.0)  # rad/s


class Case(NamedTuple):
    """A record with its model, and the model in SI as a peer's user has it.

    `start`, `truth`, `bound`: logarithms to start from and to find, and the Cramér–Rao bound on their
    deviations; ``A + sum of values x slopes`` and `b` are the system.
    """

    ensemble: Ensemble
    start: Any
    truth: Any
    bound: Any
    A: Any
    slopes: Any
    b: Any


@lru_cache(maxsize=8)
def case(samples: int, seed: int = 1) -> Case:
    """Return a record of this length and noise."""
    import numpy as np

    from dynid.identification.augmented import augmented
    from dynid.identification.ensemble import Ensemble
    from dynid.identification.fit import fitter
    from dynid.identification.measurement import Measurement, Simulation, data
    from dynid.lti.signals import Multisine
    from dynid.structure.response import Channel, Load

    model = _structure()
    loads = [Load(5, Multisine([100.0] * 3, list(_OMEGA)))]
    channels = (Channel(2, "velocity"), Channel(3, "velocity"))
    measurement = Measurement(STEP, samples, channels, Simulation(0.05, seed, 10.0))
    record = data(model, loads, measurement)
    joint = augmented(model, loads, channels, measurement.record.times)
    ensemble = Ensemble((fitter(joint, model, channels, record),))
    truth = np.log(list(model.true_values().values()))
    start = np.log([unknown.start for unknown in model.unknowns])
    assert record.noise is not None
    bound = ensemble.information(ensemble.fit(truth), [record.noise]).deviations()
    return Case(ensemble, start, truth, bound, *_system(model))


def _structure() -> StructuralModel:
    """Return the five masses."""
    from dynid.structure.joints import Joint, JointParameter
    from dynid.structure.lumped import Link, lumped

    joints = [
        Joint(name, dofs, JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0))
        for name, dofs in (("upper", (2, 3)), ("lower", (3, 4)))
    ]
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    return lumped((2, 2, 1.5, 1, 1), links, joints)


def _system(model: StructuralModel) -> tuple[Any, Any, Any]:
    """Return A without the unknowns, its change by each, and b of a force on the last mass."""
    import numpy as np

    from dynid.structure.matrices import as_array

    M, C, K = model.dense({unknown.name: 0.0 for unknown in model.unknowns})
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    slopes = np.zeros((4, 10, 10))
    for slope, unknown in zip(slopes, model.unknowns, strict=True):
        here = slice(0, 5) if unknown.letter == "k" else slice(5, 10)
        slope[5:, here] = -np.linalg.solve(M, as_array(unknown.pattern))
    return A, slopes, np.concatenate([np.zeros(5), np.linalg.inv(M)[:, 4]])


#: What the times of a filter do not show.
REMARK = (
    "a process that loads the kernels takes longer before it begins (startup: run-identification-kernels), "
    "so that short records are filtered without them; DYNID_COMPILED=1 has them always"
)


def compiles(samples: int, records: int = 1) -> bool:
    """Tell whether the suite compiles its kernels by default for so many records of this length."""
    from dynid.identification.kernels.compiled import compiled, repeated

    with repeated(records):
        return compiled(samples, 10 + 2 * len(_OMEGA), 4)


@contextmanager
def kernels(wish: str) -> Iterator[None]:
    """Compile, or do not, whatever the sizes."""
    from dynid.identification.kernels.compiled import VARIABLE

    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = wish
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def assumed_noise(this: Case) -> Any:
    """Return the deviations that the first pass assumes (times x channels)."""
    from dynid.identification.estimators.passes import first_noise

    return first_noise(this.ensemble)[0]


def first_prior(this: Case) -> Prior:
    """Return what every filter starts with."""
    return this.ensemble.records[0].wide_prior(this.start)


def first_covariance(this: Case) -> Any:
    """Return its covariance in SI (14 x 14)."""
    import numpy as np

    record = this.ensemble.records[0]
    root = first_prior(this).root * np.append(record.model.scale, np.ones(4))[:, None]
    return root @ root.T


def _forces(this: Case) -> Any:
    """Return the force at the begin, the middle and the end of each interval (intervals x 3)."""
    import numpy as np

    times = this.ensemble.records[0].model.line.nodes
    at = times[:-1, None] + STEP * np.array([0.0, 0.5, 1.0])
    return 100 * np.sin(at[..., None] * np.array(_OMEGA)).sum(axis=-1)


def by_filterpy(this: Case) -> Callable[[], Any]:
    """Return filterpy's extended Kalman filter; the work returns the last logarithms."""
    import numpy as np
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


def by_dynamax(this: Case) -> Callable[[], Any]:
    """Return dynamax' extended Kalman filter, in double precision; the work returns the last logarithms."""
    import jax  # type: ignore[import-not-found,unused-ignore]
    import jax.numpy as jnp  # type: ignore[import-not-found,unused-ignore]
    import numpy as np

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
