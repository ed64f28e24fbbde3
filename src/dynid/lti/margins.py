"""Gain, phase, delay and modulus margins of a loop, from its exact open-loop transfer function.

With L = N/D on s = jω, |L| = 1, Im L = 0 and the extremes of |1 + L| are polynomial equations in ω² over the
integers, whose roots are certified: no crossing is missed between the points of a grid.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from dynid.lti.certified_roots import certified_roots
from dynid.lti.stability import all_left

#: Imaginary parts of roots below this, relative to their size, belong to real roots: the certified radii are
#: of the order of rounding errors.
_REAL = 1e-9
#: Relative rounding errors of a loop at its limit of stability.
_LIMIT = 1e-9


@dataclass(frozen=True)
class Margins:
    """Margins of a closed loop 1 + L = 0; infinite where nothing limits them.

    Where the closed loop is unstable, they are the changes at which a root crosses the axis.

    Parameters
    ----------
    stable
        Whether the closed loop is stable.
    gain
        Factor on L, above 1, that makes the loop unstable.
    gain_reduction
        Factor below 1 that does so; 0 where none does.
    phase
        Phase lag that does so, degrees.
    delay
        Delay that does so, s.
    modulus
        The smallest |1 + L|, the inverse of the largest sensitivity.
    gain_crossover, phase_crossover, modulus_at
        Frequencies of the smallest phase margin (|L| = 1), of the smallest gain margin (L real), and of the
        smallest |1 + L|; rad/s, infinite where there is none.
    """

    stable: bool
    gain: float
    gain_reduction: float
    phase: float
    delay: float
    modulus: float
    gain_crossover: float
    phase_crossover: float
    modulus_at: float


def margins(numerator: Any, denominator: Any) -> Margins:
    """Return the margins of a loop.

    Parameters
    ----------
    numerator, denominator
        The open-loop transfer function L(s) of negative feedback: integer polynomials (flint `fmpz_poly`).
    """
    n, d = _on_axis(numerator), _on_axis(denominator)
    size_n, size_d = _squared(n), _squared(d)
    # Im(N conj D) = 0 and |N|^2 = |D|^2, as polynomials in ω.
    imaginary = n[1] * d[0] - n[0] * d[1]

    def loop(omega: float) -> complex:
        return _at(numerator, 1j * omega) / _at(denominator, 1j * omega)

    phases = [(_lag(loop(omega)), omega) for omega in _positive_roots(size_n - size_d)]
    phase, gain_crossover = min(phases, default=(math.inf, math.inf))
    delay = min((math.radians(lag) / omega for lag, omega in phases), default=math.inf)
    real = [(loop(omega).real, omega) for omega in _positive_roots(_without(imaginary, size_d))]
    real_at = [(value, omega) for value, omega in real if value < 0]
    if denominator[0] != 0 and loop(0.0).real < 0:
        real_at.append((loop(0.0).real, 0.0))
    gains = [(-1 / value, omega) for value, omega in real_at]
    above = [(factor, omega) for factor, omega in gains if factor >= 1 - _LIMIT]
    below = [(factor, omega) for factor, omega in gains if factor < 1 - _LIMIT]
    gain, phase_crossover = min(above, default=(math.inf, math.inf))
    reduction = max(below, default=(0.0, math.inf))
    if not above:
        phase_crossover = reduction[1]
    one = _squared(_on_axis(numerator + denominator))
    stationary = one.derivative() * size_d - one * size_d.derivative()
    sizes = [(abs(1 + loop(omega)), omega) for omega in _positive_roots(_without(stationary, size_d))]
    if denominator[0] != 0:
        sizes.append((abs(1 + loop(0.0)), 0.0))
    if numerator.degree() < denominator.degree():
        sizes.append((1.0, math.inf))
    elif numerator.degree() == denominator.degree():
        limit = float(int(numerator.leading_coefficient())) / float(int(denominator.leading_coefficient()))
        sizes.append((abs(1 + limit), math.inf))
    modulus, modulus_at = min(sizes, default=(math.inf, math.inf))
    stable = bool(all_left(certified_roots(numerator + denominator)))
    return Margins(
        stable, gain, reduction[0], phase, delay, modulus, gain_crossover, phase_crossover, modulus_at
    )


def _lag(value: complex) -> float:
    """Return the phase lag, degrees in [0, 360), that turns a value of modulus 1 to -1."""
    lag = math.degrees(cmath.phase(-value)) % 360.0
    return 0.0 if lag > 360.0 - _LIMIT else lag


def _without(polynomial: Any, other: Any) -> Any:
    """Return a polynomial without the roots of another one: crossings are not at poles of the loop."""
    while polynomial != 0 and (shared := polynomial.gcd(other)).degree() > 0:
        polynomial = polynomial // shared
    return polynomial


def _on_axis(polynomial: Any) -> tuple[Any, Any]:
    """Return real and imaginary part on s = jω, as polynomials in ω."""
    from flint import fmpz_poly

    coefficients = [int(c) for c in polynomial.coeffs()]
    signs = (1, 1, -1, -1)
    real = [c * signs[k % 4] if k % 2 == 0 else 0 for k, c in enumerate(coefficients)]
    imaginary = [c * signs[k % 4] if k % 2 else 0 for k, c in enumerate(coefficients)]
    return fmpz_poly(real), fmpz_poly(imaginary)


def _squared(parts: tuple[Any, Any]) -> Any:
    return parts[0] * parts[0] + parts[1] * parts[1]


def _positive_roots(polynomial: Any) -> Iterator[float]:
    """Yield the positive real roots of a polynomial in ω."""
    if polynomial == 0:
        return
    for root in certified_roots(polynomial):
        value = root.value
        if value.real > 0 and abs(value.imag) <= max(root.radius, _REAL * abs(value)):
            yield value.real


def _at(polynomial: Any, s: complex) -> complex:
    total = 0j
    for coefficient in reversed([int(c) for c in polynomial.coeffs()]):
        total = total * s + coefficient
    return total
