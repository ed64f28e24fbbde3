"""Controllers of a continuous plant made discrete, exactly or in ball arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import accumulate
from typing import Any, NamedTuple

from dynid.errors import UsageError

Rows = list[list[Any]]


class DiscreteController(NamedTuple):
    """ξ[k+1] = F ξ[k] + g y[k] + t w[k], answer h ξ[k] + d y[k], exact (flint `fmpq`) or in balls (`arb`).

    w is what the answer is short of its limits: the answer has its integral over a time constant added.
    """

    F: Rows
    g: list[Any]
    h: list[Any]
    d: Any
    t: list[Any]


def discrete_controller(
    numerator: Sequence[Fraction],
    denominator: Sequence[Fraction],
    method: str,
    period: Fraction,
    place: str = "",
    tracking: Fraction = Fraction(0),
) -> DiscreteController:
    """Return a controller in discrete time, from coefficients in descending powers of s, or of z.

    Raises `UsageError` where it answers before it measures: one that is improper in z, or held and improper
    in s, or with a pole where the method has infinity. `tracking`: time constant of its anti-windup, s; 0: it
    has none.
    """
    from flint import arb, arb_mat, fmpq, fmpq_poly

    top, bottom = (fmpq_poly([*map(as_fmpq, reversed(part))]) for part in (numerator, denominator))
    degree = max(top.degree(), bottom.degree())
    if method in ("tustin", "backward"):  # s = rate (z - 1)/(z + 1), or rate (z - 1)/z
        rate, shifted = as_fmpq((2 if method == "tustin" else 1) / period), int(method == "tustin")
        powers = [
            fmpq_poly([-rate, rate]) ** power * fmpq_poly([shifted, 1]) ** (degree - power)
            for power in range(degree + 1)
        ]
        top, bottom = (
            sum((part[power] * weight for power, weight in enumerate(powers)), fmpq_poly([0]))
            for part in (top, bottom)
        )
        if bottom.degree() < degree:
            raise UsageError(
                f"the controller has a pole at {rate} rad/s, which 'method: {method}' maps to infinity",
                remedy="Change the sample time.",
                names=[f"{place}.controller.sample"],
            )
    elif top.degree() > bottom.degree():
        raise UsageError(
            f"the controller has more zeros than poles, which 'method: {method}' cannot make discrete",
            remedy="Add poles, such as a filter of the derivative (tf).",
            names=[f"{place}.controller.method"],
        )
    order, zero = bottom.degree(), fmpq(0)
    below, above = ([part[order - k] / bottom[order] for k in range(order + 1)] for part in (bottom, top))
    rows: list[list[Any]] = [
        [*(fmpq(int(k == i + 1)) - (below[i + 1] if k == 0 else 0) for k in range(order)),
         above[i + 1] - below[i + 1] * above[0], weight]
        for i, weight in enumerate(_tracking(below, method, period, tracking))
    ]  # observer form, F beside g and t  # fmt: skip
    if method == "zoh":
        rows = (arb_mat([*rows, *[[zero] * (order + 2)] * 2]) * arb(as_fmpq(period))).exp().tolist()[:order]
    F, g, weights = [row[:-2] for row in rows], [row[-2] for row in rows], [row[-1] for row in rows]
    return DiscreteController(F, g, [fmpq(k == 0) for k in range(order)], above[0], weights)


def _tracking(below: list[Any], method: str, period: Fraction, tracking: Fraction) -> list[Any]:
    """Return the coefficients over a monic denominator of 1/(tracking s), or of its Euler sum in z."""
    from flint import fmpq

    if not tracking:
        return [fmpq(0)] * (len(below) - 1)
    if method == "zoh":
        return [entry / as_fmpq(tracking) for entry in below[:-1]]  # over s
    return [entry * as_fmpq(period / tracking) for entry in accumulate(below[:-1])]  # over z - 1


def as_fmpq(number: Fraction) -> Any:
    """Return a number as a rational one of flint."""
    from flint import fmpq

    return fmpq(number.numerator, number.denominator)
