"""Bond graphs as linear systems with derivatives: against tableaux, structures, and equations by hand."""

import random
from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from flint import acb, acb_mat, arb, ctx, fmpq, fmpq_mat
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.arithmetic.dependent import Dependent, sqrt
from dynid.bondgraph.graph import Bond, BondGraph, Node
from dynid.errors import Singular, UsageError
from dynid.identification.records.measurement import Simulation
from dynid.identification.systems.graph_system import GraphChannel, GraphSystem, IdentifiedGraph, SourceLoad
from dynid.lti.signals import Impulse, Multisine, Sampled, Sine, Step
from dynid.parameters import Parameter
from tests.bondgraph.graphs import build, chain, parse, port, solvable
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at, transfers_at

SINE = Sine(1.0, 3.0)


def made(graph, unknown, initial=None, **dependents):
    """A model in which these values are unknown, or these functions of unknown parameters."""
    numbers = {name: Dependent.parameter(name, graph.value(name)) for name in unknown} | dependents
    nodes = [
        replace(node, dependent=numbers[name]) if name in numbers else node
        for name, node in graph.nodes.items()
    ]
    starts = {name: float(graph.value(name)) for name in unknown}
    for number in dependents.values():
        number.fold(
            lambda one: (
                starts.setdefault(one.operands[0], float(one)) if isinstance(one, Dependent) else None
            ),
            lambda *_: None,
        )
    parameters = [
        Parameter(name, start, true=start, scale="log" if start > 0 else "linear")
        for name, start in starts.items()
    ]
    return IdentifiedGraph(BondGraph(nodes, graph.bonds), parameters, initial)


def written(nodes, bonds, unknown=None, **options):
    types, values, pairs = parse(nodes, bonds)
    return made(build(types, values, pairs), values if unknown is None else unknown, **options)


def system(model, outputs, signal=SINE):
    sources = [name for name, node in model.graph.nodes.items() if node.type in ("Se", "Sf")]
    loads = [model.load(name, signal) for name in sources]
    return model.system(loads, [model.channel(port(output)) for output in outputs])


def exact(number):
    """A float as a rational number of mpmath, exactly."""
    return mpmath.mpf(float(number))


def transfer(found, s):
    """T(s) and its slopes (channels x loads, p x channels x loads) from matrices, in rational arithmetic."""

    def rational(matrix):
        numbers = [fmpq(*float(x).as_integer_ratio()) for x in np.ravel(matrix)]
        return fmpq_mat(*matrix.shape, numbers)

    def rounded(matrix):
        numbers = [int(x.p) / int(x.q) for x in matrix.entries()]
        return np.array(numbers).reshape(matrix.nrows(), matrix.ncols())

    s, p = fmpq(s.numerator, s.denominator), len(found.A_slopes)
    T = sum((rational(part) * s**order for order, part in enumerate(found.D[1:], 1)), rational(found.D[0]))
    slopes = [
        sum((rational(part) * s**order for order, part in enumerate(parts[1:], 1)), rational(parts[0]))
        for parts in found.D_slopes
    ]
    if len(found.A):
        A, B, C = map(rational, found[:3])
        pencil = fmpq_mat(*found.A.shape, [s * int(x) for x in np.eye(len(found.A)).ravel()]) - A
        by_load, by_channel = pencil.solve(B), pencil.transpose().solve(C.transpose()).transpose()
        T = T + C * by_load
        for k in range(p):
            dA, dB, dC = (rational(part[k]) for part in found[4:7])
            slopes[k] = slopes[k] + dC * by_load + by_channel * (dA * by_load + dB)
    return rounded(T), np.array([rounded(slope) for slope in slopes]).reshape(p, *found.D[0].shape)


def known_transfer(made_graph, output, s):
    """T(s) of the tableau and its derivatives by every value, from exact differences of 1e-12."""
    types, values, bonds, inputs, _ = made_graph
    T = transfer_at(types, values, bonds, inputs, output, s)
    if T is None:
        return None
    step, slopes = Fraction(1, 10**12), []
    for name, value in values.items():
        above, below = (
            transfer_at(types, {**values, name: value * (1 + sign * step)}, bonds, inputs, output, s)
            for sign in (1, -1)
        )
        slopes.append([float((above[u] - below[u]) / (2 * step * value)) for u in inputs])
    return np.array([float(T[u]) for u in inputs]), np.array(slopes).reshape(len(values), len(inputs))


def assert_close(found, known, sizes, relative):
    bound = relative * np.maximum(np.abs(known), sizes)
    assert np.all(np.abs(found - known) <= bound + 1e-150), (found, known)


# --- random graphs ----------------------------------------------------------------------------------


def from_random(made_graph):
    """The system of a random graph, all values unknown; None where it has no solution."""
    types, values, bonds, inputs, (node, quantity) = made_graph
    if solvable(made_graph) is None:
        return None
    model = made(build(types, values, bonds), values)
    loads = [SourceLoad(name, SINE) for name in inputs]
    return model.system(loads, [GraphChannel(port(f"{node}.{quantity}"))])


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_random_graphs_have_the_transfers_and_slopes_of_their_tableau(seed):
    rng = random.Random(seed)
    made_graph = random_graph(rng, rng.randint(1, 7), rng.choice([0, 0, 1, 2]))
    found = from_random(made_graph)
    if found is None:
        return
    _, values, _, _, output = made_graph
    s = Fraction(rng.randint(1, 60), rng.randint(1, 20))
    known = known_transfer(made_graph, output, s)
    if known is None:
        return
    T, slopes = transfer(found.at({}), s)
    sizes = np.abs(known[0]) / np.array([abs(float(value)) for value in values.values()])[:, None]
    assert_close(T[0], known[0], 1e-12, 1e-9)
    assert_close(slopes[:, 0], known[1], sizes, 1e-9)
    named = [name for name, slope in zip(values, known[1], strict=True) if slope.any()]
    assert not set(named).intersection(found.unreached)


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_responses_keep_nine_digits_with_values_twelve_decades_apart(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 6), rng.choice([0, 0, 1]))
    values = {name: value * Fraction(10) ** rng.randint(-6, 6) for name, value in values.items()}
    found = from_random((types, values, bonds, inputs, output))
    if found is None:
        return
    omega = float(10.0 ** rng.randint(-4, 6))
    H, slopes = found.response({}, np.array([omega]))
    try:
        known = on_axis(types, values, bonds, inputs, output, omega)
    except ZeroDivisionError:  # a part that the output does not depend on has no solution
        return
    assert_close(H[0, 0], known[0], 0.0, 1e-9)
    sizes = np.abs(known[0])[:, None] / np.array([abs(float(value)) for value in values.values()])
    assert_close(slopes[0, 0], known[1], sizes, 1e-9)


def on_axis(types, values, bonds, inputs, output, omega):
    """T(j omega) and its derivatives by every value, from the equations of bonds, with 1000 bits."""

    def solved(numbers):
        size, s = len(bonds) * 2, acb(0, omega)
        table, right = acb_mat(size, size), acb_mat(size, len(inputs))
        row = 0
        for name, kind in types.items():
            at = [k for k, bond in enumerate(bonds) if name in bond]
            signs = [1 if bonds[k][1] == name else -1 for k in at]
            value = numbers.get(name)
            if kind in "01":
                same = 0 if kind == "0" else 1
                for k in at[1:]:
                    table[row, 2 * at[0] + same], table[row, 2 * k + same] = 1, -1
                    row += 1
                for k, sign in zip(at, signs, strict=True):
                    table[row, 2 * k + 1 - same] = sign
            elif kind in ("Se", "Sf"):
                table[row, 2 * at[0] + (kind == "Sf")] = 1
                if name in inputs:
                    right[row, inputs.index(name)] = 1
            elif kind in "RIC":
                table[row, 2 * at[0] + (kind == "C")] = 1
                table[row, 2 * at[0] + (kind != "C")] = -(value if kind == "R" else s * value) * signs[0]
            else:
                one, two = at if signs[0] == 1 else at[::-1]
                table[row, 2 * one], table[row, 2 * two + (kind == "GY")] = 1, -value
                row += 1
                table[row, 2 * two + (kind == "TF")], table[row, 2 * one + 1] = 1, -value
            row += 1
        place = 2 * next(k for k, bond in enumerate(bonds) if output[0] in bond) + (output[1] in "fq")
        solution, scale = table.solve(right), 1 / s if output[1] in "qp" else acb(1)
        return [solution[place, k] * scale for k in range(len(inputs))]

    with ctx.workprec(1000):
        numbers = {name: acb(float(value)) for name, value in values.items()}
        h, slopes = arb(2) ** -200, []
        for name, value in numbers.items():
            above, below = (solved({**numbers, name: value * (1 + sign * h)}) for sign in (1, -1))
            slopes.append([complex((a - b) / (2 * h * value)) for a, b in zip(above, below, strict=True)])
        T = np.array([complex(t) for t in solved(numbers)])
        return T, np.array(slopes).reshape(len(numbers), len(inputs)).T


# --- by hand ----------------------------------------------------------------------------------------

MOTOR = (
    "Se U, 1 electric, I L 1/1000, R Ra 1/2, GY Km 1/20, 1 rotor, I J 1/5000, R b 1/10000, TF gear 1/10, "
    "0 shaft, C flex 1/40, 1 load, I JL 1/50, R bL 1/100",
    "U -> electric -> L, electric -> Ra, electric -> Km -> rotor -> J, rotor -> b, "
    "rotor -> gear -> shaft -> flex, shaft -> load -> JL, load -> bL",
)


def motor_equations(v):
    """A of [i, w, q, wL]."""
    L, R, Km, J, b, n, c, JL, bL = (v[x] for x in ("L", "Ra", "Km", "J", "b", "gear", "flex", "JL", "bL"))
    return mpmath.matrix(
        [
            [-R / L, -Km / L, 0, 0],
            [Km / J, -b / J, -n / (c * J), 0],
            [0, n, 0, -1],
            [0, 0, 1 / (c * JL), -bL / JL],
        ]
    )


def test_a_motor_with_gear_and_shaft_has_the_equations_derived_by_hand():
    model = written(*MOTOR)
    found = system(model, ["L.f", "JL.f"])
    assert [state.name for state in found.states] == ["L.f", "J.f", "flex.q", "JL.f"]
    rng = np.random.default_rng(1)
    for _ in range(20):
        values = {one.name: one.start * 10 ** rng.uniform(-6, 6) for one in model.unknowns}
        matrices = found.at(values)
        with mpmath.workdps(80):
            numbers = {name: exact(value) for name, value in values.items()}
            A = np.array(motor_equations(numbers).tolist(), dtype=float)
            np.testing.assert_allclose(matrices.A, A, rtol=1e-14)
            h = mpmath.mpf(10) ** -30
            for k, one in enumerate(model.unknowns):
                moved = [
                    motor_equations({**numbers, one.name: numbers[one.name] * (1 + sign * h)})
                    for sign in (1, -1)
                ]
                slope = (moved[0] - moved[1]) / (2 * h * numbers[one.name])
                slope = np.array(slope.tolist(), dtype=float)
                np.testing.assert_allclose(
                    matrices.A_slopes[k], slope, rtol=1e-12, atol=1e-25 * np.abs(slope).max()
                )
        np.testing.assert_allclose(matrices.B, [[1 / values["L"]], [0], [0], [0]])
        np.testing.assert_array_equal(matrices.C, [[1, 0, 0, 0], [0, 0, 0, 1]])
        assert not matrices.D.any()
        assert matrices.B_slopes[[one.name for one in model.unknowns].index("L"), 0, 0] == pytest.approx(
            -1 / values["L"] ** 2, rel=1e-14
        )


def test_rigid_gears_share_one_state_and_its_inertia():
    model = written(
        "Se M, 1 a, I J1 2, TF n 3, 1 b, I J2 5, R d 1/7", "M -> a -> J1, a -> n -> b -> J2, b -> d"
    )
    found = system(model, ["J1.f", "J2.f", "J2.e"])
    (state,) = found.states
    J1, J2, n, d = 2.0, 5.0, 3.0, 1 / 7
    inertia = J1 + n**2 * J2
    matrices = found.at({"J1": J1, "J2": J2, "n": n, "d": d})
    assert state.name in ("J1.f", "J2.f")
    assert matrices.A[0, 0] == pytest.approx(-(n**2) * d / inertia, rel=1e-15)
    k = [one.name for one in model.unknowns].index("n")
    by_n = -2 * n * d / inertia + n**2 * d * 2 * n * J2 / inertia**2
    assert matrices.A_slopes[k, 0, 0] == pytest.approx(by_n, rel=1e-14)
    T, _ = transfer(matrices, Fraction(3, 4))
    known = transfers_at(
        *parse("Se M, 1 a, I J1 2, TF n 3, 1 b, I J2 5, R d 1/7", "M -> a -> J1, a -> n -> b -> J2, b -> d"),
        ["M"],
        [("J1", "f"), ("J2", "f"), ("J2", "e")],
        Fraction(3, 4),
    )
    np.testing.assert_allclose(T[:, 0], [float(value) for value in known.values()], rtol=1e-13)


LOOP = (
    "Se u, 1 a, R r1 1, 0 b, R r2 2, 1 c, R r3 3, TF t 1/2, 0 d, R r4 4, 1 e, R r5 5, C k 1, I m 2",
    "u -> a -> r1, a -> b -> r2, b -> c -> r3, c -> t -> d -> r4, d -> e -> r5, e -> k, e -> m, b -> d",
)


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_an_algebraic_loop_keeps_its_digits_over_twelve_decades(seed):
    """r1 … r5 and a transformer form a loop of resistors."""
    rng = np.random.default_rng(seed)
    types, values, bonds = parse(*LOOP)
    model = made(build(types, values, bonds), values)
    found = system(model, ["m.f"])
    chosen = {name: float(value) * 10 ** rng.uniform(-6, 6) for name, value in values.items()}
    matrices = found.at(chosen)
    s = Fraction(float(10 ** rng.uniform(-3, 3)))
    T, slopes = transfer(matrices, s)
    numbers = {name: Fraction(value) for name, value in chosen.items()}
    known = known_transfer((types, numbers, bonds, ["u"], None), ("m", "f"), s)
    assert_close(T[0], known[0], 0.0, 1e-9)
    sizes = np.abs(known[0]) / np.array(list(chosen.values()))[:, None]
    assert_close(slopes[:, 0], known[1], sizes, 1e-9)


def test_values_that_are_functions_of_parameters():
    """C = 1/k, R = 2 zeta sqrt(k m), I = m: derivatives by k, m and zeta as of the closed form."""
    nodes, bonds = (
        "Se F, 1 v, I mass 2, C spring 1/50, R damper 1",
        "F -> v -> mass, v -> spring, v -> damper",
    )
    k, m, zeta = (
        Dependent.parameter(name, Fraction(value)) for name, value in (("k", 50), ("m", 2), ("zeta", "1/20"))
    )
    values = {"k": 50.0, "m": 2.0, "zeta": 0.05}
    types, numbers, pairs = parse(nodes, bonds)
    model = made(build(types, numbers, pairs), (), mass=m, spring=1 / k, damper=2 * zeta * sqrt(k * m))
    found = system(model, ["mass.f"])
    matrices = found.at(values)
    assert [state.name for state in found.states] == ["mass.f", "spring.q"]
    np.testing.assert_allclose(matrices.A, [[-2 * 0.05 * 5, -25], [1, 0]], rtol=1e-15)
    slopes = dict(zip([one.name for one in model.unknowns], matrices.A_slopes, strict=True))
    np.testing.assert_allclose(slopes["k"], [[-0.05 / 10, -0.5], [0, 0]], rtol=1e-14)
    np.testing.assert_allclose(slopes["m"], [[0.05 * 5 / 2, 12.5], [0, 0]], rtol=1e-14)
    np.testing.assert_allclose(slopes["zeta"], [[-10, 0], [0, 0]], rtol=1e-14)


def test_a_divisor_that_vanishes_is_an_error_not_a_number():
    model = written("Se u, 1 a, R r1 1, R r2 2, C k 1", "u -> a -> r1, a -> r2, a -> k")
    found = system(model, ["k.q"])
    assert np.isfinite(found.at({"r1": -1.0, "r2": 2.0, "k": 1.0}).A).all()
    with pytest.raises(Singular, match="divisor vanishes") as raised:
        found.at({"r1": -2.0, "r2": 2.0, "k": 1.0})
    assert raised.value.remedy
    with pytest.raises(Singular):
        found.at({"r1": 1.0, "r2": 2.0, "k": 0.0})


def test_a_slope_that_is_zero_at_some_values_only_is_zero():
    """Of two equal dampers beside each other: d/dr (r1 - r2)^2 through a bridge vanishes where they agree."""
    nodes = "Se u, 1 a, R s 1, 0 p, 1 l, R r1 1, 0 x, R r2 1, 1 r, R r3 1, 0 y, R r4 1, 1 z, I m 1"
    bonds = (
        "u -> a -> s, a -> p, p -> l -> r1, l -> x -> r2, p -> r -> r3, r -> y -> r4, x -> z, z -> y, z -> m"
    )
    found = system(written(nodes, bonds), ["m.f"])
    matrices = found.at({})
    assert matrices.B[0, 0] == 0.0  # the bridge is balanced
    assert np.count_nonzero(matrices.B_slopes) == 4


# --- structures -------------------------------------------------------------------------------------


def grounded_chain(rng, n):
    """M, C, K of a grounded chain of masses, and the graph that it is, with its displacements' map to q."""
    m, k, c = rng.uniform(0.5, 3, n), 10 ** rng.uniform(2, 5, n), 10 ** rng.uniform(-1, 1, n)
    L = np.eye(n) - np.eye(n, k=-1)  # elongation of spring i: x_i - x_(i-1)
    nodes, bonds = "Se F", f"F -> v{n}"
    for i in range(1, n + 1):
        nodes += f", 1 v{i}, I m{i} {Fraction(m[i - 1])}, 0 z{i}, 1 l{i}, C s{i} {1 / Fraction(k[i - 1])}"
        nodes += f", R d{i} {Fraction(c[i - 1])}"
        bonds += f", v{i} -> m{i}, v{i} -> z{i} -> l{i} -> s{i}, l{i} -> d{i}"
        bonds += f", z{i} -> v{i - 1}" if i > 1 else ""
    types, values, pairs = parse(nodes, bonds)
    springs = {f"s{i}": 1 / Dependent.parameter(f"k{i}", Fraction(k[i - 1])) for i in range(1, n + 1)}
    unknown = [f"{letter}{i}" for letter in "md" for i in range(1, n + 1)]
    model = made(build(types, values, pairs), unknown, **springs)
    return m, c, k, L, model


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.sampled_from([0.05, 1.0, 40.0, 1e5]))
def test_a_grounded_chain_is_its_structure_in_other_coordinates(seed, n, length):
    """Matrices, slopes and prior are those of displacements and velocities under the constant map q = L x."""
    rng = np.random.default_rng(seed)
    m, c, k, L, model = grounded_chain(rng, n)
    found = system(model, ["m1.f"])
    names = [state.name for state in found.states]
    order = [names.index(f"s{i}.q") for i in range(1, n + 1)] + [
        names.index(f"m{i}.f") for i in range(1, n + 1)
    ]
    change = np.zeros((2 * n, 2 * n))
    change[:n, :n], change[n:, n:] = L, np.eye(n)
    back = np.linalg.inv(change)
    matrices = found.at({})

    def structure(m, c, k):
        A = np.zeros((2 * n, 2 * n))
        A[:n, n:] = np.eye(n)
        A[n:, :n], A[n:, n:] = (-(L.T * part) @ L / m[:, None] for part in (k, c))
        return A

    A = matrices.A[np.ix_(order, order)]
    np.testing.assert_allclose(back @ A @ change, structure(m, c, k), rtol=1e-12, atol=1e-9)
    for p, one in enumerate(model.unknowns):
        letter, place = one.name[0], int(one.name[1:]) - 1
        step, zero = np.eye(n)[place], np.zeros(n)
        if letter == "m":
            expected = structure(m, c, k) * np.concatenate([zero, -step / m])[:, None]
        else:
            expected = structure(m, step if letter == "d" else zero, step if letter == "k" else zero)
            expected[:n] = 0
        slope = back @ matrices.A_slopes[p][np.ix_(order, order)] @ change
        np.testing.assert_allclose(slope, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())
    root = back @ found.prior({}, length)[order]
    covariance = root @ root.T
    K = (L.T * k) @ L
    known = np.linalg.inv(K + np.diag(m) / length**2)
    scale = np.sqrt(np.diag(known))
    np.testing.assert_allclose(
        covariance[:n, :n] / scale / scale[:, None], known / scale / scale[:, None], atol=1e-9
    )
    np.testing.assert_allclose(covariance[n:, n:], np.diag(1 / m), rtol=1e-10, atol=1e-12)
    assert not covariance[:n, n:].any()


def test_an_integral_without_energy_is_bounded_by_the_length_of_the_record():
    model = written("Se F, 1 v, I m 4, R d 1", "F -> v -> m, v -> d")
    found = system(model, ["v.q"])
    assert [state.name for state in found.states] == ["m.f", "v.q"]
    root = found.prior({}, 30.0)
    np.testing.assert_allclose(root @ root.T, [[1 / 4, 0], [0, 30**2 / 4]], rtol=1e-12)
    np.testing.assert_allclose(found.at({}).A, [[-1 / 4, 0], [1, 0]])


def test_a_capacitor_on_resistors_is_bounded_by_its_energy():
    found = system(written("Se u, 1 a, R r 3, C k 1/8", "u -> a -> r, a -> k"), ["k.e"])
    np.testing.assert_allclose(found.prior({}, 1e-6) ** 2, [[1 / 8]], rtol=1e-14)


# --- loads, channels and records --------------------------------------------------------------------


def test_names_units_and_what_is_not_reached():
    types, values, bonds = parse(*MOTOR)
    domains = {
        "L": "electrical",
        "J": "rotational",
        "flex": "rotational",
        "JL": "rotational",
        "U": "electrical",
    }
    graph = build(types, values, bonds)
    graph = BondGraph(
        [replace(node, domain=domains.get(name, "")) for name, node in graph.nodes.items()], bonds_of(graph)
    )
    model = made(graph, values)
    load, channel = model.load("U", SINE), model.channel(port("JL.f"))
    assert (load.name, load.unit, channel.name, channel.unit) == ("U", "V", "JL.f", "rad/s")
    found = model.system([load], [channel])
    assert [(state.name, state.unit) for state in found.states] == [
        ("L.f", "A"),
        ("J.f", "rad/s"),
        ("flex.q", "rad"),
        ("JL.f", "rad/s"),
    ]
    assert found.unreached == ()
    behind = written(
        "Sf w, 1 a, I J 2, 0 s, C k 3, 1 l, I m 4, R d 5", "w -> a -> J, a -> s -> k, s -> l -> m, l -> d"
    )
    driven = system(behind, ["m.f"])
    assert driven.unreached == ("J",)
    assert not driven.at({}).A_slopes[0].any()
    for wrong in ("V", "L"):
        with pytest.raises(UsageError, match=f"'{wrong}' is no source"):
            model.load(wrong, SINE)
    for wrong in ("Lx.f", "gear.f", "load.e"):
        with pytest.raises(UsageError):
            model.channel(port(wrong))
    with pytest.raises(UsageError, match="store energy"):
        IdentifiedGraph(graph, (), {"Ra": 1.0})


def bonds_of(graph):
    return [Bond(*bond) for bond in graph.bonds]


def test_a_rate_of_an_input_in_an_output_asks_for_a_smooth_one():
    model = written("Se u, 0 a, C k 2, R r 3", "u -> a -> k, a -> r")
    found = system(model, ["u.f"])
    matrices = found.at({})
    np.testing.assert_allclose(matrices.D[:, 0, 0], [1 / 3, 2])
    np.testing.assert_allclose(matrices.D_slopes[:, :, 0, 0], [[0, 1], [-1 / 9, 0]])
    samples = np.sin(np.arange(50.0))
    model = written("Se u, 0 a, C k 2, R r 3, 1 b, I m 4", "u -> a -> k, a -> b -> r, b -> m")
    for signal in (Sampled(samples, 0.1), Sampled(samples, 0.1, "linear"), Step(1.0, 0.0)):
        system(model, ["u.f"], signal).check()
    for signal in (Sampled(samples, 0.1, "zero"), Impulse(1.0)):
        with pytest.raises(UsageError, match="follows its derivative directly") as raised:
            system(model, ["u.f"], signal).check()
        assert raised.value.remedy
    system(model, ["m.f"], Sampled(samples, 0.1, "zero")).check()


def test_a_record_of_time_needs_a_state():
    found = system(written("Se u, 1 a, R r 3, R s 2", "u -> a -> r, a -> s"), ["s.e"])
    assert found.states == ()
    np.testing.assert_allclose(found.at({}).D, [[[2 / 5]]])
    H, slopes = found.response({}, np.array([0.0, 7.0]))
    np.testing.assert_allclose(H, np.full((2, 1, 1), 2 / 5))
    np.testing.assert_allclose(slopes, np.broadcast_to([[-2 / 25, 3 / 25]], (2, 1, 1, 2)))
    with pytest.raises(UsageError, match="no state of a storage lies between"):
        found.check()


def test_reach_takes_the_rate_of_a_storage_for_its_slowest_motion():
    model = written("Se F, 1 v, I m 2, C k 1/50, R d 3", "F -> v -> m, v -> k, v -> d")
    found = system(model, ["m.f", "k.q", "m.e", "d.e", "F.e"])
    length, omega = 40.0, np.hypot(5, 1 / 40)
    spread = 1 / np.sqrt(2)
    known = [spread, spread / omega, 2 * omega * spread, 3 * spread, np.inf]
    np.testing.assert_allclose(found.reach({}, length), known, rtol=1e-12)


def test_loads_of_one_source_add_up_and_sources_without_one_are_zero():
    nodes = "Se u, Se w, 1 a, R r 3, I m 2"
    model = written(nodes, "u -> a, w -> a, a -> r, a -> m")
    loads = [model.load(name, SINE) for name in ("w", "u", "w")]
    found = model.system(
        loads, [model.channel(port("m.f")), model.channel(port("r.e")), model.channel(port("m.f"))]
    )
    np.testing.assert_allclose(found.at({}).B, [[1 / 2, 1 / 2, 1 / 2]])
    np.testing.assert_allclose(found.at({}).C, [[1], [3], [1]])
    one = model.system(loads[1:2], [model.channel(port("m.f"))])
    assert one.at({}).B.shape == (1, 1)
    assert one.response({}, np.array([0.0, 2.0]))[0][:, 0, 0] == pytest.approx(
        [1 / 3, 1 / (3 + 4j)], rel=1e-14
    )


def test_stored_energy_starts_the_simulated_motion():
    """A mass on a spring with f(0) and e(0): f = f0 cos(wt) - e0/(m w) sin(wt), exactly, after settling."""
    model = written("Se F, 1 v, I m 2, C k 1/50", "F -> v -> m, v -> k", initial={"m": 0.3, "k": 4.0})
    channels = (model.channel(port("m.f")), model.channel(port("k.q")))
    t = 1.5 + 0.05 * np.arange(40)
    found = model.simulated([model.load("F", Step(0.0, 0.0))], channels, t, Simulation(settle=1.5))
    flow = 0.3 * np.cos(5 * t) - 4.0 / (2 * 5) * np.sin(5 * t)
    q = 4.0 / 50 * np.cos(5 * t) + 0.3 / 5 * np.sin(5 * t)
    np.testing.assert_allclose(found.outputs, np.column_stack([flow, q]), atol=1e-13)


def test_energy_on_rigidly_coupled_masses_is_shared():
    model = written(
        "Se F, 1 v, I m 2, TF n 3, 1 w, I J 5", "F -> v -> m, v -> n -> w -> J", initial={"J": 1.0}
    )
    loads, channels = [model.load("F", Step(0.0, 0.0))], [model.channel(port("m.f"))]
    found = model.simulated(loads, channels, np.array([0.0, 0.5, 1.0]), Simulation())
    np.testing.assert_allclose(found.outputs, 3 * 5 * 1.0 / (2 + 9 * 5), rtol=1e-14)  # momentum on v


def test_forty_states():
    types, values, bonds = parse(*chain(20))
    model = made(build(types, values, bonds), ["m1", "k2", "b3", "k20"])
    found = system(model, ["m1.f", "m20.f"], Multisine((1.0,), (2.0,)))
    assert isinstance(found, GraphSystem)
    assert len(found.states) == 40
    known = transfers_at(types, values, bonds, ["F"], [("m1", "f"), ("m20", "f")], Fraction(7, 3))
    T, _ = transfer(found.at({}), Fraction(7, 3))
    np.testing.assert_allclose(T[:, 0], [float(value) for value in known.values()], rtol=1e-11)


def test_nodes_keep_their_reference_value():
    node = Node("m", "I", Fraction(3), dependent=Dependent.parameter("m", Fraction(3)))
    graph = BondGraph([Node("u", "Se"), node], [Bond("u", "m")])
    assert graph.value("m") == 3
    assert graph.with_values({"m": Fraction(4)}).nodes["m"].dependent is None


@pytest.mark.parametrize("shift", [61, 122, -61])
def test_binary_fractions_a_power_of_two_apart_are_different_numbers(shift):
    """2^61 is 1 modulo the prime 2^61 - 1: values that differ by it were taken for the same."""
    theta = Dependent.parameter("theta", Fraction(3))
    factor = 5 * Fraction(2) ** -shift
    model = written("Se u, 1 j, I m 1, R a 15, R b 1", "u -> j -> m, j -> a, j -> b", [],
                    a=theta * 5, b=theta * factor)  # fmt: skip
    found = system(model, ["m.f"]).at({"theta": 7.0})
    assert found.A[0, 0] == pytest.approx(-float(35 + 7 * factor), rel=1e-15)
    assert found.A_slopes[0, 0, 0] == pytest.approx(-float(5 + factor), rel=1e-15)
