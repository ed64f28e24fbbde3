"""A measured robot arm: a graph of two inertias identified from half of a record predicts the other half.

The data (the flexible robot arm of the collection DaISy, De Moor, KU Leuven) are two bare columns, torque
and acceleration, in unknown units; a step of 2 ms is assumed, and only scales the estimates. The graph is an
inertia on a spring and damper to the ground, and a second one on it, which the torque drives and whose
acceleration is measured: 4 states, 6 unknowns. Peers are ARX models (least squares) and subspace models
(N4SID by an oblique projection), from the same half. No prediction uses measured outputs of the second half;
that of ARX starts from the last ones of the first.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bench.benchmark import DATA, Alternative, Benchmark

if TYPE_CHECKING:
    from dynid.arrays import Array

_FILE = "measured/robot_arm.dat"
_SCENE = """\
dynid: 1
kind: identification
title: Robot arm
parameters:
  J1: {start: 1}
  J2: {start: 1}
  k0: {start: 5.0e+4}
  k: {start: 5.0e+4}
  d0: {start: 5}
  d: {start: 5}
graph:
  nodes:
    T: Se
    base: 1
    J1: {type: I, value: J1, domain: rotational}
    k0: {type: C, value: 1/k0}
    d0: {type: R, value: d0}
    twist: 0
    joint: 1
    k: {type: C, value: 1/k}
    d: {type: R, value: d}
    arm: 1
    J2: {type: I, value: J2}
  bonds: [T -> arm, arm -> J2, base -> twist -> arm, base -> J1, base -> k0, base -> d0, twist -> joint -> k,
    joint -> d]
excitation: [{source: T, kind: file, path: FILE, column: 1}]
measurement:
  step: 0.002
  samples: SAMPLES
  channels: [{output: J2.e, gain: 1/J2}]
  file: {path: FILE, columns: [2]}
"""


def _data_file() -> Path:
    """Return the file of the record: in the folder ``DYNID_DATA``, else in that beside the sources."""
    shared_data = Path(__file__).resolve().parents[4].parent / "shared/data"
    return Path(os.environ.get(DATA, shared_data)).resolve() / _FILE


def missing_data() -> str:
    """Return what is missing to run, or an empty text."""
    path = _data_file()
    return "" if path.is_file() else f"no file {path}; {DATA} names the folder with '{_FILE}'"


def record(samples: int) -> Array:
    """Return torque and acceleration (2 x samples)."""
    return np.loadtxt(_data_file(), max_rows=samples).T


def fit(measured: Array, predicted: Array) -> float:
    """Return the fit in per cent, ``100 (1 - |y - y_p| / |y - mean|)``."""
    error = np.linalg.norm(measured - predicted)
    return float(100 * (1 - error / np.linalg.norm(measured - measured.mean())))


def by_graph(samples: int) -> tuple[dict[str, float], Array]:
    """Return the estimates by the first half of the samples, and the graph's prediction of all of them."""
    from dynid.identification.systems.parametric_model import parametric_model
    from dynid.identification.systems.prediction import free_prediction, prediction
    from dynid.parameters import coordinates
    from dynid.scene.kinds.identified_graphs import identified_graph
    from dynid.scene.kinds.measurements import experiments
    from dynid.scene.load import check_source
    from dynid.scene.run import run_scene
    from dynid.scene.yaml.source import parse_source

    path, half = _data_file(), samples // 2

    def scene(count: int) -> Any:
        text = _SCENE.replace("FILE", f"'{path}'").replace("SAMPLES", str(count))
        return check_source(parse_source(text, str(path.parent / "robot_arm.yaml")))

    result = run_scene(scene(half))
    names, estimates = (result[f"identification/parameters/{name}"].data for name in ("name", "estimate"))
    estimates_by_name = dict(zip(names.tolist(), estimates.tolist(), strict=True))
    full_record = scene(2 * half)
    graph, _ = identified_graph(full_record)
    (experiment,) = experiments(
        full_record, full_record.model.excitation, full_record.model.measurement, graph
    )
    model = parametric_model(
        graph, experiment.loads, experiment.measurement.channels, experiment.measurement.record.times
    )
    eta = coordinates(
        graph.unknowns, np.array([estimates_by_name[unknown.name] for unknown in graph.unknowns])
    )
    at_rest = prediction(model, eta, np.zeros(model.states), *free_prediction(model, eta))
    forced, by_state = at_rest.outputs[:, 0], at_rest.by_state[:, 0]
    y = np.asarray(experiment.measurement.source)[:, 0]
    start = np.linalg.lstsq(by_state[:half], y[:half] - forced[:half], rcond=None)[0]
    return estimates_by_name, forced + by_state @ start


def by_arx(u: Array, y: Array, order: int, half: int) -> Array:
    """Return the prediction of the second half by an ARX model, from the last outputs of the first."""
    rows = [np.r_[-y[k - order : k][::-1], u[k - order : k + 1][::-1]] for k in range(order, half)]
    theta = np.linalg.lstsq(np.array(rows), y[order:half], rcond=None)[0]
    prediction = list(y[half - order : half])
    for k in range(half, len(y)):
        prediction.append(np.r_[-np.array(prediction[-order:])[::-1], u[k - order : k + 1][::-1]] @ theta)
    return np.array(prediction[order:])


def by_subspace(u: Array, y: Array, order: int, half: int, depth: int = 20) -> Array:
    """Return the prediction of the second half by N4SID (van Overschee & De Moor, 1994)."""
    columns = half - 2 * depth + 1
    U, Y = (np.array([x[i : i + columns] for i in range(2 * depth)]) for x in (u[:half], y[:half]))
    past, future = np.vstack([U[:depth], Y[:depth]]), U[depth:]
    weights = np.linalg.lstsq(np.vstack([past, future]).T, Y[depth:].T, rcond=None)[0].T
    left, size, _ = np.linalg.svd(weights[:, : len(past)] @ past, full_matrices=False)
    observed = left[:, :order] * np.sqrt(size[:order])
    A, C = np.linalg.lstsq(observed[:-1], observed[1:], rcond=None)[0], observed[:1]
    # Outputs are linear in x0, B and D: least squares of the first half.
    powers, regressor = np.eye(order), np.zeros((half, 2 * order + 1))
    driven = np.zeros((order, order))
    for k in range(half):
        regressor[k] = np.r_[(C @ powers)[0], (C @ driven)[0], u[k]]
        powers, driven = A @ powers, A @ driven + u[k] * np.eye(order)
    solution = np.linalg.lstsq(regressor, y[:half], rcond=None)[0]
    x, B, D = solution[:order], solution[order : 2 * order], solution[-1]
    outputs = []
    for value in u:
        outputs.append((C @ x)[0] + D * value)
        x = A @ x + B * value
    return np.array(outputs)[half:]


def _peer(name: str, method: Callable[..., Array], order: int) -> Alternative:
    def work(data: Array) -> Array:
        return method(*data, order, data.shape[1] // 2)

    return Alternative(f"{name}-{order}", work, record, peer=True, unavailable=missing_data)


def _error(samples: int, prediction: Any) -> float:
    measured = record(samples)[1][samples // 2 : 2 * (samples // 2)]
    return 1 - fit(measured, prediction[: len(measured)]) / 100


BENCHMARK = Benchmark(
    title="Prediction of half the record of a robot arm by models (of an order) from the other half",
    size="samples",
    sizes=(1024,),
    alternatives=(
        Alternative(
            "graph-4",
            lambda samples: by_graph(samples)[1][samples // 2 :],
            unavailable=missing_data,
        ),
        *(_peer(*one, order) for order in (4, 6) for one in (("arx", by_arx), ("subspace", by_subspace))),
    ),
    error=_error,
    measure="norm of the error of the second half over that of its deviation from the mean: 1 - fit",
)
