"""Matrices of fields that depend on parameters, and bonds to cut: what is refused, and with which words."""

from fractions import Fraction

import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.bondgraph.decomposition.graph_bisection import GraphBisection, bond_fault, loop_fault
from dynid.bondgraph.field_expansion import field_fault, symmetric_squares
from dynid.bondgraph.graph import Bond, BondGraph, Node
from dynid.errors import UsageError


def free(value):
    return Dependent.parameter("a", Fraction(value))


@pytest.mark.parametrize(
    ("matrix", "fault"),
    [
        ([[free(2), 1], [1, 1]], ""),
        ([[free(1), 1], [1, 1]], ""),
        ([[free(2), 1], [3, 1]], "entry (2, 1) is 3, (1, 2) is 1; a gyrator couples ports"),
        ([[free(-3), 0], [0, 1]], "its lowest eigenvalue is -3; with unknown parameters a field is passive"),
        ([[-3, 0], [0, 1]], ""),
    ],
)
def test_a_field_with_unknown_parameters_is_passive(matrix, fault):
    matrix = [[entry if isinstance(entry, Dependent) else Fraction(entry) for entry in row] for row in matrix]
    found = field_fault(matrix)
    assert fault in found
    assert bool(found) == bool(fault)


def test_a_coupling_that_vanishes_at_the_start_alone_is_refused():
    one = Fraction(1)
    with pytest.raises(UsageError, match="a coupling of 'field' is zero at the start values") as raised:
        symmetric_squares("field", {0: {0: one, 1: free(0)}, 1: {0: free(0), 1: one}})
    assert raised.value.names == ("field",)
    first, second = symmetric_squares("field", {0: {0: one, 1: free(2)}, 1: {0: free(2), 1: Fraction(9)}})
    columns = {first.pivot: first, second.pivot: second}
    total = sum(  # v' A v of v = (1, 1) is 1 + 2 a + 9, whatever the order of the squares
        float(one.value) * float(1 + sum(float(entry) for entry in one.entries.values())) ** 2
        for one in columns.values()
    )
    assert total == pytest.approx(14)


TYPES = {"F": "Se", "x": "1", "m": "I", "k": "C"}
BONDS = [Bond("F", "x"), Bond("x", "m"), Bond("x", "k")]


@pytest.mark.parametrize(
    ("port", "fault"),
    [
        (("F", "x"), ""),
        (("x", "F"), ""),
        (("F", "mm"), "no node 'mm'; did you mean 'm'?"),
        (("y", "q"), "no node 'y'; no node 'q'"),
        (("F", "m"), "there is no bond between 'F' and 'm'"),
    ],
)
def test_a_bond_to_cut_is_one_of_the_graph(port, fault):
    found = bond_fault(TYPES, BONDS, Bond(*port))
    assert found.startswith(fault)
    assert bool(found) == bool(fault)
    nodes = [Node(name, kind, Fraction(1) if kind in "IC" else None) for name, kind in TYPES.items()]
    if fault:
        with pytest.raises(UsageError) as raised:
            GraphBisection.at(BondGraph(nodes, BONDS), Bond(*port))
        assert raised.value.problem == found
    else:
        assert GraphBisection.at(BondGraph(nodes, BONDS), Bond(*port)).drawn == BONDS[0]


def test_a_graph_with_other_faults_has_no_fault_of_its_bond():
    assert loop_fault(TYPES, [*BONDS, Bond("m", "k")], Bond("x", "m")) == ""
    around = {"F": "Se", "x": "1", "a": "0", "b": "0", "y": "1", "r": "R", "p": "R", "q": "R"}
    ring = [Bond("F", "x"), Bond("x", "a"), Bond("x", "b"), Bond("a", "y"), Bond("b", "y"), Bond("y", "r")]
    ring += [Bond("a", "p"), Bond("b", "q")]
    assert "loop" in loop_fault(around, ring, Bond("x", "a"))
    assert loop_fault(around, ring, Bond("y", "r")) == ""
