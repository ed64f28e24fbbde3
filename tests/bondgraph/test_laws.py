"""Graphs with laws: their linearisation against the tableau of all equations with slopes taken by hand."""

import random
from contextlib import suppress
from fractions import Fraction

import pytest

from dynid.arithmetic.expression import parse
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.operating_point.element_laws import Law, LawGraph
from dynid.bondgraph.operating_point.equilibrium import OperatingPointRequest, find_operating_point
from dynid.bondgraph.operating_point.linearisation import linearised
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular, UsageError
from tests.bondgraph.graphs import at, transfers
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfers_at
from tests.sample import sample

S = Fraction(7, 5)


def double(number):
    """A value as dynid rounds it: to the nearest double, read exactly."""
    return Fraction(float(number))


# Laws of own variable x and another one y with their slopes by both, by hand.
LAWS = [
    ("a*x + b*x**3", lambda a, b, x, _y: (a + 3 * b * x**2, 0)),
    ("a*x*abs(x) + b*x*y", lambda a, b, x, y: (2 * a * abs(x) + b * y, b * x)),
    (
        "(a*x + b*y)/(1 + x**2)",
        lambda a, b, x, y: ((a - 2 * x * (a * x + b * y) / (1 + x**2)) / (1 + x**2), b / (1 + x**2)),
    ),
    ("a*y**2 + b*max(x, 0)", lambda a, b, x, y: (b if x > 0 else 0, 2 * a * y)),
    ("a*y - b*y", lambda a, b, _x, _y: (0, a - b)),
]


class RandomLaws:
    """A random graph in which elements and two-ports have laws, at a random point."""

    def __init__(self, seed):
        self.rng = rng = random.Random(seed)
        self.types, self.values, self.bonds, self.inputs, self.output = random_graph(
            rng, rng.randint(2, 5), rng.choice([0, 1])
        )
        self.laws, self.point, self.rows, self.known = {}, {}, {}, {}
        for name in [
            n for n, k in self.types.items() if k in ("R", "I", "C", "TF", "GY") and rng.random() < 0.4
        ][:4]:
            self.add_law(name)

    def bond(self, node):
        return next(k for k, pair in enumerate(self.bonds) if node in pair)

    def variable(self):
        """A random variable of the graph, and its value at the point."""
        node = self.rng.choice(
            [n for n, k in self.types.items() if k not in ("TF", "GY") and any(n in b for b in self.bonds)]
        )
        quantity = {"0": self.rng.choice("ep"), "1": self.rng.choice("fq")}.get(
            self.types[node]
        ) or self.rng.choice("efqp")
        port = Port(node, quantity)
        return port, self.value(port)

    def value(self, port):
        """The value of a variable at the point, one for all names of an effort or flow of a bond."""
        key = port if port.quantity in "qp" else (self.bond(port.node), port.quantity)
        value = self.known.setdefault(key, Fraction(self.rng.randint(-8, 8) or 1, self.rng.choice([1, 2, 4])))
        return self.point.setdefault(port, value)

    def term(self, port, coefficient):
        return self.bond(port.node), port.quantity, coefficient / (S if port.quantity in "qp" else 1)

    def add_law(self, name):
        rng, kind = self.rng, self.types[name]
        text, slopes = rng.choice(LAWS)
        a, b = Fraction(rng.randint(1, 9), 4), Fraction(rng.randint(1, 9), 8)
        other, y = self.variable()
        variables = {"y": other}
        if kind in ("TF", "GY"):
            self.add_modulus(name, a, b, other, y)
            return
        gives = {"I": "f", "C": "e"}.get(kind) or rng.choice("ef")
        own = Port(name, {"I": "p", "C": "q"}.get(kind) or "ef"[gives == "e"])
        if other == own:
            return
        x = self.value(own)
        variables["x"] = own
        expression = parse(text)
        self.laws[name] = Law(
            gives, expression, {"a": a, "b": b}, {k: v for k, v in variables.items() if k in expression.names}
        )
        by_own, by_other = slopes(a, b, x, y)
        sign = 1 if self.bonds[self.bond(name)][1] == name else -1
        element = double(by_own)
        if by_own and (kind in "IC" or gives == "f"):
            element = 1 / double(1 / Fraction(by_own))
        row = [(self.bond(name), gives, Fraction(1)), self.term(own, -sign * element)]
        row.append(self.term(other, -sign * double(by_other)))
        self.rows[name] = [row]

    def add_modulus(self, name, a, b, other, y):
        kind = self.types[name]
        into = next(k for k, pair in enumerate(self.bonds) if pair[1] == name)
        out = next(k for k, pair in enumerate(self.bonds) if pair[0] == name)
        self.laws[name] = Law("value", parse("a*y + b*y**2"), {"a": a, "b": b}, {"y": other})
        n, slope = a * y + b * y**2, a + 2 * b * y
        pairs = [((into, "e"), (out, "e")), ((out, "f"), (into, "f"))]
        if kind == "GY":
            pairs = [((into, "e"), (out, "f")), ((out, "e"), (into, "f"))]
        self.rows[name] = []
        for left, right in pairs:
            # the other factor at the point: given by a variable beside, where there is one
            port = self.beside(name, right)
            value = self.value(port)
            row = [(*left, Fraction(1)), (*right, -double(n)), self.term(other, -double(value * slope))]
            self.rows[name].append(row)

    def beside(self, name, place):
        """A port for the variable of a bond of a two-port: a sensor is put into the bond."""
        bond, quantity = place
        sensor = f"s_{name}_{len(self.bonds)}"
        tail, head = self.bonds[bond]
        self.types[sensor] = "0" if quantity == "e" else "1"
        # in the place of the old bond the one at the two-port, so that bonds keep their numbers
        own, rest = ((sensor, head), (tail, sensor)) if head == name else ((tail, sensor), (sensor, head))
        self.bonds[bond] = own
        self.bonds.append(rest)
        return Port(sensor, quantity)

    def graph(self):
        nodes = [
            Node(
                name, kind, self.values.get(name, Fraction(1)) if kind not in ("0", "1", "Se", "Sf") else None
            )
            for name, kind in self.types.items()
        ]
        return LawGraph(BondGraph(nodes, [Bond(*pair) for pair in self.bonds]), self.laws)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", sample(range(60), 20))
def test_the_linearisation_of_random_graphs_is_the_tableau_exactly(seed):
    made = RandomLaws(seed)
    if not made.laws:
        return
    try:
        model = made.graph()
    except UsageError:  # a junction without bonds
        return
    linear = linearised(find_operating_point(model, OperatingPointRequest(values=made.point)))
    types = made.types | dict.fromkeys(made.laws, "law")
    values = made.values | made.rows
    expected = transfers_at(types, values, made.bonds, made.inputs, [made.output], S)
    output = Port(*made.output)
    ports = [linear.variables.get(output, output)]
    if expected is None:
        with suppress(Singular):
            ReducedGraph(linear.graph, made.inputs, ports, traced=False)
        return
    try:
        reduced = ReducedGraph(linear.graph, made.inputs, ports, traced=False)
    except Singular as error:
        if "general" in str(error):  # a cancellation of general values is refused
            return
        raise
    found = {key: at(function, S) for key, function in transfers(reduced).items()}
    assert found == expected
