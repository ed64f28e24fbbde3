"""The result of an identification from frequency response functions, as named arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.identification.diagnostics import is_coloured, whiteness
from dynid.identification.findings import Findings, Named
from dynid.identification.findings_result import add_diagnostics, add_parameters, add_stages
from dynid.identification.frf.estimator import FrfLikelihood
from dynid.identification.frf.measurement import FrfMeasurement, unstacked
from dynid.result import Result
from dynid.structure.response import common_unit

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Residuals below this part of the signal are rounding, whatever their colour.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class FrfOutcome(Findings):
    """What an identification from frequency response functions found.

    Attributes
    ----------
    ensemble
        Model and measured responses.
    measurement
        What was measured.
    """

    ensemble: FrfLikelihood
    measurement: FrfMeasurement

    @property
    def measured(self) -> Sequence[Sequence[Named]]:
        """What is measured: one set of responses."""
        return [self.measurement.channels]

    @property
    def word(self) -> str:
        """What a set of responses is called."""
        return "response"

    def _complex(self, values: Array) -> ComplexArray:
        """Return values that were worked on (2 L x channels) as responses (L x channels)."""
        return np.asarray(unstacked(values) * self.measurement.profile)

    @property
    def residual_rms(self) -> Array:
        """RMS of the complex residuals (channels)."""
        residual = np.abs(self._complex(self.final.residuals[0]))
        return np.asarray(np.sqrt(np.nanmean(residual**2, axis=0)))

    @property
    def remarks(self) -> Sequence[str]:
        """Say of which responses the residuals are no noise, and where they are largest."""
        said = []
        sizes = np.abs(unstacked(self.final.residuals[0]))
        for place, part in zip(self.channels, self.residual_ratio, strict=True):
            if part < _ROUNDING or not is_coloured(whiteness(self.series(place))):
                continue
            at = self.measurement.omega[int(np.nanargmax(sizes[:, place.column]))]
            said.append(
                f"the model does not explain {place.name}: what is left ({100 * part:.2g} % of it) is no "
                f"noise; it is largest at {at:.4g} rad/s"
            )
        return said

    def result(self) -> Result:
        """Return everything under ``identification/``."""
        result = Result("identification")
        add_parameters(result, self)
        add_stages(result, self)
        self._add_measurement(result)
        add_diagnostics(result, self)
        if self.model_error is not None:
            self.model_error.add_to(result, [place.name for place in self.channels])
        return result

    def _add_measurement(self, result: Result) -> None:
        group, dims = "identification/measurement", ("omega", "channel")
        channels, record = self.measurement.channels, self.ensemble.records[0]
        units = [channel.unit for channel in channels]
        unit = common_unit(units)
        result.add_axis(f"{group}/omega", self.measurement.omega, "rad/s")
        result.add_axis(f"{group}/channel", [channel.name for channel in channels])
        result.add(f"{group}/unit", units, ("channel",))
        result.add(f"{group}/measured", self._complex(record.data.values), dims, unit)
        result.add(f"{group}/predicted", self._complex(self.final.parts[0].predicted.outputs), dims, unit)
        if record.data.noise is not None:
            result.add(f"{group}/noise", np.sqrt(2) * record.data.noise, ("channel",), unit)
        if self.measurement.deviation is not None:
            result.add(f"{group}/deviation", self.measurement.profile, dims, unit)
        elif self.measurement.given_noise is not None:
            result.add(f"{group}/given_noise", self.measurement.given_noise, ("channel",), unit)
