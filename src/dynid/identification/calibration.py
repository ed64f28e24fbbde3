"""Sensitivity of the estimates to the calibration of the instruments: gains and trigger delay.

Gains of loads and sensors and the delay are considered parameters, not estimated ones: error bars do not
include their errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.lti.floating import finite
from dynid.result import Result

Array = NDArray[np.float64]

#: Name of the delay of the loads behind what the channels record.
DELAY = "trigger delay"
#: Change of a gain that effects are quoted for; and of a phase, rad, where nothing is sampled.
GAIN_CHANGE = 0.01
#: Group of the result.
GROUP = "identification/considered"
# Singular values of the scaled sensitivities, over the largest, below which parameters are not distinguished.
_LEAST_SINGULAR = 1e-8


class CalibrationDerivatives(NamedTuple):
    """Derivatives of a record by the parameters and by the calibration, over the noise.

    Attributes
    ----------
    quantities
        Gains, delay and considered parameters (q), by name. A gain multiplies a load as the estimator knows
        it, or the values of a channel; a delay, s, shifts the loads to later times. Quantities of one name
        are one.
    changes
        The change of each that effects are quoted for (q): 1 % of a gain, a sampling step of the delay, the
        standard deviation of a considered parameter (of its logarithm, if it has one).
    by_parameter
        Derivatives of the prediction by the coordinates of the parameters (rows x p), free of the initial
        state.
    by_quantity
        Derivatives of prediction less measurement by the logarithms of gains and by the delay (rows x q),
        free of the initial state.
    """

    quantities: tuple[str, ...]
    changes: Array
    by_parameter: Array
    by_quantity: Array


class CalibrationSlopes(NamedTuple):
    """Slopes of the estimates by gains and delay.

    Attributes
    ----------
    parameters
        Names of the parameters (p).
    quantities
        Names of gains and delay (q).
    changes
        The change of each quantity that effects are quoted for (q): 1 % of a gain, a sampling step of the
        delay, s (of frequency responses the delay that turns the phase at the highest line by 0.01 rad).
    slopes
        Derivatives of the logarithms of the estimates by the logarithms of gains, and by the delay, 1/s
        (p x q).
    """

    parameters: Sequence[str]
    quantities: Sequence[str]
    changes: Array
    slopes: Array


def calibration_slopes(
    names: Sequence[str],
    derivatives: Sequence[CalibrationDerivatives],
    priors: Array,
    held: NDArray[np.bool_],
) -> CalibrationSlopes:
    """Return the slopes of the maximum-likelihood estimate, to first order (Gauss–Newton).

    With J the derivatives of the prediction by the parameters, free of the initial state, with a row for
    each prior, and g those of prediction less measurement by a quantity: ``-(J^T W J)^-1 J^T W g``. The error
    is of the order of the residuals. See B. D. Tapley, B. E. Schutz, G. H. Born, Statistical Orbit
    Determination, 2004, ch. 6 (consider covariance analysis).

    Parameters
    ----------
    names
        Names of the parameters (p).
    derivatives
        Derivatives of each record, over its noise.
    priors
        Sensitivities of the priors over their deviations (count x p).
    held
        Mask of parameters at a limit (p): these do not move.
    """
    quantities = list(dict.fromkeys(name for one in derivatives for name in one.quantities))
    changes = np.full(len(quantities), np.inf)
    J = np.concatenate([*(one.by_parameter for one in derivatives), priors])
    own = []
    for one in derivatives:  # one name is one instrument, in all records
        places = [quantities.index(name) for name in one.quantities]
        changes[places] = np.minimum(changes[places], one.changes)
        own.append(one.by_quantity @ np.eye(len(quantities))[places])
    g = np.concatenate([*own, np.zeros((len(priors), len(quantities)))])
    J = np.where(held, 0.0, J)
    finite("the sensitivity of the record", J)
    finite("the sensitivity of the record to its calibration", g)
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    moves = np.asarray(np.linalg.lstsq(J / size, g, _LEAST_SINGULAR)[0] / size[:, None])
    return CalibrationSlopes(names, quantities, changes, np.where(held[:, None], 0.0, -moves))


def add_calibration_slopes(result: Result, slopes: CalibrationSlopes, relative: Array) -> None:
    """Add ``considered/``: the slopes of the estimates by the calibration and considered parameters.

    Parameters
    ----------
    result
        The result.
    slopes
        The slopes of the coordinates.
    relative
        Derivatives of the logarithms of the estimates by their coordinates (p): 1 of logarithms.
    """
    dims = ("parameter", "quantity")
    result.add_axis(f"{GROUP}/parameter", list(slopes.parameters))
    result.add_axis(f"{GROUP}/quantity", list(slopes.quantities))
    units = ["s" if name == DELAY else "" for name in slopes.quantities]
    result.add(f"{GROUP}/unit", units, ("quantity",))
    result.add(f"{GROUP}/change", slopes.changes, ("quantity",))
    each = "relative change of a gain or considered parameter; second of delay"
    result.add(f"{GROUP}/slope", slopes.slopes * relative[:, None], dims, per=each)
