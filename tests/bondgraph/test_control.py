"""Feedback around bond graphs, against the tableau of the open graph and against python-control."""

import math
import random
from fractions import Fraction

import control
import numpy as np
import pytest
import sympy
from flint import fmpz_poly

from dynid.bondgraph.controller_circuits import Loop, close_loops
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular, UsageError
from dynid.lti.margins import margins
from tests.bondgraph.graphs import at, build, port, transfers
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfers_at
from tests.sample import sample

S = Fraction(7, 5)


def rational(number):
    return sympy.Rational(number.numerator, number.denominator)


def answer(loop):
    """Return the controller at S, or None at a pole."""
    top, bottom = (
        sum(c * S**k for k, c in enumerate(reversed(part))) for part in (loop.numerator, loop.denominator)
    )
    return top / bottom if bottom else None


def random_loops(rng, types):
    variables = [name for name, kind in types.items() if kind not in ("TF", "GY")]
    sources = [name for name, kind in types.items() if kind in ("Se", "Sf")]
    loops = []
    for number in range(rng.choice([1, 1, 2, 3])):
        node = rng.choice(variables)
        quantity = {"0": rng.choice("ep"), "1": rng.choice("fq")}.get(types[node]) or rng.choice("efqp")
        bottom = [
            Fraction(rng.choice([-4, -1, 1, 3, 9]), rng.randint(1, 5)) for _ in range(rng.randint(1, 4))
        ]
        top = [
            Fraction(rng.randint(-9, 9), rng.randint(1, 5)) for _ in range(rng.randint(1, len(bottom) + 1))
        ]
        if any(top):
            setpoint = rng.choice(["", f"w{number}"])
            loops.append(
                Loop(
                    port(f"{node}.{quantity}"),
                    rng.choice(sources),
                    top,
                    bottom,
                    f"r{number}",
                    setpoint=setpoint,
                )
            )
    return loops


@pytest.mark.parametrize("seed", sample(range(120), 40))
def test_random_closed_loops_solve_the_equations_of_the_open_graph(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 6), rng.choice([0, 1, 2]))
    loops = random_loops(rng, types)
    measured = [(loop.measured.node, loop.measured.quantity) for loop in loops]
    driven = [loop.source for loop in loops]
    open_graph = transfers_at(
        types, values, bonds, [*dict.fromkeys([*inputs, *driven])], [output, *measured], S
    )
    gains = [answer(loop) for loop in loops]
    if not loops or open_graph is None or None in gains:
        return
    names = [".".join(one) for one in measured]
    system = sympy.Matrix(
        len(loops),
        len(loops),
        lambda i, j: int(i == j) + rational(open_graph[names[i], driven[j]] * gains[j]),
    )
    if system.det() == 0:
        return
    closed = close_loops(build(types, values, bonds), loops)
    # What acts at a driven source: a reference as it is, a setpoint times the controller.
    acting = {loop.reference: (loop.source, Fraction(1)) for loop in loops}
    acting |= {
        loop.setpoint: (loop.source, gain) for loop, gain in zip(loops, gains, strict=True) if loop.setpoint
    }
    sources = [name for name in inputs if name not in driven] + [*acting]
    wanted = closed.variables.get(port(".".join(output)), port(".".join(output)))
    found = transfers(ReducedGraph(closed.graph, sources, [wanted]))
    for source in sources:
        by, factor = acting.get(source, (source, Fraction(1)))
        signals = system.LUsolve(sympy.Matrix([rational(open_graph[name, by]) for name in names]))
        expected = rational(open_graph[".".join(output), by]) - sum(
            rational(open_graph[".".join(output), own] * gain) * signal
            for own, gain, signal in zip(driven, gains, signals, strict=True)
        )
        assert rational(at(found[str(wanted), source], S)) == expected * rational(factor)


def stable_plant(rng):
    """Return numerator and denominator of a strictly proper stable plant, in descending powers."""
    bottom = fmpz_poly([1])
    for _ in range(rng.randint(1, 4)):
        real = rng.random() < 0.6
        bottom *= fmpz_poly([rng.randint(1, 40), rng.randint(1, 5), rng.randint(1, 4)][: 2 if real else 3])
    top = fmpz_poly([rng.randint(1, 200)])
    for _ in range(rng.randint(0, min(2, bottom.degree() - 1))):
        top *= fmpz_poly([rng.randint(1, 20), rng.randint(1, 8)])
    return top, bottom


@pytest.mark.parametrize("seed", sample(range(120), 40))
def test_margins_are_those_of_python_control(seed):
    top, bottom = stable_plant(random.Random(seed))
    loop = control.tf(*([int(c) for c in part.coeffs()][::-1] for part in (top, bottom)))
    if any(control.feedback(loop, 1).poles().real >= 0):
        return
    found = margins(top, bottom)
    gain, _, modulus, at_gain, _, _ = control.stability_margins(loop)
    # python-control finds its crossings as roots of polynomials in double precision.
    assert found.gain == pytest.approx(gain, rel=1e-6)
    if math.isfinite(gain):
        assert found.phase_crossover == pytest.approx(at_gain, rel=1e-6)
    # Of several crossings python-control reports the least turn to either side; a lag is what delays.
    _, phases, _, _, crossings, _ = control.stability_margins(loop, returnall=True)
    lags = np.mod(phases, 360)
    assert found.phase == pytest.approx(min(lags, default=math.inf), abs=1e-5)
    delays = np.radians(lags) / crossings
    assert found.delay == pytest.approx(min(delays, default=math.inf), rel=1e-6)
    assert found.modulus == pytest.approx(min(modulus, 1.0), rel=1e-6)


def test_margins_of_a_double_integrator_with_lead():
    """L = K (s + 1)/s^2: |L| = 1 where ω^4 = K^2 (ω^2 + 1), a phase margin of arctan ω, no gain limits it."""
    found = margins(fmpz_poly([3, 3]), fmpz_poly([0, 0, 1]))
    omega = math.sqrt((9 + math.sqrt(81 + 36)) / 2)
    assert found.gain == math.inf
    assert found.gain_crossover == pytest.approx(omega, rel=1e-14)
    assert found.phase == pytest.approx(math.degrees(math.atan(omega)), rel=1e-13)
    assert found.delay == pytest.approx(math.atan(omega) / omega, rel=1e-13)


@pytest.mark.parametrize(
    ("top", "bottom"), [([1], [1, 0, 1]), ([1, 1], [1, 0, 1]), ([1, 1], [2, 1, 2, 1]), ([3], [4, 0, 5, 0, 1])]
)
def test_loops_with_undamped_poles_have_margins(top, bottom):
    """At a pole on the axis L is infinite: no crossing is there."""
    found = margins(fmpz_poly(top), fmpz_poly(bottom))
    assert math.isfinite(found.modulus)
    assert found.gain == math.inf


def test_a_loop_at_its_limit_has_a_gain_margin_of_1():
    """L = 2/(s (s + 1)^2) at ω = 1."""
    found = margins(fmpz_poly([2]), fmpz_poly([0, 1, 2, 1]))
    assert not found.stable
    assert found.gain == pytest.approx(1, abs=1e-12)
    assert found.phase == pytest.approx(0, abs=1e-6)
    assert found.modulus == pytest.approx(0, abs=1e-12)


def test_a_conditionally_stable_loop_has_two_gain_margins():
    """L = K (s + 1)^2/s^3 is stable above K = 1/2 only."""
    found = margins(fmpz_poly([2, 4, 2]), fmpz_poly([0, 0, 0, 1]))
    assert found.gain == math.inf
    assert found.gain_reduction == pytest.approx(0.25, rel=1e-13)
    assert found.phase_crossover == pytest.approx(1.0, rel=1e-13)


def test_a_controller_that_differentiates_twice_is_refused():
    graph = build({"u": "Se", "j": "1", "m": "I"}, {"m": Fraction(1)}, [("u", "j"), ("j", "m")])
    with pytest.raises(UsageError, match="differentiates 2 times"):
        close_loops(graph, [Loop(port("j.q"), "u", [Fraction(1), 0, 0], [Fraction(1)])])


def test_a_loop_without_a_solution_is_refused():
    """u = -(-1) e of the same junction: 1 + L is zero for every s."""
    graph = build({"u": "Se", "j": "1", "r": "R"}, {"r": Fraction(2)}, [("u", "j"), ("j", "r")])
    closed = close_loops(graph, [Loop(port("r.e"), "u", [Fraction(-1)], [Fraction(1)], "ref")])
    with pytest.raises(Singular):
        ReducedGraph(closed.graph, ["ref"], [port("r.f")])


def test_states_of_a_closed_loop_move_as_its_matrices():
    """A mass with a PI controller of its speed, and a disturbing force."""
    m, b, kp, ki = Fraction(2), Fraction(1), Fraction(6), Fraction(5)
    graph = build(
        {"u": "Se", "d": "Se", "j": "1", "m": "I", "b": "R"},
        {"m": m, "b": b},
        [("u", "j"), ("d", "j"), ("j", "m"), ("j", "b")],
    )
    closed = close_loops(graph, [Loop(port("m.f"), "u", [kp, ki], [Fraction(1), Fraction(0)], "r")])
    channels = transfers(ReducedGraph(closed.graph, ["d", "r"], [port("m.f")]))
    expected = control.tf([1, 0], [2, 7, 5])
    for channel in channels.values():
        top, bottom = channel.coefficients()
        np.testing.assert_allclose(top, expected.num[0][0] / 2, rtol=1e-15)
        np.testing.assert_allclose(bottom, np.array([2, 7, 5]) / 2, rtol=1e-15)
