"""Margins of a loop, and bandwidth and resonance of a channel, from exact transfer functions.

With L = N/D on s = jω, |L| = 1, Im L = 0, the extremes of |1 + L| and |L/(1 + L)|, and |T| at a level are
polynomial equations in ω² over the integers, whose roots are certified: no crossing is missed between the
points of a grid. Where L(∞) is not 0, infinite frequency is a candidate, too: 1 + k L loses its leading
coefficient at k = -1/L(∞) (Zhou, Doyle & Glover 1996, 5.2). Loops with delays: `lti/delay_margins.py`.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from dynid.lti.certified_roots import certified_roots
from dynid.lti.stability import all_left, stability

#: Relative rounding errors of a loop at its limit of stability.
LIMIT = 1e-9
#: Verdict on a loop with L = 0.
FEED_FORWARD = "stable: L = 0, nothing is fed back"
#: Working precision, bits, of values on the axis, which cancel, and of frequencies, which become doubles.
_AXIS_BITS, _FREQUENCY_BITS = 256, 80


#: Margins that are defined for a stable loop alone: the changes that make it unstable, and their frequencies.
CHANGES = ("gain", "gain_reduction", "phase", "delay", "gain_crossover", "phase_crossover")


@dataclass(frozen=True)
class Margins:
    """Margins of a closed loop 1 + L = 0; infinite where nothing limits them.

    Where the closed loop is not stable, `gain`, `gain_reduction`, `phase` and `delay` are changes at which a
    root crosses the axis, and no margins: `where_stable` leaves them undefined.
    """

    stable: bool  # whether the closed loop is stable
    stability: str  # the verdict in words
    #: Number of poles of the closed loop in the right half-plane; inf where there are infinitely many, or
    #: where it is undecided.
    unstable_poles: float
    gain: float  # factor on L, above 1, that makes the loop unstable
    gain_reduction: float  # factor below 1 that does so; 0 where none does
    phase: float  # phase lag that does so, degrees
    #: Further delay that does so, s; 0 where any delay does, because the gain does not fall below 1 at high
    #: frequencies.
    delay: float
    modulus: float  # the smallest |1 + L|, the inverse of the largest sensitivity
    #: Frequencies of the smallest phase margin (|L| = 1), of the smallest gain margin (L real), and of the
    #: smallest |1 + L|; rad/s, infinite where there is none, or where the gain margin is that of L(∞).
    gain_crossover: float
    phase_crossover: float
    modulus_at: float
    #: The largest |S| = 1/|1 + L|, at `modulus_at`, and the largest |T| = |L/(1 + L)|.
    Ms: float
    Mt: float
    Mt_at: float  # frequency of the largest |T|, rad/s
    undecided: str = ""  # why some of these are NaN though the loop is stable; else empty

    def where_stable(self) -> Margins:
        """Return them with NaN for the changes that make a stable loop unstable, where it is not stable."""
        if self.stable:
            return self
        undefined: dict[str, Any] = dict.fromkeys(CHANGES, math.nan)
        return replace(self, **undefined)


def margins(numerator: Any, denominator: Any) -> Margins:
    """Return the margins of a loop, the transfer function L(s) of negative feedback (flint `fmpz_poly`).

    Its polynomials have no common factor; 0/1 is a feed-forward, which limits nothing and moves no pole.
    """
    roots = certified_roots(numerator + denominator)
    return replace(
        changes(numerator, denominator),
        stable=bool(all_left(roots)),
        stability=stability(roots) if numerator != 0 else FEED_FORWARD,
        unstable_poles=sum(root.multiplicity for root in roots if root.side > 0),
    )


def changes(numerator: Any, denominator: Any) -> Margins:
    """Return the margins of a loop, with the verdict left open."""
    n, d = _on_axis(numerator), _on_axis(denominator)
    size_d = _squared(denominator)
    imaginary = n[1] * d[0] - n[0] * d[1]  # of N conj D, over ω
    phases = gain_crossings(numerator, denominator)
    delay = min((math.radians(angle) / omega for angle, omega in phases), default=math.inf)
    limit = _limit(numerator, denominator)
    if abs(limit) == 1:
        phases.append((lag(complex(limit)), math.inf))
    phase, gain_crossover = min(phases, default=(math.inf, math.inf))
    crossings = [*_frequencies(_without(imaginary, size_d)), *([0.0] if denominator[0] != 0 else [])]
    real = [(_ratio(numerator, denominator, omega).real, omega) for omega in crossings]
    gains = [(-1 / value, omega) for value, omega in real if value < 0]
    above = [(factor, omega) for factor, omega in gains if factor >= 1 - LIMIT]
    below = [(factor, omega) for factor, omega in gains if factor < 1 - LIMIT]
    if limit < 0:  # 1 + k L loses its leading coefficient: a pole passes through infinity
        (above if limit > -1 else below).append((float(-1 / limit), math.inf))
    gain, phase_crossover = min(above, default=(math.inf, math.inf))
    reduction = max(below, default=(0.0, math.inf))
    if not above:
        phase_crossover = reduction[1]
    closed = numerator + denominator
    Ms, Ms_at = _largest(denominator, closed)
    Mt, Mt_at = _largest(numerator, closed)
    return Margins(
        stable=False,
        stability="",
        unstable_poles=math.inf,
        gain=gain,
        gain_reduction=reduction[0],
        phase=phase,
        delay=0.0 if abs(limit) >= 1 or numerator.degree() > denominator.degree() else delay,
        modulus=1 / Ms if Ms else math.inf,
        gain_crossover=gain_crossover,
        phase_crossover=phase_crossover,
        modulus_at=Ms_at,
        Ms=Ms,
        Mt=Mt,
        Mt_at=Mt_at,
    )


def gain_crossings(numerator: Any, denominator: Any) -> list[tuple[float, float]]:
    """Return the phase lags, degrees, that turn L to -1 where |L(jω)| = 1, with ω, rad/s."""
    frequencies = _frequencies(_squared(numerator) - _squared(denominator))
    return [(lag(_ratio(numerator, denominator, omega)), omega) for omega in frequencies]


def lag(value: complex) -> float:
    """Return the phase lag, degrees in [0, 360), that turns a value of modulus 1 to -1."""
    angle = math.degrees(cmath.phase(-value)) % 360.0
    return 0.0 if angle > 360.0 - LIMIT else angle


def _largest(top: Any, bottom: Any) -> tuple[float, float]:
    """Return the largest size of a rational function on s = jω, and its frequency; inf at a pole there."""
    shared = top.gcd(bottom)
    top, bottom = top // shared, bottom // shared
    real, imaginary = _on_axis(bottom)
    if poles := [*([0.0] if real[0] == 0 else []), *_frequencies(real.gcd(imaginary))]:
        return math.inf, poles[0]
    above, below = _squared(top), _squared(bottom)
    stationary = above.derivative() * below - above * below.derivative()
    sizes = [(abs(_ratio(top, bottom, omega)), omega) for omega in [0.0, *_frequencies(stationary)]]
    high = math.inf if top.degree() > bottom.degree() else float(abs(_limit(top, bottom)))
    return largest_of([*sizes, (high, math.inf)])


def largest_of(sizes: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Return the largest of sizes with their frequencies, of those equal but for rounding the first."""
    best = (0.0, math.inf)
    for candidate in sizes:
        if candidate[0] > best[0] * (1 + 1e-13):
            best = candidate
    return best


def _limit(top: Any, bottom: Any) -> Fraction:
    """Return a rational function at infinity; 0 where it is not finite."""
    if top.degree() != bottom.degree():
        return Fraction(0)
    from dynid.arithmetic.field_polynomials import leading_ratio

    return leading_ratio(top, bottom)


def _ratio(top: Any, bottom: Any, omega: float) -> complex:
    """Return a rational function at s = jω."""
    from flint import acb, acb_poly, ctx

    from dynid.arithmetic.field_polynomials import integers

    with ctx.workprec(_AXIS_BITS):
        s = acb(0, omega)
        top, bottom = integers(top, bottom)
        value = acb_poly(top)(s) / acb_poly(bottom)(s)
        return complex(float(value.real.mid()), float(value.imag.mid()))


def _without(polynomial: Any, factor: Any) -> Any:
    """Return a polynomial without the roots of another one: crossings are not at poles of the loop."""
    while polynomial != 0 and (shared := polynomial.gcd(factor)).degree() > 0:
        polynomial = polynomial // shared
    return polynomial


def _on_axis(polynomial: Any) -> tuple[Any, Any]:
    """Return P and Q of p(jω) = P(ω²) + jω Q(ω²)."""
    from dynid.arithmetic.field_polynomials import like

    coefficients = [c * (-1) ** (k // 2) for k, c in enumerate(polynomial.coeffs())]
    return like(polynomial, coefficients[::2]), like(polynomial, coefficients[1::2])


def _squared(polynomial: Any) -> Any:
    """Return |p(jω)|² as a polynomial in ω²."""
    from dynid.arithmetic.field_polynomials import like

    real, imaginary = _on_axis(polynomial)
    return real * real + like(polynomial, [0, 1]) * imaginary * imaginary


def _frequencies(polynomial: Any, *, crossings: bool = False) -> list[float]:
    """Return ω of the positive roots ω² of a polynomial, ascending; or of its changes of sign alone."""
    from flint import ctx

    if polynomial == 0:
        return []
    with ctx.workprec(_FREQUENCY_BITS):
        roots = [
            float(root.real.sqrt())
            for root, count in polynomial.complex_roots()
            if root.imag == 0 and root.real > 0 and (count % 2 or not crossings)
        ]
    return sorted(roots)


@dataclass(frozen=True)
class Bandwidth:
    """Bandwidth and resonance of a channel; None where one is not defined."""

    status: str  # `defined`, or the reason why some or all are not
    #: The lowest frequency, rad/s, at which |T(jω)| falls below |T(0)|/√2 (-3 dB); inf where it never does.
    bandwidth: float | None = None
    #: The supremum of |T(jω)| over all frequencies, and the lowest frequency where it is taken, rad/s; inf at
    #: an undamped pole; the frequency is inf where it is the limit of high frequencies.
    peak_gain: float | None = None
    peak_frequency: float | None = None
    #: The nearest frequencies below and above that of the peak at which |T| is 1/√2 of it, rad/s; 0 and inf
    #: where there is none on that side.
    half_power_low: float | None = None
    half_power_high: float | None = None


def bandwidth(numerator: Any, denominator: Any) -> Bandwidth:
    """Return bandwidth and resonance of a transfer function in lowest terms (flint `fmpz_poly`)."""
    if numerator == 0:
        return Bandwidth("undefined: the input does not reach the output")
    above, below = _squared(numerator), _squared(denominator)
    status, band = "defined", None
    if below[0] == 0:
        status = "partly defined: T(0) is infinite, which the bandwidth refers to"
    elif above[0] == 0:
        status = "partly defined: T(0) is 0, which the bandwidth refers to"
    else:  # |T(jω)|² - |T(0)|²/2, over a positive factor: positive at rest
        band = min(_frequencies(2 * above * below[0] - above[0] * below, crossings=True), default=math.inf)
    gain, at = _largest(numerator, denominator)
    if gain == math.inf:
        return Bandwidth(status, band, gain, at)
    square = Fraction(gain) ** 2
    half = _frequencies(2 * above * square.denominator - square.numerator * below, crossings=True)
    low = max((omega for omega in half if omega < at), default=0.0)
    high = min((omega for omega in half if omega > at), default=math.inf)
    return Bandwidth(status, band, gain, at, low, high)
