"""Causality: every stroke obeys its node, and the states are as many as the equations have."""

import json
import random
from collections import Counter
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.causality.scap import assign_causality
from dynid.bondgraph.graph import Port
from dynid.bondgraph.graph_state_space import natural_order
from dynid.bondgraph.results.causality import add_causality
from dynid.errors import Singular
from dynid.result import Result
from tests.bondgraph.graphs import ISOLATOR, build, chain, parse
from tests.bondgraph.random_graphs import coincident_graph, random_graph

FOLDER = Path(__file__).parents[2] / "../shared/data/bondgraphs"


def causality(nodes, bonds):
    return assign_causality(build(*parse(nodes, bonds)))


def meanings(remarks):
    return [remark.meaning for remark in remarks]


def states(found):
    return [state.name for state in found.states]


def efforts_in(found, types):
    """Return, for every node, whether effort is imposed on it, bond by bond."""
    inward = {name: [] for name in types}
    for bond in found.bonds:
        inward[bond.tail].append(bond.stroke == "tail")
        inward[bond.head].append(bond.stroke == "head")
    return inward


def assert_every_rule_is_obeyed(found, types):
    inward = efforts_in(found, types)
    for name, kind in types.items():
        efforts, flows = inward[name].count(True), inward[name].count(False)
        match kind:
            case "0":
                assert efforts == 1, name
            case "1":
                assert flows == 1, name
            case "TF":
                assert efforts == flows == 1, name
            case "GY":
                assert {efforts, flows} == {0, 2}, name
            case "Se":
                assert (efforts, flows) == (0, 1), name
            case "Sf":
                assert (efforts, flows) == (1, 0), name
    integrates = {"I": True, "C": False}
    for element in found.elements:
        (effort_in,) = inward[element.name]
        if element.type in integrates:
            wanted = "integral" if effort_in is integrates[element.type] else "derivative"
        elif element.type == "R":
            wanted = "conductive" if effort_in else "resistive"
        else:
            wanted = "fixed"
        assert element.causality == wanted, element.name


def most_integrating(types, bonds):
    """Try every causality that obeys the rules, and return the most states (None: none)."""
    best = None
    for strokes in range(2 ** len(bonds)):
        heads = [strokes >> k & 1 == 1 for k in range(len(bonds))]
        inward = {name: [] for name in types}
        for (tail, head), at_head in zip(bonds, heads, strict=True):
            inward[tail].append(not at_head)
            inward[head].append(at_head)
        counts = {name: (ends.count(True), ends.count(False)) for name, ends in inward.items()}
        allowed = {"TF": [(1, 1)], "GY": [(0, 2), (2, 0)], "Se": [(0, 1)], "Sf": [(1, 0)]}
        legal = all(
            counts[name][0] == 1
            if kind == "0"
            else counts[name][1] == 1
            if kind == "1"
            else counts[name] in allowed.get(kind, [(0, 1), (1, 0)])
            for name, kind in types.items()
        )
        if legal:
            integral = sum(counts[n] == {"I": (1, 0), "C": (0, 1)}.get(k) for n, k in types.items())
            best = max(integral, -1 if best is None else best)
    return best


# --- every graph ---------------------------------------------------------------------------------


@settings(max_examples=120, deadline=None)
@given(seed=st.integers(0, 10**6), junctions=st.integers(1, 9), loops=st.integers(0, 6))
def test_strokes_obey_every_junction_two_port_and_source(seed, junctions, loops):
    types, values, bonds, *_ = random_graph(random.Random(seed), junctions, loops)
    graph = build(types, values, bonds)
    found = assign_causality(graph)
    assert [(bond.tail, bond.head) for bond in found.bonds] == [tuple(pair) for pair in bonds]
    if not found.conflicts:
        assert_every_rule_is_obeyed(found, types)
    try:
        order = natural_order(graph)
    except Singular:
        return
    assert not found.conflicts
    assert order <= found.order  # parallel plain bonds have equal gains, which may cancel
    if not loops:
        assert order == found.order


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_values_that_coincide_can_only_take_states_away(seed):
    types, values, bonds, *_ = coincident_graph(random.Random(seed), 5)
    found = assign_causality(build(types, values, bonds))
    try:
        order = natural_order(build(types, values, bonds))
    except Singular:
        return
    assert not found.conflicts
    assert_every_rule_is_obeyed(found, types)
    assert order <= found.order


def test_no_causality_has_more_storages_that_integrate():
    """Against all causalities of small graphs with loops, where a greedy choice could go wrong."""
    seen = Counter()
    for seed in range(4000):
        rng = random.Random(seed)
        types, values, bonds, *_ = random_graph(rng, rng.randint(2, 5), 2)
        if len(bonds) > 11:
            continue
        found, best = assign_causality(build(types, values, bonds)), most_integrating(types, bonds)
        assert bool(found.conflicts) is (best is None), seed
        if best is not None:
            assert found.order == best, seed
        seen[best is None] += 1
        if seen.total() == 60:
            break
    assert min(seen.values()) >= 10


def test_a_chain_of_ten_thousand_nodes_needs_neither_recursion_nor_look_ahead():
    found = causality(*chain(1700))
    assert found.order == 3400
    assert (found.dependent, found.loops, found.conflicts) == ((), (), ())


# --- published -----------------------------------------------------------------------------------


@pytest.mark.skipif(not FOLDER.is_dir(), reason=f"the published graphs are not at {FOLDER}")
@pytest.mark.parametrize(
    ("name", "order", "dependent", "loops"),
    [
        ("bgt_C_directly_on_Se", 0, ["c"], 0),
        ("bgt_modular_RLC_parallel", 2, [], 0),
        ("felipe_ctms_dc_motor", 2, [], 0),
        ("karlinde_more_complex", 2, [], 0),
        ("loudspeaker", 3, [], 0),
        ("pybg_2r2c_building", 2, [], 0),
        ("pybg_hoisting_device", 4, [], 0),
        ("sbg_ex11_algebraic_loop", 2, [], 1),
        ("sbg_ex6_halfcar_conv_m40", 8, [], 0),
        ("sbg_ex8_derivative_causality", 2, ["kt"], 0),
    ],
)
def test_the_published_graphs(name, order, dependent, loops):
    graph = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    types = {e["name"]: e["type"] for e in graph["elements"]}
    values = {e["name"]: Fraction(e["value_exact"]) for e in graph["elements"] if e["value_exact"]}
    found = assign_causality(build(types, values, graph["bonds"]))
    assert_every_rule_is_obeyed(found, types)
    assert (found.order, len(found.loops)) == (order, loops)
    assert [remark.nodes[0] for remark in found.dependent] == dependent
    assert natural_order(build(types, values, graph["bonds"])) == order


# --- what it means -------------------------------------------------------------------------------


def test_the_isolators_fluid_is_tied_to_the_body_and_the_base():
    found = causality(*ISOLATOR)
    assert states(found) == ["p_m_s", "q_C_a"]
    assert meanings(found.dependent) == [
        "I_f (I) is in derivative causality: its momentum is determined by m_s (I) and v_in (Sf) "
        "through tuning (TF)"
    ]


def test_a_mass_behind_a_lever_is_tied_to_the_first():
    found = causality(
        "Se u, 1 j, I m1 3, TF lever 2, 1 k, I m2 5, R r 1", "u -> j -> m1, j -> lever -> k -> m2, k -> r"
    )
    (remark,) = found.dependent
    assert "momentum is determined by m1 (I) through lever (TF)" in remark.meaning
    assert remark.nodes == ("m2", "m1", "lever")


def test_a_compliance_on_an_effort_source_follows_it():
    found = causality("Se u, C c 3", "u -> c")
    assert meanings(found.dependent) == [
        "c (C) is in derivative causality: its displacement is determined by u (Se)"
    ]
    assert found.order == 0


def test_two_resistances_that_depend_on_each_other_are_a_loop():
    found = causality(
        "Se u, 1 a, I m 1, R r1 1, 0 j, R r2 1, 1 b, R r3 2, Se v",
        "u -> a -> m, a -> j -> r1, j -> b -> r2, v -> b, b -> r3",
    )
    (loop,) = found.loops
    assert set(loop.nodes) >= {"r1", "r2", "r3", "j", "b"}
    assert loop.equations == 1
    assert "one linear equation has to be solved" in loop.meaning


@pytest.mark.parametrize("bonds", ["a -> b -> c -> d -> a, u -> b", "b -> a -> d -> c -> b, b -> u"])
def test_a_ring_of_bare_junctions_comes_back_upon_itself(bonds):
    found = causality("0 a, 1 b, 0 c, 1 d, Se u", bonds)
    (loop,) = found.loops
    assert set(loop.nodes) == {"a", "b", "c", "d"}
    assert "fails where the gain once round is 1" in loop.meaning


def test_a_ring_of_gyrators_is_a_loop_without_elements():
    found = causality("Se u, 1 a, GY g 2, 1 b, GY h 3, R r 1", "u -> a -> g -> b -> h -> a, a -> r")
    assert len(found.loops) == 1
    assert not found.conflicts


@pytest.mark.parametrize(
    ("nodes", "bonds", "words"),
    [
        (
            "Se u, Se v, 0 j, R r 1",
            "u -> j, v -> j -> r",
            "u (Se) and v (Se) both set the effort of 0-junction j",
        ),
        (
            "Sf u, Sf v, 1 j, R r 1",
            "u -> j, v -> j -> r",
            "u (Sf) and v (Sf) both set the flow of 1-junction j",
        ),
        ("Sf u, Sf v, 1 j", "u -> j -> v", "u (Sf) and v (Sf) both set the flow of 1-junction j"),
        ("Se u, Se v, 1 j", "u -> j -> v", "nothing is left to set the flow of 1-junction j"),
        ("Se u, Se v", "u -> v", "u (Se) and v (Se) cannot both impose"),
        (
            "Se u, 0 a, TF t 2, 0 b, Se v, R r 1",
            "u -> a -> t -> b -> r, v -> b",
            "set the effort of 0-junction",
        ),
    ],
)
def test_sources_that_contradict_each_other_are_named(nodes, bonds, words):
    (conflict,) = causality(nodes, bonds).conflicts
    assert words in conflict.meaning
    assert "ideal sources meet with no element between them" in conflict.meaning
    assert set(conflict.nodes) >= {"u", "v"}


def test_springs_round_a_loop_of_masses_share_one_displacement():
    """Three compliances between two efforts and ground: the third follows from the other two."""
    nodes = "0 a, 0 b, 1 ab, 1 ag, 1 bg, C k1 1, C k2 1, C k3 1, I m 1, Se u, 1 in"
    bonds = "a -> ab -> b, a -> ag, b -> bg, ab -> k1, ag -> k2, bg -> k3, u -> in -> m, in -> a"
    found = causality(nodes, bonds)
    assert [remark.nodes[0] for remark in found.dependent] == ["k3"]
    assert "k1 (C)" in found.dependent[0].meaning
    assert "k2 (C)" in found.dependent[0].meaning


# --- in a result ---------------------------------------------------------------------------------


def analysed(nodes, bonds, *outputs, results=("causality",)):
    types, values, pairs = parse(nodes, bonds)
    ports = tuple(Port(*output.split(".")) for output in outputs)
    sources = tuple(name for name, kind in types.items() if kind in ("Se", "Sf"))
    return analyse(build(types, values, pairs), Analysis(sources, ports, frozenset(results)))


def test_the_result_has_a_stroke_for_every_bond_and_both_orders():
    result = analysed(*ISOLATOR, "m_s.f")
    bonds = result["bond_graph/causality/bonds"].data
    assert bonds[0].item() == ("v_in", "base", "tail", "source")
    assert len(bonds) == 8
    assert result.value("bond_graph/causality/order") == result.value("bond_graph/causality/order_exact") == 2
    assert "note" not in result.group_attrs.get("bond_graph/causality", {})


@pytest.mark.parametrize("results", [("causality",), ("causality", "properties")])
@pytest.mark.parametrize(
    ("nodes", "bonds"),
    [
        ("Se u, Se v, 0 j, R r 1", "u -> j, v -> j -> r"),
        ("Sf u, Sf v, 1 j, TF t 3, R r 2, 1 i", "u -> j -> t -> i -> r, v -> i"),
        ("Se u, 0 j, TF t 2, TF s 3, 0 i, R r 1", "u -> j -> t -> i -> r, j -> s -> i"),
    ],
)
def test_a_contradiction_is_an_error_also_where_only_causality_is_asked_for(nodes, bonds, results):
    with pytest.raises(Singular):
        analysed(nodes, bonds, "r.f", results=results)


def test_what_is_undetermined_is_a_warning_where_only_causality_is_asked_for():
    nodes, bonds = "Se u, R r 1, 0 a, 0 b", "u -> r, a -> b"
    result = analysed(nodes, bonds, "b.e")
    assert "the effort of 'a' and 'b' is not determined" in result["bond_graph/warnings"].data[0]
    assert "bond_graph/causality/bonds" in result
    with pytest.raises(Singular):
        analysed(nodes, bonds, "b.e", results=("causality", "properties"))


def test_a_state_that_the_numbers_take_away_is_explained():
    result = analysed("Se u, 1 j, I m 0, R r 1, C c 1", "u -> j -> m, j -> r, j -> c", "c.e")
    assert result.value("bond_graph/causality/order") == 2
    assert result.value("bond_graph/causality/order_exact") == 1
    assert "the values of m are zero" in result.group_attrs["bond_graph/causality"]["note"]


def test_a_loop_whose_gain_is_one_is_explained():
    ring = "0 a, 1 b, 0 c, 1 d, Se u, R r 1", "a -> b -> c -> d -> a, u -> b, c -> r"
    with pytest.raises(Singular):
        analysed(*ring, "r.f")
    result = Result("bond-graph")
    add_causality(result, build(*parse(*ring)))
    assert "order_exact" not in [path.rsplit("/", 1)[-1] for path in result]
    assert "no unique solution" in result.group_attrs["bond_graph/causality"]["note"]
