"""Modes in the scale of results, with their covariance as factors.

Values are frequencies (rad/s), damping ratios, and the real (and imaginary) parts of shapes, channel by
channel and mode by mode. Their covariance is ``F F'`` with `common` F, plus for the values of each channel
``B B'`` with `by_channel` B: in full it would have (2 + 2 channels)^2 modes^2 entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.modal.modal_model import ModalFit, ModalModel, inverse_root
from dynid.modal.spectra import LEAKAGE, MIN_RESOLUTION

#: The scales of shapes.
MODAL_A, MODAL_MASS, LARGEST = "modal a of 1", "unit modal mass", "largest entry 1"


@dataclass(frozen=True, eq=False)
class ReportedModes:
    """Modes in a band: frequencies (n), rad/s, damping ratios (n), shapes (n x channels)."""

    omega: Array
    damping: Array
    shape: ComplexArray
    normalisation: str
    common: Array  # (values x factors)
    by_channel: Array  # (channels x values of a channel x factors)
    driving: NDArray[np.int_]  # response by which each shape is scaled (n)

    @property
    def complexity(self) -> Array:
        """What no phase makes real of each shape (n); 0 of a real one."""
        from dynid.structure.correlation import complexity

        return complexity(self.shape.T)

    def with_leakage(self, resolution: float) -> ReportedModes:
        """Return the modes with the bias of damping by leakage of lines so far apart (Hz) as an error.

        A mode narrower than twice the resolution has no standard errors (NaN).
        """
        n = len(self.omega)
        lines = self.damping * self.omega / (np.pi * resolution)  # r = 2 zeta f / df
        bias = np.zeros((len(self.common), n))
        bias[n + np.arange(n), np.arange(n)] = LEAKAGE / lines**2 * self.damping
        common, by_channel = np.hstack([self.common, bias]), self.by_channel.copy()
        narrow = np.flatnonzero(lines < MIN_RESOLUTION)
        for k in narrow:
            common[k::n] = np.nan
            by_channel[:, k::n] = np.nan
        return replace(self, common=common, by_channel=by_channel)

    @property
    def scale_error(self) -> Array:
        """Standard error of each shape where its scale comes from, relative (n)."""
        modes = np.arange(len(self.omega))
        return np.asarray(
            self.standard_errors[2][modes, self.driving] / np.abs(self.shape[modes, self.driving])
        )

    def _variance(self) -> Array:
        variance = np.sum(self.common**2, axis=1)
        n, channels = self.shape.shape
        of_shapes = np.sum(self.by_channel**2, axis=2).reshape(channels, -1, n)
        variance[2 * n :] += of_shapes.transpose(1, 0, 2).ravel()
        return np.asarray(variance)

    @property
    def standard_errors(self) -> tuple[Array, Array, Array]:
        """Standard errors of frequencies, damping ratios, and shapes, root of E |n|^2 (n x channels)."""
        n, channels = self.shape.shape
        variance = self._variance()
        of_shapes = variance[2 * n :].reshape(-1, channels, n).sum(axis=0).T
        return np.sqrt(variance[:n]), np.sqrt(variance[n : 2 * n]), np.sqrt(of_shapes)


def reported_modes(
    model: ModalModel,
    fit: ModalFit,
    modes: NDArray[np.int_],
    driving_points: Sequence[tuple[int, int]],
    bar_scale: float,
    window_rate: float = 0.0,
    duration: float = np.inf,
) -> ReportedModes:
    """Return some modes of a fit: of unit modal a, or with real shapes mass, by the driving points.

    `driving_points`: response and reference of the DOFs that are both; of each mode that with the largest
    residue counts. Without one the largest entry of each shape is 1. `bar_scale` multiplies standard errors;
    the decay rate `window_rate` of a window (1/s) is subtracted from those of the poles. Decays that were cut
    off after a `duration` (s) have residues smaller by 1 - exp(lambda duration).
    """
    n, channels = len(modes), model.responses
    parts = 1 if model.real else 2
    theta = _Unknowns(model, fit)
    lam, psi = fit.poles[modes] + window_rate, fit.shapes[:, modes]
    omega = np.abs(lam)
    zeta = -lam.real / omega
    of_poles = theta.poles[np.concatenate([modes, len(fit.poles) + modes])]
    by_omega = (lam.real[:, None] * of_poles[:n] + lam.imag[:, None] * of_poles[n:]) / omega[:, None]
    by_zeta = (-of_poles[:n] - zeta[:, None] * by_omega) / omega[:, None]
    if driving_points:
        scale, reference, d_reference, d_participation = _by_driving_point(
            fit, modes, driving_points, model.own
        )
        cut = 1 - np.exp(
            np.minimum(fit.poles[modes].real, 0.0) * duration + 1j * _phase(fit, modes, duration)
        )
        scale = scale / np.sqrt(cut.real if model.real else cut)
        normalisation = MODAL_MASS if model.real else MODAL_A
    else:
        reference = np.argmax(np.abs(psi), axis=0)
        scale = 1 / psi[reference, np.arange(n)]
        d_reference, d_participation = -scale, None
        normalisation = LARGEST
    shape = psi * scale
    common = [by_omega, by_zeta, *[np.zeros((channels * n, by_omega.shape[1])) for _ in range(parts)]]
    referred = np.unique(reference)
    own_columns = {int(b): np.zeros((parts, channels, n, parts * len(fit.poles))) for b in referred}
    by_channel = np.zeros((channels, parts, n, parts * len(fit.poles)))
    of_shapes = [theta.shapes(o, modes) for o in range(channels)]
    for o in range(channels):
        slopes = _times(scale, of_shapes[o].slopes)
        by_channel[o] = _times(scale, of_shapes[o].root)
        for k, b in enumerate(reference.tolist()):
            factor = shape[o, [k]] * d_reference[[k]]
            slopes[:, [k]] += _times(factor, of_shapes[b].slopes[:, [k]])
            own_columns[b][:, o, [k]] += _times(factor, of_shapes[b].root[:, [k]])
            if d_participation is not None:
                column, change = d_participation[k]
                slopes[:, [k]] += _times(shape[o, [k]] * change, theta.participation(column, modes[[k]]))
        for part in range(parts):
            common[2 + part][o * n : (o + 1) * n] = slopes[part]
    for b in referred.tolist():  # what a channel shares with all is common
        own_columns[b][:, b] += by_channel[b]
        by_channel[b] = 0.0
    columns = [own_columns[int(b)].reshape(parts * channels * n, -1) for b in referred]
    joint = np.hstack([np.vstack(common), *[np.vstack([np.zeros((2 * n, c.shape[1])), c]) for c in columns]])
    joint = joint[:, np.any(joint != 0, axis=0)]
    blocks = by_channel.reshape(channels, parts * n, -1)
    return ReportedModes(
        omega, zeta, shape.T, normalisation, bar_scale * joint, bar_scale * blocks, reference
    )


def imaginary_shapes(model: ModalModel, fit: ModalFit, modes: NDArray[np.int_]) -> tuple[float, int]:
    """Return the Wald statistic of what no phase makes real of complex shapes, and its degrees of freedom.

    Shapes of real modes of positive mass have phase -90 degrees beside real participations, and with these
    -45 degrees where both are equal by reciprocity.
    """
    unknowns = _Unknowns(model, fit)
    turn = np.exp(0.25j * np.pi) if model.own else 1.0
    rows, values = [], []
    for i, free in enumerate(fit.free[:, modes]):
        rows.append(_times(np.full(len(modes), turn), unknowns.participation(i, modes))[1, free])
        values.append((turn * fit.participation[i, modes]).imag[free])
    G, c = np.vstack(rows), np.concatenate(values)
    # Unknowns u of unit covariance at the constraint G u = -c, shapes of further responses at theirs.
    A, b, statistic, count = np.eye(G.shape[1]), np.zeros(G.shape[1]), 0.0, len(c)
    turns = np.full(len(modes), turn if model.own else 1j)
    for o in set(range(model.responses)) - {*model.own}:
        of_shapes = unknowns.shapes(o, modes)
        root, slopes = (_times(turns, parts)[1] for parts in (of_shapes.root, of_shapes.slopes))
        shape = (turns * fit.shapes[o, modes]).imag
        whitened = np.linalg.solve(np.linalg.cholesky(root @ root.T), np.column_stack([slopes, shape]))
        A += whitened[:, :-1].T @ whitened[:, :-1]
        b -= whitened[:, :-1].T @ whitened[:, -1]
        statistic += float(whitened[:, -1] @ whitened[:, -1])
        count += len(modes)
    multiplied = np.block([[A, G.T], [G, np.zeros((len(c), len(c)))]])
    solution = np.linalg.solve(multiplied, np.concatenate([b, -c]))
    # Least value of u'u + sum of squares: by stationarity A u = b - G' nu.
    return statistic - float(solution @ np.concatenate([b, -c])), count


def _phase(fit: ModalFit, modes: NDArray[np.int_], duration: float) -> Array:
    """Return the phase of poles after a duration, rad; 0 of decays that are not cut off."""
    return fit.poles[modes].imag * duration if np.isfinite(duration) else np.zeros(len(modes))


def _by_driving_point(
    fit: ModalFit, modes: NDArray[np.int_], points: Sequence[tuple[int, int]], own: dict[int, int]
) -> tuple[ComplexArray, NDArray[np.int_], ComplexArray, list[tuple[int, complex]] | None]:
    """Return factors of shapes, their responses of reference, and slopes by these and participations."""
    responses, references = (np.array(index) for index in zip(*points, strict=True))
    n = len(modes)
    if own:  # shapes are participations at the references: of unit modal a already
        scale = np.ones(n, dtype=np.complex128)
        signed = np.asarray(scale * _signs(fit.shapes[:, modes] * scale))
        return signed, np.full(n, responses[0]), np.zeros(n, dtype=np.complex128), None
    residues = fit.shapes[responses][:, modes] * fit.participation[references][:, modes]
    best = np.argmax(np.abs(residues), axis=0)
    at, force = np.asarray(responses[best]), references[best]
    psi, participation = fit.shapes[at, modes], fit.participation[force, modes]
    if np.all((participation / psi).imag == 0) and np.any((participation / psi).real < 0):
        raise NumericalError(
            "a mode has a negative modal mass at its driving point",
            remedy="Turn sensor or force there (NODE:-DIR), or leave the shapes complex.",
        )
    scale = np.sqrt(participation / psi)
    scale = scale * _signs(fit.shapes[:, modes] * scale)
    return (
        scale,
        at,
        -0.5 / psi,
        [(int(i), 0.5 / value) for i, value in zip(force, participation, strict=True)],
    )


def _signs(shapes: ComplexArray) -> Array:
    """Return signs that make the largest component of each shape (columns) positive, of real modes."""
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    # Unit modal a is unit modal mass over root of 2 i omega, of phase -45 degrees for a real mode.
    turned = np.where(np.abs(largest.imag) > 0, largest * np.exp(0.25j * np.pi), largest)
    return np.where(turned.real < 0, -1.0, 1.0)


def _times(factor: ComplexArray, parts: Array) -> Array:
    """Return the parts (parts x n x …) of complex rows times complex factors (n)."""
    shaped = factor[:, None]
    if len(parts) == 1:
        return np.asarray(shaped.real * parts)
    real, imaginary = parts
    return np.stack(
        [shaped.real * real - shaped.imag * imaginary, shaped.real * imaginary + shaped.imag * real]
    )


@dataclass(frozen=True)
class _OfShapes:
    """Parts of the shapes at a response (parts x modes x …): by the unknowns, and their own root."""

    slopes: Array
    root: Array


class _Unknowns:
    """Poles, participations and shapes in a basis in which the unknowns have unit covariance."""

    def __init__(self, model: ModalModel, fit: ModalFit) -> None:
        self.model, self.fit = model, fit
        self.root = inverse_root(fit.information)
        self.m, self.parts = len(fit.poles), 1 if model.real else 2

    @property
    def poles(self) -> Array:
        """Slopes of the poles, real parts above imaginary ones."""
        return self.root[: 2 * self.m]

    def participation(self, reference: int, modes: NDArray[np.int_]) -> Array:
        """Return the parts of the participations of a reference (parts x modes x …); 0 of known ones."""
        free = self.fit.free
        before = 2 * self.m + self.parts * int(free[:reference].sum())
        count = int(free[reference].sum())
        rows = np.zeros((self.parts, self.m, self.root.shape[1]))
        for part in range(self.parts):
            start = before + part * count
            rows[part, free[reference]] = self.root[start : start + count]
        return rows[:, modes]

    def shapes(self, response: int, modes: NDArray[np.int_]) -> _OfShapes:
        """Return the parts of the shapes at a response."""
        root, slopes = self.fit.shape_roots[response], self.fit.shape_slopes[response]
        if root is None or slopes is None:
            own = self.participation(self.model.own[response], modes)
            return _OfShapes(own, np.zeros((self.parts, len(modes), self.parts * self.m)))
        by_unknowns = (slopes @ self.root).reshape(self.parts, self.m, -1)
        return _OfShapes(by_unknowns[:, modes], root.reshape(self.parts, self.m, -1)[:, modes])
