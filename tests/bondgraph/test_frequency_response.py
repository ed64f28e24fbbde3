"""The frequency response against exact evaluation, above all where pivots vanish."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bench.cases.frequency_response import exact_ladder, ladder
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph_response import frequency_response
from tests.bondgraph.graphs import (
    ISOLATOR,
    at,
    build,
    chain,
    parse,
    polynomial_at,
    port,
    reduced,
    solvable,
    transfers,
    written,
)
from tests.bondgraph.random_graphs import coincident_graph, random_graph


class Gaussian:
    """A Gaussian rational, just enough to evaluate polynomials with."""

    def __init__(self, re, im=0):
        self.re, self.im = Fraction(re), Fraction(im)

    def __add__(self, other):
        other = other if isinstance(other, Gaussian) else Gaussian(other)
        return Gaussian(self.re + other.re, self.im + other.im)

    def __mul__(self, other):
        return Gaussian(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)

    __rmul__ = __mul__

    def over(self, other):
        """Return the quotient as a complex number, each part correctly rounded; inf at a pole."""
        size = other.re**2 + other.im**2
        if not size:
            return complex(np.inf, 0)
        product = self * Gaussian(other.re, -other.im)
        return complex(float(product.re / size), float(product.im / size))


def exact(channel, omega):
    """Return T(j omega) correctly rounded, for the double omega."""
    s = Gaussian(0, Fraction(float(omega)))
    zero = Gaussian(0)
    value = [zero + _horner(p, s) for p in (channel.numerator, channel.denominator)]
    return value[0].over(value[1])


def _horner(polynomial, s):
    total = Gaussian(0)
    for coefficient in reversed([int(c) for c in polynomial.coeffs()]):
        total = total * s + coefficient
    return total


def assert_exact(graph, omega, tolerance=1e-12):
    """Compare every channel; 1e-12 relative is what the response promises."""
    omega = np.asarray(omega, dtype=float)
    response = frequency_response(graph, omega)
    assert response.shape == (len(omega), len(graph.outputs), len(graph.inputs))
    assert not np.isnan(response).any()
    found = transfers(graph)
    for i, output in enumerate(graph.outputs):
        for k, source in enumerate(graph.inputs):
            channel = found[str(output), source]
            for w, value in zip(omega, response[:, i, k], strict=True):
                expected = exact(channel, w)
                if np.isinf(expected):
                    assert np.isinf(value)
                else:
                    assert abs(value - expected) <= tolerance * abs(expected), (w, value, expected)


def test_the_oracle_agrees_with_an_evaluation_at_a_rational_point():
    (channel,) = transfers(written(*ISOLATOR, "m_s.f")).values()
    s = Gaussian(Fraction(3, 7))
    expected = polynomial_at(channel.numerator, Fraction(3, 7))
    assert _horner(channel.numerator, s).re == expected


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(), loops=st.sampled_from([0, 0, 1, 3]))
def test_random_graphs(seed, loops):
    rng = random.Random(seed)
    graph = solvable(random_graph(rng, rng.randint(1, 7), loops))
    if graph is None:
        return
    assert_exact(graph, [0, 1e-9, 0.3, 1, 2, 17.5, 1e6])


@pytest.mark.parametrize("seed", range(70_000, 70_060))
def test_graphs_full_of_coincidences_where_poles_and_pivots_lie_on_the_axis(seed):
    rng = random.Random(seed)
    graph = solvable(coincident_graph(rng, rng.randint(1, 4)))
    if graph is None:
        return
    assert_exact(graph, [0, 0.5, 1, 2, 2**0.5])


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(1, 9), st.integers(-12, 12)), min_size=5, max_size=5))
def test_parameters_over_24_decades(scales):
    m, r, n, i, c = (Fraction(digit) * Fraction(10) ** exponent for digit, exponent in scales)
    nodes = f"Sf v_in, 0 base, 1 body, I m_s {m}, R b {r}, TF tuning {n}, 1 fluid, I I_f {i}, C C_a {c}"
    assert_exact(written(nodes, ISOLATOR[1], "m_s.f"), [0, 1e-12, 1e-6, 1, 1e6, 1e12])


def test_the_isolators_zero():
    """At omega_0 the tuning part's pivot vanishes; omega_0 is irrational, so T is tiny and not zero."""
    root = np.sqrt(5000.0)
    near = [root, np.nextafter(root, 0), np.nextafter(root, 1e9)]
    graph = written(*ISOLATOR, "m_s.f")
    assert_exact(graph, near)
    assert (np.abs(frequency_response(graph, np.array(near))) < 1e-15).all()


def test_a_zero_that_is_a_double_is_exactly_zero():
    """Two unlike sections share omega = 2 as an antiresonance; nothing passes there."""
    graph = written("Se u, 1 j, R r 3, 0 k, I m 1/4, C c 1", "u -> j -> r, j -> k -> m, k -> c", "r.f")
    assert_exact(graph, [2.0])
    assert frequency_response(graph, np.array([2.0])).item() == 0


def test_a_pole_on_the_axis_is_infinite_and_never_nan():
    graph = written("Sf u, 0 j, C c 1, I m 1/4", "u -> j -> c, j -> m", "c.e")
    assert_exact(graph, [0.0, 1.0, 2.0, 3.0])
    assert np.isinf(frequency_response(graph, np.array([2.0])).item())


def test_an_integrator_at_zero_frequency_is_infinite():
    graph = written("Se u, I m 3", "u -> m", "m.q", "m.f", "m.e")
    response = frequency_response(graph, np.array([0.0]))[0, :, 0]
    assert np.isinf(response[:2]).all()
    assert response[2] == 1


def test_zero_frequency_is_the_dc_gain_where_compliances_block():
    graph = written("Se u, 1 j, R r 2, 0 k, C c 3, R q 6", "u -> j -> r, j -> k -> c, k -> q", "q.e", "c.f")
    response = frequency_response(graph, np.array([0.0]))[0, :, 0]
    assert response.tolist() == [0.75, 0]


def test_a_pole_of_a_part_is_none_of_the_whole():
    """At omega = 2 the branch beside the output is a short: T is finite, only a pivot is not."""
    graph = written(
        "Se u, 1 j, R r 3, 0 k, 1 b, I m 1/4, C c 1, R q 5, R z 0",
        "u -> j -> r, j -> k -> b -> m, b -> c, k -> q, b -> z",
        "q.e",
        "q.f",
        "b.f",
        "r.f",
    )
    assert_exact(graph, [0.0, 2.0, np.nextafter(2.0, 3.0)])


def test_channels_that_vanish_are_exactly_zero():
    graph = written("Se u, Se w, 0 j, R r 2, C c 3", "u -> j -> r, w -> c", "r.f")
    assert frequency_response(graph, np.array([0.0, 1.0]))[:, 0, 1].tolist() == [0, 0]


def test_no_frequencies_give_an_empty_response():
    assert frequency_response(written(*ISOLATOR, "m_s.f"), np.array([])).shape == (0, 1, 1)


@pytest.mark.parametrize("damping", ["0", "1/1000000000000"])
def test_a_long_chain_at_its_own_resonances(damping):
    """Twelve equal masses and springs, hardly damped: every pivot goes through zero somewhere."""
    stages = 12
    nodes = "Sf u" + "".join(f", 0 a{k}, C c{k} 1, 1 b{k}, I m{k} 1, R d{k} {damping}" for k in range(stages))
    bonds = "u -> a0" + "".join(
        f", a{k} -> c{k}, a{k} -> b{k}, b{k} -> m{k}, b{k} -> d{k}" for k in range(stages)
    )
    bonds += "".join(f", b{k} -> a{k + 1}" for k in range(stages - 1))
    graph = written(nodes, bonds, f"m{stages - 1}.f")
    resonances = [2 * np.sin((2 * k + 1) * np.pi / (4 * stages + 2)) for k in range(stages)]
    assert_exact(graph, [*resonances, 1.0, np.sqrt(2.0), 2.0, 30.0])


@pytest.mark.parametrize("stages", [30, 300])
def test_a_long_ladder_full_of_loops(stages):
    """Error bounds, which grow with every step on a loop, must not keep the response from an answer."""
    omega = np.array([0.1, 0.7, 5.0, 60.0])
    found = frequency_response(ladder(stages), np.repeat(omega, 20))[::20, 0, 0]
    assert np.allclose(found, exact_ladder(stages, omega), rtol=1e-12, atol=0.0)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(), loops=st.sampled_from([1, 3, 5]))
def test_a_balanced_plan_gives_the_same_channels(seed, loops):
    rng = random.Random(seed)
    graph = solvable(random_graph(rng, rng.randint(3, 9), loops))
    if graph is None:
        return
    one, other = (
        {name: at(channel, Fraction(7, 3)) for name, channel in transfers(plan).items()}
        for plan in (graph.balanced(), graph)
    )
    assert one == other


def spectrum_peak(function, low, high):
    """Return max |T(j w)| over a band: where d|T|^2/dw vanishes, by the roots of a polynomial in w^2."""
    above, below = (
        np.polynomial.Polynomial([float(int(c)) for c in part.coeffs()])
        for part in (function.numerator, function.denominator)
    )

    def squared(part):  # |part(j w)|^2 as a polynomial in x = w^2
        even, odd = (np.polynomial.Polynomial(part.coef[k::2] if len(part.coef) > k else [0]) for k in (0, 1))
        minus = np.polynomial.Polynomial([0, -1])
        x = np.polynomial.Polynomial([0, 1])
        return even(minus) ** 2 + x * odd(minus) ** 2

    P, Q = squared(above), squared(below)
    turning = (P.deriv() * Q - P * Q.deriv()).roots()
    inside = [x.real for x in turning if abs(x.imag) < 1e-6 * abs(x) and low**2 < x.real < high**2]
    return max(math.sqrt(P(x) / Q(x)) for x in [low**2, *inside, high**2])


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("poles", [True, False])
def test_the_reported_maximum_is_that_of_the_exact_function(seed, poles):
    rng = random.Random(seed)
    stages = rng.randint(1, 4)
    nodes, bonds = chain(stages)
    low, high, points = 10 ** rng.uniform(-1, 0), 10 ** rng.uniform(1.5, 2.5), rng.randint(5, 60)
    types, values, pairs = parse(nodes, bonds)
    for name, kind in types.items():
        if kind == "R":
            values[name] *= Fraction(rng.randint(1, 100), 1000)
    graph, output = build(types, values, pairs), port("m1.f")
    omega = np.geomspace(low, high, points)
    results = frozenset({"frequency_response"} | ({"poles"} if poles else set()))
    result = analyse(graph, Analysis(("F",), (output,), results=results, omega=omega))
    (function,) = transfers(reduced(types, values, pairs, ["F"], "m1.f")).values()
    expected = spectrum_peak(function, low, high)
    assert result["bond_graph/frequency_peaks/magnitude"].data.item() == pytest.approx(expected, rel=1e-8)
    at = 1j * result["bond_graph/frequency_peaks/omega"].data.item()
    ratio = abs(polynomial_at(function.numerator, at) / polynomial_at(function.denominator, at))
    assert ratio == pytest.approx(expected, rel=1e-8)


def test_an_undamped_resonance_between_frequencies_is_infinite():
    types, values, pairs = parse("Se F, 1 j, I m 2, C k 1/98", "F -> j -> m, j -> k")
    analysis = Analysis(
        ("F",), (port("m.f"),), results=frozenset({"frequency_response"}), omega=np.linspace(1.0, 20.0, 7)
    )
    result = analyse(build(types, values, pairs), analysis)
    assert result["bond_graph/frequency_peaks/magnitude"].data.item() == math.inf
    assert result["bond_graph/frequency_peaks/omega"].data.item() == pytest.approx(7.0, rel=1e-14)
