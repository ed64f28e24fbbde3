"""Designs: roots where they are wanted and least norms, against closed forms, grids and mpmath."""

from fractions import Fraction
from itertools import pairwise
from math import pi, sqrt

import mpmath
import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.bondgraph.design.design_request import Criterion, Design, RootTarget
from dynid.bondgraph.design.functions import DesignFunctions
from dynid.bondgraph.design.quadratic import quadratic_program
from dynid.bondgraph.design.solve import solve
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.errors import Unreachable
from dynid.parameters import Parameter

pytestmark = pytest.mark.thorough


def graph(elements, chains):
    nodes = []
    for name, kind, *value in elements:
        number = value[0] if value else None
        if isinstance(number, Dependent):
            nodes.append(Node(name, kind, Fraction(number.reference), dependent=number))
        else:
            nodes.append(Node(name, kind, None if number is None else Fraction(number)))
    ends = [chain.split() for chain in chains]
    return BondGraph(nodes, [Bond(a, b) for one in ends for a, b in pairwise(one)])


def free(name, value):
    return Dependent.parameter(name, Fraction(value).limit_denominator(10**6))


def absorber(mu):
    """Return an undamped mass with an absorber: mass ratio mu, frequency ratio f, z = c/(2 m Omega)."""
    f, z, m = free("f", 0.9), free("z", 0.2), Fraction(mu)
    elements = [("F", "Se"), ("body", "1"), ("M", "I", 1), ("K", "C", 1), ("link", "0"), ("own", "1")]
    elements += [("m", "I", m), ("strut", "1"), ("k", "C", 1 / (m * f * f)), ("c", "R", 2 * m * z)]
    return graph(elements, ["F body M", "body K", "body link own m", "link strut k", "strut c"])


F, Z = Parameter("f", 0.9, low=0.3, high=2.0), Parameter("z", 0.2, low=1e-3, high=2.0)
X, V = Port("K", "q"), Port("M", "f")


def designed(targets, *parameters, mu=Fraction(1, 10), starts=1, **options):
    return solve(Design(absorber(mu), parameters or (F, Z), tuple(targets), starts, **options))


def exact_peak(mu):
    """Return f, z and the peak of the optimum (Nishihara & Asami, J. Vib. Acoust. 124, 2002)."""
    r = sqrt(4 + 3 * mu)
    f = (
        2
        / (1 + mu)
        * sqrt(2 * (16 + 23 * mu + 9 * mu**2 + 2 * (2 + mu) * r) / (3 * (64 + 80 * mu + 27 * mu**2)))
    )
    zeta = sqrt((8 + 9 * mu - 4 * r) / (1 + mu)) / 4
    peak = sqrt(((8 + 9 * mu) ** 2 * (16 + 9 * mu) - 128 * r**3) / (3 * (32 + 27 * mu))) / (3 * mu)
    return f, zeta * f, peak


@pytest.mark.parametrize("mu", ["1/10", "1/50", "1/2", "31/1000", "33/1000"])
def test_the_least_peak_of_an_absorber_is_that_of_the_closed_form(mu):
    found = designed([Criterion("hinf", X, "F")], mu=Fraction(mu))
    f, z, peak = exact_peak(float(Fraction(mu)))
    assert found.values == pytest.approx({"f": f, "z": z}, rel=1e-11)
    assert found.solution.objective == pytest.approx(peak, rel=1e-12)
    assert found.solution.conditions.verified
    assert found.solution.conditions.active == 2


def test_the_least_h2_norm_of_an_absorber_is_that_of_the_closed_form():
    found, mu = designed([Criterion("h2", X, "F")]), 0.1
    f = sqrt(1 + mu / 2) / (1 + mu)  # Asami, Wakasono, Kameoka, Hasegawa, Sekiguchi, JSME 1991
    zeta = sqrt(mu * (4 + 3 * mu) / (8 * (1 + mu) * (2 + mu)))
    assert found.values == pytest.approx({"f": f, "z": zeta * f}, rel=1e-9)
    assert found.solution.conditions.verified


def compliance(f, z, omega, mu=0.1):
    s = 1j * omega
    k, c = mu * f * f, 2 * mu * z
    strut = k + c * s
    return (mu * s**2 + strut) / ((s**2 + 1 + strut) * (mu * s**2 + strut) - strut**2)


def test_no_point_of_a_grid_has_a_lower_peak_in_a_band():
    found = designed([Criterion("peak", X, "F", 0.5, 0.9)], starts=4)
    omega = np.linspace(0.5, 0.9, 4001)
    f, z = np.meshgrid(np.linspace(0.6, 1.2, 61), np.linspace(0.02, 0.4, 58), indexing="ij")
    peaks = np.abs(compliance(f[..., None], z[..., None], omega[::10])).max(axis=-1)
    assert found.solution.conditions.verified
    assert found.solution.objective < peaks.min() < 1.05 * found.solution.objective
    own = np.abs(compliance(*found.values.values(), omega)).max()
    assert own == pytest.approx(found.solution.objective, rel=1e-6)


def test_a_sum_of_norms_has_the_least_value_of_all_neighbours():
    criteria = [Criterion("hinf", V, "F"), Criterion("h2", X, "F", weight=2.0)]
    found = designed(criteria)
    functions, best = found.functions, found.solution
    assert best.conditions.verified
    assert best.objective == pytest.approx(
        best.evaluation.norms[0].value + 2 * best.evaluation.norms[1].value
    )
    rng = np.random.default_rng(0)
    for step in rng.normal(size=(20, 2)) * 1e-3:
        near = functions.at(best.evaluation.eta + step)
        assert near.norms[0].value + 2 * near.norms[1].value > best.objective


def test_a_limit_is_active():
    limited = Parameter("z", 0.05, low=1e-3, high=0.1)
    found = designed([Criterion("hinf", X, "F")], F, limited)
    assert found.values["z"] == 0.1
    assert found.solution.conditions.verified
    f = np.linspace(0.9, 0.94, 801)
    grid = np.abs(compliance(f[:, None], 0.1, np.linspace(0.7, 1.2, 801))).max(axis=1)
    assert found.solution.objective == pytest.approx(grid.min(), rel=1e-4)
    assert found.values["f"] == pytest.approx(f[grid.argmin()], abs=2e-4)


def test_a_norm_is_least_where_a_zero_is_wanted():
    found = designed([RootTarget("zero", X, "F", 1.0), Criterion("hinf", X, "F")])
    assert found.values["f"] == pytest.approx(1.0, abs=1e-14)
    z = np.linspace(0.15, 0.3, 601)
    grid = np.abs(compliance(1.0, z[:, None], np.linspace(0.6, 1.1, 601))).max(axis=1)
    assert found.values["z"] == pytest.approx(z[grid.argmin()], abs=3e-3)
    assert found.solution.conditions.verified


def test_poles_are_placed_exactly():
    found = designed([RootTarget("pole", X, "F", 1.1, 0.1)], starts=4)
    f, z = (mpmath.mpf(value) for value in found.values.values())
    mu, s = mpmath.mpf(1) / 10, mpmath.mpf("1.1") * mpmath.mpc(-0.1, mpmath.sqrt(mpmath.mpf("0.99")))
    strut = mu * f**2 + 2 * mu * z * s
    assert abs((s**2 + 1 + strut) * (mu * s**2 + strut) - strut**2) < 1e-13
    assert found.solution.met
    assert found.solution.conditions is None


def test_zeros_are_placed_with_their_damping():
    found = designed([RootTarget("zero", X, "F", 1.2, 0.3)])
    assert found.values == pytest.approx({"f": 1.2, "z": 0.36}, rel=1e-14)


def rc_and_rl():
    """Return a chain of two real poles, -1/a and -1/b."""
    a, b = free("a", 1), free("b", 3)
    elements = [("V", "Se"), ("one", "1"), ("R1", "R", a), ("zero", "0"), ("C1", "C", 1), ("two", "1")]
    elements += [("R2", "R", b), ("C2", "C", 1)]
    return graph(elements, ["V one R1", "one zero C1", "zero two R2", "two C2"])


def test_two_real_poles_are_placed():
    A, B = Parameter("a", 1.0), Parameter("b", 3.0)
    wanted = [RootTarget("pole", Port("C2", "e"), "V", value, 1.0) for value in (0.2, 2.5)]
    found = solve(Design(rc_and_rl(), (A, B), tuple(wanted), starts=4))
    a, b = found.values.values()  # 1 + s (2 a + b) + s^2 a b
    assert [1 / (a * b), (2 * a + b) / (a * b)] == pytest.approx([0.5, 2.7], rel=1e-12)


def test_an_overdamped_pair_becomes_an_oscillating_one():
    mass, spring, loss = ("m", "I", 1), ("k", "C", 1), ("c", "R", free("c", 5))
    made = graph([("F", "Se"), ("j", "1"), mass, spring, loss], ["F j m", "j k", "j c"])
    target = RootTarget("pole", Port("k", "q"), "F", 1.0, 0.25)
    found = solve(Design(made, (Parameter("c", 5.0),), (target,), starts=1))
    assert found.values["c"] == pytest.approx(0.5, rel=1e-13)


def test_a_parameter_that_no_target_depends_on_keeps_its_start():
    found = designed([RootTarget("zero", X, "F", 1.2)], starts=3)
    assert found.idle == ("z",)
    assert found.values == {"f": pytest.approx(1.2, rel=1e-14), "z": 0.2}


def test_parameters_of_any_sign_are_designed():
    gain = Parameter("f", -0.9, scale="linear")
    assert designed([RootTarget("zero", X, "F", 1.2)], gain).values["f"] == pytest.approx(-1.2, rel=1e-13)
    zero = Parameter("z", 0.2, low=0.0, high=1.0, scale="linear")
    found = designed([RootTarget("zero", X, "F", 1.2, 0.0)], F, zero)
    assert found.values == pytest.approx({"f": 1.2, "z": 0.0}, abs=1e-12)


def zero(frequency, damping=None, **options):
    return RootTarget("zero", X, "F", frequency, damping, **options)


def pole(frequency, damping=None):
    return RootTarget("pole", X, "F", frequency, damping)


def limited(name, start, high):
    return Parameter(name, start, high=high)


UNREACHABLE = {
    "the zeros of K.q/F do not depend on z; the nearest that is reached is 0.9 rad/s": ([zero(1.2)], [Z]),
    "f is at its max, 1; there 1 rad/s is reached; without limits it needs f = 1.2": (
        [zero(1.2)], [limited("f", 0.9, 1.0)],
    ),
    "f is at its max, 3.14159; there 0.5 Hz is reached": (
        [zero(2 * pi, hertz=True)], [limited("f", 0.9, pi)],
    ),
    "2 conditions on 1 free parameter": ([zero(0.9, 0.3)], [F]),
    "4 conditions on 2 free parameters": ([pole(1.1, 0.1), pole(0.8, 0.1)], [F, Z]),
    "no real poles": ([pole(2.0, 1.0)], [F]),
    "the natural frequency of this pole does not depend on z": ([pole(2.0, -0.1)], [Parameter("z", 0.2)]),
    "no oscillating zeros": ([RootTarget("zero", Port("m", "f"), "F", 2.0)], [Z]),
    "fewer oscillating zeros than targets": ([zero(0.9), zero(1.9)], [F]),
    "M.e/F follows its input directly (gain 1): its H2 norm is infinite": (
        [Criterion("h2", Port("M", "e"), "F")], [F, Z],
    ),
    "K.p/F is not stable: a pole at 0 lies on the imaginary axis": (
        [Criterion("hinf", Port("K", "p"), "F")], [F, Z],
    ),
}  # fmt: skip


@pytest.mark.parametrize("reason", UNREACHABLE)
def test_what_cannot_be_reached_is_refused_with_the_reason(reason):
    targets, parameters = UNREACHABLE[reason]
    with pytest.raises(Unreachable) as error:
        designed(targets, *parameters, starts=2)
    assert reason in error.value.problem
    assert error.value.names[0].startswith("design.targets.")


def test_a_zero_that_is_never_there_is_refused():
    made = graph([("F", "Se"), ("j", "1"), ("m", "I", free("m", 1)), ("c", "R", 1)], ["F j m", "j c"])
    target = RootTarget("zero", Port("m", "f"), "F", 1.0)
    with pytest.raises(Unreachable, match=r"m.f/F has no zeros"):
        solve(Design(made, (Parameter("m", 1.0),), (target,), starts=2))


def shaft():
    """Return two free inertias with a damped spring between, in which no force shows that they turn."""
    elements = [("T", "Se"), ("a", "1"), ("J1", "I", 1), ("z", "0"), ("s", "1"), ("k", "C", 1)]
    elements += [("c", "R", free("c", Fraction(1, 10))), ("b", "1"), ("J2", "I", 1)]
    return graph(elements, ["T a J1", "a z b J2", "z s k", "s c"])


def test_hidden_modes_do_not_count():
    c, force = Parameter("c", 0.1, low=0.01, high=1.0), Port("k", "e")
    found = solve(Design(shaft(), (c,), (Criterion("h2", force, "T"),), starts=2))
    # k.e/T = 1/(s^2 + 2 c s + 2): its H2 norm is 1/sqrt(8 c)
    assert found.values["c"] == 1.0
    assert found.solution.objective == pytest.approx(1 / sqrt(8), rel=1e-12)
    placed = solve(Design(shaft(), (c,), (RootTarget("pole", force, "T", sqrt(2), 0.3),), starts=2))
    assert placed.values["c"] == pytest.approx(0.3 * sqrt(2), rel=1e-13)


def test_what_grows_to_no_end_is_said():
    target = RootTarget("pole", Port("k", "e"), "T", sqrt(2), -0.3)
    with pytest.raises(Unreachable, match=r"c falls to 1e-07"):
        solve(Design(shaft(), (Parameter("c", 0.1),), (target,), starts=1))


def test_a_norm_without_a_minimum_is_refused():
    with pytest.raises(Unreachable, match=r"has no minimum: it still falls, .* as c grows") as error:
        solve(Design(shaft(), (Parameter("c", 0.1),), (Criterion("h2", Port("k", "e"), "T"),), starts=1))
    assert error.value.names[0] == "design.free.c"


def test_a_peak_in_a_band_needs_no_stability_outside_of_it():
    c = Parameter("c", 0.1, low=0.01, high=1.0)
    speed = Port("J1", "f")
    with pytest.raises(Unreachable, match=r"not stable: a pole at 0"):
        solve(Design(shaft(), (c,), (Criterion("hinf", speed, "T"),), starts=1))
    found = solve(Design(shaft(), (c,), (Criterion("peak", speed, "T", 0.5, 5.0),), starts=2))
    s = 1j * np.linspace(0.5, 5.0, 20001)
    damping = np.linspace(0.01, 1.0, 200)[:, None]
    peaks = np.abs((s**2 + damping * s + 1) / (s * (s**2 + 2 * damping * s + 2))).max(axis=1)
    assert found.solution.objective <= peaks.min() * (1 + 1e-9)
    assert found.solution.objective == pytest.approx(peaks.min(), rel=1e-3)


@pytest.mark.parametrize("kind", ["h2", "hinf"])
def test_unstable_graphs_have_no_norm(kind):
    loss = ("c", "R", -free("c", 1))
    made = graph([("F", "Se"), ("j", "1"), ("m", "I", 1), ("k", "C", 1), loss], ["F j m", "j k", "j c"])
    c = Parameter("c", 1.0, low=0.5, high=1.5)
    with pytest.raises(Unreachable, match=r"k.q/F is unstable: poles at 0.5 ± 0.866"):
        solve(Design(made, (c,), (Criterion(kind, Port("k", "q"), "F"),), starts=1))


def test_a_differentiating_channel_has_no_norm_over_all_frequencies():
    made = graph([("V", "Sf"), ("j", "1"), ("m", "I", free("m", 1)), ("c", "R", 1)], ["V j m", "j c"])
    effort, m = Port("m", "e"), Parameter("m", 1.0, low=0.5, high=2.0)
    with pytest.raises(Unreachable, match=r"m.e/V follows a derivative of its input"):
        solve(Design(made, (m,), (Criterion("hinf", effort, "V"),), starts=1))
    j, target = Port("c", "e"), RootTarget("zero", Port("m", "e"), "V", 1.0)
    assert solve(Design(made, (m,), (Criterion("hinf", j, "V"),), starts=1)).solution.objective == 1.0
    with pytest.raises(Unreachable, match=r"no oscillating zeros"):
        solve(Design(made, (m,), (target,), starts=1))


def test_residuals_have_exact_derivatives():
    targets = (
        RootTarget("pole", X, "F", 1.1, 0.1),
        RootTarget("zero", X, "F", 0.8, 0.4),
        Criterion("h2", X, "F"),
    )
    functions, h = DesignFunctions(Design(absorber("1/10"), (F, Z), targets)), 1e-6
    eta = functions.coordinates.start
    here = functions.at(eta)
    for k in range(2):
        up, down = (functions.at(eta + side * h * np.eye(2)[k]) for side in (1, -1))
        assert (up.residuals - down.residuals) / (2 * h) == pytest.approx(here.jacobian[:, k], abs=1e-8)
        rate = (up.norms[0].value - down.norms[0].value) / (2 * h)
        assert rate == pytest.approx(here.norms[0].slopes[0, k], abs=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_quadratic_programs_meet_their_conditions(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 3))
    H, c = root.T @ root, rng.normal(size=3)
    A = np.concatenate([rng.normal(size=(5, 3)), np.eye(3), -np.eye(3)])
    b = np.concatenate([rng.uniform(0.1, 1, 5), np.ones(6)])
    x, dual = quadratic_program(H, c, A, b)
    assert H @ x + c + A.T @ dual == pytest.approx(np.zeros(3), abs=1e-9)
    assert (A @ x <= b + 1e-9).all()
    assert (dual >= 0).all()
    assert dual @ (b - A @ x) == pytest.approx(0, abs=1e-9)


def oscillator(*loss):
    """Return a mass on a spring with a resistance, if any."""
    elements = [("F", "Se"), ("j", "1"), ("m", "I", free("m", 1)), ("k", "C", 1), *loss]
    return graph(elements, ["F j m", "j k", *("j c" for _ in loss)])


def test_the_response_at_an_undamped_pole_is_infinite_and_beside_it_finite():
    target = RootTarget("pole", Port("k", "q"), "F", 2.0)
    functions = DesignFunctions(Design(oscillator(), (Parameter("m", 1.0),), (target,)))
    found = functions.matrices(functions.coordinates.start)
    omega = np.array([0.5, 1.0, 2.0, 3.0])
    response = functions.response(found, target, omega)
    assert np.isinf(response).tolist() == [False, True, False, False]
    assert response[[0, 2, 3]] == pytest.approx(1 / (1 - omega[[0, 2, 3]] ** 2), rel=1e-14)


@pytest.mark.parametrize("limits", [{}, {"low": -0.5, "high": 1.0}, {"low": 0.0, "high": 4.0}])
def test_a_parameter_of_any_sign_may_start_at_zero(limits):
    loss = Parameter("z", 0.0, scale="linear", **limits)
    assert DesignFunctions(Design(absorber("1/10"), (loss,), (zero(1.2, 0.3),))).coordinates.units == [
        limits.get("high", 1.0)
    ]
    found = designed([zero(1.2, 0.3)], F, loss)
    assert found.values == pytest.approx({"f": 1.2, "z": 0.36}, rel=1e-12)


def test_a_held_parameter_is_met_or_not():
    made, held = oscillator(("c", "R", Fraction(1, 2))), Parameter("m", 1.0, low=1.0, high=1.0)
    met = RootTarget("pole", Port("k", "q"), "F", 1.0, 0.25)
    assert solve(Design(made, (held,), (met,), starts=1)).values == {"m": 1.0}
    missed = RootTarget("pole", Port("k", "q"), "F", 2.0, 0.25)
    with pytest.raises(Unreachable, match="1 rad/s"):
        solve(Design(made, (held,), (missed,), starts=1))


def test_an_output_without_the_input_has_no_zeros():
    elements = [("F", "Se"), ("j", "1"), ("m", "I", free("m", 1)), ("c", "R", 1)]
    elements += [("G", "Se"), ("i", "1"), ("n", "I", 1), ("d", "R", 1)]
    made = graph(elements, ["F j m", "j c", "G i n", "i d"])
    target = RootTarget("zero", Port("n", "f"), "F", 1.0)
    with pytest.raises(Unreachable, match=r"n.f/F has no zeros"):
        solve(Design(made, (Parameter("m", 1.0),), (target,), starts=1))


def test_values_at_which_the_equations_have_no_solution_are_infinitely_far():
    """The resistances a and -1 in series drive C and R side by side: the pole is -1 - 1/(a - 1)."""
    elements = [("F", "Se"), ("j", "1"), ("r1", "R", free("a", 2)), ("r2", "R", -1), ("z", "0")]
    elements += [("k", "C", 1), ("o", "1"), ("r3", "R", 1)]
    made = graph(elements, ["F j r1", "j r2", "j z k", "z o r3"])
    e = Port("k", "e")
    design = Design(made, (Parameter("a", 2.0),), (RootTarget("pole", e, "F", 3.0, 1.0),), starts=1)
    assert solve(design).values == {"a": pytest.approx(1.5, rel=1e-13)}
    functions = DesignFunctions(Design(made, design.free, (*design.targets, Criterion("h2", e, "F"))))
    nowhere, somewhere = functions.at(np.zeros(1)), functions.at(np.log([1.5]))
    assert (nowhere.exists, somewhere.exists) == (False, True)
    assert np.isinf(nowhere.residuals).all()
    assert nowhere.norms[0].value == np.inf
    assert "have no solution at these values" in nowhere.norms[0].why
    # e/F = 2/(s + 3) at a = 1.5: its H2 norm is 2/sqrt(6)
    assert somewhere.norms[0].value == pytest.approx(2 / sqrt(6), rel=1e-12)
