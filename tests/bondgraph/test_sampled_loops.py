"""Sampled controllers, against the eigenvalues of closed-loop matrices that SciPy's exponentials make."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from scipy.linalg import expm

from dynid.bondgraph.controller_circuits import Loop, Sampling
from dynid.bondgraph.graph import Bond, BondGraph, Node
from dynid.bondgraph.sampled_loops import SampledLoops
from dynid.bondgraph.sampled_response import sampled_response
from dynid.errors import UsageError
from tests.bondgraph.graphs import port
from tests.bondgraph.sampled_loops import (
    closed_matrix,
    held,
    loop_gain,
    pi_loop,
    random_chain,
    random_pi,
    random_sampling,
)
from tests.sample import sample


def build(nodes, bonds):
    """Return a graph from texts: `m:I=1 j:1` and `F->j j->m`."""
    typed = [text.partition(":")[::2] for text in nodes.split()]
    parts = [(name, *kind.partition("=")[::2]) for name, kind in typed]
    return BondGraph(
        [Node(name, kind, Fraction(value) if value else None) for name, kind, value in parts],
        [Bond(*text.split("->")) for text in bonds.split()],
    )


_SEEDS = sample(range(500), 20)


def drawn(seed):
    """Return a chain, gains and a sampling, and the loops."""
    rng = np.random.default_rng(seed)
    chain, (kp, ki), sampling = random_chain(rng), random_pi(rng), random_sampling(rng)
    return chain, kp, ki, sampling, SampledLoops(chain.graph(), [pi_loop(chain, kp, ki, sampling)])


def radius(chain, kp, ki, sampling, factor=1.0):
    matrix = closed_matrix(chain, float(kp) * factor, float(ki) * factor, sampling)
    return np.abs(np.linalg.eigvals(matrix)).max()


@pytest.mark.parametrize("seed", _SEEDS)
def test_the_verdict_is_that_of_the_eigenvalues(seed):
    chain, kp, ki, sampling, loops = drawn(seed)
    values = np.linalg.eigvals(closed_matrix(chain, float(kp), float(ki), sampling))
    outside = (np.abs(values) > 1 + 1e-9).sum()
    rest = np.abs(values - 1).min() < 1e-9  # an integral of a velocity that has a zero at 0
    assert (np.abs(np.abs(values) - 1) < 1e-9).sum() == rest
    assert loops.verdict.kind == ("unstable" if outside else "marginal" if rest else "stable")
    assert loops.verdict.unstable_poles == outside
    poles = np.array([pole.value for pole in loops.poles for _ in range(pole.multiplicity)])
    assert len(poles) == len(values)
    assert np.abs(np.poly(poles) - np.poly(values)).max() < 1e-10 * np.abs(np.poly(values)).max()


@pytest.mark.parametrize("seed", _SEEDS)
def test_margins_are_the_changes_that_make_it_unstable(seed):
    chain, kp, ki, sampling, loops = drawn(seed)
    if not loops.verdict.stable:
        return
    margin = loops.margins(0)
    step = 1e-6
    if np.isfinite(margin.gain):
        assert radius(chain, kp, ki, sampling, margin.gain * (1 - step)) < 1
        assert radius(chain, kp, ki, sampling, margin.gain * (1 + step)) > 1
    else:
        assert radius(chain, kp, ki, sampling, 1e4) < 1
    if margin.gain_reduction:
        assert radius(chain, kp, ki, sampling, margin.gain_reduction * (1 + step)) < 1
        assert radius(chain, kp, ki, sampling, margin.gain_reduction * (1 - step)) > 1
    grid = np.linspace(1e-3, np.pi, 4000) / float(sampling.period)
    values = np.array([loop_gain(chain, float(kp), float(ki), sampling, omega) for omega in grid[::20]])
    if np.isfinite(margin.phase):
        value = loop_gain(chain, float(kp), float(ki), sampling, margin.gain_crossover)
        assert abs(value) == pytest.approx(1, rel=1e-9)
        assert np.degrees(np.angle(-value)) % 360 == pytest.approx(margin.phase, abs=1e-6)
    else:
        assert (np.abs(values) < 1).all()
    assert 1 / np.abs(1 + values).min() <= margin.Ms * (1 + 1e-9)
    at = loop_gain(chain, float(kp), float(ki), sampling, margin.modulus_at)
    assert 1 / abs(1 + at) == pytest.approx(margin.Ms, rel=1e-8)


@pytest.mark.parametrize("seed", sample(range(60), 6))
def test_the_delay_margin_is_the_further_computation_time_that_makes_it_unstable(seed):
    chain, kp, ki, sampling, loops = drawn(seed)
    if not loops.verdict.stable or not np.isfinite(delay := loops.margins(0).delay):
        return
    for factor, stable in ((1 - 1e-7, True), (1 + 1e-7, False), (0.5, True)):
        later = replace(sampling, computation=sampling.computation + Fraction(delay * factor))
        assert (radius(chain, kp, ki, later) < 1) == stable


@pytest.mark.parametrize("seed", sample(range(60), 6))
def test_the_largest_sample_time_is_where_stability_ends(seed):
    chain, kp, ki, sampling, loops = drawn(seed)
    largest = loops.largest_sample_time
    if not np.isfinite(largest):
        return
    for factor, stable in ((1 - 1e-7, True), (1 + 1e-7, False)):
        changed = replace(sampling, period=Fraction(largest * factor))
        assert (radius(chain, kp, ki, changed) < 1) == stable


def lag(gain, sampling, method="tustin"):
    """Return a loop of a gain around 1/(s + 1): a mass of 1 kg with a damper of 1 N s/m."""
    graph = build("F:Se j:1 m:I=1 b:R=1", "F->j j->m j->b")
    return SampledLoops(
        graph, [Loop(port("m.f"), "F", [gain], [Fraction(1)], sampling=replace(sampling, method=method))]
    )


def test_a_gain_at_its_limit_is_decided_to_sixty_digits():
    with ctx.workprec(400):
        mantissa, exponent = ((1 + arb(-1).exp()) / (1 - arb(-1).exp())).mid().man_exp()
    critical = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    for digits in (6, 20, 60):
        change = Fraction(1, 10**digits)
        assert lag(critical * (1 - change), Sampling(Fraction(1))).verdict.stable
        assert lag(critical * (1 + change), Sampling(Fraction(1))).verdict.kind == "unstable"


@pytest.mark.parametrize("method", ["tustin", "backward", "zoh", "z"])
def test_an_integral_of_what_has_a_zero_at_rest_is_marginal(method):
    # PI on the velocity of a mass on a spring: the integral is the displacement, which rests where it is
    graph = build("F:Se j:1 m:I=1 b:R=3 k:C=1/2", "F->j j->m j->b j->k")
    numerator = [Fraction(1), Fraction(-1, 2) if method == "z" else Fraction(1)]
    denominator = [Fraction(1), Fraction(-1) if method == "z" else Fraction(0)]
    sampling = Sampling(Fraction(1, 5), Fraction(1, 20), method)
    loops = SampledLoops(graph, [Loop(port("m.f"), "F", numerator, denominator, sampling=sampling)])
    assert loops.verdict.kind == "marginal"
    assert loops.verdict.unstable_poles == 0
    assert np.isnan(loops.largest_sample_time)
    doubled = replace(loops.loops[0], measured=port("k.q"))
    assert SampledLoops(graph, [doubled]).verdict.stable


def test_a_pole_on_the_circle_is_at_the_limit():
    graph = build("F:Se j:1 m:I=1", "F->j j->m")  # 1/s, K = 2/T: z = -1
    loops = SampledLoops(
        graph, [Loop(port("m.f"), "F", [Fraction(2)], [Fraction(1)], sampling=Sampling(Fraction(1)))]
    )
    assert loops.verdict.kind == "at the limit"
    assert "z = -1" in loops.verdict.reason
    assert not loops.verdict.stable


@pytest.mark.parametrize("method", ["tustin", "backward"])
def test_coefficients_in_z_are_those_of_the_method(method):
    chain, kp, ki, sampling, _ = drawn(7)
    T = sampling.period
    numerator = {"tustin": [kp + ki * T / 2, -kp + ki * T / 2], "backward": [kp + ki * T, -kp]}[method]
    loop = pi_loop(chain, kp, ki or Fraction(1), sampling)
    ki = ki or Fraction(1)
    numerator = {"tustin": [kp + ki * T / 2, -kp + ki * T / 2], "backward": [kp + ki * T, -kp]}[method]
    in_z = replace(
        loop,
        numerator=numerator,
        denominator=[Fraction(1), Fraction(-1)],
        sampling=replace(sampling, method="z"),
    )
    first, second = (
        SampledLoops(chain.graph(), [replace(loop, sampling=replace(sampling, method=method))]),
        SampledLoops(chain.graph(), [in_z]),
    )
    assert [pole.value for pole in first.poles] == [pole.value for pole in second.poles]


def test_a_held_controller_has_the_exponential_of_its_pole():
    # K = 1/(s + 2) held: (1 - e^-2T)/2 /(z - e^-2T), around 1/(s + 1)
    T = 0.5
    loops = lag(Fraction(1), Sampling(Fraction(1, 2)))
    loop = replace(
        loops.loops[0],
        denominator=[Fraction(1), Fraction(2)],
        sampling=Sampling(Fraction(1, 2), method="zoh"),
    )
    poles = np.array([pole.value for pole in SampledLoops(loops.opened, [loop]).poles])
    p, c = np.exp(-T), np.exp(-2 * T)
    expected = np.roots([1, -(p + c), p * c + (1 - p) * (1 - c) / 2])
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(expected), abs=1e-13)


def test_a_mode_that_no_loop_moves_counts():
    graph = build("F:Se j:1 m:I=1 b:R=1 G:Se i:1 n:I=1 r:R=-1", "F->j j->m j->b G->i i->n i->r")
    loop = Loop(port("m.f"), "F", [Fraction(1)], [Fraction(1)], sampling=Sampling(Fraction(1, 10)))
    assert SampledLoops(graph, [loop]).verdict.kind == "unstable"


def test_the_integral_that_measures_beside_a_spring_is_no_mode():
    graph = build("F:Se j:1 m:I=1 b:R=1 k:C=1", "F->j j->m j->b j->k")
    loop = Loop(port("m.q"), "F", [Fraction(1)], [Fraction(1)], sampling=Sampling(Fraction(1, 10)))
    loops = SampledLoops(graph, [loop])
    assert loops.verdict.stable
    assert len(loops.poles) == 2


def test_two_loops_are_closed_together():
    # two masses on one spring, a force and a gain at each: M from its exponentials
    graph = build(
        "F:Se a:1 m:I=1 G:Se b:1 n:I=2 o:0 d:1 k:C=1/4 r:R=1/2",
        "F->a a->m a->o o->d d->k d->r o->b b->n G->b",
    )
    T, delay = 0.2, 0.05
    first = Loop(
        port("m.f"), "F", [Fraction(2)], [Fraction(1)], sampling=Sampling(Fraction(1, 5), Fraction(1, 20))
    )
    second = Loop(port("n.f"), "G", [Fraction(3)], [Fraction(1)], sampling=Sampling(Fraction(1, 5)))
    A = np.array([[-0.5, 0.5, -4], [0.25, -0.25, 2], [1, -1, 0]])  # speeds, the spring's displacement
    B = np.array([[1, 0], [0, 0.5], [0, 0]])
    Phi, whole = held(A, B[:, 1], T)
    P, late = held(A, B[:, 0], T - delay)
    early = P @ held(A, B[:, 0], delay)[1]
    M = np.zeros((4, 4))
    M[:3, :3] = Phi - np.outer(whole, [0, 3, 0]) - np.outer(late, [2, 0, 0])
    M[:3, 3], M[3, 0] = early, -2
    poles = np.array([pole.value for pole in SampledLoops(graph, [first, second]).poles])
    assert np.poly(poles) == pytest.approx(np.poly(np.linalg.eigvals(M)), abs=1e-12)


def test_what_jumps_with_its_source_is_measured_before():
    # flow of R under Se: y = u/R; u[k] = -K u[k-1]/R
    graph = build("F:Se j:1 r:R=2 m:I=1", "F->j j->r j->m")
    loop = Loop(port("m.e"), "F", [Fraction(3, 10)], [Fraction(1)], sampling=Sampling(Fraction(1, 10)))
    loops = SampledLoops(graph, [loop])  # m.e = u - 2 v, v' = u - 2 v
    a = np.exp(-0.2)
    # x = v, u before: u[k] = -0.3 (u[k-1] - 2 v[k])
    M = np.array([[a + (1 - a) / 2 * 0.6, -(1 - a) / 2 * 0.3], [0.6, -0.3]])
    poles = np.sort_complex([pole.value for pole in loops.poles])
    assert poles == pytest.approx(np.sort_complex(np.linalg.eigvals(M).astype(complex)), abs=1e-12)


def test_what_follows_the_rate_of_a_held_source_is_not_measured():
    graph = build("F:Sf j:1 m:I=1", "F->j j->m")
    loop = Loop(port("m.e"), "F", [Fraction(1)], [Fraction(1)], sampling=Sampling(Fraction(1, 10)))
    with pytest.raises(UsageError, match="follows the rate of what a sampled controller holds"):
        SampledLoops(graph, [loop])


def test_sampling_near_half_a_period_of_a_mode_is_warned_of():
    graph = build("F:Se j:1 m:I=1 k:C=1", "F->j j->m j->k")  # 1 rad/s
    loop = Loop(
        port("m.f"), "F", [Fraction(1, 2)], [Fraction(1)], sampling=Sampling(Fraction(314159, 100000))
    )
    assert len(SampledLoops(graph, [loop]).confused_modes()) == 1
    usual = replace(loop, sampling=Sampling(Fraction(1)))
    assert not SampledLoops(graph, [usual]).confused_modes()


def fundamental(A, b, c, kp, ki, T, omega):
    """Return the part at ω of the answer to a force exp(jωt) at the input, from a lifted steady state."""
    n = len(A)
    z = np.exp(1j * omega * T)
    Phi, gain = held(A, b, T)
    J = np.zeros((n + 1, n + 1), complex)
    J[:n, :n], J[:n, n], J[n, n] = A, b, 1j * omega
    forced = expm(J * T)[:n, n]
    K = kp + (ki * T / 2 * (z + 1) / (z - 1) if ki else 0)
    x = np.linalg.solve(z * np.eye(n) - Phi + np.outer(gain, c) * K, forced)
    u = -K * (c @ x)
    # x̂ over a period: (1/T) ∫ x exp(-jωt) dt by an integral as a further state
    big = np.zeros((n + 3, n + 3), complex)
    big[:n, :n], big[:n, n], big[:n, n + 1] = A - 1j * omega * np.eye(n), b, b
    big[n + 1, n + 1] = -1j * omega  # u exp(-jωt); the force itself is constant
    big[n + 2, :n] = c / T
    return (expm(big * T) @ np.concatenate([x, [1.0, u, 0.0]]))[n + 2]


@pytest.mark.parametrize("omega", [0.3, 2.0, 9.0])
def test_the_fundamental_response_is_that_of_the_steady_state(omega):
    graph = build("F:Se j:1 m:I=1 b:R=3 k:C=1/2", "F->j j->m j->b j->k")
    T = Fraction(1, 5)
    loop = Loop(
        port("k.q"),
        "F",
        [Fraction(3, 2), Fraction(1)],
        [Fraction(1), Fraction(0)],
        reference="d",
        sampling=Sampling(T),
    )
    evaluate = sampled_response(SampledLoops(graph, [loop]), ["d"], [port("k.q")])
    A, b, c = np.array([[-3.0, -2.0], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    expected = fundamental(A, b, c, 1.5, 1.0, 0.2, omega)
    assert evaluate(np.array([omega]))[0, 0, 0] == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("omega", [0.0, 2.0])
def test_the_response_is_finite_where_the_graph_alone_has_a_pole(omega):
    # undamped at 2 rad/s, a free mass at 0: closed by a PI on its velocity
    spec = ("F:Se j:1 m:I=1 k:C=1/4", "F->j j->m j->k") if omega else ("F:Se j:1 m:I=1", "F->j j->m")
    loop = Loop(
        port("m.f"), "F", [Fraction(1)], [Fraction(1)], reference="d", sampling=Sampling(Fraction(1, 5))
    )
    loops = SampledLoops(build(*spec), [loop])
    assert loops.verdict.stable
    value = sampled_response(loops, ["d"], [port("m.f")])(np.array([omega]))[0, 0, 0]
    A, b, c = (
        (np.array([[0.0, -4.0], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([1.0, 0.0]))
        if omega
        else (np.zeros((1, 1)), np.ones(1), np.ones(1))
    )
    assert value == pytest.approx(fundamental(A, b, c, 1.0, 0.0, 0.2, omega), rel=1e-11)
