"""Norms of inverses, beside those of dense inverses."""

import numpy as np
import pytest

from dynid.arrays import norm_of_inverse


@pytest.mark.parametrize("rows", [1, 4, 5, 40])
@pytest.mark.parametrize("symmetric", [True, False])
def test_the_norm_of_an_inverse_needs_no_random_numbers(rows, symmetric):
    rng = np.random.default_rng(rows)
    state = np.random.get_state()[1]
    for _ in range(20):
        matrix = rng.standard_normal((rows, rows)) + np.diag(10.0 ** rng.uniform(-3, 3, rows))
        matrix = matrix + matrix.T if symmetric else matrix
        inverse = np.linalg.inv(matrix)
        transposed = None if symmetric else inverse.T.__matmul__
        norm, exact = norm_of_inverse(rows, inverse.__matmul__, transposed), np.linalg.norm(inverse, 1)
        assert (1 if rows <= 4 else 0.2) * (1 - 1e-9) * exact <= norm <= (1 + 1e-9) * exact
    np.testing.assert_array_equal(np.random.get_state()[1], state)


def test_the_norm_of_an_inverse_beyond_double_precision_is_not_finite():
    with np.errstate(all="ignore"):
        assert not np.isfinite(norm_of_inverse(9, lambda right: right / np.zeros(9)))
