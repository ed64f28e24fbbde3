"""The modes that frequency responses show: poles added where the fit lacks one, removed where none is needed.

A pole, in the band or beyond its edges, is worth its parameters if it lowers chi-squared by
``k + 8 sqrt(2 k)``, k = 2 responses + 2 references, eight standard deviations above what noise gives. BIC's
``k ln N`` missed a pair 0.1 % apart at 5 % noise in 8 of 8 records.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.modal.frf_matrix import FrfMatrix
from dynid.modal.modal_model import ModalFit, ModalModel

# Lines over which chi-squared by line is averaged, and its excess that asks for a pole, standard deviations.
_AVERAGED_LINES, _EXCESS = 7, 6.0
# Poles that may be added, steps of a trial with one more, and rounds of removals.
MAX_ADDED, _TRIAL_STEPS, _MAX_ROUNDS = 12, 12, 30
# Steps after which poles that have left the band for good, or guard its edges for nothing, are removed: they
# wander for dozens of steps.
_FIRST_STEPS = 6
# Standard error of a decay rate, relative, above which a pole in the band is none.
_MAX_DECAY_ERROR = 0.6
# Damping ratio above which a pole is none, in the band or beyond it: residual terms do what it does.
_MAX_RATIO = 0.5
# Part of the band's width up to which poles beyond it are kept: they carry what leaks in from there.
_GUARD_PART, _LOWEST_PART = 0.3, 0.2
# Weak modes whose removal is tried in a round; times the worth up to which a Wald statistic says weak.
_TRIED_REMOVALS, _WEAK = 2, 5.0
# Places of further poles: beyond the edges, widths at a line, shifts of the nearest pole, in half widths.
_EDGES, _WIDTHS, _SHIFTS = (1.02, 1.06, 0.97), (0.3, 1.0, 3.0), (0.3, -0.3)
# Damping ratio of a pole beyond an edge.
_EDGE_DAMPING = 0.01
# Repetitions of fit and scale of the noise where it is estimated, at the start and at the end, and the
# deviation of chi-squared from its expectation that asks for another at the end.
_SCALES, _SETTLED = 2, 0.02


def worth(frf: FrfMatrix) -> float:
    """Return the decrease of chi-squared that a pole is worth."""
    parameters = 2 * frf.values.shape[1] + 2 * frf.values.shape[2]
    return float(parameters + 8 * np.sqrt(2 * parameters)) * frf.correlation


def in_band(poles: ComplexArray, frf: FrfMatrix) -> NDArray[np.bool_]:
    """Return the poles whose frequencies lie in the band; the others guard its edges."""
    return np.asarray((poles.imag >= frf.omega[0]) & (poles.imag <= frf.omega[-1]))


def degrees(model: ModalModel, fit: ModalFit) -> int:
    """Return the degrees of freedom of chi-squared."""
    return model.frf.count - fit.parameters


def select_modes(
    frf: FrfMatrix, starts: ComplexArray, *, real: bool = False, min_distance: float = 0.0
) -> tuple[ModalModel, ModalFit]:
    """Return the model and the fit of the modes in a band, from start poles.

    A pole is added only so far (rad/s) from the others: leakage splits what is closer than its main lobe.
    Where the scale of the noise is estimated it is that of the residuals. Raises `NumericalError` where there
    is no mode.
    """
    model = ModalModel(frf, real=real)
    fit = _pruned(model, starts, model.start(starts))
    for _ in range(_SCALES if frf.estimated else 0):
        model, fit = _rescaled(model, fit)
    for _ in range(MAX_ADDED):
        extended = _extended(model, fit, min_distance)
        if extended is None:
            break
        fit = extended
        if frf.estimated:
            model, fit = _rescaled(model, fit)
    for _ in range(_SCALES if frf.estimated else 0):
        if abs(fit.chi2 / degrees(model, fit) - 1) < _SETTLED:
            break
        model, fit = _rescaled(model, fit)
    return model, fit


def _rescaled(model: ModalModel, fit: ModalFit) -> tuple[ModalModel, ModalFit]:
    """Return model and fit with the noise of each pair by its residuals."""
    frf = model.frf
    there = frf.weights > 0
    squares = np.where(there, np.abs(fit.residual / np.where(there, frf.weights, 1.0)) ** 2, 0.0)
    count = np.maximum(np.count_nonzero(there, axis=0) * (degrees(model, fit) / frf.count), 1.0)
    profiles = [frf.deviation] if frf.shaped else [frf.flat, np.abs(model.synthesis(fit))]
    best, deviation, scale = np.full(count.shape, np.inf), frf.deviation, frf.scale
    for profile in profiles:
        size = np.where(there & (profile > 0), profile, 1.0)
        variance = np.sum(squares / size**2, axis=0) / count
        variance = np.where(variance > 0, variance, 1.0)
        unlikelihood = np.sum(np.where(there, np.log(variance * size**2), 0.0), axis=0)
        better = unlikelihood < best
        best = np.where(better, unlikelihood, best)
        deviation, scale = np.where(better, profile, deviation), np.where(better, np.sqrt(variance), scale)
    frf = replace(frf, deviation=deviation, scale=scale, first=frf.flat)
    rescaled = ModalModel(frf, real=model.real)
    return rescaled, _pruned(rescaled, fit.poles, fit.participation)


def _pruned(model: ModalModel, poles: ComplexArray, participation: ComplexArray) -> ModalFit:
    """Return the fit without the poles that are none, or that the data do not need."""
    for _ in range(_MAX_ROUNDS):
        if not len(poles):
            break
        fit = model.fit(poles, participation, _FIRST_STEPS)
        removed, weaker = _far(model.frf, fit.poles), None
        if not removed.any():
            weaker = _without_weak(model, fit, _at_edges(model.frf, fit.poles))
        if weaker is None and not removed.any():
            fit = model.fit(fit.poles, fit.participation)
            removed = _far(model.frf, fit.poles) | _undetermined(model.frf, fit)
            if not removed.any():
                weaker = _without_weak(model, fit, in_band(fit.poles, model.frf))
                if weaker is None:
                    return fit
        fit = fit if weaker is None else weaker
        keep = ~removed if weaker is None else slice(None)
        poles, participation = fit.poles[keep], fit.participation[:, keep]
    raise NumericalError(
        "no mode is found in the band",
        remedy="Choose the band by the peaks of the responses, and check columns, units and noise.",
    )


def _far(frf: FrfMatrix, poles: ComplexArray) -> NDArray[np.bool_]:
    """Return the poles that are overdamped, or far beyond the band."""
    low, high = frf.omega[0], frf.omega[-1]
    far = _GUARD_PART * (high - low)
    outside = (poles.imag < max(low - far, _LOWEST_PART * low)) | (poles.imag > high + far)
    return np.asarray(outside | (-poles.real > _MAX_RATIO * np.abs(poles)))


def _at_edges(frf: FrfMatrix, poles: ComplexArray) -> NDArray[np.bool_]:
    """Return the poles beyond the band or within their half width of its edges."""
    half = np.abs(poles.real)
    return np.asarray((poles.imag - half < frf.omega[0]) | (poles.imag + half > frf.omega[-1]))


def _undetermined(frf: FrfMatrix, fit: ModalFit) -> NDArray[np.bool_]:
    """Return the poles in the band that are unstable, or whose decay rates are not determined."""
    poles = fit.poles
    error = np.sqrt(np.maximum(np.diag(fit.covariance())[: len(poles)], 0.0))
    none = (poles.real >= 0) | (error > _MAX_DECAY_ERROR * np.abs(poles.real))
    return np.asarray(in_band(poles, frf) & none)


def _without_weak(model: ModalModel, fit: ModalFit, of: NDArray[np.bool_]) -> ModalFit | None:
    """Return the fit without one of some poles that is not worth its parameters; None where all are."""
    least = worth(model.frf)
    m = len(fit.poles)
    if m == 1 or not of.any():
        return None
    covariance = fit.covariance()
    wald = np.where(of, 0.0, np.inf)
    tested = np.flatnonzero(of)
    for o in range(model.responses):
        block = fit.shape_covariance(o, covariance)
        assert block is not None  # reciprocity is tested when the modes are known
        for r in tested:
            parts = [r] if model.real else [r, m + r]
            value = np.array([fit.shapes[o, r].real, fit.shapes[o, r].imag])[: len(parts)]
            wald[r] += value @ np.linalg.solve(block[np.ix_(parts, parts)], value)
    # Without the correlation of responses the statistic misjudges close pairs: the fit without it decides.
    for r in np.argsort(wald)[:_TRIED_REMOVALS]:
        if wald[r] < _WEAK * max(least, 2 * model.responses * np.log(model.frf.count)):
            rest = np.arange(m) != r
            without = model.fit(fit.poles[rest], fit.participation[:, rest])
            if without.chi2 - fit.chi2 < least:
                return without
    return None


def _excess_by_line(model: ModalModel, fit: ModalFit) -> Array:
    """Return the excess of chi-squared over its expectation around each line, in standard deviations."""
    present = 2 * np.count_nonzero(model.frf.weights, axis=(1, 2))
    squares = np.sum(np.abs(fit.residual) ** 2, axis=(1, 2))
    kernel = np.ones(_AVERAGED_LINES)
    count = np.convolve(present, kernel, "same") * (degrees(model, fit) / model.frf.count)
    total = np.convolve(squares, kernel, "same")
    deviation = np.sqrt(2 * model.frf.correlation * np.maximum(count, 1))
    return np.asarray((total - count) / deviation)


def _extended(model: ModalModel, fit: ModalFit, min_distance: float) -> ModalFit | None:
    """Return the best fit with one more pole; None where chi-squared asks for none, or none is worth it."""
    excess = _excess_by_line(model, fit)
    if excess.max() < _EXCESS:
        return None
    best: ModalFit | None = None
    for pole in _places(model.frf, fit.poles, float(model.frf.omega[np.argmax(excess)])):
        poles = np.append(fit.poles, pole)
        try:
            trial = model.fit(poles, model.start(poles), _TRIAL_STEPS)
        except NumericalError:
            continue
        if min_distance and np.min(np.abs(np.diff(np.sort(trial.poles.imag)))) < min_distance:
            continue
        if best is None or trial.chi2 < best.chi2:
            best = trial
    if best is None or fit.chi2 - best.chi2 < worth(model.frf):
        return None
    try:
        best = _pruned(model, best.poles, best.participation)
    except NumericalError:
        return None
    return best if fit.chi2 - best.chi2 >= worth(model.frf) else None


def _places(frf: FrfMatrix, poles: ComplexArray, line: float) -> Iterator[complex]:
    """Yield places where a pole may be missing, if chi-squared is largest at a line."""
    low, high = frf.omega[0], frf.omega[-1]
    for factor in _EDGES:
        edge = float(factor * (high if factor > 1 else low))
        yield complex(-_EDGE_DAMPING * edge, edge)
    near = complex(poles[np.argmin(np.abs(poles.imag - line))])
    yield from (complex(width * near.real, line) for width in _WIDTHS)
    yield from (near + shift * abs(near.real) * 1j for shift in _SHIFTS)
