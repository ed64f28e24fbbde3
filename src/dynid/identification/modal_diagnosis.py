"""Diagnosis of a fit to measured modes: frequencies left out, the ends of the trade-off, what is determined.

Where the form of a model is in error, better frequencies may cost agreement of shapes. The error bars of such
a fit say nothing of it, but these do: each frequency predicted with it left out, beside its bar, and the fits
to frequencies alone and to shapes alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.identify import Rebuild
from dynid.identification.information import Information
from dynid.identification.modal_record import ModalFit, ModalLikelihood, ModalRecord
from dynid.parameters import named
from dynid.progress import report_progress

Array = NDArray[np.float64]

# What a fit to a part of the data may raise: the rest may not determine the parameters.
_FAILURES = (DynidError, ArithmeticError, np.linalg.LinAlgError)
# Most steps with a frequency left out, and to an end of the trade-off.
_STEPS = 25
# An error that takes the weight from a quantity.
_NO_WEIGHT = 1e3
#: Prediction errors beyond so many bars contradict these: one in 16,000 by chance.
CONTRADICTED = 4.0
# Part of a direction below which a parameter is not named in it.
_SHARE = 0.3
#: A direction is determined by the data where they know it better than the prior.
DETERMINED = 1.0


class LeftOut(NamedTuple):
    """Frequencies predicted with them left out, over the measured ones less 1.

    Attributes
    ----------
    error
        Relative errors of the predictions (r); NaN where the other data do not determine the parameters.
    deviation
        Their standard deviations by parameters, scatter and error of the form (r).
    by_scatter
        The same by scatter alone (r).
    """

    error: Array
    deviation: Array
    by_scatter: Array

    @property
    def contradicted(self) -> NDArray[np.bool_]:
        """Mask of modes whose prediction errors exceed four times the bars by scatter alone (r)."""
        return np.asarray(np.abs(self.error) > CONTRADICTED * self.by_scatter)


def left_out(record: ModalRecord, eta: Array) -> LeftOut:
    """Predict each frequency with it left out; shapes stay.

    Parameters
    ----------
    record
        The measured modes, with the errors of the form that were found.
    eta
        Coordinates of the estimate (p).
    """
    r, measured = record.measurement.modes, record.measurement.omega
    error, deviation, by_scatter = np.full((3, r), np.nan)
    bare = record.with_error(record.known_error)
    for k in range(r):
        report_progress(f"frequency {k + 1} left out")
        both = [ModalLikelihood((one.with_error(one.error, (k,)),)) for one in (record, bare)]
        try:
            _information(both[0], eta).check()
            end = refine(both[0], eta, _STEPS).fit
            roots = [_information(one, end.eta).root for one in both]
        except _FAILURES:
            continue
        fit = end.parts[0]
        assert isinstance(fit, ModalFit)
        assert fit.by_parameter is not None
        error[k] = fit.omega[k] / measured[k] - 1
        slope = fit.by_parameter[k, 0] * record.spread[0][k] / measured[k]
        for one, root, bars in zip((record, bare), roots, (deviation, by_scatter), strict=True):
            bars[k] = np.hypot(np.linalg.norm(slope @ root), one.spread[0][k] / measured[k])
    return LeftOut(error, deviation, by_scatter)


def _information(likelihood: ModalLikelihood, eta: Array) -> Information:
    fit = likelihood.fit(eta)
    return likelihood.information(fit, likelihood.likeliest(fit))


class End(NamedTuple):
    """An end of the trade-off: frequencies over the measured ones less 1 (r), and MAC (r)."""

    error: Array
    mac: Array


def trade_off(record: ModalRecord, eta: Array, rebuild: Rebuild | None) -> dict[str, End]:
    """Return the fits to `frequencies` alone and to `shapes` alone, as far as these determine the parameters.

    Priors count in both, and so do damping ratios where they are measured.

    Parameters
    ----------
    record, eta
        As of `left_out`.
    rebuild
        Returns the model for parameters by name, where its basis follows them.
    """
    found, channels = {}, [one.name for one in record.channels]
    for name, ignored in (("frequencies", "shape"), ("shapes", "frequency")):
        report_progress(f"fit to {name} alone")
        error = np.where([one == ignored for one in channels], _NO_WEIGHT, record.known_error)
        own, end = record.with_error(error), eta
        try:
            for _ in range(1 if rebuild is None else 2):
                end = refine(ModalLikelihood((own,)), end, _STEPS).fit.eta
                if rebuild is not None:
                    own = replace(own, model=rebuild(named(own.unknowns, end)))
            fit = own.fit(end, own.data.values)
        except _FAILURES:
            continue
        found[name] = End(fit.omega / own.measurement.omega - 1, fit.own_mac)
    return found


@dataclass(frozen=True)
class Direction:
    """A combination of parameters, and how much better the data know it than the priors.

    Attributes
    ----------
    strength
        Deviation by the prior over that by the data.
    weights
        Its components in units of the priors' deviations (p).
    """

    strength: float
    weights: Array

    def label(self, names: Sequence[str]) -> str:
        """Return the parameters that take part in it, the most important first, as ratios or products."""
        order = np.argsort(-np.abs(self.weights), kind="stable")
        largest = np.abs(self.weights).max()
        parts = [k for k in order.tolist() if abs(self.weights[k]) > _SHARE * largest]
        sign = np.sign(self.weights[parts[0]])
        return " ".join(f"{'' if self.weights[k] * sign > 0 else '-'}{names[k]}" for k in parts)


def directions(information: Information, prior: Array) -> list[Direction]:
    """Return combinations of parameters by how well the data determine them: singular vectors of J · prior.

    Parameters
    ----------
    information
        Of the data alone, without priors.
    prior
        Deviations of the priors of the coordinates (p).
    """
    _, s, Vt = np.linalg.svd(information.projected * prior, full_matrices=False)
    return [Direction(float(size), row) for size, row in zip(s, Vt, strict=True)]
