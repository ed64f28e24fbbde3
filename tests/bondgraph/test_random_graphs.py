"""Random graphs, contradictory and underdetermined ones included, against the tableau modulo a prime.

`python -m tests.bondgraph.test_random_graphs [COUNT] [SEED]` tries as many from any seed on, and counts.
"""

import math
import random
import sys
from collections import Counter

import pytest
from flint import fmpz_poly, nmod_poly

from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.errors import Singular
from tests.bondgraph.graphs import build, port, reduced, transfers
from tests.bondgraph.modular_tableau import PRIME, solve, transfer
from tests.bondgraph.random_graphs import coincident_graph, ill_posed_graph, random_graph
from tests.sample import sample

pytestmark = pytest.mark.thorough

RESULTS = frozenset({"transfer_function", "zeros", "poles", "properties"})
ANSWERED, WARNED, CONTRADICTORY, OPEN = "answered", "answered with a warning", "contradictory", "undetermined"


def fresh(seed):
    rng = random.Random(seed)
    match seed % 4:
        case 0:
            return random_graph(rng, rng.randint(1, 12), rng.choice([0, 0, 1, 2, 4]))
        case 1:
            return coincident_graph(rng, rng.randint(1, 7))
        case _:
            return ill_posed_graph(rng)


def expected_outcome(types, values, bonds, output, s):
    found = solve(types, values, bonds, output, s)
    if not found.solvable:
        return CONTRADICTORY
    if found.outputs is None:
        return OPEN
    return ANSWERED if found.determined else WARNED


def judge(seed):
    """Return what the tableau says of a graph; fail where the answer is another."""
    types, values, bonds, inputs, output = fresh(seed)
    rng = random.Random(f"points {seed}")
    expected = expected_outcome(types, values, bonds, output, rng.randrange(1, PRIME))
    out = port(".".join(output))
    graph = build(types, values, bonds)
    try:
        result = analyse(graph, Analysis(tuple(inputs), (out,), results=RESULTS, engine="exact"))
    except Singular as error:
        refused = error
    else:
        refused = None
    if refused is not None:
        assert expected in (CONTRADICTORY, OPEN), (seed, expected, str(refused))
        assert (" not determined" in refused.problem) is (expected == OPEN), (seed, str(refused))
        assert refused.names, seed
        assert set(refused.names) <= set(types), seed
        assert refused.remedy, seed
        return expected
    assert expected == (WARNED if "bond_graph/warnings" in result else ANSWERED), (seed, expected)
    exact = transfers(reduced(types, values, bonds, inputs, str(out)))
    known = transfer(types, values, bonds, output, rng)
    for source in inputs:
        function = exact[str(out), source]
        assert_same_function(function, known[source], seed)
        assert_properties(result, str(out), source, function, seed)
    return expected


def assert_same_function(function, known, seed):
    numerator, denominator = known
    found = [
        nmod_poly([int(c) % PRIME for c in p.coeffs()], PRIME)
        for p in (function.numerator, function.denominator)
    ]
    lead = nmod_poly([pow(int(found[1][found[1].degree()]), -1, PRIME)], PRIME)
    assert found[0] * lead == numerator, seed
    assert found[1] * lead == denominator, seed


def assert_properties(result, output, source, function, seed):
    """Check roots and degrees against the polynomials, which are those of the tableau."""
    numerator, denominator = function.numerator, function.denominator
    group = f"bond_graph/transfer_function/{output}/{source}"
    told = f"bond_graph/properties/{output}/{source}"
    vanishes = not numerator
    assert_roots(result[f"{group}/poles"].data, denominator, seed)
    assert_roots(result[f"{group}/zeros"].data, fmpz_poly([1]) if vanishes else numerator, seed)
    assert result.value(f"{told}/order") == denominator.degree(), seed
    relative = math.inf if vanishes else denominator.degree() - numerator.degree()
    assert result.value(f"{told}/relative_degree") == relative, seed


def assert_roots(found, polynomial, seed):
    """Match roots one by one: they are certified, so to a few roundings of each."""
    known = [
        complex(float(root.real.mid()), float(root.imag.mid()))
        for root, multiplicity in polynomial.complex_roots()
        for _ in range(multiplicity)
    ]
    left = list(found)
    assert len(left) == len(known), seed
    for root in known:
        nearest = min(range(len(left)), key=lambda k: abs(left[k] - root))
        assert abs(left.pop(nearest) - root) <= 1e-12 * abs(root), (seed, root)


@pytest.mark.parametrize("first", sample(range(0, 120, 30), 1))
def test_fresh_graphs_are_answered_or_refused_as_the_tableau_says(first):
    for seed in range(first, first + 30):
        judge(seed)


def test_the_graphs_are_of_all_kinds():
    rng = random.Random(0)
    seen = Counter()
    for seed in range(200):
        types, values, bonds, _, output = fresh(seed)
        seen[expected_outcome(types, values, bonds, output, rng.randrange(1, PRIME))] += 1
    assert min(seen[kind] for kind in (ANSWERED, WARNED, CONTRADICTORY, OPEN)) >= 10


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1_000_000, 1_002_000, 100))
def test_two_thousand_fresh_graphs(first):
    for seed in range(first, first + 100):
        judge(seed)


if __name__ == "__main__":
    count, start = (int(given) for given in (*sys.argv[1:], *("2000", "1000000")[len(sys.argv) - 1 :]))
    tally = Counter()
    for number in range(start, start + count):
        try:
            tally[judge(number)] += 1
        except Exception as error:
            tally["wrong"] += 1
            print(f"{type(error).__name__}: {error}"[:300], flush=True)
    print(", ".join(f"{kind}: {times}" for kind, times in sorted(tally.items())), f"wrong: {tally['wrong']}")
