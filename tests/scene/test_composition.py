"""Sub-models: nested graphs equal their flat form exactly; faults stand where they are written."""

import random
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
import sympy

import dynid
from dynid.errors import FileError, SceneError, Singular
from dynid.scene.composition import composed
from dynid.scene.identified import identified_scene
from dynid.scene.kinds.bond_graph import built_graph
from dynid.scene.load import check_source, load_scene
from dynid.scene.yaml.source import apply_overrides, parse_source, read_source
from tests.bondgraph.random_graphs import random_graph
from tests.sample import sample
from tests.scene.nested_graphs import nested
from tests.work import at_most


def scene(text):
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


def faults(text):
    with pytest.raises(SceneError) as raised:
        scene(text)
    return str(raised.value)


def graph_scene(nodes, bonds, inputs, outputs, **more):
    analysis = {
        "inputs": inputs,
        "outputs": outputs,
        "engine": "exact",
        "results": ["transfer_function", "zeros", "poles"],
    }
    return dynid.scene_from(
        {"kind": "bond-graph", "graph": {"nodes": nodes, "bonds": bonds}, "analysis": analysis, **more}
    )


def content(graph, names=None):
    """Return what a graph is, whatever the order of its nodes and bonds."""
    names = names or {name: name for name in graph.nodes}
    nodes = {names[name]: (node.type, node.value) for name, node in graph.nodes.items()}
    return nodes, Counter((names[bond.tail], names[bond.head]) for bond in graph.bonds)


def both(seed):
    """Return a random graph of nested models, the flat one, and the names of its nodes in the first."""
    rng = random.Random(seed)
    types, values, bonds, inputs, (node, quantity) = random_graph(
        rng, rng.randint(1, 9), rng.choice([0, 1, 2])
    )
    models, nodes, texts, names = nested(rng, types, values, bonds)
    whole = graph_scene(
        nodes, texts, [names[name] for name in inputs], [f"{names[node]}.{quantity}"], models=models
    )
    nodes = {
        name: {"type": kind} | ({"value": str(values[name])} if name in values else {})
        for name, kind in types.items()
    }
    return (
        whole,
        graph_scene(nodes, [" -> ".join(bond) for bond in bonds], inputs, [f"{node}.{quantity}"]),
        names,
    )


@pytest.mark.parametrize("seed", sample(range(300), 30))
def test_nested_models_are_the_flat_graph(seed):
    whole, flat, names = both(seed)
    assert content(built_graph(whole).graph) == content(built_graph(flat).graph, names)


@pytest.mark.parametrize("seed", sample(range(300, 340), 20))
def test_nested_models_have_the_responses_of_the_flat_graph(seed):
    whole, flat, names = both(seed)
    try:
        expected = dynid.run(flat)
    except Singular:
        with pytest.raises(Singular):
            dynid.run(whole)
        return
    found = dynid.run(whole)
    (output,) = flat.model.analysis.outputs
    node, _, quantity = str(output).rpartition(".")
    for name in flat.model.analysis.inputs:
        for part in ("numerator", "denominator", "zeros", "poles"):
            one = expected[f"bond_graph/transfer_function/{node}.{quantity}/{name}/{part}"].data
            other = found[f"bond_graph/transfer_function/{names[node]}.{quantity}/{names[name]}/{part}"].data
            np.testing.assert_array_equal(one, other)


MOTOR = """
dynid: 1
kind: bond-graph
models:
  motor:
    ports: [supply, rotor]
    parameters: {R: 1.2, L: 5.0e-4, k: 0.05, J: "2*J0", J0: 1.0e-5}
    nodes:
      circuit: {type: 1, domain: electrical}
      R: {type: R, value: R}
      L: {type: I, value: L}
      k: {type: GY, value: k}
      rotor: 1
      J: {type: I, value: J}
    bonds: [supply -> circuit, circuit -> R, circuit -> L, circuit -> k -> rotor, rotor -> J]
parameters: {Rm: 2}
graph:
  nodes:
    V: Se
    m1: {model: motor, R: 2*Rm}
    d: {type: R, value: 0.5}
  bonds: [V -> m1.supply, m1.rotor -> d]
analysis: {outputs: [m1.J.f]}
"""


def test_an_instance_has_the_values_of_its_model_where_it_gives_none():
    graph = built_graph(scene(MOTOR)).graph
    values = {name: node.value for name, node in graph.nodes.items()}
    assert values["m1.R"] == 4
    assert values["m1.J"] == Fraction(2, 100_000)
    assert graph.nodes["m1.circuit"].domain == "electrical"


def test_a_node_of_an_instance_is_addressed_by_overrides_and_studies():
    source = parse_source(MOTOR.lstrip("\n"), "scene.yaml")
    changed = check_source(
        apply_overrides(source, ["graph.nodes.m1.J0=3e-5", "models.motor.parameters.k=0.1"])
    )
    values = {name: node.value for name, node in built_graph(changed).graph.nodes.items()}
    assert (values["m1.J"], values["m1.k"]) == (Fraction(6, 100_000), Fraction(1, 10))
    assert "model: motor" in changed.source.resolved_text()


def test_a_parameter_named_as_the_variable_of_a_node_leaves_the_variable():
    """`arm.e` may be a node e of the instance arm; of a node, e f q p are its variables."""
    text = MOTOR.replace("J: {type: I, value: J}", "e: {type: I, value: J}").replace(
        "rotor -> J", "rotor -> e"
    )
    found = scene(text.replace("m1.J.f", "m1.e.f"))
    assert "m1.e" in built_graph(found).graph.nodes


CHAIN = """
dynid: 1
kind: bond-graph
models:
  segment:
    ports: [left, right]
    parameters: {m: 1, c: 0.1}
    nodes: {a: 1, m: {type: I, value: m}, b: 0, c: {type: C, value: c}}
    bonds: [left -> a -> b -> right, a -> m, b -> c]
graph:
  nodes:
    F: Se
    line: {model: segment, repeat: 3, chain: [right, left], c: 0.5}
    end: {type: R, value: 1}
  bonds: [F -> line.left, line.right -> end]
analysis: {outputs: [line.2.m.f, end.f]}
"""


def test_a_chain_joins_its_copies_and_has_the_outer_ports():
    graph = built_graph(scene(CHAIN)).graph
    assert content(graph)[1] == Counter(
        [
            ("F", "line.1.a"),
            *((f"line.{k}.a", f"line.{k}.{name}") for k in (1, 2, 3) for name in "bm"),
            *((f"line.{k}.b", f"line.{k}.c") for k in (1, 2, 3)),
            ("line.1.b", "line.2.a"),
            ("line.2.b", "line.3.a"),
            ("line.3.b", "end"),
        ]
    )
    assert {graph.nodes[f"line.{k}.c"].value for k in (1, 2, 3)} == {Fraction(1, 2)}


def test_a_chain_of_telegraph_segments_is_the_power_of_its_chain_matrix():
    """Per segment (e, f) left = [[1 + zy, z], [y, 1]] (e, f) right with z = m s, y = c s, exactly."""
    s = sympy.Symbol("s")
    matrix = sympy.Matrix([[1 + s * s / 2, s], [s / 2, 1]]) ** 3
    expected = sympy.Poly(sympy.expand(matrix[0, 0] + matrix[0, 1]), s)  # e over f at an end of R = 1
    found = dynid.run(
        scene(
            CHAIN.replace("[line.2.m.f, end.f]", "[end.f]\n  engine: exact")
            .replace("{outputs", "\n  outputs")
            .replace("exact}", "exact")
        )
    )
    own = found["bond_graph/transfer_function/end.f/F/denominator"].data
    numerator = found["bond_graph/transfer_function/end.f/F/numerator"].data
    np.testing.assert_allclose(own / numerator[-1], np.array(expected.all_coeffs(), dtype=float), rtol=1e-15)


@pytest.mark.parametrize("count", [1, 2])
def test_copies_without_a_chain_are_connected_one_by_one(count):
    nodes = {"F": "Se", "j": 1, "pair": {"model": "leg", "repeat": count}}
    leg = {"ports": ["foot"], "nodes": {"R": {"type": "R", "value": 2}}, "bonds": ["foot -> R"]}
    bonds = ["F -> j", *(f"j -> pair.{k}.foot" for k in range(1, count + 1))]
    graph = built_graph(graph_scene(nodes, bonds, ["F"], ["j.f"], models={"leg": leg})).graph
    assert set(graph.nodes) == {"F", "j", *(f"pair.{k}.R" for k in range(1, count + 1))}


def test_models_are_read_from_files_that_use_files(tmp_path):
    models = MOTOR[MOTOR.index("models:") : MOTOR.index("parameters: {Rm")]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "motor.yaml").write_text(models)
    (tmp_path / "all.yaml").write_text("use: parts/motor.yaml\n")
    own = tmp_path / "scene.yaml"
    own.write_text(MOTOR.lstrip("\n").replace(models, "use: [all.yaml]\n"))
    assert content(built_graph(load_scene(own)).graph) == content(built_graph(scene(MOTOR)).graph)


def test_two_files_may_use_the_same_one(tmp_path):
    models = MOTOR[MOTOR.index("models:") : MOTOR.index("parameters: {Rm")]
    (tmp_path / "motor.yaml").write_text(models)
    (tmp_path / "one.yaml").write_text("use: motor.yaml\n")
    (tmp_path / "two.yaml").write_text("use: ./motor.yaml\n")
    own = tmp_path / "scene.yaml"
    own.write_text(MOTOR.lstrip("\n").replace(models, "use: [one.yaml, two.yaml]\n"))
    assert content(built_graph(load_scene(own)).graph) == content(built_graph(scene(MOTOR)).graph)


def test_a_result_holds_the_models_of_other_files(tmp_path):
    models = MOTOR[MOTOR.index("models:") : MOTOR.index("parameters: {Rm")]
    (tmp_path / "motor.yaml").write_text(models)
    own = tmp_path / "scene.yaml"
    own.write_text(MOTOR.lstrip("\n").replace(models, "use: motor.yaml\n"))
    text = load_scene(own).source.resolved_text()
    assert content(built_graph(scene(text)).graph) == content(built_graph(scene(MOTOR)).graph)


def test_a_fault_in_a_used_file_stands_in_that_file(tmp_path):
    models = MOTOR[MOTOR.index("models:") : MOTOR.index("parameters: {Rm")].replace(
        "value: R}", "value: R + Q}"
    )
    (tmp_path / "motor.yaml").write_text(models)
    own = tmp_path / "scene.yaml"
    own.write_text(
        MOTOR.lstrip("\n").replace(
            MOTOR[MOTOR.index("models:") : MOTOR.index("parameters: {Rm")], "use: motor.yaml\n"
        )
    )
    with pytest.raises(SceneError, match=r"motor\.yaml:7:\d+: .*'Q'"):
        load_scene(own)


def place(text, fragment):
    """Return LINE:COLUMN of a fragment; `|` stands for the place where it differs from its beginning."""
    before, _, after = fragment.partition("|")
    at = text.index(before + after) + (len(before) if after else 0)
    return f"{text.count(chr(10), 0, at) + 1}:{at - text.rfind(chr(10), 0, at)}"


@pytest.mark.parametrize(
    ("old", "new", "at", "message"),
    [
        ("model: motor", "model: moter", "model: |moter", "no model 'moter'; did you mean 'motor'?"),
        ("R: 2*Rm", "Q: 2*Rm", "Q: 2", "the model 'motor' has no parameter 'Q'"),
        ("{R: 1.2", "{Q: null, R: 1.2", "m1: ", "'m1' needs the parameter 'Q' of its model 'motor'"),
        ("R: 2*Rm", "R: 2*Rn", "R: |2*Rn", "no parameter 'Rn'"),
        ("V -> m1.supply, ", "", "m1: ", "port 'supply' of 'm1' has no bond; connect it"),
        ("-> d]", "-> d, d -> m1.supply]", "d -> m1", "port 'supply' of 'm1' has 2 bonds"),
        (
            "m1.rotor ->",
            "m1.J ->",
            "m1.J ->",
            "bond 'm1.J -> d': 'm1.J' is no port; bonds attach at m1.supply, m1",
        ),
        (
            "m1.rotor ->",
            "m1 ->",
            "m1 ->",
            "bond 'm1 -> d': 'm1' is an instance of motor; bonds attach at m1.s",
        ),
        (
            "V -> m1.supply",
            "m1.supply -> V",
            "m1.supply ->",
            "the arrows at port 'm1.supply' contradict each",
        ),
        ("rotor: 1", "other: {model: motor}", "model: |motor}", "the model contains itself: motor -> motor"),
        (
            "[supply, rotor]",
            "[supply, rotor, x]",
            ", |x]",
            "the port 'x' is no node, so one bond of the model ends",
        ),
        ("{R: 1.2", "{value: 1.2", "value: 1.2", "'value' is a key of nodes; use another name"),
        (
            "circuit -> R,",
            "circuit -> Q,",
            "circuit -> Q",
            "bond 'm1.circuit -> m1.Q': no node 'm1.Q'; did you",
        ),
        ("m1: {model", "m 1: {model", "m 1", "'m 1' cannot be a name"),
        ("R: {type", "R!: {type", "R!: {", "'R!' cannot name a node"),
        ("Rm: 2}", "Rm: 2, m1.R: 3}", "m1.R: 3", "'m1.R' is a parameter of the instance 'm1'; use another"),
        ("R: 2*Rm", "repeat: 0", "repeat: |0", "'repeat' is a whole number from 1"),
        ("R: 2*Rm", "chain: [supply, rotor]", "chain: [", "'chain' is [port, port] beside 'repeat'"),
        (
            "R: 2*Rm",
            "repeat: 2, chain: [supply, x]",
            ", |x]",
            "the model 'motor' has no port 'x'; it has supply",
        ),
        ("models:", "use: none.yaml\nmodels:", "use: |none", "none.yaml: no such file; 'use' is relative"),
        (
            "models:",
            "use: dc_motor\nmodels:",
            "use: |dc_motor",
            "the model 'dc_motor' comes with dynid and needs no 'use': leave this out",
        ),
        ("models:", "use: 3\nmodels:", "use: |3", "'use' names files of models"),
        ("m1.J.f", "m1.rotr.f", "[|m1.rotr", "'m1.rotr.f': no node 'm1.rotr'; did you mean 'm1.rotor'?"),
        ("    nodes:\n      circuit", "    knots:\n      circuit", "knots", "unknown key 'knots'"),
        ("graph:\n", "graphs:\n", "models", "models are for a 'graph'; there is none"),
        (
            "rotor: 1",
            "rotor: {model: motor}",
            ", |rotor]",
            "the port 'rotor' is an instance; name a port of another name",
        ),
    ],
)
def test_faults_stand_where_they_are_written(old, new, at, message):
    text = MOTOR.lstrip("\n")
    assert old in text
    text = text.replace(old, new)
    with pytest.raises((SceneError, FileError)) as raised:
        scene(text)
    assert f"scene.yaml:{place(text, at)}: {message}" in str(raised.value)


def test_a_missing_file_of_models_is_not_answered_with_templates_of_scenes():
    with pytest.raises(FileError) as raised:
        scene(MOTOR.replace("models:", "use: none.yaml\nmodels:"))
    assert "dynid new" not in str(raised.value)


def test_one_mistake_is_reported_once():
    assert faults(MOTOR.replace("R: 2*Rm", "repeat: 0")).count("\n") == 0
    assert faults(MOTOR.replace("R: 2*Rm", "repeat: 2, chain: [supply, x]")).count("\n") == 0
    assert faults(MOTOR.replace("model: motor", "model: moter")).count("\n") == 0


def test_models_that_contain_each_other_are_refused_with_the_circle():
    models = """
models:
  a: {ports: [p], nodes: {j: 1, b: {model: b}}, bonds: [p -> j -> b.p]}
  b: {ports: [p], nodes: {j: 0, a: {model: a}}, bonds: [p -> j -> a.p]}
graph: {nodes: {S: Se, x: {model: a}}, bonds: [S -> x.p]}
analysis: {outputs: [S.f]}
"""
    assert "the model contains itself: a -> b -> a" in faults(f"dynid: 1\nkind: bond-graph{models}")


def test_files_that_use_each_other_are_refused(tmp_path):
    (tmp_path / "a.yaml").write_text("use: b.yaml\nmodels: {}\n")
    (tmp_path / "b.yaml").write_text("use: a.yaml\nmodels: {}\n")
    own = tmp_path / "scene.yaml"
    own.write_text(f"use: a.yaml{MOTOR}")
    with pytest.raises(SceneError, match=r"b\.yaml:1:6: 'a\.yaml' uses itself"):
        load_scene(own)


def test_a_thousand_copies_are_one_graph_of_as_many_nodes():
    graph = built_graph(scene(CHAIN.replace("repeat: 3", "repeat: 1000"))).graph
    assert len(graph.nodes) == 4002


ARM = """
dynid: 1
kind: bond-graph
models:
  drive:
    ports: [supply, hub]
    parameters: {k: 0.05, EI: 30}
    nodes:
      circuit: 1
      R: {type: R, value: 2}
      k: {type: GY, value: k}
      rotor: 1
      J: {type: I, value: 0.01}
      field: {type: I, matrix: [[2, 0.5], [0.5, EI/30]], ports: [a, b]}
      arm: {model: arm, EI: EI}
    bonds: [supply -> circuit -> k -> rotor -> J, circuit -> R, rotor -> arm.hub, rotor -> field.a,
      arm.tip -> field.b, rotor -> hub]
  arm:
    ports: [hub, tip]
    parameters: {EI: null}
    nodes:
      beam:
        type: structure
        structure: {beam: {elements: 3, length: 0.25, EI: EI, rhoA: 0.8, supports: [{node: 1, fix: [w]}]}}
        ports: {hub: theta_1, tip: w_4}
    bonds: [hub -> beam.hub, beam.tip -> tip]
graph:
  nodes: {V: Se, d: {model: drive, EI: 20}, load: {type: R, value: 3}}
  bonds: [V -> d.supply, d.hub -> load]
analysis:
  outputs: [d.J.f, d.arm.beam.tip.f, d.field.b.e]
  engine: exact
  results: [transfer_function, zeros, poles]
"""
FLAT_ARM = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    V: Se
    circuit: 1
    R: {type: R, value: 2}
    k: {type: GY, value: 0.05}
    rotor: 1
    J: {type: I, value: 0.01}
    field: {type: I, matrix: [[2, 0.5], [0.5, 20/30]], ports: [a, b]}
    beam:
      type: structure
      structure: {beam: {elements: 3, length: 0.25, EI: 20, rhoA: 0.8, supports: [{node: 1, fix: [w]}]}}
      ports: {hub: theta_1, tip: w_4}
    load: {type: R, value: 3}
  bonds: [V -> circuit -> k -> rotor -> J, circuit -> R, rotor -> beam.hub, rotor -> field.a,
    beam.tip -> field.b, rotor -> load]
analysis:
  outputs: [J.f, beam.tip.f, field.b.e]
  engine: exact
  results: [transfer_function, zeros, poles]
"""


def test_fields_and_structures_within_models_are_those_of_the_flat_graph():
    found, expected = dynid.run(scene(ARM)), dynid.run(scene(FLAT_ARM))
    for nested_name, name in (
        ("d.J.f", "J.f"),
        ("d.arm.beam.tip.f", "beam.tip.f"),
        ("d.field.b.e", "field.b.e"),
    ):
        for part in ("numerator", "denominator", "zeros", "poles"):
            one = found[f"bond_graph/transfer_function/{nested_name}/V/{part}"].data
            np.testing.assert_array_equal(one, expected[f"bond_graph/transfer_function/{name}/V/{part}"].data)


IDENTIFIED = """
dynid: 1
kind: identification
models:
  stage:
    ports: [left, right]
    parameters: {m: 2, c: 0.01, b: {start: 1, true: 3}}
    nodes: {v: 1, m: {type: I, value: m}, z: 0, s: 1, c: {type: C, value: c}, b: {type: R, value: b}}
    bonds: [left -> v -> m, v -> z -> s, s -> c, s -> b, z -> right]
parameters: {mass: {start: 1, true: 2.5}}
graph:
  nodes:
    F: Se
    one: {model: stage, m: mass}
    two: {model: stage, m: mass, c: {start: 0.02, true: 0.008}, b: 2}
    wall: {type: Sf}
  bonds: [F -> one.left, one.right -> two.left, two.right -> wall]
excitation: [{source: F, kind: multisine, amplitude: [1, 1, 1], frequency: [2, 7, 15]}]
measurement:
  {step: 0.005, samples: 600, channels: [{output: one.m.f}, {output: two.m.f}],
   simulate: {noise_ratio: 0.01, seed: 4}}
estimator: {method: auto}
"""


def test_unknowns_of_instances_are_identified_and_written_back():
    result = dynid.run(scene(IDENTIFIED))
    names = [str(name) for name in result["identification/parameters/name"].data]
    assert sorted(names) == ["mass", "one.b", "two.c"]
    estimates = dict(zip(names, result["identification/parameters/estimate"].data, strict=True))
    expected = {"mass": 2.5, "one.b": 3, "two.c": 0.008}
    errors = dict(zip(names, result["identification/parameters/standard_error"].data, strict=True))
    for name, value in expected.items():
        assert abs(estimates[name] - value) < 4.5 * errors[name]
    # The unknown of one instance within a model has no place in the model: the scene is written flat.
    assert parse_source(identified_scene(result)).data["parameters"]["one.b"] == pytest.approx(
        estimates["one.b"]
    )


def test_an_unknown_that_an_instance_is_given_is_written_back_there():
    result = dynid.run(scene(IDENTIFIED.replace("b: {start: 1, true: 3}", "b: 3")))
    written = parse_source(identified_scene(result))
    names = [str(name) for name in result["identification/parameters/name"].data]
    estimate = result["identification/parameters/estimate"].data[names.index("two.c")]
    assert written.data["graph"]["nodes"]["two"]["c"] == estimate
    assert written.data["models"]["stage"]["parameters"]["b"] == 3
    check_source(written)


def nested_scene(models, instance="{model: m0}", name="x"):
    """Return a scene with an instance of the first model beside a graph that is valid."""
    lines = "\n".join(f"  {name}: {model}" for name, model in models.items())
    return (
        "dynid: 1\nkind: bond-graph\n"
        f"graph: {{nodes: {{v: Se, j: 1, m: {{type: I, value: 1}}, {name}: {instance}}}, "
        f"bonds: [v -> j, j -> m]}}\n"
        f"analysis: {{outputs: [m.f]}}\nmodels:\n{lines}\n"
    )


def refused_at_once(text):
    """Return the faults of a scene, which take the work of a second."""
    with at_most(calls=2_000_000):
        return faults(text)


LEAF = "{nodes: {a: {type: R, value: 1}}}"


@pytest.mark.parametrize("wide", [2, 3, 10])
def test_models_that_multiply_are_refused_before_they_are_expanded(wide):
    """Each level has several instances of the next: the size grows as a power of the depth."""
    names = "abcdefghij"[:wide]
    depth = 45
    models = {
        f"m{k}": f"{{nodes: {{{', '.join(f'{name}: {{model: m{k + 1}}}' for name in names)}}}}}"
        for k in range(depth)
    }
    reported = refused_at_once(nested_scene(models | {f"m{depth}": LEAF}))
    assert (
        "the instances of models make more than 4,000,000 values in this graph; use fewer copies" in reported
    )
    assert reported.count("\n") == 0


@pytest.mark.parametrize("counts", [(100_000, 100_000), (300, 300, 300), (2, 100_000, 50)])
def test_copies_of_copies_are_refused_before_they_are_expanded(counts):
    models = {
        f"m{k}": f"{{nodes: {{a: {{model: m{k + 1}, repeat: {count}}}}}}}" for k, count in enumerate(counts)
    }
    leaf = {f"m{len(counts)}": "{nodes: {a: {type: I, value: 1}, b: {type: C, value: 2}}}"}
    assert "more than 4,000,000 values" in refused_at_once(nested_scene(models | leaf))
    empty = refused_at_once(nested_scene(models | {f"m{len(counts)}": "{nodes: {}}"}))
    assert f"the model 'm{len(counts)}' needs the key 'nodes'" in empty


def test_long_names_and_large_nodes_count_in_the_size_of_copies():
    text = nested_scene({"m0": LEAF}, "{model: m0, repeat: 100000}", "x" * 1000)
    assert "more than 4,000,000 values" in refused_at_once(text)
    matrix = [[1] * 20] * 20  # 400 values a copy
    text = nested_scene(
        {"m0": f"{{nodes: {{a: {{type: R, matrix: {matrix}}}}}}}"}, "{model: m0, repeat: 20000}"
    )
    assert "more than 4,000,000 values" in refused_at_once(text)


@pytest.mark.parametrize("depth", [51, 300, 3000])
def test_models_too_deep_in_one_another_are_refused(depth):
    models = {f"m{k}": f"{{nodes: {{a: {{model: m{k + 1}}}}}}}" for k in range(depth - 1)}
    reported = refused_at_once(nested_scene(models | {f"m{depth - 1}": LEAF}))
    assert "models stand more than 50 deep in one another; join some of them" in reported
    assert reported.count("\n") == 0


def test_fifty_models_in_one_another_are_one_graph():
    models = {f"m{k}": f"{{nodes: {{a: {{model: m{k + 1}}}}}}}" for k in range(49)}
    source = composed(parse_source(nested_scene(models | {"m49": LEAF})))
    assert "x" + ".a" * 50 in source.data["graph"]["nodes"]


@pytest.mark.parametrize("order", [1, -1])
def test_a_model_of_two_depths_is_too_deep_where_its_deeper_use_is(order):
    """The model m0 is 30 deep; below 25 others it is too deep, whichever of both is met first."""
    models = {f"m{k}": f"{{nodes: {{a: {{model: m{k + 1}}}}}}}" for k in range(29)} | {"m29": LEAF}
    models |= {f"n{k}": f"{{nodes: {{a: {{model: n{k + 1}}}}}}}" for k in range(24)}
    models["n24"] = "{nodes: {a: {model: m0}}}"
    pair = ["p: {model: m0}", "q: {model: n0}"][::order]
    text = nested_scene(models | {"both": f"{{nodes: {{{', '.join(pair)}}}}}"}, "{model: both}")
    assert "more than 50 deep" in refused_at_once(text)


@pytest.mark.parametrize(
    "wrong", ["{model: none}", "{model: m2, Q: 1}", "{model: m2, repeat: 0}", "{model: m3}"]
)
def test_a_fault_in_a_model_of_many_copies_is_reported_once_and_at_once(wrong):
    models = {
        "m0": "{nodes: {a: {model: m1, repeat: 100000}}}",
        "m1": f"{{nodes: {{a: {wrong}}}}}",
        "m2": LEAF,
        "m3": "{parameters: {R: null}, nodes: {a: {type: R, value: R}}}",
    }
    assert refused_at_once(nested_scene(models)).count("\n") == 0


def test_a_bond_without_a_port_in_many_copies_is_reported_at_once():
    models = {"m0": "{nodes: {a: 1, b: {model: m1}}, bonds: [a -> b.q]}", "m1": LEAF}
    reported = refused_at_once(nested_scene(models, "{model: m0, repeat: 50000}"))
    assert "'b.q' is no port" in reported
    assert reported.count("\n") == 0


@pytest.mark.parametrize(
    "spellings", [("{}.yaml", "./{}.yaml"), ("{}.yaml", "down/../{}.yaml"), ("d/{}.yaml", "e/{}.yaml")]
)
def test_each_file_is_read_once_by_whichever_names(tmp_path, monkeypatch, spellings):
    """Every file uses the next under two names: read by name, the last would be read 2^40 times."""
    (tmp_path / "down").mkdir()
    for link in "de":
        (tmp_path / link).symlink_to(tmp_path, target_is_directory=True)
    for k in range(40):
        names = ", ".join(spelling.format(f"f{k + 1}") for spelling in spellings)
        (tmp_path / f"f{k}.yaml").write_text(f"use: [{names}]\n")
    (tmp_path / "f40.yaml").write_text(
        "models: {leaf: {ports: [a], nodes: {a: 1, r: {type: R, value: 1}}, bonds: [a -> r]}}\n"
    )
    (tmp_path / "scene.yaml").write_text(
        "dynid: 1\nkind: bond-graph\nuse: f0.yaml\n"
        "graph: {nodes: {v: Se, j: 1, x: {model: leaf}}, bonds: [v -> j, j -> x.a]}\n"
        "analysis: {outputs: [m.f]}\n"
    )
    files = []

    def read(path):
        files.append(path)
        return read_source(path)

    monkeypatch.setattr("dynid.scene.models.read_source", read)
    source = composed(read_source(tmp_path / "scene.yaml"))
    assert "x.a" in source.data["graph"]["nodes"]
    assert len(files) == 41


def test_files_that_use_one_another_too_deep_are_refused(tmp_path):
    for k in range(60):
        (tmp_path / f"f{k}.yaml").write_text(f"use: f{k + 1}.yaml\n")
    own = tmp_path / "scene.yaml"
    own.write_text(f"use: f0.yaml{MOTOR}")
    with pytest.raises(SceneError, match=r"f49\.yaml:1:6: more than 50 files use one another in a row"):
        load_scene(own)


def test_a_model_of_two_files_is_refused_in_the_second(tmp_path):
    models = MOTOR[MOTOR.index("models:") : MOTOR.index("parameters: {Rm")]
    (tmp_path / "one.yaml").write_text(models)
    (tmp_path / "two.yaml").write_text("# another one\n" + models)
    own = tmp_path / "scene.yaml"
    own.write_text(MOTOR.lstrip("\n").replace(models, "use: [one.yaml, two.yaml]\n"))
    with pytest.raises(SceneError) as raised:
        load_scene(own)
    (found,) = raised.value.faults
    assert (found.file, found.line) == (str(tmp_path / "two.yaml"), 3)
    assert found.message == f"there are two models 'motor'; the other is in {tmp_path / 'one.yaml'}"


@pytest.mark.parametrize("content", ["[motor]\n", "graph: {nodes: {}}\n"])
def test_a_used_file_without_models_is_refused(tmp_path, content):
    (tmp_path / "one.yaml").write_text(content)
    own = tmp_path / "scene.yaml"
    own.write_text(MOTOR.lstrip("\n") + "use: one.yaml\n")
    with pytest.raises(SceneError, match=r"'one\.yaml' has no 'models'") as raised:
        load_scene(own)
    assert raised.value.faults[0].line == len(MOTOR.splitlines())


SPOILED = """
dynid: 1
kind: bond-graph
models:
  cell:
    ports: [left]
    nodes: {left: 1, r: {type: R, value: 1}}
    bonds: [left -> r]
graph:
  nodes: {u: Se, a: {model: cell}}
  bonds: [u -> a.left]
analysis: {inputs: [u], outputs: [a.r.f]}
"""


def test_a_bond_without_an_end_is_a_fault_of_its_model():
    assert "scene.yaml:7:24: 'left ->' is not a bond" in faults(
        SPOILED.replace("[left -> r]", '[left -> r, "left ->"]')
    )


def test_a_bond_that_is_no_text_is_a_fault_beside_models():
    spoiled = SPOILED.replace("bonds: [u -> a.left]", "bonds: [[u -> a.left]]")
    assert "'['u -> a.left']' is not a bond; write 'a -> b'" in faults(spoiled)


def test_a_port_that_is_no_end_of_a_bond_is_a_fault_also_of_a_chain():
    text = SPOILED.replace("[left]", "[left, right]").replace(
        "{model: cell}", "{model: cell, repeat: 2, chain: [right, left]}"
    )
    assert "the port 'right' is no node, so one bond of the model ends there, not none" in faults(text)
