"""Bond graphs identified: the same answers as of the structures that they are, and estimates at the bound."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid import load_scene
from dynid.arithmetic.dependent import Dependent
from dynid.bondgraph.graph import BondGraph
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Multisine
from dynid.parameters import Parameter
from dynid.scene.kinds.identified_graphs import identified_graph
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.bondgraph.graphs import build, parse, port
from tests.identification.test_graph_system import MOTOR, written
from tests.sample import sample

pytestmark = pytest.mark.thorough


def chain_twice(masses, stiffness, damping, joints, factor=0.6):
    """A grounded chain as a structure and as a graph; these links (from 1, at the ground) are unknown joints.

    The graph has C = 1/k, with the joints' k and c as its parameters.
    """
    n = len(masses)
    links, unknown, parameters, dependents = [], [], [], {}
    nodes, bonds = "Se F", f"F -> v{n}"
    exact = ([Fraction(float(x)) for x in numbers] for numbers in (masses, stiffness, damping))
    for i, (m, k, c) in enumerate(zip(*exact, strict=True), 1):
        dofs = (1,) if i == 1 else (i - 1, i)
        nodes += f", 1 v{i}, I m{i} {m}, 0 z{i}, 1 l{i}, C s{i} {1 / k}, R d{i} {c}"
        bonds += f", v{i} -> m{i}, v{i} -> z{i} -> l{i} -> s{i}, l{i} -> d{i}"
        bonds += f", z{i} -> v{i - 1}" if i > 1 else ""
        if i not in joints:
            links.append(Link(dofs, float(k), float(c)))
            continue
        k_and_c = (JointParameter(start=factor * float(x), true=float(x)) for x in (k, c))
        unknown.append(Joint(f"j{i}", dofs, *k_and_c))
        dependents[f"s{i}"] = 1 / Dependent.parameter(f"j{i}.k", k)
        dependents[f"d{i}"] = Dependent.parameter(f"j{i}.c", c)
        parameters += [
            Parameter(f"j{i}.{letter}", factor * float(x), true=float(x))
            for letter, x in (("k", k), ("c", c))
        ]
    types, values, pairs = parse(nodes, bonds)
    graph = build(types, values, pairs)
    nodes = [replace(node, dependent=dependents.get(name)) for name, node in graph.nodes.items()]
    return lumped(masses, links, unknown), IdentifiedGraph(BondGraph(nodes, graph.bonds), parameters)


def both(structure, graph, force, measured, step, samples, estimator, settle=10.0, seed=1):
    """Identify one record, made with the structure, in both ways."""
    last = int(max(structure.dofs))
    loads = [Load(last, force)]
    channels = tuple(Channel(dof, "velocity") for dof in measured)
    simulation = Simulation(0.05, seed, settle)
    values = data(structure, loads, Measurement(step, samples, channels, simulation)).values
    one = identify(
        structure, Experiment(loads, Measurement(step, samples, channels, values, start=settle)), estimator
    )
    loads = [graph.load("F", force)]
    channels = tuple(graph.channel(port(f"m{dof}.f")) for dof in measured)
    other = identify(
        graph, Experiment(loads, Measurement(step, samples, channels, values, start=settle)), estimator
    )
    return one, other


def numbers(result, name):
    return np.asarray(result[f"identification/{name}"].data)


SUSPENSION = chain_twice((2, 2, 1.5, 1, 1), (2e4, 3e4, 2e4, 2e4, 2e4), (20, 30, 20, 20, 20), (3, 4))
FORCE = Multisine((100.0, 100.0, 100.0), (70.0, 110.0, 250.0))


@pytest.mark.parametrize("estimator", [None, OutputError(), Filter(2)])
def test_the_suspension_as_a_graph_gives_what_it_gives_as_a_structure(estimator):
    one, other = both(*SUSPENSION, FORCE, (2, 3), 0.002, 800, estimator)
    for name in ("estimate", "standard_error", "cramer_rao"):
        np.testing.assert_allclose(
            numbers(other, f"parameters/{name}"), numbers(one, f"parameters/{name}"), rtol=1e-11
        )
    for name in ("estimate", "standard_deviation"):
        np.testing.assert_allclose(
            numbers(other, f"history/{name}"), numbers(one, f"history/{name}"), rtol=1e-10
        )


@pytest.mark.thorough
@settings(max_examples=4, deadline=None)
@given(st.integers(0, 10**6))
def test_random_chains_give_the_same_as_graphs_and_as_structures(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    k = 10 ** rng.uniform(3.5, 4.5, n)
    joints = rng.permutation(n)[: min(n, 2)] + 1
    chains = chain_twice(rng.uniform(0.5, 3, n).tolist(), k, k * 10 ** rng.uniform(-3, -2, n), joints)
    force = Multisine((50.0, 50.0, 50.0), tuple(rng.uniform(20, 250, 3)))
    for estimator in (OutputError(), Filter(1)):
        one, other = both(*chains, force, range(1, n + 1), 0.003, 400, estimator, settle=2.0, seed=seed)
        found, known = (numbers(result, "parameters/estimate") for result in (other, one))
        np.testing.assert_allclose(found, known, rtol=1e-8)
        found, known = (numbers(result, "parameters/standard_error") for result in (other, one))
        np.testing.assert_allclose(found, known, rtol=1e-7)
        found, known = (numbers(result, "history/estimate") for result in (other, one))
        np.testing.assert_allclose(found, known, rtol=1e-7)


def motor(unknown, factors):
    types, values, pairs = parse(*MOTOR)
    graph = build(types, values, pairs)
    nodes = [
        replace(node, dependent=Dependent.parameter(name, node.value)) if name in unknown else node
        for name, node in graph.nodes.items()
    ]
    truths = {name: float(graph.value(name)) for name in unknown}
    parameters = [
        Parameter(name, truths[name] * factor, true=truths[name])
        for name, factor in zip(unknown, factors, strict=True)
    ]
    return IdentifiedGraph(BondGraph(nodes, graph.bonds), parameters)


def identified(model, outputs, seed, noise=0.02):
    volts = Multisine((4.0, 4.0, 4.0, 3.0, 3.0), (8.0, 37.0, 91.0, 240.0, 700.0))
    channels = tuple(model.channel(port(output)) for output in outputs)
    return identify(
        model,
        Experiment(
            [model.load("U", volts)], Measurement(0.001, 1000, channels, Simulation(noise, seed, 1.0))
        ),
    )


@pytest.mark.thorough
@pytest.mark.parametrize("seed", sample(range(4), 1))
def test_six_values_of_a_motor_are_found_from_starts_far_away(seed):
    names = ("Ra", "L", "Km", "J", "flex", "JL")
    factors = 10 ** np.random.default_rng(seed).uniform(-1, 1, len(names))
    result = identified(motor(names, factors), ("L.f", "JL.f"), seed)
    deviations = (numbers(result, "parameters/estimate") - numbers(result, "parameters/true")) / numbers(
        result, "parameters/cramer_rao"
    )
    assert numbers(result, "diagnostics/converged")
    assert np.abs(deviations).max() < 4.5


@pytest.mark.parametrize(
    "outputs", [("L.f", "load.q"), ("L.e", "JL.e"), ("rotor.q", "load.q"), ("U.f", "flex.q")]
)
def test_displacements_efforts_and_integrals_are_measured(outputs):
    result = identified(motor(("Km", "J", "flex", "JL"), [0.8] * 4), outputs, 3)
    deviations = (numbers(result, "parameters/estimate") - numbers(result, "parameters/true")) / numbers(
        result, "parameters/cramer_rao"
    )
    assert numbers(result, "diagnostics/converged")
    assert np.abs(deviations).max() < 4.5


def test_what_no_channel_depends_on_is_named():
    model = written(
        "Sf w, 1 a, I J 2, 0 s, C k 3, 1 l, I m 4, R d 5",
        "w -> a -> J, a -> s -> k, s -> l -> m, l -> d",
        ["J", "k", "m"],
    )
    measurement = Measurement(0.1, 300, (model.channel(port("m.f")),), Simulation(0.02, 1, 5.0))
    result = identify(model, Experiment([model.load("w", Multisine((1.0, 1.0), (0.3, 0.9)))], measurement))
    assert numbers(result, "parameters/identifiable").tolist() == [False, True, True]
    assert any(text.startswith("J is not identifiable") for text in numbers(result, "diagnostics/warnings"))
    assert not numbers(result, "diagnostics/converged")


@pytest.mark.usefixtures("complete")
def test_a_motor_is_identified_from_frequency_responses():
    names = ("Ra", "L", "Km", "J", "flex", "JL")
    model = motor(names, (0.6, 1.5, 0.7, 2.0, 0.5, 1.4))
    functions = tuple(Frf(model.channel(port(output)), "U") for output in ("L.f", "JL.f"))
    result = identify(model, FrfMeasurement(np.geomspace(2, 2000, 120), functions, Simulation(0.02, 1)))
    deviations = (numbers(result, "parameters/estimate") - numbers(result, "parameters/true")) / numbers(
        result, "parameters/cramer_rao"
    )
    assert numbers(result, "diagnostics/converged")
    assert np.abs(deviations).max() < 4.5


SCENE = """
dynid: 1
kind: identification
parameters: {kb: {start: 2, true: 4}, m: 3}
graph:
  nodes: {F: Se, v: 1, k: {type: C, value: 1/kb}, m: {type: I, value: m}}
  bonds: [F -> v -> k, v -> m]
excitation: [{source: F, kind: sine, amplitude: 1, frequency: 2}]
measurement: {step: 0.01, samples: 100, channels: [{output: m.f}], simulate: {noise_ratio: 0.01, seed: 1}}
"""


def test_values_of_a_scene_depend_on_its_unknown_parameters(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    nodes = identified_graph(load_scene(path))[0].graph.nodes
    assert (nodes["k"].value, nodes["m"].value, nodes["m"].dependent) == (Fraction(1, 4), 3, None)
    assert nodes["k"].dependent.at({"kb": 2.0}) == (0.5, {"kb": -0.25})
