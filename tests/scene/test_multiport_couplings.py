"""Multiport transformers and gyrators, against the tableau of all equations, exactly."""

import random
from fractions import Fraction

import numpy as np
import pytest
import yaml

import dynid
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import SceneError, Singular
from dynid.scene.kinds.bond_graph import built_graph
from tests.bondgraph.graphs import at, transfers
from tests.bondgraph.tableau import transfers_at
from tests.sample import sample


def random_coupled(seed):
    """Return (types, values, bonds, inputs, outputs, nodes as written) of junctions between multiports."""
    rng = random.Random(seed)
    types, values, bonds, nodes, outputs = {}, {}, [], {}, []

    def add(name, kind, value=None):
        types[name] = kind
        nodes[name] = {"type": kind} | ({} if value is None else {"value": str(value)})
        if value is not None:
            values[name] = value

    def number():
        return Fraction(rng.randint(1, 30), rng.randint(1, 12))

    junctions = [f"j{k}" for k in range(rng.randint(2, 4))]
    for name in junctions:
        add(name, rng.choice("01"))
        for k in range(rng.randint(1, 3)):
            add(f"{name}x{k}", rng.choice("RIC"), number())
            bonds.append((name, f"{name}x{k}"))
    for k in range(rng.randint(1, 2)):
        kind, rows, columns = rng.choice(["TF", "GY"]), rng.randint(1, 3), rng.randint(1, 3)
        moduli = [[rng.choice([0, 1, -1, 2]) * number() for _ in range(columns)] for _ in range(rows)]
        ports = [f"t{k}.p{n}" for n in range(rows + columns)]
        types[f"t{k}"], values[f"t{k}"] = f"M{kind}", (moduli, ports[:rows], ports[rows:])
        bonds += [(rng.choice(junctions), one) for one in ports[:rows]]
        bonds += [(one, rng.choice(junctions)) for one in ports[rows:]]
        nodes[f"t{k}"] = {
            "type": kind,
            "matrix": [[str(entry) for entry in row] for row in moduli],
            "ports": [one.partition(".")[2] for one in ports],
        }
        outputs.append((rng.choice(ports), rng.choice("efqp")))
    add("u", rng.choice(["Se", "Sf"]))
    bonds.append(("u", rng.choice(junctions)))
    outputs.append((rng.choice([name for name, kind in types.items() if kind in "RIC"]), rng.choice("ef")))
    return types, values, bonds, ["u"], outputs, nodes


def coupled_scene(nodes, bonds, outputs, **analysis):
    texts = [f"{name}.{quantity}" for name, quantity in outputs]
    graph = {"nodes": nodes, "bonds": [" -> ".join(bond) for bond in bonds]}
    return dynid.scene_from(
        {"kind": "bond-graph", "graph": graph, "analysis": {"outputs": texts, **analysis}}
    )


@pytest.mark.parametrize("seed", sample(range(80), 30))
def test_random_couplings_have_the_transfer_functions_of_the_tableau(seed):
    types, values, bonds, inputs, outputs, nodes = random_coupled(seed)
    s = Fraction(7, 5)
    expected = transfers_at(types, values, bonds, inputs, outputs, s)
    built = built_graph(coupled_scene(nodes, bonds, outputs))
    try:
        found = transfers(ReducedGraph(built.graph, inputs, built.outputs))
    except Singular:
        assert expected is None
        return
    if expected is not None:
        assert {(name, source): at(function, s) for (name, source), function in found.items()} == expected


def test_a_single_modulus_is_the_two_port():
    for kind in ("TF", "GY"):
        bonds = [("u", "a"), ("a", "m"), ("a", "t"), ("t", "b"), ("b", "r")]
        nodes = {"u": "Se", "a": 1, "m": {"type": "I", "value": 2}, "b": 1, "r": {"type": "R", "value": 5}}
        two_port = coupled_scene({**nodes, "t": {"type": kind, "value": 3}}, bonds, [("m", "f")])
        multi = coupled_scene(
            {**nodes, "t": {"type": kind, "matrix": [[3]], "ports": ["in", "out"]}},
            [*bonds[:2], ("a", "t.in"), ("t.out", "b"), bonds[4]],
            [("m", "f")],
        )
        own, other = dynid.run(two_port), dynid.run(multi)
        for part in ("numerator", "denominator", "poles"):
            path = f"bond_graph/transfer_function/m.f/u/{part}"
            np.testing.assert_array_equal(own[path].data, other[path].data)


def test_moduli_may_be_unknown():
    text = """
dynid: 1
kind: identification
parameters: {n: {start: 1, true: 2}}
graph:
  nodes:
    F: Se
    a: 1
    m: {type: I, value: 1}
    lever: {type: TF, matrix: [[n, 1]], ports: [left, p, q]}
    k: {type: C, value: 0.1}
    j: 0
    b: {type: R, value: 3}
  bonds: [F -> a -> m, a -> lever.left, lever.p -> k, lever.q -> b]
excitation: [{source: F, kind: multisine, amplitude: [1, 1], frequency: [2, 7]}]
measurement: {step: 0.01, samples: 400, channels: [{output: m.f}], simulate: {noise_ratio: 0.01, seed: 1}}
"""
    result = dynid.run(dynid.scene_from(yaml.safe_load(text.replace("    j: 0\n", ""))))
    found = result["identification/parameters/estimate"].data[0]
    assert abs(found - 2) < 4.5 * result["identification/parameters/standard_error"].data[0]


@pytest.mark.parametrize(
    ("node", "bond", "message"),
    [
        (
            "{type: TF, matrix: [[1, 2], [3]], ports: [a, b, c, d]}",
            "",
            "row 2 of the matrix has 1 entries, row 1 has 2",
        ),
        (
            "{type: TF, matrix: [[1, 2]], ports: [a, b]}",
            "",
            "the matrix is 1 x 2, but 'ports' names 2: those of the rows",
        ),
        (
            "{type: GY, matrix: [[1]], ports: [a, b], value: 2}",
            "",
            "a multiport GY has a 'matrix', and no 'value'",
        ),
        ("{type: GY, matrix: [[1]], ports: [a, b], domain: thermal}", "", "a multiport GY joins domains"),
        (
            "{type: TF, ports: [a, b]}",
            "",
            "a multiport TF is written {type: TF, matrix: [[…]], ports: [a, b]}",
        ),
        (
            "{type: TF, matrix: [[1]], ports: [a, b]}",
            "t.a -> one, t.b -> two",
            "power of 't' is positive into its rows; turn the bond at 't.a'",
        ),
        (
            "{type: TF, matrix: [[1]], ports: [a, b]}",
            "one -> t.a, two -> t.b",
            "positive out of its columns; turn the bond at 't.b'",
        ),
        ("{type: TF, matrix: [[1]], ports: [a, b]}", "one -> t.a", "port 't.b' has no bond"),
        (
            "{type: TF, matrix: [[1]], ports: [a, b]}",
            "one -> t, t.b -> two",
            "'t' is a multiport; bonds attach at its ports: t.a, t.b",
        ),
        ("{type: TF, matrix: [], ports: [a, b]}", "", "matrix"),
    ],
)
def test_faults_are_located(node, bond, message):
    nodes = {"u": "Se", "one": 1, "two": 1, "r": {"type": "R", "value": 1}, "t": yaml.safe_load(node)}
    bonds = ["u -> one", "two -> r", *(bond or "one -> t.a, t.b -> two").split(", ")]
    data = {"kind": "bond-graph", "graph": {"nodes": nodes, "bonds": bonds}, "analysis": {"outputs": ["r.f"]}}
    with pytest.raises(SceneError) as raised:
        dynid.scene_from(data)
    assert message in str(raised.value), str(raised.value)
