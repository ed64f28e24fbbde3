"""The outcome of an identification in words: whether it converged, and what to be wary of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.identification.diagnostics import is_coloured, root_mean_square, whiteness
from dynid.identification.residuals import Consistency, spectrum

Array = NDArray[np.float64]

# What is worth a warning: a correlation, a standard error of a logarithm, an error in standard errors, a part
# of the samples that are missing or stand at the channel's extreme.
_TOGETHER, _VAGUE, _OFF, _GAPS, _CLIPPED = 0.95, 0.5, 5.0, 0.2, 0.01
# How many deviations a prior and a record are apart that contradict each other: by chance one in 16,000.
CONTRADICTED = 4.0
# Residuals below this part of the signal are rounding and holds, whatever their colour.
_ROUNDING = 1e-6
# With fewer values than this beyond the unknowns the noise that they tell is off by a quarter, as a rule.
_LEAST_SPARE = 10
# A channel that takes so few values is no motion that could be clipped.
_LEAST_SAMPLES = 50


class Sensor(NamedTuple):
    """A channel of a record: `name`, `measured` values and `residual` (times), sampling `step`, s."""

    name: str
    measured: Array
    residual: Array
    step: float


class Facts(NamedTuple):
    """What the words are about.

    Parameters `names` with their `deviations` (of the logarithms), `correlation`, and `errors` of the
    estimates in bounds (NaN where the truth is not known); the `sensors`; the filter's `consistency`, if it
    is known; how many values are left to tell the noise by, beyond the unknowns, where it is not given; and
    how far priors and record are apart, in deviations of that distance (0 without a prior).
    """

    names: Sequence[str]
    deviations: Array
    correlation: Array
    errors: Array
    sensors: Sequence[Sensor]
    consistency: Consistency | None = None
    spare: int | None = None
    conflict: Array | None = None


def verdict(names: Sequence[str], distance: Array, *, settled: bool, explained: bool) -> str:
    """Say whether an estimate has converged, and if not, why.

    Parameters
    ----------
    names
        The parameters (p).
    distance
        Their distances to the optimum of the record, in standard errors (p).
    settled, explained
        Whether the estimate is at the optimum, and whether the residuals are small or noise.
    """
    reasons = []
    if not settled:
        k = int(np.argmax(distance))
        reasons.append(f"{distance[k]:.2g} standard errors of {names[k]} from the optimum")
    if not explained:
        reasons.append("the residuals are not noise")
    return f"NOT converged: {', and '.join(reasons)}" if reasons else "converged"


def warnings(facts: Facts) -> list[str]:
    """Return what to be wary of, in words; nothing where all is well."""
    return [
        *_of_priors(facts),
        *_of_parameters(facts),
        *_of_residuals(facts),
        *_of_record(facts),
        *_of_filter(facts),
    ]


def _of_priors(facts: Facts) -> Iterator[str]:
    for name, apart in zip(facts.names, () if facts.conflict is None else facts.conflict, strict=False):
        if apart > CONTRADICTED:
            yield (
                f"the prior of {name} and the record contradict each other ({apart:.2g} deviations apart): "
                "correct its value, or give it a larger relative_deviation"
            )


def _of_parameters(facts: Facts) -> Iterator[str]:
    for k, name in enumerate(facts.names):
        if facts.errors[k] > _OFF:
            yield f"{name} is {facts.errors[k]:.2g} bounds off its true value"
        if facts.deviations[k] > _VAGUE:
            yield f"{name} is hardly known: its standard error is {100 * facts.deviations[k]:.0f} % of it"
        for other in range(k):
            rho = facts.correlation[k, other]
            if abs(rho) > _TOGETHER:
                shown = "ratio" if rho > 0 else "product"
                yield (
                    f"{facts.names[other]} and {name} are hardly told apart (correlation {rho:.3f}): "
                    f"the record knows their {shown} better than either"
                )


def _of_residuals(facts: Facts) -> Iterator[str]:
    """Say of which channels the residuals are no noise, and at what frequency most of them is."""
    for sensor in facts.sensors:
        residual = sensor.residual[:, None]
        part = float(root_mean_square(residual)[0] / root_mean_square(sensor.measured[:, None])[0])
        if part < _ROUNDING or not is_coloured(whiteness(residual)):
            continue
        omega, density = spectrum(residual, sensor.step)
        peak = omega[int(np.argmax(density[:, 0]))]
        yield (
            f"the residual of {sensor.name} ({100 * part:.2g} % of the signal) is no white noise; "
            f"it is strongest at {peak:.3g} rad/s"
        )


def _of_record(facts: Facts) -> Iterator[str]:
    if facts.spare is not None and facts.spare < _LEAST_SPARE:
        left = "1 value is" if facts.spare == 1 else f"{facts.spare} values are"
        yield f"{left} left to tell the noise by, beyond the unknowns: standard errors are rough"
    for name, values, *_ in facts.sensors:
        there = values[~np.isnan(values)]
        if len(there) < (1 - _GAPS) * len(values):
            yield f"{name} has {100 * (1 - len(there) / len(values)):.0f} % of its samples missing"
        extreme = max(np.count_nonzero(there == there.min()), np.count_nonzero(there == there.max()))
        if len(there) >= _LEAST_SAMPLES and extreme > max(2, _CLIPPED * len(there)):
            yield f"{name} stands at its extreme value in {extreme} samples: it may be clipped"


def _of_filter(facts: Facts) -> Iterator[str]:
    found = facts.consistency
    if found is not None and not found.consistent:
        size = "larger" if found.overall > 1 else "smaller"
        yield (
            f"the filter's innovations are {size} than it takes them for: mean square {found.overall:.3g}, "
            f"{found.overall_low:.3g} … {found.overall_high:.3g} expected"
        )
