"""The compiled run in doubled precision, against exact evaluation and against its own bounds."""

import os
import random
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bench.cases.frequency_response import reduced as ladder
from dynid.bench.cases.frequency_response import tree
from dynid.bondgraph import graph_response as response_module
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.program.frequency_sweep import compile_tape, sweep_frequencies
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.native import VARIABLE, found
from dynid.templates.chain import FORCE, Stage, chain, distinct, last_velocity, uniform
from tests.bondgraph.graphs import solvable, transfers, written
from tests.bondgraph.random_graphs import coincident_graph, random_graph
from tests.bondgraph.test_frequency_response import Gaussian, assert_exact, exact


def swept(graph, omega):
    registers = list(graph.channels().values())
    return sweep_frequencies(graph.program, registers, graph.graph.value, np.asarray(omega, dtype=float))


def of_either_kind(make, seed):
    rng = random.Random(seed)
    arguments = (rng.choice([0, 1, 3]),) if make is random_graph else ()
    return make(rng, rng.randint(1, 7), *arguments)


def chain_of(stages):
    return ReducedGraph(chain(stages), [FORCE], [last_velocity(len(stages))])


def by_recursion(stages, omega):
    """Return v_N / F of a chain with 60 digits, by the impedances seen from the far end."""
    with mpmath.workdps(60):
        s = mpmath.mpc(0, omega)
        values = [tuple(mpmath.mpf(v.numerator) / v.denominator for v in stage) for stage in stages]
        force, seen = mpmath.mpf(1), mpmath.mpf(0)  # Thevenin equivalent of what lies before the stage
        for index, (m, k, b) in enumerate(values):
            seen += s * m
            joint = k / s + b
            if index == len(values) - 1:
                return complex(force / (seen + joint))
            force, seen = force * joint / (seen + joint), seen * joint / (seen + joint)


@pytest.mark.parametrize("make", [random_graph, coincident_graph])
@settings(deadline=None, max_examples=40)
@given(seed=st.integers())
def test_the_error_is_within_its_bound(make, seed):
    graph = solvable(of_either_kind(make, seed))
    if graph is None:
        return
    omega = [0, 1e-9, 0.3, 1, 2, 17.5, 1e6]
    found, bounds = swept(graph, omega)
    for column, channel in enumerate(transfers(graph).values()):
        for w, value, bound in zip(omega, found[:, column], bounds[:, column], strict=True):
            expected = exact(channel, w)
            if bound < 1e-12 * abs(value):
                assert abs(value - expected) <= bound + 2.3e-16 * abs(expected)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers())
def test_flagged_points_are_computed_again(seed):
    rng = random.Random(seed)
    graph = solvable(coincident_graph(rng, rng.randint(1, 5)))
    if graph is None:
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(response_module, "_LONG", -1)
        assert_exact(graph, [0.25, 1.0, 2.0, 3.3], tolerance=4.5e-16)


@pytest.mark.thorough
@pytest.mark.parametrize("stages", [uniform(300), distinct(300)])
def test_a_long_chain_is_right_to_the_last_bits(stages):
    omega = np.geomspace(0.01, 100, 20)
    response = frequency_response(chain_of(stages), omega)[:, 0, 0]
    expected = np.array([by_recursion(stages, w) for w in omega])
    assert (np.abs(expected) > 0).all()
    np.testing.assert_allclose(response, expected, rtol=4.5e-16, atol=1e-302)


def test_bounds_of_a_chain_grow_slowly():
    _, bounds = swept(chain_of(uniform(300)), [0.5, 5.0])
    assert (bounds < 1e-24).all()


@pytest.mark.skipif(found() is None, reason="installed without the library")
@pytest.mark.parametrize("make", [uniform, distinct])
def test_memory_does_not_grow_with_the_chain_and_work_grows_in_step(make):
    needs = {}
    for stages in (50, 100, 400):
        graph = chain_of(make(stages))
        tape = compile_tape(graph.program, list(graph.channels().values()), graph.graph.value)
        needs[stages] = (len(tape.rows), tape.slots)
    assert needs[50][1] == needs[400][1] < 12
    assert (needs[400][0] - needs[100][0]) == 6 * (needs[100][0] - needs[50][0])


@pytest.mark.skipif(found() is None, reason="installed without the library")
@pytest.mark.parametrize(
    ("make", "size", "most"), [(tree, 5000, 20), (lambda stages: ladder(stages).balanced(), 1250, 1000)]
)
def test_few_values_are_alive_where_the_order_of_the_reduction_keeps_many(make, size, most):
    graph = make(size)
    tape = compile_tape(graph.program, list(graph.channels().values()), graph.graph.value)
    assert tape.slots < most  # in the order of the reduction 217 and 12,495


def membrane(side):
    """Build a square of masses on dampers to ground, with springs between neighbours: loops everywhere."""
    nodes, bonds, springs = [Node("u", "Se")], [Bond("u", "v0_0")], []
    for x in range(side):
        for y in range(side):
            here = f"{x}_{y}"
            mass, damping = Fraction(3 + (x + 2 * y) % 5, 4), Fraction(1 + (2 * x + y) % 3, 10)
            nodes += [Node(f"v{here}", "1"), Node(f"m{here}", "I", mass), Node(f"r{here}", "R", damping)]
            bonds += [Bond(f"v{here}", f"m{here}"), Bond(f"v{here}", f"r{here}")]
            for way, (i, k) in {"a": (x + 1, y), "b": (x, y + 1)}.items():
                if max(i, k) < side:
                    compliance = Fraction(1, 5 + (x * y + i) % 4)
                    nodes += [Node(f"j{way}{here}", "0"), Node(f"c{way}{here}", "C", compliance)]
                    bonds += [Bond(f"v{here}", f"j{way}{here}"), Bond(f"j{way}{here}", f"c{way}{here}")]
                    bonds.append(Bond(f"j{way}{here}", f"v{i}_{k}"))
                    springs.append((x * side + y, i * side + k, 1 / compliance))
    masses, dampers = (np.array([float(n.value) for n in nodes if n.type == kind]) for kind in "IR")
    return BondGraph(nodes, bonds), masses, dampers, springs


@pytest.mark.skipif(found() is None, reason="installed without the library")
def test_graphs_full_of_loops_need_memory_that_grows_more_slowly_than_their_work():
    tapes = {}
    for side in (6, 12):
        graph = ReducedGraph(membrane(side)[0], ["u"], [Port(f"v{side - 1}_{side - 1}", "f")], traced=False)
        tapes[side] = compile_tape(graph.program, list(graph.channels().values()), graph.graph.value)
    small, large = tapes[6], tapes[12]
    assert large.slots / small.slots < len(large.rows) / len(small.rows)
    assert large.slots < 10 * 12**2


def test_a_graph_full_of_loops_agrees_with_its_dense_nodal_form():
    side = 8
    graph, masses, dampers, springs = membrane(side)
    omega = np.array([0.4, 2.0, 3.7])
    last = Port(f"v{side - 1}_{side - 1}", "f")
    found, bounds = swept(ReducedGraph(graph, ["u"], [last], traced=False), omega)
    for w, value, bound in zip(omega, found[:, 0], bounds[:, 0], strict=True):
        nodal = np.diag(1j * w * masses + dampers)
        for a, b, stiffness in springs:
            nodal[[a, b, a, b], [a, b, b, a]] += np.array([1, 1, -1, -1]) * float(stiffness) / (1j * w)
        expected = np.linalg.solve(nodal, np.eye(side**2)[0])[-1]
        assert bound < 1e-18 * abs(value)
        # the dense solution is the less accurate of the two: its condition is about 1e3
        assert value == pytest.approx(expected, rel=1e-11)


def test_where_the_system_does_not_say_which_cores_may_be_used(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    found, _ = swept(chain_of(uniform(3)), [1.0, 40.0])
    np.testing.assert_allclose(found[:, 0], [by_recursion(uniform(3), w) for w in (1.0, 40.0)], rtol=4.5e-16)


def test_stiff_values():
    nodes = "Sf v, 0 base, 1 body, I m 1e12, R b 1e-12, TF t 1/1000000, 1 fluid, I i 1e12, C c 1e-12"
    bonds = "v -> base -> body, body -> m, body -> b, base -> t -> fluid, fluid -> i, fluid -> c"
    graph = written(nodes, bonds, "m.f")
    omega = [3e-12, 3e-6, 0.3, 3e6, 3e12]  # off the exact resonances
    found, bounds = swept(graph, omega)
    (channel,) = transfers(graph).values()
    expected = np.array([exact(channel, w) for w in omega])
    assert (bounds[:, 0] <= 1e-12 * np.abs(found[:, 0])).all()
    np.testing.assert_allclose(found[:, 0], expected, rtol=4.5e-16)


def test_an_undamped_ladder_at_a_resonance_of_a_part_is_flagged():
    """At omega = 1 the first mass and spring cancel exactly: a pivot is zero, the bound infinite."""
    graph = written(
        "Se u, 1 j, I m 1, C c 1, R r 1, 0 k, I n 3", "u -> j -> m, j -> c, j -> k -> n, k -> r", "n.f"
    )
    _, bounds = swept(graph, [1.0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(response_module, "_LONG", -1)
        found = frequency_response(graph, np.array([1.0]))[0, 0, 0]
    (channel,) = transfers(graph).values()
    assert found == pytest.approx(exact(channel, 1.0), rel=1e-15)
    assert not (bounds <= 1e-12).any()


def backwards(stages, omega):
    """Return v_N / F of a chain with 60 digits: the force that it takes to move the last mass, summed up."""
    with mpmath.workdps(60):
        s, velocity, force = mpmath.mpc(0, omega), mpmath.mpf(1), mpmath.mpf(0)
        for index, stage in enumerate(reversed(stages)):
            m, k, b = (mpmath.mpf(v.numerator) / v.denominator for v in stage)
            if index:
                velocity += force / (k / s + b)
                force += s * m * velocity
            else:
                force = s * m + k / s + b
        return complex(1 / force)


def test_a_pivot_of_a_large_graph_that_is_exactly_zero():
    """The first mass on its undamped spring resonates at 1 rad/s; the whole chain does not."""
    stages = [Stage(Fraction(1), Fraction(1), Fraction(0)), *distinct(300)]
    graph = ReducedGraph(chain(stages), [FORCE], [last_velocity(len(stages))], traced=False)
    omega = np.array([0.5, 1.0, np.nextafter(1.0, 2.0)])
    found = frequency_response(graph, omega)[:, 0, 0]
    np.testing.assert_allclose(found, [backwards(stages, w) for w in omega], rtol=4.5e-16)


def test_branches_of_a_large_graph_that_resonate_exactly_at_a_frequency_short_it():
    nodes = [Node("u", "Sf"), Node("j", "0"), Node("c", "C", Fraction(1)), Node("m", "I", Fraction(1, 4))]
    bonds = [Bond("u", "j"), Bond("j", "c"), Bond("j", "m")]
    links = 450  # a ladder of shunt pairs that all resonate at 2 rad/s, on one junction
    for k in range(links):
        nodes += [Node(f"b{k}", "1"), Node(f"i{k}", "I", Fraction(1, 4)), Node(f"s{k}", "C", Fraction(1))]
        bonds += [Bond("j", f"b{k}"), Bond(f"b{k}", f"i{k}"), Bond(f"b{k}", f"s{k}")]
    outputs = [Port("j", "e"), Port("b0", "f")]
    graph = ReducedGraph(BondGraph(nodes, bonds), ["u"], outputs, traced=False)
    # They share the flow equally: each takes 1/450 of it.
    np.testing.assert_allclose(
        frequency_response(graph, np.array([2.0]))[0, :, 0], [0, 1 / links], rtol=1e-15
    )


@pytest.mark.parametrize("points", [0, 1, 63, 64, 65, 200])
def test_any_number_of_frequencies(points):
    graph = chain_of(uniform(3))
    omega = np.linspace(1.0, 40.0, points)
    found, bounds = swept(graph, omega)
    assert found.shape == bounds.shape == (points, 1)
    expected = [by_recursion(uniform(3), w) for w in omega]
    np.testing.assert_allclose(found[:, 0], expected, rtol=4.5e-16)


def test_the_oracles_agree():
    (channel,) = transfers(chain_of(distinct(5))).values()
    assert by_recursion(distinct(5), 7.0) == pytest.approx(exact(channel, 7.0), rel=1e-15)
    assert Gaussian(1).over(Gaussian(2)) == 0.5


@pytest.mark.parametrize("make", [random_graph, coincident_graph])
@pytest.mark.parametrize("seed", range(12))
def test_numpy_gives_what_the_library_gives(monkeypatch, make, seed):
    graph = solvable(of_either_kind(make, seed))
    if graph is None:
        return
    omega = [0, 1e-9, 0.3, 1, 17.5, 1e100]
    found, bounds = swept(graph, omega)
    monkeypatch.setenv(VARIABLE, "0")
    plain, plain_bounds = swept(graph, omega)
    sharp, plainly = (b <= 1e-12 * np.abs(v) for b, v in ((bounds, found), (plain_bounds, plain)))
    np.testing.assert_array_equal(sharp[2:5], plainly[2:5])
    sharp &= plainly
    size = bounds + plain_bounds + 4.5e-16 * np.abs(found)
    assert (np.abs(plain - found)[sharp] <= size[sharp]).all()


@pytest.mark.thorough
def test_a_long_chain_without_the_library(monkeypatch):
    monkeypatch.setenv(VARIABLE, "0")
    omega, stages = np.geomspace(0.01, 100, 20), distinct(300)
    response = frequency_response(chain_of(stages), omega)[:, 0, 0]
    expected = np.array([by_recursion(stages, w) for w in omega])
    np.testing.assert_allclose(response, expected, rtol=4.5e-16, atol=1e-302)
    assert (swept(chain_of(stages), omega)[1] < 1e-20).all()


def test_a_value_beyond_all_doubles_is_not_trusted():
    graph = written("Se u, 1 j, I m 1, R r 1", "u -> j -> m, j -> r", "m.f")
    registers = list(graph.channels().values())
    exact_ = graph.graph.value
    _, bounds = sweep_frequencies(
        graph.program, registers, lambda name: 10**400 if name == "m" else exact_(name), np.array([1.0])
    )
    assert not np.isfinite(bounds).any()
