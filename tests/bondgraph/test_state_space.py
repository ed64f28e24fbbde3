"""State equations and time responses, against the tableau and closed forms."""

import random
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph_state_space import state_space
from dynid.lti.signals import Impulse, Sine, Step
from tests.bondgraph.graphs import ISOLATOR, solvable, transfer, transfers, written
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at

pytestmark = pytest.mark.thorough

EPS = 2.0**-53


def value_and_bound(system, s):
    """Return C (s - A)^-1 B + D + D1 s + … and what rounding A, B, C, D to doubles can change in it."""
    n = len(system.A)
    resolvent = np.linalg.inv(s * np.eye(n) - system.A) if n else np.zeros((0, 0))
    value = system.C @ resolvent @ system.B
    R, B, C = abs(resolvent), abs(system.B), abs(system.C)
    bound = C @ R @ B + C @ R @ (s * np.eye(n) + abs(system.A)) @ R @ B
    for order, feedthrough in enumerate((system.D, *system.higher)):
        value = value + feedthrough * s**order
        bound = bound + abs(feedthrough) * s**order
    return value, 8 * (n + 2) * EPS * bound


def regular(seeds, junctions, loops, quantities="ef"):
    """Yield random graphs with a solution, with their seed's output replaced by e or f of an element."""
    for seed in seeds:
        rng = random.Random(seed)
        made = types, values, bonds, inputs, (node, quantity) = random_graph(
            rng, rng.randint(1, junctions), loops
        )
        if quantity not in quantities:
            continue
        graph = solvable(made)
        if graph is None:
            continue
        yield types, values, bonds, inputs, (node, quantity), graph


@pytest.mark.parametrize("count", [150, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("junctions", "loops", "quantities"), [(4, 0, "ef"), (7, 2, "ef"), (5, 4, "efqp")])
def test_the_transfer_function_of_the_state_equations_is_that_of_the_tableau(
    junctions, loops, quantities, count
):
    point = Fraction(5, 4)
    for *case, graph in regular(range(count), junctions, loops, quantities):
        expected = transfer_at(*case, point)
        if expected is None:
            continue
        value, bound = value_and_bound(state_space(graph), float(point))
        exact = np.array([[float(expected[source]) for source in graph.inputs]])
        assert (abs(value - exact) <= bound + 4 * EPS * abs(exact)).all()


@pytest.mark.parametrize("count", [150, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("junctions", "loops"), [(4, 0), (7, 2), (4, 4)])
def test_there_is_a_state_for_every_mode_and_no_other(junctions, loops, count):
    for *_, graph in regular(range(1000, 1000 + count), junctions, loops):
        result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"properties"})))
        channel, t = next(iter(transfers(graph).items()))
        hidden = result.value(f"bond_graph/properties/{channel[0]}/{channel[1]}/hidden_modes")
        assert len(state_space(graph).A) == t.order + len(hidden)


@pytest.mark.parametrize(("junctions", "loops"), [(4, 0), (6, 2)])
def test_the_eigenvalues_are_the_natural_modes(junctions, loops):
    for *_, graph in regular(range(2000, 2200), junctions, loops):
        result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"properties"})))
        channel, t = next(iter(transfers(graph).items()))
        hidden = result.value(f"bond_graph/properties/{channel[0]}/{channel[1]}/hidden_modes")
        modes = np.concatenate([hidden, [p.value for p in t.poles for _ in range(p.multiplicity)]])
        A = state_space(graph).A
        # the characteristic polynomial at a point away from the modes, as determinant and as product
        s = 2.0 * (1 + abs(modes).max(initial=0.0))
        assert np.linalg.det(s * np.eye(len(A)) - A) == pytest.approx(np.prod(s - modes).real, rel=1e-10)


def test_derivative_causality_leaves_one_state_for_two_masses():
    """Two inertias on one flow, one behind a lever."""
    graph = written(
        "Se u, 1 j, I m 3, TF n 2, 1 k, I q 5, R r 1", "u -> j -> m, j -> n -> k -> q, k -> r", "m.f"
    )
    system = state_space(graph)
    assert len(system.A) == 1
    assert system.A.tolist() == [[pytest.approx(-4 / 23, rel=1e-15)]]  # n^2 R / (m + n^2 q)


def test_without_storage_there_are_no_states():
    system = state_space(written("Se u, 1 j, R r 2, R q 3", "u -> j -> r, j -> q", "q.e"))
    assert system.A.shape == (0, 0)
    assert system.D.tolist() == [[0.6]]


def test_an_improper_output_has_matrices_on_the_derivatives_of_the_input():
    system = state_space(written("Sf u, 1 j, I m 3, R r 2", "u -> j -> m, j -> r", "u.e"))
    assert system.A.shape == (0, 0)
    assert system.D.tolist() == [[2.0]]
    assert [matrix.tolist() for matrix in system.higher] == [[[3.0]]]


# --- time ----------------------------------------------------------------------------------------


def inverse_laplace(numerator, denominator, times):
    """Invert a strictly proper rational function with simple poles, by residues at 50 digits."""
    with mpmath.workdps(50):
        top, bottom = ([mpmath.mpf(c.numerator) / c.denominator for c in p] for p in (numerator, denominator))
        poles = mpmath.polyroots(bottom, maxsteps=500, extraprec=500)
        slope = [c * (len(bottom) - 1 - k) for k, c in enumerate(bottom[:-1])]
        residues = [mpmath.polyval(top, p) / mpmath.polyval(slope, p) for p in poles]
        pairs = list(zip(residues, poles, strict=True))
        return np.array([float(mpmath.re(sum(r * mpmath.exp(p * t) for r, p in pairs))) for t in times])


def product(*polynomials):
    total = [Fraction(1)]
    for polynomial in polynomials:
        total = [
            sum(
                (total[i] * polynomial[k - i] for i in range(len(total)) if 0 <= k - i < len(polynomial)),
                Fraction(0),
            )
            for k in range(len(total) + len(polynomial) - 1)
        ]
    return total


def descending(polynomial):
    return [Fraction(int(c)) for c in reversed(polynomial.coeffs())]


def simulated(graph, times, signals, **initial):
    asked = Analysis(
        graph.inputs, graph.outputs, frozenset({"time_response"}), None, times, tuple(signals), initial
    )
    return analyse(graph.graph, asked).value("bond_graph/time_response/response")


TIMES = np.linspace(0, 3, 61)
NUMERATOR = [Fraction(2), Fraction(0), Fraction(10**4)]  # m_e s^2 + A_p^2/C_a
DENOMINATOR = [Fraction(12), Fraction(50), Fraction(10**4)]


def isolator():
    return written(*ISOLATOR, "m_s.f")


def test_the_isolators_step_response():
    expected = inverse_laplace(NUMERATOR, product(DENOMINATOR, [Fraction(1), Fraction(0)]), TIMES)
    found = simulated(isolator(), TIMES, [("v_in", Step())])[:, 0]
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


def test_the_isolators_response_to_a_sine_from_rest():
    top = [10 * c for c in NUMERATOR]
    expected = inverse_laplace(top, product(DENOMINATOR, [Fraction(1), Fraction(0), Fraction(100)]), TIMES)
    found = simulated(isolator(), TIMES, [("v_in", Sine(1.0, 10.0))])[:, 0]
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


def test_the_isolators_impulse_response_without_the_dirac_part():
    # T - T(inf), with T(inf) = 1/6: numerator - denominator / 6
    rest = [n - d / 6 for n, d in zip(NUMERATOR, DENOMINATOR, strict=True)][1:]
    expected = inverse_laplace(rest, DENOMINATOR, TIMES)
    found = simulated(isolator(), TIMES, [("v_in", Impulse())])[:, 0]
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


def test_the_isolators_free_motion_from_stored_energy():
    """Eqs 13 to 16: stored energy acts as an impulse: m_s f(0) on the body, C_a e(0) on the fluid."""
    flow = inverse_laplace([Fraction(10), Fraction(0)], DENOMINATOR, TIMES)  # m_s s / (…)
    found = simulated(isolator(), TIMES, [], m_s=0.1)[:, 0]
    assert np.abs(found - 0.1 * flow).max() <= 1e-13
    # e_C(0) = 1: a pressure 1/s in series with the fluid, seen by the body as the force A_p/s
    push = inverse_laplace([Fraction(1, 100)], DENOMINATOR, TIMES)
    found = simulated(isolator(), TIMES, [], C_a=1.0)[:, 0]
    assert np.abs(np.abs(found) - np.abs(push)).max() <= 1e-13 * np.abs(push).max()


def test_stored_energy_and_signals_superpose():
    both = simulated(isolator(), TIMES, [("v_in", Step()), ("v_in", Sine(2.0, 5.0))], m_s=0.1, C_a=3.0)
    alone = [
        simulated(isolator(), TIMES, [("v_in", Step())]),
        simulated(isolator(), TIMES, [("v_in", Sine(2.0, 5.0))]),
        simulated(isolator(), TIMES, [], m_s=0.1),
        simulated(isolator(), TIMES, [], C_a=3.0),
    ]
    assert np.abs(both - sum(alone)).max() <= 1e-13 * np.abs(both).max()


def test_a_compliance_on_an_effort_source_answers_with_the_derivative():
    graph = written("Se u, C c 3", "u -> c", "c.f")
    found = simulated(graph, TIMES, [("u", Sine(2.0, 5.0))])[:, 0]
    assert np.abs(found - 30 * np.cos(5 * TIMES)).max() <= 1e-13 * 30


def test_step_responses_of_random_graphs():
    times = np.linspace(0, 4, 9)
    checked = 0
    for *_, graph in regular(range(700, 1300), 6, 1):
        (output, source), t = next(iter(transfers(graph).items()))
        poles = t.poles
        simple = all(p.multiplicity == 1 and p.value != 0 for p in poles)
        if t.vanishes or t.relative_degree < 0 or not poles or not simple or not t.stable:
            continue
        checked += 1
        bottom = product(descending(t.denominator), [Fraction(1), Fraction(0)])
        expected = inverse_laplace(descending(t.numerator), bottom, times)
        found = simulated(graph, times, [(source, Step())])[:, 0]
        scale = max(np.abs(expected).max(), abs(t.dc_gain), abs(t.high_frequency_gain))
        # the rounding of A moves a pole of modulus |p| by about EPS |p|; over t that is EPS |p| t
        stiffness = 1 + max(abs(p.value) for p in poles) * times[-1]
        assert np.abs(found - expected).max() <= 1e-14 * stiffness * scale, output
    assert checked >= 20


def test_energy_is_conserved_without_resistances():
    nodes = "1 a, I m1 3, C k1 1/7, 0 b, C k2 1/5, TF n 3/2, 1 c, I m2 2, GY g 4"
    nodes += ", 0 d, C k3 1/2, 0 e, I m3 1, Sf u"
    bonds = "a -> m1, a -> k1, a -> b -> k2, b -> n -> c -> m2, c -> g -> d -> k3, d -> e -> m3, u -> e"
    graph = written(nodes, bonds, "m1.f", "k1.e", "k2.e", "m2.f", "k3.e", "m3.f")
    sizes = np.array([3, 1 / 7, 1 / 5, 2, 1 / 2, 1])
    found = simulated(graph, np.linspace(0, 50, 501), [], m1=0.3, k2=2.0, m3=-1.0)
    energy = found**2 @ sizes / 2
    stored = (3 * 0.3**2 + 2.0**2 / 5 + 1.0**2) / 2
    assert np.abs(energy - stored).max() <= 1e-12 * stored


def test_energy_put_into_dependent_storages_is_shared_as_momentum():
    """Two masses tied together, one of them moving: momentum is kept, energy is not (an inelastic impact)."""
    graph = written("Se u, 1 j, I m1 3, I m2 1", "u -> j -> m1, j -> m2", "m2.f")
    assert simulated(graph, np.array([0.0, 1.0]), [], m1=2.0)[:, 0].tolist() == pytest.approx([1.5, 1.5])


def test_a_displacement_is_the_integral_of_the_flow():
    graph = written("Se u, 1 j, R r 2, I m 1", "u -> j -> r, j -> m", "m.f", "m.q", "m.p")
    flow, displacement, momentum = simulated(graph, TIMES, [("u", Step())]).T
    assert flow == pytest.approx((1 - np.exp(-2 * TIMES)) / 2, abs=1e-14)
    assert displacement == pytest.approx(TIMES / 2 - (1 - np.exp(-2 * TIMES)) / 4, abs=1e-14)
    assert momentum == pytest.approx(flow, abs=1e-14)


def test_the_scene_gets_the_same_matrices():
    graph = isolator()
    asked = Analysis(graph.inputs, graph.outputs, frozenset({"state_space"}))
    result = analyse(graph.graph, asked)
    system = state_space(graph)
    for name in "ABCD":
        assert np.array_equal(result.value(f"bond_graph/state_space/{name}"), getattr(system, name))
    assert result.value("bond_graph/state_space/state").tolist() == list(system.states)


def test_the_direct_transfer_of_the_isolator_is_its_high_frequency_gain():
    system = state_space(isolator())
    assert system.D.item() == transfer(*ISOLATOR, "m_s.f").high_frequency_gain
