"""Reduced structures with unknown quantities: the estimator's basis is made at the starts."""

import numpy as np
import pytest

from dynid.scene.load import load_scene
from dynid.scene.run import run_scene as run
from tests.sample import sample

pytestmark = pytest.mark.thorough

SCENE = """
dynid: 1
kind: identification
parameters:
  EI: {{start: 150, true: {EI}}}
  r: {{start: 0.8, true: {r}}}
structure:
  beam:
    elements: 5
    length: 2
    EI: EI
    rhoA: r
    supports: [{{node: 1, fix: [w, theta]}}]
    damping: {{alpha: 0.5, beta: 0.0001}}
joints: {{tip: {{dofs: [w_6], k: {{start: 300, true: {k}}}, c: 2}}}}
reduction: {{{method}}}
excitation: [{{dof: w_4, kind: multisine, amplitude: [10, 10], frequency: [12, 60]}}]
measurement:
  step: 0.01
  samples: 120
  channels: [{{dof: w_3, quantity: acceleration}}, {{dof: w_6, quantity: velocity}}]
  {source}
estimator: {{method: output-error}}
derived: []
"""
METHODS = {
    "craig-bampton": "method: craig-bampton, masters: [w_3, w_4, w_6], modes: [1, 2]",
    "guyan": "method: guyan, masters: [w_2, w_3, w_4, w_5, w_6]",
    "modal": "method: modal, modes: {count: 4}",
    "serep": "method: serep, masters: [w_3, w_4, w_6], modes: [1, 2, 3]",
    "joint-aware": "method: joint-aware, masters: [w_3, w_4, w_6], modes: [1, 2, 3]",
}


def identified(folder, method, source, **true):
    path = folder / "scene.yaml"
    path.write_text(SCENE.format(method=METHODS[method], source=source, **true))
    return run(load_scene(path))


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """The record of a beam of EI = 200, r = 0.6, k = 500."""
    folder = tmp_path_factory.mktemp("record")
    source = "simulate: {noise_ratio: 0.01, seed: 1}"
    found = identified(folder, "guyan", source, EI=200, r=0.6, k=500)
    np.savetxt(
        folder / "record.csv",
        found.value("identification/measurement/measured"),
        delimiter=",",
        header="a,v",
        comments="",
    )
    return folder / "record.csv"


@pytest.mark.parametrize("method", sample(METHODS, 0, *(METHODS.keys() - {"serep"})))
def test_estimates_do_not_depend_on_the_truth_but_through_the_record(tmp_path, record, method):
    """The record is read from a file, so that `true` tells the run nothing that it may use."""
    source = f"file: {{path: {record}, columns: [a, v]}}"
    first = identified(tmp_path, method, source, EI=200, r=0.6, k=500)
    second = identified(tmp_path, method, source, EI=90, r=2.0, k=4000)
    for name in ("estimate", "standard_error"):
        path = f"identification/parameters/{name}"
        np.testing.assert_array_equal(first.value(path), second.value(path))
    path = "identification/measurement/predicted"
    np.testing.assert_array_equal(first.value(path), second.value(path))
