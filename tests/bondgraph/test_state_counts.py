"""Roots of graphs on loops by their state equations, against the reduction over the rationals."""

import numpy as np
import pytest
from flint import fmpq

from dynid.bench.cases.graph_shapes import _lattice
from dynid.bondgraph.floating import state_counts
from dynid.bondgraph.floating.float_engine import FloatEngine
from dynid.bondgraph.floating.state_counts import StateCounts
from dynid.bondgraph.graph import Node, Port
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.defaults import Limit
from dynid.lti.certified_roots import repeated
from dynid.scene.run import run_scene
from tests.bondgraph.test_nodal_response import Lattice
from tests.work import at_most


def engines(monkeypatch, graph, outputs):
    """The engine with state equations, and one with the program's rational functions."""
    reduced = ReducedGraph(graph, ["u"], outputs, traced=False)
    by_states = FloatEngine(reduced)
    monkeypatch.setattr(state_counts, "MANY_LOOPS", Limit(10**6, "{value}"))
    return by_states, FloatEngine(reduced)


@pytest.mark.parametrize(("ground", "link"), [("C", "R"), ("C", "RI"), ("RI", "RC")])
def test_counts_and_roots_are_those_of_rational_functions(monkeypatch, ground, link):
    lattice = Lattice(4, 2, ground, link)
    outputs = [Port("n15", "e"), Port(f"{link[0]}j0_1", "f")]
    by_states, by_program = engines(monkeypatch, lattice.graph, outputs)
    assert by_states._states
    assert not by_program._states
    for channel in by_program.channels:
        for counts, expected in zip(by_states.counts[channel], by_program.counts[channel], strict=True):
            polynomials = [
                item.polynomial / item.polynomial.leading_coefficient() for item in (counts, expected)
            ]
            assert polynomials[0] == polynomials[1]
        transfer, expected = by_states.channel(channel), by_program.channel(channel)
        for name in ("zeros", "poles", "hidden_modes"):
            roots, true = (repeated(getattr(one, name)) for one in (transfer, expected))
            np.testing.assert_allclose(roots, true, rtol=1e-11, atol=1e-12)
        for name in ("gain", "dc_gain", "high_frequency_gain"):
            assert getattr(transfer, name) == pytest.approx(getattr(expected, name), rel=1e-15, abs=0)
        for at_infinity in (False, True):
            power, factor = by_states.leading(channel, at_infinity=at_infinity)
            true_power, true_factor = by_program.leading(channel, at_infinity=at_infinity)
            assert (power, factor) == (true_power, pytest.approx(true_factor, rel=1e-15, abs=0))


def test_a_symmetric_lattice_hides_modes_and_repeats_others(monkeypatch):
    """Equal values: modes that are antisymmetric about the diagonal reach no corner."""
    lattice = Lattice(4, decades=0)
    by_states, by_program = engines(monkeypatch, lattice.graph, [Port("n15", "e")])
    (channel,) = by_states.channels
    assert [c.degree for c in by_states.counts[channel]] == [c.degree for c in by_program.counts[channel]]
    hidden = repeated(by_states.hidden_modes(channel))
    assert len(hidden) == 16 - by_states.channel(channel).order > 0
    np.testing.assert_allclose(hidden, repeated(by_program.hidden_modes(channel)), rtol=1e-10)


@pytest.mark.parametrize("port", [Port("n15", "p"), Port("u", "e")])
def test_integrals_and_reactions(monkeypatch, port):
    lattice = Lattice(4)
    by_states, by_program = engines(monkeypatch, lattice.graph, [port])
    assert bool(by_states._states) == (port.quantity != "p")
    (channel,) = by_program.channels
    for name in ("zeros", "poles"):
        roots, true = (repeated(getattr(engine.channel(channel), name)) for engine in (by_states, by_program))
        np.testing.assert_allclose(roots, true, rtol=1e-11, atol=1e-12)


def test_a_source_that_answers_with_a_derivative_keeps_the_program():
    """An effort source on a node with a capacitor: the flow that it gives follows the rate of its effort."""
    lattice = Lattice(4)
    lattice.nodes[0] = Node("u", "Se")
    reduced = ReducedGraph(lattice.graph, ["u"], [Port("u", "f")], traced=False)
    assert StateCounts.of(reduced, Port("u", "f")) is None
    engine = FloatEngine(reduced)
    assert [counts.degree for counts in engine.counts[Port("u", "f"), "u"]] == [16, 15]


def test_a_channel_below_the_range_of_doubles_has_no_finite_first_values():
    one, drive = fmpq(1), ("u", "u", 0)
    rates = {name: {("w", name): -k * one, drive: fmpq(1, 10**400)} for k, name in ((1, "x"), (2, "y"))}
    counts = StateCounts(rates, {("w", "x"): one, ("w", "y"): one}, ["u"], 101)
    assert counts.counts("u")[0].degree == 1
    assert np.isnan(counts.zeros("u", 1)).all()


def test_the_roots_of_a_lattice_take_few_operations():
    """Rational functions took three million calls here, the reduction with the output at zero as many."""
    scene = _lattice(9).scene("zeros", "poles")
    run_scene(scene)
    with at_most(calls=150_000):
        result = run_scene(scene)
    (zeros,) = (result[path].data for path in result if path.endswith("/zeros"))
    assert len(zeros) == 64


def test_properties_of_a_lattice_take_little_more_than_its_roots():
    """Gains by expansions of the program took five times the calls here."""
    scene = _lattice(9).scene("properties")
    run_scene(scene)
    with at_most(calls=150_000):
        run_scene(scene)
