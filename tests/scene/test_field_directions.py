"""Fields with bonds of both directions, against the tableau of all equations: e = Z S f along the arrows.

`python -m tests.scene.test_field_directions [COUNT] [SEED]` tries as many random graphs, and counts.
"""

import itertools
import random
import sys
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import dynid
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular, Undecided
from dynid.scene.kinds.bond_graph import built_graph
from tests.bondgraph.graphs import at, transfers
from tests.bondgraph.tableau import determined_at
from tests.sample import sample

PARTS = {"I": "MI", "C": "MC", "R": "MR"}


def random_fields(seed):
    """Return (types, values, bonds, nodes as written, outputs) of junctions between fields.

    Every bond between a junction and an element or a field has either direction; several ports of a field may
    be at one junction, and matrices may be singular or indefinite.
    """
    rng = random.Random(seed)
    types, values, bonds, nodes = {}, {}, [], {}

    def number():
        return Fraction(rng.randint(1, 30), rng.randint(1, 12))

    def join(junction, end):
        bonds.append((junction, end) if rng.random() < 0.5 else (end, junction))

    junctions = [f"j{k}" for k in range(rng.randint(1, 4))]
    for name in junctions:
        nodes[name] = types[name] = rng.choice("01")
        for k in range(rng.randint(1, 3)):
            element, kind = f"{name}x{k}", rng.choice("RIC")
            types[element], values[element] = kind, number()
            nodes[element] = {"type": kind, "value": str(values[element])}
            join(name, element)
    for one, other in itertools.pairwise(junctions):
        if rng.random() < 0.5:
            join(one, other)
    ports = []
    for k in range(rng.randint(1, 2)):
        kind, size = rng.choice("RIC"), rng.randint(1, 4)
        lower = [[rng.choice([0, 1, -1, 2]) * number() for _ in range(size)] for _ in range(size)]
        signs = [rng.choice([0, 1, 1, 1, 1, -1]) for _ in range(size)]
        terms = [list(zip(row, signs, strict=True)) for row in lower]
        matrix = [[sum(a * sign * b for (a, sign), b in zip(row, column, strict=True)) for column in lower]
                  for row in terms]  # fmt: skip
        names = [f"f{k}.p{n}" for n in range(size)]
        types[f"f{k}"], values[f"f{k}"] = PARTS[kind], (matrix, names)
        nodes[f"f{k}"] = {
            "type": kind,
            "matrix": [[str(entry) for entry in row] for row in matrix],
            "ports": [name.partition(".")[2] for name in names],
        }
        for name in names:
            join(rng.choice(junctions), name)
        ports += names
    nodes["u"] = types["u"] = rng.choice(["Se", "Sf"])
    join(rng.choice(junctions), "u")
    outputs = [(port, rng.choice("efqp")) for port in rng.sample(ports, min(2, len(ports)))]
    outputs.append((rng.choice([name for name in types if types[name] in "RIC"]), rng.choice("ef")))
    return types, values, bonds, nodes, outputs


def field_scene(nodes, bonds, outputs, **analysis):
    texts = [f"{name}.{quantity}" for name, quantity in outputs]
    graph = {"nodes": nodes, "bonds": [" -> ".join(bond) for bond in bonds]}
    return dynid.scene_from(
        {"kind": "bond-graph", "graph": graph, "analysis": {"outputs": texts, **analysis}}
    )


def judge(seed):
    """Compare one random graph, and return what came: answered, refused (as by the tableau), undecided."""
    types, values, bonds, nodes, outputs = random_fields(seed)
    s = Fraction(random.Random(seed).randint(200, 900), 211)
    outcomes = []
    for output in dict.fromkeys(outputs):
        expected = determined_at(types, values, bonds, ["u"], output, s)
        built = built_graph(field_scene(nodes, bonds, [output]))
        try:
            (function,) = transfers(ReducedGraph(built.graph, ["u"], built.outputs)).values()
        except Singular:
            assert not expected, (seed, output)
            outcomes.append("refused")
        except Undecided:
            outcomes.append("undecided")
        else:
            assert expected, (seed, output)
            assert at(function, s) == expected["u"], (seed, output)
            outcomes.append("answered")
    return outcomes


@pytest.mark.parametrize("seed", sample(range(120), 25))
def test_random_fields_have_the_transfer_functions_of_the_tableau(seed):
    assert "undecided" not in judge(seed)


def loaded(kind, matrix, signs, **keys):
    """Return the scene of a field each of whose ports has a load: a resistor and a storage at its junction.

    With the field's inward variables S v (v common at the junctions) the loads and the field add up:
    (R + s L + S Z S) v = u, of compliances with flows and efforts exchanged.
    """
    dual, ports = kind == "C", [f"p{k}" for k in range(len(matrix))]
    nodes = {"u": "Sf" if dual else "Se", "field": {"type": kind, "matrix": matrix, "ports": ports}}
    bonds = ["u -> j0"]
    for k, sign in enumerate(signs):
        nodes |= {f"j{k}": 0 if dual else 1, f"R{k}": {"type": "R", "value": k + 1}}
        nodes |= {f"S{k}": {"type": "C" if dual else "I", "value": 2}}
        bonds += [f"j{k} -> R{k}", f"j{k} -> S{k}"]
        bonds.append(f"j{k} -> field.p{k}" if sign > 0 else f"field.p{k} -> j{k}")
    return {"dynid": 1, "kind": "bond-graph", "graph": {"nodes": nodes, "bonds": bonds}} | keys


def matrices(kind, matrix, signs):
    """Return L and R of L dv/dt + R v = u, v the common flows of the junctions, of a C field their efforts.

    At a 0-junction flows into the field add up whatever the arrow; its efforts are those of the ports.
    """
    size = len(matrix)
    own = (
        np.diag(signs) @ np.array(matrix, float) @ np.diag(signs) if kind != "C" else np.array(matrix, float)
    )
    resistance = np.diag(1.0 / np.arange(1, size + 1) if kind == "C" else np.arange(1.0, size + 1))
    storage = 2 * np.eye(size)
    return (storage, resistance + own) if kind == "R" else (storage + own, resistance)


FIELD = [[3, -1, 2], [-1, 4, 1], [2, 1, 5]]
DIRECTIONS = [(1, -1, 1), (-1, 1, -1), (-1, -1, -1)]


@pytest.mark.parametrize("engine", ["exact", "float"])
@pytest.mark.parametrize("signs", DIRECTIONS)
@pytest.mark.parametrize("kind", ["I", "R", "C"])
def test_every_engine_has_poles_responses_and_port_variables_along_the_arrows(kind, signs, engine):
    L, R = matrices(kind, FIELD, signs)
    outputs = [f"field.p{k}.{quantity}" for k in range(3) for quantity in "ef"]
    frequency = {"start": 0.3, "stop": 4, "points": 3}
    analysis = {"inputs": ["u"], "outputs": outputs, "engine": engine, "frequency": frequency}
    analysis |= {"time": {"stop": 2, "step": 0.5}}
    analysis["results"] = ["frequency_response", "time_response", "poles", "state_space", "causality"]
    result = dynid.run(dynid.scene_from(loaded(kind, FIELD, signs, analysis=analysis)))
    modes = np.sort(np.linalg.eigvals(np.linalg.solve(L, -R)))
    for output in outputs:
        poles = result[f"bond_graph/transfer_function/{output}/u/poles"].data
        np.testing.assert_allclose(np.sort(poles.real), modes, rtol=1e-10)
    responses = result["bond_graph/frequency_response/response"].data[:, :, 0]
    Z = np.array(FIELD, float)
    S = np.diag(signs)
    for s, response in zip(1j * np.geomspace(0.3, 4, 3), responses, strict=True):
        v = np.linalg.solve(R + s * L, [1, 0, 0])
        e, f = (v, S @ (s * Z) @ v) if kind == "C" else ((s if kind == "I" else 1) * Z @ S @ v, v)
        np.testing.assert_allclose(response, np.column_stack([e, f]).ravel(), rtol=1e-10)
    time, steps = (result[f"bond_graph/time_response/{name}"].data for name in ("time", "response"))
    common = steps[:, [0, 2, 4] if kind == "C" else [1, 3, 5]]
    steady, A = np.linalg.solve(R, [1, 0, 0]), np.linalg.solve(L, -R)
    expected = [steady - expm(A * t) @ steady for t in time]
    np.testing.assert_allclose(common, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("signs", DIRECTIONS)
def test_stored_energy_decays_through_a_field_with_either_direction(signs):
    """Flows of the inertias from their initial values, without any input."""
    analysis = {"inputs": ["u"], "outputs": ["S1.f", "field.p1.e"], "time": {"stop": 3, "step": 0.25}}
    keys = {
        "analysis": analysis | {"results": ["time_response"]},
        "initial": {"S0": {"f": 1}, "S2": {"f": -2}},
    }
    result = dynid.run(dynid.scene_from(loaded("R", FIELD, signs, **keys)))
    L, R = matrices("R", FIELD, signs)
    A = np.linalg.solve(L, -R)
    flows = np.array([expm(A * t) @ [1, 0, -2] for t in result["bond_graph/time_response/time"].data])
    efforts = (np.array(FIELD) @ np.diag(signs) @ flows.T)[1]
    expected = np.column_stack([flows[:, 1], efforts])
    np.testing.assert_allclose(
        result["bond_graph/time_response/response"].data, expected, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("signs", DIRECTIONS)
def test_an_identified_coupling_has_its_sign_whatever_the_arrows(signs, tmp_path):
    """The record is made by the matrices, with the coupling -1 between the ports 0 and 1."""
    L, R = matrices("R", FIELD, signs)
    steady, A = np.linalg.solve(R, [1, 0, 0]), np.linalg.solve(L, -R)
    time = np.arange(200) * 0.02
    flows = np.array([steady - expm(A * t) @ steady for t in time])
    rng = np.random.default_rng(3)
    flow = flows[:, 1] + 1e-5 * rng.standard_normal(200)
    (tmp_path / "run.csv").write_text("v\n" + "".join(f"{value:.17g}\n" for value in flow))
    matrix = [[3, "a", 2], ["a", 4, 1], [2, 1, 5]]
    scene = loaded("R", matrix, signs) | {
        "kind": "identification",
        "parameters": {"a": {"start": -0.5, "scale": "linear"}},
        "excitation": [{"source": "u", "kind": "step"}],
        "measurement": {"step": 0.02, "samples": 200, "channels": [{"output": "S1.f"}],
                        "file": {"path": "run.csv", "columns": ["v"]}},
    }  # fmt: skip
    result = dynid.run(dynid.scene_from(scene, tmp_path))
    estimate, deviation = (
        result[f"identification/parameters/{name}"].data[0] for name in ("estimate", "standard_error")
    )
    assert abs(estimate + 1) < 4 * deviation < 0.01


if __name__ == "__main__":
    count, first = (int(text) for text in [*sys.argv[1:], "300", "1000"][:2])
    total = Counter()
    for seed in range(first, first + count):
        total.update(judge(seed))
    print(dict(total))
