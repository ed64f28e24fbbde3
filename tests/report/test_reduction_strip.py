"""Reduction strips and prototypes: the figures 1, 2 and 6 to 8 of Park & Kim."""

import json
import random
import re
import xml.etree.ElementTree as ET
from fractions import Fraction
from pathlib import Path

import pytest

import dynid
from dynid.errors import Singular
from dynid.report import figures
from dynid.report.drawing.bond_graph import DrawnGraph, reduction_strip
from dynid.report.drawing.layout import lay_out
from dynid.report.drawing.prototype import prototype_picture, prototype_sketch
from tests.bondgraph.graphs import ISOLATOR, build, parse, port, reduced
from tests.bondgraph.random_graphs import random_graph
from tests.report.geometry import crossings, ends, overlaps

CONFIGS = Path(__file__).parents[2] / "configs"
PUBLISHED = sorted((Path(__file__).parents[2] / "../shared/data/bondgraphs").glob("*.json"))


def strip(types, values, bonds, inputs, output):
    return reduction_strip(
        DrawnGraph(build(types, values, bonds), tuple(inputs), (port(output),), None, {}), port(output)
    )


def assert_readable(sketches):
    for sketch in sketches:
        layout = lay_out(sketch)
        assert overlaps(sketch, layout) == []
        assert ends(sketch, layout) == []
        assert crossings(sketch, layout) <= layout.crossings


@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.stem)
def test_every_step_of_the_published_graphs_is_readable(file):
    graph = json.loads(file.read_text(encoding="utf-8"))
    types = {element["name"]: element["type"] for element in graph["elements"]}
    values = {e["name"]: Fraction(e["value_exact"]) for e in graph["elements"] if e["value_exact"]}
    output = f"{graph['output']['element']}.{graph['output']['kind']}"
    assert_readable(strip(types, values, graph["bonds"], graph["inputs"], output))


@pytest.mark.thorough
def test_every_step_of_random_graphs_is_readable():
    drawn = 0
    for seed in range(12):
        types, values, bonds, inputs, (node, quantity) = random_graph(random.Random(seed), 6, seed % 4)
        try:
            sketches = strip(types, values, bonds, inputs, f"{node}.{quantity}")
        except Singular:
            continue
        assert_readable(sketches)
        drawn += len(sketches)
    assert drawn > 30


def test_the_isolators_strip_is_that_of_the_paper():
    types, values, bonds = parse(*ISOLATOR)
    sketches = strip(types, values, bonds, ["v_in"], "m_s.f")
    shown = [{vertex.lines[0].text for vertex in sketch.nodes} for sketch in sketches]
    assert {"TF : tuning", "I : I_f", "C : C_a"} <= shown[0]  # Fig. 6(b)
    assert shown[2] == {"Sf : v_in", "0", "1", "Z_tuning", "I : m_s", "R : b"}  # Fig. 7
    assert shown[3] == {"Se : e_eq_base", "1", "Z_tuning", "I : m_s", "R : b"}  # Fig. 8(a)
    assert shown[5] == {"Se : e_eq_base", "1", "Z_A", "I : m_s"}  # Fig. 8(b)
    changed = [{v.lines[0].text for v in sketch.nodes if v.changed} for sketch in sketches]
    assert changed[:4] == [set(), {"Z_fluid"}, {"Z_tuning"}, {"Se : e_eq_base", "Z_tuning"}]


def test_a_swapped_junction_is_drawn_before_it_merges():
    types, values, bonds = parse(*ISOLATOR)
    swapped, merged = strip(types, values, bonds, ["v_in"], "m_s.f")[3:5]
    junctions = [[v.lines[1].text for v in s.nodes if v.lines[0].text == "1"] for s in (swapped, merged)]
    assert sorted(junctions[0]) == ["base", "body"]
    assert junctions[1] == ["body"]
    ends = {(link.tail, link.head) for link in swapped.bonds}
    assert {("base", "body"), ("base", "base/Z_tuning"), ("e_eq_base", "base"), ("body", "b")} <= ends
    assert [v.key for v in merged.nodes if v.changed] == ["body"]


def test_labels_of_what_steps_made_agree_with_their_strokes_and_no_graph_is_drawn_twice_for_a_swap():
    """A stroke at the junction: the effort is the answer, an impedance; at the element: an admittance."""
    judged = swaps = 0
    for seed in range(60):
        types, values, bonds, inputs, (node, quantity) = random_graph(random.Random(seed), 6, 0)
        try:
            question = DrawnGraph(
                build(types, values, bonds), tuple(inputs), (port(f"{node}.{quantity}"),), None, {}
            )
            sketches = reduction_strip(question, port(f"{node}.{quantity}"))
            (reduction,) = reduced(types, values, bonds, inputs, f"{node}.{quantity}").reductions.values()
        except Singular:
            continue
        for sketch in sketches[1:]:
            notes = {v.key: v.lines[1].text for v in sketch.nodes if len(v.lines) > 1}
            for link in sketch.bonds:
                if notes.get(link.head) in ("impedance", "admittance") and link.stroke:
                    judged += 1
                    assert (notes[link.head] == "impedance") is (link.stroke == "tail"), (seed, link)
        rules = [step.rule for step in reduction.steps]
        for place in range(len(rules) - 1):
            if rules[place : place + 2] == ["source swap", "merge"]:
                swaps += 1
                counts = [
                    sum(v.lines[0].text in "01" for v in s.nodes) for s in sketches[place + 1 : place + 3]
                ]
                assert counts[0] > counts[1], seed
    assert judged > 50
    assert swaps > 5


def test_the_strokes_that_are_left_are_those_of_the_prototype():
    types, values, bonds = parse(*ISOLATOR)
    last = strip(types, values, bonds, ["v_in"], "m_s.f")[-1]
    kinds = {vertex.key: vertex.lines[0].text for vertex in last.nodes}
    found = {(kinds[link.tail], kinds[link.head]): link.stroke for link in last.bonds}
    expected = {("Se : e_eq_base", "1"): "head", ("1", "Z_A"): "tail", ("1", "I : m_s"): "head"}
    assert found == expected


#: The ends of strokes at source, A and B that Fig. 2 shows: which variable each part is given.
FIG_2 = {"a": ("f", "f", "f"), "b": ("e", "e", "e"), "c": ("f", "e", "f"), "d": ("e", "f", "e")}


@pytest.mark.parametrize("letter", "abcd")
def test_a_prototype_has_the_strokes_of_fig_2(letter):
    sketch = prototype_sketch(letter)
    source, a, b = sketch.bonds
    gives = "e" if source.stroke == "head" else "f"  # a source gives effort towards the stroke
    given = [
        "e" if link.stroke == "head" else "f" for link in (a, b)
    ]  # a system is given effort at its stroke
    assert (gives, *given) == FIG_2[letter]
    names = {vertex.key: vertex.lines[0].text for vertex in sketch.nodes}
    for key, effort in zip("AB", given, strict=True):
        assert names[key][0] == ("Y" if effort == "e" else "Z")
    layout = lay_out(sketch)
    assert overlaps(sketch, layout) == []


@pytest.mark.parametrize(("letter", "signs"), [("a", "++"), ("b", "++"), ("c", "+−"), ("d", "+−")])
def test_a_prototype_stands_beside_its_block_diagram(letter, signs):
    picture = prototype_picture("p", letter, ["Z = 1", "Z_{A} = b", "Y_{B} = c"], "here")
    texts = [element.text for element in ET.fromstring(picture.svg).findall(".//{*}text")]
    assert "".join(text for text in texts if text in "+−") == signs
    assert picture.table.rows == ((letter, "Z = 1", "Z_{A} = b", "Y_{B} = c"),)


def test_a_result_has_all_its_drawings_and_they_are_the_same_each_time():
    result = dynid.run(CONFIGS / "isolator_port.yaml")
    result.merge(_reduction())
    names = [figure.name for figure in figures(result)]
    assert {"bond-graph", "reduction-m_s.f", "prototype-m_s.f", "prototype-port"} <= set(names)
    for one, other in zip(figures(result), figures(result), strict=True):
        if one.name in ("bond-graph", "reduction-m_s.f", "prototype-m_s.f", "prototype-port"):
            assert one.svg == other.svg
            ids = re.findall(r' id="([^"]*)"', one.svg)
            assert len(ids) == len(set(ids))
            assert one.caption
            assert one.table.rows


def _reduction():
    whole = dynid.run(dynid.load_scene(CONFIGS / "isolator_port.yaml", ["analysis.results=[reduction]"]))
    part = dynid.result.Result(whole.kind)
    for path in ("bond_graph/reduction/steps", "bond_graph/reduction/step"):
        part.add(path, whole[path].data, whole[path].dims)
    return part
