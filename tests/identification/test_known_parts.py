"""Known masses, stiffnesses and the clock: slopes of the estimates against estimates with other values."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.bondgraph.graph import BondGraph
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.identification.systems.known_parts import with_known_parts
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Multisine, Sampled
from dynid.parameters import Parameter
from dynid.report.content.identifiability import known_parts_table
from dynid.structure.assembly import Support
from dynid.structure.frame import beam
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.bondgraph.graphs import build, parse, port
from tests.identification.modal_cases import measured as survey_of
from tests.identification.test_delays import GROUP, Rig
from tests.identification.test_proportional_noise import responses

pytestmark = pytest.mark.thorough

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
    return identify(model, Experiment([Load(3, Sampled(rig.force(), step))], measured))


def of_responses(rig, model, clock=0.0, noise=0.005):
    rig.rng = np.random.default_rng(1)
    measured = responses(rig, lambda size: noise * size.mean(axis=0))
    return identify(model, replace(measured, omega=measured.omega / (1 + clock)))


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
        found.append(identify(chain(rig), Experiment([load], measured)))
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
    from tests.screens import lines

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


def electric(factors=()):
    """An RLC ladder behind a source, R1 and C2 unknown; `factors` of the values of other storages by node."""
    types, values, pairs = parse(
        "Se U, 1 a, R R1 3, I L1 1/50, 0 b, C C1 1/2000, 1 d, I L2 1/80, 0 f, C C2 1/900, R R2 8",
        "U -> a, a -> R1, a -> L1, a -> b, b -> C1, b -> d, d -> L2, d -> f, f -> C2, f -> R2",
    )
    values |= {name: values[name] * factor for name, factor in dict(factors).items()}
    graph, unknown = build(types, values, pairs), {"R1": 3.0, "C2": 1 / 900}
    nodes = [
        replace(node, dependent=Dependent.parameter(name, node.value)) if name in unknown else node
        for name, node in graph.nodes.items()
    ]
    parameters = [Parameter(name, 1.1 * value, true=value) for name, value in unknown.items()]
    return IdentifiedGraph(BondGraph(nodes, graph.bonds), parameters)


def ladder(omega):
    """Current of L1 and voltage of C2 for a unit of voltage, from the impedances."""
    s = 1j * omega
    last = 1 / (1 / 8 + s / 900)
    second = s / 80 + last
    first = 1 / (s / 2000 + 1 / second)
    current = 1 / (3 + s / 50 + first)
    return np.column_stack([current, current * first / second * last])


VOLTS = Multisine((2.0, 2.0, 2.0), (60.0, 150.0, 330.0))


def of_graph_record(model, values):
    channels = tuple(model.channel(port(name)) for name in ("L1.f", "C2.e"))
    measured = Measurement(0.002, 600, channels, values, start=1.0)
    return identify(model, Experiment([model.load("U", VOLTS)], measured))


def of_graph_responses(model, values):
    omega = np.linspace(30.0, 400.0, 90)
    functions = [Frf(model.channel(port(name)), "U") for name in ("L1.f", "C2.e")]
    return identify(model, FrfMeasurement(omega, functions, values))


@pytest.mark.parametrize("estimated", [of_graph_record, of_graph_responses])
def test_known_storages_of_a_graph_bias_by_their_slopes(estimated):
    """Records of the graph itself, identified with other inductances and capacitances."""
    model = electric()
    if estimated is of_graph_record:
        source = Simulation(0.01, 4, 1.0)
        channels = tuple(model.channel(port(name)) for name in ("L1.f", "C2.e"))
        values = data(model, [model.load("U", VOLTS)], Measurement(0.002, 600, channels, source)).values
    else:
        values = ladder(np.linspace(30.0, 400.0, 90))
        rng = np.random.default_rng(3)
        values += 0.01 * np.abs(values).mean(axis=0) * (rng.standard_normal((2, *values.shape)).T @ (1, 1j)).T
    found = estimated(model, values)
    names = found[f"{CONSIDERED}/quantity"].data.tolist()
    slopes = dict(zip(names, found[f"{CONSIDERED}/slope"].data.T, strict=True))
    known = {"inertia of L1": "L1", "compliance of C1": "C1", "inertia of L2": "L2"}
    assert {name for name in names if name.startswith(("inertia", "compliance"))} == set(known)
    for name, node in known.items():
        ends = [estimated(electric({node: 1 + sign * Fraction(1, 10**4)}), values) for sign in (1, -1)]
        logs = [np.log(end[f"{GROUP}/estimate"].data) for end in ends]
        np.testing.assert_allclose(slopes[name], (logs[0] - logs[1]) / 2e-4, rtol=0.05, atol=0.02)


def test_known_parts_of_modal_surveys_bias_by_their_slopes():
    """Surveys of a chain identified with other masses and springs, or by an analyser whose clock is off."""
    masses, springs = np.array([2.0, 1.4, 1.0, 0.6]), np.array([5e4, 4e4, 3e4])

    def model(mass=1.0, spring=1.0, at=0):
        m, k = masses.copy(), springs.copy()
        m[at] *= mass
        k[min(at, 2)] *= spring
        links = [Link((1,), k[0], 0.0), Link((2, 3), k[1], 0.0), Link((3, 4), k[2], 0.0)]
        return lumped(m.tolist(), links, [Joint("bolt", (1, 2), JointParameter(start=3e4, true=3.5e4))])

    survey = survey_of(model(), seed=6, modes=(0, 1, 2), dofs=(1, 2, 4), scatter=(0.001, 0.05, 0.01))
    found = identify(model(), survey)
    names = found[f"{CONSIDERED}/quantity"].data.tolist()
    slopes = dict(zip(names, found[f"{CONSIDERED}/slope"].data[0], strict=True))
    cases = {f"mass of DOF {k + 1}": ("mass", k) for k in range(4)}
    cases |= {
        "stiffness from DOF 1 to ground": ("spring", 0),
        "stiffness between DOFs 3 and 4": ("spring", 2),
    }
    for name, (part, at) in cases.items():
        ends = [
            identify(
                model(**{part: 1 + sign * 1e-4, "at": at}),
                survey,
            )
            for sign in (1, -1)
        ]
        logs = [np.log(end[f"{GROUP}/estimate"].data[0]) for end in ends]
        assert slopes[name] == pytest.approx((logs[0] - logs[1]) / 2e-4, rel=0.05, abs=0.02)
    ends = [identify(model(), replace(survey, omega=survey.omega / (1 + e))) for e in (1e-5, -1e-5)]
    logs = [np.log(end[f"{GROUP}/estimate"].data[0]) for end in ends]
    assert slopes["clock"] == pytest.approx((logs[0] - logs[1]) / 2e-5, rel=0.05)
