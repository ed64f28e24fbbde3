"""Bandwidth and resonance of transfer functions, as certified roots of polynomials in ω²."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

#: Working precision, bits.
_PRECISION = 256


@dataclass(frozen=True)
class Bandwidth:
    """Bandwidth and resonance of a channel; None where one is not defined.

    Parameters
    ----------
    status
        `defined`, or the reason why some or all are not.
    bandwidth
        The lowest frequency, rad/s, at which |T(jω)| falls below |T(0)|/√2 (-3 dB); inf where it never does.
    peak_gain, peak_frequency
        The supremum of |T(jω)| over all frequencies, and the lowest frequency where it is taken, rad/s; inf
        at an undamped pole; the frequency is inf where it is the limit of high frequencies.
    half_power_low, half_power_high
        The nearest frequencies below and above that of the peak at which |T| is 1/√2 of it, rad/s; 0 and inf
        where there is none on that side.
    """

    status: str
    bandwidth: float | None = None
    peak_gain: float | None = None
    peak_frequency: float | None = None
    half_power_low: float | None = None
    half_power_high: float | None = None


def bandwidth(numerator: Any, denominator: Any) -> Bandwidth:
    """Return bandwidth and resonance of a transfer function.

    Parameters
    ----------
    numerator, denominator
        The transfer function in lowest terms: integer polynomials (flint `fmpz_poly`).
    """
    if numerator == 0:
        return Bandwidth("undefined: the input does not reach the output")
    from flint import ctx

    above, below = _squared_magnitude(numerator), _squared_magnitude(denominator)
    with ctx.workprec(_PRECISION):
        status, band = "defined", None
        if below[0] == 0:
            status = "partly defined: T(0) is infinite, which the bandwidth refers to"
        elif above[0] == 0:
            status = "partly defined: T(0) is 0, which the bandwidth refers to"
        else:  # |T(jω)|² - |T(0)|²/2, over a positive factor: positive at rest
            crossings = _crossings(2 * above * below[0] - above[0] * below)
            band = math.sqrt(min(map(float, crossings))) if crossings else math.inf
        square, at = _peak(above, below)
        if square is None:
            return Bandwidth(status, band, math.inf, math.sqrt(float(at)))
        crossings = _crossings(2 * above * int(square.q) - int(square.p) * below)
        low = max((float(x) for x in crossings if x < at), default=0.0)
        high = min((float(x) for x in crossings if x > at), default=math.inf)
        gain = math.sqrt(float(square))
    return Bandwidth(status, band, gain, math.sqrt(float(at)), math.sqrt(low), math.sqrt(high))


def _squared_magnitude(polynomial: Any) -> Any:
    """Return |p(jω)|² as a polynomial in ω²."""
    from flint import fmpz_poly

    mirrored = fmpz_poly([c * (-1) ** k for k, c in enumerate(polynomial.coeffs())])
    return fmpz_poly([c * (-1) ** k for k, c in enumerate((polynomial * mirrored).coeffs()[::2])])


def _positive_roots(polynomial: Any) -> list[tuple[Any, int]]:
    """Return the positive roots of a polynomial (flint `arb`) with their multiplicities, ascending."""
    if polynomial == 0:
        return []
    found = [
        (root.real, int(count))
        for root, count in polynomial.complex_roots()
        if root.imag == 0 and root.real > 0
    ]
    return sorted(found, key=lambda one: float(one[0]))


def _crossings(polynomial: Any) -> list[Any]:
    """Return the positive numbers at which a polynomial changes its sign, ascending."""
    return [root for root, count in _positive_roots(polynomial) if count % 2]


def _peak(above: Any, below: Any) -> tuple[Any, Any]:
    """Return the supremum of |T|² (flint `fmpq`; None: infinite) and its ω² (flint `arb`)."""
    from flint import arb, fmpq

    infinite = arb(math.inf)
    if below[0] == 0:
        return None, arb(0)
    if poles := _positive_roots(below):
        return None, poles[0][0]
    if above.degree() > below.degree():
        return None, infinite
    stationary = above.derivative() * below - above * below.derivative()
    places = [arb(0), *(root for root, _ in _positive_roots(stationary))]
    limit = above.leading_coefficient() if above.degree() == below.degree() else 0
    candidates = [(_ratio(above, below, place), place) for place in places]
    candidates.append((fmpq(limit, below.leading_coefficient()), infinite))
    return max(candidates, key=lambda one: one[0])


def _ratio(above: Any, below: Any, at: Any) -> Any:
    """Return the quotient of two polynomials at a ball: its middle (flint `fmpq`)."""
    from flint import fmpq

    if at == 0:
        return fmpq(above[0], below[0])
    mantissa, exponent = (above(at) / below(at)).mid().man_exp()
    return fmpq(mantissa) * fmpq(2) ** int(exponent)
