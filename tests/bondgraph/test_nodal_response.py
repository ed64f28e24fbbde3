"""The response of graphs on many loops by sparse factors, against balances solved in 60 digits."""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from flint import acb, acb_mat, arb, ctx, fmpq

from dynid.bench.cases.graph_shapes import _analysis, _chain, _ladder, _lattice
from dynid.bondgraph import nodal_response
from dynid.bondgraph.analysis_request import modelled_storages
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.nodal_response import NodalResponse
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.defaults import Limit
from dynid.scene.run import run_scene
from tests.work import at_most, calls_of

OMEGA = np.array([0.01, 0.3, 1.0, 7.0])


@pytest.fixture
def small(monkeypatch):
    """Let small graphs take sparse factors."""
    monkeypatch.setattr(nodal_response, "NODAL_RESPONSES", Limit(0, "{value}"))


class Lattice:
    """A square lattice of nodes to ground by one-ports, joined by links of one-ports in series."""

    def __init__(self, side, seed=0, ground="C", link="R", two_port=None, decades=0.5):
        draw = np.random.default_rng(seed)
        self.side, self.elements, self.nodes, self.bonds = side, [], [Node("u", "Sf")], [Bond("u", "n0")]
        self.ratio = Fraction(1)
        for k in range(side * side):
            self.nodes.append(Node(f"n{k}", "0"))
            self._add(f"n{k}", ground, (k, None), draw, decades)
        across = [(k, k + 1) for k in range(side * side) if (k + 1) % side]
        for tail, head in [*across, *((k, k + side) for k in range(side * (side - 1)))]:
            name = f"j{tail}_{head}"
            self.nodes.append(Node(name, "1"))
            self.bonds += [Bond(f"n{tail}", name), Bond(name, f"n{head}")]
            self._add(name, link, (tail, head), draw, decades)
        if two_port:  # a lattice behind a transformer or gyrator
            self.ratio = Fraction(5, 2)
            self.nodes += [Node("x", "1" if two_port == "GY" else "0"), Node("T", two_port, self.ratio)]
            self.nodes.append(Node("rx", "R", Fraction(3)))
            self.bonds[0] = Bond("u", "x")
            self.bonds += [Bond("x", "rx"), Bond("x", "T"), Bond("T", "n0")]
            if two_port == "GY":
                self.nodes[0] = Node("u", "Se")

    def _add(self, junction, kinds, ends, draw, decades):
        for kind in kinds:
            value = Fraction(round(1000 * 10 ** draw.uniform(-decades, decades)) + 1, 1000)
            self.nodes.append(Node(f"{kind}{junction}", kind, value))
            self.bonds.append(Bond(junction, f"{kind}{junction}"))
            self.elements.append((junction, kind, value, ends))

    @property
    def graph(self):
        return BondGraph(self.nodes, self.bonds)

    def impedance(self, junction, s):
        """The impedance of a link, or the admittance of a node, in balls."""
        total = acb(0)
        for place, kind, value, _ in self.elements:
            if place == junction:
                exact = acb(arb(fmpq(value.numerator, value.denominator)))
                law = exact if kind == "R" else s * exact
                direct = (kind == "C") if junction[0] == "n" else (kind in "RI")
                total += law if direct else 1 / law
        return total

    def efforts(self, omega):
        """The efforts of all nodes for a unit flow into the first, in 60 digits."""
        with ctx.workprec(200):
            s, count = acb(0, float(omega)), self.side**2
            matrix = acb_mat(count, count)
            for k in range(count):
                matrix[k, k] += self.impedance(f"n{k}", s)
            for junction, ends in {
                (place, ends) for place, _, _, ends in self.elements if ends[1] is not None
            }:
                admittance = 1 / self.impedance(junction, s)
                for i in ends:
                    for j in ends:
                        matrix[i, j] += admittance if i == j else -admittance
            drive = acb_mat([[1 if k == 0 else 0] for k in range(count)])
            solved = matrix.solve(drive)
            return np.array([complex(solved[k, 0].mid()) for k in range(count)])


def nodal(graph, inputs, outputs):
    """The response by sparse factors, whatever the fill."""
    return NodalResponse(JunctionStructure(graph), inputs, outputs).at(OMEGA)


@pytest.mark.parametrize(
    ("ground", "link"), [("C", "R"), ("C", "RI"), ("CR", "RIC"), ("CI", "R"), ("RI", "RC")]
)
@pytest.mark.parametrize("seed", range(3))
def test_responses_of_lattices_lie_within_their_bounds(ground, link, seed):
    lattice = Lattice(4, seed, ground, link, decades=2)
    outputs = [Port("n15", "e"), Port(f"{ground[0]}n7", "f"), Port("n0", "e")]
    response, bounds = nodal(lattice.graph, ["u"], outputs)
    for row, omega in enumerate(OMEGA):
        exact = lattice.efforts(omega)
        law = complex(0, omega) * float(next(v for p, k, v, _ in lattice.elements if p == "n7"))
        law = {"C": law, "I": 1 / law if law else 0, "R": 1 / (law.imag / omega)}[ground[0]]
        expected = np.array([exact[15], exact[7] * law, exact[0]])
        error = np.abs(response[row, :, 0] - expected)
        assert (error <= bounds[row, :, 0] + 4e-16 * np.abs(expected)).all()
        assert (bounds[row, :, 0] <= 1e-13 * np.abs(expected)).all()


@pytest.mark.parametrize("two_port", ["TF", "GY"])
def test_two_ports_and_integrals(two_port):
    """Against the reduction program, which knows nothing of nodal matrices."""
    lattice = Lattice(3, 1, "CR", "RI", two_port)
    outputs = [Port("n8", "e"), Port("Cn4", "q"), Port("j0_1", "f"), Port("Rn3", "f"), Port("n2", "p")]
    planned = ReducedGraph(lattice.graph, ["u"], outputs)
    assert planned.nodal is None
    np.testing.assert_allclose(
        nodal(lattice.graph, ["u"], outputs)[0], frequency_response(planned, OMEGA), rtol=1e-13
    )


@pytest.mark.usefixtures("small")
def test_a_lattice_takes_sparse_factors_without_a_plan():
    lattice, port = Lattice(5), Port("n24", "e")
    reduced = ReducedGraph(lattice.graph, ["u"], [port], traced=False)
    response = frequency_response(reduced, OMEGA)
    assert "program" not in vars(reduced)
    planned = ReducedGraph(lattice.graph, ["u"], [port])
    np.testing.assert_allclose(response, frequency_response(planned, OMEGA), rtol=1e-13)
    assert (reduced.dropped(port), modelled_storages(reduced)) == ((), 25)
    assert reduced.channels().keys() == planned.channels().keys()  # planned now


@pytest.mark.usefixtures("small")
def test_a_lattice_without_inputs_has_no_responses():
    reduced = ReducedGraph(Lattice(5).graph, (), [Port("n24", "e")], traced=False)
    assert reduced.nodal is not None
    assert frequency_response(reduced, OMEGA).shape == (4, 1, 0)


def test_the_fill_decides():
    graph = Lattice(5).graph
    assert ReducedGraph(graph, ["u"], [Port("n24", "e")], traced=False).nodal is None


@pytest.mark.usefixtures("small")
def test_what_is_left_out_is_that_of_the_program():
    """A source at zero that fixes a node, with what hangs on it; a source that is no input."""
    lattice = Lattice(5)
    lattice.nodes += [Node("hold", "Se"), Node("idle", "Sf"), Node("far", "R", Fraction(1)), Node("n", "0")]
    lattice.nodes += [Node("l", "1"), Node("rl", "R", Fraction(1))]
    lattice.bonds += [Bond("hold", "n"), Bond("n", "far"), Bond("n", "l"), Bond("l", "rl"), Bond("l", "n5")]
    lattice.bonds.append(Bond("idle", "n7"))
    for inputs in (["u"], ["u", "hold"]):
        port = Port("n24", "e")
        reduced = ReducedGraph(lattice.graph, inputs, [port], traced=False)
        planned = ReducedGraph(lattice.graph, inputs, [port])
        assert reduced.nodal is not None
        assert reduced.dropped(port) == planned.dropped(port) != ()
        np.testing.assert_allclose(
            frequency_response(reduced, OMEGA), frequency_response(planned, OMEGA), rtol=1e-13
        )


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("change", ["negative", "open", "fixed output"])
def test_what_the_structure_does_not_decide_is_planned(change):
    lattice, output = Lattice(5), Port("n24", "e")
    if change == "negative":
        place = next(k for k, node in enumerate(lattice.nodes) if node.name == "Rj0_1")
        lattice.nodes[place] = Node("Rj0_1", "R", Fraction(-1))
    elif change == "open":  # a part of its own
        lattice.nodes += [Node("a", "0"), Node("ra", "R", Fraction(1)), Node("ua", "Sf")]
        lattice.bonds += [Bond("ua", "a"), Bond("a", "ra")]
    else:
        output = Port("u", "f")
    assert ReducedGraph(lattice.graph, ["u"], [output], traced=False).nodal is None


@pytest.mark.usefixtures("small")
def test_nodes_without_elements_are_solved_for():
    """Only the corners of a mesh of resistors have elements: the efforts between are fixed by the links."""
    lattice = Lattice(5)
    inner = {f"Cn{k}" for k in range(1, 24)}
    nodes = [node for node in lattice.nodes if node.name not in inner]
    bonds = [bond for bond in lattice.bonds if bond.head not in inner]
    reduced = ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port("n24", "e")], traced=False)
    planned = ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port("n24", "e")])
    assert reduced.nodal is not None
    np.testing.assert_allclose(
        frequency_response(reduced, OMEGA), frequency_response(planned, OMEGA), rtol=1e-12
    )


@pytest.mark.usefixtures("small")
def test_a_frequency_of_an_undamped_mode_is_left_to_the_program():
    """Equal products of I and C on every link resonate at 1 rad/s: the links are open there."""
    lattice = Lattice(5, ground="C", link="I")
    inertias = [(place, value) for place, kind, value, _ in lattice.elements if kind == "I"]
    nodes = [*lattice.nodes, *(Node(f"C{place}", "C", 1 / value) for place, value in inertias)]
    bonds = [*lattice.bonds, *(Bond(place, f"C{place}") for place, _ in inertias)]
    reduced = ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port("n24", "e")], traced=False)
    assert reduced.nodal is not None
    assert not np.isfinite(reduced.nodal.at(np.array([1.0]))[1]).any()
    assert np.isfinite(reduced.nodal.at(np.array([0.9]))[1]).all()
    planned = ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port("n24", "e")])
    at_mode = np.array([1.0, 1.1])
    np.testing.assert_allclose(
        frequency_response(reduced, at_mode), frequency_response(planned, at_mode), rtol=1e-12
    )


@pytest.mark.usefixtures("small")
def test_values_of_samples_do_not_keep_the_matrix_of_others():
    lattice = Lattice(5)
    reduced = ReducedGraph(lattice.graph, ["u"], [Port("n24", "e")], traced=False)
    sample = reduced.with_values({"Cn0": Fraction(7)})
    expected = ReducedGraph(lattice.graph.with_values({"Cn0": Fraction(7)}), ["u"], [Port("n24", "e")])
    np.testing.assert_allclose(
        frequency_response(sample, OMEGA), frequency_response(expected, OMEGA), rtol=1e-12
    )


def _chain_scene(stages, *results):
    return _analysis(*_chain(stages), "m0.f", *results)


#: Every shape of the benchmarks: its scene, and its nodes.
SHAPES = {
    "lattice": (_lattice(14).scene, 196),
    **{f"ladder of {rungs}": (_ladder(rungs).scene, 2 * rungs) for rungs in (20, 40, 100)},
    "chain": (partial(_chain_scene, 30), 180),
}


@pytest.mark.parametrize(("scene", "nodes"), SHAPES.values(), ids=SHAPES)
def test_a_default_run_costs_little_more_than_its_response(scene, nodes):
    """Peaks, scope and labels: no shape of some hundred nodes takes more calls than 400 a node."""
    built = scene("frequency_response")
    run_scene(built)
    with at_most(calls=400 * nodes + 10_000):
        run_scene(built)


@pytest.mark.parametrize("scene", [_lattice(7).scene, _ladder(20).scene, partial(_chain_scene, 25)])
def test_properties_cost_no_more_than_ten_times_the_roots_that_they_need(scene):
    built = [scene("properties"), scene("zeros", "poles")]
    for each in built:
        run_scene(each)
    properties, roots = (calls_of(run_scene, each) for each in built)
    assert properties <= 10 * roots
