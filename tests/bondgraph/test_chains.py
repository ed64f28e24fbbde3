"""Chains of mass-spring-damper stages: their known zeros, orders and sizes."""

from fractions import Fraction

import pytest
from flint import fmpz_poly

from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.templates.chain import FORCE, Stage, chain, distinct, last_velocity, uniform
from tests.bondgraph.graphs import transfers
from tests.bondgraph.tableau import transfer_at


def reduced_chain(stages):
    return ReducedGraph(chain(stages), [FORCE], [last_velocity(len(stages))])


@pytest.mark.parametrize("stages", [uniform(1), uniform(6), distinct(6)])
def test_the_zeros_are_0_and_those_of_the_joints_passed(stages):
    (transfer,) = transfers(reduced_chain(stages)).values()
    assert transfer.order == 2 * len(stages)
    expected = fmpz_poly([0, 1])
    for stage in stages[:-1]:
        ratio = stage.stiffness / stage.damping
        expected *= fmpz_poly([ratio.numerator, ratio.denominator])
    assert transfer.numerator * expected.leading_coefficient() == (
        expected * transfer.numerator.leading_coefficient()
    )


def test_a_chain_agrees_with_the_tableau():
    stages, s = distinct(4), Fraction(7, 3)
    graph = chain(stages)
    types = {name: node.type for name, node in graph.nodes.items()}
    values = {name: node.value for name, node in graph.nodes.items() if node.value is not None}
    bonds = [(bond.tail, bond.head) for bond in graph.bonds]
    expected = transfer_at(types, values, bonds, [FORCE], ("v4", "f"), s)[FORCE]
    (transfer,) = transfers(reduced_chain(stages)).values()

    def at(polynomial):
        return sum(Fraction(int(c)) * s**power for power, c in enumerate(polynomial.coeffs()))

    assert at(transfer.numerator) / at(transfer.denominator) == expected


def test_the_statics_of_a_chain():
    """Hold a constant force: the elongations are force over stiffness, so the displacements add up."""
    stages = [Stage(Fraction(1), Fraction(k), Fraction(1)) for k in (2, 3, 5)]
    graph = ReducedGraph(chain(stages), [FORCE], [last_velocity(3)])
    (transfer,) = transfers(graph).values()
    assert Fraction(int(transfer.numerator[1]), int(transfer.denominator[0])) == Fraction(1, 5)


def test_distinct_stages_differ_and_stay_within_a_quarter():
    stages = distinct(200)
    assert len(set(stages)) == 200
    for place, value in enumerate(Stage()):
        assert all(Fraction(3, 4) <= stage[place] / value <= Fraction(5, 4) for stage in stages)


@pytest.mark.thorough
@pytest.mark.parametrize("make", [uniform, distinct])
def test_a_plan_grows_with_the_number_of_stages_alone(make):
    """Operations per stage stay the same from 50 stages to 1600."""
    counts = [len(reduced_chain(make(stages)).program.ops) for stages in (50, 100, 800, 1600)]
    assert counts[1] - counts[0] == (counts[3] - counts[2]) / 16


def test_a_plan_without_its_steps_has_the_same_transfer_functions():
    graph = chain(distinct(5))
    plain = ReducedGraph(graph, [FORCE], [last_velocity(5)], traced=False)
    assert transfers(plain) == transfers(ReducedGraph(graph, [FORCE], [last_velocity(5)]))
    assert all(reduction.steps == () for reduction in plain.reductions.values())


def test_a_junction_with_thousands_of_elements():
    """Their impedances add up; looking at each again for every other would take minutes."""
    count = 3000
    nodes = [Node("u", "Se"), Node("j", "1"), *(Node(f"r{k}", "R", Fraction(k)) for k in range(1, count + 1))]
    bonds = [Bond("u", "j"), *(Bond("j", f"r{k}") for k in range(1, count + 1))]
    reduced = ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port("j", "f")])
    (transfer,) = transfers(reduced).values()
    assert Fraction(int(transfer.numerator[0]), int(transfer.denominator[0])) == Fraction(
        2, count * (count + 1)
    )
