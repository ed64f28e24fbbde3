"""Certified roots of many real polynomials of one degree at once, in double-double arithmetic.

Eigenvalues of the companion matrices start Newton's iteration in double-double arithmetic. The disc of
radius n |p/p'| about a point holds a root of p, so n disjoint ones hold one each (`dynid.lti.enclosures`):
where the discs are so small that every number in one is rounded to the same double, the roots are correctly
rounded. Where they are not, the polynomial is marked, and ball arithmetic decides
(`dynid.lti.certified_roots`). Hence the result does not depend on the other polynomials of the batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.lti.doubled import Doubled, DoubledComplex

#: Newton steps after the eigenvalues, and further ones for rows whose discs are still too large.
_NEWTON_STEPS, _FURTHER_STEPS = 2, 3
# Error bounds of one step of Horner's rule, relative to the sum of the moduli: in double-double arithmetic 64
# units of 2^-106 cover four products and three sums of parts; in double precision 16 units of 2^-53.
_DOUBLED_RTOL, _DOUBLE_RTOL = 2.0**-100, 2.0**-49
#: Bits that a coefficient is truncated to, and the relative truncation error.
_DOUBLED_BITS, _DROPPED_RTOL = 106, 2.0**-105
#: Widest range of the scaled coefficients, as an exponent of 2.
_COEFFICIENT_RANGE_BITS = 400
#: Factor by which bounds are enlarged for their own rounding.
_BOUND_SLACK = 1 + 1e-12
#: Numbers in a block, which stays in the cache.
_CACHE_NUMBERS = 8192


@dataclass(frozen=True, eq=False)
class RootBatch:
    """Roots of many polynomials."""

    values: NDArray[np.complex128]  # roots, each part correctly rounded (polynomial x root)
    radii: Array  # bounds on the distance from the true root (polynomial x root)
    sides: NDArray[np.int8]  # -1 left of the imaginary axis, 0 on it, 1 right of it (polynomial x root)
    #: Mask of the polynomials for which all of this is proved; the rows of the others are invalid.
    certain: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Polynomials in z = s / 2^shift with coefficients about 1, ascending (polynomial x power)."""

    coefficients: Doubled
    shift: NDArray[np.int64]
    fits: NDArray[np.bool_]

    def __getitem__(self, rows: slice) -> _Scaled:
        return _Scaled(self.coefficients[rows], self.shift[rows], self.fits[rows])


def root_batch(columns: Sequence[Sequence[int]], *, even: bool = False) -> RootBatch:
    """Return the roots of polynomials with integer coefficients, by columns of ascending powers.

    First and last columns are not zero, and the degree is at least one. `even`: the polynomials are in s^2,
    and have two roots s for each of theirs.
    """
    scaled = _scaled(columns, 2 if even else 1)
    count, size = len(columns[0]), len(columns)
    block = max(1, _CACHE_NUMBERS // (size - 1))
    parts = [_roots(scaled[start : start + block], even=even) for start in range(0, count, block)]
    return RootBatch(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _scaled(columns: Sequence[Sequence[int]], divisor: int) -> _Scaled:
    """Round integers to double-double, in a unit 2^shift of s that makes first and last similar.

    The shift is a multiple of the divisor.
    """
    shape = (len(columns[0]), len(columns))
    high, low = np.zeros(shape), np.zeros(shape)
    exponents = np.zeros(shape, dtype=np.int64)
    for power, column in enumerate(columns):
        sizes = [value.bit_length() for value in column]
        cuts = [max(0, size - _DOUBLED_BITS) for size in sizes]
        kept = [value >> cut for value, cut in zip(column, cuts, strict=True)]
        heads = [float(value) for value in kept]
        high[:, power] = heads
        low[:, power] = [float(value - int(head)) for value, head in zip(kept, heads, strict=True)]
        exponents[:, power] = cuts
    bits = exponents + np.frexp(high)[1]
    shift = divisor * np.rint((bits[:, 0] - bits[:, -1]) / (divisor * (shape[1] - 1))).astype(np.int64)
    rise = np.arange(shape[1]) * shift[:, None]
    bits = np.where(high == 0, np.min(bits + rise, axis=1, keepdims=True), bits + rise)
    largest = bits.max(axis=1, keepdims=True)
    fits = np.ptp(bits, axis=1) < _COEFFICIENT_RANGE_BITS
    exponents = np.where(fits[:, None], exponents + rise - largest, 0)
    return _Scaled(Doubled(high, low).scaled(exponents), shift, fits)


def _roots(polynomials: _Scaled, *, even: bool) -> tuple[NDArray[Any], ...]:
    """Return values, radii, sides, and a mask of certified polynomials."""
    values, radii = _refined(polynomials.coefficients, polynomials.fits)
    with np.errstate(all="ignore"):
        certain = polynomials.fits & disjoint(values.rounded, radii)
        shift = polynomials.shift
        if even:
            values, radii, real = _square_roots(values, radii)
            certain, shift = certain & real, shift // 2
        else:
            certain &= (values.real.high != 0).all(axis=1)  # a disc does not prove a root on the axis
        certain &= _known(values, radii).all(axis=1) & (np.abs(shift) < _COEFFICIENT_RANGE_BITS)
        distance = (radii + 2 * np.hypot(values.real.low, values.imag.low)) * _BOUND_SLACK
        rounded, exponent = values.rounded, shift[:, None]
        roots = np.empty_like(rounded)
        roots.real, roots.imag = np.ldexp(rounded.real, exponent), np.ldexp(rounded.imag, exponent)
        return roots, np.ldexp(distance, exponent), np.sign(rounded.real).astype(np.int8), certain


def _square_roots(squares: DoubledComplex, radii: Array) -> tuple[DoubledComplex, Array, NDArray[np.bool_]]:
    """Return s and -s for the roots s^2, their radii, and a mask of rows whose squares are all real."""
    size = np.abs(squares.real.high)
    sign = np.sign(squares.real.high)
    root = Doubled(sign * squares.real.high, sign * squares.real.low).sqrt()
    reach = radii / np.sqrt(size - radii) + 2.0**-99 * root.high
    both = Doubled(*(np.concatenate([-values, values], axis=1) for values in (root.high, root.low)))
    left = np.tile(sign > 0, 2)
    parts = [
        Doubled(*(np.where(here, values, 0.0) for values in (both.high, both.low))) for here in (left, ~left)
    ]
    real = (squares.imag.high == 0) & (size > radii)
    return DoubledComplex(*parts), np.tile(reach, 2), real.all(axis=1)


def _refined(coefficients: Doubled, usable: NDArray[np.bool_]) -> tuple[DoubledComplex, Array]:
    """Return approximate roots and the radii of discs that hold one each."""
    count, degree = len(coefficients.high), coefficients.high.shape[1] - 1
    companions = np.zeros((count, degree, degree))
    companions[:, range(1, degree), range(degree - 1)] = 1
    companions[usable, :, -1] = -coefficients.high[usable, :-1] / coefficients.high[usable, -1:]
    companions[~np.isfinite(companions).all(axis=(1, 2))] = 0
    points = DoubledComplex.of(np.linalg.eigvals(companions).astype(np.complex128))
    with np.errstate(all="ignore"):
        points, radii = _newton(coefficients, points, _NEWTON_STEPS)
        loose = np.flatnonzero(usable & ~_known(points, radii).all(axis=1))
        if len(loose):
            again, closer = _newton(coefficients[loose], points[loose], _FURTHER_STEPS)
            for component, better in ((points.real, again.real), (points.imag, again.imag)):
                component.high[loose], component.low[loose] = better.high, better.low
            radii[loose] = closer
    return points, radii


def _newton(coefficients: Doubled, points: DoubledComplex, steps: int) -> tuple[DoubledComplex, Array]:
    """Return the points after some steps, and n |p/p'| there, errors included."""
    for _ in range(steps):
        step = _value(coefficients, points).rounded / _slope(coefficients.high, points.rounded)
        points = points - DoubledComplex.of(np.where(np.isfinite(step), step, 0))
    degree = coefficients.high.shape[1] - 1
    where, sizes = points.rounded, np.abs(coefficients.high)
    reach = np.abs(where) * _BOUND_SLACK
    error = ((2 * degree + 2) * _DOUBLED_RTOL + _DROPPED_RTOL) * _along(sizes, reach)
    above = np.abs(_value(coefficients, points).rounded) * _BOUND_SLACK + error
    slope_error = (2 * degree + 2) * _DOUBLE_RTOL * _along(sizes[:, 1:] * np.arange(1, degree + 1), reach)
    below = np.abs(_slope(coefficients.high, where)) / _BOUND_SLACK - slope_error
    return points, np.where(below > 0, degree * above / np.where(below > 0, below, 1) * _BOUND_SLACK, np.inf)


def _value(coefficients: Doubled, points: DoubledComplex) -> DoubledComplex:
    """Evaluate the polynomials (Horner's rule)."""
    degree = coefficients.high.shape[1] - 1
    nothing = Doubled.of(np.zeros_like(points.real.high))
    total = DoubledComplex(coefficients[:, [degree]] + nothing, nothing)
    for power in range(degree - 1, -1, -1):
        product = total * points
        total = DoubledComplex(product.real + coefficients[:, [power]], product.imag)
    return total


def _slope(coefficients: Array, points: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Evaluate the derivatives in double precision."""
    degree = coefficients.shape[1] - 1
    return _along(coefficients[:, 1:] * np.arange(1, degree + 1), points)


def _along(coefficients: Array, points: NDArray[Any]) -> NDArray[Any]:
    """Evaluate polynomials, coefficients ascending."""
    total = np.zeros_like(points) + coefficients[:, [-1]]
    for power in range(coefficients.shape[1] - 2, -1, -1):
        total = total * points + coefficients[:, [power]]
    return total


def _known(values: DoubledComplex, radii: Array) -> NDArray[np.bool_]:
    """Return a mask of roots for which all numbers in the disc round to the same double.

    A part that is 0 is exact: a disc about a real number that holds one root of a real polynomial holds
    its conjugate as well.
    """
    certain: NDArray[np.bool_] = np.isfinite(radii)
    for component in (values.real, values.imag):
        certain = certain & ((component.high == 0) | component.rounds_the_same(radii))
    return certain


def disjoint(values: NDArray[np.complex128], radii: Array) -> NDArray[np.bool_]:
    """Return a mask of rows in which no two discs meet."""
    size = values.shape[1]
    reach = radii * _BOUND_SLACK + 2.0**-52 * np.abs(values)
    apart = (
        np.abs(values[:, :, None] - values[:, None, :])
        > (reach[:, :, None] + reach[:, None, :]) * _BOUND_SLACK
    )
    apart[:, range(size), range(size)] = True
    return np.asarray(np.all(apart, axis=(1, 2)))
