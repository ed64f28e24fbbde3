"""What is decided from one exact transfer function: degrees, gains, stability, phase, hidden modes."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from tests.bondgraph.graphs import ISOLATOR, polynomial_at, transfer, transfers, written


def prop(nodes, bonds, output, name, inputs=None):
    """Return one property of a graph's only channel, as a scene would store it."""
    graph = written(nodes, bonds, output, inputs=inputs)
    result = analyse(
        graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"properties", "hidden_modes"}))
    )
    return result.value(f"bond_graph/properties/{output}/{graph.inputs[0]}/{name}")


# Each: nodes, bonds, output, relative degree, T(0+), T(inf).
GAINS = {
    "a gain": ("Se u, R r 2", "u -> r", "r.f", 0, 0.5, 0.5),
    "a differentiator": ("Se u, C c 3", "u -> c", "c.f", -1, 0.0, math.inf),
    "a negative differentiator": ("Se u, C c 3", "c -> u", "c.f", -1, 0.0, -math.inf),
    "an integrator": ("Se u, I m 3", "u -> m", "m.f", 1, math.inf, 0.0),
    "a negative integrator": ("Se u, I m 3", "m -> u", "m.f", 1, -math.inf, 0.0),
    "a double integrator": ("Se u, I m 3", "u -> m", "m.q", 2, math.inf, 0.0),
    "a low pass": ("Se u, 1 j, R r 2, I m 4", "u -> j -> r, j -> m", "m.f", 1, 0.5, 0.0),
    "a high pass": ("Se u, 1 j, R r 2, C c 4", "u -> j -> r, j -> c", "r.f", 0, 0.0, 0.5),
    "a PD driving point": ("Sf u, 1 j, R r 2, I m 4", "u -> j -> r, j -> m", "u.e", -1, 2.0, math.inf),
}


@pytest.mark.parametrize("name", GAINS)
def test_relative_degree_and_gains(name):
    nodes, bonds, output, degree, low, high = GAINS[name]
    channel = transfer(nodes, bonds, output)
    assert channel.relative_degree == degree
    assert channel.dc_gain == low
    assert channel.high_frequency_gain == high


def test_a_channel_that_the_input_does_not_reach_vanishes():
    nodes, bonds = "Se u, Se w, 0 j, R r 2, 1 k, R q 3, I m 1", "u -> j -> r, j -> k -> q, w -> k, k -> m"
    channel = transfers(written(nodes, bonds, "r.f"))["r.f", "w"]
    assert channel.vanishes
    assert channel.relative_degree == math.inf
    assert (channel.dc_gain, channel.high_frequency_gain) == (0.0, 0.0)
    assert channel.zeros == ()
    assert channel.minimum_phase is False
    assert channel.zero_stability.startswith("undefined")
    numerator, denominator = channel.coefficients()
    assert numerator.tolist() == [0.0]
    assert denominator.tolist() == [1.0]


def test_without_storage_there_are_no_states():
    channel = transfer("Se u, 1 j, R r 2, R q 3", "u -> j -> r, j -> q", "q.e")
    assert channel.order == 0
    assert (channel.zeros, channel.poles) == ((), ())
    assert channel.stable
    assert channel.minimum_phase
    assert channel.dc_gain == channel.high_frequency_gain == 0.6


VERDICTS = {
    "minimum phase: there are no finite zeros": ("Se u, 1 j, R r 2, I m 4", "u -> j -> r, j -> m", "m.f"),
    "minimum phase: every zero": ("Sf u, 1 j, R r 2, I m 4", "u -> j -> r, j -> m", "u.e"),
    "marginal": ("Sf u, 1 j, C c 2, I m 4", "u -> j -> c, j -> m", "u.e"),
    "non-minimum phase": ("Sf u, 1 j, R r -2, I m 4", "u -> j -> r, j -> m", "u.e"),
    "undefined": ("Se u, R q 1, R r 1, Sf w", "w -> q, u -> r", "r.f"),
}


@pytest.mark.parametrize("start", VERDICTS)
def test_the_phase_verdict_starts_with_its_keyword(start):
    nodes, bonds, output = VERDICTS[start]
    inputs = ["w"] if start == "undefined" else None
    channel = transfer(nodes, bonds, output, inputs=inputs)
    assert channel.zero_stability.startswith(start)
    assert channel.minimum_phase is start.startswith("minimum phase")


def test_zeros_at_both_sides_of_an_all_pass_bridge():
    """A lattice of two arms: T = (1 - s)/(1 + s), the textbook non-minimum phase."""
    nodes = "Se u, 0 top, 1 a, 1 b, 1 c, 1 d, 0 x, 0 y, 1 out, R r1 1, R r2 1, C c1 1, C c2 1, Sf probe"
    bonds = (
        "u -> top, top -> a, a -> r1, a -> x, x -> c, c -> c1, top -> b, b -> c2, b -> y, y -> d, d -> r2, "
        "x -> out, out -> y, probe -> out"
    )
    channel = transfers(written(nodes, bonds, "probe.e", inputs=["u"]))["probe.e", "u"]
    assert [root.value for root in channel.zeros] == [1]
    assert [root.value for root in channel.poles] == [-1]
    assert channel.stable
    assert channel.zero_stability.startswith("non-minimum phase: zero at 1 lies in the right half-plane")


positive = st.floats(1e-6, 1e6).map(lambda x: Fraction(f"{x:.6g}"))


@settings(max_examples=100)
@given(m_s=positive, b=positive, area=positive, inertia=positive, compliance=positive)
def test_the_isolator_obeys_equations_20_to_23(m_s, b, area, inertia, compliance):
    nodes = (
        f"Sf v_in, 0 base, 1 body, I m_s {m_s}, R b {b}, TF tuning {area}, 1 fluid, I I_f {inertia}, "
        f"C C_a {compliance}"
    )
    channel = transfer(nodes, ISOLATOR[1], "m_s.f")
    m_e, stiffness = area**2 * inertia, area**2 / compliance
    # eq 20: the zeros, undamped at w_0
    w_0 = math.sqrt(stiffness / m_e)
    assert [root.value.real for root in channel.zeros] == [0.0, 0.0]
    assert [abs(root.value) for root in channel.zeros] == pytest.approx([w_0] * 2, rel=1e-12)
    # eq 21: the poles, of (m_s + m_e) s^2 + b s + A_p^2/C_a
    numerator, denominator = channel.coefficients()
    assert denominator.tolist() == [1.0, float(b / (m_s + m_e)), float(stiffness / (m_s + m_e))]
    assert numerator.tolist() == [float(m_e / (m_s + m_e)), 0.0, float(stiffness / (m_s + m_e))]
    # eqs 22, 23 as corrected: T(0) = 1, T(inf) = (w_n/w_0)^2 = (m_e/m_s)/(1 + m_e/m_s)
    ratio = m_e / m_s
    w_n2 = stiffness / (m_s + m_e)
    assert channel.dc_gain == 1.0
    assert channel.high_frequency_gain == float(ratio / (1 + ratio))
    assert channel.high_frequency_gain == pytest.approx(float(w_n2) / w_0**2, rel=1e-12)
    assert channel.relative_degree == 0
    assert channel.stable
    assert channel.zero_stability.startswith("marginal")


@settings(max_examples=100)
@given(
    st.lists(st.fractions(min_value=-9, max_value=9, max_denominator=100), min_size=1, max_size=4),
    st.lists(st.fractions(min_value=-9, max_value=9, max_denominator=100), min_size=1, max_size=4),
)
def test_gains_are_the_limits_of_the_function(top, bottom):
    from flint import fmpz_poly

    from dynid.bondgraph.exact_engine import TransferFunction

    def polynomial(coefficients):
        size = math.lcm(*(c.denominator for c in coefficients))
        return fmpz_poly([int(c * size) for c in coefficients])

    numerator, denominator = polynomial(top), polynomial(bottom)
    if denominator == 0:
        return
    common = numerator.gcd(denominator)
    channel = TransferFunction(numerator // common, denominator // common)

    def value(s):
        return polynomial_at(numerator, s) / polynomial_at(denominator, s)

    for limit, s in ((channel.dc_gain, Fraction(1, 10**30)), (channel.high_frequency_gain, Fraction(10**30))):
        near = value(s)
        if math.isinf(limit):
            assert math.copysign(1, limit) == math.copysign(1, near)
            assert abs(near) > 10**20
        else:
            assert abs(near - Fraction(limit)) < 1e-12 * max(1, abs(limit))


def test_two_compliances_in_series_hide_the_charge_between_them():
    nodes, bonds = "Se u, 1 j, R r 2, C c1 1, C c2 3", "u -> j -> r, j -> c1, j -> c2"
    assert transfer(nodes, bonds, "j.f").order == 1
    assert prop(nodes, bonds, "j.f", "hidden_modes").tolist() == [0]


def test_a_symmetric_graph_hides_its_antisymmetric_mode():
    """Two equal branches under one effort: their difference decays alone, at -R/I."""
    nodes = "Se u, 1 s, R z 1, 0 j, 1 a, R r1 3, I m1 2, 1 b, R r2 3, I m2 2"
    bonds = "u -> s -> z, s -> j, j -> a -> r1, a -> m1, j -> b -> r2, b -> m2"
    assert prop(nodes, bonds, "s.f", "hidden_modes").tolist() == [-1.5]
    assert prop(nodes, bonds, "s.f", "order") == 1


def test_nearly_symmetric_branches_hide_nothing():
    nodes = "Se u, 1 s, R z 1, 0 j, 1 a, R r1 3, I m1 2, 1 b, R r2 3, I m2 2.000000000000001"
    bonds = "u -> s -> z, s -> j, j -> a -> r1, a -> m1, j -> b -> r2, b -> m2"
    assert prop(nodes, bonds, "s.f", "hidden_modes").tolist() == []
    assert prop(nodes, bonds, "s.f", "order") == 2


def test_a_mode_that_the_output_does_not_see_is_hidden():
    """The branch beside the output, under an ideal source, is left out; behind a resistance it is a mode."""
    nodes = "Se u, 1 s, R z 1, 0 j, R q 1, 1 b, R r 3, I m 2"
    bonds = "u -> s -> z, s -> j -> q, j -> b -> r, b -> m"
    assert prop(nodes, bonds, "q.e", "order") == 1
    assert prop(nodes, bonds, "q.e", "hidden_modes").tolist() == []


def test_poles_and_hidden_modes_together_are_the_natural_modes():
    """A hidden mode on top of one that shows at the same place keeps its multiplicity."""
    nodes = "Se u, 1 s, R z 1, 0 j" + "".join(f", 1 a{k}, R r{k} 3, I m{k} 2" for k in range(4))
    bonds = "u -> s -> z, s -> j" + "".join(f", j -> a{k} -> r{k}, a{k} -> m{k}" for k in range(4))
    assert prop(nodes, bonds, "s.f", "hidden_modes").tolist() == [-1.5, -1.5, -1.5]


def test_coefficients_are_monic_and_correctly_rounded():
    channel = transfer("Se u, 1 j, R r 1/3, I m 7", "u -> j -> r, j -> m", "m.f")
    numerator, denominator = channel.coefficients()
    assert numerator.dtype == np.float64
    assert numerator.tolist() == [1 / 7]
    assert denominator.tolist() == [1.0, float(Fraction(1, 21))]


@pytest.mark.parametrize(
    ("resistance", "verdict"),
    [
        (1, "stable"),
        (0, "marginal, not stable: poles at ±1j lie on the imaginary axis"),
        (-1, "unstable: poles at 0.5 ± 0.866j"),
    ],
)
def test_the_stability_verdict_names_the_poles_that_decide_it(resistance, verdict):
    channel = transfer(f"Se u, 1 j, R r {resistance}, I m 1, C k 1", "u -> j -> r, j -> m, j -> k", "m.f")
    assert channel.stability.startswith(verdict)
    assert channel.stable == (verdict == "stable")


def test_two_masses_that_drift_are_unstable():
    channel = transfer("Se u, 1 j, I m 1", "u -> j -> m", "m.q")
    assert channel.stability == "unstable: poles at 0 lie repeated on the imaginary axis"


def test_roots_that_nobody_asks_for_are_not_computed(monkeypatch):
    def refuse(_):
        raise AssertionError("nobody asked for roots")

    monkeypatch.setattr("dynid.bondgraph.exact_engine.certified_roots", refuse)
    graph = written("Se u, 1 j, R r 1, I m 1", "u -> j -> r, j -> m", "m.f")
    asked = Analysis(graph.inputs, graph.outputs, frozenset({"transfer_function"}))
    result = analyse(graph.graph, asked)
    assert result.value("bond_graph/transfer_function/m.f/u/denominator").tolist() == [1, 1]
