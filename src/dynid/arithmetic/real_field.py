"""The field of the irrational numbers of a scene: what is exactly zero, and enclosures of what is not.

A field is known by two homomorphisms. Real enclosures (Arb) prove that a number is not zero. Residues modulo
a large prime show what is: a number of the field that is not zero is divisible by it with a probability of
about one in 2^250. Together they make a *coded* number, a fraction that is as close to the real number as
wanted and has its residue, so that sums and products of coded numbers are coded numbers again, and zero is
recognised after any number of them.

The prime P is -1 modulo the factors of all radicands. So these are squares modulo P, -1 is none, and
"is a square" behaves like "is positive": each positive number has one root of each degree that is a square,
and roots of products are products of roots. A root of a sum that lies in the field of the other roots, as
sqrt(3 + 2 sqrt(2)) = 1 + sqrt(2), is found as an integer relation (LLL). Angles are points on the circle
x^2 + y^2 = 1 modulo P, a group of P + 1 elements, which holds those of rational multiples of pi.
Exponentials, logarithms and angles that no rational relation ties are random residues: they are
algebraically independent if Schanuel's conjecture holds.

References
----------
A. S. Besicovitch, "On the linear independence of fractional powers of integers", J. London Math. Soc. 15
(1940) 3-6. D. Richardson, "How to recognize zero", J. Symbolic Computation 24 (1997) 627-645.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from flint import arb, ctx, fmpq, fmpz, fmpz_mod_ctx, fmpz_mod_poly_ctx

from dynid.arithmetic.integer_relations import integer_relation
from dynid.arithmetic.modular_circle import ModularCircle, is_square, prime_factors
from dynid.arithmetic.terms import RATIONAL, Enclosures, OutOfRangeError, Term, in_order, root_ball

#: Least bits of the prime, and of a random cofactor in it.
_PRIME_BITS, _COFACTOR_BITS = 256, 64
#: Bits of the prime up to which radicands are put into it; more of them are squares by trial.
_MAX_MODULUS_BITS = 1024
#: Relative accuracy of coded numbers, bits, and that of the fractions which they are rounded to in the end.
CODED_BITS, ROUNDED_BITS = 1024, 320
#: Bits of a value that is rounded to the nearest double.
_DOUBLE_BITS = 64
#: What more of it a system has for each order: common factors lose some 7 bits a degree.
_BITS_PER_ORDER = 24
#: First and last precision at which a sum that is not zero is told from zero, bits.
_FIRST_PRECISION, _MAX_PRECISION = 256, 1 << 14
#: Bits of numerator and denominator together up to which a residue is recognised as rational: with the
#: prime's 256 bits, one in 2^56 others looks like one.
_RATIONAL_BITS = 200
#: Most terms of a relation that is sought.
_MAX_TERMS = 32
#: Largest numerator and denominator in a relation of exponents.
_MAX_MULTIPLE = 10_000
#: Primes tried, each a square root of a sum exists modulo about half of them.
_MAX_TRIALS = 4096
#: Circles have points of this order from the start: angles in whole degrees, halved twice.
_CIRCLE_ORDER = 1440
#: Multiples of an angle by fractions with such a denominator are its multiples.
_ANGLE_DIVISOR = 5040


class _Extend(Exception):
    """The prime has to be -1 modulo one more number, the order of an angle or another."""

    def __init__(self, modulus: int, order: int = 1) -> None:
        self.modulus, self.order = modulus, order


class _NoRootError(Exception):
    """A square root does not exist modulo this prime."""


@dataclass(frozen=True)
class _Exponential:
    """A number X with its logarithm: residues, and enclosure of the logarithm."""

    number: int
    logarithm: int
    real: Callable[[], Any]


@dataclass(frozen=True)
class _Angle:
    """A point on the circle whose `_ANGLE_DIVISOR`-th multiple belongs to an angle, with its enclosure."""

    point: tuple[int, int]
    angle: int
    real: Callable[[], Any]


@dataclass(frozen=True)
class _Generator:
    """A number that others may be polynomials in: its term, residue and enclosure, and its degree."""

    term: int
    image: int
    real: Callable[[], Any]
    degree: int


class RealField:
    """The field that terms lie in.

    `order` is that of the system that is computed with coded numbers: common factors of its polynomials lose
    accuracy. `polynomials` is the context of those modulo `prime` (flint `fmpz_mod_poly_ctx`); `enclosure`
    returns an enclosure of a number at the working precision (flint `arb`).
    """

    def __init__(self, terms: Iterable[Term], order: int = 0) -> None:
        self.bits = CODED_BITS + _BITS_PER_ORDER * order
        self._terms = list(in_order(terms))
        self.enclosure = Enclosures()
        self._relations: dict[
            tuple[int, str, int, float], list[Fraction] | None
        ] = {}  # the same for every prime
        modulus, trial, self._order = _CIRCLE_ORDER, 0, _CIRCLE_ORDER
        for base in self._radical_primes(self._terms):
            if modulus.bit_length() < _MAX_MODULUS_BITS:
                modulus = math.lcm(modulus, _odd(base))
        for _ in range(_MAX_TRIALS):
            self.prime = _prime(modulus, trial)
            try:
                self._assign()
            except _Extend as extension:
                self._order = math.lcm(self._order, extension.order)
                modulus = math.lcm(modulus, extension.modulus, self._order)
            except _NoRootError:
                trial += 1
            else:
                break
        else:
            raise OutOfRangeError("too many different roots; write fewer, or round some to decimals")
        self.residues = fmpz_mod_ctx(self.prime)
        self.polynomials = fmpz_mod_poly_ctx(self.residues)

    @staticmethod
    def _radical_primes(terms: Iterable[Term]) -> dict[int, None]:
        """Return the factors of the radicands among terms."""
        radicands = (term.operands[0] for term in terms if _radical(term))
        return dict.fromkeys(
            base
            for radicand in radicands
            for number in radicand.as_integer_ratio()  # type: ignore[union-attr]
            for base, _ in prime_factors(number)
        )

    # --- residues ------------------------------------------------------------------------------

    def _assign(self) -> None:
        """Give every term its residue."""
        self._random = random.Random(0x5EED)
        self._points = ModularCircle(self.prime, self._order)
        self._images: dict[int, int] = {}
        self._radicals: dict[int, int] = {}  # by base the degree of its root
        self._generators: list[_Generator] = []
        self._exponentials: list[_Exponential] = []
        self._angles: list[_Angle] = []
        self._unit: tuple[int, int] | None = None
        self._turns = 1  # cosines and sines of multiples of 2 pi over it are polynomials in that of one
        self._pi = pow(self._random.randrange(2, self.prime), 2, self.prime)
        for term in self._terms:  # roots of fractions first: sums may have their roots among them
            if _radical(term):
                self._images[id(term)] = self._image(term)
        for term in self._terms:
            if id(term) not in self._images:
                self._current = term
                self._images[id(term)] = self._image(term)

    def residue(self, number: Term | Fraction) -> int:
        """Return the residue of a number of the field."""
        if isinstance(number, Term):
            return self._images[id(number)]
        return number.numerator * pow(number.denominator, -1, self.prime) % self.prime

    def _image(self, term: Term) -> int:
        """Return the residue of a term whose operands have theirs."""
        p, operation = self.prime, term.operation
        images = [self.residue(operand) for operand in term.operands]
        match operation:
            case "pi":
                return self._pi
            case "+" | "-" | "*" | "neg":
                return int(RATIONAL[operation](*images)) % p
            case "/":
                return self._quotient(images[0], images[1])
            case "sqrt":
                return self._root(term.operands[0], images[0], 2, self._real(term))
            case "**":
                return self._power(term, images)
            case "exp":
                return self._exponential(images[0], self._real(term.operands[0]))
            case "log":
                return self._logarithm(images[0], self._real(term))
        cosine, sine = self._circle(images[0], self._real(term.operands[0]))
        return {"sin": sine, "cos": cosine}[operation] if operation != "tan" else self._quotient(sine, cosine)

    def _quotient(self, above: int, below: int) -> int:
        if not below:
            raise OutOfRangeError("division by zero")
        return above * pow(below, -1, self.prime) % self.prime

    def _real(self, number: Term | Fraction) -> Callable[[], Any]:
        return lambda: self.enclosure(number)

    def _power(self, term: Term, images: Sequence[int]) -> int:
        base, exponent = term.operands
        if isinstance(exponent, Fraction):
            if not images[0]:
                return 0
            if exponent.denominator == 1:
                return pow(images[0], int(exponent), self.prime)
            degree = exponent.denominator
            root = self._root(base, images[0], degree, lambda: root_ball(self.enclosure(base), degree))
            return pow(root, exponent.numerator, self.prime)
        logarithm = self._logarithm(images[0], lambda: self.enclosure(base).log())
        return self._exponential(
            images[1] * logarithm % self.prime,
            lambda: self.enclosure(exponent) * self.enclosure(base).log(),
        )

    def _root_of_fraction(self, radicand: Fraction, degree: int) -> int:
        """Return the root of a positive fraction, made of roots of the factors of its numbers."""
        self._check_degree(degree)
        parts = []
        for number in (radicand.numerator, radicand.denominator):
            perfect = 1
            for base, power in prime_factors(number):
                quotient, rest = divmod(power, degree)
                perfect = perfect * pow(base, quotient, self.prime) % self.prime
                if rest:
                    root_degree = degree // math.gcd(rest, degree)
                    self._radicals[base] = math.lcm(root_degree, self._radicals.get(base, 1))
                    root = self._canonical(base % self.prime, degree)
                    perfect = perfect * pow(root, rest, self.prime) % self.prime
            parts.append(perfect)
        return self._quotient(*parts)

    def _check_degree(self, degree: int) -> None:
        if (self.prime + 1) % _odd(degree):
            raise _Extend(_odd(degree))

    def _canonical(self, image: int, degree: int) -> int:
        """Return the root that is a square; of a number that is none, for odd degrees, the other one."""
        if not is_square(image, self.prime):
            if degree % 2 == 0:
                raise _NoRootError
            return -self._canonical(-image % self.prime, degree) % self.prime
        return pow(image, pow(degree, -1, (self.prime - 1) // 2), self.prime) if image else 0

    def _root(self, base: Term | Fraction, image: int, degree: int, real: Callable[[], Any]) -> int:
        """Return the root of a number; roots of even degree of sums are sought in the field."""
        if isinstance(base, Fraction):
            return self._root_of_fraction(base, degree)
        self._check_degree(degree)
        root = self._canonical(image, degree)
        sums = ("+", "-", "sin", "cos", "tan")  # products of roots have theirs by their residues
        if degree % 2 or not any(term.operation in sums for term in in_order([base])):
            return root
        twos = degree & -degree
        if twos > 2:  # as roots of roots
            half = self._root(base, image, degree // 2, lambda: real() ** 2)
            return self._square_root(base, half, self._canonical(half, 2), real)
        return self._square_root(base, pow(root, 2, self.prime), root, real)

    def _square_root(self, base: Term, square: int, root: int, real: Callable[[], Any]) -> int:
        """Return the square root with the sign that belongs to the positive one."""
        basis = self._basis(base)
        relation = self._related("sqrt", real, [value for _, value in basis])
        if relation is not None:
            combined = sum(self.residue(c) * image for c, (image, _) in zip(relation, basis, strict=True))
            if pow(combined, 2, self.prime) == square:
                return combined % self.prime
        self._generate(root, real)
        return root

    def _related(
        self, kind: str, real: Callable[[], Any], basis: Sequence[Callable[[], Any]], largest: int = 0
    ) -> list[Fraction] | None:
        """Return the relation of a number to others, sought once for the current term."""
        key = id(self._current), kind, len(basis), float(real().mid())
        if key not in self._relations:
            self._relations[key] = integer_relation(real, basis, largest)
        return self._relations[key]

    def _generate(self, image: int, real: Callable[[], Any]) -> None:
        """Note a number that others may be sums of, with itself or not."""
        self._generators.append(_Generator(id(self._current), image, real, 2))

    def _basis(self, base: Term) -> list[tuple[int, Callable[[], Any]]]:
        """Return products of powers of generators: those of a term first, as far as there is room."""
        inside = list(in_order([base]))
        terms_inside = {id(term) for term in inside}
        bases = self._radical_primes(inside)
        radicals = [
            (
                number not in bases,
                self._canonical(number % self.prime, degree),
                _radical_ball(number, degree),
                degree,
            )
            for number, degree in self._radicals.items()
        ]
        others = [
            (generator.term not in terms_inside, generator.image, generator.real, generator.degree)
            for generator in self._generators
        ]
        if self._unit is not None and self._turns > 1:
            turn, outside = fmpq(2, self._turns), all(term.operation != "pi" for term in inside)
            cosine = 2 * self._points.times(self._unit, self._order // self._turns)[0] % self.prime
            degree = max(int(fmpz(self._turns).euler_phi()) // 2, 2)
            radicals.append((outside, cosine, lambda: 2 * arb.cos_pi_fmpq(turn), degree))
        basis: list[tuple[int, Callable[[], Any]]] = [(1, lambda: arb(1))]
        for _, image, real, degree in sorted([*radicals, *reversed(others)], key=lambda entry: entry[0]):
            if len(basis) * degree <= _MAX_TERMS:
                basis = [
                    (monomial * pow(image, k, self.prime) % self.prime, _product(product, real, k))
                    for monomial, product in basis
                    for k in range(degree)
                ]
        return basis

    def _exponential(self, image: int, real: Callable[[], Any]) -> int:
        """Return exp of a number."""
        p, entries = self.prime, self._exponentials
        if not image:
            return 1
        relation = self._related("exp", real, [entry.real for entry in entries], _MAX_MULTIPLE)
        if relation is not None:
            parts = list(zip(relation, entries, strict=True))
            if (image - sum(self.residue(multiple) * entry.logarithm for multiple, entry in parts)) % p == 0:
                result = 1
                for multiple, entry in parts:
                    self._check_degree(multiple.denominator)
                    root = self._canonical(entry.number, multiple.denominator)
                    result = result * pow(root, multiple.numerator, p) % p
                return result
        number = pow(self._random.randrange(2, p), 2, p)
        entries.append(_Exponential(number, image, real))
        self._generate(number, lambda: real().exp())
        return number

    def _logarithm(self, image: int, real: Callable[[], Any]) -> int:
        """Return the logarithm of a number, of which `real` encloses it."""
        p, entries = self.prime, self._exponentials
        if image == 1:
            return 0
        relation = self._related("exp", real, [entry.real for entry in entries], _MAX_MULTIPLE)
        if relation is not None:
            common = math.lcm(*(multiple.denominator for multiple in relation))
            product = 1
            for multiple, entry in zip(relation, entries, strict=True):
                product = product * pow(entry.number, int(common * multiple), p) % p
            if product == pow(image, common, p):
                parts = zip(relation, entries, strict=True)
                return sum(self.residue(multiple) * entry.logarithm for multiple, entry in parts) % p
        logarithm = pow(self._random.randrange(2, p), 2, p)
        if real() < 0:
            logarithm = -logarithm % p
        entries.append(_Exponential(image, logarithm, real))
        self._generate(logarithm, real)
        return logarithm

    def _circle(self, image: int, real: Callable[[], Any]) -> tuple[int, int]:
        """Return cosine and sine of an angle."""
        p, entries = self.prime, self._angles
        if not image:
            return 1, 0
        basis = [arb.pi, *(entry.real for entry in entries)]
        relation = self._related("angle", real, basis, _MAX_MULTIPLE)
        if relation is not None:
            residues = [self._pi, *(entry.angle for entry in entries)]
            parts = zip(relation, residues, strict=True)
            if (
                image - sum(self.residue(multiple) * residue for multiple, residue in parts)
            ) % p == 0 and all(_ANGLE_DIVISOR % multiple.denominator == 0 for multiple in relation[1:]):
                point = self._part_of_pi(relation[0])
                for multiple, entry in zip(relation[1:], entries, strict=True):
                    point = self._points.turned(
                        point, self._points.times(entry.point, int(multiple * _ANGLE_DIVISOR))
                    )
                return point
        entry = _Angle(self._points.random_point(self._random), image, real)
        entries.append(entry)
        point = self._points.times(entry.point, _ANGLE_DIVISOR)
        self._generate(point[0], lambda: real().cos())
        self._generate(point[1], lambda: real().sin())
        return point

    def _part_of_pi(self, multiple: Fraction) -> tuple[int, int]:
        """Return the point at a rational multiple of pi."""
        order = 2 * multiple.denominator
        if self._order % order:
            raise _Extend(1, order)
        if self._unit is None:
            self._unit = self._points.unit(self._random)
        point = self._points.times(self._unit, multiple.numerator * (self._order // order))
        if multiple.denominator > 2:
            self._turns = math.lcm(self._turns, 4, order)
        return point

    # --- numbers -------------------------------------------------------------------------------

    def simplified(self, term: Term) -> Fraction | float:
        """Return the value of a term: a fraction where it is rational, else rounded to the nearest double.

        `OutOfRangeError` where enclosures hold zero at every precision although the residue is not zero.
        """
        image = self._images[id(term)]
        if image == 0:
            return Fraction(0)
        precision = _FIRST_PRECISION
        while True:
            with ctx.workprec(precision):
                ball = self.enclosure(term)
                if ball.rel_accuracy_bits() > _DOUBLE_BITS:
                    exact = self.rational(image, ball)
                    return float(ball.mid()) if exact is None else exact
            precision *= 2
            if precision > _MAX_PRECISION:
                raise _undecided(term)

    def rational(self, image: int, ball: Any) -> Fraction | None:
        """Return the fraction with a residue and an enclosure, where it is a short one."""
        last, following, above, below = self.prime, image, 0, 1
        while following.bit_length() > _RATIONAL_BITS // 2:  # the Euclidean algorithm, halfway
            quotient = last // following
            last, following, above, below = (
                following,
                last - quotient * following,
                below,
                above - quotient * below,
            )
        if not below or below.bit_length() > _RATIONAL_BITS // 2:
            return None
        exact = Fraction(following, below)
        return exact if bool(ball.contains(fmpq(exact.numerator, exact.denominator))) else None

    def coded(self, term: Term) -> Fraction:
        """Return a term of the field as a coded number: a fraction close to it that has its residue."""
        precision = self.bits + _FIRST_PRECISION
        while True:
            with ctx.workprec(precision):
                ball = self.enclosure(term)
                if ball.rel_accuracy_bits() >= self.bits:
                    coded = self.near(ball.mid().fmpq(), self._images[id(term)])
                    return Fraction(int(coded.p), int(coded.q))
            precision *= 2

    def near(self, close: Any, image: int) -> Any:
        """Return a number (`fmpq`) with a residue that agrees with another one, not 0, to the coded accuracy.

        Its denominator is a power of 2.
        """
        above, below, prime = close.p, close.q, self.prime
        shift = self.bits + prime.bit_length() + below.bit_length() - above.bit_length()
        if shift >= 0:
            target, scale = (above << shift) // below, fmpz(1) << shift
        else:
            target, scale = above // (below << -shift), fmpq(1, fmpz(1) << -shift)
        shifted = image * pow(2, shift, prime)
        return (target + (shifted - target + prime // 2) % prime - prime // 2) / fmpq(scale)


# --- terms ----------------------------------------------------------------------------------------


def _radical(term: Term) -> bool:
    """Test whether a term is the root of a fraction."""
    if term.operation == "sqrt":
        return isinstance(term.operands[0], Fraction)
    return (
        term.operation == "**"
        and all(isinstance(operand, Fraction) for operand in term.operands)
        and term.operands[1].denominator > 1  # type: ignore[union-attr]
    )


def _undecided(term: Term) -> OutOfRangeError:
    """Return the error for two terms of which it cannot be decided whether they are equal."""
    digits = f"{int(_MAX_PRECISION * math.log10(2)):,} digits"
    what = f"'{term}' is 0 to {digits}"
    if term.operation == "-":
        what = f"'{term.operands[0]}' and '{term.operands[1]}' agree to {digits}"
    return OutOfRangeError(f"{what}, and it cannot be decided whether exactly; simplify one of the terms")


# --- numbers --------------------------------------------------------------------------------------


def _odd(number: int) -> int:
    return number // (number & -number)


def _radical_ball(base: int, degree: int) -> Callable[[], Any]:
    return lambda: root_ball(arb(base), degree)


def _product(first: Callable[[], Any], second: Callable[[], Any], power: int) -> Callable[[], Any]:
    return lambda: first() * second() ** power


def _prime(modulus: int, trial: int) -> int:
    """Return a prime that is -1 modulo a number: one of a fixed sequence."""
    bits = max(_COFACTOR_BITS, _PRIME_BITS - modulus.bit_length())
    factor = random.Random(0xD1F1D + trial).getrandbits(bits) | 1 << bits
    while not fmpz(candidate := modulus * factor - 1).is_probable_prime():
        factor += 1
    return candidate
