"""Modes from frequency responses: from the chart of poles to modes in the scale of results.

The steps: poles of increasing orders (`plscf`), chains of them (`chains`), maximum likelihood with as many
poles as chi-squared asks for (`selection`), reciprocity where the data do not contradict it, scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dynid.arrays import ComplexArray
from dynid.errors import NumericalError
from dynid.modal.chains import Chart, chart_of
from dynid.modal.frf_matrix import FrfMatrix
from dynid.modal.modal_model import ModalFit, ModalModel
from dynid.modal.plscf import poles_by_order
from dynid.modal.reported_modes import ReportedModes, imaginary_shapes, reported_modes
from dynid.modal.selection import degrees, in_band, select_modes
from dynid.progress import report_progress

# Highest orders of the chart, and the number of chains from which the second counts.
_ORDERS, _MANY_CHAINS = (40, 60), 15
# Least lines for each order, so that a denominator has fewer unknowns than there are data.
_LINES_OF_ORDER = 4
#: Level of the tests of reciprocity: below it a record is not taken for reciprocal.
RECIPROCITY_LEVEL = 1e-3
# Standard deviations of chi-squared over its degrees of freedom up to which a fit has no lack of fit.
_LACK_OF_FIT = 4.0
# Width of the main lobe of the Hann window, in lines.
_MAIN_LOBE_LINES = 4
# Repetitions of the fit with noise in proportion to the fitted responses instead of the measured ones.
_PROPORTIONAL_FITS = 2


@dataclass(frozen=True, eq=False)
class ModalAnalysis:
    """Modes of a band, with what they rest on."""

    modes: ReportedModes
    chart: Chart
    model: ModalModel
    fit: ModalFit
    bar_scale: float  # factor of standard errors for the lack of fit; 1 without one
    reciprocity: float  # p-value of reciprocity, NaN where it is not tested
    real_shapes: float  # p-value of real shapes, NaN where they are not tested
    whiteness: float  # scatter of residuals from line to line over that of white noise, 1 of white ones

    @property
    def degrees(self) -> int:
        """Degrees of freedom of chi-squared."""
        return degrees(self.model, self.fit)

    @property
    def reduced_chi2(self) -> float:
        """Chi-squared over its degrees of freedom."""
        return self.fit.chi2 / self.degrees


def analyse(
    frf: FrfMatrix,
    driving_points: Sequence[tuple[int, int]],
    *,
    real: bool = False,
    reciprocal: bool | Literal["auto"] = "auto",
    proportional: bool = False,
    window_rate: float = 0.0,
    resolution: float = 0.0,
    duration: float = np.inf,
) -> ModalAnalysis:
    """Return the modes that frequency responses show, with their covariance.

    Parameters
    ----------
    frf
        Receptances of a band with the deviations of their noise.
    driving_points
        Response and reference of each DOF that is both.
    real
        Shapes are real.
    reciprocal
        Responses to forces at two references are equal if these are exchanged; ``auto``: if a test at the
        level 0.001 does not contradict it.
    proportional
        The deviation of the noise is in proportion to the response.
    window_rate
        Decay rate (1/s) of an exponential window, which is subtracted from that of every pole.
    resolution
        Distance of the lines of random records (Hz), whose leakage counts in the standard errors of damping;
        0 of responses without leakage.
    duration
        Time (s) after which the decays of impacts were cut off, which counts in the scale of the shapes.

    Raises
    ------
    NumericalError
        Where the band has no mode.
    """
    if frf.estimated:
        frf = frf.with_scale_of_differences()
    chart = _chart(frf)
    starts = chart.starts
    if not len(starts):
        raise NumericalError(
            "no pole is stable over the orders of the chart",
            remedy="Choose the band by the peaks of the responses, and check columns, units and noise.",
        )
    report_progress(f"maximum likelihood, {len(starts)} poles")
    main_lobe = _MAIN_LOBE_LINES * 2 * np.pi * resolution
    model, fit = select_modes(frf, starts, real=real, min_distance=main_lobe)
    for _ in range(_PROPORTIONAL_FITS if proportional else 0):
        synthesis = np.abs(model.synthesis(fit))
        ratio = np.nanmedian(model.frf.deviation / np.abs(model.frf.values), axis=0)
        model = ModalModel(replace(model.frf, deviation=ratio * synthesis), real=real)
        fit = model.fit(fit.poles, fit.participation)
    inside = in_band(fit.poles, frf) & (fit.poles.real < 0)  # guard poles may enter the band later
    whiteness = _whiteness(fit, model)
    reduced_chi2 = fit.chi2 / degrees(model, fit)
    bar_scale = _bar_scale(frf, reduced_chi2, whiteness, degrees(model, fit))
    unit = frf.correlation * bar_scale**2  # of chi-squared, whose increases are tested
    tested = float("nan")
    if len(driving_points) > 1 and reciprocal is not False:
        own = ModalModel(model.frf, real=real, reciprocal=driving_points)
        constrained = own.fit(fit.poles, _reciprocal_participation(fit, driving_points))
        tested = _p_value((constrained.chi2 - fit.chi2) / unit, fit.parameters - constrained.parameters)
        if reciprocal is True or tested >= RECIPROCITY_LEVEL:
            model, fit = own, constrained
    modes = np.array([r for r in np.argsort(fit.poles.imag, kind="stable") if inside[r]], dtype=int)
    if not len(modes):
        raise NumericalError("no mode is found in the band", remedy="Choose the band by the peaks.")
    real_shapes = float("nan")
    if not real:
        statistic, constraints = imaginary_shapes(model, fit, modes)
        real_shapes = _p_value(statistic / unit, constraints)
    reported = reported_modes(
        model,
        fit,
        modes,
        driving_points,
        bar_scale * float(np.sqrt(frf.correlation)),
        window_rate,
        duration,
    )
    if resolution:
        reported = reported.with_leakage(resolution)
    return ModalAnalysis(reported, chart, model, fit, bar_scale, tested, real_shapes, whiteness)


def _chart(frf: FrfMatrix) -> Chart:
    """Return the chart of poles of increasing orders, by the smaller one of both sides of the responses."""
    if frf.values.shape[1] < frf.values.shape[2]:
        frf = frf.transposed()
    band = float(frf.omega[0]), float(frf.omega[-1])
    chart = None
    for highest in _ORDERS:
        report_progress(f"poles up to order {highest}")
        orders = range(2, max(3, min(highest, len(frf.omega) // _LINES_OF_ORDER)) + 1)
        chart = chart_of(orders, poles_by_order(frf, orders), band)
        if chart.chain.max(initial=-1) + 1 < _MANY_CHAINS:
            break
    assert chart is not None
    return chart


def _reciprocal_participation(fit: ModalFit, points: Sequence[tuple[int, int]]) -> ComplexArray:
    """Return participations of reciprocal modes nearest to those of a fit, of unit modal a."""
    rows, columns = ([*index] for index in zip(*points, strict=True))
    psi, L = fit.shapes[rows], fit.participation
    best = np.argmax(np.abs(psi * L[columns]), axis=0)
    modes = np.arange(len(fit.poles))
    scale = np.sqrt(psi[best, modes] / L[columns][best, modes])
    participation = L * scale
    participation[columns] = (participation[columns] + psi / scale) / 2
    return np.asarray(participation)


def _whiteness(fit: ModalFit, model: ModalModel) -> float:
    """Return the mean squared difference of residuals at neighbouring lines over twice their mean square."""
    both = (model.frf.weights[1:] > 0) & (model.frf.weights[:-1] > 0)
    differences = np.where(both, np.abs(np.diff(fit.residual, axis=0)) ** 2, 0.0)
    squares = np.where(both, np.abs(fit.residual[1:]) ** 2 + np.abs(fit.residual[:-1]) ** 2, 0.0)
    return float(differences.sum() / squares.sum()) if squares.any() else 1.0


def _bar_scale(frf: FrfMatrix, reduced_chi2: float, whiteness: float, free: int) -> float:
    """Return the factor of standard errors for a lack of fit, 1 without one.

    Noise that is estimated is all that a fit leaves: there a lack of fit shows as correlation between lines
    (von Neumann's ratio, of variance 2 / degrees).
    """
    if reduced_chi2 > 1 + _LACK_OF_FIT * np.sqrt(2 * frf.correlation / free):
        return float(np.sqrt(reduced_chi2))
    if frf.estimated and frf.correlation == 1 and whiteness < 1 - _LACK_OF_FIT * np.sqrt(2 / free):
        return float(1 / np.sqrt(whiteness))
    return 1.0


def _p_value(increase: float, parameters: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(parameters, max(increase, 0.0)))
