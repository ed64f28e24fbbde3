"""Drawings of graphs with sub-models: boxes, what is in them, and what is around."""

from itertools import pairwise

import pytest

from dynid.report.drawing.sketch import Sketch, SketchBond, SketchNode, TextLine, folded, instances

NAMES = ["V", "m.a", "m.b", "line.1.a", "line.1.b", "line.2.a", "line.2.b", "end"]


def sketch(role="", **more):
    nodes = tuple(SketchNode(name, (TextLine(name),), role=role if name == "m.b" else "") for name in NAMES)
    bonds = tuple(SketchBond(a, b, "head") for a, b in pairwise(NAMES))
    return Sketch(nodes, bonds, "V", "end", **more)


def keys(drawing):
    return {node.key for node in drawing.nodes}


def ends(drawing):
    return [(bond.tail, bond.head) for bond in drawing.bonds]


def test_an_instance_is_yielded_after_the_one_around_it_and_one_copy_of_many():
    assert list(instances(NAMES)) == ["line", "line.1", "m"]


@pytest.mark.parametrize(
    ("within", "nodes", "bonds"),
    [
        ("", {"V", "m", "line", "end"}, [("V", "m"), ("m", "line"), ("line", "end")]),
        ("m", {"V", "m.a", "m.b", "line"}, [("V", "m.a"), ("m.a", "m.b"), ("m.b", "line")]),
        (
            "line",
            {"m", "line.1", "line.2", "end"},
            [("m", "line.1"), ("line.1", "line.2"), ("line.2", "end")],
        ),
        (
            "line.1",
            {"m", "line.1.a", "line.1.b", "line.2"},
            [("m", "line.1.a"), ("line.1.a", "line.1.b"), ("line.1.b", "line.2")],
        ),
    ],
)
def test_a_level_shows_its_nodes_and_its_neighbours(within, nodes, bonds):
    drawing = folded(sketch(), within)
    assert keys(drawing) == nodes
    assert ends(drawing) == bonds
    assert all(bond.stroke == "head" for bond in drawing.bonds)


def test_a_box_says_how_much_is_in_it_and_leads_there():
    (box,) = [node for node in folded(sketch()).nodes if node.key == "line"]
    assert [line.text for line in box.lines] == ["line", "4 nodes"]
    assert box.opens == "inside-line"


def test_a_box_is_an_output_where_something_in_it_is():
    roles = {node.key: node.role for node in folded(sketch("output")).nodes}
    assert roles == {"V": "", "m": "output", "line": "", "end": ""}


def test_a_cut_within_a_box_is_not_drawn_around_it():
    assert folded(sketch(cut=("m.a", "m.b"))).cut is None
    assert folded(sketch(cut=("m.a", "m.b")), "m").cut == ("m.a", "m.b")
    assert folded(sketch(cut=("m.b", "line.1.a"))).cut == ("m", "line")
