"""Analogue filters of instruments: high-pass and low-pass, Butterworth or Bessel.

A low-pass of the corner 1 rad/s has the poles p_k and the gain 1 at 0; a high-pass is it at 1/s, with the
poles 1/p_k and the gain 1 at high frequencies. At the corner w, the -3 dB point, they are taken at s/w. Poles
of Bessel filters: W. E. Thomson, Proc. IEE 96-III (1949).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.arrays import Array, ComplexArray

Kind = Literal["high_pass", "low_pass"]
Shape = Literal["butterworth", "bessel"]


class FilterMatrices(NamedTuple):
    """``z' = A z + b y``, output ``c z + d y``, of the corner 1 rad/s; of another one A and b times it."""

    A: Array
    b: Array
    c: Array
    d: float


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
        if self.shape == "bessel":
            from scipy.signal import besselap  # heavy import, of these filters alone

            poles = np.asarray(besselap(self.order, norm="mag")[1], dtype=complex)
        else:
            angles = np.pi * (2 * np.arange(self.order) + self.order + 1) / (2 * self.order)
            poles = np.exp(1j * angles)
        poles = poles if self.kind == "low_pass" else 1 / poles
        upper, real = poles[poles.imag > 1e-9], poles[np.abs(poles.imag) <= 1e-9].real
        return np.concatenate([np.stack([upper, upper.conj()], axis=1).ravel(), real])

    @cached_property
    def matrices(self) -> FilterMatrices:
        """The matrices of the corner 1 rad/s: a cascade of real sections of one or two poles."""
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
        return FilterMatrices(A, b, c, d)

    def response(self, omega: Array, frequency: float) -> tuple[ComplexArray, ComplexArray]:
        """Return the response at frequencies (L), rad/s, and its derivative by the corner `frequency`."""
        s = 1j * omega / frequency
        factors = s[:, None] - self.poles
        n = self.order
        zeros = s**n if self.kind == "high_pass" else np.prod(-self.poles)
        value = zeros / np.prod(factors, axis=1)
        slope = -value * np.sum(1 / factors, axis=1)  # by s
        if self.kind == "high_pass":
            slope = slope + n * s ** (n - 1) / np.prod(factors, axis=1)
        return value, -slope * s / frequency
