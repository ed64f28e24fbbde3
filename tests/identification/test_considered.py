"""Parameters that are known with uncertainty: slopes of the estimates, and error bars with their effect."""

import numpy as np
import pytest
from scipy.linalg import eigh

from dynid import load_scene, run
from dynid.arithmetic.dependent import Dependent
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.lti.signals import Multisine
from dynid.parameters import Parameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

pytestmark = pytest.mark.thorough

CHANNELS = (Channel(1, "velocity"), Channel(2, "acceleration"))
RECORD = Measurement(0.002, 400, CHANNELS, Simulation(0.01, 3))
LINES = np.linspace(5.0, 150.0, 60)
RESPONSES = FrfMeasurement(LINES, tuple(Frf(channel, 2) for channel in CHANNELS), Simulation(0.01, 3))
LOADS = [Load(2, Multisine([10.0, 10.0], [30.0, 90.0]))]
PARAMETER = "identification/parameters"
# The modes of masses 1 and 2 on stiffnesses k = 15,000 and kg = 2,000, with some scatter.
SQUARES, SHAPES = eigh([[1.7e4, -1.5e4], [-1.5e4, 1.5e4]], np.diag([1.0, 2.0]))
SURVEY = ModalMeasurement(
    np.sqrt(SQUARES) * [1.002, 0.999],
    (1, 2),
    SHAPES + np.array([[0.004, -0.002], [-0.003, 0.005]]),
    omega_std=2e-3 * np.sqrt(SQUARES),
    shape_std=np.full((2, 2), 0.005),
)


def chain(m, c, std=None):
    """Return a chain with unknown k and kg, and a mass m and damping c that are considered, or fixed."""
    unknown = (Parameter("k", 1.3e4, 1.5e4), Parameter("kg", 1.7e3, 2e3, scale="linear"))
    known = (
        ()
        if std is None
        else (Parameter("m", m, m, std=std[0]), Parameter("c", c, c, scale="linear", std=std[1]))
    )
    number = {one.name: Dependent.parameter(one.name, one.expected) for one in (*unknown, *known)}
    m, c = number.get("m", m), number.get("c", c)
    links = [Link((1, 2), number["k"], c), Link((1,), number["kg"], 3.0)]
    return lumped((1.0, m), links, parameters=(*unknown, *known))


def estimated(model, kind, truth=None):
    if kind == "record":
        return identify(model, Experiment(LOADS, RECORD), truth=truth)
    return identify(model, SURVEY) if kind == "survey" else identify(model, RESPONSES, truth=truth)


@pytest.mark.parametrize("kind", ["record", "responses", "survey"])
def test_slopes_and_total_errors_are_those_of_estimates_with_other_values(kind):
    truth, std = chain(2.0, 5.0), (0.02, 0.3)
    found = estimated(chain(2.0, 5.0, std), kind, truth)
    assert found[f"{PARAMETER}/name"].data.tolist() == ["k", "kg"]
    quantities = found["identification/considered/quantity"].data.tolist()
    slopes = found["identification/considered/slope"].data[:, [quantities.index(name) for name in "mc"]]
    values = found[f"{PARAMETER}/estimate"].data
    moves = []
    for steps in ((1e-4, 0.0), (0.0, 1e-3)):
        ends = [
            estimated(chain(2.0 * (1 + way * steps[0]), 5.0 + way * steps[1]), kind, truth) for way in (1, -1)
        ]
        up, down = (end[f"{PARAMETER}/estimate"].data for end in ends)
        moves.append((up - down) / (2 * sum(steps)) / values)
    # The slopes leave out the second derivatives of the prediction times residuals of 1 %.
    np.testing.assert_allclose(slopes, np.transpose(moves), rtol=0.03, atol=1e-3 * np.abs(moves).max())
    total = np.hypot(
        found[f"{PARAMETER}/standard_error"].data,
        np.linalg.norm(slopes * values[:, None] * [std[0] / 2.0, std[1]], axis=1),
    )
    np.testing.assert_allclose(found[f"{PARAMETER}/standard_error_total"].data, total, rtol=1e-12)


def test_without_considered_parameters_there_is_no_total_error():
    assert f"{PARAMETER}/standard_error_total" not in estimated(chain(2.0, 5.0), "record")


def test_a_scene_considers_a_parameter(tmp_path):
    (tmp_path / "scene.yaml").write_text(
        """
dynid: 1
kind: identification
parameters: {k: {start: 1.0e4, true: 1.5e4}, m: {value: 2, std: 0.02}}
structure: {lumped: {masses: [1, m], links: [{dofs: [1, 2], k: k, c: 5}, {dofs: [1], k: 2000, c: 3}]}}
excitation: [{dof: 2, kind: multisine, amplitude: [10, 10], frequency: [30, 90]}]
measurement:
  step: 0.002
  samples: 400
  channels: [{dof: 1, quantity: velocity}]
  simulate: {noise_ratio: 0.01, seed: 1}
"""
    )
    result = run(load_scene(tmp_path / "scene.yaml"))
    assert result[f"{PARAMETER}/name"].data.tolist() == ["k"]
    assert result.value(f"{PARAMETER}/standard_error_total") > 3 * result.value(f"{PARAMETER}/standard_error")
