"""Loops cut open: random closed loops against python-control, delays against det(I + L)."""

import random
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import control
import numpy as np
import pytest

from dynid.bondgraph.controller_circuits import Loop, close_loops, pade
from dynid.bondgraph.cut_loops import CutLoops
from dynid.bondgraph.delayed_response import delayed_response
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.results.margin_results import add_margins
from dynid.errors import Singular
from dynid.lti.certified_roots import repeated
from dynid.lti.delay_stability import roots_right_of
from dynid.lti.margins import margins
from dynid.lti.quasi_polynomials import on_axis
from dynid.result import Result
from tests.bondgraph.graphs import build, port, transfers
from tests.sample import sample


class Chain:
    """Masses in a row on springs and dampers, tied to ground; forces at the first and the last."""

    def __init__(self, rng, size):
        self.size = size
        self.m, self.k, self.c = (
            [Fraction(rng.randint(1, 40), rng.choice([4, 10])) for _ in range(size)] for _ in range(3)
        )

    def graph(self):
        types, values, bonds = {"F1": "Se", "F2": "Se"}, {}, [("F1", "v0"), ("F2", f"v{self.size - 1}")]
        for i in range(self.size):
            types |= {f"v{i}": "1", f"m{i}": "I", f"z{i}": "1", f"k{i}": "C", f"c{i}": "R"}
            values |= {f"m{i}": self.m[i], f"k{i}": 1 / self.k[i], f"c{i}": self.c[i]}
            bonds += [(f"v{i}", f"m{i}"), (f"z{i}", f"k{i}"), (f"z{i}", f"c{i}")]
        for i, j in pairwise(range(self.size)):  # a link between two masses has their relative speed
            types[f"n{i}"] = "0"
            bonds += [(f"v{j}", f"n{i}"), (f"n{i}", f"z{j}"), (f"n{i}", f"v{i}")]
        bonds.append(("v0", "z0"))
        return build(types, values, bonds)

    def matrices(self):
        """Return A, B of states (positions, speeds) and forces, in doubles."""
        n = self.size
        difference = np.eye(n) - np.eye(n, k=-1)
        K, C = (difference.T @ np.diag([float(v) for v in part]) @ difference for part in (self.k, self.c))
        inverse = np.diag([1 / float(v) for v in self.m])
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
        force = np.zeros((n, 2))
        force[0, 0], force[-1, 1] = 1, 1
        return A, np.vstack([np.zeros((n, 2)), inverse @ force])

    def row(self, quantity, mass):
        row = np.zeros(2 * self.size)
        row[mass + (self.size if quantity == "f" else 0)] = 1
        return row


def random_controller(rng, quantity):
    # An integral of a speed is a displacement: the pole at 0 cancels.
    kind = rng.choice(["gain", "lead", "filter", *(["pi"] if quantity == "q" else [])])
    kp, ki, tf = (Fraction(rng.randint(1, 60), rng.choice([1, 7, 10])) for _ in range(3))
    return {
        "gain": ([kp], [Fraction(1)]),
        "pi": ([kp, ki], [Fraction(1), Fraction(0)]),
        "lead": ([kp * tf, kp], [tf / 20, Fraction(1)]),
        "filter": ([kp], [tf * tf, tf, Fraction(1)]),
    }[kind]


def system(loop):
    return control.tf(*([float(c) for c in part] for part in (loop.numerator, loop.denominator)))


@pytest.mark.parametrize("seed", sample(range(50), 20))
def test_random_closed_loops_are_those_of_python_control(seed):
    rng = random.Random(seed)
    chain = Chain(rng, rng.randint(1, 3))
    mass, quantity = rng.randrange(chain.size), rng.choice("fq")
    loop = Loop(port(f"m{mass}.{quantity}"), rng.choice(["F1", "F2"]), *random_controller(rng, quantity), "r")
    A, B = chain.matrices()
    own = B[:, [0 if loop.source == "F1" else 1]]
    plant = control.ss(A, own, chain.row(quantity, mass), 0)
    whole = control.series(plant, control.ss(system(loop)))
    expected = control.feedback(whole, 1).poles()
    closed = close_loops(chain.graph(), [loop])
    (channel,) = transfers(ReducedGraph(closed.graph, ["r"], [loop.measured])).values()
    found = repeated(channel.poles)
    distance = np.abs(found[:, None] - expected).min(axis=1)
    assert np.all(distance < 1e-6 * np.abs(expected).max())
    above, below = (part.terms[0] for part in CutLoops(chain.graph(), [loop]).loop(0))
    own_margins = margins(above, below)
    assert own_margins.stable == bool(np.all(expected.real < 0))
    assert own_margins.unstable_poles == np.count_nonzero(expected.real > 0)
    if own_margins.stable:
        modulus = control.stability_margins(whole)[2]
        gains, phases, _, _, crossings, _ = control.stability_margins(whole, returnall=True)
        lags, gains = np.mod(phases, 360), gains[(gains > 1) & (gains < 1e9)]
        assert own_margins.gain == pytest.approx(min(gains, default=np.inf), rel=1e-5)
        assert own_margins.phase == pytest.approx(min(lags, default=np.inf), abs=1e-4)
        assert own_margins.delay == pytest.approx(min(np.radians(lags) / crossings, default=np.inf), rel=1e-5)
        assert own_margins.modulus == pytest.approx(min(modulus, 1.0), rel=1e-5)
        assert own_margins.Ms == pytest.approx(
            control.system_norm(1 / (1 + control.tf(whole)), "inf"), rel=1e-3
        )


def turned(matrix, radius=1200.0):
    """Return the turns of det(I + L) times the open poles' polynomial along a half circle, by sampling."""
    arc = radius * np.exp(1j * np.linspace(-np.pi / 2, np.pi / 2, 6001))
    upper = np.concatenate([np.linspace(radius, 30, 8001)[:-1], np.geomspace(30, 1e-4, 6001)])
    values = matrix(np.concatenate([arc, 1j * upper, -1j * upper[::-1]]))
    return np.angle(values[1:] / values[:-1]).sum() / (2 * np.pi)


@pytest.mark.parametrize("seed", sample(range(12), 6))
def test_two_loops_with_delays_have_the_roots_of_their_determinant(seed):
    rng = random.Random(seed)
    chain = Chain(rng, 2)
    delays = [Fraction(rng.randint(1, 20), 20), Fraction(rng.choice([0, 7, 13]), 20)]
    other = rng.choice("fq")
    loops = [
        Loop(port("m0.f"), "F1", *random_controller(rng, "f"), "r", delays[0], setpoint="w0"),
        Loop(port(f"m1.{other}"), "F2", *random_controller(rng, other), delay=delays[1], setpoint="w1"),
    ]
    A, B = chain.matrices()
    C = np.vstack([chain.row(loop.measured.quantity, place) for place, loop in enumerate(loops)])

    def controllers(s, late=delays):
        parts = [
            np.polyval([float(c) for c in one.numerator], s)
            / np.polyval([float(c) for c in one.denominator], s)
            * np.exp(-s * float(tau))
            for one, tau in zip(loops, late, strict=True)
        ]
        return np.stack(parts, axis=-1)

    def plant(s):
        return C @ np.linalg.solve(s[:, None, None] * np.eye(4) - A, B.astype(complex)[None])

    def characteristic(s):
        open_poles = np.linalg.det(s[:, None, None] * np.eye(4) - A)
        for one in loops:
            open_poles = open_poles * np.polyval([float(c) for c in one.denominator], s)
        return np.linalg.det(np.eye(2) + plant(s) * controllers(s)[:, None, :]) * open_poles

    cut = CutLoops(chain.graph(), loops)
    cut.check()
    assert roots_right_of(cut.closed) == pytest.approx(turned(characteristic), abs=1e-3)
    # L of one loop with the other closed, on the axis.
    omega = np.array([0.3, 1.7, 9.1])
    whole = plant(1j * omega) * controllers(1j * omega)[:, None, :]
    for own, other in ((0, 1), (1, 0)):
        expected = whole[:, own, own] - whole[:, own, other] * whole[:, other, own] / (
            1 + whole[:, other, other]
        )
        np.testing.assert_allclose(on_axis(*cut.loop(own), omega), expected, rtol=1e-11)
    # The response from the reference, and from the setpoints, which are ahead of the controllers.
    sensitivity = np.linalg.inv(np.eye(2) + whole)
    outputs = [loop.measured for loop in loops]
    evaluate = delayed_response(chain.graph(), loops, ["r", "w0", "w1"], outputs)
    found = evaluate(omega)
    np.testing.assert_allclose(found[:, :, 0], (sensitivity @ plant(1j * omega))[:, :, 0], rtol=1e-9)
    np.testing.assert_allclose(found[:, :, 1:], sensitivity @ whole, rtol=1e-9)
    rest = evaluate(np.array([0.0]))[0]
    near = evaluate(np.array([1e-7]))[0]
    np.testing.assert_allclose(rest, near, atol=1e-5)


def test_a_delay_where_the_prompt_loop_has_a_pole_on_the_axis():
    """m s v = u - k e^(-sτ) q: without the delay it oscillates at sqrt(k/m)."""
    graph = build({"u": "Se", "j": "1", "m": "I"}, {"m": Fraction(1)}, [("u", "j"), ("j", "m")])
    loop = Loop(port("m.q"), "u", [Fraction(4)], [Fraction(1)], "r", Fraction(1, 10))
    found = delayed_response(graph, [loop], ["r"], [port("m.f")])(np.array([2.0, 3.0]))
    s = 1j * np.array([2.0, 3.0])
    np.testing.assert_allclose(found[:, 0, 0], s / (s**2 + 4 * np.exp(-0.1 * s)), rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 6])
def test_approximants_of_a_delay(order):
    """python-control has the same ones; an all-pass of size 1."""
    above, below = pade(Fraction(3, 10), order)
    expected = control.pade(0.3, order)
    for own, other in zip((above, below), expected, strict=True):
        np.testing.assert_allclose(
            [float(c / below[0]) for c in own], np.array(other) / expected[1][0], rtol=1e-12
        )


def test_algebraic_loops_without_a_solution_are_refused():
    """1 + L = 0 at high frequencies: alone, or of two loops together."""
    graph = build(
        {"u": "Se", "w": "Se", "j": "1", "r": "R", "m": "I"},
        {"r": Fraction(2), "m": Fraction(1)},
        [("u", "j"), ("w", "j"), ("j", "r"), ("j", "m")],
    )
    one = Loop(
        port("u.e"), "u", [Fraction(-1), Fraction(2)], [Fraction(1), Fraction(3)], place="control.loops.0"
    )
    with pytest.raises(Singular, match=r"the loop 'u\.e -> u' is algebraic") as raised:
        CutLoops(graph, [one]).check()
    assert raised.value.names == ("control.loops.0",)
    half = replace(one, numerator=[Fraction(-1, 2)], denominator=[Fraction(1)])
    both = [half, replace(half, place="control.loops.1")]
    with pytest.raises(Singular, match=r"the loops 'u\.e -> u', 'u\.e -> u' are algebraic"):
        CutLoops(graph, both).check()
    CutLoops(graph, [half]).check()
    CutLoops(graph, [replace(one, delay=Fraction(1))]).check()


def test_a_determinant_with_a_zero_in_the_first_place():
    """Two loops that only measure what the other one drives."""
    graph = build(
        {"u": "Se", "a": "1", "i": "I", "w": "Se", "b": "1", "k": "I", "r": "R"},
        {"i": Fraction(2), "k": Fraction(3), "r": Fraction(1)},
        [("u", "a"), ("a", "i"), ("w", "b"), ("b", "k"), ("b", "r")],
    )
    crossed = [
        Loop(port("k.f"), "u", [Fraction(5)], [Fraction(1)]),
        Loop(port("i.f"), "w", [Fraction(7)], [Fraction(1)]),
    ]
    cut = CutLoops(graph, crossed)
    s = 1j * np.array([0.5, 4.0])
    expected = -(35 / (2 * s) / (3 * s + 1))
    np.testing.assert_allclose(on_axis(*cut.loop(0), s.imag), expected, rtol=1e-13)


@pytest.mark.parametrize("delay", [Fraction(0), Fraction(1, 10)])
def test_a_cancelled_unstable_pole_makes_the_loops_unstable(delay):
    """The controller's zero hides the plant's pole at +1 from every transfer function."""
    graph = build({"u": "Se", "j": "1", "m": "I", "r": "R"}, {"m": Fraction(1), "r": Fraction(-1)},
                  [("u", "j"), ("j", "m"), ("j", "r")])  # fmt: skip
    loop = Loop(port("m.f"), "u", [Fraction(1), Fraction(-1)], [Fraction(1), Fraction(2)], "r", delay)
    result = Result("bond-graph")
    add_margins(result, CutLoops(graph, [loop]), np.array([1.0]))
    assert not result["bond_graph/margins/stable"].data[0]
    assert "cancelled" in str(result["bond_graph/margins/stability"].data[0])
    assert result["bond_graph/margins/unstable_poles"].data[0] == 1
    marginal = replace(loop, numerator=[Fraction(1)], denominator=[Fraction(1), Fraction(0)])
    graph = build({"u": "Se", "j": "1", "m": "I", "k": "C", "r": "R"}, dict.fromkeys("mkr", Fraction(1)),
                  [("u", "j"), ("j", "m"), ("j", "k"), ("j", "r")])  # fmt: skip
    result = Result("bond-graph")
    add_margins(result, CutLoops(graph, [marginal]), None)
    assert result["bond_graph/margins/stable"].data[0]
    assert "cancelled" in str(result["bond_graph/margins/stability"].data[0])


def locus(controller):
    """Return gains and poles of the root locus of 1/(s + 1) in a loop with a controller, gain by branch."""
    graph = build({"u": "Se", "j": "1", "m": "I", "r": "R"}, dict.fromkeys("mr", Fraction(1)),
                  [("u", "j"), ("j", "m"), ("j", "r")])  # fmt: skip
    parts = [[Fraction(c) for c in part] for part in controller]
    result = Result("bond-graph")
    add_margins(result, CutLoops(graph, [Loop(port("m.f"), "u", *parts)]), np.array([1.0]))
    group = "bond_graph/root_locus/loop_1"
    return result[f"{group}/gain"].data, result[f"{group}/poles"].data


#: Controllers beside 1/(s + 1), with the double poles of their loci and the gains there, by hand.
LOCI = [
    (([5], [1, 4]), [-2.5], [0.45]),  # (s + 1)(s + 4) + 5 k
    (([1, 3], [1, 0]), [-3 + 6**0.5, -3 - 6**0.5], [5 - 2 * 6**0.5, 5 + 2 * 6**0.5]),  # s^2 + s + k (s + 3)
    # (u^2 - 1) (u^2 + 4) + k with u = s + 2: two pairs meet off the real axis
    (([1], [1, 7, 20, 24]), [-2, -2 + 1.5**0.5 * 1j, -2 - 1.5**0.5 * 1j], [4, 6.25, 6.25]),
    (([2], [1, 1]), [], []),  # double at the gain 0
]


@pytest.mark.parametrize(("controller", "meeting", "at"), LOCI)
def test_branches_of_a_root_locus_meet_and_are_symmetric(controller, meeting, at):
    gains, poles = locus(controller)
    assert np.all(np.diff(gains) > 0)
    for root, gain in zip(meeting, at, strict=True):
        place = np.abs(gains - gain).argmin()
        assert gains[place] == pytest.approx(gain, rel=1e-15)
        assert np.count_nonzero(np.abs(poles[place] - root) < 1e-6) == 2
    # Every step of a branch has its mirror image.
    steps = np.stack([poles[:-1], poles[1:]], axis=-1)
    for at_gain in steps:
        distance = np.abs(at_gain[:, None] - at_gain.conj()[None]).max(axis=-1)
        assert np.all(distance.min(axis=1) < 1e-6 * (1 + np.abs(at_gain).max()))
