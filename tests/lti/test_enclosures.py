"""Balls around the roots of polynomials, against roots known by their factors."""

import pytest
from flint import acb, ctx, fmpz_poly

from dynid.lti.enclosures import enclosures

FAR = 2**1000


def distances(balls, roots):
    """Return how far the nearest ball is from each root, over the size of the root."""
    with ctx.workprec(2000):
        return [
            min(float(abs((ball - acb(*root)).mid()) / abs(acb(*root))) for ball in balls) for root in roots
        ]


@pytest.mark.parametrize(
    "starts",
    [
        None,
        [],
        [1.0, 1.0, 1.0, 1.0],
        [-1.1, -2.2, -1 + 3j, -1 - 3j],
        [5.0, -1.01, -2.02, -1.01 + 3j, -0.99 - 3j, 100j],
        [0.0, 1e300],
    ],
)
def test_starts_change_no_root(starts):
    polynomial = fmpz_poly([1, 1]) * fmpz_poly([2, 1]) * fmpz_poly([10, 2, 1])
    balls = enclosures(polynomial, starts)
    assert len(balls) == 4
    roots = [(-1, 0), (-2, 0), (-1, 3), (-1, -3)]
    assert max(distances(balls, roots)) < 1e-18
    assert sum(ball.imag == 0 for ball in balls) == 2
    assert all(ball.real < 0 for ball in balls)


def test_roots_beyond_the_range_of_floats_are_separated_from_the_axis():
    """s^2 + 2^601 s + 2^2000: the real part is 2^-400 of the modulus."""
    polynomial = fmpz_poly([FAR**2, 2 * FAR // 2**400, 1]) * fmpz_poly([1, 1])
    balls = enclosures(polynomial)
    assert len(balls) == 3
    assert all(ball.real < 0 for ball in balls)
    with ctx.workprec(2000):
        pair = [ball for ball in balls if not ball.imag.contains(0)]
        assert all(abs(float(ball.real / -acb(FAR // 2**400).real) - 1) < 1e-12 for ball in pair)


@pytest.mark.parametrize(("square", "root"), [(2, 2**0.5), (FAR**2, FAR)])
def test_roots_on_the_axis_cannot_be_separated_from_it(square, root):
    polynomial = fmpz_poly([square, 0, 1])
    with pytest.raises(ArithmeticError, match="could not be separated from the imaginary axis"):
        enclosures(polynomial)
    assert max(distances(enclosures(polynomial, sides=False), [(0, root), (0, -root)])) < 1e-15
