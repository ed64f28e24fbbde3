"""Transfer matrices of random graphs against the tableau: several inputs and outputs, every quantity."""

import random
from collections import Counter
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.bondgraph.causality.scap import assign_causality
from dynid.errors import Singular
from tests.bondgraph.graphs import at, build, reduced, transfers
from tests.bondgraph.random_graphs import random_graph
from tests.bondgraph.tableau import transfers_at

pytestmark = pytest.mark.thorough

S = Fraction(987654321, 1234577)


def several_outputs(rng, types):
    """Return up to four variables, of any nodes and quantities."""
    allowed = {"0": "ep", "1": "fq"}
    nodes = [name for name, kind in types.items() if kind not in ("TF", "GY")]
    chosen = rng.sample(nodes, min(len(nodes), 4))
    return [(name, rng.choice(allowed.get(types[name], "efqp"))) for name in chosen]


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 2**40))
def test_random_transfer_matrices_agree_exactly_with_the_tableau(seed):
    assert_agrees(seed)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(seed=st.integers(0, 2**40))
def test_300_random_transfer_matrices_agree_exactly_with_the_tableau(seed):
    assert_agrees(seed)


def assert_agrees(seed):
    rng = random.Random(seed)
    types, values, bonds, inputs, _ = random_graph(rng, rng.randint(1, 8), rng.choice([0, 0, 1, 2, 4]))
    outputs = several_outputs(rng, types)
    expected = transfers_at(types, values, bonds, inputs, outputs, S)
    try:
        graph = reduced(types, values, bonds, inputs, *(f"{node}.{quantity}" for node, quantity in outputs))
    except Singular:
        assert expected is None
        return
    if expected is not None:
        found = {channel: at(transfer, S) for channel, transfer in transfers(graph).items()}
        assert found == expected


def test_the_random_graphs_hold_every_kind_of_difficulty():
    """Counted over 150 of them, so that the agreement above means something."""
    seen = Counter()
    for seed in range(150):
        rng = random.Random(seed)
        types, values, bonds, inputs, _ = random_graph(rng, rng.randint(1, 8), rng.choice([0, 0, 1, 2, 4]))
        outputs = several_outputs(rng, types)
        seen["several inputs and outputs"] += len(inputs) > 1 and len(outputs) > 1
        seen["trees"] += len(bonds) < len(types)
        seen["loops"] += len(bonds) >= len(types)
        seen["rings with several TF, GY"] += two_ports_in_rings(types, bonds) > 1
        seen["a displacement or momentum"] += any(quantity in "qp" for _, quantity in outputs)
        causality = assign_causality(build(types, values, bonds))
        seen["derivative causality"] += bool(causality.dependent)
        seen["algebraic loops"] += bool(causality.loops)
        try:
            names = [f"{node}.{quantity}" for node, quantity in outputs]
            graph = reduced(types, values, bonds, inputs, *names)
        except Singular:
            seen["no unique solution"] += 1
            continue
        found = transfers(graph).values()
        seen["improper"] += any(t.relative_degree < 0 for t in found)
        seen["identically zero"] += any(t.vanishes for t in found)
        seen["no state"] += all(t.order == 0 for t in found)
    assert all(count > 5 for count in seen.values()), seen
    assert len(seen) == 11


def two_ports_in_rings(types, bonds):
    """Count the TF and GY that lie on a ring: without them their ends are still connected."""
    count = 0
    for name in (name for name, kind in types.items() if kind in ("TF", "GY")):
        ends = [other for bond in bonds if name in bond for other in bond if other != name]
        rest = [bond for bond in bonds if name not in bond]
        reached, queue = {ends[0]}, [ends[0]]
        for node in queue:
            queue += [o for bond in rest if node in bond for o in bond if o not in reached]
            reached |= set(queue)
        count += ends[-1] in reached
    return count
