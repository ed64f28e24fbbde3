"""Bandwidth and resonance of a channel T = N/Q with delays, by the searches of `delay_margins.py`.

T is the complementary sensitivity of L = N/(Q - N), and |T| = c where c^-1 T has the modulus 1: no crossing
and no maximum is missed.
"""

from __future__ import annotations

import math
from fractions import Fraction

from dynid.errors import Undecided
from dynid.lti.delay_margins import SEARCH, LoopSearch
from dynid.lti.margins import Bandwidth
from dynid.lti.quasi_polynomials import QuasiPolynomial

#: 1/√2 to more digits than doubles have.
_HALF_POWER = Fraction(math.isqrt(10**60 // 2), 10**30)


def delayed_bandwidth(above: QuasiPolynomial, below: QuasiPolynomial) -> Bandwidth:
    """Return bandwidth and resonance of a channel without common factors of N and Q."""
    if not above.terms:
        return Bandwidth("undefined: the input does not reach the output")
    at_rest = abs(above.at_origin()), abs(below.at_origin())
    status, band = "defined", None
    try:
        if not at_rest[1]:
            status = "partly defined: T(0) is infinite, which the bandwidth refers to"
        elif not at_rest[0]:
            status = "partly defined: T(0) is 0, which the bandwidth refers to"
        else:
            band = min(_at_level(above, below, Fraction(*at_rest) * _HALF_POWER), default=math.inf)
        peaks = dict[str, float]()
        LoopSearch(above, below - above, SEARCH).extremes(peaks)
        gain, at = peaks["Mt"], peaks["Mt_at"]
        if gain == math.inf:
            return Bandwidth(status, band, gain, at)
        half = _at_level(above, below, Fraction(gain) * _HALF_POWER)
    except Undecided as error:
        return Bandwidth(f"not computed: {error.problem}")
    low = max((omega for omega in half if omega < at), default=0.0)
    return Bandwidth(
        status, band, gain, at, low, min((omega for omega in half if omega > at), default=math.inf)
    )


def _at_level(above: QuasiPolynomial, below: QuasiPolynomial, level: Fraction) -> list[float]:
    """Return the frequencies, rad/s, at which |N/Q| takes a level."""
    top, bottom = above.times(level.denominator), below.times(level.numerator)
    return LoopSearch(top, bottom, SEARCH).unit_gains()
