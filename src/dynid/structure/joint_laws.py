# ruff: noqa: ARG002, ARG005, D102 - the methods of all laws are those of `Law`, described there
"""Laws of joints: the force over deflection d, its rate v and a hidden state z, in regimes that are smooth.

A law is a class of value, slopes, guards and tangent. Within a regime all its functions are smooth; the
regime ends where a guard is no longer positive. To add a law: write its class, add it to `LAWS`, and its keys
to `scene/schema/joint_laws.py`. The march in C takes the laws that have a `code`, any other the march in
NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from dynid.arithmetic.expression import Expression

Values = Sequence[float]
"""Values of the parameters of a law, in the order of its `names`."""


# Points of a cycle over which work is summed: of smooth laws exact, of others to 1e-3.
_CYCLE_POINTS = 360
# Cycles until a hysteresis loop closes.
_CYCLES = 4


class Slopes(NamedTuple):
    """A function of d, v, z and the parameters, with its derivatives; numbers, or arrays over nodes."""

    value: Any
    d: Any = 0.0
    v: Any = 0.0
    z: Any = 0.0
    p: Sequence[Any] = ()


class Guard(NamedTuple):
    """A function that is positive within a regime, and the regime where it is no longer."""

    function: Slopes
    following: int


class Law:
    """A law without regimes and without a hidden state."""

    kind: ClassVar[str]
    names: tuple[str, ...]  # its parameters
    signed: tuple[str, ...] = ()  # those that may be negative: estimated themselves, not as logarithms
    units: tuple[str, ...] = ()  # of the parameters, over a translation; empty: not known
    code: ClassVar[int] = 0  # the law's number in `native/march.c`; 0: NumPy alone has it
    hidden: ClassVar[bool] = False  # True if it has a hidden state
    preloaded: ClassVar[bool] = True  # True if an offset of the joint shifts its deflection
    remembers: ClassVar[bool] = False  # True if its branches follow Masing's rules: see `nonlinear/memory.py`
    options: tuple[float, ...] = ()  # its numbers that are no parameters, as the march in C takes them
    lowest: ClassVar[Mapping[str, float]] = MappingProxyType({})  # limits of unknowns that may be negative

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        """Return the force on the joint's ends, positive where it resists a positive deflection."""
        raise NotImplementedError

    def rate(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes | None:
        """Return the rate of the hidden state; None where it is constant within the regime."""
        return None

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        """Return the regime in which a motion starts."""
        return 0

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        """Return the guards of a regime."""
        return ()

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        """Return the stiffness and damping of a regime that the march takes into the linear rest."""
        return 0.0, 0.0

    def entered(self, p: Values, before: int, after: int, d: float, z: float) -> Slopes | None:
        """Return the hidden state with which a regime begins; None where it goes on."""
        return None

    def range_of_hidden(self, p: Values, d: float) -> tuple[float, float]:
        """Return centre and half the width of the hidden states that a motion from d may start with."""
        return 0.0, 0.0

    def cycle_work(self, p: Values, amplitude: float, omega: float, offset: float = 0.0) -> float:
        """Return the work that it takes up in a cycle of a steady sine of the deflection, J.

        `amplitude`, m; `omega`, rad/s; `offset`: the mean of the deflection, m.
        """
        angle = 2 * np.pi * (np.arange(_CYCLE_POINTS) + 0.5) / _CYCLE_POINTS
        d, v = offset + amplitude * np.cos(angle), -amplitude * omega * np.sin(angle)
        regimes = np.array([self.regime(p, *pair, 0.0) for pair in zip(d.tolist(), v.tolist(), strict=True)])
        work = 0.0
        for regime in np.unique(regimes).tolist():
            there = regimes == regime
            force = self.force(p, regime, d[there], v[there], np.zeros(int(there.sum())))
            work += float(np.sum(force.value * v[there]))
        return work * 2 * np.pi / (_CYCLE_POINTS * omega)

    def fault(self, p: Sequence[float | None]) -> str:
        """Return why known values (None of unknown ones) make no sense, or an empty text."""
        return ""


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


class Jenkins(Law):
    """A spring kt in series with a slider fs; z is the position of the slider."""

    kind, names, units, code = "jenkins", ("kt", "fs"), ("N/m", "N"), 2
    hidden, preloaded = True, False

    # Regimes: 0 stuck, 1 and -1 slipping forwards and backwards.
    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        kt, fs = p
        if regime:
            return Slopes(regime * fs + 0.0 * d, p=(0.0, float(regime)))
        return Slopes(kt * (d - z), kt, 0.0, -kt, (d - z, 0.0))

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        force = p[0] * (d - z)
        return 0 if abs(force) < p[1] or force * v <= 0 else (1 if force > 0 else -1)

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        if regime:
            return (Guard(Slopes(regime * v, v=float(regime)), 0),)
        kt, fs = p
        e = d - z
        return tuple(Guard(Slopes(fs - s * kt * e, -s * kt, 0.0, s * kt, (-s * e, 1.0)), s) for s in (1, -1))

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        return (0.0 if regime else p[0]), 0.0

    def entered(self, p: Values, before: int, after: int, d: float, z: float) -> Slopes | None:
        if after:
            return None
        kt, fs = p
        return Slopes(d - before * fs / kt, 1.0, p=(before * fs / kt**2, -before / kt))

    def range_of_hidden(self, p: Values, d: float) -> tuple[float, float]:
        return d, p[1] / p[0]

    def cycle_work(self, p: Values, amplitude: float, omega: float, offset: float = 0.0) -> float:
        return 4 * p[1] * max(0.0, amplitude - p[1] / p[0])


class Coulomb(Law):
    """fs tanh(v/v0): dry friction whose jump at rest is spread over some v0."""

    kind, names, units, code, preloaded = "coulomb", ("fs", "v0"), ("N", "m/s"), 5, False

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        ratio = v / p[1]
        tanh = np.tanh(ratio)
        slope = p[0] / p[1] * (1 - tanh**2)
        return Slopes(p[0] * tanh, v=slope, p=(tanh, -slope * ratio))


class Backbone(NamedTuple):
    """The force of first loading over a deflection u >= 0, its slope, and its slopes by the parameters."""

    value: Any
    slope: Any
    p: tuple[Any, ...]


class Iwan(Law):
    """Sliders whose slip forces are distributed: D. J. Segalman, J. Appl. Mech. 72 (2005) 752–760.

    First loading: ``kt u (1 - (u/phi)^(chi+1) / ((1+beta) (chi+2)))`` until all slip at fs, from the
    deflection phi = fs (1+beta) / (kt (beta + (chi+1)/(chi+2))) on. After a reversal Masing's rules hold:
    twice this curve from half the deflection. z is the deflection where the branch began.
    """

    kind, names, signed, code = "iwan", ("kt", "fs", "chi", "beta"), ("chi",), 6
    units = ("N/m", "N", "", "")
    hidden, preloaded, remembers = True, False, True
    lowest = MappingProxyType({"chi": -0.99})

    # Regimes: bit 0, the motion is backwards; bit 1, all slip, or did before; bit 2, since a reversal.
    def slip(self, p: Values) -> tuple[float, tuple[float, ...]]:
        """Return the deflection phi from which on all slip, and its slopes by the parameters."""
        kt, fs, chi, beta = p
        a = chi + 1
        c = beta + a / (a + 1)
        phi = fs * (1 + beta) / (kt * c)
        return phi, (-phi / kt, phi / fs, -phi / ((a + 1) ** 2 * c), phi * (1 / (1 + beta) - 1 / c))

    def backbone(self, p: Values, u: Any) -> Backbone:
        """Return the force of first loading; a deflection beyond the regime continues smoothly."""
        kt, _, chi, beta = p
        phi, by = self.slip(p)
        a, ratio = chi + 1, np.maximum(u, 0.0) / phi
        w = ratio**a / ((1 + beta) * (a + 1))
        log = np.log(np.where(ratio > 0, ratio, 1.0))
        of_w = [-w * a * slope / phi for slope in by]
        of_w[2] = of_w[2] + w * (log - 1 / (a + 1))
        of_w[3] = of_w[3] - w / (1 + beta)
        by_p = [-kt * u * slope for slope in of_w]
        by_p[0] = by_p[0] + u * (1 - w)
        return Backbone(kt * u * (1 - w), kt * (1 - w * (1 + a)), tuple(by_p))

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        s, scale = 1.0 - 2 * (regime & 1), 1.0 + (regime >> 2)
        if regime & 6 == 2:
            return Slopes(s * p[1] + 0.0 * d, p=(0.0, s, 0.0, 0.0))
        f = self.backbone(p, s * (d - z) / scale)
        return Slopes(scale * s * f.value, f.slope, 0.0, -f.slope, tuple(scale * s * slope for slope in f.p))

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        u = d - z
        return int((u or v) < 0) | (2 if abs(u) >= self.slip(p)[0] and u * v > 0 else 0)

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        s = 1.0 - 2 * (regime & 1)
        reversal = Guard(Slopes(s * v, v=s, p=(0.0,) * 4), (regime ^ 1) | 4)
        if regime & 6:
            return (reversal,)
        phi, by = self.slip(p)
        return reversal, Guard(Slopes(phi - s * (d - z), -s, 0.0, s, by), regime | 2)

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        return (0.0 if regime & 6 == 2 else p[0]), 0.0

    def entered(self, p: Values, before: int, after: int, d: float, z: float) -> Slopes | None:
        if before & 6 != 2:
            return None
        s, (phi, by) = 1.0 - 2 * (before & 1), self.slip(p)  # from where first loading would have come
        return Slopes(d - s * phi, 1.0, p=tuple(-s * slope for slope in by))

    def range_of_hidden(self, p: Values, d: float) -> tuple[float, float]:
        return d, self.slip(p)[0]

    def cycle_work(self, p: Values, amplitude: float, omega: float, offset: float = 0.0) -> float:
        kt, fs, chi, beta = p
        phi, a = self.slip(p)[0], chi + 1
        u = min(amplitude, phi)
        work = 4 * kt * u**2 * (u / phi) ** a * a / ((1 + beta) * (a + 1) * (a + 2))
        return float(work + 4 * fs * (amplitude - u))

    def fault(self, p: Sequence[float | None]) -> str:
        if p[2] is not None and p[2] <= -1:
            return "a 'chi' of -1 or less: the sliders have no stiffness together; give more than -1"
        return ""


class BoucWen(Law):
    """kz e with e' = v (1 - alpha |e|^n) for v e > 0, v (1 + delta |e|^n) for v e < 0, in the unit of d.

    z is d - e, as of `Jenkins`: it is constant, and the law linear, where alpha and delta are 0.
    """

    kind, names, signed, code = "bouc_wen", ("kz", "alpha", "delta"), ("alpha", "delta"), 3
    hidden, preloaded = True, False

    def __init__(self, n: float = 1.0) -> None:
        self.n, self.options = float(n), (float(n),)
        self.units = ("N/m", "1/m", "1/m") if n == 1 else ("N/m", f"1/m{n:g}", f"1/m{n:g}")

    # Regimes: bit 0, v is negative; bit 1, e is.
    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        return Slopes(p[0] * (d - z), p[0], 0.0, -p[0], (d - z, 0.0, 0.0))

    def rate(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes | None:
        sign = -1.0 if regime & 2 else 1.0
        base = np.maximum(sign * (d - z), 0.0) if self.n % 1 else sign * (d - z)
        power, slope = base**self.n, sign * self.n * base ** (self.n - 1)
        loading = regime in (0, 3)
        change = p[1] if loading else -p[2]
        by_p = (0.0, v * power, 0.0) if loading else (0.0, 0.0, -v * power)
        return Slopes(v * change * power, v * change * slope, change * power, -v * change * slope, by_p)

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        return (v < 0) | (d < z) << 1

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        of_v, of_e = (-1.0 if regime & 1 else 1.0), (-1.0 if regime & 2 else 1.0)
        elastic = Slopes(of_e * (d - z), d=of_e, z=-of_e)
        return Guard(Slopes(of_v * v, v=of_v), regime ^ 1), Guard(elastic, regime ^ 2)

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        return p[0], 0.0

    def range_of_hidden(self, p: Values, d: float) -> tuple[float, float]:
        return d, (p[1] ** (-1 / self.n) if p[1] > 0 else np.inf)

    def cycle_work(self, p: Values, amplitude: float, omega: float, offset: float = 0.0) -> float:
        def slope(z: float, sign: float) -> float:  # of z over the deflection
            change = -p[1] if z * sign >= 0 else p[2]
            return float(1 + change * abs(z) ** self.n)

        z, work, half = 0.0, 0.0, _CYCLE_POINTS // 2
        step = 2 * amplitude / half
        for cycle in range(2 * _CYCLES):
            sign = 1.0 if cycle % 2 == 0 else -1.0
            work = work if cycle % 2 else 0.0
            for _ in range(half):  # midpoint rule
                middle = z + sign * step / 2 * slope(z, sign)
                z += sign * step * slope(middle, sign)
                work += sign * step * p[0] * middle
        return work

    def fault(self, p: Sequence[float | None]) -> str:
        for name, value in zip(self.names[1:], p[1:], strict=True):
            if value is not None and value < 0:
                return f"a negative '{name}' makes hysteresis loops that create energy; give 0 or more"
        return ""


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


#: Value and derivatives by the operands, from operands and value, of the operations of expressions.
_OPERATIONS: dict[str, tuple[Callable[..., Any], Callable[..., tuple[Any, ...]]]] = {
    "+": (np.add, lambda a, b, y: (1.0, 1.0)),
    "-": (np.subtract, lambda a, b, y: (1.0, -1.0)),
    "*": (np.multiply, lambda a, b, y: (b, a)),
    "/": (np.divide, lambda a, b, y: (1 / b, -y / b)),
    "neg": (np.negative, lambda a, y: (-1.0,)),
    "pos": (np.positive, lambda a, y: (1.0,)),
    "sqrt": (np.sqrt, lambda a, y: (0.5 / y,)),
    "exp": (np.exp, lambda a, y: (y,)),
    "log": (np.log, lambda a, y: (1 / a,)),
    "sin": (np.sin, lambda a, y: (np.cos(a),)),
    "cos": (np.cos, lambda a, y: (-np.sin(a),)),
    "tan": (np.tan, lambda a, y: (1 + y * y,)),
}


class _Dual(NamedTuple):
    """A value, or values at nodes, with derivatives by name."""

    value: Any
    slopes: dict[str, Any]

    @classmethod
    def of(cls, operation: str, operands: Sequence[_Dual]) -> _Dual:
        """Return the result of an operation."""
        x = [operand.value for operand in operands]
        if operation == "**":
            base, exponent = operands
            value = np.power(*x)
            rates: tuple[Any, ...] = (
                x[1] * np.power(x[0], x[1] - 1.0) if base.slopes and np.any(x[1]) else 0.0,
            )
            rates += (value * np.log(x[0]) if exponent.slopes else 0.0,)
        else:
            function, derivatives = _OPERATIONS[operation]
            value = function(*x)
            rates = derivatives(*x, value)
        slopes: dict[str, Any] = {}
        for operand, rate in zip(operands, rates, strict=True):
            for name, slope in operand.slopes.items():
                slopes[name] = slopes.get(name, 0.0) + rate * slope
        return cls(value, slopes)


class ExpressionLaw(Law):
    """An expression of d, v and parameters; where `abs`, `min` or `max` switch, a regime ends."""

    kind = "expression"

    def __init__(self, expression: Expression, names: Sequence[str]) -> None:
        self.expression, self.names = expression, tuple(names)
        self.signed = self.names

    def _fold(self, p: Values, regime: int | None, d: Any, v: Any) -> tuple[_Dual, list[tuple[_Dual, bool]]]:
        """Return value and derivatives, and of each switch the function that is positive on its first branch.

        `regime`: bits of the switches that are on their second branch; None: where they are by themselves.
        """
        switches: list[tuple[_Dual, bool]] = []
        leaves = {"d": d, "v": v, **dict(zip(self.names, p, strict=True))}

        def leaf(item: Any) -> _Dual:
            if not isinstance(item, str):
                return _Dual(float(item), {})
            return _Dual(np.pi, {}) if item == "pi" else _Dual(leaves[item], {item: 1.0})

        def make(operation: str, operands: list[_Dual]) -> _Dual:
            if operation not in ("abs", "min", "max"):
                return _Dual.of(operation, operands)
            chosen = operands[0]
            for other in operands[1:] or [_Dual.of("neg", [chosen])]:
                difference = _Dual.of("-", [chosen, other])
                if operation == "min":
                    difference = _Dual.of("neg", [difference])
                second = bool(difference.value < 0) if regime is None else bool(regime >> len(switches) & 1)
                switches.append((difference, second))
                chosen = other if second else chosen
            return chosen

        with np.errstate(all="raise", under="ignore"):
            return self.expression.fold(leaf, make), switches

    def _slopes(self, dual: _Dual, sign: float = 1.0) -> Slopes:
        d, v, *by_p = (sign * dual.slopes.get(name, 0.0) for name in ("d", "v", *self.names))
        return Slopes(sign * dual.value, d, v, 0.0, by_p)

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        return self._slopes(self._fold(p, regime, d, v)[0])

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        _, switches = self._fold(p, None, d, v)
        return sum(second << index for index, (_, second) in enumerate(switches))

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        _, switches = self._fold(p, regime, d, v)
        return [
            Guard(self._slopes(dual, -1.0 if second else 1.0), regime ^ 1 << index)
            for index, (dual, second) in enumerate(switches)
        ]

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        at_rest = self.force(p, regime, 0.0, 0.0, 0.0)
        return float(at_rest.d), float(at_rest.v)


LAWS: dict[str, type[Law]] = {
    law.kind: law
    for law in (Power, Cubic, QuadraticDamping, Coulomb, Jenkins, Iwan, BoucWen, Gap, ExpressionLaw)
}
"""The laws by their kinds."""


@dataclass(frozen=True)
class BoundLaw:
    """A law with values of its parameters, at a row of deflections of a structure.

    A preload deflects the joint by `offset` at rest; its static force is balanced, so that the force is that
    of the deflection from there. The offset is the last one of the parameters by which a force has slopes.
    """

    law: Law
    values: tuple[float, ...]
    row: int = 0  # its place among the rows of deflections
    offset: float = 0.0

    @property
    def _shift(self) -> float:
        return self.offset if self.law.preloaded else 0.0

    @cached_property
    def static(self) -> Slopes:
        """The force of the preload alone."""
        if not self._shift:
            return Slopes(0.0, p=(0.0,) * len(self.values))
        return self.law.force(
            self.values, self.law.regime(self.values, self._shift, 0.0, 0.0), self._shift, 0.0, 0.0
        )

    def force(self, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        """Return the force, with its slopes by the parameters and by the offset."""
        f, static = self.law.force(self.values, regime, d + self._shift, v, z), self.static
        by_p = [slope - at_rest for slope, at_rest in zip(f.p, static.p, strict=True)]
        return f._replace(value=f.value - static.value, p=(*by_p, (f.d - static.d) * self.law.preloaded))

    def rate(self, regime: int, d: Any, v: Any, z: Any) -> Slopes | None:
        """Return the rate of the hidden state."""
        rate = self.law.rate(self.values, regime, d + self._shift, v, z)
        return None if rate is None else rate._replace(p=(*rate.p, 0.0))

    def guards(self, regime: int, d: Any, v: Any, z: Any) -> list[Guard]:
        """Return the guards of a regime, with slopes as of `force`."""
        guards = self.law.guards(self.values, regime, d + self._shift, v, z)
        none = (0.0,) * len(self.values)
        return [
            guard._replace(function=f._replace(p=(*(f.p or none), f.d * self.law.preloaded)))
            for guard in guards
            for f in (guard.function,)
        ]

    def entered(self, before: int, after: int, d: float, z: float) -> Slopes | None:
        """Return the hidden state with which a regime begins, with slopes as of `force`."""
        hidden = self.law.entered(self.values, before, after, d + self._shift, z)
        return None if hidden is None else hidden._replace(p=(*hidden.p, 0.0))

    def regime(self, d: float, v: float, z: float) -> int:
        """Return the regime in which a motion starts."""
        return self.law.regime(self.values, d + self._shift, v, z)

    def tangent(self, regime: int) -> tuple[float, float]:
        """Return the stiffness and damping of a regime that the march takes into the linear rest."""
        return self.law.tangent(self.values, regime)

    def cycle_work(self, amplitude: float, omega: float) -> float:
        """Return the work that the law takes up in a cycle of a steady sine about the offset, J."""
        return self.law.cycle_work(self.values, amplitude, omega, self._shift)

    @property
    def at_rest(self) -> tuple[float, float]:
        """Stiffness and damping for small motions about rest."""
        regime = self.regime(0.0, 0.0, 0.0)
        if self.law.hidden:
            return self.tangent(regime)
        f = self.force(regime, 0.0, 0.0, 0.0)
        return float(f.d), float(f.v)
