"""Every step of a reduction, run alone, leaves the transfer function as it is; and says what it does.

The network left after a step is solved here from scratch, by Gaussian elimination over the rationals at one
rational s, and must give what the tableau of the whole graph gives.
"""

import json
import random
from fractions import Fraction
from pathlib import Path

import pytest

from dynid.bondgraph.reduction.snapshots import snapshots
from dynid.errors import Singular
from tests.bondgraph.graphs import ISOLATOR, port, reduced, written
from tests.bondgraph.random_graphs import coincident_graph, random_graph
from tests.bondgraph.tableau import determined_at
from tests.sample import sample

S = Fraction(987654321, 1234577)
PUBLISHED = sorted((Path(__file__).parents[2] / "../shared/data/bondgraphs").glob("*.json"))

#: A word for the physical operation that every rule must name.
OPERATION = {
    "series": "impedances add",
    "parallel": "admittances add",
    "reflection": "seen from",
    "source swap": "equivalent",
    "merge": "merge",
    "junction elimination": "equivalent (Schur complement",
    "constraint": "balance",
    "prototype": "source on",
}


def assert_every_step_keeps(types, values, bonds, inputs, output):
    """Check the network after every step against the tableau; return the steps."""
    name = f"{output[0]}.{output[1]}"
    graph = reduced(types, values, bonds, inputs, name)
    expected = determined_at(types, values, bonds, inputs, output, S)
    strip = snapshots(graph.structure, graph.program, port(name), graph.inputs)
    steps = graph.reductions[port(name)].steps
    assert tuple(shot.step for shot in strip) == (None, *steps)
    for shot in strip:
        found = transfer_of(shot, graph.program, values, inputs, S)
        assert {source: found[source] for source in expected} == expected, shot.step
    assert len(strip[-1].junctions) == 1
    return steps


def transfer_of(shot, program, values, inputs, s):
    """Solve the network of a snapshot for {input: T(s)}."""
    registers, names = registers_of(shot, program), list(shot.junctions)
    at = program.run(registers, values, s, Fraction(1))
    place = {name: row for row, name in enumerate(names)}
    matrix = [[Fraction(0)] * len(names) for _ in names]
    for name, state in shot.junctions.items():
        matrix[place[name]][place[name]] = sum((at[term.register] for term in state.terms), Fraction(0))
    for link in shot.links:
        matrix[place[link.tail]][place[link.head]] = at[link.forward]
        matrix[place[link.head]][place[link.tail]] = at[link.back]
    root = place[shot.root]
    found = {}
    for source in inputs:
        fed = [at[shot.junctions[name].sources.get(source, program.zero)] for name in names]
        rows, right = list(matrix), list(fed)
        if shot.known is not None:
            rows[root] = [Fraction(column == root) for column in range(len(names))]
            right[root] = at[shot.known[source]]
        x = solved(rows, right)
        lacking = fed[root] - sum(entry * value for entry, value in zip(matrix[root], x, strict=True))
        found[source] = at[shot.reading.common] * x[root] + at[shot.reading.drive] * lacking
        if source == shot.reading.by:
            found[source] += at[shot.reading.direct]
    return found


def registers_of(shot, program):
    states = shot.junctions.values()
    return {
        program.zero,
        *(register for state in states for register in state.sources.values()),
        *(term.register for state in states for term in state.terms),
        *(register for link in shot.links for register in (link.forward, link.back)),
        *(shot.known or {}).values(),
        *(shot.reading.common, shot.reading.drive, shot.reading.direct),
    }


def solved(rows, right):
    """Gaussian elimination over the rationals."""
    table = [[*row, value] for row, value in zip(rows, right, strict=True)]
    for column in range(len(table)):
        pivot = next(row for row in range(column, len(table)) if table[row][column])
        table[column], table[pivot] = table[pivot], table[column]
        scale = table[column][column]
        table[column] = [entry / scale for entry in table[column]]
        for row in range(len(table)):
            if row != column and (factor := table[row][column]):
                table[row] = [a - factor * b for a, b in zip(table[row], table[column], strict=True)]
    return [row[-1] for row in table]


def checked(cases):
    """Check every graph that has a solution; return the rules that were seen."""
    rules = set()
    for case in cases:
        try:
            steps = assert_every_step_keeps(*case)
        except Singular:
            continue
        for step in steps:
            rules.add(step.rule)
            assert OPERATION[step.rule] in step.meaning, step
    return rules


@pytest.mark.parametrize("first", sample(range(70_000, 70_150, 50), 1))
def test_every_step_on_random_graphs_keeps_the_transfer_function(first):
    def cases():
        for seed in range(first, first + 50):
            rng = random.Random(seed)
            yield random_graph(rng, rng.randint(1, 8), rng.choice([0, 0, 1, 2, 4]))

    assert checked(cases()) == set(OPERATION)


@pytest.mark.thorough
@pytest.mark.parametrize("first", sample(range(80_000, 80_200, 50), 1))
def test_every_step_on_graphs_full_of_coincidences_keeps_the_transfer_function(first):
    def cases():
        for seed in range(first, first + 50):
            rng = random.Random(seed)
            yield coincident_graph(rng, rng.randint(1, 6))

    assert "constraint" in checked(cases())


@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.stem)
def test_every_step_on_published_graphs_keeps_the_transfer_function(file):
    graph = json.loads(file.read_text(encoding="utf-8"))
    types = {element["name"]: element["type"] for element in graph["elements"]}
    values = {e["name"]: Fraction(e["value_exact"]) for e in graph["elements"] if e["value_exact"]}
    bonds = [tuple(bond) for bond in graph["bonds"]]
    output = graph["output"]["element"], graph["output"]["kind"]
    steps = assert_every_step_keeps(types, values, bonds, graph["inputs"], output)
    assert all(OPERATION[step.rule] in step.meaning for step in steps)


def test_the_isolators_strip_shows_what_each_step_consumes():
    graph = written(*ISOLATOR, "m_s.f")
    strip = snapshots(graph.structure, graph.program, port("m_s.f"), graph.inputs)
    left = [list(shot.junctions) for shot in strip]
    assert [len(junctions) for junctions in left] == [3, 3, 2, 1, 1, 1, 1]
    assert (left[0], left[-1]) == (["body", "base", "fluid"], ["body"])
    swap = next(shot for shot in strip if shot.step and shot.step.rule == "source swap")
    assert swap.gone == ("base",)
    assert swap.changed == ("body",)
    assert list(swap.junctions["body"].drives) == ["e_eq_base"]


def test_what_a_constraint_cuts_off_goes_with_it():
    """Nothing stands on k, so j has no effort, and the resistance behind j is tied to nothing."""
    graph = written("Sf u, 1 a, R q 3, 0 j, 1 k, 1 l, R r 2", "u -> a -> q, a -> j -> k, j -> l -> r", "u.e")
    strip = snapshots(graph.structure, graph.program, port("u.e"), graph.inputs)
    constraint = next(shot for shot in strip if shot.step and shot.step.rule == "constraint")
    assert constraint.gone == ("j", "k", "l")
    assert list(constraint.junctions) == ["a"]


def test_two_junctions_have_one_link():
    graph = written(*ISOLATOR, "m_s.f")
    drawn, *_ = snapshots(graph.structure, graph.program, port("m_s.f"), graph.inputs)
    assert [{link.tail, link.head} for link in drawn.links] == [{"body", "base"}, {"base", "fluid"}]


def test_what_an_elimination_leaves_bears_the_name_that_its_step_defines():
    """Two junctions gain the same admittance, each under a name of its own."""
    nodes = "Se u, 1 a, I m 2, 0 z, R r 3, 1 b, C c 5, 0 y, R q 7"
    graph = written(nodes, "u -> a -> m, a -> z -> r, z -> b -> c, a -> y -> q, y -> b", "m.f")
    drawn, left, *_ = snapshots(graph.structure, graph.program, port("m.f"), graph.inputs)
    assert (left.step.rule, left.gone, left.changed) == ("junction elimination", ("b",), ("z", "y"))
    assert [name for name, _ in left.step.definitions] == ["k_z_z", "k_z_y", "k_y_z", "k_y_y"]
    for name in ("z", "y"):
        before, now = drawn.junctions[name].terms, left.junctions[name].terms
        gained = [left.junctions[name].titles[term] for term in now if term not in before]
        assert gained == [f"k_{name}_{name}"]
