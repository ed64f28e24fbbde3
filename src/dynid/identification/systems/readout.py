"""Outputs of a model as its channels record them: at its own times, or at those of clocks of their own.

Between two nodes of a timeline, state and generators of the inputs follow one exponential, so that an output
is an entire function of the time since the node. It is interpolated there in Chebyshev polynomials, whose
coefficients are rows of the state and the generators at the node, by exact steps to the Chebyshev points. So
a record is propagated once over its timeline, for any number of clocks, and at whatever rates. The degree is
raised until the last coefficients are rounding; these bound the error of the interpolation (L. N. Trefethen,
Approximation Theory and Approximation Practice, 2013, chapters 8 and 16). Derivatives by clocks and delays
are the rates of the outputs times those of the instants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self
from weakref import WeakKeyDictionary

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.systems.parametric_model import DirectTerm, ParametricModel
from dynid.lti.exponential import exponential
from dynid.parameters import named, rates

# Degrees that are tried; last coefficients below this part of the largest are rounding.
_DEGREES, _COEFFICIENT_TOL = (9, 13, 19, 28, 42, 63, 95, 143), 1e-11
_TURNED: WeakKeyDictionary[ParametricModel, dict[tuple[int, float], list[Array]]] = WeakKeyDictionary()
# Part of an interval within which an instant is at its end: round-off.
_NODE_TOL = 1e-9


@dataclass(frozen=True, eq=False)
class Readout:
    """Rows of the state at the nodes of a timeline, from which channels are read out.

    `C` (rows x n), `C_slopes` (p x rows x n) and `direct`: the outputs at the nodes, one row a channel; of
    channels with clocks of their own the Chebyshev coefficients of each.
    """

    model: ParametricModel
    channels: slice
    C: Array
    C_slopes: Array
    direct: DirectTerm

    @classmethod
    def of(cls, model: ParametricModel, eta: Array, channels: slice) -> Readout:
        """Return the rows of channels at coordinates `eta` (p)."""
        if model.instruments.clocked:
            return _ClockedReadout.at(model, eta, channels)
        C, C_slopes = model.output(eta)
        return cls(model, channels, C[channels], C_slopes[:, channels], model.direct(eta, channels))

    def gathered(self, values: Array) -> Array:
        """Return values at the nodes (nodes x rows x …) as channels record them (times x channels x …)."""
        return self.model.gathered(values)

    def by_parameter(self, slopes: Array, outputs: Array) -> Array:  # noqa: ARG002 - rates are of clocks
        """Return derivatives (nodes x rows x p) of the rows' `outputs` as the channels record them."""
        return self.gathered(slopes)


@dataclass(frozen=True, eq=False)
class _ClockedReadout(Readout):
    """Rows of channels with clocks of their own."""

    nodes: NDArray[np.int64]  # node before each sample (times x channels)
    # `weights`, `rate_weights`: of the coefficients in each sample, and in its rate (times x channels x d)
    weights: Array
    rate_weights: Array
    slopes: Array  # derivatives of the instants by the coordinates (p x times x channels)

    @classmethod
    def at(cls, model: ParametricModel, eta: Array, channels: slice) -> Self:
        """Return the rows of channels at coordinates `eta` (p)."""
        line, at = model.line, named(model.unknowns, eta)
        instants = model.instruments.instants(model.times, at)
        length = float(np.diff(line.nodes).max())
        C, C_slopes, R, R_slopes = _coefficients(model, eta, channels, length)
        value, rate = instants.value[:, channels], rates(model.unknowns, eta)
        nodes = np.clip(np.searchsorted(line.nodes, value, side="right") - 1, 0, len(line.nodes) - 2)
        nodes += value - line.nodes[nodes + 1] > -_NODE_TOL * length
        passed = 2 / length * (value - line.nodes[nodes]) - 1
        degree = C.shape[1] - 1
        polynomials = np.asarray(chebyshev.chebvander(passed, degree), dtype=float)
        # Of each polynomial, in the others.
        derivative = np.asarray(chebyshev.chebder(np.eye(degree + 1)), dtype=float) * (2 / length)
        value_of_inputs, slopes_of_inputs = _direct(model, eta, channels, R, R_slopes)
        return cls(
            model,
            channels,
            C.reshape(-1, C.shape[-1]),
            C_slopes.reshape(len(eta), -1, C.shape[-1]),
            DirectTerm(value_of_inputs, slopes_of_inputs),
            nodes,
            polynomials,
            polynomials[..., :degree] @ derivative,
            instants.slopes[:, :, channels] * rate[:, None, None],
        )

    def gathered(self, values: Array) -> Array:
        """Return values at the nodes (nodes x rows x …) as channels record them (times x channels x …)."""
        return self._summed(self.weights, values)

    def by_parameter(self, slopes: Array, outputs: Array) -> Array:
        """Return derivatives (nodes x rows x p) of the rows' `outputs` as the channels record them."""
        rate = self._summed(self.rate_weights, outputs)
        return self.gathered(slopes) + rate[..., None] * np.moveaxis(self.slopes, 0, -1)

    def _summed(self, weights: Array, values: Array) -> Array:
        channels, terms = weights.shape[1:]
        values = values.reshape(len(values), channels, terms, *values.shape[2:])
        columns = [
            np.einsum("td,td...->t...", weights[:, c], values[self.nodes[:, c], c]) for c in range(channels)
        ]
        return np.stack(columns, axis=1)


def _coefficients(
    model: ParametricModel, eta: Array, channels: slice, length: float
) -> tuple[Array, Array, Array, Array]:
    """Return coefficients of channels over an interval (channels x d x n), and by generators (… x q).

    Each is followed by its derivatives by the coordinates (p x …). Raises UsageError if the model is too fast
    for the interval.
    """
    matrices, n = model.at(eta), model.states
    C, C_slopes = matrices.C[channels], matrices.C_slopes[:, channels]
    D, D_slopes = matrices.D[:, channels], matrices.D_slopes[:, :, channels]
    readout = model.line.H * model.acting[:, None] * model.w_scale
    inputs = np.stack([readout @ np.linalg.matrix_power(model.line.G, order) for order in range(len(D))])
    through = np.einsum("kcl,klq->cq", D, inputs)
    through_slopes = np.einsum("pkcl,klq->pcq", D_slopes, inputs)
    fastest = float(np.abs(model.poles(eta)).max(initial=0.0))
    for degree in [degree for degree in _DEGREES if _may_resolve(degree, fastest * length / 2)]:
        points = chebyshev.chebpts1(degree + 1)
        fit = chebyshev.chebvander(points, degree).T * (2 / (degree + 1))
        fit[0] /= 2
        values, moved = [], []
        passed = ((points + 1) * (length / 2)).tolist()
        for h, turned in zip(passed, _turned(model, passed), strict=True):
            step, derivatives = model.transition(eta, h)
            row = C @ step
            row[:, n:] += through @ turned
            slope = C_slopes @ step + C @ derivatives
            slope[:, :, n:] += through_slopes @ turned
            values.append(row)
            moved.append(slope)
        rows = np.einsum("kd,dcx->ckx", fit, np.stack(values))
        if all(_is_resolved(part) for part in (rows[..., :n], rows[..., n:])):
            slopes = np.einsum("kd,dpcx->pckx", fit, np.stack(moved))
            return rows[..., :n], slopes[..., :n], rows[..., n:], slopes[..., n:]
    raise UsageError(
        f"a motion of the model is too fast for channels with clocks of their own: {fastest:.3g} rad/s, and "
        f"the record's step is {length:.3g} s",
        remedy="Reduce the structure (reduction), or shorten the step of the record.",
        names=("measurement.step", "step"),
    )


def _may_resolve(degree: int, phase: float) -> bool:
    """Return False if sines of half this phase over an interval have larger last coefficients, J_n(phase)."""
    last = (degree - 1) * math.log(max(phase, 1e-300) / 2) - math.lgamma(degree)
    return degree == _DEGREES[-1] or last < math.log(_COEFFICIENT_TOL)


def _turned(model: ParametricModel, passed: Sequence[float]) -> list[Array]:
    """Return the exponentials of the inputs' generators over times, kept with the model."""
    kept = _TURNED.setdefault(model, {})
    key = (len(passed), passed[-1])
    if key not in kept:
        kept[key] = [exponential(model.line.G, h) for h in passed]
    return kept[key]


def _is_resolved(rows: Array) -> bool:
    """Return True if the last coefficients (channels x d x …) are rounding beside the largest."""
    size = np.abs(rows).max(axis=2, initial=0.0)
    return bool(np.all(size[:, -2:] <= _COEFFICIENT_TOL * size.max(axis=1, keepdims=True, initial=0.0)))


def _direct(
    model: ParametricModel, eta: Array, channels: slice, R: Array, R_slopes: Array
) -> tuple[Array, Array | None]:
    """Return what inputs and offsets add to the coefficients at the nodes, and its derivatives."""
    instruments, d = model.instruments, R.shape[1]
    offset, change = instruments.numbers(instruments.offsets, named(model.unknowns, eta))
    change = change * rates(model.unknowns, eta)[:, None]
    value = model.W @ R.reshape(-1, R.shape[-1]).T
    value[:, ::d] += offset[channels]  # the constant polynomial
    if not (R_slopes.any() or change.any()):
        return value, None
    slopes = model.W @ R_slopes.reshape(len(eta), -1, R.shape[-1]).swapaxes(1, 2)
    slopes[:, :, ::d] += change[:, None, channels]
    return value, slopes
