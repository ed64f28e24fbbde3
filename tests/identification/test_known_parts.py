"""Known masses, stiffnesses and the clock: slopes of the estimates against estimates with other values."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.identification.identify import identify, identify_frf
from dynid.identification.records.measurement import Measurement
from dynid.identification.systems.known_parts import with_known_parts
from dynid.lti.signals import Multisine, Sampled
from dynid.report.content.identifiability import known_parts_table
from dynid.structure.assembly import Support
from dynid.structure.frame import beam
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.test_delays import GROUP, Rig
from tests.identification.test_proportional_noise import responses

CONSIDERED = "identification/considered"


def chain(rig, masses=(0, 0, 0), springs=(0, 0)):
    """Return the chain of a rig with relative errors of its masses and known springs."""
    (k1, c1), (k2, c2), (k3, c3) = rig.links
    known = [Link((1,), k1 * (1 + springs[0]), c1), Link((2, 3), k3 * (1 + springs[1]), c3)]
    joint = Joint("bolt", (1, 2), JointParameter(start=1.1 * k2, true=k2), JointParameter(start=c2, true=c2))
    return lumped((rig.masses * (1 + np.array(masses))).tolist(), known, [joint])


def of_record(rig, model, clock=0.0, noise=0.005):
    rng = np.random.default_rng(1)
    values = np.column_stack([rig.recorded(1, "acceleration", 0.0), rig.recorded(3, "velocity", 0.0)])
    values += noise * np.sqrt(np.mean(values**2, axis=0)) * rng.standard_normal(values.shape)
    step = rig.step * (1 + clock)
    channels = (Channel(1, "acceleration"), Channel(3, "velocity"))
    measured = Measurement(step, rig.samples, channels, values)
    return identify(model, [Load(3, Sampled(rig.force(), step))], measured)


def of_responses(rig, model, clock=0.0, noise=0.005):
    rig.rng = np.random.default_rng(1)
    measured = responses(rig, lambda size: noise * size.mean(axis=0))
    return identify_frf(model, replace(measured, omega=measured.omega / (1 + clock)))


CHANGES = {
    "mass of DOF 1": {"masses": (1, 0, 0)},
    "mass of DOF 3": {"masses": (0, 0, 1)},
    "stiffness from DOF 1 to ground": {"springs": (1, 0)},
    "stiffness between DOFs 2 and 3": {"springs": (0, 1)},
}


@pytest.mark.parametrize("estimated", [of_record, of_responses])
def test_slopes_are_those_of_estimates_with_other_values(estimated):
    rig = Rig(3, 400)
    found = estimated(rig, chain(rig))
    names = found[f"{CONSIDERED}/quantity"].data.tolist()
    slopes = dict(zip(names, found[f"{CONSIDERED}/slope"].data.T, strict=True))
    assert {*CHANGES, "clock", "mass of DOF 2"} <= set(names)
    assert "stiffness between DOFs 1 and 2" not in names  # the joint's own
    for name, change in CHANGES.items():
        ends = [
            estimated(
                rig, chain(rig, **{part: sign * 1e-4 * np.array(size) for part, size in change.items()})
            )
            for sign in (1, -1)
        ]
        logs = [np.log(end[f"{GROUP}/estimate"].data) for end in ends]
        # Gauss-Newton: the slopes leave out second derivatives times residuals.
        np.testing.assert_allclose(slopes[name], (logs[0] - logs[1]) / 2e-4, rtol=0.05, atol=0.02)
    logs = [np.log(estimated(rig, chain(rig), sign * 1e-5)[f"{GROUP}/estimate"].data) for sign in (1, -1)]
    np.testing.assert_allclose(slopes["clock"], (logs[0] - logs[1]) / 2e-5, rtol=0.05, atol=0.05)


def test_a_clock_beside_inputs_that_keep_their_own_time():
    rig, found = Rig(3, 400), []
    phases = np.angle(rig.lines) + np.pi / 2
    load = Load(3, Multisine(np.abs(rig.lines).tolist(), rig.omega.tolist(), phases.tolist()))
    values = np.column_stack([rig.recorded(1, "acceleration", 0.0), rig.recorded(3, "velocity", 0.0)])
    values += 1e-3 * values.std(axis=0) * np.random.default_rng(2).standard_normal(values.shape)
    channels = (Channel(1, "acceleration"), Channel(3, "velocity"))
    for clock in (0.0, 2e-6, -2e-6):
        measured = Measurement(rig.step * (1 + clock), 400, channels, values)
        found.append(identify(chain(rig), [load], measured))
    names = found[0][f"{CONSIDERED}/quantity"].data.tolist()
    slope = found[0][f"{CONSIDERED}/slope"].data[:, names.index("clock")]
    logs = [np.log(result[f"{GROUP}/estimate"].data) for result in found[1:]]
    np.testing.assert_allclose(slope, (logs[0] - logs[1]) / 4e-6, rtol=0.02, atol=0.02 * np.abs(slope).max())


def test_a_change_is_visible_by_what_it_leaves_in_the_residuals():
    rig = Rig(3, 400)
    found = of_record(rig, chain(rig))
    places = found[f"{CONSIDERED}/quantity"].data.tolist()
    visibility = found[f"{CONSIDERED}/visibility"].data
    for name in ("mass of DOF 3", "stiffness from DOF 1 to ground"):
        part = {key: 1e-2 * np.array(size) for key, size in CHANGES[name].items()}
        ends = [
            of_record(rig, chain(rig, **{key: sign * size for key, size in part.items()})) for sign in (1, -1)
        ]
        # -2 log L = 2 sum_c N log RMS_c grows by the square, on average over both signs.
        costs = [
            sum(800 * np.log(end["identification/diagnostics/residual_rms"].data)) for end in (*ends, found)
        ]
        square = (costs[0] + costs[1]) / 2 - costs[2]
        expected = visibility[places.index(name)] ** 2
        assert 0.3 < square / (800 * np.log1p(expected / 800)) < 3


def test_the_table_beside_the_standard_errors_says_what_residuals_would_show():
    rig = Rig(3, 400)
    result = of_record(rig, chain(rig))
    heads, rows, _ = known_parts_table(result)
    assert heads[0] == "bias of the estimates by"
    assert heads[1:3] == ("bolt.k", "bolt.c")
    assert rows[0][0] == "standard error"
    assert any(row[0].startswith("1 % of the mass of DOF") for row in rows)
    from dynid.cli.summary.identification import lines

    screen = "\n".join(lines(result))
    assert "residuals show it from" in screen
    assert f"redundancy {result.value('identification/diagnostics/redundancy')}" in screen


def test_matrices_that_are_no_networks_are_taken_as_a_whole():
    made = beam(4, 1.0, 50.0, 2.0, supports=[Support(1, ("w", "theta"))])
    joint = Joint("tip", (made.dofs[-2],), JointParameter(start=100.0))
    model = made.joined([joint])
    names = [
        one.name for one in with_known_parts(model, (), [Channel(made.dofs[2], "acceleration")]).parameters
    ]
    sensor = f"mass at the sensor of DOF {made.dofs[2]}"
    assert names == ["mass of the structure", sensor, "stiffness of the structure"]
    freed = with_known_parts(model, (), [])
    slopes = freed.slopes({"tip.k": 100.0}, ["mass of the structure", "stiffness of the structure"])
    np.testing.assert_allclose(slopes[0]["M"], model.M, rtol=1e-12)
    np.testing.assert_allclose(slopes[1]["K"], model.K, rtol=1e-12)
