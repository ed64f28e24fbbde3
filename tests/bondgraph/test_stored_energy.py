"""Stored energy as equivalent sources: in the Laplace domain, in time, and at a port."""

import random
from fractions import Fraction

import numpy as np
import pytest

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph import Bond
from dynid.bondgraph.graph_state_space import state_space
from dynid.bondgraph.reduced_graph import characteristic_polynomials
from dynid.bondgraph.results.response_results import zero_input_outputs
from dynid.errors import Singular
from dynid.lti.signals import Step
from tests.bondgraph.graphs import at, port, reduced, written
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at

S = Fraction(987654321, 1234577)
TURNED = ("Se u, 1 j, R r 2, C c 3, I m 5", "u -> j -> r, c -> j, m -> j")


def with_equivalent_sources(types, values, bonds, stored):
    """Write the same graph with each stored energy as a drawn source (Park & Kim 1997, eqs 13 to 16).

    An I is drawn with an effort source of its momentum on a 1-junction in front of it, a C with a flow
    source of its displacement on a 0-junction: e = s I f - I f(0), f = s C e - C e(0).
    """
    types, drawn = dict(types), []
    for name in stored:
        types[f"port_{name}"] = "1" if types[name] == "I" else "0"
        types[f"store_{name}"] = "Se" if types[name] == "I" else "Sf"
    for tail, head in bonds:
        if tail in stored:
            drawn += [(tail, f"port_{tail}"), (f"port_{tail}", head)]
            drawn.append((f"store_{tail}", f"port_{tail}"))
        elif head in stored:
            drawn += [(tail, f"port_{head}"), (f"port_{head}", head)]
            drawn.append((f"store_{head}", f"port_{head}"))
        else:
            drawn.append((tail, head))
    return types, values, drawn


@pytest.mark.parametrize("first", range(0, 120, 40))
def test_the_zero_input_output_is_that_of_drawn_sources(first):
    compared = 0
    for seed in range(first, first + 40):
        rng = random.Random(seed)
        types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 6), rng.choice([0, 1]))
        node, quantity = output
        stored = [name for name, kind in types.items() if kind in "IC" and name != node][:3]
        more, _, drawn = with_equivalent_sources(types, values, bonds, stored)
        sources = [f"store_{name}" for name in stored]
        expected = transfer_at(more, values, drawn, sources, output, S)
        try:
            graph = reduced(types, values, bonds, inputs, f"{node}.{quantity}")
        except Singular:
            continue
        if expected is None or not stored:
            continue
        registers = graph.stored(stored)
        found = graph.program.run(registers.values(), values, S, Fraction(1))
        for name in stored:  # the momentum I f(0) or displacement C e(0) drives
            register = registers[port(f"{node}.{quantity}"), name]
            assert found[register] == values[name] * expected[f"store_{name}"]
        compared += 1
    assert compared > 5


def test_a_storage_starts_from_what_is_given_along_the_arrow_of_its_bond():
    """The bonds of c and m point away from them; their own variables start as given nevertheless."""
    graph = written(*TURNED, "c.e", "m.f", "c.q", "m.p")
    initial = {"c": Fraction(7), "m": Fraction(11)}
    asked = Analysis(
        (), graph.outputs, frozenset({"time_response"}), times=np.array([0.0, 1.0]), initial=initial
    )
    start = analyse(graph.graph, asked)["bond_graph/time_response/response"].data[0]
    assert start.tolist() == [7, 11, -21, -55]  # e = -Z f: q = -C e, p = -I f
    for name, value in zip(("c.e", "m.f", "c.q", "m.p"), start, strict=True):
        output = zero_input_outputs(graph, initial)[port(name)]
        lead = Fraction(int(output.numerator.leading_coefficient()))
        assert lead / int(output.denominator.leading_coefficient()) == value
        assert output.relative_degree == 1


@pytest.mark.parametrize("seed", range(20))
def test_the_laplace_transform_is_that_of_the_time_response(seed):
    """Against (sI - A)^-1 of the state equations, which share no step with the reduction."""
    rng = random.Random(seed)
    types, values, bonds, inputs, (node, quantity) = random_graph(rng, rng.randint(1, 5), 0)
    stored = [name for name, kind in types.items() if kind in "IC"]
    try:
        graph = reduced(types, values, bonds, inputs, f"{node}.{quantity}")
        system = state_space(graph, stored)
    except Singular:
        return
    s = 1.25
    resolvent = np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B)
    transfer = system.C @ resolvent + system.D
    for power, matrix in enumerate(system.higher, 1):
        transfer = transfer + s**power * matrix
    initial = {name: Fraction(k + 1) for k, name in enumerate(stored)}
    expected = sum(float(v) * transfer[0, system.inputs.index(f"initial:{n}")] for n, v in initial.items())
    (output,) = zero_input_outputs(graph, initial).values() if stored else (None,)
    if output is not None:
        # the resolvent is taken in doubles, of a matrix with entries up to 1e3
        assert float(at(output, Fraction(5, 4))) == pytest.approx(expected, rel=1e-8, abs=1e-9)


def test_the_zero_input_output_stands_over_all_natural_modes():
    """Two equal branches: their difference decays unseen by the sum; its mode stays in the denominator."""
    nodes = "Se u, 1 s, R z 1, 0 j, 1 a, R r1 3, I m1 2, 1 b, R r2 3, I m2 2"
    bonds = "u -> s -> z, s -> j, j -> a -> r1, a -> m1, j -> b -> r2, b -> m2"
    graph = written(nodes, bonds, "s.f", "m1.f")
    natural = characteristic_polynomials(graph)[port("s.f")]
    outputs = zero_input_outputs(graph, {"m1": Fraction(1), "m2": Fraction(-1)})
    assert outputs[port("s.f")].vanishes
    assert outputs[port("m1.f")].denominator.degree() == natural.degree() == 2
    assert at(outputs[port("m1.f")], Fraction(1)) == 1 / (1 + Fraction(3, 2))  # exp(-1.5 t)


def test_forced_and_free_response_superpose():
    graph = written(*TURNED, "c.e", "m.f")
    times, asked = np.linspace(0, 5, 51), frozenset({"time_response"})
    signals, initial = (("u", Step(2.0)),), {"c": Fraction(7), "m": Fraction(11)}

    def run(signals, initial):
        analysis = Analysis(("u",), graph.outputs, asked, times=times, signals=signals, initial=initial)
        return analyse(graph.graph, analysis)

    both, free, forced = run(signals, initial), run((), initial), run(signals, {})
    group = "bond_graph/time_response"
    assert both.value(f"{group}/zero_input").tolist() == free.value(f"{group}/response").tolist()
    assert both.value(f"{group}/zero_state").tolist() == forced.value(f"{group}/response").tolist()
    total = free.value(f"{group}/response") + forced.value(f"{group}/response")
    assert both.value(f"{group}/response").tolist() == total.tolist()
    assert f"{group}/zero_input" not in free


def test_stored_energy_is_an_equivalent_source_at_a_port():
    """Eqs 13, 14 with erratum 3: an I that integrates adds f(0)/s to the flow of its side."""
    graph = written("Sf u, 0 j, R r 2, I m 5, C c 3", "u -> j -> r, j -> m, c -> j", "r.e")
    analysis = Analysis(
        ("u",), graph.outputs, frozenset(), initial={"m": Fraction(4), "c": Fraction(2)}, port=Bond("j", "m")
    )
    result = analyse(graph.graph, analysis)
    # the load is m alone: out of it flows -(e/(5 s) + 4/s)
    assert result.value("bond_graph/port/load/Y_eq/exact") == "1/(5*s)"
    assert result.value("bond_graph/port/load/f_eq/initial:m/exact") == "(-4)/s"
    # the source: u and the C's displacement 3 * 2 = 6 drive a 0-junction of 1/2 + 3 s
    assert result.value("bond_graph/port/source/f_eq/initial:c/exact") == "6"
    assert result.value("bond_graph/port/source/Y_eq/exact") == "(6*s + 1)/2"
    assert result.value("bond_graph/port/source/e_eq/initial:c/exact") == "12/(6*s + 1)"
