"""Hidden modes: why a channel does not show them, and what holds their energy."""

import numpy as np
import pytest

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from tests.bondgraph.graphs import build, parse, port

BRANCHES = "0 n, 1 a, R r_a 1, C c_a 2, 1 b, R r_b 1, C c_b 2"
BONDS = "n -> a, n -> b, a -> r_a, a -> c_a, b -> r_b, b -> c_b"


def hidden(nodes, bonds, output, source):
    types, values, pairs = parse(nodes, bonds)
    question = Analysis((source,), (port(output),), frozenset({"hidden_modes"}))
    result = analyse(build(types, values, pairs), question)
    group = f"bond_graph/properties/{output}/{source}"
    names = ("hidden_modes", "hidden_mode_cause", "hidden_mode_elements")
    return list(zip(*(result[f"{group}/{name}"].data for name in names), strict=True))


def test_a_difference_of_equal_branches_is_neither_driven_nor_seen_from_their_junction():
    found = hidden(f"Sf u, {BRANCHES}", f"u -> n, {BONDS}", "n.e", "u")
    assert found == [(-0.5, "uncontrollable and unobservable", "c_a 50 %, c_b 50 %")]


def test_it_is_seen_in_one_branch():
    found = hidden(f"Sf u, {BRANCHES}", f"u -> n, {BONDS}", "c_a.e", "u")
    assert found == [(-0.5, "uncontrollable", "c_a 50 %, c_b 50 %")]


def test_the_charge_that_two_capacitors_share_is_driven_by_no_effort_in_their_loop():
    # Se u in branch a: only the difference of the capacitors is driven, and their common charge stays
    found = hidden(f"Se u, {BRANCHES}", f"u -> a, {BONDS}", "c_b.e", "u")
    assert found == [(0, "uncontrollable", "c_a 50 %, c_b 50 %")]


@pytest.mark.parametrize("output", ["m.p", "m.q", "c_a.q"])
def test_the_integrator_of_an_output_is_no_hidden_mode(output):
    nodes, bonds = "Se u, 1 j, I m 1, R b 2, C c_a 1/5", "u -> j, j -> m, j -> b, j -> c_a"
    found = hidden(nodes, bonds, output, "u")
    assert all(value != 0 for value, _, _ in found)


@pytest.mark.parametrize("output", ["c.q", "c.e"])
def test_a_charge_that_no_input_reaches_is_seen_where_it_is_asked_for(output):
    nodes, bonds = "Se u, 1 j, R r 1, Sf v, 0 n, C c 1", "u -> j, j -> r, v -> n, n -> c"
    assert hidden(nodes, bonds, output, "u") == [(0, "uncontrollable", "c 100 %")]


def test_a_mode_of_irrational_place_is_explained_exactly():
    # two equal oscillators hang on one mass in opposition: the antisymmetric one has s^2 + s/2 + 1/2 = 0
    nodes = "Se u, 1 j, I m 3, 0 p, 1 d, C k 1, R b 1, I x 2, 1 w, 0 q, 1 h, C l 1, R c 1, I y 2, 1 v"
    bonds = (
        "u -> j, j -> m, j -> p, p -> d, d -> k, d -> b, p -> w, w -> x, "
        "j -> q, q -> h, h -> l, h -> c, q -> v, v -> y"
    )
    found = hidden(nodes, bonds, "m.f", "u")
    roots = np.sort_complex([value for value, _, _ in found])
    assert roots == pytest.approx(np.sort_complex(np.roots([2, 1, 1])), rel=1e-14)
    for _, cause, elements in found:
        assert cause == "uncontrollable and unobservable"
        names = [part.split()[0] for part in elements.split(", ")]
        assert sorted(names) == ["k", "l", "x", "y"]
