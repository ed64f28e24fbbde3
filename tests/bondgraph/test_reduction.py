"""The reduction against an independent tableau: exact equality, and singular exactly when it must be."""

import random
import re
from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bench.cases.frequency_response import ladder
from dynid.bondgraph.graph import Bond, BondGraph, Node, graph_faults
from dynid.bondgraph.program.program import operands
from dynid.bondgraph.reduction.junctions import NameRegistry, unique
from dynid.errors import Singular, UsageError
from tests.bondgraph.graphs import at, chain, parse, reduced, transfers, written
from tests.bondgraph.random_graphs import coincident_graph, random_graph
from tests.bondgraph.tableau import determined_at, solvable_at, transfer_at
from tests.sample import sample

#: No zero or pole of a test graph is likely here.
S = Fraction(987654321, 1234577)


def reduction_at(types, values, bonds, inputs, output, s):
    """Return {input: T(s)} from the reduction, or None where it is singular."""
    try:
        graph = reduced(types, values, bonds, inputs, f"{output[0]}.{output[1]}")
    except Singular:
        return None
    return {source: at(channel, s) for (_, source), channel in transfers(graph).items()}


def assert_agrees(case, s=S):
    """Compare with the tableau: answered where all sources can be prescribed and the output follows."""
    found, whole = reduction_at(*case, s), transfer_at(*case, s)
    if whole is None and solvable_at(*case[:3], s):
        whole = determined_at(*case, s)
    assert found == whole


@pytest.mark.parametrize("first", sample(range(0, 300, 25), 6))
def test_random_graphs_agree_exactly_with_the_tableau(first):
    for seed in range(first, first + 25):
        rng = random.Random(seed)
        assert_agrees(random_graph(rng, rng.randint(1, 9), rng.choice([0, 0, 1, 2, 5])))


@pytest.mark.parametrize("first", sample(range(50_000, 50_400, 50), 4))
def test_graphs_full_of_numeric_coincidences_agree_exactly_with_the_tableau(first):
    for seed in range(first, first + 50):
        rng = random.Random(seed)
        assert_agrees(coincident_graph(rng, rng.randint(1, 6)))


@settings(max_examples=100)
@given(seed=st.integers(), s=st.fractions(min_value=-50, max_value=50))
def test_any_random_graph_agrees_at_any_point(seed, s):
    case = random_graph(rng := random.Random(seed), rng.randint(1, 6), rng.choice([0, 0, 1, 2]))
    found = reduction_at(*case, s) if s else None
    whole = transfer_at(*case, s) if s else None
    if found is not None and whole is not None:
        # at a natural frequency the tableau is singular; elsewhere both have a value
        assert found == whole


@settings(max_examples=100)
@given(seed=st.integers())
def test_reversing_the_bond_of_a_one_port_changes_signs_only(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 5), 1)
    ends = [
        k for k, bond in enumerate(bonds) if any(types[end] not in ("TF", "GY", "0", "1") for end in bond)
    ]
    turned = rng.choice(ends)
    reversed_bonds = [bond[::-1] if k == turned else bond for k, bond in enumerate(bonds)]
    before = reduction_at(types, values, bonds, inputs, output, S)
    after = reduction_at(types, values, reversed_bonds, inputs, output, S)
    if before is None:
        assert after is None
    else:
        assert {k: abs(v) for k, v in before.items()} == {k: abs(v) for k, v in after.items()}


@pytest.mark.thorough
@settings(max_examples=100)
@given(seed=st.integers())
def test_several_outputs_give_what_each_gives_alone(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, _ = random_graph(rng, rng.randint(1, 5), rng.choice([0, 1]))
    passive = [name for name, kind in types.items() if kind in ("R", "I", "C")]
    outputs = [f"{name}.{quantity}" for name in passive[:3] for quantity in "ef"]
    try:
        together = transfers(reduced(types, values, bonds, inputs, *outputs))
    except Singular:
        return
    for output in outputs:
        alone = transfers(reduced(types, values, bonds, inputs, output))
        assert alone == {channel: t for channel, t in together.items() if channel[0] == output}


# Each: nodes, bonds, output, and what T(s) is at s = 2 for every input.
BY_HAND = {
    "a TF scales forwards": (
        "Se u, TF n 3, R r 2", "u -> n -> r",
        "r.e", {"u": Fraction(1, 3)},
    ),
    "a TF scales backwards": (
        "Se u, TF n 3, R r 2", "r -> n -> u",
        "r.e", {"u": 3},
    ),
    "a TF reflects by n squared": (
        "Se u, TF n 3, R r 2", "u -> n -> r",
        "u.f", {"u": Fraction(1, 18)},
    ),
    "a GY turns effort into flow": (
        "Se u, GY g 4, R r 2", "u -> g -> r",
        "r.f", {"u": Fraction(1, 4)},
    ),
    "a GY reflects by r squared": (
        "Se u, GY g 4, R r 2", "u -> g -> r",
        "u.f", {"u": Fraction(1, 8)},
    ),
    "a negative modulus": (
        "Se u, TF n -3, R r 2", "u -> n -> r",
        "r.e", {"u": Fraction(-1, 3)},
    ),
    "an element that drives its bond": (
        "Se u, R r 2", "r -> u",
        "r.f", {"u": Fraction(-1, 2)},
    ),
    "an element that faces a source": (
        "Sf u, I m 3", "u -> m",
        "m.e", {"u": 6},
    ),
    "a source's own variable": (
        "Sf u, I m 3", "u -> m",
        "u.f", {"u": 1},
    ),
    "a source's reaction": (
        "Sf u, I m 3", "u -> m",
        "u.e", {"u": 6},
    ),
    "a momentum": (
        "Sf u, I m 3", "u -> m",
        "m.p", {"u": 3},
    ),
    "a displacement": (
        "Sf u, I m 3", "u -> m",
        "m.q", {"u": Fraction(1, 2)},
    ),
    "two GYs in a chain are a TF": (
        "Se u, GY g 4, GY h 2, R r 5", "u -> g -> h -> r",
        "r.e", {"u": Fraction(1, 2)},
    ),
    "three two-ports in a chain": (
        "Se u, TF n 2, GY g 4, TF m 5, R r 1", "u -> n -> g -> m -> r",
        "r.f", {"u": Fraction(5, 8)},
    ),
    "a GY back onto its own junction": (
        "Se u, 1 j, GY g 4, R r 2", "u -> j -> r, j -> g -> j",
        "r.f", {"u": Fraction(1, 2)},
    ),
    "a TF back onto its own junction holds it": (
        "Se u, 1 j, TF n 2, R r 2", "u -> j -> r, j -> n -> j",
        "r.f", {"u": 0},
    ),
    "no resistance on a 0-junction": (
        "Se u, 1 a, R q 2, 0 j, R r 0", "u -> a -> q, a -> j -> r",
        "r.f", {"u": Fraction(1, 2)},
    ),
    "no inertia on a 0-junction": (
        "Se u, 1 a, R q 2, 0 j, I m 0", "u -> a -> q, a -> j -> m",
        "m.e", {"u": 0},
    ),
    "no compliance on a 1-junction": (
        "Sf u, 0 a, R q 2, 1 j, C c 0", "u -> a -> q, a -> j -> c",
        "c.e", {"u": 2},
    ),
    "a resistance of 1 beside one of -1": (
        "Se u, 1 a, R r 1, R q -1, 0 b, R z 3, 1 d, I m 5", "u -> a -> r, a -> q, a -> b -> z, b -> d -> m",
        "m.e", {"u": 1},
    ),
    "two sources superpose": (
        "Se u, Sf w, 1 a, R r 2, 0 b, R q 3", "u -> a -> r, a -> b -> q, w -> b",
        "q.e", {"u": Fraction(3, 5), "w": Fraction(6, 5)},
    ),
    "a source that the output cannot see": (
        "Se u, Se w, 0 j, R r 2, 1 k, R q 3", "u -> j -> r, j -> k -> q, w -> k",
        "r.f", {"u": Fraction(1, 2), "w": 0},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BY_HAND)
def test_by_hand(name):
    nodes, bonds, output, expected = BY_HAND[name]
    found = {
        source: at(channel, Fraction(2))
        for (_, source), channel in transfers(written(nodes, bonds, output)).items()
    }
    assert found == expected


SINGULAR = {
    "two effort sources on a 0-junction": ("Se u, Se w, 0 j, R r 1", "u -> j -> r, w -> j", "r.e"),
    "two flow sources on a 1-junction": ("Sf u, Sf w, 1 j, R r 1", "u -> j -> r, w -> j", "r.e"),
    "two effort sources face to face": ("Se u, Se w", "u -> w", "u.f"),
    "effort sources on either side of a TF": ("Se u, TF n 2, Se w", "u -> n -> w", "u.f"),
    "a flow source into nothing": ("Sf u, 0 j", "u -> j", "j.e"),
    "a ring of flows that are not determined": (
        "Se u, 0 a, 1 b, 1 c, 0 d, R r 1",
        "u -> a -> b -> d, a -> c -> d, d -> r",
        "b.f",
    ),
    "impedances that cancel": ("Se u, 1 j, R r 1, R q -1", "u -> j -> r, j -> q", "r.f"),
    "an effort source on no resistance": ("Se u, R r 0", "u -> r", "r.f"),
}


@pytest.mark.parametrize("name", SINGULAR)
def test_what_has_no_unique_solution_is_refused_and_names_nodes(name):
    nodes, bonds, output = SINGULAR[name]
    types, values, pairs = parse(nodes, bonds)
    place, _, quantity = output.rpartition(".")
    assert transfer_at(types, values, pairs, ["u"], (place, quantity), S) is None
    with pytest.raises(Singular) as refused:
        written(nodes, bonds, output)
    assert refused.value.names
    assert set(refused.value.names) <= set(types)
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("nodes", "ring", "what", "answer"),
    [
        ("Se u, 1 j, TF n 1", "j -> n -> j", "the effort of 'j' and 'n'", Fraction(1, 2)),
        ("Sf u, 0 j, TF n 1", "j -> n -> j", "the flow of 'j' and 'n'", Fraction(1)),
        (
            "Se u, 0 j, GY n -1, GY m -1",
            "j -> n -> m -> j",
            "the common variable of 'n', 'm' and 'j'",
            Fraction(1, 2),
        ),
    ],
)
def test_what_is_not_determined_and_no_output_depends_on_is_an_effort_a_flow_or_either(
    nodes, ring, what, answer
):
    """A TF of 1 back onto its own junction; made of two gyrators it turns one into the other."""
    graph = written(f"{nodes}, R r 2", f"u -> j -> r, {ring}", "r.f")
    (said,) = graph.undetermined
    assert said.startswith(f"{what} is not determined")
    assert at(transfers(graph)["r.f", "u"], S) == answer


@pytest.mark.parametrize(("kind", "unknown", "shared"), [("0", "flow", "effort"), ("1", "effort", "flow")])
def test_a_ring_of_like_junctions_leaves_what_they_do_not_share_open(kind, unknown, shared):
    nodes = f"S{'fe'[int(kind)]} u, {kind} a, {kind} b, {kind} c, R r 1"
    graph = written(nodes, "u -> a -> b -> c -> a, b -> r", "r.e")
    (said,) = graph.undetermined
    assert re.match(f"the {unknown} through the bond 'c -> a' .* which share their {shared}", said)
    assert at(transfers(graph)["r.e", "u"], S) == 1


@pytest.mark.parametrize(
    ("nodes", "bonds", "words"),
    [
        ("Se u, TF n 2, Se w", "u -> n -> w", "^sources 'u' and 'w' contradict each other"),
        ("Sf u, 0 j", "u -> j", "^source 'u' meets a balance without a solution.* on the 0-junction 'j'"),
        (
            "Se u, Se w, 0 j, R r 1",
            "u -> j -> r, w -> j",
            "^effort sources .* both fix the effort .*parallel",
        ),
        ("Sf u, Sf w, 1 j, R r 1", "u -> j -> r, w -> j", "^flow sources .* both fix the flow .*in series"),
    ],
)
def test_what_sources_contradict_is_said(nodes, bonds, words):
    with pytest.raises(Singular, match=words):
        written(nodes, bonds, "j.e" if "j" in nodes else "u.f")


@pytest.mark.parametrize("stages", [20, 2000])
def test_those_concerned_are_named_in_graphs_of_any_size(stages):
    nodes, bonds = chain(stages)
    middle = f"v{stages // 2}"
    with pytest.raises(Singular) as refused:
        written(
            f"{nodes}, 0 x, Sf w, 0 y, Sf z", f"{bonds}, {middle} -> x, w -> x, {middle} -> y, z -> y", "v1.f"
        )
    assert set(refused.value.names) == {"w", "x", "z", "y"}


@pytest.mark.parametrize(("count", "end"), [(8, "'n6' and 'n7' is not"), (9, "'n7' and 1 more is not")])
def test_a_message_names_eight_nodes_at_most(count, end):
    loose = [f"n{k}" for k in range(count)]  # zeros joined by plain bonds, with nothing on them
    nodes = "Se e, 1 j, R r 2, " + ", ".join(f"0 {name}" for name in loose)
    bonds = "e -> j -> r, " + " -> ".join(loose)
    work = written(nodes, bonds, "r.f")
    (said,) = work.undetermined
    assert end in said


@pytest.mark.parametrize("inputs", [["u"], ["u", "w"]])
def test_sources_that_contradict_each_other_behind_an_ideal_source_are_refused(inputs):
    """Each source is prescribed, one that is held at zero as well; no output needs this part."""
    nodes, bonds = "Se u, 0 j, 1 k, R r 2, GY g 1, 0 x, Sf w", "u -> j -> k -> r, j -> g -> x, w -> x"
    with pytest.raises(Singular, match="sources 'u' and 'w' contradict each other through 'x'"):
        written(nodes, bonds, "r.f", inputs=inputs)


def test_what_floats_behind_an_ideal_source_is_a_warning():
    graph = written("Se u, 0 j, 1 k, R r 2, 1 x", "u -> j -> k -> r, j -> x, x -> j", "r.f")
    assert at(transfers(graph)["r.f", "u"], S) == Fraction(1, 2)
    (reduction,) = graph.reductions.values()
    assert "x" in reduction.dropped
    assert graph.undetermined == [
        "the flow of 'x' is not determined: this part floats, or a loop through it has no unique solution; "
        "no requested output depends on it"
    ]


def test_a_part_that_is_not_connected_is_dropped():
    graph = written("Se u, R r 2, Se w, I m 3", "u -> r, w -> m", "r.f")
    (reduction,) = graph.reductions.values()
    assert set(reduction.dropped) == {"w", "m"}
    assert transfers(graph)["r.f", "w"].vanishes


def test_sources_that_are_not_inputs_are_zero():
    nodes, bonds = "Se u, Sf w, 1 a, R r 2, 0 b, R q 3", "u -> a -> r, a -> b -> q, w -> b"
    (channel,) = transfers(written(nodes, bonds, "q.e", inputs=["w"])).items()
    assert channel[0] == ("q.e", "w")
    assert at(channel[1], S) == Fraction(6, 5)


def test_the_order_of_nodes_and_bonds_does_not_matter():
    rng = random.Random(3)
    types, values, bonds, inputs, output = random_graph(rng, 7, 2)
    expected = transfer_at(types, values, bonds, inputs, output, S)
    assert expected is not None
    for _ in range(5):
        names = list(types)
        rng.shuffle(names)
        rng.shuffle(bonds)
        shuffled = {name: types[name] for name in names}
        assert reduction_at(shuffled, values, bonds, inputs, output, S) == expected


@pytest.mark.parametrize(
    ("nodes", "bonds", "words"),
    [
        ("Se u, 1 j, R r 1", "u -> j", "R 'r' has no bond"),
        ("Se u, 1 j, R r 1, 0 k", "u -> j -> r -> k", "R 'r' has 2 bonds but only one port"),
        ("Se u, TF n 2, R r 1", "u -> n, r -> n", "one bond in and one bond out; it has 2 in and 0 out"),
        ("Se u, 1 j, R r 1", "u -> j -> r, j -> j", "ends where it starts"),
        ("Se u, TF n 0, R r 1", "u -> n -> r", "the modulus of TF 'n' is zero"),
        ("Se u, R r", "u -> r", "R 'r' has no value"),
    ],
)
def test_a_graph_that_is_not_well_formed_is_refused_with_the_reason(nodes, bonds, words):
    types, values, pairs = parse(nodes, bonds)
    with pytest.raises(UsageError) as refused:
        BondGraph([Node(n, k, values.get(n)) for n, k in types.items()], [Bond(*pair) for pair in pairs])
    assert words in str(refused.value)


def test_all_faults_of_a_graph_are_listed_at_once():
    types, _, pairs = parse("Se u, 1 j, R r 1, TF n 1, 0 k", "u -> j, j -> j")
    faults = graph_faults(types, [Bond(*pair) for pair in pairs])
    assert [fault.node for fault in faults if fault.node] == ["r", "n", "k"]
    assert [fault.bond for fault in faults if fault.bond is not None] == [1]


def test_a_balanced_plan_has_short_ways_through_a_ladder():
    """Each doubling of a ladder adds one round of eliminations, which lengthens the way by a few steps."""

    def way(plan):
        lengths = []
        for op, a, b in plan.program.ops:
            lengths.append(1 + max((lengths[register] for register in operands(op, a, b)), default=0))
        (answer,) = plan.channels().values()
        return lengths[answer]

    short, long = (ladder(stages) for stages in (50, 200))
    assert way(long.balanced()) - way(short.balanced()) <= 20
    assert way(long) - way(short) > 1000


def test_a_ladder_of_a_thousand_nodes_needs_no_recursion():
    """Resistors of 1 in series and parallel: the driving point is a quotient of Fibonacci numbers."""
    stages = 250
    types, values, bonds = {"u": "Se"}, {}, []
    ends = [name for k in range(stages) for name in (f"a{k}", f"b{k}")]
    for name in ends:
        types |= {name: "1" if name[0] == "a" else "0", f"r{name}": "R"}
        values[f"r{name}"] = Fraction(1)
        bonds.append((name, f"r{name}"))
    bonds += [("u", "a0"), *pairwise(ends)]
    channel = transfers(reduced(types, values, bonds, ["u"], "u.f"))["u.f", "u"]
    a, b = 1, 1
    for _ in range(2 * stages - 1):
        a, b = b, a + b
    assert at(channel, S) == Fraction(a, b)


def test_a_junction_that_was_not_drawn_is_called_after_the_nodes_that_it_lies_between():
    graph = written("Se u, TF n 2, GY g 3, R r 1", "u -> n -> g -> r", "r.f")
    assert {"u_n", "n_g", "g_r"} <= set(graph.structure.junctions)


def test_fresh_names_are_numbered_past_those_that_are_taken():
    names = NameRegistry(["a", "a_3"])
    assert [names.fresh("a") for _ in range(3)] == ["a_2", "a_4", "a_5"]
    assert [unique("a", ["a", "a_3"]), unique("a", ["a", "a_2"]), unique("b", ["a"])] == ["a_2", "a_3", "b"]
    assert [names.fresh("b"), names.fresh("a_2"), names.fresh("b")] == ["b", "a_2_2", "b_2"]


@pytest.mark.parametrize(("closing", "shared"), [("", ()), (", c -> j", ("a", "b", "c"))])
def test_both_systems_share_the_junctions_of_a_loop_through_the_port(closing, shared):
    nodes = "Se u, 1 j, 0 a, R p 2, 1 b, R q 3, 0 c, C k 5"
    graph = written(nodes, f"u -> j, j -> a -> p, a -> b -> q, b -> c -> k{closing}", "u.f")
    (reduction,) = graph.reductions.values()
    assert reduction.prototype.shared() == shared


def test_a_mass_and_a_negative_spring_do_not_cancel_whatever_their_values():
    nodes = "Se u, 1 j, I m 2, C k -1/2, Se w, 1 h, R r 1"
    assert written(nodes, "u -> j -> m, j -> k, w -> h -> r", "r.f").undetermined == []
