"""Error of a reduced model apart from the noise: estimates that the full model would give.

From the estimate, the full model (or, of a large one, a basis three times the size) is fitted to the same
records by two Gauss–Newton steps. Their sum is the error of the estimates by the reduction; the standard
errors for the residual noise then are the errors by the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.statistics import root_mean_square
from dynid.parameters import Parameter, named, rates, values
from dynid.result import Result, common_unit
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.state_space import without_massless

# Most DOFs of a full model as the reference; of a larger one so many times the reduced coordinates.
_MAX_REFERENCE_DOFS, _FINER = 48, 3
# Shifts below this part of a parameter cause no warning, whatever the noise.
_NEGLIGIBLE_SHIFT = 1e-5
# Longest step of a coordinate for which the first order is valid.
_MAX_LINEAR_STEP = 0.5


@dataclass(frozen=True, eq=False)
class ModelError:
    """The effect of a reduction on the estimates."""

    reference: str  # description of the reference model
    unknowns: tuple[Parameter, ...]  # the unknown parameters (p)
    estimate: Array  # their estimates with the reduced model (p)
    coordinates: Array  # their coordinates (p)
    # Two Gauss–Newton steps of the coordinates from there towards the optimum with the reference (p).
    shift: Array
    noise: Array  # standard deviations of the coordinates by the noise (p)
    # RMS of the difference of the predictions over that of the measured values (channels of all records).
    response: Array
    # `omega`, `reference_omega`: natural frequencies of both at the estimate (modes), rad/s
    omega: Array
    reference_omega: Array

    @property
    def dominant(self) -> NDArray[np.bool_]:
        """Mask of estimates (p) whose error by the reduction exceeds that by the noise."""
        return np.asarray(np.abs(self.shift) > np.maximum(self.noise, _NEGLIGIBLE_SHIFT))

    @property
    def warning(self) -> str:
        """Warning about the reduction; empty where the error by the noise is larger."""
        if not self.dominant.any():
            return ""
        k = int(np.argmax(np.abs(self.shift) / np.maximum(self.noise, _NEGLIGIBLE_SHIFT)))
        name, unknown = self.unknowns[k].name, self.unknowns[k]
        moved, rate = self.shifted[k] - self.estimate[k], rates(self.unknowns, self.coordinates)[k]
        if (
            np.abs(self.shift / [unknown.first_spread / 2 for unknown in self.unknowns]).max()
            >= _MAX_LINEAR_STEP
        ):
            effect = f"the estimates with the {self.reference} are far from these"
        else:
            way = "higher" if moved > 0 else "lower"
            size, left, mark = abs(moved), rate * self.noise[k], f" {unknown.unit}".rstrip()
            if self.estimate[k]:
                size, left, mark = (
                    100 * size / abs(self.estimate[k]),
                    100 * left / abs(self.estimate[k]),
                    " %",
                )
            effect = f"with the {self.reference} {name} is {size:.2g}{mark} {way}"
            effect += f" (standard error with that model: {left:.2g}{mark})"
        return f"the error of the reduced model dominates: {effect}"

    @property
    def shifted(self) -> Array:
        """The estimates with the reference (p)."""
        return values(self.unknowns, self.coordinates + self.shift)

    def add_to(self, result: Result, channels: list[str]) -> None:
        """Add it as ``identification/model_error``; `channels` are the names of all records' channels."""
        group, dims = "identification/model_error", ("parameter",)
        unit = common_unit(unknown.unit for unknown in self.unknowns)
        names, modes = [unknown.name for unknown in self.unknowns], np.arange(1, len(self.omega) + 1)
        result.add_axes(group, parameter=names, channel=channels, mode=modes)
        units = [unknown.unit for unknown in self.unknowns]
        result.add_all(group, dims, unit=units, dominant=self.dominant)
        noise = rates(self.unknowns, self.coordinates) * self.noise
        result.add_all(group, dims, unit, shift=self.shifted - self.estimate, noise_error=noise)
        result.add(f"{group}/response_error", self.response, ("channel",))
        result.add(f"{group}/frequency", self.omega, ("mode",), "rad/s")
        result.add(f"{group}/frequency_error", self.omega / self.reference_omega - 1, ("mode",))
        result.add_all(group, reference=self.reference, warning=self.warning)


def model_error(
    model: StructuralModel,
    likelihood: Likelihood,
    fit: Fit,
    dofs: list[Label],
    refitted: Callable[[StructuralModel], Likelihood],
) -> ModelError:
    """Compare a reduced model with the full one, at the estimate.

    `model`: the reduced model; `likelihood`, `fit`: the records with it, and their fit at the estimate.
    `dofs`: DOFs of loads and sensors; `refitted`: returns the records with another model.
    """
    assert model.basis is not None
    unknowns = likelihood.unknowns
    at = named(unknowns, fit.eta)
    finer, words = _reference(model, model.basis.parent, dofs, at)
    reference = refitted(finer)
    reference_fit = reference.fit(fit.eta)
    shift = _step(reference, reference_fit)
    # The second step; the residual there is noise.
    nearer = reference.fit(fit.eta + shift)
    fits = zip(fit.parts, reference_fit.parts, likelihood.records, strict=True)
    response = [
        root_mean_square(a.predicted.outputs - b.predicted.outputs) / record.data.rms for a, b, record in fits
    ]
    omega = _frequencies(model, at, None)
    return ModelError(
        words,
        unknowns,
        values(unknowns, fit.eta),
        fit.eta,
        shift + _step(reference, nearer),
        reference.information(nearer, _noise(reference, nearer)).deviations(),
        np.concatenate(response),
        omega,
        _frequencies(model.basis.parent, at, len(omega)),
    )


def _noise(likelihood: Likelihood, fit: Fit) -> list[Array]:
    """Return the residual noise, not below rounding."""
    fits = zip(fit.parts, likelihood.records, strict=True)
    return [
        np.maximum(record_fit.noise, np.finfo(float).eps * record.data.rms) for record_fit, record in fits
    ]


def _step(likelihood: Likelihood, fit: Fit) -> Array:
    """Return the Gauss–Newton step of the coordinates, no longer than is valid to first order."""
    noise = _noise(likelihood, fit)
    step = likelihood.information(fit, noise).step(likelihood.weighted(fit, noise))
    length = float(np.abs(step / likelihood.priors.units).max(initial=_MAX_LINEAR_STEP))
    return np.asarray(step * min(1.0, _MAX_LINEAR_STEP / length))


def _reference(
    model: StructuralModel, full: StructuralModel, dofs: list[Label], values: dict[str, float]
) -> tuple[StructuralModel, str]:
    """Return the full model, or one of many more modes with the joints as estimated, and its name."""
    # Residual vectors correct the truncation of modes, an error that it would share with the reduced model.
    count = _FINER * model.size
    if full.size <= max(_MAX_REFERENCE_DOFS, count):
        return without_massless(full, dofs), f"full model of {full.size} DOFs"
    from dynid.structure.reduction.mode_selection import Interest, ModeRange
    from dynid.structure.reduction.serep import JointAware

    method = JointAware(None, ModeRange(count=count), Interest(tuple(dofs)), values, residuals="auto")
    return method.reduce(full).model, f"model of {count} modes and residual vectors"


def _frequencies(model: StructuralModel, values: dict[str, float], count: int | None) -> Array:
    from dynid.structure.modes import modes

    return np.asarray(modes(*model.with_joints(values), count=count).omega)
