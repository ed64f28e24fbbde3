"""Filters and estimators on records of the suspension of five masses (Yang, Table 2).

Four joint parameters are unknown and started at half their true values; two velocities are measured with 5 %
noise; the filters have 10 + 4 states.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import ESTIMATOR
from dynid.identification.estimators.filter import LINEARISED_DEVIATIONS, Pass, filter_pass

if TYPE_CHECKING:
    from dynid.identification.likelihood.priors import InitialState
    from dynid.identification.likelihood.time_record import TimeLikelihood

STEP = 0.002
OMEGA = (70.0, 110.0, 250.0)  # rad/s


class SuspensionRecord(NamedTuple):
    """A record with its model, and the matrices of the model in SI.

    `start`, `truth`, `bound`: start and true values of the logarithms of the parameters, and the Cramér–Rao
    bound on their deviations. The state matrix is A without the unknowns plus the sum of values x `slopes`;
    `b` is the column of a force on the last mass.
    """

    ensemble: TimeLikelihood
    start: Any
    truth: Any
    bound: Any
    A: Any
    slopes: Any
    b: Any


@lru_cache(maxsize=8)
def case(samples: int, seed: int = 1) -> SuspensionRecord:
    """Return a record of this length and noise."""
    from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
    from dynid.identification.records.measurement import Measurement, Simulation
    from dynid.identification.systems.parametric_model import parametric_model
    from dynid.identification.systems.record_values import data
    from dynid.lti.signals import Multisine
    from dynid.structure.joints import Joint, JointParameter
    from dynid.structure.lumped import Link, lumped
    from dynid.structure.matrices import as_array
    from dynid.structure.ports import Channel, Load

    joints = [
        Joint(name, dofs, JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0))
        for name, dofs in (("upper", (2, 3)), ("lower", (3, 4)))
    ]
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    model = lumped((2, 2, 1.5, 1, 1), links, joints)
    loads = [Load(5, Multisine([100.0] * 3, list(OMEGA)))]
    channels = (Channel(2, "velocity"), Channel(3, "velocity"))
    measurement = Measurement(STEP, samples, channels, Simulation(0.05, seed, 10.0))
    record = data(model, loads, measurement)
    joint = parametric_model(model, loads, channels, measurement.record.times)
    ensemble = TimeLikelihood((TimeRecord(joint, record),))
    truth = np.log(list(model.true_values().values()))
    start = np.log([unknown.start for unknown in model.unknowns])
    assert record.noise is not None
    bound = ensemble.information(ensemble.fit(truth), [record.noise]).deviations()
    M, C, K = model.dense({unknown.name: 0.0 for unknown in model.unknowns})
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    slopes = np.zeros((4, 10, 10))
    changes = model.slopes(model.true_values())
    for slope, change in zip(slopes, changes, strict=True):
        for letter, pattern in change.items():
            here = slice(0, 5) if letter == "K" else slice(5, 10)
            slope[5:, here] = -np.linalg.solve(M, as_array(pattern))
    b = np.concatenate([np.zeros(5), np.linalg.inv(M)[:, 4]])
    return SuspensionRecord(ensemble, start, truth, bound, A, slopes, b)


@contextmanager
def kernels(wish: str) -> Iterator[None]:
    """Use the compiled kernels (`1`) or not (`0`)."""
    from dynid.native import VARIABLE

    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = wish
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def assumed_noise(this: SuspensionRecord) -> Any:
    """Return the deviations that the first pass assumes (times x channels)."""
    from dynid.identification.estimators.filter_passes import first_noise

    return first_noise(this.ensemble)[0]


def _first_initial_state(this: SuspensionRecord) -> InitialState:
    """Return the prior of all filters."""
    from dynid.identification.estimators.filter_passes import wide_prior

    return wide_prior(this.ensemble.records[0], this.start)


def first_covariance(this: SuspensionRecord) -> Any:
    """Return the prior covariance in SI (14 x 14)."""
    record = this.ensemble.records[0]
    root = _first_initial_state(this).root * np.append(record.model.scale, np.ones(4))[:, None]
    return root @ root.T


def _passed(this: SuspensionRecord, wish: str = "1", deviations: float = LINEARISED_DEVIATIONS) -> Pass:
    """Return dynid's pass, compiled or not; `deviations` 0: linearised anew at every sample."""
    record, prior = this.ensemble.records[0], _first_initial_state(this)
    with kernels(wish):
        return filter_pass(
            record.model, record.data.values, prior, assumed_noise(this), this.start, deviations
        )


def _pass(name: str, *options: Any, **limits: Any) -> Alternative:
    return Alternative(name, lambda this: _passed(this, *options).eta[-1], **limits)


def _joseph(this: SuspensionRecord, precision: str) -> Any:
    """Return the last logarithms of the pass on the covariance itself, in Joseph's form."""
    record = this.ensemble.records[0]
    model, kind = record.model, np.dtype(precision)
    scale = np.append(model.scale, np.ones(4))
    P = (first_covariance(this) / scale / scale[:, None]).astype(kind)
    H = np.zeros((2, 14), dtype=kind)
    H[:, :10] = model.output(this.start)[0]
    noise, values = assumed_noise(this), record.data.values.astype(kind)
    z, eye = np.append(np.zeros(10), this.start).astype(kind), np.eye(14, dtype=kind)
    for k, value in enumerate(values):
        if k:
            step, slopes = model.transition(z[10:].astype(float), STEP)
            driven = np.concatenate([z[:10], model.W[k - 1]])
            F = np.eye(14, dtype=kind)
            F[:10, :10], F[:10, 10:] = step[:, :10], (slopes @ driven).T
            z[:10] = step @ driven
            P = F @ P @ F.T
        R = np.diag(noise[k] ** 2).astype(kind)
        gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        z = z + gain @ (value - H @ z)
        closed = eye - gain @ H
        P = closed @ P @ closed.T + gain @ R @ gain.T
    return z[10:].astype(float)


def _imbedding(this: SuspensionRecord, substeps: int) -> Any:
    """Integrate eqs 19 and 20 as one differential equation, by Runge–Kutta 4 with so many steps a sample."""
    from dynid.identification.estimators.imbedding import Flow, InvariantImbedding

    record, prior = this.ensemble.records[0], _first_initial_state(this)
    weights = 1 / (2 * assumed_noise(this) ** 2 * STEP)
    times, h = record.model.line.nodes, STEP / substeps
    equations = Flow(record, InvariantImbedding(), this.start)
    v = equations.packed(np.concatenate([prior.state, prior.eta]), prior.root @ prior.root.T)
    with np.errstate(all="ignore"):
        for time, weight in zip(times[:-1], weights[:-1], strict=True):
            equations.weight = weight
            for k in range(substeps):
                t = time + k * h
                k1 = equations.rate(t, v)
                k2 = equations.rate(t + h / 2, v + h / 2 * k1)
                k3 = equations.rate(t + h / 2, v + h / 2 * k2)
                v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + equations.rate(t + h, v + h * k3))
    return v[10:14]


@lru_cache(maxsize=4)
def _exact_pass(samples: int) -> Pass:
    return _passed(case(samples), "1", 0.0)


def _filter_error(samples: int, logarithms: Any) -> float:
    exact = _exact_pass(samples)
    error = float(np.max(np.abs(logarithms - exact.eta[-1]) / exact.deviations[-1]))
    return error if np.isfinite(error) else float("inf")


FILTERS = Benchmark(
    title="One filter pass over the suspension's record, 10 + 4 states",
    size="samples",
    sizes=(800, 8000),
    alternatives=(
        _pass("square-root"),
        _pass("square-root-numpy", "0"),
        _pass("every-sample", "1", 0.0),
        _pass("every-sample-numpy", "0", 0.0, max_size=8000),
        Alternative("joseph", partial(_joseph, precision="float64"), max_size=8000),
        Alternative("joseph-float32", partial(_joseph, precision="float32"), max_size=8000),
        *(Alternative(f"imbedding-{k}", partial(_imbedding, substeps=k), max_size=800) for k in (1, 4)),
    ),
    error=_filter_error,
    problem=case,
    measure="largest distance from the filter linearised at every sample, in its deviations; inf: no number",
    default=lambda _: "square-root",
    full=(80_000,),
)


#: Seeds of the noise of the records.
_SEEDS = (1, 2, 3, 4)


def each_record(make: Callable[[SuspensionRecord], Callable[[], Any]]) -> Callable[[int], Any]:
    """Return the preparation of the works on all records."""
    return lambda samples: [make(this) for this in _cases(samples)]


def _cases(samples: int) -> list[SuspensionRecord]:
    return [case(samples, seed) for seed in _SEEDS]


def _estimated(cases: list[SuspensionRecord], name: str, wish: str = "1") -> Any:
    """Return the logarithms that an estimator of dynid finds, with compiled kernels or without."""
    from dynid.identification.estimators.auto import Auto
    from dynid.identification.estimators.estimate import Estimator
    from dynid.identification.estimators.filter_passes import Filter
    from dynid.identification.estimators.imbedding import InvariantImbedding
    from dynid.identification.estimators.maximum_likelihood import OutputError

    estimators: dict[str, Estimator] = {f"filter-{k}": Filter(k) for k in (1, 2, 3)}
    estimators |= {each.name: each for each in (Auto(), OutputError(), InvariantImbedding())}
    with kernels(wish):
        return [estimators[name].run(this.ensemble, this.start).fit.eta for this in cases]


def _least_squares(cases: list[SuspensionRecord]) -> Any:
    """Return SciPy's optimiser on a simulation, Jacobian by differences, initial state among the unknowns."""
    from scipy.optimize import least_squares

    from dynid.identification.systems.prediction import free_prediction

    def residual(unknown: Any, this: SuspensionRecord) -> Any:
        record = this.ensemble.records[0]
        free, _ = free_prediction(record.model, unknown[:4])
        seen = free.forced + free.by_state @ (record.root @ unknown[4:])
        return ((record.data.values - seen) / record.data.rms).ravel()

    with kernels("0"):
        return [
            least_squares(residual, np.append(this.start, np.zeros(10)), args=(this,)).x[:4] for this in cases
        ]


def _estimator_error(samples: int, estimates: Any) -> float:
    errors = [(eta - this.truth) / this.bound for eta, this in zip(estimates, _cases(samples), strict=True)]
    return float(np.sqrt(np.mean(np.square(errors))))


ESTIMATORS = Benchmark(
    title="Four joint parameters of the suspension, from four records",
    size="samples",
    sizes=(800,),
    alternatives=(
        Alternative("auto", partial(_estimated, name="auto")),
        Alternative("auto-numpy", partial(_estimated, name="auto", wish="0"), max_size=8000),
        *(
            Alternative(name, partial(_estimated, name=name))
            for name in ("filter-1", "filter-2", "filter-3", "output-error")
        ),
        Alternative("invariant-imbedding", partial(_estimated, name="invariant-imbedding"), max_size=200),
        Alternative("least-squares", _least_squares, peer=True),
    ),
    error=_estimator_error,
    problem=_cases,
    measure="RMS of the errors over the Cramér-Rao bound",
    default=lambda _: ESTIMATOR.value,
    full=(8000, 80_000),
)
