"""Known answers by means that share nothing with dynid: closed forms, and mpmath at many digits."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import mpmath
import numpy as np

DIGITS = 80


def exact(text: str | float) -> Fraction:
    """Read a number as a scene does: the decimal that is written."""
    return Fraction(str(text))


def times(*factors: Sequence[Fraction | int]) -> list[Fraction]:
    """Multiply polynomials, descending coefficients."""
    product = [Fraction(1)]
    for factor in factors:
        grown = [Fraction(0)] * (len(product) + len(factor) - 1)
        for i, a in enumerate(product):
            for j, b in enumerate(factor):
                grown[i + j] += a * b
        product = grown
    return product


def plus(*terms: Sequence[Fraction | int]) -> list[Fraction]:
    """Add polynomials, descending coefficients."""
    size = max(map(len, terms))
    padded = [[Fraction(0)] * (size - len(term)) + [Fraction(c) for c in term] for term in terms]
    return [sum(column, Fraction(0)) for column in zip(*padded, strict=True)]


def roots(coefficients: Sequence[Fraction | int]) -> np.ndarray:
    """Return the roots of a polynomial without repeated ones, to double precision."""
    with mpmath.workdps(DIGITS):
        numbers = [mpmath.mpf(Fraction(c).numerator) / Fraction(c).denominator for c in coefficients]
        while numbers and numbers[-1] == 0:
            numbers.pop()
        origin = len(coefficients) - len(numbers)
        # In a variable that makes the roots' geometric mean 1.
        degree = len(numbers) - 1
        if degree < 1:
            return np.zeros(origin, dtype=complex)
        scale = abs(numbers[-1] / numbers[0]) ** (mpmath.mpf(1) / degree)
        scaled = [c / numbers[0] / scale**k for k, c in enumerate(numbers)]
        found = mpmath.polyroots(scaled, maxsteps=2000, extraprec=2000)
        return np.array([0j] * origin + [complex(root * scale) for root in found])


def monic(coefficients: Sequence[Fraction], lead: Fraction | None = None) -> np.ndarray:
    """Return coefficients over the leading one, or over another, correctly rounded."""
    return np.array([float(c / (lead or coefficients[0])) for c in coefficients])


def channel(
    numerator: Sequence[Fraction | int], denominator: Sequence[Fraction | int]
) -> dict[str, np.ndarray]:
    """Return what is known of a channel in lowest terms: coefficients, zeros and poles."""
    above, below = [Fraction(c) for c in numerator], [Fraction(c) for c in denominator]
    return {
        "numerator": monic(above, below[0]),
        "denominator": monic(below),
        "zeros": roots(above),
        "poles": roots(below),
    }


def chain_poles(stages: int, k: float, b: float, *, fixed: bool = False) -> np.ndarray:
    """Return the poles of a uniform chain of unit masses with springs k and dampers b.

    Held at one end, of `stages` masses; or `fixed` at both. Its matrices are polynomials in one tridiagonal
    matrix, whose eigenvalues are known (F. R. Gantmacher, M. G. Krein, Oscillation Matrices, ch. II).
    """
    with mpmath.workdps(40):
        if fixed:
            angles = [j * mpmath.pi / (2 * (stages + 1)) for j in range(1, stages + 1)]
        else:
            angles = [(2 * j - 1) * mpmath.pi / (4 * stages + 2) for j in range(1, stages + 1)]
        poles = []
        for angle in angles:
            size = 4 * mpmath.sin(angle) ** 2
            half, product = mpmath.mpf(str(b)) * size / 2, mpmath.mpf(str(k)) * size
            root = mpmath.sqrt(mpmath.mpc(half**2 - product))
            # The smaller of two real roots by the product of both, lest digits cancel.
            poles += [complex(-half - root), complex(-product / (half + root))]
    return np.array(poles)
