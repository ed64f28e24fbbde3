"""Quasi-polynomials, sums of polynomials times exp(-s τ): the characteristic functions of loops with delays.

Values are enclosed by ball arithmetic; single roots are refined by Newton's method and proved to be isolated
(`refined_root`). The roots right of a line are counted in `lti/delay_stability.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from flint import Ordering, acb, acb_poly, arb, ctx, fmpq, fmpz_mpoly_ctx, fmpz_poly
from numpy.typing import NDArray

from dynid.arrays import ComplexArray

#: Most frequencies at which a phase is followed, some seconds, and halvings of their steps.
_MAX_PHASE_POINTS, _PHASE_HALVINGS = 20_000, 30
#: Working precision, bits.
PRECISION = 160
#: Relative size of a step that ends Newton's method.
_NEWTON_STEP_RTOL = 2.0**-120
#: Steps of Newton's method in doubles, and the last one relative to a root that it has reached.
_POLISHING_STEPS, _POLISHED_RTOL = 25, 1e-8
#: Bits of a value that is exact to double precision.
_DOUBLE_ACCURACY_BITS = 60


class Delay(NamedTuple):
    """The delay of a loop."""

    seconds: Fraction
    loop: int = 0


class QuasiPolynomial:
    """A sum of polynomials P_k(s) times exp(-s τ_k).

    Terms are integer polynomials (flint `fmpz_poly`) by delay, s, not negative; or by the set of loops
    (`Delay`) whose delays add up, which tells how the delays of terms depend on each other. For the algebra
    of this class they may be over a field (`FieldPolynomial`).
    """

    def __init__(self, terms: Mapping[Fraction, Any] | Mapping[frozenset[Delay], Any]) -> None:
        #: By set of loops.
        self.products: dict[frozenset[Delay], Any] = {}
        for key, polynomial in terms.items():
            loops = key if isinstance(key, frozenset) else frozenset([Delay(key)] if key else [])
            if polynomial != 0:
                self.products[loops] = polynomial
        sums: dict[Fraction, Any] = {}
        for loops, polynomial in self.products.items():
            delay = sum((loop.seconds for loop in loops), Fraction(0))
            sums[delay] = sums[delay] + polynomial if delay in sums else polynomial
        #: By delay, ascending.
        self.terms = {delay: sums[delay] for delay in sorted(sums) if sums[delay] != 0}

    def __add__(self, other: QuasiPolynomial) -> QuasiPolynomial:
        products = dict(self.products)
        for loops, polynomial in other.products.items():
            products[loops] = products[loops] + polynomial if loops in products else polynomial
        return QuasiPolynomial(products)

    def __sub__(self, other: QuasiPolynomial) -> QuasiPolynomial:
        return self + QuasiPolynomial({loops: -polynomial for loops, polynomial in other.products.items()})

    def over(self, factor: Any) -> QuasiPolynomial:
        """Return it divided by a polynomial that divides every term."""
        return QuasiPolynomial({loops: polynomial // factor for loops, polynomial in self.products.items()})

    def times(self, factor: Any) -> QuasiPolynomial:
        """Return it times a polynomial."""
        return QuasiPolynomial({loops: polynomial * factor for loops, polynomial in self.products.items()})

    @property
    def degree(self) -> int:
        """The largest degree of its polynomials; -1 of zero."""
        return max((int(polynomial.degree()) for polynomial in self.products.values()), default=-1)

    @property
    def is_rational(self) -> bool:
        """True if it is a polynomial: no term has a delay."""
        return not any(self.terms)

    def leading(self, degree: int) -> dict[frozenset[Delay], Fraction]:
        """Return the coefficients of s^degree by set of loops: the difference operator D of its degree."""
        return {loops: Fraction(int(polynomial[degree])) for loops, polynomial in self.products.items()}

    def taylor(self, order: int) -> Fraction:
        """Return its coefficient of s^order at the origin, exactly."""
        return sum(
            (
                int(polynomial[k]) * (-delay) ** (order - k) / math.factorial(order - k)
                for delay, polynomial in self.terms.items()
                for k in range(order + 1)
            ),
            Fraction(0),
        )

    def at_origin(self) -> int:
        """Return its value at s = 0, exactly."""
        return sum(int(polynomial[0]) for polynomial in self.terms.values())

    @cached_property
    def balls(self) -> Balls:
        """It, and its first two derivatives, in ball arithmetic."""
        return Balls.of(self)

    def __call__(self, s: complex) -> complex:
        """Return its value, rounded."""
        with ctx.workprec(PRECISION):
            value = self.balls.values(acb(s.real, s.imag))[0]
            return complex(float(value.real.mid()), float(value.imag.mid()))


def common_factor(parts: Iterable[QuasiPolynomial]) -> Any:
    """Return the greatest common divisor of all polynomials of some quasi-polynomials."""
    polynomials = [polynomial for terms in parts for polynomial in terms.products.values()]
    if not polynomials:
        return fmpz_poly([1])
    factor = 0 * polynomials[0]
    for polynomial in polynomials:
        factor = factor.gcd(polynomial)
    return factor


def coprime(first: QuasiPolynomial, second: QuasiPolynomial) -> tuple[QuasiPolynomial, QuasiPolynomial]:
    """Return two quasi-polynomials without their common factor, delays included.

    They are polynomials in s and in one variable exp(-s τ) for each loop.
    """
    loops = sorted(set().union(*first.products, *second.products))
    context = fmpz_mpoly_ctx.get(["s", *(f"q{number}" for number in range(len(loops)))], Ordering.lex)
    parts = [
        context.from_dict(
            {
                (power, *(int(loop in product) for loop in loops)): coefficient
                for product, polynomial in numerator.products.items()
                for power, coefficient in enumerate(polynomial.coeffs())
                if coefficient != 0
            }
        )
        for numerator in (first, second)
    ]
    shared = parts[0].gcd(parts[1])
    results = []
    for numerator in parts:
        powers: dict[frozenset[Delay], dict[int, Any]] = {}
        for (power, *exponents), coefficient in (numerator // shared).to_dict().items():
            product = frozenset(loop for loop, exponent in zip(loops, exponents, strict=True) if exponent)
            powers.setdefault(product, {})[power] = coefficient
        products = {
            product: fmpz_poly([by_power.get(k, 0) for k in range(max(by_power) + 1)])
            for product, by_power in powers.items()
        }
        results.append(QuasiPolynomial(products))
    return results[0], results[1]


@dataclass(frozen=True)
class _Term:
    """exp(-s τ) times a polynomial and its first two derivatives (flint `acb_poly`)."""

    delay: Any
    polynomials: tuple[Any, Any, Any]


@dataclass(frozen=True)
class Balls:
    """A quasi-polynomial in ball arithmetic; its prompt term is the first."""

    terms: tuple[_Term, ...]

    @classmethod
    def of(cls, function: QuasiPolynomial, line: float = 0.0, precision: int = PRECISION) -> Balls:
        """Return a quasi-polynomial as a function of s - line."""
        terms = []
        with ctx.workprec(precision):
            for delay, polynomial in function.terms.items():
                exact = arb(fmpq(delay.numerator, delay.denominator))
                moved = acb_poly(polynomial)
                if line:
                    moved = moved(acb_poly([line, 1])) * acb((-arb(line) * exact).exp())
                terms.append(_Term(exact, (moved, moved.derivative(), moved.derivative().derivative())))
        return cls(tuple(terms))

    @classmethod
    def constant(cls, balls: Balls, degree: int) -> Balls:
        """Return the terms with the coefficients of s^degree alone."""
        none = acb_poly([])
        terms = [
            _Term(term.delay, (acb_poly([term.polynomials[0][degree]]), none, none))
            for term in balls.terms
            if term.polynomials[0][degree] != 0
        ]
        return cls(tuple(terms))

    def values(self, s: Any, orders: int = 1) -> list[Any]:
        """Return enclosures of value and derivatives at a ball (flint `acb`)."""
        derivatives = [acb(0) for _ in range(orders)]
        for term in self.terms:
            delay, factor = term.delay, (-s * term.delay).exp()
            p = [polynomial(s) for polynomial in term.polynomials[:orders]]
            derivatives[0] += p[0] * factor
            if orders > 1:
                derivatives[1] += (p[1] - delay * p[0]) * factor
            if orders > 2:
                derivatives[2] += (p[2] - 2 * delay * p[1] + delay * delay * p[0]) * factor
        return derivatives


# --- single roots -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RefinedRoot:
    """A root that was refined; one root, a simple one, provably lies within the radius."""

    value: complex
    radius: float


def refined_root(function: QuasiPolynomial, start: complex) -> RefinedRoot | None:
    """Return the root to which Newton's method leads from a first value; None where it leads to none.

    That a simple root lies within the radius is proved by the interval Newton operator.
    """
    with ctx.workprec(PRECISION):
        balls, s = function.balls, acb(start.real, start.imag)
        for _ in range(60):
            value, slope = balls.values(s, 2)
            if slope.abs_lower() == 0:
                return None
            step = (value / slope).mid()
            s = (s - step).mid()
            if step.abs_upper() <= _NEWTON_STEP_RTOL * s.abs_upper():
                break
            if not s.abs_upper() < 1e6 * (1 + abs(start)):
                return None
        root = complex(float(s.real), float(s.imag))
        about = acb(root.real, root.imag)
        radius = 2.0**-50 * abs(root)
        for _ in range(20):
            disc = about + acb(arb(0, radius), arb(0, radius))
            slope = balls.values(disc, 2)[1]
            if slope.abs_lower() > 0:
                move = balls.values(about)[0] / slope
                if move.real.abs_upper() < radius and move.imag.abs_upper() < radius:
                    return RefinedRoot(root, math.nextafter(math.sqrt(2) * radius, math.inf))
            radius *= 4
    return None


class Polished:
    """Roots of ``k N + D`` by Newton's method in doubles, of many first values at once."""

    def __init__(self, functions: Sequence[QuasiPolynomial]) -> None:
        scale = max(abs(int(c)) for f in functions for p in f.terms.values() for c in p.coeffs())
        self._terms = [
            (number, float(delay), coefficients, np.polyder(coefficients))
            for number, function in enumerate(functions)
            for delay, polynomial in function.terms.items()
            for coefficients in [np.array([int(c) / scale for c in reversed(polynomial.coeffs())])]
        ]

    def reached(self, starts: ComplexArray, factors: Sequence[float]) -> ComplexArray:
        """Return the roots to which first values lead, in their order; inf where to none, or one before."""
        s, step = np.array(starts, complex), np.full(len(starts), np.inf, complex)
        with np.errstate(all="ignore"):
            for _ in range(_POLISHING_STEPS):
                value, slope = np.zeros(len(s), complex), np.zeros(len(s), complex)
                for number, delay, coefficients, rates in self._terms:
                    factor, at = factors[number] * np.exp(-delay * s), np.polyval(coefficients, s)
                    value += factor * at
                    slope += factor * (np.polyval(rates, s) - delay * at)
                step = np.where(value == 0, 0, value / slope)
                s = s - step
                if not np.any(np.abs(step) > _POLISHED_RTOL**2 * np.abs(s)):
                    break
            real = np.abs(s.imag) <= _POLISHED_RTOL * np.abs(s)
            s = np.where(real, s.real, s)
            near = np.abs(s[:, None] - s) <= _POLISHED_RTOL * np.abs(s)
            good = (np.abs(step) <= _POLISHED_RTOL * np.abs(s)) & ~np.tril(near, -1).any(axis=1)
        return np.where(good, s, np.inf)


# --- values ----------------------------------------------------------------------------------------


def continuous_phase(
    evaluate: Callable[[NDArray[np.float64]], NDArray[np.complex128]],
    omega: NDArray[np.float64],
    delays: float,
) -> NDArray[np.float64] | None:
    """Return the phases, rad, of responses (omega x …), followed along the frequencies, rad/s.

    Between them frequencies are added until none turns by more than a quarter turn a step; steps are an
    eighth of a turn of all `delays`, s, together, to begin with, from where they have hardly turned anything.
    None where that takes too many frequencies.
    """
    ends = np.concatenate([np.minimum(omega[:1], math.pi / 8 / delays), omega])
    ends = ends[np.flatnonzero(np.diff(ends, prepend=-1.0) > 0)]
    parts = np.maximum(1.0, np.ceil(np.diff(ends) * delays / (math.pi / 4)))
    if parts.sum() > _MAX_PHASE_POINTS:
        return None
    pieces = zip(ends, ends[1:], parts.astype(int).tolist(), strict=False)
    grid = np.concatenate([*(np.linspace(*piece, endpoint=False) for piece in pieces), ends[-1:]])
    values = evaluate(grid)
    for _ in range(_PHASE_HALVINGS):
        with np.errstate(all="ignore"):
            turns = np.abs(np.angle(values[1:] / values[:-1]))
        wide = np.flatnonzero((turns > math.pi / 2).any(axis=tuple(range(1, values.ndim))))
        if not len(wide) or len(grid) + len(wide) > 2 * _MAX_PHASE_POINTS:
            break
        middles = (grid[wide] + grid[wide + 1]) / 2
        grid = np.insert(grid, wide + 1, middles)
        values = np.insert(values, wide + 1, evaluate(middles), axis=0)
    flat = values.reshape(len(grid), -1)
    phases = np.full(flat.shape, np.nan)
    for column in range(flat.shape[1]):
        defined = np.isfinite(flat[:, column]) & (flat[:, column] != 0)
        phases[defined, column] = np.unwrap(np.angle(flat[defined, column]))
    return phases.reshape(values.shape)[np.searchsorted(grid, omega)]


def on_axis(top: QuasiPolynomial, bottom: QuasiPolynomial, omega: Iterable[float]) -> list[complex]:
    """Return a quotient at s = jω to full double precision; inf at a pole."""
    roots = []
    for at in omega:
        for precision in (PRECISION, 8 * PRECISION, 64 * PRECISION):
            with ctx.workprec(precision):
                s = acb(0, at)
                above, below = (
                    (
                        function.balls if precision == PRECISION else Balls.of(function, precision=precision)
                    ).values(s)[0]
                    for function in (top, bottom)
                )
                value = above / below
                if value.rel_accuracy_bits() > _DOUBLE_ACCURACY_BITS or above.is_zero():
                    roots.append(complex(float(value.real.mid()), float(value.imag.mid())))
                    break
        else:
            roots.append(complex(0.0 if above.abs_upper() < below.abs_upper() else math.inf))
    return roots
