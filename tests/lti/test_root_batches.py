"""Roots of many polynomials at once are those that ball arithmetic finds for each, to the last bit."""

import numpy as np
import pytest
from flint import fmpz_poly
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dynid.lti.certified_roots import certified_roots
from dynid.lti.root_batches import root_batch

INTEGERS = st.integers(-(10**25), 10**25).filter(bool)


def in_order(values):
    return sorted(values, key=lambda z: (abs(z), z.real, z.imag))


def assert_same(columns, batch, *, even=False):
    """Check every polynomial that is certain against exact isolation."""
    for number in np.flatnonzero(batch.certain):
        coefficients = [int(column[number]) for column in columns]
        if even:
            coefficients = [part for value in coefficients for part in (value, 0)]
        true = certified_roots(fmpz_poly(coefficients))
        assert all(root.multiplicity == 1 for root in true)
        found = in_order(batch.values[number].tolist())
        assert np.array(found).tobytes() == np.array([root.value for root in true]).tobytes()
        sides = {complex(v): s for v, s in zip(batch.values[number], batch.sides[number], strict=True)}
        assert [sides[root.value] for root in true] == [root.side for root in true]


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(st.integers(1, 6), st.data())
def test_roots_are_correctly_rounded(degree, data):
    columns = [data.draw(st.lists(INTEGERS, min_size=3, max_size=3)) for _ in range(degree + 1)]
    assert_same(columns, root_batch(columns))


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(st.integers(1, 3), st.data())
@example(1, None)
def test_even_polynomials_have_their_roots_exactly_on_the_axis_or_real(degree, data):
    if data is None:
        columns = [[50, -3], [1, 7]]
    else:
        columns = [data.draw(st.lists(INTEGERS, min_size=3, max_size=3)) for _ in range(degree + 1)]
    assert_same(columns, root_batch(columns, even=True), even=True)


def test_ordinary_polynomials_are_certain():
    rng = np.random.default_rng(1)
    columns = [[int(c) for c in rng.integers(1, 10**12, 200)] for _ in range(5)]
    batch = root_batch(columns)
    assert batch.certain.all()
    assert_same(columns, batch)
    axis = root_batch([columns[0], columns[1]], even=True)
    assert axis.certain.all()
    assert not axis.values.real.any()


@pytest.mark.parametrize(
    "coefficients",
    [
        [1, 2, 1],  # double
        [10**40 + 10**4, 2 * 10**20, 1],  # nearly so
        [2, 1, 2, 1],  # (s + 1)(s^2 + 2) / … : a pair on the axis by chance
        [1, 10**300, 1, 10**300, 1],  # too wide for doubles
        [10**400, 1, 10**400],
    ],
)
def test_what_discs_do_not_prove_is_not_certain(coefficients):
    assert not root_batch([[c] for c in coefficients]).certain.any()


def test_wide_roots_far_apart_are_certain():
    # (s + 1)(s + 10^8): small and large root to the last bit
    columns = [[10**8], [10**8 + 1], [1]]
    batch = root_batch(columns)
    assert batch.certain.all()
    assert in_order(batch.values[0].tolist()) == [-1, -1e8]


def test_a_polynomial_has_the_same_roots_in_any_company():
    rng = np.random.default_rng(2)
    columns = [[int(c) for c in rng.integers(-(10**12), 10**12, 3000)] for _ in range(4)]
    together = root_batch(columns)
    for place in (0, 1, 1499, 2999):
        alone = root_batch([[column[place]] for column in columns])
        assert alone.values[0].tobytes() == together.values[place].tobytes()
        assert alone.certain[0] == together.certain[place]
    backwards = root_batch([column[::-1] for column in columns])
    assert backwards.values[::-1].tobytes() == together.values.tobytes()


def test_radii_bound_the_distance_from_the_true_roots():
    rng = np.random.default_rng(3)
    columns = [[int(c) for c in rng.integers(1, 10**6, 20)] for _ in range(4)]
    batch = root_batch(columns)
    for number in range(20):
        true = certified_roots(fmpz_poly([column[number] for column in columns]))
        for value, radius in zip(batch.values[number], batch.radii[number], strict=True):
            (root,) = (root for root in true if root.value == value)
            assert radius >= 0.99 * root.radius  # the distance itself, both times
