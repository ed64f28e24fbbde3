"""Certified discs about the roots of a square-free integer polynomial.

Initial values are the caller's, or circles from the Newton polygon of the coefficients, improved as
eigenvalues of the polynomial's diagonal-plus-rank-one companion matrix at the last approximations. The
Ehrlich-Aberth iteration finishes: Newton corrections in ball arithmetic (Arb, through python-flint) at a
precision that doubles where necessary, repulsion between the roots in floating point. The certificate does
not depend on how the roots were found: the disc of radius n |p/p'| about a point holds a root of p, so n
disjoint ones hold one each. Where the iteration fails, Arb's own isolation takes its place.

References
----------
D. A. Bini, "Numerical computation of polynomial zeros by means of Aberth's method", Numerical Algorithms 13
(1996) 179-200. S. Fortune, "An iterated eigenvalue algorithm for approximating roots of univariate
polynomials", Journal of Symbolic Computation 33 (2002) 627-646.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import acb, arb, arb_poly, ctx, fmpz_poly

if TYPE_CHECKING:
    from dynid.lti.axis_boxes import Work

#: First and largest working precision, and relative accuracy of a returned part, bits.
_FIRST_PRECISION, _MAX_PRECISION, _ACCURATE_BITS = 128, 1 << 16, 64
#: Most sweeps of the iteration; relative correction that ends it; relative distance of near points.
_MAX_SWEEPS, _CONVERGED_RTOL, _NEAR_RTOL = 200, 2.0**-44, 1e-8
#: Accuracy of a correction during the iteration, bits.
_MIN_CORRECTION_BITS = 10
#: Most rounds of eigenvalues, relative correction that ends them, largest ratio of moduli.
_MAX_ROUNDS, _ROUND_RTOL, _MAX_SPREAD = 40, 1e-6, 1e9
#: Largest |log2| of a root's modulus in the floating-point part of the iteration.
_ROOT_RANGE_BITS = 900
#: Bits to which a start close to a root agrees with it, steps from there, and the largest precision for them.
_CLOSE_BITS, _CLOSE_STEPS, _CLOSE_PRECISION = 28, 4, 4096
#: Evaluations for every root that Arb's isolation costs, at the precision that roots of unlike sizes take.
_ISOLATION_EVALUATIONS = 600
#: Bits of a coefficient that an evaluation costs one unit of work for, about a microsecond; the unit.
_WORK_UNIT_BITS = 1024
EVALUATIONS = f"multiplications of {_WORK_UNIT_BITS} bits; their number grows with degree times digits"


def enclosures(
    polynomial: Any, starts: Sequence[complex] | None = None, *, sides: bool = True, work: Work | None = None
) -> list[Any]:
    """Return one ball (flint `acb`) for every root of a square-free polynomial; real roots are exactly real.

    The polynomial has a constant term. `starts` are approximate roots, perhaps of others. With `sides` the
    real part is found to a relative 64 bits, too; then no root may lie on the imaginary axis, and
    `ArithmeticError` says that 65,536 bits do not separate one from it. `work` limits the cost, in
    `EVALUATIONS`.
    """
    radii = _newton_radii(polynomial)
    exponent = round((max(radii) + min(radii)) / 2)
    if max(map(abs, radii)) > _ROOT_RANGE_BITS and abs(exponent) > 1:  # centred, doubles may hold them
        shift = max(0, -exponent * int(polynomial.degree()))  # p(2^exponent s), times a power of two
        scaled = [c << (shift + exponent * k) for k, c in enumerate(map(int, polynomial.coeffs()))]
        balls = enclosures(fmpz_poly(scaled), sides=sides, work=work)
        with ctx.workprec(2 * _MAX_PRECISION):
            return [ball * arb(2) ** exponent for ball in balls]
    evaluated = _BallPolynomial(polynomial, work)
    if starts and (balls := _close_by(evaluated, starts, sides=sides)):
        return balls
    if centres := _initial_values(evaluated, radii, starts):
        precisions = [_FIRST_PRECISION] * len(centres)
        if not starts:
            _approach(evaluated, centres, precisions)
        _iterate(evaluated, centres, precisions)
        discs = [(*_disc(evaluated, *at), at[1]) for at in zip(centres, precisions, strict=True)]
        if _disjoint(discs):
            upper = [disc for disc in discs if disc[0].imag >= 0]
            return _with_conjugates([_polished(evaluated, *disc, sides=sides) for disc in upper])
    precision = _FIRST_PRECISION
    spread = round(evaluated.degree * (max(radii) - min(radii)))
    while precision <= _MAX_PRECISION:  # Arb's isolation: slower, and certified too
        evaluated.spend(max(precision, spread), _ISOLATION_EVALUATIONS * evaluated.degree)
        with ctx.workprec(precision):
            balls = [ball for ball, _ in polynomial.complex_roots()]
            if not sides or all(ball.real > 0 or ball.real < 0 for ball in balls):
                return balls
        precision *= 2
    raise ArithmeticError("a root could not be separated from the imaginary axis")


def _with_conjugates(balls: list[Any]) -> list[Any]:
    with ctx.workprec(2 * _MAX_PRECISION):  # flint rounds even a change of sign
        return [t for ball in balls for t in ([ball] if ball.imag == 0 else [ball, ball.conjugate()])]


def _close_by(polynomial: _BallPolynomial, starts: Sequence[complex], *, sides: bool) -> list[Any]:
    """Return the balls if there is a start close to every root; none else.

    The discs of radius n |w_k| about all z_k, w_k = p(z_k) / (a prod (z_k - z_j)), hold the roots, and each
    one that is disjoint of the others holds one (B. T. Smith, Journal of the ACM 17 (1970) 661-674). The
    products are taken at the starts, in floating point, with an allowance for what that changes.
    """
    upper = np.array(
        [start for start in starts if start.imag >= 0 and 0 < abs(start) < 2.0**_ROOT_RANGE_BITS]
    )
    z = np.concatenate([upper, upper[upper.imag > 0].conj()])
    if len(z) != polynomial.degree:
        return []
    gaps = upper[:, None] - z
    np.fill_diagonal(gaps, np.inf)
    loose = ((np.abs(upper)[:, None] + np.abs(z)) / np.abs(gaps)).sum(1) if gaps.all() else np.inf
    if not np.max(loose) * 2.0 ** (3 - _CLOSE_BITS) < 0.01:
        return []
    np.fill_diagonal(gaps, 1.0)
    lead, precision, discs = acb(polynomial.exact.leading_coefficient()), _FIRST_PRECISION, []
    turned = np.where(upper.imag == 0, np.pi * (gaps.real < 0).sum(1), np.angle(gaps).sum(1))
    for start, size, angle in zip(upper.tolist(), np.log(np.abs(gaps)).sum(1), turned, strict=True):
        real, centre, steps = start.imag == 0, acb(start), 0
        others = lead * acb(size, angle).exp()
        while True:
            value = polynomial.at(centre, precision)
            with ctx.workprec(precision):
                step = value / others
                radius = abs(step).upper() * (1.05 * polynomial.degree)
                if radius * 2**_ACCURATE_BITS <= _smallest_part(centre, sides=sides):
                    break
                if value.rel_accuracy_bits() < _MIN_CORRECTION_BITS:
                    precision *= 2
                    if precision > _CLOSE_PRECISION:
                        return []
                    continue
                steps += 1
                if steps > _CLOSE_STEPS or not abs(step) < 2.0**-_CLOSE_BITS * abs(start):
                    return []
                centre = (centre - step).mid()
                centre = acb(centre.real) if real else centre
        discs.append((centre, radius, precision))
    if not _disjoint(discs):
        return []
    return _with_conjugates([_ball(*disc) for disc in discs])


class _BallPolynomial:
    """A polynomial and its derivative in ball arithmetic, cached by precision."""

    def __init__(self, polynomial: Any, work: Work | None = None) -> None:
        self.exact = polynomial
        self.degree = int(polynomial.degree())
        self._work = work
        self._balls: dict[int, tuple[Any, Any]] = {}

    def at(self, point: Any, precision: int, order: int = 0) -> Any:
        """Return p, or p' (order 1), at a point."""
        self.spend(precision)
        with ctx.workprec(precision):
            if precision not in self._balls:
                self._balls[precision] = arb_poly(self.exact), arb_poly(self.exact.derivative())
            return acb(self._balls[precision][order](point if point.imag != 0 else point.real))

    def spend(self, precision: int, evaluations: int = 1) -> None:
        """Count evaluations."""
        if self._work is not None:
            self._work.spend(evaluations * self.degree * -(-precision // _WORK_UNIT_BITS))

    def value(self, point: Any, precision: int) -> tuple[Any, int]:
        """Return p to a few digits, where possible, and the precision needed."""
        while True:
            value = self.at(point, precision)
            if value.rel_accuracy_bits() >= _MIN_CORRECTION_BITS or precision >= _MAX_PRECISION:
                return value, precision
            precision *= 2

    def newton(self, point: Any, precision: int) -> tuple[np.complex128, int]:
        """Return p/p' to a few digits (0 where the ball of p contains 0) and the precision needed."""
        value, precision = self.value(point, precision)
        if value.contains(0):
            return np.complex128(0), precision
        slope = self.at(point, precision, 1)
        bottom = slope.abs_upper() if slope.contains(0) else slope
        return np.complex128(complex((value / bottom).mid())), precision


def _initial_values(
    polynomial: _BallPolynomial, radii: list[float], starts: Sequence[complex] | None
) -> list[Any]:
    """Return as many different values as there are roots; none where the roots exceed the range."""
    if max(map(abs, radii)) > _ROOT_RANGE_BITS:
        return []
    turns = np.exp(1j * (0.7 + 2.4 * np.arange(len(radii))))  # the golden angle: no two roots align
    values = [complex(start) for start in starts or () if 0 < abs(start) < 2.0**_ROOT_RANGE_BITS]
    if len(values) > len(radii):  # keep those nearest to roots of this polynomial
        size = [abs(polynomial.newton(acb(start), _FIRST_PRECISION)[0]) / abs(start) for start in values]
        best = sorted(range(len(values)), key=size.__getitem__)[: polynomial.degree]
        values = [values[k] for k in sorted(best)]
    values += [2.0**r * turn for r, turn in zip(radii[len(values) :], turns[len(values) :], strict=True)]
    seen: set[complex] = set()
    for k, start in enumerate(values):
        while values[k] in seen:
            values[k] += abs(start) * 1e-6 * turns[k]
        seen.add(values[k])
    return [acb(start) for start in values]


def _newton_radii(polynomial: Any) -> list[float]:
    """Return log2 of the roots' moduli, from the Newton polygon of the coefficients."""
    hull: list[tuple[int, float]] = []
    for k, c in enumerate(polynomial.coeffs()):
        if not c:
            continue
        h = float(abs(int(c)).bit_length())
        while len(hull) > 1:
            (i, f), (j, g) = hull[-2:]
            if (g - f) * (k - i) > (h - f) * (j - i):
                break
            hull.pop()
        hull.append((k, h))
    return [(h - g) / (k - j) for (j, h), (k, g) in pairwise(hull) for _ in range(k - j)]


def _approach(polynomial: _BallPolynomial, centres: list[Any], precisions: list[int]) -> None:
    """Replace the centres by eigenvalues of their companion matrix, until they converge.

    diag(z) - 1 w^T with the Weierstrass corrections w_k = p(z_k) / (a prod (z_k - z_j)) has p as its
    characteristic polynomial for any z. In floating point very small roots are lost beside large ones.
    """
    lead = acb(polynomial.exact.leading_coefficient())
    for _ in range(_MAX_ROUNDS):
        z = np.array([complex(centre) for centre in centres])
        if np.max(np.abs(z)) > _MAX_SPREAD * np.min(np.abs(z)):
            return
        gaps = z[:, None] - z[None, :]
        np.fill_diagonal(gaps, 1)
        if not gaps.all():
            return
        w = np.empty_like(z)
        for k, (size, angle) in enumerate(
            zip(np.log(np.abs(gaps)).sum(1), np.angle(gaps).sum(1), strict=True)
        ):
            value, precisions[k] = polynomial.value(centres[k], precisions[k])
            w[k] = complex((value / (lead * acb(size, angle).exp())).mid())
        if not np.isfinite(w).all() or np.max(np.abs(w / z)) < _ROUND_RTOL:
            return
        centres[:] = [acb(complex(root)) for root in np.linalg.eigvals(np.diag(z) - w)]


def _iterate(polynomial: _BallPolynomial, centres: list[Any], precisions: list[int]) -> None:
    """Move the centres (exact balls) to the roots by the Ehrlich-Aberth iteration."""
    active = list(range(len(centres)))
    for _ in range(_MAX_SWEEPS):
        # Repulsion: sum 1/(z_k - z_j) over j != k; differences of near points are taken exactly.
        z = np.array([complex(c) for c in centres])
        gap = z[active, None] - z[None, :]
        near = np.abs(gap) <= _NEAR_RTOL * np.abs(z[active, None])
        with np.errstate(all="ignore"):
            repulsion = np.where(near, 0, 1 / np.where(near, 1, gap)).sum(axis=1)
        for row, j in np.argwhere(near):
            if active[row] != j:
                difference = centres[active[row]] - centres[j]
                repulsion[row] += complex(1 / difference) if not difference.contains(0) else 0
        moving = []
        for k, push in zip(active, repulsion, strict=True):
            newton, precisions[k] = polynomial.newton(centres[k], precisions[k])
            with np.errstate(all="ignore"):
                step = complex(newton / (1 - newton * push))
            if not np.isfinite(step):
                continue
            with ctx.workprec(precisions[k]):
                size = float(abs(centres[k]).mid())
                moved = (centres[k] - acb(step)).mid()
            rough = abs(step) > _CONVERGED_RTOL * size
            centres[k] = acb(complex(moved)) if rough else moved  # short numbers are faster
            if rough:
                moving.append(k)
        active = moving
        if not active:
            return


def _disc(polynomial: _BallPolynomial, centre: Any, precision: int) -> tuple[Any, Any]:
    """Return centre and radius of a disc that holds a root; one that meets the real axis is centred on it."""
    radius = _reach(polynomial, centre, precision)
    if centre.imag == 0 or not radius >= abs(centre.imag):
        return centre, radius
    on_axis = acb(centre.real.mid())
    return on_axis, _reach(polynomial, on_axis, precision)


def _reach(polynomial: _BallPolynomial, centre: Any, precision: int) -> Any:
    """Return n |p/p'|, a bound on the distance to the nearest root."""
    with ctx.workprec(precision):
        ratio = polynomial.at(centre, precision) / polynomial.at(centre, precision, 1)
        return (polynomial.degree * ratio).abs_upper()


def _disjoint(discs: list[tuple[Any, Any, int]]) -> bool:
    """Test whether discs of finite radius do not meet."""
    if not all(radius.is_finite() for _, radius, _ in discs):
        return False
    z = np.array([complex(centre) for centre, _, _ in discs])
    reach = np.array([float(radius) for _, radius, _ in discs]) * (1 + 1e-12) + 1e-15 * np.abs(z)
    close = np.abs(z[:, None] - z[None, :]) <= (reach[:, None] + reach[None, :]) * (1 + 1e-12)
    for j, k in np.argwhere(np.triu(close, 1)):
        (a, r, _), (b, t, _) = discs[j], discs[k]
        if not abs(a - b) > r + t:
            return False
    return True


def _polished(polynomial: _BallPolynomial, centre: Any, radius: Any, precision: int, *, sides: bool) -> Any:
    """Shrink an isolating disc until every part that is not exactly zero is accurate."""
    while True:
        smallest = _smallest_part(centre, sides=sides)
        if radius * 2**_ACCURATE_BITS <= smallest and smallest > 0:
            return _ball(centre, radius, precision)
        if precision > _MAX_PRECISION:
            raise ArithmeticError("a root could not be separated from the imaginary axis")
        with ctx.workprec(precision):
            step = polynomial.at(centre, precision) / polynomial.at(centre, precision, 1)
            smaller, reach = _disc(polynomial, (centre - step).mid(), precision)
            inside = bool(abs(smaller - centre) + reach < radius)
            quick = inside and bool(reach * 1024 < radius)
        if inside:
            centre, radius = smaller, reach
        if not quick:
            precision *= 2


def _smallest_part(centre: Any, *, sides: bool) -> Any:
    """Return the smallest of the parts of a centre that are needed accurately."""
    if centre.imag == 0:
        return abs(centre.real)
    return abs(centre.real).min(abs(centre.imag)) if sides else abs(centre.imag)


def _ball(centre: Any, radius: Any, precision: int) -> Any:
    """Return a disc as a ball; one that is centred on the real axis is real."""
    with ctx.workprec(precision):
        real = arb(centre.real.mid(), radius)
        return acb(real, arb(centre.imag.mid(), radius)) if centre.imag != 0 else acb(real)
