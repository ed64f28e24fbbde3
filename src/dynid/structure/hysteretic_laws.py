# ruff: noqa: ARG002, D102 - the methods of all laws are those of `Law`, described there
"""Laws of joints with memory: slider and spring (Jenkins), distributed sliders (Iwan), Bouc and Wen."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from dynid.structure.law import CYCLE_POINTS, Guard, Law, Slopes, Values

# Cycles until a hysteresis loop closes.
_CYCLES = 4


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

        z, work, half = 0.0, 0.0, CYCLE_POINTS // 2
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
