"""Analogue filters of instruments: high-pass and low-pass, Butterworth or Bessel, and integrators.

A low-pass of the corner 1 rad/s has the poles p_k and the gain 1 at 0; a high-pass is it at 1/s, with the
poles 1/p_k and the gain 1 at high frequencies. At the corner w, the -3 dB point, they are taken at s/w. Poles
of Bessel filters: W. E. Thomson, Proc. IEE 96-III (1949). An integrator is (s + w)^-n: below its corner,
which may be 0, it does not integrate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.arrays import Array, ComplexArray

Kind = Literal["high_pass", "low_pass", "integrator"]
Shape = Literal["butterworth", "bessel"]


class _FilterMatrices(NamedTuple):
    """``z' = A z + b y``, output ``c z + d y``, and derivatives of A and b by the corner."""

    A: Array
    b: Array
    c: Array
    d: float
    dA: Array
    db: Array


@dataclass(frozen=True)
class Filter:
    """A filter of a channel; its corner, rad/s, may depend on parameters."""

    kind: Kind
    frequency: Real
    order: int = 1
    shape: Shape = "butterworth"

    @cached_property
    def poles(self) -> ComplexArray:
        """The poles of the corner 1 rad/s, pairs side by side."""
        if self.kind == "integrator":
            return -np.ones(self.order, dtype=complex)
        if self.shape == "bessel":
            from scipy.signal import besselap  # heavy import, of these filters alone

            poles = np.asarray(besselap(self.order, norm="mag")[1], dtype=complex)
        else:
            angles = np.pi * (2 * np.arange(self.order) + self.order + 1) / (2 * self.order)
            poles = np.exp(1j * angles)
        poles = poles if self.kind == "low_pass" else 1 / poles
        upper, real = poles[poles.imag > 1e-9], poles[np.abs(poles.imag) <= 1e-9].real
        return np.concatenate([np.stack([upper, upper.conj()], axis=1).ravel(), real])

    def matrices(self, frequency: float) -> _FilterMatrices:
        """Return the matrices at the corner `frequency`, rad/s."""
        n = self.order
        if self.kind == "integrator":
            first, last = np.eye(1, n)[0], np.eye(1, n, n - 1)[0]
            return _FilterMatrices(
                np.eye(n, k=-1) - frequency * np.eye(n), first, last, 0.0, -np.eye(n), np.zeros(n)
            )
        A, b, c, d = self._sections
        return _FilterMatrices(frequency * A, frequency * b, c, d, A, b)

    @cached_property
    def _sections(self) -> tuple[Array, Array, Array, float]:
        """The matrices A, b, c, d of the corner 1 rad/s: a cascade of real sections of one or two poles."""
        n, high = self.order, self.kind == "high_pass"
        A, b, c, d = np.zeros((n, n)), np.zeros(n), np.zeros(n), 1.0
        at = 0
        while at < n:
            pole, size = complex(self.poles[at]), 2 if self.poles[at].imag else 1
            here = slice(at, at + size)
            if size == 2:
                block, into = (
                    np.array([[0.0, abs(pole)], [-abs(pole), 2 * pole.real]]),
                    np.array([0.0, abs(pole)]),
                )
                out = np.array([-1.0, 2 * pole.real / abs(pole)]) if high else np.array([1.0, 0.0])
            else:
                block, into = np.array([[pole.real]]), np.array([-pole.real])
                out = np.array([-1.0 if high else 1.0])
            through = 1.0 if high else 0.0
            A[here, here], A[here, :at] = block, np.outer(into, c[:at])
            b[here] = into * d
            c = through * c
            c[here], d = out, through * d
            at += size
        return A, b, c, d

    def response(self, omega: Array, frequency: float) -> tuple[ComplexArray, ComplexArray]:
        """Return the response at frequencies (L), rad/s, and its derivative by the corner `frequency`."""
        if self.kind == "integrator":
            value = np.asarray((1j * omega + frequency) ** -float(self.order), dtype=complex)
            return value, -self.order * value / (1j * omega + frequency)
        s = 1j * omega / frequency
        factors = s[:, None] - self.poles
        n = self.order
        zeros = s**n if self.kind == "high_pass" else np.prod(-self.poles)
        value = zeros / np.prod(factors, axis=1)
        slope = -value * np.sum(1 / factors, axis=1)  # by s
        if self.kind == "high_pass":
            slope = slope + n * s ** (n - 1) / np.prod(factors, axis=1)
        return value, -slope * s / frequency
