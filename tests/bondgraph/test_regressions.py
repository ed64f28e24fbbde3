"""Corners that random tests found once: each was wrong, and must stay right."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.program.factored import primes
from tests.bondgraph.graphs import at, build, parse, port, transfer, transfers, written
from tests.bondgraph.random_graphs import coincident_graph
from tests.bondgraph.test_frequency_response import exact
from tests.bondgraph.test_reduction import assert_agrees

ONE_WAY = [
    (
        "1 j0, 1 j1, 0 j2, 1 j3, GY t4 -1, GY t9 1, R x11 -1, Se u, I x19 0",
        "t4 -> j0, j2 -> j1, j1 -> t9, t9 -> j3, j2 -> x19, j1 -> t4, j0 -> j2, x11 -> j0, u -> j1",
        "j3.f",
    ),
    (
        "0 j0, 0 j1, 0 j2, 1 j3, 0 j4, GY t9 1, R x14 -1, I x22 0, Sf u, GY t26 1",
        "j2 -> t9 -> j1, j2 -> j3, j4 -> j3, j3 -> j1, j0 -> j1, u -> t26 -> j0, x22 -> j1, x14 -> j2",
        "u.f",
    ),
]


@pytest.mark.parametrize(("nodes", "bonds", "output"), ONE_WAY)
def test_a_bond_and_a_gyrator_in_parallel_may_couple_one_way_only(nodes, bonds, output):
    node, _, quantity = output.rpartition(".")
    assert_agrees((*parse(nodes, bonds), ["u"], (node, quantity)))


@pytest.mark.parametrize("seed", [311322, 313965, 314161, 314627])
def test_random_graphs_with_one_way_couplings(seed):
    rng = random.Random(seed)
    assert_agrees(coincident_graph(rng, rng.randint(1, 7)))


@pytest.mark.parametrize("output", ["r1.f", "r1.q"])
def test_a_hidden_mode_at_zero_is_not_taken_for_the_integrator_of_a_displacement(output):
    graph = written(
        "Se u, 1 a, R r1 1, 0 b, R r2 1, 1 c, C c1 1, C c2 2",
        "u -> a -> r1, a -> b -> r2, b -> c -> c1, c -> c2",
        output,
    )
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"properties"})))
    assert result.value(f"bond_graph/properties/{output}/u/hidden_modes").tolist() == [0]


@pytest.mark.parametrize(
    ("nodes", "letter"), [("Sf u, 0 j, C a 0, C b 1", "c"), ("Se u, 1 j, I a 0, I b 1", "d")]
)
def test_a_storage_of_zero_may_be_the_system_that_sets_the_common_variable(nodes, letter):
    output = "j.e" if letter == "c" else "j.f"
    graph = written(nodes, "u -> j, j -> a, j -> b", output)
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"prototype"})))
    assert result.value("bond_graph/reduction/prototype") == letter
    poles = result.value(f"bond_graph/reduction/dynamics/{output}/natural_modes")
    assert poles.tolist() == [0]


@pytest.mark.parametrize("sign", [1, -1])
def test_gains_and_coefficients_beyond_doubles_are_infinite(sign):
    channel = transfer(f"Sf u, TF n {10**200}, R r {sign * 10**200}", "u -> n -> r", "u.e")
    assert channel.dc_gain == channel.high_frequency_gain == sign * math.inf
    assert channel.coefficients()[0].tolist() == [sign * math.inf]


PRIME = next(primes())


@pytest.mark.parametrize("modulus", [PRIME, Fraction(1, PRIME), 3 * PRIME])
@pytest.mark.parametrize("resistance", [1, PRIME])
def test_no_value_is_taken_for_zero(modulus, resistance):
    """Such numbers vanish, or have no inverse, modulo the prime that images are first taken modulo."""
    nodes, bonds = f"Sf u, 1 j, TF n {modulus}, R r {resistance}, I m 1", "u -> j -> n -> r, j -> m"
    assert at(transfer(nodes, bonds, "u.e"), Fraction(2)) == Fraction(modulus) ** 2 * resistance + 2


def test_an_intermediate_underflow_does_not_make_the_frequency_response_wrong():
    graph = written(
        f"0 j0, 1 j1, 1 j2, TF t3 1, GY t4 1/{10**86}, TF t5 {10**146}, I x9 {10**131}, C x10 1, Se u",
        "j1 -> t4, t4 -> t3, t3 -> j0, j2 -> t5, t5 -> j1, j0 -> j2, x9 -> j1, x10 -> j2, j0 -> u",
        "x10.q",
    )
    expected = exact(transfers(graph)["x10.q", "u"], 1.0)
    assert frequency_response(graph, np.array([1.0])).item() == pytest.approx(expected, rel=1e-12)


def test_a_hydraulic_servo_drive_agrees_with_its_equations():
    """Pump -> valve resistance -> cylinder volume -> ram (TF 1/A) -> mass with friction: by hand."""
    from fractions import Fraction

    R, C, A, m, d = (Fraction(x) for x in ("1/3", "1/50", "2", "7", "5"))
    graph = f"Se p, 1 valve, R R {R}, 0 volume, C C {C}, TF ram {1 / A}, 1 load, I m {m}, R d {d}"
    channel = transfer(
        graph, "p -> valve -> R, valve -> volume -> C, volume -> ram -> load -> m, load -> d", "m.f"
    )
    # p = R q + P;  q = C s P + A v;  A P = (m s + d) v
    expected = [R * C * m, R * C * d + m, d + R * A**2]
    numerator, denominator = channel.coefficients()
    assert denominator.tolist() == [float(x / expected[0]) for x in expected]
    assert numerator.tolist() == [float(A / expected[0])]


def test_natural_frequencies_and_damping_ratios_of_pairs_real_poles_and_integrators():
    types, values, pairs = parse(
        "Se u, 1 j, I m 1, R b 2, C k 1/5, 0 p, R r 1, C c 1/3, GY g 1",
        "u -> j, j -> m, j -> b, j -> k, j -> g, g -> p, p -> r, p -> c",
    )
    question = Analysis(("u",), (port("m.q"),), frozenset({"properties", "poles"}))
    result = analyse(build(types, values, pairs), question)
    poles = result["bond_graph/transfer_function/m.q/u/poles"].data
    group = "bond_graph/properties/m.q/u"
    found = result[f"{group}/natural_frequency"].data, result[f"{group}/damping_ratio"].data
    upper = [pole for pole in poles if pole.imag >= 0]
    assert found[0] == pytest.approx([abs(pole) for pole in upper])
    expected = [-np.cos(np.angle(pole)) if pole else 0.0 for pole in upper]
    assert found[1] == pytest.approx(expected)
