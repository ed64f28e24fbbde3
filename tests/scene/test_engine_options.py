"""Scenes that name an engine, a reading or formulas, and what is refused of them."""

import math

import pytest

import dynid
from dynid.errors import NumericalError, SceneError, UsageError
from dynid.scene.kind import KINDS
from dynid.scene.load import check_source, load_scene
from dynid.scene.schema.json_schema import scene_schema
from dynid.scene.yaml.source import parse_source
from dynid.templates.chain import chain_scene

SCENE = """\
dynid: 1
kind: bond-graph
parameters: {a: 0.1, b: 0.2, c: -0.3}
graph:
  nodes: {u: Se, j: 1, m: {type: I, value: 1}, r: {type: R, value: a}, q: {type: R, value: b},
    w: {type: R, value: c}}
  bonds: [u -> j -> m, j -> r, j -> q, j -> w]
analysis:
  outputs: [m.f]
"""


def scene(tmp_path, *lines):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE + "".join(f"  {line}\n" for line in lines), encoding="utf-8")
    return path


def faults(*lines):
    with pytest.raises(SceneError) as caught:
        check_source(parse_source(SCENE + "".join(f"  {line}\n" for line in lines), "scene.yaml"))
    return [str(fault) for fault in caught.value.faults]


def test_a_scene_says_how_its_numbers_are_read(tmp_path):
    results = {
        reading: dynid.run(scene(tmp_path, f"reading: {reading}", "results: [poles, properties]"))
        for reading in ("decimal", "binary")
    }
    for reading, stable in (("decimal", False), ("binary", True)):
        assert results[reading].value("bond_graph/properties/m.f/u/stable") is stable
        assert results[reading].group_attrs["bond_graph"]["reading"] == reading
        assert results[reading].group_attrs["bond_graph/transfer_function/m.f/u"]["reading"] == reading


@pytest.mark.parametrize("engine", ["exact", "float"])
def test_a_scene_names_its_engine(tmp_path, engine):
    result = dynid.run(scene(tmp_path, f"engine: {engine}"))
    assert result.group_attrs["bond_graph"]["engine"] == engine
    assert result.value("bond_graph/transfer_function/m.f/u/poles").tolist() == [0]


def test_the_symbolic_engine_leaves_the_usual_numbers_out(tmp_path):
    result = dynid.run(scene(tmp_path, "engine: symbolic"))
    assert not [path for path in result if "/properties/" in path or path.endswith(("zeros", "poles"))]
    assert result.value("bond_graph/transfer_function/m.f/u/program").splitlines()[-1].startswith("T = ")


def test_formulas_longer_than_an_attribute_are_stored(tmp_path):
    stages = 7
    nodes = "u: Se" + "".join(
        f", v{k}: 1, e{k}: 0, w{k}: 1, m{k}: {{type: I, value: 1}}, "
        f"c{k}: {{type: C, value: 1}}, b{k}: {{type: R, value: 1}}"
        for k in range(stages)
    )
    bonds = "u -> v0" + "".join(
        f", v{k} -> m{k}, v{k} -> e{k} -> w{k} -> c{k}, w{k} -> b{k}" for k in range(stages)
    )
    bonds += "".join(f", e{k} -> v{k + 1}" for k in range(stages - 1))
    path = tmp_path / "long.yaml"
    path.write_text(
        f"dynid: 1\nkind: bond-graph\ngraph:\n  nodes: {{{nodes}}}\n  bonds: [{bonds}]\n"
        "analysis: {outputs: [v6.f], results: [transfer_function], symbolic: {form: expanded}}\n",
        encoding="utf-8",
    )
    result = dynid.run(path)
    group = "bond_graph/transfer_function/v6.f/u"
    text = result.value(f"{group}/symbolic_denominator")
    assert len(text) > 64 * 1024
    assert text.count("+") + 1 == result[f"{group}/symbolic_denominator"].attrs["terms"] == 10_923


def test_a_guard_that_is_hit_is_found_in_the_scene(tmp_path):
    path = scene(tmp_path, "symbolic: {form: expanded, terms: 2}")
    loaded = load_scene(path)
    with pytest.raises(NumericalError, match="more than 2 terms") as caught:
        dynid.run(loaded)
    assert str(loaded.locate(caught.value)).startswith(f"{path}:10:")


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        (["engine: exactly"], "scene.yaml:10:11: 'engine' cannot be 'exactly'"),
        (["reading: hex"], "scene.yaml:10:12: 'reading' cannot be 'hex'"),
        (
            ["engine: symbolic", "results: [transfer_function, poles]"],
            "scene.yaml:11:32: 'poles' needs numbers",
        ),
        (
            ["symbolic: {form: nested}", "results: [poles]"],
            "scene.yaml:10:3: formulas are of the transfer function",
        ),
        (["symbolic: {form: flat}"], "scene.yaml:10:20: 'form' cannot be 'flat'"),
        (["symbolic: {terms: 0}"], "scene.yaml:10:21: "),
        (
            ["symbolic: {term: 10}"],
            "scene.yaml:10:14: 'term' is not a key of analysis.symbolic; did you mean 'terms'?",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_at_its_place(lines, fault):
    (found,) = faults(*lines)
    assert found.startswith(fault)


def test_the_schema_knows_the_choices():
    definitions = scene_schema(KINDS["bond-graph"].load("model"))["$defs"]
    analysis = definitions["AnalysisModel"]["properties"]
    assert analysis["engine"]["enum"] == ["auto", "exact", "float", "symbolic"]
    assert analysis["reading"]["enum"] == ["decimal", "binary"]
    assert definitions["SymbolicModel"]["properties"]["form"]["enum"] == ["nested", "expanded"]


def test_sensitivities_of_a_large_graph_are_refused_unless_insisted_on(tmp_path):
    path = tmp_path / "chain.yaml"
    asked = "[transfer_function, zeros, poles, frequency_response]"
    path.write_text(chain_scene(51, vary=True).replace(asked, "[sensitivities]"), encoding="utf-8")
    with pytest.raises(UsageError, match=r"sensitivities of a graph of 102 storage elements") as refused:
        dynid.run(path)
    assert "chain.yaml:" in str(load_scene(path).locate(refused.value))


def test_the_dynamics_of_a_large_prototype_are_left_out_and_it_says_so(tmp_path):
    path = tmp_path / "chain.yaml"
    asked = "[transfer_function, zeros, poles, frequency_response]"
    path.write_text(chain_scene(80, vary=True).replace(asked, "[prototype]"), encoding="utf-8")
    result = dynid.run(path)
    assert result.value("bond_graph/reduction/prototype") in ("c", "d")
    note = result.group_attrs["bond_graph/reduction"]["dynamics"]
    assert note.startswith("not formed: 160 storage elements")


@pytest.mark.parametrize(("m", "c"), [("2", "1/3"), ("0.3", "0.7"), ("5", "7e-12"), ("0.001", "13")])
def test_critical_damping_by_an_irrational_resistance_is_a_double_pole_of_the_float_engine(m, c):
    nodes = {"u": "Se", "j": 1, "m": {"type": "I", "value": m}, "c": {"type": "C", "value": c}}
    nodes["b"] = {"type": "R", "value": f"2*sqrt({m}/({c}))"}
    graph = {"nodes": nodes, "bonds": ["u -> j", "j -> m", "j -> c", "j -> b"]}
    analysis = {"outputs": ["c.e"], "engine": "float", "results": ["poles", "properties"]}
    result = dynid.run(dynid.scene_from({"kind": "bond-graph", "graph": graph, "analysis": analysis}))
    poles = result["bond_graph/transfer_function/c.e/u/poles"].data
    assert poles.tolist() == [poles[0]] * 2
    assert poles[0] == pytest.approx(-math.sqrt(1 / (eval(m) * eval(c))), rel=1e-14)
    assert result.value("bond_graph/properties/c.e/u/stable") is True
