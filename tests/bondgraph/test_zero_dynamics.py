"""Zero dynamics: with the output held at zero, their modes are the zeros of the channel."""

import math
from fractions import Fraction

import numpy as np
import pytest

from dynid.bondgraph.graph_state_space import state_space, zero_dynamics, zero_parts
from dynid.errors import Singular
from tests.bondgraph.graphs import ISOLATOR, chain, polynomial_at, transfers, written
from tests.bondgraph.tableau import transfer_at
from tests.bondgraph.test_state_space import regular


def determinant(A, s):
    return float(np.linalg.det(s * np.eye(len(A)) - A))


def through(stages):
    """A force in at the first mass of a chain, the velocity out at the last."""
    return written(*chain(stages), f"m{stages}.f")


def only_port(graph):
    return graph.outputs[0]


@pytest.mark.parametrize("count", [80, pytest.param(250, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("junctions", "loops", "quantities"), [(4, 0, "ef"), (6, 2, "efqp"), (4, 4, "ef")])
def test_the_modes_of_the_zero_dynamics_are_the_zeros(junctions, loops, quantities, count):
    """T is det(s - A_z) / det(s - A) up to a constant, so its ratio at two points is known (tableau)."""
    checked = 0
    for *case, graph in regular(range(3000, 3000 + count), junctions, loops, quantities):
        port = only_port(graph)
        system = state_space(graph)
        far = 2 + 2 * float(abs(np.linalg.eigvals(system.A)).max(initial=0.0))
        for source in graph.inputs:
            exact = transfers(graph)[str(port), source]
            if exact.vanishes:
                with pytest.raises(Singular, match="does not reach"):
                    zero_dynamics(graph, port, source)
                with pytest.raises(Singular, match="does not reach"):
                    zero_parts(graph, port, source)
                continue
            inside, parts = zero_dynamics(graph, port, source), zero_parts(graph, port, source)
            assert len(inside.A) == len(system.A) - exact.relative_degree
            assert sum(len(part.states) for part in parts) == len(inside.A)
            far = max(far, 2 + 2 * float(abs(np.linalg.eigvals(inside.A)).max(initial=0.0)))
            points = Fraction(far), Fraction(3 * far)
            exactly = [transfer_at(*case, s) for s in points]
            if None in exactly:  # singular in a part that the output does not depend on
                continue
            ratio = float(exactly[1][source] / exactly[0][source])
            natural = determinant(system.A, float(points[1])) / determinant(system.A, float(points[0]))
            found = determinant(inside.A, float(points[1])) / determinant(inside.A, float(points[0]))
            assert found / natural == pytest.approx(ratio, rel=1e-10)
            one, other = (math.prod(polynomial_at(part.polynomial, s) for part in parts) for s in points)
            assert float(other / one) / natural == pytest.approx(ratio, rel=1e-10)
            checked += 1
    assert checked >= count / 5


def test_the_isolators_fluid_resonates_while_the_body_stands_still():
    graph = written(*ISOLATOR, "m_s.f")
    inside = zero_dynamics(graph, only_port(graph), "v_in")
    # m_e s^2 + A_p^2 / C_a = 0
    assert sorted(np.linalg.eigvals(inside.A).imag) == pytest.approx([-np.sqrt(5e3), np.sqrt(5e3)], rel=1e-14)
    assert (inside.inputs, inside.outputs) == ((), ("v_in",))


def test_the_input_that_holds_the_output_still():
    """No force on the mass: it keeps its velocity, and the input is what spring and damper take."""
    graph = written("Se F, 1 v, I m 2, C k 1/3, R b 5", "F -> v -> m, v -> k, v -> b", "m.e")
    inside = zero_dynamics(graph, only_port(graph), "F")
    assert inside.states == ("v.f", "k.e")
    assert inside.A.tolist() == [[0, 0], [3, 0]]
    assert inside.C.tolist() == [[5, 1]]


def test_an_input_that_is_differentiated_holds_the_output_by_standing_still():
    graph = written("Se u, C c 3", "u -> c", "c.f")
    inside = zero_dynamics(graph, only_port(graph), "u")
    assert (inside.states, inside.A.tolist(), inside.C.tolist()) == (("c.e",), [[0]], [[1]])


@pytest.mark.thorough
def test_a_chain_has_one_small_block_for_every_zero():
    graph = through(500)
    parts = zero_parts(graph, only_port(graph), "F")
    assert {part.polynomial.degree() for part in parts} == {1}
    found = np.sort([-int(p.polynomial[0]) / int(p.polynomial[1]) for p in parts])
    exact = np.sort([0, *(-(1000 + 7 * i) / (10 + i % 13) for i in range(1, 500))])
    assert np.abs(found - exact).max() <= 2.0**-52 * np.abs(exact).max()


def test_the_coupled_equations_of_a_short_chain_have_the_same_modes():
    graph = through(3)
    inside = zero_dynamics(graph, only_port(graph), "F")
    assert np.sort(np.linalg.eigvals(inside.A)) == pytest.approx([-1007 / 11, -1014 / 12, 0], abs=1e-10)


def test_the_zero_dynamics_of_a_very_large_part_keep_their_states_without_a_polynomial():
    # held at the driven mass the rest of the chain is one part: of 199 states
    graph = written(*chain(100), "v1.f")
    (part,) = zero_parts(graph, graph.outputs[0], "F")
    assert len(part.states) == 199
    assert part.polynomial is None
