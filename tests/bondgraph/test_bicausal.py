"""The zero dynamics as a graph: bicausal from output to input, its states as many as the zeros."""

import random
from functools import reduce

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.causality.bicausal import zero_causality
from dynid.bondgraph.causality.scap import assign_causality
from dynid.bondgraph.graph_state_space import zero_parts
from dynid.bondgraph.reduced_graph import characteristic_polynomials
from dynid.errors import Singular
from tests.bondgraph.graphs import ISOLATOR, build, chain, parse, port, reduced, transfers, written
from tests.bondgraph.random_graphs import random_graph


def cases(seed, junctions, loops):
    """Yield (graph, reduced graph, port, source) of a random graph that is determined in all its parts."""
    types, values, bonds, inputs, (node, quantity) = random_graph(random.Random(seed), junctions, loops)
    graph = build(types, values, bonds)
    try:
        work = reduced(types, values, bonds, inputs, f"{node}.{quantity}")
    except Singular:
        return
    if not work.undetermined and not assign_causality(graph).conflicts:
        for source in inputs:
            yield graph, work, work.outputs[0], source


def zeros(work, where, source):
    try:
        return sum(len(part.states) for part in zero_parts(work, where, source))
    except Singular:
        return None


def imposed(found):
    """Return what is imposed on each node, bond by bond: (effort in, flow in)."""
    inward = {}
    for bond in found.bonds:
        for name, end in ((bond.tail, "tail"), (bond.head, "head")):
            inward.setdefault(name, []).append((bond.effort == end, bond.flow == end))
    return inward


def assert_every_rule_is_obeyed(found, types, detector, source):
    for name, bonds in imposed(found).items():
        efforts, flows = [e for e, _ in bonds], [f for _, f in bonds]
        match "detector" if name == detector else "input" if name == source else types.get(name, "new"):
            case "detector":
                assert bonds == [(False, False)]
            case "input":
                assert bonds == [(True, True)]
            case "0":
                assert (efforts.count(True), flows.count(False)) == (1, 1), name
            case "1":
                assert (flows.count(True), efforts.count(False)) == (1, 1), name
            case "TF":
                assert (efforts.count(True), flows.count(True)) == (1, 1), name
            case "GY":  # e1 = r f2 and e2 = r f1: one of each pair comes in
                assert efforts[0] != flows[1], name
                assert efforts[1] != flows[0], name
            case "Se":
                assert bonds == [(False, True)], name
            case "Sf":
                assert bonds == [(True, False)], name
            case "R" | "I" | "C":
                assert efforts[0] != flows[0], name


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), junctions=st.integers(1, 7), loops=st.integers(0, 3))
def test_the_states_inside_are_as_many_as_the_zeros(seed, junctions, loops):
    for graph, work, where, source in cases(seed, junctions, loops):
        found, exact = zero_causality(graph, where, source), zeros(work, where, source)
        if found is None:
            assert exact is None
            continue
        types = {name: node.type for name, node in graph.nodes.items()}
        (detector,) = {bond.head for bond in found.bonds if bond.head not in types} & {found.line[-1]}
        assert found.line[0] == source
        assert_every_rule_is_obeyed(found, types, detector, source)
        modelled = set(work.reductions[where].modelled)
        inside = sum(state.element in modelled for state in found.inside.states)
        if loops == 0:
            assert exact == inside
        elif exact is not None:
            assert exact <= inside  # the gains of plain bonds are equal: parallel lines may cancel


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), junctions=st.integers(1, 6), loops=st.integers(0, 3))
def test_the_parts_multiply_to_the_numerator_and_the_hidden_modes(seed, junctions, loops):
    """N of T = N / D, times what D lacks of the natural polynomial."""
    for graph, work, where, source in cases(seed, junctions, loops):
        if zeros(work, where, source) is None:
            continue
        exact = transfers(work)[str(where), source]
        natural = characteristic_polynomials(work)[where]
        if where.quantity in "qp" and not graph.is_state(where):
            natural = natural * type(natural)([0, 1])
        parts = [part.polynomial for part in zero_parts(work, where, source)]
        whole = reduce(lambda a, b: a * b, parts, type(natural)([1]))
        left, right = whole * exact.denominator, exact.numerator * natural
        assert left * right.leading_coefficient() == right * left.leading_coefficient()


def analysed(nodes, bonds, *outputs):
    types, values, pairs = parse(nodes, bonds)
    sources = tuple(name for name, kind in types.items() if kind in ("Se", "Sf"))
    ports = tuple(port(output) for output in outputs)
    return analyse(build(types, values, pairs), Analysis(sources, ports, frozenset({"causality"})))


def test_the_isolators_zero_dynamics_are_its_fluid_and_its_air():
    result = analysed(*ISOLATOR, "m_s.f")
    group = "bond_graph/causality/zero_dynamics/m_s.f/v_in"
    assert result[f"{group}/line"].data.tolist() == ["v_in", "base", "body", "m_s.f"]
    assert result[f"{group}/internal_state"].data.tolist() == ["p_I_f", "q_C_a"]
    assert result[f"{group}/derivative_storage"].data.tolist() == ["m_s"]
    assert result[f"{group}/parts"].data["elements"].tolist() == ["I_f, C_a"]
    assert result.value(f"{group}/zeros_structural") == result.value(f"{group}/zeros_exact") == 2
    assert result.value(f"{group}/relative_degree_structural") == 0
    assert result.value(f"{group}/relative_degree_exact") == 0
    assert result.value(f"{group}/meaning") == (
        "zero dynamics, with m_s.f held at zero by v_in: states of I_f (I) and C_a (C)"
    )


def test_the_isolators_zero_dynamics_are_written_in_its_symbols():
    result = analysed(*ISOLATOR, "m_s.f")
    group = "bond_graph/causality/zero_dynamics/m_s.f/v_in"
    states = result[f"{group}/state"].data.tolist()
    assert dict(zip(states, result[f"{group}/equations"].data, strict=True)) == {
        "fluid.f": "d/dt fluid.f = -1/I_f*C_a.e",
        "C_a.e": "d/dt C_a.e = 1/C_a*fluid.f",
    }
    assert result.value(f"{group}/input_equation") == "v_in = 1/tuning*fluid.f"  # the fluid swallows the base


def test_every_zero_of_a_chain_is_carried_by_one_spring_and_its_damper():
    graph = written(*chain(5), "m5.f")
    found = zero_parts(graph, graph.outputs[0], "F")
    assert {part.elements for part in found} == {(f"k{i}", f"b{i}") for i in range(1, 5)} | {("k5",)}


@pytest.mark.parametrize(
    ("output", "zeros_left", "degree"), [("m.f", 1, 1), ("m.p", 1, 1), ("m.q", 1, 2), ("k.q", 0, 2)]
)
def test_the_structural_relative_degree_counts_integrations(output, zeros_left, degree):
    result = analysed("Se u, 1 j, I m 2, C k 3, R r 1", "u -> j -> m, j -> k, j -> r", output)
    group = f"bond_graph/causality/zero_dynamics/{output}/u"
    for kind in ("structural", "exact"):
        assert result.value(f"{group}/zeros_{kind}") == zeros_left
        assert result.value(f"{group}/relative_degree_{kind}") == degree


def test_two_lines_of_power_that_cancel_are_explained():
    """A balanced bridge: the input does not reach the detector, although its structure would let it."""
    nodes = "Se u, 0 a, 1 p, 1 q, R r1 1, R r2 1, 0 b, R d 5, 1 s, 1 t, R r3 1, R r4 1, 0 c, 1 m"
    bonds = "u -> a, a -> p -> b, p -> r1, a -> q -> c, q -> r2"
    bonds += ", b -> s, s -> r3, c -> t, t -> r4, b -> m -> c, m -> d"
    result = analysed(nodes, bonds, "d.f")
    group = "bond_graph/causality/zero_dynamics/d.f/u"
    assert f"{group}/zeros_exact" not in result
    assert "contributions cancel (2 lines of power were compared)" in result.group_attrs[group]["note"]


def test_a_channel_without_a_line_of_power_says_so():
    result = analysed("Se u, 0 a, R r 1, 1 b, I m 2, Se v", "u -> a -> r, a -> b -> m, v -> b", "r.e")
    group = "bond_graph/causality/zero_dynamics/r.e/v"
    assert result.value(f"{group}/meaning") == "the input v does not reach r.e: no zero dynamics"
    assert f"{group}/bonds" not in result
