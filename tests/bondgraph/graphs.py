"""Small ways to write a graph in a test, and to read exact results off it."""

from fractions import Fraction
from itertools import pairwise

from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular

ISOLATOR = (
    "Sf v_in, 0 base, 1 body, I m_s 10, R b 50, TF tuning 1/100, 1 fluid, I I_f 20000, C C_a 1/100000000",
    "v_in -> base -> body, body -> m_s, body -> b, base -> tuning -> fluid, fluid -> I_f, fluid -> C_a",
)


def chain(stages):
    """Masses in a row, each on a spring and a damper to the next, the last one tied to ground: as text."""
    nodes, bonds = "Se F", "F -> v1"
    for i in range(1, stages + 1):
        nodes += f", 1 v{i}, I m{i} {100 + i}/100, 0 z{i}"
        nodes += f", 1 l{i}, C k{i} 1/{1000 + 7 * i}, R b{i} {10 + i % 13}"
        bonds += f", v{i} -> m{i}, v{i} -> z{i} -> l{i} -> k{i}, l{i} -> b{i}"
        bonds += f", z{i} -> v{i + 1}" if i < stages else ""
    return nodes, bonds


def parse(nodes, bonds):
    """Read 'Se u, 1 j, R r 2' and 'u -> j -> r' into (types, values, bonds)."""
    types, values, pairs = {}, {}, []
    for entry in nodes.split(","):
        kind, name, *value = entry.split()
        types[name] = kind
        if value:
            values[name] = Fraction(value[0])
    for chain in bonds.split(","):
        ends = [end.strip() for end in chain.split("->")]
        pairs += pairwise(ends)
    return types, values, pairs


def build(types, values, bonds):
    return BondGraph(
        [Node(name, kind, values.get(name)) for name, kind in types.items()],
        [Bond(tail, head) for tail, head in bonds],
    )


def port(text):
    node, _, quantity = text.rpartition(".")
    return Port(node, quantity)


def reduced(types, values, bonds, inputs, *outputs):
    return ReducedGraph(build(types, values, bonds), inputs, [port(output) for output in outputs])


def solvable(made):
    """Reduce a random graph; None where it has no unique solution."""
    types, values, bonds, inputs, (node, quantity) = made
    try:
        return reduced(types, values, bonds, inputs, f"{node}.{quantity}")
    except Singular:
        return None


def written(nodes, bonds, *outputs, inputs=None):
    """Reduce a graph that is written as text; all its sources are inputs unless said otherwise."""
    types, values, pairs = parse(nodes, bonds)
    sources = [name for name, kind in types.items() if kind in ("Se", "Sf")]
    return reduced(types, values, pairs, sources if inputs is None else inputs, *outputs)


def transfers(graph):
    """Return the exact transfer function of every channel, by the texts of output and input."""
    channels = graph.channels()
    ratios = graph.rational(channels.values())
    return {
        (str(output), source): TransferFunction.of(ratios[register])
        for (output, source), register in channels.items()
    }


def transfer(nodes, bonds, output, inputs=None):
    """Return the only channel of a graph that is written as text."""
    (only,) = transfers(written(nodes, bonds, output, inputs=inputs)).values()
    return only


def polynomial_at(polynomial, s):
    """Evaluate an integer polynomial by Horner's rule."""
    total = 0 * s
    for coefficient in reversed([int(c) for c in polynomial.coeffs()]):
        total = total * s + coefficient
    return total


def at(function, s):
    """Return T(s) at a rational s, or None at a pole."""
    denominator = polynomial_at(function.denominator, s)
    return polynomial_at(function.numerator, s) / denominator if denominator else None
