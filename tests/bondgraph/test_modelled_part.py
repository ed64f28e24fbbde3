"""Only what an output depends on is modelled, and what is left out is named."""

import random
from fractions import Fraction

import pytest

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.errors import Singular
from tests.bondgraph.graphs import port, reduced, written
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at
from tests.sample import sample

pytestmark = pytest.mark.thorough

S = Fraction(987654321, 1234577)


@pytest.mark.parametrize("first", sample(range(40_000, 40_150, 50), 1))
def test_what_is_named_as_dropped_does_not_matter_together_or_alone(first):
    named = 0
    for seed in range(first, first + 50):
        rng = random.Random(seed)
        types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 7), rng.choice([0, 0, 1]))
        before = transfer_at(types, values, bonds, inputs, output, S)
        try:
            graph = reduced(types, values, bonds, inputs, f"{output[0]}.{output[1]}")
        except Singular:
            continue
        left_out = graph.dropped(port(f"{output[0]}.{output[1]}"))
        changed = {name: v * 3 if name in left_out else v for name, v in values.items()}
        after = transfer_at(types, changed, bonds, inputs, output, S)
        if before is None or after is None:
            continue
        assert after == before
        assert all(before[name] == 0 for name in left_out if name in inputs)
        for name in values:
            other = transfer_at(types, {**values, name: values[name] * 3}, bonds, inputs, output, S)
            assert name not in left_out or other in (before, None)
            named += name in left_out
    assert named > 20


def test_each_output_names_what_it_leaves_out():
    """A bus under an ideal source parts the graph: each branch is modelled for its own output only."""
    nodes = "Se u, Sf w, 0 bus, 1 a, R r 2, I m 3, 1 b, R q 4, C c 5, GY g 6, 0 z, R x 7"
    bonds = "u -> bus -> a -> r, a -> m, bus -> b -> q, b -> c, bus -> g -> z, z -> x, w -> z"
    graph = written(nodes, bonds, "m.f", "c.e")
    assert graph.dropped(port("m.f")) == ("w", "b", "q", "c", "g", "z", "x")
    assert graph.dropped(port("c.e")) == ("w", "a", "r", "m", "g", "z", "x")
    asked = Analysis(graph.inputs, graph.outputs, frozenset({"prototype"}))
    result = analyse(graph.graph, asked)
    assert result["bond_graph/need/left_out_names"].data[0] == "w, g, z, x"
    assert result["bond_graph/reduction/dropped"].data.tolist() == [
        "w, b, q, c, g, z, x",
        "w, a, r, m, g, z, x",
    ]


def test_an_element_that_a_constraint_silences_is_dropped():
    """Two levers hand the force of w to c; what else moves with their common point plays no part."""
    graph = written(
        "Se w, 1 a, R r 5, 0 b, 1 c, TF n 2, TF m 3, I i 1", "w -> a -> n -> b -> m -> c -> i, a -> r", "c.f"
    )
    assert graph.dropped(port("c.f")) == ()
    behind = written("Se u, 0 j, R r 1, R q 2", "u -> j -> r, j -> q", "r.f")
    assert behind.dropped(port("r.f")) == ()  # q stands on the port's junction: it is part of the prototype


def test_sources_that_are_no_inputs_are_named():
    nodes, bonds = "Se u, Sf w, 1 a, R r 2, 0 b, R q 3", "u -> a -> r, a -> b -> q, w -> b"
    graph = written(nodes, bonds, "q.e", inputs=["u"])
    assert graph.dropped(port("q.e")) == ("w",)
