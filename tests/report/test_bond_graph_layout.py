"""Layout of bond graphs: no overlaps, few crossings, strokes as assigned."""

import json
import random
import xml.etree.ElementTree as ET
from fractions import Fraction
from math import dist
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dynid
from dynid.bondgraph.causality.scap import assign_causality
from dynid.bondgraph.graph import spread_domains
from dynid.report import figures
from dynid.report.drawing.bond_graph import DrawnGraph, drawn_graph, sketch_of
from dynid.report.drawing.layout import lay_out
from dynid.report.svg import path_of
from tests.bondgraph.graphs import ISOLATOR, build, chain, parse, port
from tests.bondgraph.random_graphs import random_graph
from tests.report.geometry import crossings, ends, overlaps

CONFIGS = Path(__file__).parents[2] / "configs"
PUBLISHED = sorted((Path(__file__).parents[2] / "../shared/data/bondgraphs").glob("*.json"))


def question(types, values, bonds, inputs=(), *outputs):
    return DrawnGraph(build(types, values, bonds), tuple(inputs), tuple(map(port, outputs)), None, {})


def assert_readable(asked, most_crossings=0):
    sketch = sketch_of(asked)
    layout = lay_out(sketch)
    assert set(layout.boxes) == set(asked.graph.nodes)
    assert overlaps(sketch, layout) == []
    assert ends(sketch, layout) == []
    assert crossings(sketch, layout) <= most_crossings
    assert_strokes(asked.graph, sketch, layout)
    return layout


def assert_strokes(graph, sketch, layout):
    """Check each stroke as drawn: it is nearer to the end that effort is imposed towards."""
    for bond, link, route in zip(assign_causality(graph).bonds, sketch.bonds, layout.routes, strict=True):
        (x1, y1), (x2, y2) = link.stroke_on(route)
        place = ((x1 + x2) / 2, (y1 + y2) / 2)
        to_tail, to_head = (abs(place[0] - x) + abs(place[1] - y) for x, y in (route[0], route[-1]))
        assert (bond.tail, bond.head) == (link.tail, link.head)
        assert bond.stroke == ("tail" if to_tail < to_head else "head")


@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.stem)
def test_the_published_graphs_are_drawn_without_any_overlap(file):
    graph = json.loads(file.read_text(encoding="utf-8"))
    types = {element["name"]: element["type"] for element in graph["elements"]}
    values = {e["name"]: Fraction(e["value_exact"]) for e in graph["elements"] if e["value_exact"]}
    output = f"{graph['output']['element']}.{graph['output']['kind']}"
    layout = assert_readable(question(types, values, graph["bonds"], graph["inputs"], output))
    assert layout.crossings == 0  # all ten are planar


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**9), st.integers(1, 18), st.sampled_from([0, 0, 1, 2, 3]))
def test_random_graphs_up_to_sixty_nodes_are_readable(seed, junctions, loops):
    types, values, bonds, inputs, (node, quantity) = random_graph(random.Random(seed), junctions, loops)
    if len(types) <= 60:
        asked = question(types, values, bonds, inputs, f"{node}.{quantity}")
        assert_readable(asked, most_crossings=planned_crossings(asked))


def planned_crossings(asked):
    """Return how many crossings the layout admits; none for a tree."""
    return lay_out(sketch_of(asked)).crossings


def test_a_tree_has_no_crossing_and_long_chains_no_limit():
    layout = assert_readable(question(*parse(*chain(8)), ["F"], "v1.f"))
    assert layout.crossings == 0
    assert len(layout.boxes) > 45


@pytest.mark.parametrize(
    ("neighbours", "crossed"),
    [
        ({i: set(range(4)) - {i} for i in range(4)}, 0),
        ({i: {i ^ 1, i ^ 2, i ^ 4} for i in range(8)}, 2),  # a cube, which is planar, but not in columns
        ({i: set(range(5)) - {i} for i in range(5)}, 1),  # K5 and K3,3 (Kuratowski 1930)
        ({i: set(range(3, 6)) if i < 3 else set(range(3)) for i in range(6)}, 1),
        ({i: set(range(6)) - {i} for i in range(6)}, 3),
    ],
)
def test_junctions_that_are_all_in_loops_have_few_crossings(neighbours, crossed):
    types = {f"j{k}": "01"[k % 2] for k in neighbours}
    bonds = [(f"j{a}", f"j{b}") for a, near in neighbours.items() for b in near if a < b]
    layout = assert_readable(question(types, {}, bonds), most_crossings=crossed)
    assert layout.crossings == crossed


def test_a_ring_of_five_junctions_all_tied_crosses_once():
    names = [f"j{i}" for i in range(5)]
    types = {name: "01"[i % 2] for i, name in enumerate(names)} | {"u": "Se", "r": "R"}
    bonds = [("u", "j1"), ("j0", "r")]
    bonds += [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    layout = assert_readable(question(types, {"r": Fraction(1)}, bonds, ["u"], "r.f"), most_crossings=1)
    assert layout.crossings == 1


def test_the_isolator_reads_from_its_source_to_its_mass():
    layout = assert_readable(question(*parse(*ISOLATOR), ["v_in"], "m_s.f"))
    row = [layout.boxes[name].centre for name in ("v_in", "base", "body", "m_s")]
    assert [x for x, _ in row] == sorted(x for x, _ in row)
    assert len({round(y, 6) for _, y in row}) == 1


@pytest.fixture(scope="module")
def isolator():
    return dynid.run(dynid.load_scene(CONFIGS / "isolator_port.yaml"))


@pytest.mark.thorough
def test_a_result_is_drawn_from_its_own_scene(isolator, tmp_path):
    from dynid.store import write_result

    write_result(isolator, tmp_path / "r.h5")
    drawn, again = (
        {f.name: f.svg for f in figures(r)} for r in (isolator, dynid.open_result(tmp_path / "r.h5"))
    )
    assert drawn == again
    texts = [element.text for element in ET.fromstring(drawn["bond-graph"]).findall(".//{*}text")]
    assert {
        "TF : tuning",
        "n = 0.01",
        "20\N{NARROW NO-BREAK SPACE}000 kg/m⁴",
        "10⁻⁸ m³/Pa",
        "input",
        "output f",
    } <= set(texts)
    assert {"source", "load", "hydraulic"} <= set(texts)


def test_the_cut_parts_the_spine_between_source_and_output(isolator):
    sketch = sketch_of(drawn_graph(isolator))
    boxes = lay_out(sketch).boxes
    assert sketch.cut == ("base", "body")
    row = [boxes[name].centre for name in ("v_in", "base", "body", "m_s")]
    assert [x for x, _ in row] == sorted(x for x, _ in row)
    assert len({round(y, 6) for _, y in row}) == 1


@pytest.mark.parametrize(
    ("scene", "signals"),
    [
        ("isolator_controlled.yaml", {("body", "p_a")}),
        ("servo_orifices.yaml", {("signal", f"{way}_{side}") for way in ("in", "out") for side in "ab"}),
    ],
)
def test_signals_have_a_full_arrow_and_bonds_a_half_arrow(scene, signals):
    result = dynid.run(dynid.load_scene(CONFIGS / scene, ["analysis.results=[poles]"]))
    sketch = sketch_of(drawn_graph(result))
    layout = lay_out(sketch)
    assert overlaps(sketch, layout) == []
    (svg,) = (figure.svg for figure in figures(result) if figure.name == "bond-graph")
    found = set()
    for bond, route in zip(sketch.bonds, layout.routes, strict=True):
        *barbs, tip = sorted(bond.arrow_on(route), key=lambda at, end=route[-1]: -dist(at, end))
        assert all(dist(barb, route[-2]) < dist(tip, route[-2]) for barb in barbs)  # it points to the head
        assert len({round(dist(barb, tip), 6) for barb in barbs}) == 1
        if len(barbs) == 2:
            found.add((bond.tail, bond.head))
            assert f'class="bond" d="{path_of([barbs[0], tip, barbs[1]])}"' in svg
    assert found == signals


def test_a_domain_spreads_through_bonds_and_stops_at_a_transformer(isolator):
    asked = drawn_graph(isolator)
    assert {name for name, domain in asked.domains.items() if domain == "hydraulic"} == {
        "fluid",
        "I_f",
        "C_a",
    }
    assert {asked.domains[name] for name in ("v_in", "base", "body", "b")} == {"mechanical"}
    assert "tuning" not in asked.domains
    both = spread_domains(asked.graph, {"fluid": "hydraulic", "b": "hydraulic"})
    assert both["tuning"] == "hydraulic"
    assert spread_domains(asked.graph, {"fluid": "hydraulic", "b": "mechanical"})["v_in"] == "mechanical"


def test_a_result_without_its_scene_has_no_drawing_of_it():
    from dynid.result import Result

    assert figures(Result("bond-graph")) == []
    assert figures(Result("identification")) == []
