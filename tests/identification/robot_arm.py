"""A measured robot arm: a graph of two inertias identified from the first half predicts the second half.

    python -m tests.identification.robot_arm [FILE]

The data are two bare columns, torque and acceleration of a flexible arm, in unknown units; a step of 2
ms is assumed, and only scales the estimates. The graph is an inertia on a spring and damper to the
ground, and a second one on it, which the torque drives and whose acceleration is measured: 4 states, 6
unknowns. The fit in per cent, 100 (1 - |y - y_p| / |y - mean|), is that of a prediction of the second
half without its measured outputs; beside it stand those of ARX models (least squares) and of subspace
models (N4SID by an oblique projection).
"""

import sys
from pathlib import Path

import numpy as np

from dynid.identification.parametric_model import parametric_model
from dynid.identification.prediction import free_prediction, prediction
from dynid.parameters import coordinates
from dynid.scene.kinds.identified_graphs import identified_graph
from dynid.scene.kinds.measurements import experiments
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source

DATA = Path(__file__).parents[3] / "shared/data/measured/robot_arm.dat"
SCENE = """
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
excitation: [{source: T, kind: file, path: %s, column: 1}]
measurement:
  step: 0.002
  samples: %d
  channels: [{output: J2.e, gain: 1/J2}]
  file: {path: %s, columns: [2]}
"""


def fit(measured, predicted):
    """Return the fit in per cent."""
    error = np.linalg.norm(measured - predicted)
    return 100 * (1 - error / np.linalg.norm(measured - measured.mean()))


def by_graph(path, half):
    """Return the estimates by name, and the prediction of the whole record."""

    def scene(samples):
        text = SCENE.lstrip("\n") % (path, samples, path)
        return check_source(parse_source(text, str(path.parent / "robot_arm.yaml")))

    result = run_scene(scene(half))
    names, estimates = (result[f"identification/parameters/{name}"].data for name in ("name", "estimate"))
    found = dict(zip(names, estimates.tolist(), strict=True))
    whole = scene(2 * half)
    graph, _ = identified_graph(whole)
    (record,) = experiments(whole, whole.model.excitation, whole.model.measurement, graph)
    channels, times = record.measurement.channels, record.measurement.record.times
    model = parametric_model(graph, record.loads, channels, times)
    eta = coordinates(graph.unknowns, np.array([found[one.name] for one in graph.unknowns]))
    at_rest = prediction(model, eta, np.zeros(model.states), *free_prediction(model, eta))
    forced, by_state = at_rest.outputs[:, 0], at_rest.by_state[:, 0]
    y = np.asarray(record.measurement.source)[:, 0]
    start = np.linalg.lstsq(by_state[:half], y[:half] - forced[:half], rcond=None)[0]
    return result, found, forced + by_state @ start


def by_arx(u, y, order, half):
    """Return the prediction of the second half by an ARX model, from the last outputs of the first."""
    rows = [np.r_[-y[k - order : k][::-1], u[k - order : k + 1][::-1]] for k in range(order, half)]
    theta = np.linalg.lstsq(np.array(rows), y[order:half], rcond=None)[0]
    found = list(y[half - order : half])
    for k in range(half, len(y)):
        found.append(np.r_[-np.array(found[-order:])[::-1], u[k - order : k + 1][::-1]] @ theta)
    return np.array(found[order:])


def by_subspace(u, y, order, half, depth=20):
    """Return the prediction of the second half by N4SID (van Overschee & de Moor, 1994)."""
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
    found = np.linalg.lstsq(regressor, y[:half], rcond=None)[0]
    x, B, D = found[:order], found[order : 2 * order], found[-1]
    outputs = []
    for each in u:
        outputs.append((C @ x)[0] + D * each)
        x = A @ x + B * each
    return np.array(outputs)[half:]


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    u, y = np.loadtxt(path).T
    half = len(y) // 2
    result, found, predicted = by_graph(path.resolve(), half)
    print(result.value("identification/diagnostics/verdict"))
    print(", ".join(f"{name} {value:.4g}" for name, value in found.items()))
    first, second = fit(y[:half], predicted[:half]), fit(y[half:], predicted[half:])
    print(f"graph, 4 states: {second:.1f} % ({first:.1f} % of the first half)")
    for order in (4, 6):
        for name, peer in (("ARX", by_arx), ("subspace", by_subspace)):
            print(f"{name}, order {order}: {fit(y[half:], peer(u, y, order, half)):.1f} %")
