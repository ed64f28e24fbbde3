# ruff: noqa: ARG002, D102 - the methods of all laws are those of `Law`, described there
"""Laws of joints without memory, and the laws by their kinds.

To add a law: write its class, add it to `LAWS`, and its keys to `scene/schema/joint_laws.py`. The march in C
takes the laws that have a `code`, any other the march in NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynid.structure.expression_law import ExpressionLaw
from dynid.structure.hysteretic_laws import BoucWen, Iwan, Jenkins
from dynid.structure.law import Guard, Law, Slopes, Values


def _sign(x: Any) -> Any:
    return np.where(np.asarray(x) >= 0, 1.0, -1.0)


class Power(Law):
    """a |d|^m |v|^n, times the signs of d and v where it is signed in them."""

    kind, names, code = "power", ("a",), 1
    signed: tuple[str, ...] = ("a",)

    def __init__(self, d: float = 0, v: float = 0, signed: Sequence[str] = ()) -> None:
        self.exponents = (float(d), float(v))
        self.odd = ("d" in signed, "v" in signed)
        # A whole power whose parity is that of its sign is a polynomial: it has no regimes.
        self.kinked = tuple(
            exponent > 0 and exponent % 2 != float(odd)
            for exponent, odd in zip(self.exponents, self.odd, strict=True)
        )
        self.options = (*self.exponents, *map(float, (*self.odd, *self.kinked)))

    def _factor(self, which: int, regime: int, x: Any) -> tuple[Any, Any]:
        """Return a factor and its derivative, continued smoothly beyond the regime."""
        exponent, odd = self.exponents[which], self.odd[which]
        if exponent == 0:
            return np.ones_like(x), np.zeros_like(x)
        if not self.kinked[which]:
            return x ** int(exponent), exponent * x ** int(exponent - 1)
        sign = -1.0 if regime >> which & 1 else 1.0
        base = np.maximum(sign * x, 0.0) if exponent % 1 else sign * x
        of_sign = sign if odd else 1.0
        return of_sign * base**exponent, of_sign * sign * exponent * base ** (exponent - 1)

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        (fd, sd), (fv, sv) = self._factor(0, regime, d), self._factor(1, regime, v)
        return Slopes(p[0] * fd * fv, p[0] * sd * fv, p[0] * fd * sv, 0.0, (fd * fv,))

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        return sum((x < 0) << which for which, x in enumerate((d, v)) if self.kinked[which])

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        guards = []
        for which, x in enumerate((d, v)):
            if self.kinked[which]:
                sign = -1.0 if regime >> which & 1 else 1.0
                function = Slopes(sign * x, sign * (which == 0), sign * (which == 1))
                guards.append(Guard(function, regime ^ 1 << which))
        return guards

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        linear = [self.exponents[i] == 1 and self.exponents[1 - i] == 0 and self.odd[i] for i in (0, 1)]
        return p[0] * linear[0], p[0] * linear[1]

    def fault(self, p: Sequence[float | None]) -> str:
        if p[0] is not None and p[0] < 0 and self.odd == (False, True):
            return "a negative 'a' of a force against the velocity creates energy; give its magnitude"
        return ""


class Cubic(Power):
    """k3 d^3."""

    kind, names, signed, units = "cubic", ("k3",), ("k3",), ("N/m3",)

    def __init__(self) -> None:
        super().__init__(3, 0, ("d",))


class QuadraticDamping(Power):
    """c2 |v| v."""

    kind, names, signed, units = "quadratic_damping", ("c2",), (), ("N.s2/m2",)

    def __init__(self) -> None:
        super().__init__(0, 2, ("v",))

    def fault(self, p: Sequence[float | None]) -> str:
        return "a negative 'c2' creates energy; give its magnitude" if p[0] is not None and p[0] < 0 else ""


class Coulomb(Law):
    """fs tanh(v/v0): dry friction whose jump at rest is spread over some v0."""

    kind, names, units, code, preloaded = "coulomb", ("fs", "v0"), ("N", "m/s"), 5, False

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        ratio = v / p[1]
        tanh = np.tanh(ratio)
        slope = p[0] / p[1] * (1 - tanh**2)
        return Slopes(p[0] * tanh, v=slope, p=(tanh, -slope * ratio))


class Gap(Law):
    """A spring kg, and a damper cg, beyond a clearance."""

    kind, names, units, code = "gap", ("kg", "clearance", "cg"), ("N/m", "m", "N.s/m"), 4

    def __init__(self, side: str = "both") -> None:
        self.sides = {"both": (1, -1), "positive": (1,), "negative": (-1,)}[side]
        self.options = (float(1 in self.sides), float(-1 in self.sides))

    # Regimes: 0 open, 1 and -1 in contact on that side.
    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        if not regime:
            return Slopes(0.0 * d, p=(0.0, 0.0, 0.0))
        kg, clearance, cg = p
        e = d - regime * clearance
        return Slopes(kg * e + cg * v, kg, cg, 0.0, (e, -regime * kg, v))

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        return next((side for side in self.sides if side * d > p[1]), 0)

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        if regime:
            return (Guard(Slopes(regime * d - p[1], float(regime), p=(0.0, -1.0, 0.0)), 0),)
        return tuple(Guard(Slopes(p[1] - s * d, -float(s), p=(0.0, 1.0, 0.0)), s) for s in self.sides)

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        return (p[0], p[2]) if regime else (0.0, 0.0)

    def fault(self, p: Sequence[float | None]) -> str:
        if p[1] is not None and p[1] < 0:
            return "a negative 'clearance' is an interference; give a clearance of 0, and an 'offset'"
        return ""


LAWS: dict[str, type[Law]] = {
    law.kind: law
    for law in (Power, Cubic, QuadraticDamping, Coulomb, Jenkins, Iwan, BoucWen, Gap, ExpressionLaw)
}
"""The laws by their kinds."""
