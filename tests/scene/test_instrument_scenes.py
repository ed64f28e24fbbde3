"""Filters, integrators and masses of sensors that a scene states, of structures and of graphs."""

import numpy as np
import pytest

from dynid.errors import SceneError, UsageError
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene

SCENE = """\
dynid: 1
kind: identification
parameters:
  corner: {start: 0.4, true: 0.5}
  m: {value: 0.05, std: 0.01}
structure:
  lumped: {masses: [2, 1], links: [{dofs: [1], k: 800, c: 1.5}]}
joints:
  j: {dofs: [1, 2], k: {start: 300, true: 400}, c: {start: 0.5, true: 0.8}}
excitation: [{dof: 1, kind: multisine, amplitude: [3, 2, 2], frequency: [5, 13, 31]}]
measurement:
  step: 0.02
  samples: 300
  channels:
    - {dof: 1, quantity: acceleration, high_pass: {frequency: corner, unit: Hz}, mass: m}
    - {dof: 2, quantity: acceleration, integrator: {frequency: 0.1, unit: Hz}, unit: mm/s}
  simulate: {noise_ratio: 0.01, seed: 2}
"""

GRAPH = """\
dynid: 1
kind: identification
parameters: {R: {start: 2, true: 3}}
graph:
  nodes: {U: {type: Se}, j: {type: "1"}, L: {type: I, value: 1}, R: {type: R, value: R}}
  bonds: [U -> j, j -> L, j -> R]
excitation: [{source: U, kind: multisine, amplitude: [1, 1], frequency: [2, 9]}]
measurement:
  step: 0.02
  samples: 200
  channels: [{output: L.f, integrator: {}}, {output: L.f, low_pass: {frequency: 20, order: 2}}]
  simulate: {noise_ratio: 0, seed: 1}
"""


@pytest.fixture
def run(tmp_path):
    def of(text):
        (tmp_path / "s.yaml").write_text(text)
        return run_scene(load_scene(tmp_path / "s.yaml"))

    return of


def test_a_scene_states_filters_known_and_unknown_and_uncertain_masses(run):
    result = run(SCENE)
    assert result["identification/diagnostics/converged"].data
    group = "identification/parameters"
    away = result[f"{group}/estimate"].data - result[f"{group}/true"].data
    assert np.all(np.abs(away) < 4 * result[f"{group}/standard_error"].data)
    assert "corner" in list(result[f"{group}/name"].data)
    assert "m" in list(result["identification/considered/quantity"].data)
    total = result[f"{group}/standard_error_total"].data
    assert total[0] > 1.05 * result[f"{group}/standard_error"].data[0]


def test_an_uncertain_corner_widens_the_standard_errors(run):
    result = run(SCENE.replace("corner: {start: 0.4, true: 0.5}", "corner: {value: 0.5, std: 0.05}"))
    assert "corner" in list(result["identification/considered/quantity"].data)
    group = "identification/parameters"
    ratio = result[f"{group}/standard_error_total"].data / result[f"{group}/standard_error"].data
    assert ratio.max() > 1.2


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("unit: mm/s", "unit: mm/s2", "the velocity of this channel"),
        ("acceleration, integrator: {", "velocity, integrator: {order: 2, ", "of order 2 behind a velocity"),
        ("{dof: 1, quantity", "{dofs: [1, 2], quantity", "at the one 'dof' that it measures"),
    ],
)
def test_what_cannot_be_is_refused(run, old, new, said):
    with pytest.raises(SceneError, match=said):
        run(SCENE.replace(old, new))


def test_an_ideal_integrator_makes_displacements(run):
    twice = "integrator: {order: 2}, unit: mm"
    result = run(SCENE.replace("integrator: {frequency: 0.1, unit: Hz}, unit: mm/s", twice))
    assert result["identification/diagnostics/converged"].data


def test_outputs_of_graphs_pass_filters(run):
    result = run(GRAPH)
    np.testing.assert_allclose(result["identification/parameters/estimate"].data, 3, rtol=1e-6)


RESPONSES = (
    SCENE[: SCENE.index("excitation")]
    + """\
measurement:
  channels:
    - {dof: 1, reference: {dof: 1}, quantity: acceleration, high_pass: {frequency: corner, unit: Hz}}
    - {dof: 2, reference: {dof: 1}, quantity: acceleration, integrator: {}, unit: (mm/s)/N}
  frf: {simulate: {lines: {start: 1, stop: 40, points: 40}, seed: 2}}
"""
)


def test_frequency_responses_pass_filters(run):
    result = run(RESPONSES)
    group = "identification/parameters"
    np.testing.assert_allclose(result[f"{group}/estimate"].data, result[f"{group}/true"].data, rtol=1e-6)
    with pytest.raises(UsageError, match="response at 0 of a channel with an integrator is undetermined"):
        run(RESPONSES.replace("start: 1, stop", "scale: linear, start: 0, stop"))
