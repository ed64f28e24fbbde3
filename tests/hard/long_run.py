"""Long runs: energy that must stay, and covariances that must stay positive."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from dynid.identification.estimators.filter import LINEARISED_DEVIATIONS, _walk, filter_pass
from dynid.identification.estimators.filter_passes import wide_prior
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import Measurement, Simulation
from dynid.identification.systems.parametric_model import (
    DirectTerm,
    ParametricModel,
    Transition,
    parametric_model,
)
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Multisine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.hard.case import Case
from tests.hard.records import LINES, one_mass, run
from tests.hard.scenes import graph

RING = ("Se u, 1 j, I m 3, C c 1/7", "u -> j -> m, j -> c")
COUPLED = (
    "Se u, 1 a, I m 3, C c 1/7, 0 x, C k 1/50, 1 b, I n 1/100",
    "u -> a -> m, a -> c, a -> x -> k, x -> b -> n",
)


def drift(nodes: str, bonds: str, outputs: list[str], weights: list[float], step: float, steps: int) -> float:
    """Return the largest part of its energy that a free, undamped graph gains or loses."""
    time = {"stop": step * steps, "step": step}
    scene = graph(
        nodes, bonds, outputs, results=["time_response"], time=time, initial={"m": {"f": 1}, "c": {"e": 2}}
    )
    response = run(scene).value("bond_graph/time_response/response")
    energy = response**2 @ np.array(weights) / 2
    assert len(energy) >= steps
    return float(np.abs(energy / energy[0] - 1).max())


def _energy(steps: int, *, slow: bool) -> list[Case]:
    ring = partial(drift, *RING, ["m.f", "c.e"], [3, 1 / 7])
    coupled = partial(drift, *COUPLED, ["m.f", "c.e", "k.e", "n.f"], [3, 1 / 7, 1 / 50, 1 / 100])
    return [
        Case(f"drift of energy over {steps:,} steps of {what}", "long run", "conservation of energy",
             partial(ask, step, steps), None, 1e-9, slow=slow)
        for what, ask, step in (
            ("0.02 rad of a ring", ring, 0.01),
            ("0.6 rad of a ring", ring, 0.37),
            ("0.03 and 0.7 rad of two coupled masses", coupled, 0.01),
        )
    ]  # fmt: skip


def _sure(samples: int) -> dict[str, Any]:
    """Tell whether the deviations of a filter stay finite, positive, and do not grow."""
    scene = one_mass(1.0, 1e4, 20.0, 0.01, samples)
    scene["estimator"] = {"method": "filter", "passes": 1}
    deviation = run(scene).value("identification/history/standard_deviation")
    return {
        "finite": bool(np.isfinite(deviation).all()),
        "positive": bool((deviation > 0).all()),
        "shrinking": bool((deviation[-1] < deviation[0]).all()),
    }


def _covariances(samples: int, parts: int) -> dict[str, Any]:
    """Tell whether a filter's covariance is symmetric and positive definite all along a record.

    The pass is run part after part, each from where the one before it ended, and the whole covariance of
    states and parameters is looked at after each. Without damping no state is ever forgotten: with it the
    covariance of states is in the end that of the parameters seen through the model, and singular.
    """
    joint = Joint("joint", (1,), JointParameter(start=9.9e3, true=1e4))
    model, channels = lumped([1.0], [], [joint]), (Channel(1, "velocity"),)
    loads = [Load(1, Multisine([100.0, 100.0], [90.0, 50.0]))]
    taken = Measurement(0.01, samples, channels, Simulation(0.05, 1))
    record, times = data(model, loads, taken), taken.record.times
    joined = parametric_model(model, loads, channels, times[:2])
    prior = wide_prior(TimeRecord(joined, record), np.log([9.9e3]))
    origin, smallest, symmetric = prior.eta, [], True
    for rows in np.array_split(np.arange(samples), parts):
        here = slice(max(rows[0] - 1, 0), rows[-1] + 1)
        values = record.values[here].copy()
        values[: rows[0] - here.start] = np.nan  # the last sample of the part before: it has been heard
        joined = parametric_model(model, loads, channels, times[here])
        done = filter_pass(joined, values, prior, record.noise, origin)
        prior = InitialState(done.states[-1], done.eta[-1], done.whole)
        P = done.whole @ done.whole.T
        symmetric &= bool((P == P.T).all())
        size = np.sqrt(np.diag(P))
        smallest.append(np.linalg.eigvalsh(P / np.outer(size, size))[0])
    return {"symmetric": symmetric, "positive definite": bool(min(smallest) > 1e-9)}


# --- a filter in single precision beside double ---------------------------------------------------


def riccati(steps: int, kind: type, *, joseph: bool) -> np.ndarray:
    """Return the covariance of a filter on a lasting oscillation after many steps, in one precision.

    A motion of 0.3 rad a step is read with an unknown constant added; nothing disturbs it, so that the
    covariance shrinks as 1 / steps: the hard case for its sign.
    """
    turn = np.array([[np.cos(0.3), np.sin(0.3), 0], [-np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]]).astype(kind)
    H, R = np.array([[1, 0, 1]], dtype=kind), kind(1e-6)
    P = np.diag([1e2, 1e2, 1e2]).astype(kind)
    one = np.eye(3, dtype=kind)
    for _ in range(steps):
        P = turn @ P @ turn.T
        S = H @ P @ H.T + R
        gain = P @ H.T / S
        keep = one - gain @ H
        P = keep @ P @ keep.T + gain * R @ gain.T if joseph else keep @ P
    return P


def _margin(kind: type) -> float:
    """Return how far the covariance in a precision is from the exact one, ``(sum of h h^T / R)^-1``."""
    steps = 2000
    P = riccati(steps, kind, joseph=True).astype(float)
    turn = 0.3 * np.arange(1 - steps, 1)
    h = np.stack([np.cos(turn), np.sin(turn), np.ones(steps)])
    exact = np.linalg.inv(h @ h.T / 1e-6 + np.eye(3) / 1e2)
    size = np.sqrt(np.diag(exact))
    return float(np.abs((P - exact) / np.outer(size, size)).max())


# --- the suite's own pass in single and double precision -------------------------------------------


class _Rounded(ParametricModel):
    """A model whose numbers and steps are of one precision."""

    def transition(self, eta: np.ndarray, h: float) -> Transition:
        exact = super().transition(eta.astype(float), h)
        return Transition(*(part.astype(self.scale.dtype) for part in exact))

    def output(self, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        C, slopes = super().output(eta.astype(float))
        return C.astype(self.scale.dtype), slopes.astype(self.scale.dtype)

    def direct(self, eta: np.ndarray) -> DirectTerm:
        return DirectTerm(super().direct(eta.astype(float)).value.astype(self.scale.dtype), None)


def _rounded(model: ParametricModel, kind: type) -> _Rounded:
    own = {field.name: getattr(model, field.name) for field in fields(model)}
    own["line"] = replace(model.line, W=model.line.W.astype(kind))
    numbers = {
        name: value
        for name, value in own.items()
        if isinstance(value, np.ndarray) and value.dtype.kind == "f"
    }
    return _Rounded(**own | {name: value.astype(kind) for name, value in numbers.items()})


def passed(kind: type) -> tuple[np.ndarray, np.ndarray]:
    """Return logarithms and deviations along a pass of the suspension's filter, all in one precision."""
    k, c = JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0)
    joints = [Joint("upper", (2, 3), k, c), Joint("lower", (3, 4), k, c)]
    links = [Link((1,), 2e4, 20.0), Link((1, 2), 3e4, 30.0), Link((4, 5), 2e4, 20.0)]
    structure = lumped([2.0, 2.0, 1.5, 1.0, 1.0], links, joints)
    loads, channels = (
        [Load(5, Multisine([100.0] * 3, LINES))],
        (Channel(2, "velocity"), Channel(3, "velocity")),
    )
    taken = Measurement(0.002, 800, channels, Simulation(0.05, 1, 10.0))
    record = data(structure, loads, taken)
    model = parametric_model(structure, loads, channels, taken.record.times)
    prior = wide_prior(TimeRecord(model, record), np.log([u.start for u in model.unknowns]))
    z, S = np.concatenate([prior.state, prior.eta]).astype(kind), prior.root.astype(kind)
    n, p, count = model.states, model.parameters, len(record.values)
    widths = {"eta": p, "deviations": p, "states": n, "state_deviations": n}
    widths["innovations"] = record.values.shape[1]
    history = {name: np.zeros((count, width), dtype=kind) for name, width in widths.items()}
    weight = np.broadcast_to(1 / record.noise, record.values.shape).astype(kind)
    origin = prior.eta.astype(kind)
    with np.errstate(over="ignore"):  # the bounds on safe squares are those of doubles
        _walk(
            _rounded(model, kind),
            record.values.astype(kind),
            weight,
            z,
            S,
            origin,
            history,
            LINEARISED_DEVIATIONS,
        )
    return history["eta"], history["deviations"]


def _rounding(kind: type) -> float:
    """Return how far roundings of a pass move an estimate at most, in its deviations."""
    (eta, _), (true, deviations) = passed(kind), passed(np.longdouble)
    return float(np.abs((eta - true) / deviations).max())


def _sure_case(samples: int) -> Case:
    known = {"finite": True, "positive": True, "shrinking": True}
    name = f"a filter over {samples:,} samples stays positive and sure"
    ask = partial(_sure, samples)
    return Case(name, "long run", "information adds up", ask, known, slow=samples > 10_000)


def _covariance_case(samples: int, parts: int) -> Case:
    known = {"symmetric": True, "positive definite": True}
    name = f"a filter's covariance over {samples:,} samples stays symmetric and positive definite"
    ask = partial(_covariances, samples, parts)
    return Case(name, "long run", "a covariance is one", ask, known, slow=samples > 10_000)


def _margin_case(kind: type, bound: float) -> Case:
    name = f"for comparison, a textbook filter (Joseph's form) in {kind.__name__}"
    return Case(name, "long run", "sum of information", partial(_margin, kind), None, bound)


def _rounding_case(kind: type, bound: float) -> Case:
    name = f"dynid's own filter pass in {kind.__name__}, in standard deviations of the estimates"
    source = "the same pass in extended precision"
    return Case(name, "identification", source, partial(_rounding, kind), None, bound)


CASES = [
    *_energy(100_000, slow=False),
    *_energy(10_000_000, slow=True),
    _sure_case(4_000),
    _sure_case(1_000_000),
    _covariance_case(4_000, 10),
    _covariance_case(1_000_000, 20),
    _margin_case(np.float64, 1e-8),
    _margin_case(np.float32, 0.1),
    _rounding_case(np.float64, 1e-10),
    _rounding_case(np.float32, 0.02),
]
