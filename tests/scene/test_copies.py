"""Copies of a model: values of single copies, and chains whatever the arrows, against flat graphs.

The flat graph of a random nested one is made here, by its own rules.
"""

import random
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError
from dynid.scene.identified import identified_scene
from dynid.scene.kind import KINDS
from dynid.scene.kinds.bond_graph import built_graph
from dynid.scene.load import check_source
from dynid.scene.schema.json_schema import scene_schema
from dynid.scene.yaml.source import apply_overrides, parse_source
from dynid.study.executors import SerialExecutor
from dynid.study.run import run_study
from tests.sample import sample
from tests.study.small import planned


class Part:
    """A model: a row of junctions, instances and chains of other models between its ports left and right.

    Where a port is no node, power is positive from left to right (`way` 1) or from right to left (-1).
    """

    def __init__(self, rng, name, models):
        self.rng, self.name = rng, name
        self.way = rng.choice([1, -1])
        self.row = []
        for k in range(rng.randint(1, 3)):
            part = rng.choice(models) if models and rng.random() < 0.5 else None
            self.row.append((f"s{k}", part))
        self.port_nodes = {}
        if self.row[0][1] is None and rng.random() < 0.3:
            self.port_nodes["left"] = self.row[0][0]
        if self.row[-1][1] is None and len(self.row) > 1 and rng.random() < 0.3:
            self.port_nodes["right"] = self.row[-1][0]
        self.ports = [self.port_nodes.get(side, side) for side in ("left", "right")]
        self.parameters = {"p": rng.randint(1, 9), "q": "2*p"}
        self.bonds, self.entries, self.elements = [], {}, []
        for stage, part in self.row:
            if part is None:
                self.entries[stage] = rng.choice([0, 1])
                for k in range(rng.randint(1, 2)):
                    kind, value = rng.choice("RIC"), rng.choice(["p", "q", "p + q", str(rng.randint(1, 9))])
                    self.entries[f"{stage}x{k}"] = {"type": kind, "value": value}
                    self.elements.append((stage, f"{stage}x{k}", rng.random() < 0.5))
            else:
                self.entries[stage] = self.instance(part)
        self.joins = [self.between(*pair) for pair in zip(self.row, self.row[1:], strict=False)]

    def instance(self, part):
        """Return a node that is an instance of a part, or a chain of copies, some with other values."""
        rng = self.rng
        node = {"model": part.name}
        if rng.random() < 0.5:
            node["p"] = rng.choice([rng.randint(10, 19), "p + 1"])
        if rng.random() < 0.6:
            node |= {"repeat": rng.randint(1, 4), "chain": [part.ports[1], part.ports[0]]}
            copies = {}
            for number in rng.sample(range(1, node["repeat"] + 1), rng.randint(0, node["repeat"])):
                names = rng.sample(["p", "q"], rng.randint(1, 2))
                copies[number] = {name: rng.choice([rng.randint(20, 29), "q + 2"]) for name in names}
            if copies:
                node["copies"] = copies
        return node

    def end(self, stage, part, side):
        """Return the text of an end of a stage, and the way of power there, 0 if it is free."""
        if part is None:
            return stage, 0
        return f"{stage}.{part.ports[side]}", part.way_at(side)

    def way_at(self, side):
        return 0 if ("left", "right")[side] in self.port_nodes else self.way

    def between(self, one, other):
        """Return a bond between two stages, with an arrow that both allow: a junction is put between else."""
        (tail, a), (head, b) = self.end(*one, 1), self.end(*other, 0)
        if a * b < 0:
            joint = f"{one[0]}{other[0]}"
            self.entries[joint] = self.rng.choice([0, 1])
            return [[tail, joint][::a], [joint, head][::b]]
        way = a or b or self.rng.choice([1, -1])
        return [[tail, head][::way]]

    def scene(self):
        """Return the model as data."""
        bonds = [bond for join in self.joins for bond in join]
        bonds += [[stage, element][:: 1 if out else -1] for stage, element, out in self.elements]
        self.outer = {}
        for side, port in enumerate(("left", "right")):
            if port in self.port_nodes:
                continue
            stage = self.row[0 if side == 0 else -1]
            text, way = self.end(*stage, side)
            along = [port, text] if side == 0 else [text, port]
            if way * self.way < 0:  # the stage has the other way: a junction between turns it
                joint = f"{port}joint"
                self.entries[joint] = self.rng.choice([0, 1])
                inner = [joint, text] if side == 0 else [text, joint]
                bonds.append(inner[::way])
                along = [port, joint] if side == 0 else [joint, port]
            bonds.append(along[:: self.way])
        return {
            "ports": self.ports,
            "parameters": self.parameters,
            "nodes": self.entries,
            "bonds": [" -> ".join(bond) for bond in bonds],
        }


def flat(models, nodes, bonds):
    """Return the nodes (type, value) and bonds of a nested graph."""
    made, ends = {}, []

    def expand(prefix, part, values):
        for name, node in part["nodes"].items():
            if not isinstance(node, dict) or "model" not in node:
                kind = node["type"] if isinstance(node, dict) else str(node)
                value = Fraction(eval(node["value"], {}, values)) if kind in "RIC" else None
                made[prefix + name] = (kind, value)
                continue
            model = models[node["model"]]
            for number in range(1, node.get("repeat", 1) + 1):
                own = node.get("copies", {}).get(number, {})
                given = {key: own.get(key, node.get(key)) for key in ("p", "q")}
                inner = {
                    key: value if not isinstance(value, str) else eval(value, {}, values)
                    for key, value in given.items()
                    if value is not None
                }
                inner.setdefault("p", model["parameters"]["p"])
                inner.setdefault("q", 2 * inner["p"])
                copy = f"{prefix}{name}.{number}." if "repeat" in node else f"{prefix}{name}."
                expand(copy, model, inner)
            if "chain" in node:
                right, left = node["chain"]
                for number in range(1, node["repeat"]):
                    pair = (f"{prefix}{name}.{number}.{right}", f"{prefix}{name}.{number + 1}.{left}")
                    ends.append([*pair, False])
        for text in part["bonds"]:
            ends.append([*(prefix + end for end in alias(part, text.split(" -> "))), True])

    def alias(part, pair):
        for end in pair:
            holder, _, port = end.partition(".")
            node = part["nodes"].get(holder) if port else None
            if isinstance(node, dict) and "chain" in node:
                number = node["repeat"] if port == node["chain"][0] else 1
                yield f"{holder}.{number}.{port}"
            else:
                yield end

    expand("", {"nodes": nodes, "bonds": bonds}, {})
    while loose := next((end for a, b, _ in ends for end in (a, b) if end not in made), None):
        two = [one for one in ends if loose in one[:2]]
        others = [next(end for end in one[:2] if end != loose) for one in two]
        directed = [one for one in two if one[2]]
        arrow = directed[0]
        out = others[two.index(arrow)]
        other = others[1 - two.index(arrow)]
        ends = [one for one in ends if one not in two]
        ends.append([out, other, True] if arrow[1] == loose else [other, out, True])
    return made, Counter((a, b) for a, b, _ in ends)


def random_nest(seed):
    """Return models, nodes, and bonds of a random nested graph with chains."""
    rng = random.Random(seed)
    parts, models = [], {}
    for k in range(rng.randint(1, 4)):
        part = Part(rng, f"m{k}", parts[:])
        models[part.name] = part.scene()
        parts.append(part)
    part = parts[-1]
    node = part.instance(part)
    if isinstance(node.get("p"), str):  # no parameters stand around it
        del node["p"]
    for values in node.get("copies", {}).values():
        for name in [name for name, value in values.items() if isinstance(value, str)]:
            values[name] = 31
    nodes = {"u": "Se", "x": node, "end": {"type": "R", "value": "3"}}
    ends = [("u", f"x.{part.ports[0]}", part.way_at(0)), (f"x.{part.ports[1]}", "end", part.way_at(1))]
    return models, nodes, [" -> ".join((a, b)[:: way or rng.choice([1, -1])]) for a, b, way in ends]


@pytest.mark.parametrize("seed", sample(range(105), 25))
def test_random_nested_graphs_with_chains_are_their_flat_graphs(seed):
    models, nodes, bonds = random_nest(seed)
    expected_nodes, expected_bonds = flat(models, nodes, bonds)
    data = {
        "kind": "bond-graph",
        "models": models,
        "graph": {"nodes": nodes, "bonds": bonds},
        "analysis": {"outputs": ["end.f"], "results": ["causality"]},
    }
    graph = built_graph(dynid.scene_from(data)).graph
    assert {name: (node.type, node.value) for name, node in graph.nodes.items()} == expected_nodes
    junction_chains = Counter((bond.tail, bond.head) for bond in graph.bonds)
    free = {pair for pair in junction_chains if pair not in expected_bonds}
    turned = Counter(
        {pair if pair in expected_bonds else pair[::-1]: n for pair, n in junction_chains.items()}
    )
    assert turned == expected_bonds
    # Only bonds of chains between two ports that are junctions have no arrow of their own.
    assert not any(pair[0].rpartition(".")[0] == pair[1].rpartition(".")[0] for pair in free)


@pytest.mark.parametrize("forward", [True, False])
@pytest.mark.parametrize("chain", [["right", "t"], ["t", "right"]])
def test_a_two_port_as_a_port_turns_the_bonds_of_the_chain(forward, chain):
    """A TF has one bond in and one out: the one outside follows the one within."""
    bonds = ["t -> a", "a -> right", "a -> r"] if forward else ["a -> t", "right -> a", "a -> r"]
    nodes = {"t": {"type": "TF", "value": 2}, "a": 1, "r": {"type": "R", "value": 3}}
    model = {"ports": ["t", "right"], "nodes": nodes, "bonds": bonds}
    ends = [["u", f"x.{chain[1]}"], [f"x.{chain[0]}", "end"]]
    along = forward is (chain[0] == "right")
    data = {
        "kind": "bond-graph",
        "models": {"m": model},
        "graph": {
            "nodes": {
                "u": "Se",
                "x": {"model": "m", "repeat": 3, "chain": chain},
                "end": {"type": "R", "value": 1},
            },
            "bonds": [" -> ".join(pair if along else pair[::-1]) for pair in ends],
        },
        "analysis": {"outputs": ["end.e"], "results": ["properties"]},
    }
    result = dynid.run(dynid.scene_from(data))
    n, gain, load = 2 if forward else 1 / 2, 1.0, 1.0  # effort outside the TF over that at a
    for _ in range(3):
        if chain[0] == "right":
            gain, load = gain * load / (load + 3) / n, n**2 * (load + 3)
        else:
            behind = load / n**2
            gain, load = gain * n * behind / (3 + behind), 3 + behind
    assert abs(result.value("bond_graph/properties/end.e/u/dc_gain")) == pytest.approx(gain, rel=1e-12)


LINE = """
dynid: 1
kind: bond-graph
models:
  seg:
    ports: [left, right]
    parameters: {R: 1, C: 1, K: 2*C}
    nodes: {a: 1, r: {type: R, value: R}, b: 0, c: {type: C, value: C}, k: {type: I, value: K}}
    bonds: [left -> a -> b -> right, a -> r, b -> c, b -> k]
graph:
  nodes: {u: Se, line: {model: seg, repeat: 3, chain: [right, left]}, end: {type: R, value: 5}}
  bonds: [u -> line.left, line.right -> end]
analysis: {inputs: [u], outputs: [line.3.c.e], results: [transfer_function]}
"""


def checked(text, *overrides):
    return check_source(apply_overrides(parse_source(text.lstrip("\n"), "scene.yaml"), overrides))


def values(scene, *names):
    nodes = built_graph(scene).graph.nodes
    return [nodes[name].value for name in names]


COPIES = [
    "graph.nodes.line.2.C=3",
    "graph.nodes.line.2={C: 3}",
    "graph.nodes.line.copies.2.C=3",
    "graph.nodes.line.copies={'2': {C: 3}}",
]


@pytest.mark.parametrize("override", COPIES)
def test_a_copy_has_its_value_and_what_depends_on_it(override):
    scene = checked(LINE, override)
    assert values(scene, *(f"line.{k}.c" for k in (1, 2, 3))) == [1, 3, 1]
    assert values(scene, *(f"line.{k}.k" for k in (1, 2, 3))) == [2, 6, 2]
    written = check_source(parse_source(scene.source.resolved_text()))
    assert values(written, "line.2.c", "line.3.c") == [3, 1]
    (formula,) = [attrs["symbolic"] for attrs in dynid.run(scene).group_attrs.values() if "symbolic" in attrs]
    assert "line.2.C" in formula
    assert "line.C" in formula


def test_values_of_the_chain_are_shared_by_copies_without_their_own():
    text = LINE.replace("chain: [right, left]", "chain: [right, left], C: x, copies: {1: {C: 2*x, R: 7}}")
    scene = checked(f"{text}parameters: {{x: 4}}\n", "graph.nodes.line.3.K=1")
    assert values(scene, *(f"line.{k}.{name}" for k in (1, 2, 3) for name in "rck")) == [
        7,
        8,
        16,
        1,
        4,
        8,
        1,
        4,
        1,
    ]


def test_copies_that_all_have_a_value_need_none_in_common():
    text = LINE.replace("R: 1, C: 1", "R: 1, C: null")
    scene = checked(text, *(f"graph.nodes.line.{k}.C={k}" for k in (1, 2, 3)))
    assert values(scene, "line.1.c", "line.2.k", "line.3.k") == [1, 4, 6]
    assert "line.C" not in scene.source.data["parameters"]


def test_a_study_varies_one_copy(tmp_path):
    (tmp_path / "line.yaml").write_text(LINE.lstrip("\n"))
    study = "dynid: 1\nkind: study\nscene: line.yaml\nvary: {graph.nodes.line.2.R: {values: [1, 2, 5]}}\n"
    path = "bond_graph/transfer_function/line.3.c.e/u/denominator"
    run_study(planned(tmp_path, f"{study}collect: [{path}]\n"), tmp_path / "study.h5", SerialExecutor())
    results = dynid.open_result(tmp_path / "study.h5")[f"study/results/{path}"].data
    for resistance, result in zip((1, 2, 5), results, strict=True):
        scene = checked(LINE, f"graph.nodes.line.2.R={resistance}")
        assert values(scene, "line.1.r", "line.2.r", "line.3.r") == [1, resistance, 1]
        assert np.array_equal(result, dynid.run(scene)[path].data)


@pytest.mark.parametrize(
    ("copies", "at", "message"),
    [
        ("{4: {C: 3}}", "{|4:", "there is no copy 4; they count from 1 to 3"),
        ("{0: {C: 3}}", "{|0:", "there is no copy 0; they count from 1 to 3"),
        ("{one: {C: 3}}", "{|one:", "there is no copy one; they count from 1 to 3"),
        ("{2: {Q: 3}}", "{|Q:", "the model 'seg' has no parameter 'Q'; it has R, C, K"),
        ("{2: {C: null}}", "{|C:", "'C' of copy 2 needs a value"),
        ("{2: {C: 3*z}}", "C: |3*z", "no parameter 'z'"),
        ("{2: {C: 3}, '02': {R: 1}}", "|'02':", "there is no copy 02; they count from 1 to 3"),
        (f"{{{'9' * 30}: {{C: 3}}}}", f"{{|{'9' * 30}:", f"there is no copy {'9' * 30}; they count"),
        ("{2: 3}", "|copies:", "'copies' has values of single copies beside 'repeat'"),
        ("[3]", "|copies:", "'copies' has values of single copies beside 'repeat'"),
    ],
)
def test_faults_of_copies_stand_at_their_places(copies, at, message):
    text = LINE.lstrip("\n").replace("left]}, end", f"left], copies: {copies}}}, end")
    with pytest.raises(SceneError) as raised:
        checked(text)
    before, _, after = at.partition("|")
    lines = text.splitlines()
    (line,) = [k for k, one in enumerate(lines) if "copies:" in one]
    column = lines[line].index(before + after, lines[line].index("repeat")) + len(before) + 1
    assert f"scene.yaml:{line + 1}:{column}: {message}" in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "repeat: 3, chain: [right, left]",
            "copies: {1: {C: 3}}",
            "'copies' has values of single copies beside",
        ),
        ("R: 1, C: 1", "R: 1, copies: 1", "'copies' is a key of nodes; use another name"),
        ("b -> right", "right -> b", "power is positive into the model 'seg' at both 'right' and 'left'"),
        (
            "left -> a -> b",
            "a -> b, a -> left, b",
            "power is positive out of the model 'seg' at both 'right'",
        ),
    ],
)
def test_instances_that_cannot_be_copied_are_refused(old, new, message):
    assert old in LINE
    with pytest.raises(SceneError) as raised:
        checked(LINE.replace(old, new).replace("left -> a -> right -> b", "left -> a -> b, right -> b"))
    assert message in str(raised.value)


IDENTIFIED = """
dynid: 1
kind: identification
models:
  stage:
    ports: [left, right]
    parameters: {m: 2, c: 0.01, b: 3}
    nodes: {v: 1, m: {type: I, value: m}, z: 0, s: 1, c: {type: C, value: c}, b: {type: R, value: b}}
    bonds: [right -> z -> v -> left, v -> m, z -> s, s -> c, s -> b]
graph:
  nodes:
    F: Se
    line: {model: stage, repeat: 3, chain: [right, left], copies: {2: {c: {start: 0.02, true: 0.008}}}}
    wall: Sf
  bonds: [line.left -> F, wall -> line.right]
excitation: [{source: F, kind: multisine, amplitude: [1, 1, 1], frequency: [2, 7, 15]}]
measurement:
  {step: 0.005, samples: 600, channels: [{output: line.1.m.f}, {output: line.3.m.f}],
   simulate: {noise_ratio: 0.01, seed: 4}}
"""


def test_an_unknown_of_one_copy_is_identified_and_written_back():
    result = dynid.run(checked(IDENTIFIED))
    assert [str(name) for name in result["identification/parameters/name"].data] == ["line.2.c"]
    (estimate,), (error,) = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "standard_error")
    )
    assert abs(estimate - 0.008) < 4.5 * error
    written = parse_source(identified_scene(result))
    assert written.data["graph"]["nodes"]["line"]["copies"] == {2: {"c": estimate}}
    check_source(written)


def test_the_schema_has_values_of_copies():
    schema = scene_schema(KINDS["bond-graph"].load("model"))
    copies = schema["$defs"]["InstanceModel"]["properties"]["copies"]
    assert "single copies" in copies["description"]
