"""A motor and a beam in one graph, identified together from one record."""

import numpy as np
import pytest
import yaml

from dynid.bondgraph.graph import Port
from dynid.errors import UsageError
from dynid.lti.signals import Step
from dynid.scene.kinds.identified_graphs import identified_graph, started_graph
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source
from tests.sample import sample

MACHINE = """
dynid: 1
kind: identification
parameters:
  k_t: {start: 0.02, true: 0.01}
  R: {start: 2, true: 1}
graph:
  nodes:
    voltage: Se
    circuit: 1
    R: {type: R, value: R}
    L: {type: I, value: 0.05, domain: electrical}
    motor: {type: GY, value: k_t}
    rotor: 1
    J: {type: I, value: 0.01}
    d: {type: R, value: 0.01}
    gear: {type: TF, value: 0.05}
    arm:
      type: structure
      ports: {hub: theta_1, tip: w_5}
      structure:
        beam: {elements: 4, length: 0.25, EI: 30, rhoA: 0.8, supports: [{node: 1, fix: [w]}],
               masses: [{node: 5, m: 0.2}], damping: {alpha: 0.1, beta: 0.0002}}
    push: Se
  bonds: [voltage -> circuit -> motor -> rotor -> J, circuit -> R, circuit -> L, rotor -> d,
    rotor -> gear -> arm.hub, push -> arm.tip]
excitation:
  - {source: voltage, kind: multisine, amplitude: [5, 5, 5, 5], frequency: [3, 20, 60, 150]}
  - {source: push, kind: multisine, amplitude: [1, 1], frequency: [11, 95]}
measurement:
  step: 0.004
  samples: 300
  channels: [{output: L.f}, {output: arm.tip.f}]
  simulate: {noise_ratio: 0.01, seed: 1, settle: 3}
"""


def with_stiffness(data):
    data["parameters"]["EI"] = {"start": 20, "true": 30}
    data["graph"]["nodes"]["arm"]["structure"]["beam"]["EI"] = "EI"


def with_joint(data):
    data["parameters"]["kb"] = {"start": 100, "true": 200}
    data["graph"]["nodes"]["arm"]["joints"] = {"mid": {"dofs": ["theta_3"], "k": "kb", "c": 0.01}}


def reduced(data):
    data["graph"]["nodes"]["arm"]["reduction"] = {"method": "craig-bampton", "modes": {"count": 2}}


def reduced_with_stiffness(data):
    with_stiffness(data)
    reduced(data)


def on_a_spring(data):
    reduced_with_stiffness(data)
    beam = data["graph"]["nodes"]["arm"]["structure"]["beam"]
    beam["springs"] = [{"node": 1, "direction": "theta", "k": 50}]


def reduced_with_joint(data):
    with_joint(data)
    reduced(data)


CHANGES = [with_stiffness, with_joint, reduced, reduced_with_stiffness, on_a_spring, reduced_with_joint]


@pytest.mark.parametrize("change", sample(CHANGES, 2, on_a_spring))
def test_motor_and_structure_are_identified_together(change):
    data = yaml.safe_load(MACHINE)
    change(data)
    data["derived"] = []
    result = run_scene(check_source(parse_source(yaml.safe_dump(data, sort_keys=False), "machine.yaml")))
    estimate, true, bound = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "true", "cramer_rao")
    )
    assert len(true) == len(data["parameters"])
    assert np.abs((estimate - true) / bound).max() < 4.5
    assert (bound / true).max() < 0.01
    assert result.value("identification/diagnostics/converged")


@pytest.mark.parametrize("EI", [10, 29.99, 30.01, 90])
@pytest.mark.parametrize("change", [with_stiffness, reduced_with_stiffness, on_a_spring])
def test_a_structure_is_passive_far_from_the_reference(change, EI):
    data = yaml.safe_load(MACHINE)
    change(data)
    graph, _ = identified_graph(check_source(parse_source(yaml.safe_dump(data), "machine.yaml")))
    arm = [node for name, node in graph.graph.nodes.items() if name.startswith("arm_")]
    dependent = [node for node in arm if node.dependent is not None and node.type in "CIR"]
    assert len(dependent) > 4
    assert all(node.dependent.at({"EI": EI}).value > 0 for node in dependent)
    response = graph.system(
        [graph.load("voltage", Step(1.0))], [graph.channel(Port("L", "f")), graph.channel(Port("J", "f"))]
    )
    assert np.linalg.eigvals(response.at({"EI": EI}).A).real.max() < 0


@pytest.mark.parametrize(("make", "same"), [(started_graph, True), (identified_graph, False)])
def test_the_basis_of_an_estimator_does_not_know_the_truth(make, same):
    def elements(true):
        data = yaml.safe_load(MACHINE)
        data["parameters"]["m"] = {"start": 0.1, "true": true}
        arm = data["graph"]["nodes"]["arm"]
        arm["structure"]["beam"]["masses"] = [{"node": 5, "m": "m"}]
        arm["reduction"] = {"method": "modal", "modes": {"count": 3}}
        graph, _ = make(check_source(parse_source(yaml.safe_dump(data), "machine.yaml")))
        nodes = [node for node in graph.graph.nodes.values() if node.value is not None]
        values = {"m": 0.3, "k_t": 0.01, "R": 1.0}
        return [
            float(node.value if node.dependent is None else node.dependent.at(values).value) for node in nodes
        ]

    one, other = elements(0.2), elements(0.8)
    assert (len(one) == len(other) and np.allclose(one, other, rtol=1e-12, atol=0)) is same


@pytest.mark.parametrize("change", [with_stiffness, reduced_with_stiffness])
def test_modal_damping_of_unknown_modes_is_refused_at_its_node(change):
    data = yaml.safe_load(MACHINE)
    change(data)
    data["graph"]["nodes"]["arm"]["structure"]["beam"]["damping"] = {"ratio": 0.02}
    text = yaml.safe_dump(data, sort_keys=False)
    line = 1 + text.splitlines().index("    arm:")
    scene = check_source(parse_source(text, "machine.yaml"))
    with pytest.raises(UsageError, match="modal damping of 'arm' depends on unknown") as raised:
        run_scene(scene)
    assert f"machine.yaml:{line}:" in str(scene.locate(raised.value))
    data["graph"]["nodes"]["arm"]["structure"]["beam"]["EI"] = 30
    del data["parameters"]["EI"]
    identified_graph(check_source(parse_source(yaml.safe_dump(data), "machine.yaml")))
