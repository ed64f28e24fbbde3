"""Signals known by samples, continued between them by a hold."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.defaults import HOLD
from dynid.errors import UsageError
from dynid.lti.generator import Array, SmoothSignal, polynomial_generator, require, require_finite

HOLDS = ("spline", "linear", "zero")


@dataclass(frozen=True, eq=False)
class Sampled(SmoothSignal):
    """A signal known by its samples, continued between them by a hold.

    Parameters
    ----------
    values
        Samples, at ``start + k step``.
    step
        Sampling step, s.
    hold
        ``spline``: cubic, not-a-knot ends; ``linear``; ``zero``: constant until the next sample.
    start
        Time of the first sample, s.
    """

    kind: ClassVar[str] = "file"

    values: ArrayLike
    step: float
    hold: str = HOLD.value
    start: float = 0.0

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        require(values.ndim == 1, "a sampled signal needs one column of values", names=("file", "column"))
        require(
            self.hold in HOLDS,
            f"a sampled signal has no hold {self.hold!r}",
            f"Use one of {', '.join(HOLDS)}.",
            ("file", "hold"),
        )
        require(
            len(values) >= (1 if self.hold == "zero" else 2),
            "a sampled signal needs two samples or more",
            names=("file", "path", "samples"),
        )
        require(0 < self.step < math.inf, "a sampled signal's step must be positive", names=("file", "step"))
        require_finite("file", start=self.start, values=values)
        object.__setattr__(self, "values", values)

    @cached_property
    def _coefficients(self) -> Array:
        return hold_coefficients(np.asarray(self.values), self.hold)

    @property
    def stop(self) -> float:
        """Time up to which the signal is known, s."""
        return self.start + len(self._coefficients) * self.step

    def generator(self) -> tuple[Array, Array]:
        """Return G and h of the hold's polynomial."""
        return polynomial_generator(self._coefficients.shape[1] - 1, self.step)

    def states(self, times: Array, middles: Array) -> Array:
        """Return the scaled derivatives (step^j times the j-th) of the pieces that hold `middles`."""
        c = self._coefficients
        place = (middles - self.start) / self.step
        if np.any((place < -1e-6) | (place > len(c) + 1e-6)):
            raise UsageError(
                f"a sampled signal is known from {self.start:g} s to {self.stop:g} s only",
                remedy="Give samples for the whole response, or end it earlier.",
                names=("file", "path"),
            )
        piece = np.clip(np.floor(place + 1e-9).astype(int), 0, len(c) - 1)
        s = (times - self.start) / self.step - piece
        s = np.where(np.abs(s) < 1e-9, 0.0, s)  # a knot, to rounding
        return shifted_polynomials(c[piece], s)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the sampling times in [start, stop]."""
        first = max(0, math.ceil((start - self.start) / self.step - 1e-9))
        last = min(len(self._coefficients), math.floor((stop - self.start) / self.step + 1e-9))
        return np.asarray(self.start + np.arange(first, last + 1) * self.step)


def hold_coefficients(values: Array, hold: str) -> Array:
    """Return the polynomial of every piece of a hold.

    Parameters
    ----------
    values
        Samples, one step apart.
    hold
        ``spline`` (cubic, not-a-knot ends), ``linear`` or ``zero``.

    Returns
    -------
    Array
        Coefficients (pieces x ascending powers of the fraction s of the step, 0 <= s <= 1); the zero
        hold continues the last sample for one step more, the others end at it.
    """
    if hold == "zero":
        return values[:, None].copy()
    rise = np.diff(values)
    if hold == "linear":
        return np.stack([values[:-1], rise], axis=1)
    n = len(values)
    if n < 4:  # one polynomial through all points
        p = np.polynomial.Polynomial.fit(np.arange(n), values, n - 1).deriv()
        slope = np.asarray(p(np.arange(n)))
    else:
        from scipy.linalg import solve_banded

        # Interior rows: curvature is continuous; end rows: so is the third derivative one knot inside.
        band = np.ones((3, n))
        band[1, 1:-1] = 4.0
        band[0, 1] = band[2, -2] = 2.0
        rhs = np.empty(n)
        rhs[1:-1] = 3 * (values[2:] - values[:-2])
        rhs[0] = (-5 * values[0] + 4 * values[1] + values[2]) / 2
        rhs[-1] = (5 * values[-1] - 4 * values[-2] - values[-3]) / 2
        slope = np.asarray(solve_banded((1, 1), band, rhs))
    left, right = slope[:-1], slope[1:]  # per step
    return np.stack([values[:-1], left, 3 * rise - 2 * left - right, left + right - 2 * rise], axis=1)


def shifted_polynomials(c: Array, s: Array) -> Array:
    """Return the derivatives of ``sum_j c_j s^j`` (rows x orders) at s."""
    out = np.zeros_like(c)
    degree = c.shape[1] - 1
    for order in range(degree + 1):
        for power in range(degree, order - 1, -1):
            out[:, order] = out[:, order] * s + c[:, power] * math.perm(power, order)
    return out
