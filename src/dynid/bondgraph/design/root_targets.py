"""Distances of zeros and poles from where they are wanted, with derivatives.

A pair of roots counts by its natural frequency sqrt(a b) and its damping ratio -(a + b)/(2 sqrt(a b)), which
stay smooth where the pair becomes real.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.design.request import RootTarget

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Imaginary parts below this part of a root are those of a real one.
_REAL = 1e-9
#: Cost of a target that no root can meet.
_MISSING = 1e12


class Reached(NamedTuple):
    """The root that is nearest to a target: frequency, damping ratio, and its residuals.

    Attributes
    ----------
    frequency, damping
        Natural frequency, rad/s, and damping ratio.
    residuals
        Logarithm of the frequency over the wanted one, and the difference of the damping ratios where one is
        wanted; of a real root its distance over the wanted one (1 or 2).
    slopes
        Derivatives of the residuals (1 or 2 x p).
    """

    frequency: float
    damping: float
    residuals: Array
    slopes: Array


def residual_count(target: RootTarget) -> int:
    """Return how many equations a target is."""
    return 1 if target.damping is None or abs(target.damping) == 1 else 2


def nearest(
    targets: Sequence[RootTarget], values: ComplexArray, slopes: ComplexArray
) -> list[Reached | None]:
    """Return the nearest root of each target, a different one of each; None where there is none.

    Parameters
    ----------
    targets
        Wanted zeros or poles of one channel.
    values, slopes
        Its roots (m), and their derivatives (m x p).
    """
    from scipy.optimize import linear_sum_assignment

    options = [_candidates(target, values, slopes) for target in targets]
    if len(targets) == 1:
        found = list(options[0].values())
        return [min(found, key=_distance) if found else None]
    keys = list(dict.fromkeys(key for one in options for key in one))
    costs = np.full((len(targets), len(keys) + len(targets)), _MISSING)
    for row, one in enumerate(options):
        for key, reached in one.items():
            costs[row, keys.index(key)] = min(_distance(reached), _MISSING)
    columns = linear_sum_assignment(costs)[1]
    return [
        one.get(keys[column]) if column < len(keys) else None
        for one, column in zip(options, columns, strict=True)
    ]


def _distance(reached: Reached) -> float:
    return float(reached.residuals @ reached.residuals)


def _candidates(
    target: RootTarget, values: ComplexArray, slopes: ComplexArray
) -> dict[tuple[int, ...], Reached]:
    """Return what could meet a target, by the places of its roots."""
    real = np.abs(values.imag) <= _REAL * np.abs(values)
    found: dict[tuple[int, ...], Reached] = {}
    if target.damping is not None and abs(target.damping) == 1:
        wanted = target.value.real
        for k in np.flatnonzero(real & (values != 0)).tolist():
            value = values[k].real
            residual = np.array([value / wanted - 1])
            damping = -math.copysign(1.0, value)
            found[k,] = Reached(abs(value), damping, residual, slopes[k : k + 1].real / wanted)
        return found
    for k in np.flatnonzero(~real & (values.imag > 0)).tolist():
        z, change = values[k], slopes[k]
        by_log = np.real(z.conjugate() * change) / abs(z) ** 2
        found[k,] = _reached(target, abs(z), -z.real / abs(z), by_log, -change.real / abs(z))
    if target.damping is not None:
        for pair in combinations(np.flatnonzero(real & (values != 0)).tolist(), 2):
            a, b = values[list(pair)].real
            if a * b > 0:
                size, moved = math.sqrt(a * b), slopes[list(pair)].real
                by_log = (moved[0] / a + moved[1] / b) / 2
                found[pair] = _reached(
                    target, size, -(a + b) / (2 * size), by_log, -moved.sum(axis=0) / 2 / size
                )
    return found


def _reached(target: RootTarget, size: float, damping: float, by_log: Array, by_sum: Array) -> Reached:
    """Return a root with its residuals; `by_sum` is the derivative of -(a + b) over 2 sqrt(a b)."""
    residuals, slopes = [math.log(size / target.frequency)], [by_log]
    if target.damping is not None:
        residuals.append(damping - target.damping)
        slopes.append(by_sum - damping * by_log)
    return Reached(size, damping, np.array(residuals), np.array(slopes))
