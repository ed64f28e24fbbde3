"""Certified discs about the roots of a square-free integer polynomial.

Starts are the caller's, or circles from the Newton polygon of the coefficients that are brought near the
roots as eigenvalues of the polynomial's diagonal-plus-rank-one companion at the last approximations. The
Ehrlich-Aberth iteration finishes: Newton corrections in ball arithmetic (Arb, through python-flint) of a
precision that doubles where it has to, repulsion between the roots in floating point. What certifies the
result does not depend on how it was found: the disc of radius n |p/p'| about a point holds a root of p, and
so n disjoint ones hold one each. Where the iteration fails, Arb's own isolation takes its place.

References
----------
D. A. Bini, "Numerical computation of polynomial zeros by means of Aberth's method", Numerical Algorithms 13
(1996) 179-200. S. Fortune, "An iterated eigenvalue algorithm for approximating roots of univariate
polynomials", Journal of Symbolic Computation 33 (2002) 627-646.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from flint import acb, acb_poly, arb, ctx
from numpy.typing import NDArray

#: First working precision in bits, the last before giving up, and bits that a returned part is right to.
_PRECISION, _MAX_PRECISION, _ACCURACY = 128, 1 << 16, 64
#: Most sweeps of the iteration; the relative correction that ends it; what counts as near.
_SWEEPS, _STILL, _NEAR = 200, 2.0**-44, 1e-8
#: Bits that a correction is right to while iterating.
_DIGITS = 10
#: Most rounds of eigenvalues, the relative correction that ends them, the widest range of sizes they bear.
_ROUNDS, _NEARBY, _SPREAD = 40, 1e-6, 1e9
#: Largest |log2| of a root's size that the floating-point half of the iteration is trusted with.
_RANGE = 900

Complex = NDArray[np.complex128]


def enclosures(polynomial: Any, starts: Sequence[complex] | None = None, *, sides: bool = True) -> list[Any]:
    """Return one ball (flint `acb`) for every root of a square-free polynomial; real roots are exactly real.

    Parameters
    ----------
    polynomial
        Flint `fmpz_poly` without multiple roots and with a constant term.
    starts
        Approximate roots, some of them perhaps of other polynomials; absent: found here.
    sides
        Whether the real part too is wanted to 64 bits of itself; then no root may lie on the imaginary axis.

    Raises
    ------
    ArithmeticError
        Where 65,536 bits do not tell a root from the axis.
    """
    family = _Family(polynomial)
    if centres := _starting(family, starts):
        precisions = [_PRECISION] * len(centres)
        if not starts:
            _approach(family, centres, precisions)
        _iterate(family, centres, precisions)
        if discs := _isolated(family, centres, precisions):
            return _with_conjugates([_polished(family, *disc, sides=sides) for disc in discs])
    return _isolated_by_arb(polynomial, sides=sides)


class _Family:
    """A polynomial and its derivative in balls of any precision, each made once."""

    def __init__(self, polynomial: Any) -> None:
        self.exact = polynomial
        self.degree = int(polynomial.degree())
        self._balls: dict[int, tuple[Any, Any]] = {}

    def at(self, point: Any, precision: int, order: int = 0) -> Any:
        """Return p, or p' (order 1), at a point."""
        with ctx.workprec(precision):
            if precision not in self._balls:
                self._balls[precision] = acb_poly(self.exact), acb_poly(self.exact.derivative())
            return self._balls[precision][order](point)

    def value(self, point: Any, precision: int) -> tuple[Any, int]:
        """Return p to a few digits, where that can be had, and the precision it took."""
        while True:
            value = self.at(point, precision)
            if value.rel_accuracy_bits() >= _DIGITS or precision >= _MAX_PRECISION:
                return value, precision
            precision *= 2

    def newton(self, point: Any, precision: int) -> tuple[np.complex128, int]:
        """Return p/p' to a few digits (0 where p vanishes for all one can tell) and the precision it took."""
        value, precision = self.value(point, precision)
        if value.contains(0):
            return np.complex128(0), precision
        slope = self.at(point, precision, 1)
        bottom = slope.abs_upper() if slope.contains(0) else slope
        return np.complex128(complex((value / bottom).mid())), precision


# --- starts --------------------------------------------------------------------------------------


def _starting(family: _Family, starts: Sequence[complex] | None) -> list[Any]:
    """Return as many different starts as there are roots, or none where the roots leave the range."""
    radii = _newton_radii(family.exact)
    if max(abs(r) for r in radii) > _RANGE:
        return []
    turns = np.exp(1j * (0.7 + 2.4 * np.arange(len(radii))))  # the golden angle: no two roots align
    found = [complex(start) for start in starts or () if 0 < abs(start) < 2.0**_RANGE]
    if len(found) > len(radii):
        found = _nearest(family, found)
    found += [2.0**r * turn for r, turn in zip(radii[len(found) :], turns[len(found) :], strict=True)]
    seen: set[complex] = set()
    for k, start in enumerate(found):
        while found[k] in seen:
            found[k] += abs(start) * 1e-6 * turns[k]
        seen.add(found[k])
    return [acb(start) for start in found]


def _newton_radii(polynomial: Any) -> list[float]:
    """Return log2 of the roots' sizes as the Newton polygon of the coefficients has them."""
    heights = [(k, float(abs(int(c)).bit_length())) for k, c in enumerate(polynomial.coeffs()) if c]
    hull: list[tuple[int, float]] = []
    for k, h in heights:
        while len(hull) > 1 and _bends_up(hull[-2], hull[-1], (k, h)):
            hull.pop()
        hull.append((k, h))
    return [(h - g) / (k - j) for (j, h), (k, g) in pairwise(hull) for _ in range(k - j)]


def _bends_up(a: tuple[int, float], b: tuple[int, float], c: tuple[int, float]) -> bool:
    return (b[1] - a[1]) * (c[0] - a[0]) <= (c[1] - a[1]) * (b[0] - a[0])


def _nearest(family: _Family, starts: list[complex]) -> list[complex]:
    """Return the starts that are nearest to the roots of this polynomial."""
    size = [abs(family.newton(acb(start), _PRECISION)[0]) / abs(start) for start in starts]
    best = sorted(range(len(starts)), key=size.__getitem__)[: family.degree]
    return [starts[k] for k in sorted(best)]


# --- iteration -----------------------------------------------------------------------------------


def _approach(family: _Family, centres: list[Any], precisions: list[int]) -> None:
    """Replace the centres by eigenvalues of the companion matrix that they make, until they stay.

    diag(z) - 1 w^T with the Weierstrass corrections w_k = p(z_k) / (a prod (z_k - z_j)) has p for its
    characteristic polynomial whatever the z. In floating point the large roots drown very small ones.
    """
    lead = acb(family.exact.leading_coefficient())
    for _ in range(_ROUNDS):
        z = np.array([complex(centre) for centre in centres])
        if np.max(np.abs(z)) > _SPREAD * np.min(np.abs(z)):
            return
        gaps = z[:, None] - z[None, :]
        np.fill_diagonal(gaps, 1)
        if not gaps.all():
            return
        w = np.empty_like(z)
        for k, (size, angle) in enumerate(
            zip(np.log(np.abs(gaps)).sum(1), np.angle(gaps).sum(1), strict=True)
        ):
            value, precisions[k] = family.value(centres[k], precisions[k])
            w[k] = complex((value / (lead * acb(size, angle).exp())).mid())
        if not np.isfinite(w).all() or np.max(np.abs(w / z)) < _NEARBY:
            return
        centres[:] = [acb(complex(root)) for root in np.linalg.eigvals(np.diag(z) - w)]


def _iterate(family: _Family, centres: list[Any], precisions: list[int]) -> None:
    """Move the centres (exact balls) to the roots, at the precisions that it takes."""
    active = list(range(len(centres)))
    for _ in range(_SWEEPS):
        repulsion = _repulsion(centres, active)
        still = []
        for k, push in zip(active, repulsion, strict=True):
            newton, precisions[k] = family.newton(centres[k], precisions[k])
            step = complex(newton / (1 - newton * push))
            if not np.isfinite(step):
                continue
            with ctx.workprec(precisions[k]):
                size = float(abs(centres[k]).mid())
                moved = (centres[k] - acb(step)).mid()
            rough = abs(step) > _STILL * size
            centres[k] = acb(complex(moved)) if rough else moved  # short numbers are quick to work with
            if rough:
                still.append(k)
        active = still
        if not active:
            return


def _repulsion(centres: list[Any], which: list[int]) -> Complex:
    """Return sum 1/(z_k - z_j) over j != k; differences of near points are taken exactly."""
    z = np.array([complex(c) for c in centres])
    gap = z[which, None] - z[None, :]
    near = np.abs(gap) <= _NEAR * np.abs(z[which, None])
    with np.errstate(all="ignore"):
        push = np.where(near, 0, 1 / np.where(near, 1, gap)).sum(axis=1)
    for row, j in np.argwhere(near):
        if which[row] != j:
            difference = centres[which[row]] - centres[j]
            push[row] += complex(1 / difference) if not difference.contains(0) else 0
    return np.asarray(push)


# --- certificate ---------------------------------------------------------------------------------


def _disc(family: _Family, centre: Any, precision: int) -> tuple[Any, Any]:
    """Return centre and radius of a disc that holds a root; a disc that meets the real axis sits on it."""
    radius = _reach(family, centre, precision)
    if centre.imag == 0 or not radius >= abs(centre.imag):
        return centre, radius
    on_axis = acb(centre.real.mid())
    return on_axis, _reach(family, on_axis, precision)


def _reach(family: _Family, centre: Any, precision: int) -> Any:
    """Return n |p/p'|: so near to a point lies a root."""
    with ctx.workprec(precision):
        ratio = family.at(centre, precision) / family.at(centre, precision, 1)
        return (family.degree * ratio).abs_upper()


def _isolated(family: _Family, centres: list[Any], precisions: list[int]) -> list[tuple[Any, Any, int]]:
    """Return disjoint discs of one root each, of conjugate pairs the upper; none if they overlap."""
    discs = [_disc(family, centre, bits) for centre, bits in zip(centres, precisions, strict=True)]
    if not all(radius.is_finite() for _, radius in discs):
        return []
    z = np.array([complex(centre) for centre, _ in discs])
    reach = np.array([float(radius) for _, radius in discs]) * (1 + 1e-12) + 1e-15 * np.abs(z)
    close = np.abs(z[:, None] - z[None, :]) <= (reach[:, None] + reach[None, :]) * (1 + 1e-12)
    for j, k in np.argwhere(np.triu(close, 1)):
        (a, r), (b, t) = discs[j], discs[k]
        if not abs(a - b) > r + t:
            return []
    return [(*disc, bits) for disc, bits in zip(discs, precisions, strict=True) if disc[0].imag >= 0]


def _polished(family: _Family, centre: Any, radius: Any, precision: int, *, sides: bool) -> Any:
    """Shrink an isolating disc until its parts are accurate."""
    while not _accurate(centre, radius, sides=sides):
        if precision > _MAX_PRECISION:
            raise ArithmeticError("a root could not be separated from the imaginary axis")
        with ctx.workprec(precision):
            step = family.at(centre, precision) / family.at(centre, precision, 1)
            smaller, reach = _disc(family, (centre - step).mid(), precision)
            inside = bool(abs(smaller - centre) + reach < radius)
            quick = inside and bool(reach * 1024 < radius)
        if inside:
            centre, radius = smaller, reach
        if not quick:
            precision *= 2
    with ctx.workprec(precision):
        real = arb(centre.real.mid(), radius)
        return acb(real, arb(centre.imag.mid(), radius)) if centre.imag != 0 else acb(real)


def _accurate(centre: Any, radius: Any, *, sides: bool) -> bool:
    """Tell whether every part that is not exactly zero is right to the accuracy wanted of itself."""
    if centre.imag == 0:
        smallest = abs(centre.real)
    elif sides:
        smallest = abs(centre.real).min(abs(centre.imag))
    else:
        smallest = abs(centre.imag)
    return bool(radius * 2**_ACCURACY <= smallest)


def _with_conjugates(balls: list[Any]) -> list[Any]:
    """Add the mirror images of the balls off the real axis, exactly."""
    with ctx.workprec(2 * _MAX_PRECISION):  # flint rounds even a change of sign
        return [twin for ball in balls for twin in ([ball] if ball.imag == 0 else [ball, ball.conjugate()])]


def _isolated_by_arb(polynomial: Any, *, sides: bool) -> list[Any]:
    """Return balls by Arb's isolation, certified by itself and slower."""
    precision = _PRECISION
    while precision <= _MAX_PRECISION:
        with ctx.workprec(precision):
            balls = [ball for ball, _ in polynomial.complex_roots()]
            if not sides or all(ball.real > 0 or ball.real < 0 for ball in balls):
                return balls
        precision *= 2
    raise ArithmeticError("a root could not be separated from the imaginary axis")
