"""Every formula of a trace is true, its name is unique, and it is in lowest terms.

The formulas are read as text: evaluated in their order at rational values, against the tableau of the graph;
and as quotients of polynomials in the names that stand in them, against what would cancel.
"""

import ast
import random
import re
from fractions import Fraction
from itertools import combinations

import pytest
from flint import fmpz_mpoly_ctx

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.decomposition.graph_bisection import BondOnLoop
from dynid.bondgraph.graph import Bond
from dynid.errors import Singular
from dynid.report.drawing.bond_graph import DrawnGraph, reduction_strip
from tests.bondgraph.graphs import build, parse, port
from tests.bondgraph.random_graphs import driven_ring, random_graph
from tests.bondgraph.tableau import transfer_at
from tests.sample import sample

pytestmark = pytest.mark.thorough


class Value(ast.NodeVisitor):
    """The exact value of a formula in known names."""

    def __init__(self, known):
        self.known = known

    def visit_Expression(self, node):
        return self.visit(node.body)

    def visit_Constant(self, node):
        return Fraction(node.value)

    def visit_Name(self, node):
        return self.known[node.id]

    def visit_UnaryOp(self, node):
        return -self.visit(node.operand)

    def visit_BinOp(self, node):
        a, b = self.visit(node.left), self.visit(node.right)
        match node.op:
            case ast.Add():
                return a + b
            case ast.Sub():
                return a - b
            case ast.Mult():
                return a * b
            case ast.Div():
                return a / b
            case ast.Pow():
                return a ** int(b)


class Lowest(Value):
    """A formula as numerator and denominator, which must have nothing in common wherever they meet."""

    def __init__(self, names):
        ring = fmpz_mpoly_ctx.get(sorted(names) or ["none"], "lex")
        self.one = ring.constant(1)
        super().__init__({name: (ring.gen(k), self.one) for k, name in enumerate(sorted(names))})

    def visit_Constant(self, node):
        return self.one * node.value, self.one

    def visit_UnaryOp(self, node):
        above, below = self.visit(node.operand)
        return -above, below

    def visit_BinOp(self, node):
        if isinstance(node.op, ast.Pow):
            above, below = self.visit(node.left)
            return above**node.right.value, below**node.right.value
        if isinstance(node.op, ast.Add | ast.Sub):
            (a, b), (c, d) = self.visit(node.left), self.visit(node.right)
            c = -c if isinstance(node.op, ast.Sub) else c
            left, right = d // b.gcd(d), b // b.gcd(d)
            one, other, below = a * left, c * right, b * left
            total = one + other
            assert len(total) == len(one) + len(other), f"terms of {ast.unparse(node)} fall together"
            assert total.gcd(below) == 1, f"{ast.unparse(node)} is not in lowest terms"
            return total, below
        (a, b), (c, d) = self.visit(node.left), self.visit(node.right)
        if isinstance(node.op, ast.Div):
            c, d = d, c
        assert a.gcd(d) == c.gcd(b) == 1, f"something cancels in {ast.unparse(node)}"
        return a * c, b * d


def addends(node):
    """Return the terms of a sum."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        sign = [ast.UnaryOp(ast.USub(), term) for term in addends(node.right)]
        return addends(node.left) + (sign if isinstance(node.op, ast.Sub) else addends(node.right))
    return [node]


def definitions(steps):
    for step in steps:
        for definition in step["equation"].split("; "):
            name, _, text = definition.partition(" = ")
            yield name, ast.parse(text, mode="eval")


def assert_in_lowest_terms(tree, known):
    Lowest(names_in(tree)).visit(tree)
    terms = [Value(known).visit(term) for term in addends(tree.body)]
    for a, b in combinations(terms, 2):
        assert a + b != 0, f"terms of {ast.unparse(tree)} take each other back"


def names_in(tree):
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def evaluated(steps, known, taken, commons=None):
    """Check the formulas of a trace, and return the values of all names.

    A constraint or a merge says what a junction's variable is in terms of others, which come out later; those
    that the trace does not need are taken from `commons`.
    """
    known, waiting, commons = dict(known), list(definitions(steps)), dict(commons or {})
    for name, tree in waiting:
        assert name not in taken, f"{name} is a node, a parameter or s"
        assert name not in names_in(tree), f"{name} in terms of itself"
    while waiting:
        ready = [(name, tree) for name, tree in waiting if names_in(tree) <= known.keys()]
        for name, tree in ready:
            found = Value(known).visit(tree)
            assert known.setdefault(name, found) == found, f"{name} stands for two things"
            assert_in_lowest_terms(tree, known)
        left = [each for each in waiting if each not in ready]
        if len(left) == len(waiting):
            missing = {name for _, tree in waiting for name in names_in(tree)} - known.keys()
            if not missing & commons.keys():
                assert all(name[0] in "ef" for name in missing), missing  # of junctions that nobody drew
                break
            known |= {name: commons[name] for name in missing & commons.keys()}
        waiting = left
    return known


def values_of(rng, values):
    """Return other values, so large that what cancels by chance does so nowhere."""
    return {
        name: Fraction(rng.randint(1, 10**6), rng.randint(1, 10**6)) * (-1 if value < 0 else 1)
        for name, value in values.items()
    }


def check(made, rng):
    """Check the trace of one output; return the number of formulas, None where there is no solution."""
    types, values, bonds, inputs, output = made
    values, s = values_of(rng, values), Fraction(rng.randint(1, 10**6), rng.randint(1, 10**6))
    graph = build(types, values, bonds)
    asked = frozenset({"reduction", "prototype"})
    try:
        result = analyse(graph, Analysis(tuple(inputs), (port(".".join(output)),), asked))
    except Singular:
        return None
    steps = result.value("bond_graph/reduction/steps")
    drives = {name: Fraction(rng.randint(1, 10**6)) for name in inputs}

    def solved(wanted):
        answers = transfer_at(types, values, bonds, inputs, wanted, s)
        return answers and sum(answers[name] * drive for name, drive in drives.items())

    junctions = {name: {"0": "e", "1": "f"}[kind] for name, kind in types.items() if kind in "01"}
    commons = {f"{quantity}_{name}": solved((name, quantity)) for name, quantity in junctions.items()}
    commons = {name: value for name, value in commons.items() if value is not None}
    known = evaluated(steps, {**values, **drives, "s": s}, {*types, "s"}, commons)
    if (expected := solved(output)) is None:  # undetermined beyond the output's reach
        return None
    assert known[f"{output[1]}_{output[0]}"] == expected
    assert commons.items() >= {(name, known[name]) for name in commons if name in known}
    for part in ("system_a", "system_b"):
        (text,) = result.value(f"bond_graph/reduction/{part}")
        name, _, formula = text.partition(" = ")
        tree = ast.parse(formula, mode="eval")
        assert Value(known).visit(tree) == known[name]
        assert_in_lowest_terms(tree, known)
    return len(list(definitions(steps)))


def graphs(first, count):
    for seed in range(first, first + count):
        rng = random.Random(seed)
        if seed % 2:
            yield driven_ring(rng, rng.randint(3, 6), rng.choice([0, 1, 1, 2])), rng
        else:
            yield random_graph(rng, rng.randint(2, 7), rng.choice([0, 1, 2, 3])), rng


@pytest.mark.thorough
@pytest.mark.parametrize("first", sample(range(500_000, 500_160, 40), 1))
def test_every_formula_of_a_trace_is_true_unique_and_in_lowest_terms(first):
    counts = [check(*made) for made in graphs(first, 40)]
    assert sum(count is not None for count in counts) > 20
    assert sum(count or 0 for count in counts) > 300


@pytest.mark.slow
@pytest.mark.parametrize("first", range(600_000, 602_000, 200))
def test_every_formula_of_2000_traces_is_true_unique_and_in_lowest_terms(first):
    counts = [check(*made) for made in graphs(first, 200)]
    assert sum(count is not None for count in counts) > 100


@pytest.mark.parametrize("seed", sample(range(700_000, 700_030), 4))
def test_the_formulas_of_both_sides_of_a_port_have_names_of_their_own(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, output = random_graph(rng, rng.randint(2, 6), rng.choice([0, 1, 2]))
    values, s = values_of(rng, values), Fraction(rng.randint(1, 10**6), rng.randint(1, 10**6))
    for tail, head in bonds:
        analysis = Analysis(
            tuple(inputs), (port(".".join(output)),), frozenset({"prototype"}), port=Bond(tail, head)
        )
        try:
            result = analyse(build(types, values, bonds), analysis)
        except (Singular, BondOnLoop):
            continue
        steps = result.value("bond_graph/port/steps")
        probes = {name for step in steps for name in re.findall(r"port_\w+", step["equation"])}
        drives = {name: Fraction(rng.randint(1, 99)) for name in [*inputs, *sorted(probes)]}
        known = evaluated(steps, {**values, **drives, "s": s}, {*types, "s"})
        for part in ("system_a", "system_b"):
            name, _, formula = result.value(f"bond_graph/port/{part}").partition(" = ")
            tree = ast.parse(formula, mode="eval")
            assert name not in names_in(tree)
            found = Value(known).visit(tree)
            assert known.get(name, found) == found
            assert_in_lowest_terms(tree, known)


def test_names_that_the_user_gave_are_not_given_again():
    """Elements called as the steps would call what they define, in a graph with a loop."""
    nodes = "Se f_eq, 1 eq, R Z_A 2, 0 b, R k_b_b 3, 1 c, I f_c 5, 0 d, C e_eq 7, 1 e, R Y_B 1"
    bonds = "f_eq -> eq -> Z_A, eq -> b -> k_b_b, b -> c -> f_c, c -> d -> e_eq, d -> e -> Y_B, e -> b"
    types, values, pairs = parse(nodes, bonds)
    analysis = Analysis(("f_eq",), (port("Z_A.f"),), frozenset({"reduction"}))
    steps = analyse(build(types, values, pairs), analysis).value("bond_graph/reduction/steps")
    s = Fraction(13, 7)
    known = evaluated(steps, {**values, "f_eq": Fraction(1), "s": s}, {*types, "s"})
    last = list(definitions(steps))[-1][0]
    assert known[last] == transfer_at(types, values, pairs, ["f_eq"], ("Z_A", "f"), s)["f_eq"]


@pytest.mark.parametrize("first", range(800_000, 800_060, 20))
def test_no_two_boxes_of_a_strip_have_one_label(first):
    drawn = 0
    for made, _ in graphs(first, 20):
        types, values, bonds, inputs, output = made
        question = DrawnGraph(build(types, values, bonds), tuple(inputs), (port(".".join(output)),), None, {})
        try:
            strip = reduction_strip(question, question.outputs[0])
        except Singular:
            continue
        for sketch in strip[1:]:
            labels = [tuple(line.text for line in vertex.lines) for vertex in sketch.nodes]
            assert len(set(labels)) == len(labels)
            drawn += 1
    assert drawn > 50
