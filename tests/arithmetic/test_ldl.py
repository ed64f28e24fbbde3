"""Semidefinite matrices as sums of squares: these give the matrix back, at any values of its parameters."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.arithmetic.dependent import Dependent, evaluated
from dynid.arithmetic.ldl import Indefinite, at_reference, dependent_squares, nonzero, squares


def product(columns, size, values=None):
    total = np.zeros((size, size))
    for pivot, value, entries in columns:
        column = np.zeros(size)
        column[pivot] = 1
        for row, entry in entries.items():
            column[row] = evaluated(entry, values or {}).value
        total += evaluated(value, values or {}).value * np.outer(column, column)
    return total


@given(st.lists(st.lists(st.integers(-3, 3), min_size=4, max_size=4), min_size=1, max_size=4))
def test_squares_are_as_many_as_the_rank_and_give_the_matrix_back(rows):
    A = np.array(rows).T @ np.array(rows)
    found = squares(nonzero([[Fraction(int(x)) for x in row] for row in A]))
    assert len(found) == np.linalg.matrix_rank(A)
    np.testing.assert_allclose(product(found, 4), A, atol=1e-12)


def test_a_negative_eigenvalue_is_found_behind_a_zero_on_the_diagonal():
    for matrix in ([[1, 2], [2, 1]], [[0, 1], [1, 5]], [[-1, 0], [0, 1]]):
        with pytest.raises(Indefinite):
            squares(nonzero([[Fraction(x) for x in row] for row in matrix]))


def test_rounding_of_a_rigid_motion_is_no_spring_but_a_soft_spring_is():
    stiff, soft = 1e9 / 3, 1e-4
    chain = np.zeros((6, 6))
    for k in range(5):
        chain[k : k + 2, k : k + 2] += (1 + k / 7) * stiff * np.array([[1, -1], [-1, 1]])
    for ground, rank in ((0.0, 5), (soft, 6)):
        chain[0, 0] += ground
        rows = nonzero([[Fraction(x) for x in row] for row in chain.tolist()])
        assert len(squares(rows, 16 * np.finfo(float).eps)) == rank


def test_a_matrix_that_depends_on_parameters_is_right_at_all_values():
    k, m = Dependent.parameter("k", Fraction(2)), Dependent.parameter("m", Fraction(3))
    rows = nonzero(
        [[k + m, -k, Fraction(0)], [-k, k + 1, Fraction(-1)], [Fraction(0), Fraction(-1), 1 + 0 * m]]
    )
    found = dependent_squares(rows, squares(at_reference(rows)))
    at = {"k": 5.0, "m": 0.25}
    np.testing.assert_allclose(product(found, 3, at), [[5.25, -5, 0], [-5, 6, -1], [0, -1, 1]], atol=1e-14)


def test_a_coupling_that_vanishes_at_the_start_only_is_refused():
    a = Dependent.parameter("a", Fraction(0))
    rows = nonzero([[Fraction(2), a], [a, Fraction(1)]])
    with pytest.raises(ZeroDivisionError):
        dependent_squares(rows, squares(at_reference(rows)))
