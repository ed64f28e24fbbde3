"""Designs for margins of loops, against the margins of the exact engine and differences."""

import numpy as np
import pytest

import dynid
from dynid.bondgraph.design.functions import DesignFunctions
from dynid.errors import SceneError, Unreachable, UsageError
from dynid.scene.kinds.design import design_of
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

LAG = """\
dynid: 1
kind: bond-graph
parameters: {kp: 1, ki: 0.3, kv: 0.5}
graph:
  nodes: {u: Se, a: 1, R1: {type: R, value: 2}, L1: {type: I, value: 1}, C1: {type: C, value: 1}}
  bonds: [u -> a, a -> R1, a -> L1, a -> C1]
control:
  loops:
    - {from: C1.e, to: u, controller: {pid: {kp: kp, ki: ki}, delay: 0.5}, setpoint: w}
    - {from: L1.f, to: u, controller: {gain: kv, delay: 0.1}}
design: {free: {kp: , ki: }, targets: [TARGETS], starts: 1}
analysis: {outputs: [C1.e], inputs: [w], results: [properties]}
"""


def scene(text):
    return check_source(parse_source(text, "scene.yaml"))


def asked(targets, text=LAG):
    return scene(text.replace("TARGETS", targets))


@pytest.mark.parametrize("loop", [1, 2])
@pytest.mark.parametrize("kind", ["phase_margin", "gain_margin", "Ms", "Mt"])
def test_slopes_are_those_of_differences(kind, loop):
    text = LAG.replace("free: {kp: , ki: }", "free: {kp: , ki: , kv: }").replace("kv: 0.5", "kv: 3")
    functions = DesignFunctions(design_of(asked(f"{{{kind}: 2, loop: {loop}}}", text)))
    eta, step = functions.coordinates.start, 1e-4
    here = functions.at(eta)
    differences = []
    for direction in np.eye(len(eta)):
        values = [functions.at(eta + side * step * direction).residuals[0] for side in (-2, -1, 1, 2)]
        differences.append((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step))
    size = np.abs(here.jacobian).max()
    assert here.jacobian[0] == pytest.approx(differences, abs=1e-7 * size)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("targets", "reached"),
    [
        ("{phase_margin: 60}, {gain_margin: 3}", {"phase": 60, "gain": 3}),
        ("{Ms: 1.4}", {"Ms": 1.4}),
        ("{Ms: 1.6}, {phase_margin: 55}", {"Ms": 1.6, "phase": 55}),
        ("{Mt: 1.3}, {gain_margin: 3}", {"Mt": 1.3, "gain": 3}),
        ("{Ms: 1.4}, {maximise: ki}", {"Ms": 1.4}),
    ],
)
def test_targets_are_met_by_the_margins_that_miss_nothing(targets, reached):
    result = dynid.run(asked(targets))
    for name, value in reached.items():
        assert result[f"bond_graph/margins/{name}"].data[0] == pytest.approx(value, rel=1e-9)
    assert result.value("bond_graph/system/stable")
    assert result.value("bond_graph/design/met")


@pytest.mark.thorough
def test_the_largest_integral_gain_under_a_limit_of_the_sensitivity():
    """On exp(-s/2)/(s + 1)^2 neither neighbour with the same Ms has a larger ki."""
    text = LAG.replace("    - {from: L1.f, to: u, controller: {gain: kv, delay: 0.1}}\n", "").replace(
        ", kv: 0.5", ""
    )
    result = dynid.run(asked("{Ms: 1.4}, {maximise: ki}", text))
    kp, ki = result["bond_graph/design/value"].data
    assert result.value("bond_graph/design/optimum")
    omega = np.geomspace(1e-2, 30, 200_001)
    s = 1j * omega

    def sensitivity(kp, ki):
        return (1 / np.abs(1 + (kp + ki / s) * np.exp(-s / 2) / (s + 1) ** 2)).max()

    assert sensitivity(kp, ki) == pytest.approx(1.4, rel=1e-8)
    for change in (0.97, 1.03):
        assert sensitivity(kp * change, ki) > 1.4


def test_a_design_without_delays_joins_margins_and_poles():
    text = LAG.replace(", delay: 0.5", "").replace(", delay: 0.1", "")
    text = text.replace("results: [properties]", "results: [properties, poles]")
    result = dynid.run(asked("{phase_margin: 70}, {pole: {frequency: 1.2}}", text))
    assert result["bond_graph/margins/phase"].data[0] == pytest.approx(70, rel=1e-9)
    poles = result["bond_graph/transfer_function/C1.e/w/poles"].data
    assert np.abs(np.abs(poles) - 1.2).min() < 1e-9


def test_what_is_maximised_is_positive():
    with pytest.raises(UsageError, match="'ki' is not positive: what is maximised has a start"):
        dynid.run(asked("{Ms: 1.4}, {maximise: ki}", LAG.replace("ki: 0.3", "ki: -0.3")))


def test_margins_that_no_gain_reaches_are_refused():
    with pytest.raises(Unreachable, match="cannot be reached"):
        dynid.run(asked("{gain_margin: 3}, {phase_margin: 60}, {Ms: 1.2}"))


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        ("{Ms: 0.9}", "'Ms' is a factor above 1"),
        ("{Ms: 1.4, loop: 3}", "no loop 3; there are 2"),
        ("{maximise: kv}", "'kv' is not free"),
        ("{minimise: h2, loop: 1}", "'loop' belongs to a margin"),
        ("{pole: 1}", "only margins (phase_margin, gain_margin, Ms, Mt) are designed with a delay"),
        ("{Ms: 1.4, pole: 2}", "a target is one of"),
    ],
)
def test_faults_of_targets_are_located(targets, message):
    with pytest.raises(SceneError) as raised:
        asked(targets)
    assert message in str(raised.value)


SAMPLED = LAG.replace("delay: 0.5", "sample: 0.2, computation: 0.05").replace(
    "delay: 0.1", "sample: 0.2, computation: 0.05, method: backward"
)


@pytest.mark.parametrize("loop", [1, 2])
@pytest.mark.parametrize("kind", ["phase_margin", "gain_margin", "Ms", "Mt"])
def test_slopes_of_sampled_loops_are_those_of_differences(kind, loop):
    text = SAMPLED.replace("free: {kp: , ki: }", "free: {kp: , ki: , kv: , r: }")
    text = (
        text.replace("kv: 0.5}", "kv: 2.6, r: 2}")
        .replace("kp: 1, ki: 0.3", "kp: 2, ki: 1.6")
        .replace("value: 2", "value: r")
    )
    functions = DesignFunctions(design_of(asked(f"{{{kind}: 2, loop: {loop}}}", text)))
    eta, step = functions.coordinates.start, 1e-4
    here = functions.at(eta)
    differences = []
    for direction in np.eye(len(eta)):
        values = [functions.at(eta + side * step * direction).residuals[0] for side in (-2, -1, 1, 2)]
        differences.append((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step))
    size = np.abs(here.jacobian).max()
    assert here.jacobian[0] == pytest.approx(differences, abs=1e-7 * size)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("targets", "reached"),
    [
        ("{phase_margin: 70}, {gain_margin: 9}", {"phase": 70, "gain": 9}),
        ("{Ms: 1.4}, {maximise: ki}", {"Ms": 1.4}),
        ("{Mt: 1.4}", {"Mt": 1.4}),
    ],
)
def test_targets_of_sampled_loops_are_met_by_the_exact_margins(targets, reached):
    result = dynid.run(asked(targets, SAMPLED))
    for name, value in reached.items():
        assert result[f"bond_graph/margins/{name}"].data[0] == pytest.approx(value, rel=1e-9)
    assert result.value("bond_graph/system/stable")
    assert "bond_graph/design/frequency_response/omega" not in result


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("method: backward", "method: zoh", "a controller of 'method: zoh' is not designed"),
        ("computation: 0.05", "computation: kp/20", "a sample time that depends on a free parameter"),
        ("sample: 0.2, computation: 0.05, method: backward", "delay: 0.1", "around delays or lines"),
        (
            "TARGETS",
            "{pole: 1}",
            "only margins (phase_margin, gain_margin, Ms, Mt) are designed with sampled",
        ),
    ],
)
def test_what_is_not_designed_of_sampled_loops_is_refused(old, new, message):
    with pytest.raises((SceneError, UsageError)) as raised:
        dynid.run(asked("{phase_margin: 60}", SAMPLED.replace(old, new)))
    assert message in str(raised.value)
