"""Plans by the library: the same programs as those that Python writes, and graphs that it refuses."""

from __future__ import annotations

import random
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from dynid.bench.cases.chain import exact_response, reduced
from dynid.bench.cases.frequency_response import ladder
from dynid.bondgraph import reduced_graph
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular
from dynid.native import VARIABLE, found
from tests.sample import sample

pytestmark = pytest.mark.skipif(found() is None, reason="installed without the library")


def both(monkeypatch, graph, inputs, outputs):
    """Return the plan by the library, and that by Python."""
    monkeypatch.setattr(reduced_graph, "LARGE_GRAPHS", replace(reduced_graph.LARGE_GRAPHS, value=0))
    plans = []
    for wish in ("1", "0"):
        monkeypatch.setenv(VARIABLE, wish)
        plans.append(ReducedGraph(graph, inputs, outputs, traced=False))
    assert type(plans[0].program).__name__ == "CompiledProgram"
    return plans


def random_graph(seed):
    """Return a graph of junctions with elements, bonds, two-ports in series and loops, and its source."""
    draw = random.Random(seed)
    names = [f"j{k}" for k in range(draw.randrange(2, 14))]
    nodes = [Node(name, draw.choice("01")) for name in names]
    bonds = []

    def value():
        return Fraction(draw.randrange(1, 9), draw.randrange(1, 9))

    def tie(a, b):
        between = [f"t{len(bonds)}_{k}" for k in range(draw.choice((0, 0, 1, 2)))]
        nodes.extend(Node(name, draw.choice(("TF", "GY")), value()) for name in between)
        way = [a, *between, b][:: draw.choice((1, -1))]
        bonds.extend(map(Bond, way, way[1:]))

    for k in range(1, len(names)):
        tie(names[draw.randrange(k)], names[k])
    for _ in range(draw.randrange(3)):
        tie(*draw.sample(names, 2))
    for name in names:
        for k in range(draw.choice((1, 1, 2))):
            nodes.append(Node(f"{name}e{k}", draw.choice("ICR"), value()))
            bonds.append(Bond(*(name, f"{name}e{k}")[:: draw.choice((1, -1))]))
    nodes.append(Node("u", draw.choice(("Se", "Sf"))))
    bonds.append(Bond("u", draw.choice(names)))
    draw.shuffle(nodes)
    return BondGraph(nodes, bonds), ["u"], [Port(f"{draw.choice(names)}e0", q) for q in "ef"]


@pytest.mark.parametrize("seed", range(12))
def test_what_is_modelled_is_that_of_python(monkeypatch, seed):
    """On trees: a source fixes each second junction, beside the one that drives."""
    draw = random.Random(seed)
    names = [f"j{k}" for k in range(12)]
    nodes = [Node("u", "Se"), Node("v", "Se"), *(Node(name, draw.choice("01")) for name in names)]
    bonds = [Bond("u", "j0"), Bond("v", "j7")]
    bonds += [Bond(names[draw.randrange(k)], names[k]) for k in range(1, 12)]
    for name in names:
        nodes += [Node(f"{name}r", "R", Fraction(2)), Node(f"{name}s", draw.choice("IC"), Fraction(3))]
        bonds += [Bond(name, f"{name}r"), Bond(name, f"{name}s")]
    ports = [Port(f"{name}r", "e") for name in ("j1", "j11")]
    try:
        by_library, by_python = both(monkeypatch, BondGraph(nodes, bonds), ["u", "v"], ports)
    except Singular:
        return
    for port in ports:
        assert by_library.reductions[port].modelled == by_python.reductions[port].modelled
        assert by_library.dropped(port) == by_python.dropped(port)


@pytest.mark.parametrize("block", sample(range(4), 2))
def test_the_library_writes_the_same_program(monkeypatch, block):
    """Over random graphs: operations, pivots, what is left at the root, and what the output depends on."""
    monkeypatch.setattr(reduced_graph, "LARGE_GRAPHS", replace(reduced_graph.LARGE_GRAPHS, value=0))
    compiled = 0
    for seed in range(40 * block, 40 * block + 40):
        plans = []
        for wish in ("1", "0"):
            monkeypatch.setenv(VARIABLE, wish)
            try:
                plans.append(ReducedGraph(*random_graph(seed), traced=False))
            except Singular as error:
                plans.append(str(error))
        one, other = plans
        if isinstance(one, str) or isinstance(other, str):
            assert one == other
            continue
        compiled += type(one.program).__name__ == "CompiledProgram"
        assert one.channels() == other.channels()
        assert one.program.ops == other.program.ops
        for port, mine in one.reductions.items():
            theirs = other.reductions[port]
            for name in ("pivots", "drives", "junctions", "driving", "root", "modelled", "integrators"):
                assert getattr(mine, name) == getattr(theirs, name), (seed, name)
            for name in ("name_a", "name_b", "letter"):
                assert getattr(mine.prototype, name) == getattr(theirs.prototype, name)
            assert mine.prototype.shared() == theirs.prototype.shared()
            assert one.dropped(port) == other.dropped(port)
            assert mine.determinant() == theirs.determinant()
    assert compiled >= 10


@pytest.mark.thorough
def test_a_long_chain_has_the_same_program_and_the_exact_response(monkeypatch):
    one = reduced(2000)
    monkeypatch.setenv(VARIABLE, "0")
    other = reduced(2000)
    assert (
        one.program.ops == other.program.ops
    )  # beyond the registers among which equal values are looked for
    assert len(one.program) > 20_000
    monkeypatch.setenv(VARIABLE, "1")
    omega = np.array([0.5, 2.0])
    np.testing.assert_allclose(
        frequency_response(one, omega)[:, 0, 0], exact_response(2000, omega), rtol=1e-14, atol=0
    )


def test_a_ladder_is_planned_balanced_by_the_library(monkeypatch):
    """Of few frequencies too: its bounds grow along the rails, whatever the precision."""
    graph = ladder(125)
    few = np.array([0.1, 0.2])
    response = frequency_response(graph, few)
    many = frequency_response(graph, np.concatenate([few, np.linspace(0.3, 60, 1000)]))
    np.testing.assert_allclose(response, many[:2], rtol=1e-12)
    planned = graph.balanced().program
    assert type(planned).__name__ == "CompiledProgram"
    monkeypatch.setenv(VARIABLE, "0")
    other = ladder(125).balanced().program
    assert type(other).__name__ == "Program"
    assert planned.ops == other.ops


def test_a_pivot_that_vanishes_with_the_values_is_planned_again(monkeypatch):
    nodes = [Node("u", "Se"), Node("a", "1"), Node("b", "0"), Node("c", "1"), Node("m", "I", Fraction(1))]
    nodes += [Node("r1", "R", Fraction(1)), Node("r2", "R", Fraction(-1)), Node("k", "C", Fraction(1))]
    bonds = [Bond("u", "a"), Bond("a", "m"), Bond("a", "b"), Bond("b", "c"), Bond("c", "k")]
    bonds += [Bond("c", "r1"), Bond("c", "r2")]
    one, other = both(monkeypatch, BondGraph(nodes, bonds), ["u"], [Port("m", "f")])
    assert one.channels() == other.channels()
    assert one.program.ops == other.program.ops


def _star(*more, bonds=()):
    nodes = [Node("u", "Se"), Node("a", "1"), Node("m", "I", Fraction(1)), Node("r", "R", Fraction(2))]
    return BondGraph([*nodes, *more], [Bond("u", "a"), Bond("a", "m"), Bond("a", "r"), *bonds])


@pytest.mark.parametrize(
    ("graph", "output"),
    [
        (_star(Node("k", "R", Fraction(0)), bonds=[Bond("a", "k")]), "m"),  # no value
        (_star(Node("b", "1"), bonds=[Bond("a", "b"), Bond("b", "a")]), "m"),  # a ring
        (_star(Node("b", "0"), bonds=[Bond("a", "b")]), "m"),  # bare to the end
        (_star(Node("x", "Se"), Node("y", "R", Fraction(1)), bonds=[Bond("x", "y")]), "m"),  # face to face
        (_star(Node("b", "0"), Node("A", "A", Fraction(1)), Node("k", "C", Fraction(1)),
               bonds=[Bond("a", "A"), Bond("A", "b"), Bond("b", "k")]), "m"),  # one way
    ],
)  # fmt: skip
def test_what_the_library_refuses_is_planned_by_python(monkeypatch, graph, output):
    monkeypatch.setattr(reduced_graph, "LARGE_GRAPHS", replace(reduced_graph.LARGE_GRAPHS, value=0))
    planned = ReducedGraph(graph, ["u"], [Port(output, "f")], traced=False)
    assert type(planned.program).__name__ == "Program"
    assert planned.channels()


def test_a_division_by_zero_is_an_error_in_the_library_too(monkeypatch):
    one, _ = both(monkeypatch, _star(), ["u"], [Port("m", "f")])
    program = one.program
    with pytest.raises(ZeroDivisionError):
        program.div(program.one, program.zero)
    assert program.are_opposite(program.one, program.neg(program.one))
    assert program.constant(7) == program.constant(7)
    assert int(program.image(program.constant(-1))) == program.prime - 1
