"""Random nested models in files, chains and structures, against a flattening written here, exactly."""

import itertools
import random
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
import yaml

import dynid
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular
from dynid.scene.kinds.bond_graph import built_graph
from dynid.scene.load import load_scene
from tests.bondgraph.graphs import at, transfers
from tests.bondgraph.tableau import transfers_at

BEAM = {
    "type": "structure",
    "structure": {
        "beam": {"elements": 2, "length": 1, "EI": "EI", "rhoA": 2, "supports": [{"node": 1, "fix": ["w"]}]}
    },
    "ports": {"hub": "theta_1", "tip": "w_3"},
}


class Line:
    """A model whose parts stand in a row between its ports: `parts` are (name, what, …)."""

    def __init__(self, rng, name, inner, *, beams):
        self.name, self.parts = name, []
        self.parameters = {"a": rng.randint(1, 9), "b": f"a + {rng.randint(1, 4)}", "c": None}
        kinds = ["0", "1", "0", "1", "TF", "GY", *("model" for _ in inner), *("model" for _ in inner)]
        for k in range(rng.randint(2, 4)):
            kind = rng.choice(kinds)
            if kind == "model":
                given = {"c": _expression(rng)} | ({"a": _expression(rng)} if rng.random() < 0.5 else {})
                count = rng.choice([None, None, 1, 3])
                self.parts.append((f"i{k}", kind, rng.choice(inner), given, count))
            elif kind in ("TF", "GY"):
                self.parts.append((f"t{k}", kind, _expression(rng)))
                self.parts.append((f"x{k}", rng.choice("01"), []))
            else:
                legs = [(f"e{k}{n}", rng.choice("RIC"), _expression(rng)) for n in range(rng.randint(1, 2))]
                self.parts.append((f"j{k}", kind, legs))
        self.parts.append(("end", "0", [("leak", "R", _expression(rng))]))
        if beams:
            self.parts.insert(1, ("beam", "structure"))
        # a port may be the junction at the end itself, or an end of a bond that is no node
        self.left = self.parts[0][0] if self.parts[0][1] in ("0", "1") and rng.random() < 0.5 else "in"
        self.right = rng.choice(["end", "out"])

    def written(self):
        nodes, bonds, row = {}, [], [] if self.left != "in" else ["in"]
        for name, kind, *rest in self.parts:
            if kind == "model":
                model, given, count = rest
                nodes[name] = {"model": model.name, **given}
                if count is not None:
                    nodes[name] |= {"repeat": count, "chain": [model.right, model.left]}
                    if count == 1:
                        nodes[name].pop("chain")
                inside = f"{name}.1" if count == 1 else name
                row += [f"{inside}.{model.left}", None, f"{inside}.{model.right}"]
            elif kind == "structure":
                nodes[name] = {**BEAM, "structure": {"beam": {**BEAM["structure"]["beam"], "EI": "b"}}}
                row += [f"{name}.hub", None, f"{name}.tip"]
            else:
                nodes[name] = {"type": kind} | ({"value": rest[0]} if kind in ("TF", "GY") else {})
                row.append(name)
                for leg, own, value in rest[0] if kind in ("0", "1") else ():
                    nodes[leg] = {"type": own, "value": value}
                    bonds.append(f"{name} -> {leg}")
        row += ["out"] if self.right == "out" else []
        bonds += [f"{tail} -> {head}" for tail, head in itertools.pairwise(row) if tail and head]
        return {
            "ports": [self.left, self.right],
            "parameters": self.parameters,
            "nodes": nodes,
            "bonds": bonds,
        }

    def flat(self, prefix, given):
        """Return the nodes {name: (type, value)} and bonds within, and the first and last end of its row."""
        scope = {}
        for key, usual in self.parameters.items():
            scope[key] = given.get(key, usual if not isinstance(usual, str) else _value(usual, scope))
        nodes, bonds, ends = {}, [], []
        for name, kind, *rest in self.parts:
            own = f"{prefix}{name}"
            if kind == "model":
                model, passed, count = rest
                values = {key: _value(text, scope) for key, text in passed.items()}
                copies = [own] if count is None else [f"{own}.{k}" for k in range(1, count + 1)]
                for copy in copies:
                    inner, inner_bonds, first, last = model.flat(f"{copy}.", values)
                    nodes |= inner
                    bonds += inner_bonds
                    ends.append((first, last))
            elif kind == "structure":
                nodes[own] = (kind, scope["b"])
                ends.append((f"{own}.hub", f"{own}.tip"))
            else:
                nodes[own] = (kind, _value(rest[0], scope) if kind in ("TF", "GY") else None)
                ends.append((own, own))
                for leg, leg_kind, value in rest[0] if kind in ("0", "1") else ():
                    nodes[f"{prefix}{leg}"] = (leg_kind, _value(value, scope))
                    bonds.append((own, f"{prefix}{leg}"))
        bonds += [(one[1], other[0]) for one, other in itertools.pairwise(ends)]
        return nodes, bonds, ends[0][0], ends[-1][1]


def _expression(rng):
    one, other = rng.choice("abc"), rng.choice("abc")
    return rng.choice([f"{one}/{rng.randint(2, 5)}", f"{one} + {other}/3", f"{rng.randint(1, 9)}*{one}", one])


def _value(text, scope):
    return Fraction(eval(text, {}, {key: Fraction(value) for key, value in scope.items()}))


def nested(seed, folder, *, beams=False):
    """Write a scene with its models in files that use each other; return it, and the flat graph."""
    rng = random.Random(seed)
    models, files = [], []
    for level in range(rng.randint(2, 4)):
        model = Line(rng, f"line{level}", models, beams=beams and level == 0)
        models.append(model)
        file = {"use": files[-1]} if files else {}
        files.append(f"level{level}.yaml")
        (folder / files[-1]).write_text(yaml.safe_dump(file | {"models": {model.name: model.written()}}))
    top = models[-1]
    nodes = {
        "u": rng.choice(["Se", "Sf"]),
        "m": {"model": top.name, "c": "g/2"},
        "load": {"type": "R", "value": 3},
    }
    graph = {"nodes": nodes, "bonds": [f"u -> m.{top.left}", f"m.{top.right} -> load"]}
    flat, bonds, first, last = top.flat("m.", {"c": Fraction(5, 2)})
    flat = {"u": (nodes["u"], None), **flat, "load": ("R", Fraction(3))}
    elements = [name for name, (kind, _) in flat.items() if kind in ("R", "I", "C")]
    outputs = [f"{name}.{rng.choice('ef')}" for name in rng.sample(elements, min(2, len(elements)))]
    scene = {"kind": "bond-graph", "use": files[-1], "parameters": {"g": 5}, "graph": graph}
    scene["analysis"] = {
        "outputs": outputs,
        "engine": "exact",
        "results": ["transfer_function", "zeros", "poles"],
    }
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump({"dynid": 1, **scene}))
    return path, flat, [("u", first), *bonds, (last, "load")], outputs


def check(seed, folder):
    """Compare nodes and bonds, and the transfer functions with the tableau of the flat graph."""
    path, flat, bonds, outputs = nested(seed, folder)
    built = built_graph(load_scene(path))
    graph = built.graph
    assert {name: (node.type, node.value) for name, node in graph.nodes.items()} == flat
    assert Counter(map(tuple, graph.bonds)) == Counter(bonds)
    types = {name: kind for name, (kind, _) in flat.items()}
    values = {name: value for name, (_, value) in flat.items() if value is not None}
    pairs = [tuple(output.rsplit(".", 1)) for output in outputs]
    s = Fraction(7, 5)
    expected = transfers_at(types, values, bonds, ["u"], pairs, s) if len(flat) < 60 else None
    try:
        found = transfers(ReducedGraph(graph, ["u"], built.outputs))
    except Singular:
        assert expected is None
        return False
    if expected is None:
        return False
    assert {pair: at(function, s) for pair, function in found.items()} == expected
    return True


@pytest.mark.thorough
def test_random_nested_models_are_their_flat_graphs(tmp_path):
    assert sum(check(seed, tmp_path) for seed in range(30)) > 15


@pytest.mark.slow
def test_three_hundred_nested_models_are_their_flat_graphs(tmp_path):
    assert sum(check(seed, tmp_path) for seed in range(30, 330)) > 150


def beamed(seed, folder):
    """Compare the results of nested models with structures inside with those of the flat scene."""
    path, flat, bonds, outputs = nested(seed, folder, beams=True)
    if sum(kind == "structure" for kind, _ in flat.values()) > 2:
        return False
    nodes = {}
    for name, (kind, value) in flat.items():
        nodes[name.replace(".", "_")] = {"type": kind} | ({} if value is None else {"value": str(value)})
        if kind == "structure":
            beam = {**BEAM["structure"]["beam"], "EI": str(value)}
            nodes[name.replace(".", "_")] = {**BEAM, "structure": {"beam": beam}}

    def plain(end):
        owner, _, port = end.rpartition(".")
        return (
            f"{owner.replace('.', '_')}.{port}"
            if flat.get(owner, ("",))[0] == "structure"
            else end.replace(".", "_")
        )

    names = [f"{output.rsplit('.', 1)[0].replace('.', '_')}.{output[-1]}" for output in outputs]
    scene = {
        "kind": "bond-graph",
        "graph": {"nodes": nodes, "bonds": [f"{plain(tail)} -> {plain(head)}" for tail, head in bonds]},
        "analysis": {"outputs": names, "engine": "exact", "results": ["transfer_function", "zeros", "poles"]},
    }
    try:
        expected = dynid.run(dynid.scene_from(scene))
    except Singular:
        with pytest.raises(Singular):
            dynid.run(load_scene(path))
        return False
    found = dynid.run(load_scene(path))
    for own, other in zip(outputs, names, strict=True):
        for part in ("numerator", "denominator", "zeros", "poles"):
            one = found[f"bond_graph/transfer_function/{own}/u/{part}"].data
            np.testing.assert_array_equal(
                one, expected[f"bond_graph/transfer_function/{other}/u/{part}"].data
            )
    return True


def test_structures_within_nested_models_are_those_of_the_flat_graph(tmp_path):
    assert sum(beamed(seed, tmp_path) for seed in (0, 2, 3)) > 1


@pytest.mark.slow
def test_many_structures_within_nested_models_are_those_of_the_flat_graph(tmp_path):
    assert sum(beamed(seed, tmp_path) for seed in range(4, 80)) > 20
