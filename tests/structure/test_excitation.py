"""Prescribed motions and moving ground, against the equations of what is left, written out by hand."""

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.identification.estimators.auto import Auto
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Multisine, Sampled, Step
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from dynid.structure.response import time_response

M1, M2, K1, C1, K2, C2 = 2.0, 1.0, 300.0, 4.0, 500.0, 3.0
T = 0.01 * np.arange(200)
W, AMPLITUDE, PHASE = 7.0, 0.3, 0.4


def chain(joints=()):
    links = [Link((1,), K1, C1)] if joints else [Link((1,), K1, C1), Link((1, 2), K2, C2)]
    return lumped([M1, M2], links, joints)


def sine(order=0, sign=1.0):
    """The order-th derivative of the displacement."""
    return Multisine([sign * AMPLITUDE * W**order], [W], [PHASE + order * np.pi / 2])


def y(model, loads, outputs, **initial):
    return time_response(model, loads, outputs, T, **initial).value("structure/time_response/response")


@pytest.mark.parametrize(("motion", "order"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)])
def test_a_prescribed_dof_drives_the_rest_through_its_joints(motion, order):
    """DOF 2 moves: of DOF 1 is left M1 x'' + (C1 + C2) x' + (K1 + K2) x = K2 u + C2 u'."""
    u0, v0 = AMPLITUDE * np.sin(PHASE), AMPLITUDE * W * np.cos(PHASE)
    found = y(
        chain(),
        [Load(2, sine(order), motion)],
        [Channel(1, "displacement"), Channel(1, "acceleration"), Channel(2, "displacement")],
        displacement={2: u0},
        velocity={2: v0},
    )
    alone = lumped([M1], [Link((1,), K1 + K2, C1 + C2)])
    force = Multisine([K2 * AMPLITUDE, C2 * AMPLITUDE * W], [W, W], [PHASE, PHASE + np.pi / 2])
    expected = y(alone, [Load(1, force)], [Channel(1, "displacement"), Channel(1, "acceleration")])
    np.testing.assert_allclose(found[:, :2], expected, atol=1e-11)
    np.testing.assert_allclose(found[:, 2], AMPLITUDE * np.sin(W * T + PHASE), atol=1e-12)


def test_a_moving_ground_is_seen_from_itself():
    """Relative motion, by forces -m a; absolute acceleration, as the springs and dampers make it."""
    ground = Load(None, sine(2), "acceleration")
    outputs = [Channel(2, "displacement"), Channel(2, "acceleration", None, True), Channel(1, "velocity")]
    found = y(chain(), [ground], outputs)
    forces = [Load(1, sine(2, -M1)), Load(2, sine(2, -M2))]
    relative = y(chain(), forces, [*outputs[::2], Channel(1, "displacement"), Channel(2, "velocity")])
    np.testing.assert_allclose(found[:, [0, 2]], relative[:, :2], atol=1e-12)
    x2, v1, x1, v2 = relative.T
    np.testing.assert_allclose(found[:, 1], -(K2 * (x2 - x1) + C2 * (v2 - v1)) / M2, atol=1e-9)


def test_coupled_masses_feel_a_prescribed_acceleration():
    """A prescribed DOF that shares mass with another: M has entries off its diagonal."""
    joint = Joint("bar", (1, 2), k=K2, m=JointParameter(value=1.0, matrix=[[0.5, 0.2], [0.2, 0.5]]))
    model = lumped([M1, M2], [Link((1,), K1, C1)], [joint])
    found = y(
        model,
        [Load(2, sine(2), "acceleration")],
        [Channel(1, "displacement")],
        displacement={2: AMPLITUDE * np.sin(PHASE)},
        velocity={2: AMPLITUDE * W * np.cos(PHASE)},
    )
    alone = lumped([M1 + 0.5], [Link((1,), K1 + K2, C1)])
    force = [Load(1, Multisine([K2 * AMPLITUDE], [W], [PHASE])), Load(1, sine(2, -0.2))]
    np.testing.assert_allclose(found, y(alone, force, [Channel(1, "displacement")]), atol=1e-11)


@pytest.mark.parametrize(
    "load",
    [
        Load(None, Multisine([9.0, 5.0], [13.0, 31.0]), "acceleration"),
        Load(1, Multisine([0.02, 0.01], [13.0, 31.0]), "displacement"),
        Load(1, Multisine([0.2, 0.1], [13.0, 31.0]), "velocity"),
        Load(1, Sampled(np.sin(0.13 * np.arange(500)), 0.01), "displacement"),
    ],
    ids=["ground", "displacement", "velocity", "samples"],
)
def test_joints_are_identified_from_base_motion(load):
    joint = Joint("j", (1, 2), JointParameter(start=250, true=K2), JointParameter(start=1, true=C2))
    channels = (Channel(2, "acceleration"), Channel(2, "displacement", 1))
    measurement = Measurement(0.01, 300, channels, Simulation(0.02, 1))
    result = identify(chain([joint]), Experiment([load], measurement), Auto())
    error = result["identification/parameters/estimate"].data - [K2, C2]
    assert np.all(np.abs(error) < 4 * result["identification/parameters/cramer_rao"].data)
    assert result.value("identification/diagnostics/converged")
    assert list(result["identification/measurement/channel"].data) == ["2.acceleration", "2-1.displacement"]


def test_what_is_prescribed_is_no_nuisance():
    """The joint of a lone mass on a DOF that moves: with that motion known the bound is lower."""
    joint = Joint("j", (1, 2), JointParameter(start=250, true=K2), JointParameter(start=1, true=C2))
    lines = np.array([13.0, 31.0])
    loads = [
        Load(1, Multisine(0.02 * lines**order, lines, [order * np.pi / 2] * 2), motion)
        for order, motion in enumerate(("displacement", "velocity", "acceleration"))
    ]
    clean = y(chain(), loads[:1], [Channel(2, "displacement")])
    noisy = clean + 1e-4 * np.random.default_rng(1).standard_normal(clean.shape)
    measurement = Measurement(0.01, 60, (Channel(2, "displacement"),), noisy[:60], 1e-4)
    results = [identify(chain([joint]), Experiment([load], measurement)) for load in loads]
    bounds = [result["identification/parameters/standard_error"].data for result in results]
    assert np.all(bounds[0] < bounds[1])
    assert np.all(bounds[1] < bounds[2])
    assert bounds[0][0] < 0.9 * bounds[2][0]


@pytest.mark.parametrize(
    ("load", "said"),
    [
        (Load(1, Step(1.0), "displacement"), "not smooth enough"),
        (Load(1, Sampled(np.ones(300), 0.01, "linear"), "displacement"), "not smooth enough"),
        (Load(7, sine(), "displacement"), "no DOF 7"),
        (Load(1, sine(), "place"), "no output quantity 'place'"),
    ],
)
def test_what_cannot_be_prescribed_is_refused(load, said):
    with pytest.raises(UsageError, match=said):
        y(chain(), [load], [Channel(2, "velocity")])


def test_a_motion_is_prescribed_once():
    with pytest.raises(UsageError, match="the motion of a DOF is prescribed twice"):
        y(chain(), [Load(2, sine(), "displacement"), Load(2, sine(1), "velocity")], [Channel(1, "velocity")])


def test_a_motion_of_what_is_no_coordinate_cannot_be_prescribed():
    small = chain().projected(np.array([[0.5], [1.0]]), ("q_1",))
    found = y(small, [Load(2, sine(), "displacement")], [Channel(1, "displacement")])
    np.testing.assert_allclose(found[:, 0], 0.5 * AMPLITUDE * np.sin(W * T + PHASE), atol=1e-12)
    with pytest.raises(UsageError, match="the motion of DOF 1 cannot be prescribed: it is no coordinate"):
        y(small, [Load(1, sine(), "displacement")], [Channel(1, "displacement")])


def test_the_ground_moves_a_reduced_structure_too():
    ground = [Load(None, sine(2), "acceleration")]
    whole = y(chain(), ground, [Channel(2, "displacement")])
    T = np.array([[1.0, 1.0], [-1.0, 2.0]])  # other coordinates, the same structure
    small = y(chain().projected(T, ("q_1", "q_2")), ground, [Channel(2, "displacement")])
    np.testing.assert_allclose(small, whole, rtol=1e-9, atol=1e-12)


def test_absolute_channels_need_a_moving_ground():
    absolute = Channel(2, "acceleration", None, True)
    with pytest.raises(UsageError, match="only where the ground moves"):
        y(chain(), [Load(1, sine())], [absolute])
    ground = Load(None, sine(2), "acceleration")
    with pytest.raises(UsageError, match="only the acceleration"):
        y(chain(), [ground], [absolute._replace(quantity="velocity")])
