"""The steps of a reduction are those of the paper, and their equations are true."""

import random
import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Rational, sympify

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from tests.bondgraph.graphs import ISOLATOR, parse, reduced, solvable, written
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfer_at

S = Fraction(13, 7)


def trace(graph):
    """Return the steps of a reduced graph as (rule, nodes, equation, meaning), as a scene stores them."""
    asked = frozenset({"reduction"})
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, asked))
    table = result.value("bond_graph/reduction/steps")
    return [tuple(row[name] for name in ("rule", "nodes", "equation", "meaning")) for row in table]


def evaluate(steps, values):
    """Evaluate the definitions of all steps in order by SymPy, and return every name's last value."""
    known = {name: Rational(value.numerator, value.denominator) for name, value in values.items()}
    for _, _, equation, _ in steps:
        for definition in equation.split("; "):
            name, _, text = definition.partition(" = ")
            known[name] = sympify(*_as_identifiers(text, known))
    return known


def _as_identifiers(text, known):
    """Give every known name an identifier: names such as `k(a, b)` and `u|r` are not."""
    names = sorted(known, key=len, reverse=True)
    if names:
        places = {name: f"known_{index}" for index, name in enumerate(names)}
        pattern = r"(?<![\w|])(" + "|".join(re.escape(name) for name in names) + r")(?![\w|])"
        text = re.sub(pattern, lambda match: places[match[0]], text)
        return text, {places[name]: known[name] for name in names}
    return text, {}


def last_variable(steps, values, inputs, source):
    """Return the variable that the last step's last equation gives for one source alone."""
    sources = {name: Fraction(int(name == source)) for name in inputs}
    known = evaluate(steps, {**values, **sources, "s": S})
    last = steps[-1][2].split("; ")[-1].partition(" = ")[0]
    return last, known[last]


def test_the_isolator_is_reduced_as_in_figures_6_to_8():
    steps = trace(written(*ISOLATOR, "m_s.f"))
    assert [(rule, nodes) for rule, nodes, _, _ in steps] == [
        ("series", "fluid, I_f, C_a"),
        ("reflection", "fluid, tuning"),
        ("source swap", "v_in, base"),
        ("merge", "base, body"),
        ("series", "body, tuning, b"),
        ("prototype", "body"),
    ]
    series, reflection, swap, merge, total, last = (equation for _, _, equation, _ in steps)
    assert series == "Z_fluid = s*I_f + 1/(s*C_a)"
    assert reflection == "Z_tuning = tuning**2*Z_fluid"
    assert swap == "e_eq_base = Z_tuning*v_in"
    assert merge == "f_base = f_body"
    assert total == "Z_A = Z_tuning + b"
    assert last.startswith("Z_A = Z_tuning + b; Y_B = 1/(s*m_s)")


def test_the_meanings_of_the_isolators_steps_name_the_papers_equations():
    steps = trace(written(*ISOLATOR, "m_s.f"))
    said = [meaning for _, _, _, meaning in steps]
    for meaning, words in zip(
        said,
        [
            ("I_f and C_a", "series", "eq 1"),
            ("transformer tuning", "Z1 = n^2 Z2"),
            (
                "the flow source v_in",
                "eq 15",
                "equivalent effort source",
                "eq 16",
                "the 0-junction becomes a 1",
            ),
            ("base and body", "merge"),
            ("tuning and b", "series", "eq 1"),
            ("prototype d", "effort source on 1-junction body", "feedback", "eq 4"),
        ],
        strict=True,
    ):
        assert all(word in meaning for word in words), meaning


def test_the_isolators_equations_give_its_transfer_function():
    types, values, bonds = parse(*ISOLATOR)
    steps = trace(written(*ISOLATOR, "m_s.f"))
    name, found = last_variable(steps, values, ["v_in"], "v_in")
    assert name == "f_m_s"
    assert found == transfer_at(types, values, bonds, ["v_in"], ("m_s", "f"), S)["v_in"]


ONE_PORTS = "R r 2, I m 3, C c 5"
PROTOTYPES = {  # in the order of the paper's equations
    # letter: source, junction, the output, what it is driven by, and what the paper calls the relation
    "a": (f"Sf u, 1 j, {ONE_PORTS}", "u.e", "Z = Z_A + Z_B"),
    "b": (f"Se u, 0 j, {ONE_PORTS}", "u.f", "Y = Y_A + Y_B"),
    "c": (f"Sf u, 0 j, {ONE_PORTS}", "u.e", "Z = Z_B/(1 + Z_B*Y_A)"),
    "d": (f"Se u, 1 j, {ONE_PORTS}", "u.f", "Y = Y_B/(1 + Y_B*Z_A)"),
}


@pytest.mark.parametrize("letter", PROTOTYPES)
def test_each_prototype_is_reached_and_its_equation_is_the_driving_point_relation(letter):
    nodes, output, relation = PROTOTYPES[letter]
    bonds = "u -> j, j -> r, j -> m, j -> c"
    graph = written(nodes, bonds, output)
    asked = Analysis(graph.inputs, graph.outputs, frozenset({"reduction", "prototype"}))
    result = analyse(graph.graph, asked)
    assert result.value("bond_graph/reduction/prototype") == letter
    (equation,) = result.value("bond_graph/reduction/prototype_equation")
    assert equation == relation
    assert trace(graph)[-1][3].endswith(f", eq {1 + list(PROTOTYPES).index(letter)}")
    types, values, pairs = parse(nodes, bonds)
    known = {name: Rational(v.numerator, v.denominator) for name, v in {**values, "s": S}.items()}
    for part in ("system_a", "system_b"):
        (text,) = result.value(f"bond_graph/reduction/{part}")
        name, _, formula = text.partition(" = ")
        known[name] = sympify(formula, known)
    driving_point = sympify(equation.partition(" = ")[2], known)
    assert driving_point == transfer_at(types, values, pairs, ["u"], (output[0], output[-1]), S)["u"]


@pytest.mark.parametrize(("letter", "setting"), [("a", None), ("b", None), ("c", "c"), ("d", "m")])
def test_b_is_what_sets_the_common_variable_or_else_the_ports_element(letter, setting):
    nodes, _, _ = PROTOTYPES[letter]
    impedances = {"r": "r", "m": "s*m", "c": "1/(s*c)"}
    for element in impedances:
        graph = written(nodes, "u -> j, j -> r, j -> m, j -> c", f"{element}.e")
        result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset({"prototype"})))
        (text,) = result.value("bond_graph/reduction/system_b")
        name, _, formula = text.partition(" = ")
        known = dict(
            zip(("s", "r", "m", "c"), (Rational(13, 7), Rational(2), Rational(3), Rational(5)), strict=True)
        )
        as_impedance = sympify(formula, known) if name == "Z_B" else 1 / sympify(formula, known)
        assert as_impedance == sympify(impedances[setting or element], known)


@pytest.mark.parametrize(("letter", "driven"), [("c", "f_eq = u; e_j = "), ("d", "e_eq = u; f_j = ")])
def test_a_free_common_variable_is_driven_by_the_equivalent_source_of_its_balance(letter, driven):
    nodes, output, _ = PROTOTYPES[letter]
    steps = trace(written(nodes, "u -> j, j -> r, j -> m, j -> c", output))
    assert driven in steps[-1][2]


def cases(first, count, junctions, loops):
    """Yield random graphs, with any output, and their transfer functions by the tableau."""
    seed, found = first, 0
    while found < count:
        rng = random.Random(seed)
        made = types, values, bonds, inputs, (output, quantity) = random_graph(rng, junctions, loops)
        seed += 1
        graph = solvable(made)
        if graph is None:
            continue
        steps = trace(graph)
        expected = transfer_at(types, values, bonds, inputs, (output, quantity), S)
        if expected is None:
            continue
        found += 1
        yield values, inputs, steps, expected, f"{quantity}_{output}"


@pytest.mark.parametrize(
    ("junctions", "loops", "count"), [(2, 0, 10), (4, 0, 5), (7, 0, 5), (4, 1, 5), (6, 3, 5)]
)
def test_the_equations_in_order_reproduce_the_transfer_function(junctions, loops, count):
    for values, inputs, steps, expected, output in cases(1000 * junctions, count, junctions, loops):
        for source in inputs:
            name, found = last_variable(steps, values, inputs, source)
            assert name == output
            assert found == expected[source], steps


@settings(max_examples=100)
@given(seed=st.integers(), kinds=st.lists(st.sampled_from("01"), min_size=2, max_size=7))
def test_a_tree_with_an_element_on_every_junction_takes_the_papers_rules_only(seed, kinds):
    rng = random.Random(seed)
    types = {f"j{k}": kind for k, kind in enumerate(kinds)} | {"u": "Se", "w": "Sf"}
    types |= {f"x{k}": rng.choice("RIC") for k in range(len(kinds))}
    values = {f"x{k}": Fraction(k + 1) for k in range(len(kinds))}
    bonds = [(f"j{rng.randrange(k)}", f"j{k}") for k in range(1, len(kinds))]
    bonds += [(f"j{k}", f"x{k}") for k in range(len(kinds))]
    for source, kind in (("u", "1"), ("w", "0")):  # where they feed, and fix nothing
        bonds += [
            (source, rng.choice([f"j{k}" for k, other in enumerate(kinds) if other == kind] or ["none"]))
        ]
    if any("none" in bond for bond in bonds):
        return
    steps = trace(reduced(types, values, bonds, ["u", "w"], "x0.e"))
    assert {rule for rule, *_ in steps} <= {"series", "parallel", "source swap", "merge", "prototype"}
    assert [rule for rule, *_ in steps].index("prototype") == len(steps) - 1


def test_a_loop_is_eliminated_by_its_multiport_equivalent():
    steps = trace(
        written(
            "Se u, 1 a, R r1 2, 0 b, R r2 3, 1 c, I m 5, 0 d, C k 7, 1 e, R r3 1",
            "u -> a -> r1, a -> b -> r2, b -> c -> m, c -> d -> k, d -> e -> r3, e -> b",
            "k.e",
        )
    )
    meanings = [meaning for rule, _, _, meaning in steps if rule == "junction elimination"]
    assert meanings
    assert all("equivalent (Schur complement" in meaning for meaning in meanings)


def test_steps_are_the_same_on_every_run():
    case = random_graph(random.Random(5), 6, 2)
    types, values, bonds, inputs, (node, quantity) = case
    first, second = (trace(reduced(types, values, bonds, inputs, f"{node}.{quantity}")) for _ in range(2))
    assert first == second


def test_what_a_constraint_states_is_true():
    """Two levers in a row behind an effort source: nothing on them takes up a force, so it is handed on."""
    nodes = "Se u, Se w, 1 a, 0 b, 1 c, TF n 2, TF m 3, I i 1"
    bonds = "w -> a -> n -> b -> m -> c -> i, u -> c"
    types, values, pairs = parse(nodes, bonds)
    steps = trace(written(nodes, bonds, "c.f"))
    assert [rule for rule, *_ in steps] == ["constraint", "prototype"]
    left, _, right = steps[0][2].split("; ")[0].partition(" = ")
    for source in ("u", "w"):
        common = {
            f"{quantity}_{junction}": transfer_at(types, values, pairs, ["u", "w"], (junction, quantity), S)[
                source
            ]
            for junction, quantity in (("a", "f"), ("b", "e"), ("c", "f"))
        }
        known = {**values, **common, "u": Fraction(source == "u"), "w": Fraction(source == "w"), "s": S}
        known = {name: Rational(v.numerator, v.denominator) for name, v in known.items()}
        assert sympify(right, known) == known[left]


def test_a_node_called_s_is_not_taken_for_the_laplace_variable():
    graph = written("Se F, 1 one, I s 2, R b 3", "F -> one -> s, one -> b", "s.f")
    steps = trace(graph)
    assert "Y_B = 1/(s*s_value)" in steps[-1][2]
    known = evaluate(steps, {"s": S, "s_value": Fraction(2), "b": Fraction(3), "F": Fraction(1)})
    assert known["f_s"] == Rational(1) / (2 * Rational(S.numerator, S.denominator) + 3)


def test_equivalents_are_not_called_what_the_prototype_is_written_with():
    """Junctions called A and B have equivalents of their own beside Z_A and Y_B of the prototype."""
    nodes = "Se u, 1 port, I m 2, C k 3, 1 A, R r1 5, I m1 7, 0 z, R r2 11, 1 B, R r3 13, C k3 17"
    bonds = "u -> port -> m, port -> k, port -> z -> r2, z -> A -> r1, A -> m1, z -> B -> r3, B -> k3"
    types, values, pairs = parse(nodes, bonds)
    steps = trace(written(nodes, bonds, "port.f"))
    names = [text.partition(" = ")[0] for step in steps for text in step[2].split("; ")]
    assert {"Z_A", "Z_A_2", "Z_B_2"} <= set(names)
    name, found = last_variable(steps, values, ["u"], "u")
    assert (name, found) == ("f_port", transfer_at(types, values, pairs, ["u"], ("port", "f"), S)["u"])


def test_equivalent_sources_that_take_each_other_back_leave_nothing():
    """By both gyrators u acts on c with opposite signs, so that the constraint fixes an effort at zero."""
    nodes = "Se u, 1 a, 0 b, 0 c, GY g 23/9, GY h 23/15, C k 3/4"
    bonds = "u -> a -> k, b -> g -> a -> c, b -> h -> c"
    types, values, pairs = parse(nodes, bonds)
    assert transfer_at(types, values, pairs, ["u"], ("b", "e"), S)["u"] == 0
    (constraint,) = (step for step in trace(written(nodes, bonds, "b.e")) if step[0] == "constraint")
    assert constraint[2].split("; ")[0] == "e_b = 0"


def test_a_source_that_is_swapped_across_a_transformer_is_seen_through_it():
    steps = trace(written("Sf u, 0 a, R r 2, TF n 3, 0 b, I m 5", "u -> a -> r, a -> n -> b -> m", "b.e"))
    said = [meaning for rule, _, _, meaning in steps if rule == "source swap"]
    assert any(meaning.endswith(", seen through n") for meaning in said)


def test_a_constraint_says_which_variables_it_ties():
    steps = trace(written("Se u, 0 j, TF n 2, GY g 2", "j -> n -> g -> j, u -> j", "u.q"))
    (said,) = (meaning for rule, _, _, meaning in steps if rule == "constraint")
    assert said == "no element stands on n_g, so its balance alone ties the effort of n_g_2 to j"
