"""The result of an identification, as named arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged
from dynid.identification.diagnostics import (
    is_coloured,
    is_explained,
    is_settled,
    root_mean_square,
    whiteness,
)
from dynid.identification.estimation import Estimation
from dynid.identification.filter import Pass
from dynid.identification.fit import Fit, Fitter
from dynid.identification.information import Information, untold
from dynid.identification.measurement import Measurement
from dynid.result import Result
from dynid.structure.matrices import Label
from dynid.structure.response import Channel, common_unit

Array = NDArray[np.float64]

# Residuals above this part of a channel's RMS void the estimates if they are not noise …
_VOID = 0.5
# … and above this one (all channels together) whatever they are.
_NOTHING = 1.0
# A standard error of the logarithm beyond which not even the order of magnitude is known: a factor of e^10.
_BLIND = 10.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an identification found.

    Attributes
    ----------
    fitter
        Model and record.
    measurement
        What was measured.
    dofs
        Labels of the DOFs.
    sources
        Names of the loads.
    method
        Name of the estimator.
    estimation
        What the estimator found.
    """

    fitter: Fitter
    measurement: Measurement
    dofs: Sequence[Label]
    sources: Sequence[str]
    method: str
    estimation: Estimation

    @property
    def _final(self) -> Fit:
        return self.estimation.fit

    @property
    def _noise(self) -> Array:
        """Noise seen in the residuals; not below rounding, so that it can be divided by."""
        return np.maximum(self._final.noise, np.finfo(float).eps * self.fitter.data.rms)

    @cached_property
    def information(self) -> Information:
        """The Fisher information at the estimate, for the noise seen in the residuals."""
        return self.fitter.information(self._final, self._noise)

    @cached_property
    def whiteness_p(self) -> float:
        """The p-value of the residuals' whiteness."""
        return whiteness(self._final.residual)

    @cached_property
    def residual_rms(self) -> Array:
        """RMS of the residuals (channels)."""
        return root_mean_square(self._final.residual)

    @cached_property
    def step(self) -> Array:
        """The Gauss–Newton step from the estimate to the optimum of the record, in logarithms (p)."""
        return self.information.step(self.fitter.weighted(self._final, self._noise))

    def check(self) -> None:
        """Refuse estimates whose prediction does not explain the record.

        The prediction must explain some of the record as a whole; and what it leaves of a channel may be
        more than half only where that looks like white noise.

        Raises
        ------
        Diverged
            Naming the parameters.
        NotIdentifiable
            Naming those of which the record tells nothing, not even the order of magnitude.
        """
        left = self._final.noise / self.fitter.data.rms  # corrected for what the fit takes up of any record
        if not np.mean(left**2) < _NOTHING**2:
            raise _void(self.fitter, "the prediction explains nothing of the record")
        for column in np.flatnonzero(left > _VOID):
            if is_coloured(whiteness(self._final.residual[:, [column]])):
                channel = self.measurement.channels[column].name
                raise _void(
                    self.fitter,
                    f"{100 * left[column]:.0f} % of {channel} is unexplained, and what is left is no noise",
                )
        blind = self.information.deviations() > _BLIND
        if blind.any():
            unknowns = self.fitter.model.unknowns
            raise untold([unknown.name for unknown, yes in zip(unknowns, blind, strict=True) if yes])

    def result(self) -> Result:
        """Return everything under ``identification/``."""
        result = Result("identification")
        self._add_parameters(result)
        histories = self.estimation.histories or [self._whole_record()]
        self._add_history(result, "identification/history", histories[-1])
        if len(histories) > 1:
            self._add_history(result, "identification/first_pass", histories[0])
        self._add_stages(result)
        self._add_measurement(result)
        self._add_diagnostics(result)
        return result

    def _add_parameters(self, result: Result) -> None:
        group, dims = "identification/parameters", ("parameter",)
        unknowns = self.fitter.model.unknowns
        names = [unknown.name for unknown in unknowns]
        estimate = np.exp(self._final.logs)
        true = np.array([np.nan if unknown.true is None else unknown.true for unknown in unknowns])
        result.add_axis(f"{group}/parameter", names)
        result.add(f"{group}/name", names, dims)
        result.add(f"{group}/unit", [unknown.unit for unknown in unknowns], dims)
        unit = self._common_unit_of_parameters()
        result.add(f"{group}/start", [unknown.start for unknown in unknowns], dims, unit)
        result.add(f"{group}/true", true, dims, unit)
        result.add(f"{group}/estimate", estimate, dims, unit)
        result.add(f"{group}/standard_error", estimate * self.information.deviations(), dims, unit)
        result.add(f"{group}/cramer_rao", self._bound(true), dims, unit)
        result.add(f"{group}/error_percent", 100 * np.abs(estimate / true - 1), dims, "%")

    def _common_unit_of_parameters(self) -> str:
        return common_unit(unknown.unit for unknown in self.fitter.model.unknowns)

    def _bound(self, true: Array) -> Array:
        """Return the Cramér–Rao bound, at the true values and noise where they are known."""
        data = self.fitter.data
        fit, values, noise = self._final, np.exp(self._final.logs), self._noise
        if not np.isnan(true).any():
            fit, values = (
                self.fitter.fit(np.log(true), data.values if data.clean is None else data.clean),
                true,
            )
        if data.noise is not None:
            noise = data.noise
        if not noise.all():
            return np.zeros(len(true))  # clean data
        return np.asarray(values * self.fitter.information(fit, noise).deviations())

    def _whole_record(self) -> Pass:
        """Return the history of an estimator of the whole record: it knows as much at any time."""
        states = self._final.predicted.states
        every = np.ones((len(states), 1))
        return Pass(every * self._final.logs, every * self.information.deviations(), states)

    def _add_stages(self, result: Result) -> None:
        group, stages = "identification/stages", self.estimation.stages
        result.annotate("identification", estimator=self.method)
        result.add_axis(f"{group}/stage", [stage.name for stage in stages])
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in self.fitter.model.unknowns])
        estimates = np.exp([stage.fit.logs for stage in stages])
        unit = self._common_unit_of_parameters()
        result.add(f"{group}/estimate", estimates, ("stage", "parameter"), unit)
        left = [np.max(root_mean_square(stage.fit.residual) / self.fitter.data.rms) for stage in stages]
        result.add(f"{group}/residual_ratio", left, ("stage",))
        result.add(f"{group}/iterations", [len(stage.fits) - 1 for stage in stages], ("stage",))
        chosen = [stage.fit is self._final for stage in stages].index(True) + 1
        result.add(f"{group}/chosen", chosen)

    def _add_history(self, result: Result, group: str, history: Pass) -> None:
        model = self.fitter.model
        estimate = np.exp(history.logs)
        dims = ("time", "parameter")
        result.add_axis(f"{group}/time", self._times(), "s")
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in model.unknowns])
        unit = self._common_unit_of_parameters()
        result.add(f"{group}/estimate", estimate, dims, unit)
        result.add(f"{group}/standard_deviation", estimate * history.deviations, dims, unit)
        components = [
            Channel(dof, quantity) for quantity in ("displacement", "velocity") for dof in self.dofs
        ]
        result.add_axis(f"{group}/component", [component.name for component in components])
        result.add(f"{group}/unit", [component.unit for component in components], ("component",))
        # Not an axis named `state`: a variable of two axes cannot bear the name of one of them.
        result.add(f"{group}/state", history.states * model.scale, ("time", "component"))

    def _add_measurement(self, result: Result) -> None:
        group, dims = "identification/measurement", ("time", "channel")
        channels, data = self.measurement.channels, self.fitter.data
        units = [channel.unit for channel in channels]
        unit = common_unit(units)
        result.add_axis(f"{group}/time", self._times(), "s")
        result.add_axis(f"{group}/channel", [channel.name for channel in channels])
        result.add(f"{group}/unit", units, ("channel",))
        result.add(f"{group}/measured", data.values, dims, unit)
        result.add(f"{group}/predicted", self._final.predicted.outputs, dims, unit)
        result.add_axis(f"{group}/excitation", self.sources)
        result.add(f"{group}/input", self.fitter.model.line.inputs(), ("time", "excitation"), "N")
        if data.noise is not None:
            result.add(f"{group}/noise", data.noise, ("channel",), unit)

    def _add_diagnostics(self, result: Result) -> None:
        group, channels = "identification/diagnostics", self.measurement.channels
        deviations = self.information.deviations()
        settled = is_settled(self.step, deviations)
        explained = is_explained(self.residual_rms, self.fitter.data.rms, self.whiteness_p)
        result.add(f"{group}/converged", settled and explained)
        result.add(f"{group}/settled", settled)
        result.add(f"{group}/explained", explained)
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in self.fitter.model.unknowns])
        result.add(f"{group}/distance_to_optimum", np.abs(self.step) / deviations, ("parameter",))
        result.add_axis(f"{group}/channel", [channel.name for channel in channels])
        unit = common_unit(channel.unit for channel in channels)
        result.add(f"{group}/residual_rms", self.residual_rms, ("channel",), unit)
        result.add(f"{group}/residual_ratio", self.residual_rms / self.fitter.data.rms, ("channel",))
        result.add(f"{group}/whiteness_p", self.whiteness_p)
        result.add(f"{group}/white", not is_coloured(self.whiteness_p))
        result.add(f"{group}/condition", self.information.condition())
        for name, fact in self.estimation.facts.items():
            result.add(f"{group}/{name}", fact)
        result.add(f"{group}/passes", len(self.estimation.histories))

    def _times(self) -> Array:
        return np.asarray(np.arange(self.measurement.samples) * self.measurement.step)


def _void(fitter: Fitter, why: str) -> Diverged:
    names = [unknown.name for unknown in fitter.model.unknowns]
    subject = "the estimates of" if len(names) > 1 else "the estimate of"
    verb = "are" if len(names) > 1 else "is"
    return Diverged(
        f"{subject} {', '.join(names)} {verb} void: {why}",
        remedy="Start nearer to the true values, add passes, or check model, units and excitation.",
        names=names,
    )
