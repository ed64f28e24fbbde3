"""Natural modes at every port: those of the graph with the driving port removed, by its tableau.

The oracle takes the driving source and its bond out of the graph, keeps the part that the port depends on,
and evaluates the determinant of all equations at rational points: two polynomials with the same quotient at
more points than they have roots are one, up to a factor.
"""

import random
from fractions import Fraction

import pytest

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.decomposition.equivalents import Decomposition
from dynid.bondgraph.decomposition.graph_bisection import BondOnLoop
from dynid.bondgraph.decomposition.prototype_dynamics import prototype_dynamics
from dynid.bondgraph.graph import Bond
from dynid.bondgraph.results.port import static_characteristics
from dynid.errors import Singular
from dynid.lti.certified_roots import certified_roots
from tests.bondgraph.graphs import build, parse, polynomial_at, port, reduced
from tests.bondgraph.random_graphs import coincident_graph, driven_ring, random_graph
from tests.bondgraph.tableau import determinant_at, transfer_at
from tests.sample import sample

pytestmark = pytest.mark.thorough

BRIDGE = (
    "Sf F, 0 a, 1 p, 1 q, 0 b, 0 d, 1 w, R Rp 2, R Rq 3, R Rw 5, C Cb 1/10, I Ld 7/10",
    "F -> a, a -> p -> b, a -> q -> d, b -> w -> d, p -> Rp, q -> Rq, w -> Rw, b -> Cb, d -> Ld",
)
FIXES = {("0", "Se"), ("1", "Sf")}


class Oracle:
    """A graph as text, taken apart without any code of the project."""

    def __init__(self, types, values, bonds):
        self.types, self.values, self.bonds = types, values, bonds

    def joined(self, start):
        """Return the like junctions that plain bonds make one with this one."""
        found = [start]
        for name in found:
            for pair in self.bonds:
                if name in pair:
                    found += [o for o in pair if o not in found and self.types[o] == self.types[start]]
        return found if self.types[start] in "01" else [start]

    def fixing(self, start):
        """Return the source that fixes the common variable of a junction, if any."""
        group = self.joined(start)
        ends = [o for pair in self.bonds for name in pair if name in group for o in pair]
        return next((o for o in ends if (self.types[start], self.types[o]) in FIXES), None)

    def without(self, *dropped):
        """Return the oracle without some nodes and their bonds."""
        types = {name: kind for name, kind in self.types.items() if name not in dropped}
        return Oracle(types, self.values, [pair for pair in self.bonds if not set(pair) & set(dropped)])

    def part(self, *starts):
        """Return what influences some nodes: a junction with a fixed variable passes nothing on."""
        inside, queue = {o for start in starts for o in self.joined(start)}, []
        queue += inside
        types, bonds = {}, []
        for name in queue:
            types[name] = self.types[name]
            for index, pair in enumerate(self.bonds):
                if name not in pair:
                    continue
                other = pair[pair[0] == name]
                if self.types[other] in "01" and other not in inside and self.fixing(other):
                    stub = f"fixed {index}"
                    types[stub] = "Se" if self.types[other] == "0" else "Sf"
                    bonds.append((index, tuple(stub if end == other else end for end in pair)))
                    continue
                bonds.append((index, pair))
                new = [o for o in self.joined(other) if o not in inside]
                inside.update(new)
                queue += new
        return Oracle(types, self.values, [pair for _, pair in sorted(set(bonds))])

    def is_undetermined(self):
        """Tell whether a part has many solutions, such as a flow round a ring of like junctions."""
        points = (Fraction(101, 7), Fraction(997, 31), Fraction(89, 1009))
        return not any(determinant_at(self.types, self.values, self.bonds, s) for s in points)

    def is_the_determinant(self, polynomial):
        """Compare with a polynomial at more points than either has roots."""
        count = 2 + sum(kind in ("I", "C") for kind in self.types.values())
        points = [Fraction(k * k + 3, 2 * k + 7) for k in range(1, count + 2)]
        found = [determinant_at(self.types, self.values, self.bonds, s) for s in points]
        given = [polynomial_at(polynomial, s) for s in points]
        scale = next((f / g for f, g in zip(found, given, strict=True) if g), None)
        if scale is None:
            return not any(found)
        return scale != 0 and found == [scale * value for value in given]


def assert_holds(dynamics):
    """Check what the prototype says of its modes against what it is made of."""
    a, b = dynamics.systems
    both, crossed = a.numerator * b.numerator, a.denominator * b.denominator
    counted = crossed + both
    if dynamics.prototype.fixed:
        counted = a.numerator * b.denominator + b.numerator * a.denominator
    if dynamics.natural == 0:
        return
    if not dynamics.prototype.shared():
        assert counted == 0 or dynamics.natural.gcd(counted).degree() == counted.degree()
        assert dynamics.foreign_modes.degree() <= 0
    modes = certified_roots(dynamics.natural)
    power = dynamics.net_power(modes)
    assert len(power) == dynamics.natural.degree()
    assert (power < 1e-30).all()  # modes are refined to 192 bits


def ports_of(types, bonds):
    """Yield every output of a graph that has a junction of its own."""
    for name, kind in types.items():
        if kind in ("TF", "GY"):
            continue
        (beside,) = [{*pair} - {name} for pair in bonds if name in pair][:1]
        at = name if kind in "01" else next(iter(beside), name)
        if types[at] in "01":
            yield at, f"{name}.{'e' if kind == '0' else 'f' if kind == '1' else 'ef'[len(name) % 2]}"


def check_outputs(made, most):
    """Check the natural modes at outputs, sources first; return how many, and how many lie on loops."""
    types, values, bonds, inputs, _ = made
    oracle, checked, looped = Oracle(types, values, bonds), 0, 0
    for at, output in [*ports_of(types, bonds)][-most:]:
        try:
            graph = reduced(types, values, bonds, inputs, output)
        except Singular:
            continue
        prototype = graph.reductions[port(output)].prototype
        dynamics = prototype_dynamics(graph, prototype)
        assert_holds(dynamics)
        fixing = oracle.fixing(at)
        if prototype.fixed and fixing is None:
            continue  # a constraint drives it, and no source that could be taken out
        released = oracle.part(at) if fixing is None else oracle.without(fixing).part(at)
        if released.is_undetermined() and dynamics.natural != 0:
            continue  # outside what the output needs
        assert released.is_the_determinant(dynamics.natural), output
        checked, looped = checked + 1, looped + bool(prototype.shared())
    return checked, looped


def check_bonds(made, most):
    """Check the natural modes, and rest, at bonds that part the graph; return how many, and with loops."""
    types, values, bonds, inputs, _ = made
    oracle, checked, looped = Oracle(types, values, bonds), 0, 0
    for index, (tail, head) in [*enumerate(bonds)][-most:]:
        try:
            parts = Decomposition(build(types, values, bonds), Bond(tail, head), inputs)
        except (Singular, BondOnLoop):
            continue
        if parts.port != Bond(*bonds[index]) or types[head] not in "01":
            continue
        dynamics = prototype_dynamics(parts, parts.prototype)
        assert_holds(dynamics)
        check_rest(parts, types, values, bonds, index, inputs)
        if parts.load.ideal:
            continue
        rest = Oracle(types, values, [pair for pair in bonds if pair != (tail, head)])
        released = rest.part(head) if parts.source.ideal else oracle.part(tail, head)
        if released.is_undetermined() and dynamics.natural != 0:
            continue
        assert released.is_the_determinant(dynamics.natural), (tail, head)
        checked, looped = checked + 1, looped + bool(parts.prototype.shared())
    return checked, looped


def check_rest(parts, types, values, bonds, index, inputs):
    """Check the operating point at rest where the tableau has one."""
    found = static_characteristics(parts)
    for place, quantity in ((0, "f"), (1, "e")):
        tail, head = bonds[index]
        split = [
            *bonds[:index],
            (tail, "gauge"),
            ("gauge", "between"),
            ("between", head),
            *bonds[index + 1 :],
        ]
        more = {**types, "gauge": "TF", "between": "0" if quantity == "e" else "1"}
        more["meter"] = "Sf" if quantity == "e" else "Se"
        split.append(("between", "meter"))
        known = {**values, "gauge": Fraction(1)}
        rest = transfer_at(more, known, split, inputs, ("meter", quantity), Fraction(0))
        if rest is not None:
            assert {name: point.operating[place] for name, point in found.items()} == {
                name: value for name, value in rest.items() if name in found
            }


def graphs(first, count):
    """Yield random graphs: trees and loops with any values, and loops full of coincidences."""
    for seed in range(first, first + count):
        rng = random.Random(seed)
        if seed % 3 == 0:
            yield random_graph(rng, rng.randint(2, 7), rng.choice([0, 1, 1, 2, 3]))
        elif seed % 3 == 1:
            yield driven_ring(rng, rng.randint(3, 6), rng.choice([0, 0, 1, 2]))
        else:
            yield coincident_graph(rng, rng.randint(1, 6))


def check(first, count, most):
    """Check many graphs; return how many outputs and bonds were compared, and how many of them on loops."""
    totals = [0, 0, 0, 0]
    for made in graphs(first, count):
        counted = (*check_outputs(made, most), *check_bonds(made, most))
        totals = [total + more for total, more in zip(totals, counted, strict=True)]
    return totals


@pytest.mark.parametrize("first", sample([300_000, 310_000], 1))
def test_the_natural_modes_are_those_of_the_graph_with_the_driving_port_removed(first):
    outputs, looped, bonds, driven = check(first, 30, most=2)
    assert outputs > 25
    assert looped > 5
    assert bonds > 10
    assert driven > 5


@pytest.mark.slow
@pytest.mark.parametrize("first", range(400_000, 500_000, 10_000))
def test_the_natural_modes_of_2000_graphs_at_every_port(first):
    outputs, looped, bonds, driven = check(first, 200, most=5)
    assert outputs > 400
    assert looped > 30
    assert bonds > 80
    assert driven > 20


def test_the_bridges_modes_are_counted_once_and_what_is_counted_twice_is_named():
    types, values, bonds = parse(*BRIDGE)
    asked = frozenset({"prototype"})
    analysis = Analysis(("F",), (port("F.e"),), asked, port=Bond("F", "a"))
    result = analyse(build(types, values, bonds), analysis)
    for group in ("bond_graph/port", "bond_graph/reduction/dynamics/F.e"):
        modes = result[f"{group}/natural_modes"].data
        assert len(modes) == 2
        # Cb and Ld behind the resistances, the current source taken out: 7 s^2 + 25 s + 100
        assert modes.real == pytest.approx([-25 / 14] * 2, rel=1e-15)
        assert not result.value(f"{group}/independent")
        assert result.value(f"{group}/shared_junctions") == "p, q, b, d, w"
        assert len(result[f"{group}/pole_dynamics/foreign_roots"].data) == 2
        assert len(result[f"{group}/pole_dynamics/missed_roots"].data) == 0
        assert "not independent" in result.group_attrs[f"{group}/pole_dynamics"]["note"]
        assert result[f"{group}/net_power"].data == pytest.approx([0, 0], abs=1e-30)


def test_on_a_tree_the_systems_are_independent():
    types, values, bonds = parse("Sf u, 0 j, C c 2, I m 3, 1 k, R r 5", "u -> j -> c, j -> m, j -> k -> r")
    graph = reduced(types, values, bonds, ["u"], "j.e")
    dynamics = prototype_dynamics(graph, graph.reductions[port("j.e")].prototype)
    assert dynamics.prototype.shared() == ()
    assert certified_roots(dynamics.natural) == certified_roots(dynamics.pole)
