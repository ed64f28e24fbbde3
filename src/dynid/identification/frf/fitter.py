"""The likelihood of frequency response functions with circular complex Gaussian noise, line by line.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 9.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dynid.identification.diagnostics import root_mean_square
from dynid.identification.frf.measurement import FrfMeasurement, responses, stacked, unstacked
from dynid.identification.information import Information, information
from dynid.identification.measurement import Data
from dynid.identification.observed import Fit, Observed, weights
from dynid.identification.prediction import Trajectory
from dynid.structure.joints import Unknown
from dynid.structure.model import StructuralModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrfFitter(Observed):
    """Compares measured frequency response functions with those of a structure.

    Attributes
    ----------
    model
        The structure.
    measurement
        Lines and channels.
    data
        The measured values over the noise's profile, real parts above imaginary ones (2 L x channels).
    magnitudes
        Whether only the logarithms of the magnitudes are compared (L x channels): less precise, but with far
        fewer local minima.
    """

    model: StructuralModel
    measurement: FrfMeasurement
    data: Data
    magnitudes: bool = False
    sharing: int = 1

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""
        return self.model.unknowns

    @property
    def nuisances(self) -> int:
        """None: a frequency response does not depend on how it began."""
        return 0

    def fit(self, logs: Array, values: Array, noise: Array | None = None) -> Fit:  # noqa: ARG002
        """Predict the responses at the parameters exp(logs) and compare them with `values`."""
        found = responses(self.model, self.measurement.channels, self.measurement.omega, logs)
        if self.magnitudes:
            outputs = _logarithms(np.abs(found.values))
            there = np.where(found.values == 0, 1.0, found.values)
            by_parameter = (found.slopes / there[..., None]).real
        else:
            profile = self.measurement.profile
            outputs = stacked(found.values / profile)
            by_parameter = stacked(found.slopes / profile[..., None])
        none = np.zeros((len(outputs), 0))
        residual = values - outputs
        predicted = Trajectory(outputs, none)
        counts, size = np.count_nonzero(~np.isnan(residual), axis=0), root_mean_square(residual)
        seen = self.noise_in(counts, size)
        return Fit(logs, predicted, residual, counts, size, seen, by_parameter=by_parameter)

    def slopes(self, fit: Fit, noise: Array) -> Array:
        """Return the derivatives by the logarithms over noise (values x p), 0 where a value is missing."""
        assert fit.by_parameter is not None
        weight = weights(noise, fit.residual)
        return (np.nan_to_num(fit.by_parameter) * weight[..., None]).reshape(-1, len(self.unknowns))

    def on(self, data: Data) -> Self:
        """Return the fitter of other values of the same responses."""
        return replace(self, data=data)

    def information(self, fit: Fit, noise: Array) -> Information:
        """Return the information on the parameters of a fit, for a noise of this deviation (channels)."""
        names = tuple(unknown.name for unknown in self.unknowns)
        weight = weights(noise, fit.residual)
        slopes = self.slopes(fit, noise)
        signal = float(np.linalg.norm(np.nan_to_num(fit.predicted.outputs) * weight))
        found = information(names, slopes, np.zeros((len(slopes), 0)), signal, int(np.count_nonzero(weight)))
        return replace(found, values=np.exp(fit.logs))

    def series(self, residual: Array) -> Array:
        """Return the residuals line after line, real and imaginary parts side by side."""
        return residual if self.magnitudes else np.concatenate(np.split(residual, 2), axis=1)

    def by_magnitude(self) -> FrfFitter:
        """Return the same responses compared by the logarithms of their magnitudes."""
        sizes = np.abs(unstacked(self.data.values)) * self.measurement.profile
        return replace(self, data=Data(_logarithms(sizes)), magnitudes=True)


def _logarithms(sizes: Array) -> Array:
    """Return the logarithms of sizes, NaN of zeros."""
    return np.log(np.where(sizes > 0, sizes, np.nan))
