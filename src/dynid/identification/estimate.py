"""Joint identification: from a structure with unknown joints and a record to estimates with error bars.

Source: K. T. Yang 1997.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.errors import Diverged
from dynid.identification.augmented import AugmentedModel, augmented
from dynid.identification.fit import Fit, Fitter, fitter
from dynid.identification.measurement import Data, Measurement, as_estimated, data
from dynid.identification.outcome import Outcome
from dynid.identification.passes import Filter, run_passes
from dynid.result import Result
from dynid.structure.model import StructuralModel
from dynid.structure.response import Load, source_names


def identify(
    model: StructuralModel,
    loads: Sequence[Load],
    measurement: Measurement,
    estimator: Filter | None = None,
    *,
    truth: StructuralModel | None = None,
) -> Result:
    """Identify the unknown joint parameters of a structure from a record.

    Parameters
    ----------
    model
        The structure the estimator works with.
    loads
        The forces. Their time is that of the simulation: with settling, the first sample is not t = 0.
    measurement
        Channels and sampling, with measured values or a simulation.
    estimator
        Filter options; absent: `Filter()`.
    truth
        The structure that simulated records are made with; absent: `model`.

    Returns
    -------
    Result
        ``identification/{parameters, history, first_pass, passes, measurement, diagnostics}``. `history` is
        the last pass, `first_pass` the first where there are several; `predicted` is the noise-free response
        at the estimate from the best initial state; `error_percent` is unsigned. `true` and `error_percent`
        are NaN where a true value is not known, `measured` where a sample is missing, nothing else ever.

    Raises
    ------
    NotIdentifiable
        If the record cannot see parameters or tell them apart, or a channel is dead.
    Diverged
        If estimates run away, or the prediction explains nothing of the record.
    UsageError
        If the call makes no sense.
    """
    record = measurement.record
    estimator = estimator or Filter()
    known = as_estimated(loads, record)
    joint = augmented(model, known, measurement.channels, record.times)
    values = data(truth or model, loads, measurement)
    fits = fitter(joint, model, measurement.channels, values)
    origin = np.log([unknown.start for unknown in joint.unknowns])
    _check_visible(fits, fits.fit(origin, values.values))
    histories, results = run_passes(fits, estimator, origin)
    final = results[-1]
    _check_explained(final, values, joint)
    outcome = Outcome(fits, measurement, model.dofs, source_names(loads), histories, results)
    _check_not_void(outcome)
    return outcome.result()


def _check_visible(fits: Fitter, fit: Fit) -> None:
    fits.information(fit, fits.data.rms).check()


def _check_not_void(outcome: Outcome) -> None:
    worst = outcome.unexplained()
    if worst is not None:
        names = [unknown.name for unknown in outcome.fitter.model.unknowns]
        channel, left = worst
        raise Diverged(
            f"the filter ran away: with {', '.join(names)} as it left them {100 * left:.0f} % of {channel} "
            f"is unexplained, and what is left is no noise",
            remedy="Start nearer to the true values, add passes, or check model, units and excitation.",
            names=names,
        )


def _check_explained(final: Fit, values: Data, joint: AugmentedModel) -> None:
    left = final.noise / values.rms  # corrected for what the fit takes up of any record
    if not np.mean(left**2) < 1:
        names = [unknown.name for unknown in joint.unknowns]
        raise Diverged(
            f"the estimates of {', '.join(names)} are void: the prediction explains nothing of the record",
            remedy="Start nearer to the true values, or check model, units and excitation.",
            names=names,
        )
