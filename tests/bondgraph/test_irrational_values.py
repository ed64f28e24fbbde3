"""Irrational values: the same graph in other units has the same zeros, poles and cancellations.

Efforts and flows of every part of a random graph of rational values are measured in irrational units:
efforts times λ, flows times c/λ, times τ for time. The values change by powers of these, which are written as
expressions, differently each time (√6 as sqrt(2)*sqrt(3)). Nothing else changes, so that the rational graph
says what is right: T(s) becomes λ_out/λ_in T(τ s), with the same degrees. The rational function comes from
the tableau of all equations.

`python -m tests.bondgraph.test_irrational_values [COUNT] [SEED]` tries as many from any seed on.
"""

import random
import sys
import time
from collections import Counter
from fractions import Fraction
from math import inf, isclose

import numpy as np
import pytest
from flint import ctx, fmpq, fmpq_poly

from dynid.arithmetic.expression import parse
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph import Bond, BondGraph, Node
from dynid.errors import Singular
from tests.bondgraph.graphs import build, port
from tests.bondgraph.random_graphs import coincident_graph, random_graph
from tests.bondgraph.tableau import determinant_at, transfer_at

pytestmark = pytest.mark.thorough

#: Spellings of one number each: square roots and powers, and functions beside them.
ROOTS = (
    ("sqrt(2)", "2**0.5", "2/sqrt(2)", "sqrt(8)/2", "(1 + sqrt(2)) - 1", "0.5**(-1/2)"),
    ("sqrt(3)", "sqrt(12)/2", "3/sqrt(3)", "(1/3)**(-0.5)"),
    ("sqrt(6)", "sqrt(2)*sqrt(3)", "3*sqrt(2/3)", "sqrt(5 + 2*sqrt(6)) - sqrt(2) - sqrt(3) + sqrt(6)"),
    ("1 + sqrt(2)", "sqrt(3 + 2*sqrt(2))", "1/(sqrt(2) - 1)", "(5*sqrt(2) + 7)**(1/3)"),
    ("(1 + sqrt(5))/2", "1 + 2/(1 + sqrt(5))", "(2 + sqrt(5))**(1/3)", "sqrt((3 + sqrt(5))/2)"),
    ("2**(1/3)", "4**(2/3)/2", "16**(1/3)/2", "2/4**(1/3)"),
    ("sqrt(2 + sqrt(3))", "(sqrt(6) + sqrt(2))/2", "1/sqrt(2 - sqrt(3))"),
    ("sqrt(0.003/7e-6)", "sqrt(0.003)/sqrt(7e-6)", "sqrt(3000/7)", "0.003/sqrt(0.003*7e-6)"),
    ("7**0.25", "sqrt(sqrt(7))", "7/7**(3/4)"),
)
FUNCTIONS = (
    ("sqrt(2)", "2*cos(pi/4)", "2*sin(pi/4)", "exp(log(2)/2)"),
    ("sqrt(3)", "tan(pi/3)", "2*sin(pi/3)", "4*cos(pi/6) - sqrt(3)"),
    ("(1 + sqrt(5))/2", "2*cos(pi/5)", "1 + 2*cos(2*pi/5)"),
    ("pi", "sqrt(pi)**2", "pi*(sin(1)**2 + cos(1)**2)", "pi**2/pi"),
    ("exp(1)", "exp(1/2)**2", "exp(2)/exp(1)", "exp(1 + log(3))/3"),
    ("log(2)", "log(4)/2", "log(6) - log(3)", "-log(0.5)"),
    ("sin(1)", "sqrt(1 - cos(1)**2)", "2*sin(0.5)*cos(0.5)", "tan(1)*cos(1)"),
    ("2**pi", "exp(pi*log(2))", "2*2**(pi - 1)"),
)


ASKED = frozenset(
    {"transfer_function", "zeros", "poles", "properties", "hidden_modes", "frequency_response", "state_space"}
)
OMEGA = np.array([0.37, 2.3])


class Units:
    """A random unit for every part of a graph that plain bonds tie together."""

    def __init__(self, rng, types, bonds, pool):
        self.rng, self.types, self.bonds = rng, types, bonds
        self.pool, self.unit, self.power = pool, {}, rng.choice([None, rng.choice(pool)])
        self.time = rng.choice([None, rng.choice(pool)])
        parts = list(range(len(bonds)))
        for name, kind in types.items():
            if kind in "01":
                at = [k for k, bond in enumerate(bonds) if name in bond]
                for k in at[1:]:
                    old, new = parts[k], parts[at[0]]
                    parts = [new if part == old else part for part in parts]
        self.parts = parts
        self.of_part = {part: rng.choice([None, *pool]) for part in sorted(set(parts))}

    def written(self, number):
        return "1" if number is None else f"({self.rng.choice(number)})"

    def at(self, name, second=False):
        at = [k for k, bond in enumerate(self.bonds) if name in bond]
        if self.types[name] in ("TF", "GY"):
            at.sort(key=lambda k: self.bonds[k][0] == name)  # the bond in first
        return self.of_part[self.parts[at[-1 if second else 0]]]

    def text(self, name, value):
        one, time, power = self.at(name), self.written(self.time), self.written(self.power)
        square = self.rng.choice([f"{self.written(one)}**2", f"{self.written(one)}*{self.written(one)}"])
        match self.types[name]:
            case "R":
                return f"({value})*{square}/{power}"
            case "I":
                return f"({value})*{time}*{square}/{power}"
            case "C":
                return f"{time}*({value})/({square})*{power}"
        two = self.at(name, second=True)
        if self.types[name] == "TF":
            return f"({value})*{self.written(one)}/{self.written(two)}"
        return f"{self.written(one)}*({value})*{self.written(two)}/{power}"

    def factor(self, name, quantity):
        """Return the number by which a variable is multiplied."""
        size = float(parse(self.written(self.at(name))).evaluate({}))
        power = float(parse(self.written(self.power)).evaluate({}))
        found = size if quantity in "ep" else power / size
        return found * (self.period if quantity in "qp" else 1)

    @property
    def period(self):
        return float(parse(self.written(self.time)).evaluate({}))


def rational_transfer(types, values, bonds, inputs, output):
    """Return numerators by input, and the denominator, by interpolation of the tableau; None if singular."""
    order = sum(kind in "IC" for kind in types.values())
    points, samples = [], {name: [] for name in inputs}
    levels = []
    k = 0
    while len(points) < order + 2:
        k += 1
        if k > 4 * order + 12:
            return None
        s = Fraction(3 * k + 1, 7)
        level = determinant_at(types, values, bonds, s)
        if level == 0:
            continue
        found = transfer_at(types, values, bonds, inputs, output, s)
        points.append(s)
        levels.append(level)
        for name in inputs:
            integral = s if output[1] in "qp" else 1
            samples[name].append(found[name] * level * integral)
    below = interpolated(points, levels)
    integral = fmpq_poly([0, 1]) if output[1] in "qp" else fmpq_poly([1])
    return {name: lowest(interpolated(points, column), below * integral) for name, column in samples.items()}


def interpolated(points, levels):
    """Return the polynomial through points (Newton's divided differences)."""
    table = [fmpq(y.numerator, y.denominator) for y in levels]
    x = [fmpq(p.numerator, p.denominator) for p in points]
    for width in range(1, len(x)):
        for k in range(len(x) - 1, width - 1, -1):
            table[k] = (table[k] - table[k - 1]) / (x[k] - x[k - width])
    total = fmpq_poly([0])
    for level, place in zip(reversed(table), reversed(x), strict=True):
        total = total * fmpq_poly([-place, 1]) + level
    return total


def lowest(above, below):
    common = above.gcd(below)
    return above // common, below // common


def roots_of(polynomial, period):
    """Return the roots, each as often as it is one, of p(τ s); those on the axis have no real part."""
    if polynomial.degree() < 1:
        return []
    with ctx.workprec(300):
        found = [
            (complex(float(root.real.mid()), float(root.imag.mid())), count)
            for root, count in polynomial.complex_roots()
        ]
    return sorted((clean(root / period) for root, count in found for _ in range(count)), key=order_of)


def clean(root):
    return complex(0.0 if abs(root.real) < 1e-30 * abs(root) else root.real, root.imag)


def order_of(root):
    return round(abs(root), 9), round(root.real, 9), root.imag


def same_roots(found, expected):
    if len(found) != len(expected):
        return False
    left = list(found)
    for root in expected:
        nearest = min(left, key=lambda other: abs(other - root))
        if abs(nearest - root) > 1e-9 * abs(root):
            return False
        left.remove(nearest)
    return True


def limit(above, below, at_zero):
    """Return the limit of a quotient at 0+ or at infinity."""
    if above == 0:
        return 0.0
    a, b = list(above.coeffs()), list(below.coeffs())
    if at_zero:
        i, j = (next(k for k, c in enumerate(p) if c != 0) for p in (a, b))
    else:
        i, j, a, b = -len(a), -len(b), a[::-1], b[::-1]
    value = a[i if at_zero else 0] / b[j if at_zero else 0]
    ratio = int(value.p) / int(value.q)
    return ratio if i == j else 0.0 if i > j else inf if ratio > 0 else -inf


def judged(seed, functions=False):
    """Return what the tableau says of a graph; fail where the graph in other units is answered otherwise."""
    rng = random.Random(seed)
    if seed % 2:
        types, values, bonds, inputs, output = random_graph(rng, rng.randint(1, 6), rng.choice([0, 0, 1]))
    else:
        types, values, bonds, inputs, output = coincident_graph(rng, rng.randint(1, 5))
    units = Units(rng, types, bonds, FUNCTIONS if functions else ROOTS)
    texts = {name: units.text(name, value) for name, value in values.items()}
    expected = rational_transfer(types, values, bonds, inputs, output)
    numbers = {name: parse(text).evaluate({}) for name, text in texts.items()}
    graph = BondGraph(
        [Node(name, kind, numbers.get(name)) for name, kind in types.items()], [Bond(*b) for b in bonds]
    )
    out = port(".".join(output))
    request = Analysis(tuple(inputs), (out,), results=ASKED, engine="exact", omega=OMEGA)
    try:
        result = analyse(graph, request)
    except Singular:
        assert expected is None, (seed, "refused", texts)
        return "refused"
    if expected is None:
        return "singular beside the output"
    rational = analyse(build(types, values, bonds), request)
    for k, name in enumerate(inputs):
        context = (seed, name, texts)
        compare(result, units, types, output, name, *expected[name], context)
        compare_response(result, units, types, output, k, name, *expected[name], context)
        compare_hidden(result, rational, units, f"{out}/{name}", context)
    return "irrational" if graph.field is not None else "rational"


def compare(result, units, types, output, name, above, below, context):
    group = f"{'.'.join(output)}/{name}"
    if above == 0:
        below = fmpq_poly([1])
    found = {key: result[f"bond_graph/properties/{group}/{key}"].data for key in ("order", "relative_degree")}
    assert found["order"] == below.degree(), (context, found, below)
    degree = inf if above == 0 else below.degree() - above.degree()
    assert found["relative_degree"] == degree, (context, found)
    period = units.period
    for what, polynomial in (("zeros", above), ("poles", below)):
        roots = result[f"bond_graph/transfer_function/{group}/{what}"].data
        expected = roots_of(polynomial, period)
        assert same_roots(list(roots), expected), (context, what, roots, expected)
        # what lies on the axis lies there exactly
        assert sum(r.real == 0 for r in roots) == sum(r.real == 0 for r in expected), (context, what, roots)
    factor = units.factor(*output) / units.factor(name, "e" if types[name] == "Se" else "f")
    for key, at_zero in (("dc_gain", True), ("high_frequency_gain", False)):
        gain = result[f"bond_graph/properties/{group}/{key}"].data
        rational = limit(above, below, at_zero)
        assert isclose(gain, factor * rational, rel_tol=1e-9), (context, key, gain, factor * rational)


def compare_response(result, units, types, output, k, name, above, below, context):
    """Compare frequency response and state equations with the rational function on the axis."""
    factor = units.factor(*output) / units.factor(name, "e" if types[name] == "Se" else "f")
    response = result["bond_graph/frequency_response/response"].data[:, 0, k]
    A, B, C = (result[f"bond_graph/state_space/{part}"].data for part in "ABC")
    direct = result["bond_graph/state_space/feedthrough"].data[:, 0, k]
    for omega, value in zip(OMEGA, response, strict=True):
        s = 1j * omega * units.period
        expected = factor * evaluated(above, s) / evaluated(below, s)
        assert abs(value - expected) <= 1e-9 * abs(expected), (context, omega, value, expected)
        states = np.linalg.solve(1j * omega * np.eye(len(A)) - A, B[:, k])
        found = C[0] @ states + np.polyval(direct[::-1], 1j * omega)
        scale = abs(expected) + abs(C[0]) @ abs(states)
        assert abs(found - expected) <= 1e-9 * scale, (context, omega, found, expected)


def evaluated(polynomial, s):
    return sum(int(c.p) / int(c.q) * s**k for k, c in enumerate(polynomial.coeffs()))


def compare_hidden(result, rational, units, channel, context):
    """Compare hidden modes and their causes with those of the rational graph, but for the unit of time."""
    group = f"bond_graph/properties/{channel}"
    modes, others = (list(each[f"{group}/hidden_modes"].data) for each in (result, rational))
    assert same_roots(modes, [root / units.period for root in others]), (context, modes, others)
    causes = [sorted(each[f"{group}/hidden_mode_cause"].data) for each in (result, rational)]
    assert causes[0] == causes[1], (context, causes)


@pytest.mark.parametrize("seed", range(12))
def test_a_graph_in_units_of_roots_is_the_same_graph(seed):
    judged(seed)


@pytest.mark.parametrize("seed", range(1000, 1008))
def test_a_graph_in_units_of_functions_is_the_same_graph(seed):
    judged(seed, functions=True)


if __name__ == "__main__":
    count, first = (int(given) for given in [*sys.argv[1:], *("300", "20000")[len(sys.argv) - 1 :]])
    tally, failures = Counter(), 0
    slowest = 0.0
    for seed in range(first, first + count):
        start = time.process_time()
        try:
            tally[judged(seed, functions=seed % 5 == 0)] += 1
        except Exception as error:
            failures += 1
            print(seed, type(error).__name__, str(error)[:600], flush=True)
        slowest = max(slowest, time.process_time() - start)
    print(dict(tally), f"{failures} failed", f"slowest {slowest:.1f} s")
