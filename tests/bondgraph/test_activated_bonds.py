"""Activated bonds: controlled sources, against the tableau of all equations, exactly."""

import random
from fractions import Fraction

import pytest

from dynid.errors import Singular
from tests.bondgraph.graphs import at, reduced, transfers
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfers_at
from tests.sample import sample


def activated(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, output = random_graph(rng, rng.randint(2, 7), rng.choice([0, 1, 2]))
    junctions = [name for name, kind in types.items() if kind in "01" and any(name in bond for bond in bonds)]
    for k in range(rng.choice([1, 1, 2, 3])):
        if len(junctions) < 2:
            break
        one, other = rng.sample(junctions, 2)
        name = f"a{k}"
        types[name], values[name] = "A", Fraction(rng.randint(-30, 30) or 1, rng.randint(1, 9))
        bonds += [(one, name), (name, other)]
    return types, values, bonds, inputs, output


@pytest.mark.parametrize("seed", sample(range(150), 50))
def test_random_graphs_with_activated_bonds_are_the_tableau(seed):
    types, values, bonds, inputs, output = activated(seed)
    expected = transfers_at(types, values, bonds, inputs, [output], Fraction(7, 5))
    try:
        graph = reduced(types, values, bonds, inputs, ".".join(output))
    except Singular:
        assert expected is None
        return
    except Exception as error:
        if "ends at the junction" in str(error):
            return
        raise
    if expected is not None:
        found = {key: at(function, Fraction(7, 5)) for key, function in transfers(graph).items()}
        assert found == expected
