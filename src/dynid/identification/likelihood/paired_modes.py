"""Modes of a model paired with measured ones: by MAC and frequency, with derivatives.

Modes of the model that are nearly equal have no shapes of their own: the measured shape is compared with the
best one of their span. The scale of a shape is solved for (variable projection), and derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.structure.correlation import mac, paired
from dynid.structure.mode_derivatives import ModalSolution, has_damping, lowest_modes, modal_basis
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.backbone_points import Backbones, Place, backbone_points

# Modes beside the measured ones that are computed, so that crossings are seen; up to which part of the
# highest measured frequency; and the most of them.
_SPARE_MODES, _BEYOND_MEASURED, _MAX_MODES = 4, 1.5, 200
# Part of the highest measured frequency up to which the derivatives of modes are in a basis.
_WITH_SLOPES = 1.25
# Shapes at the sensors, of equal frequencies, are dependent below this part of the largest singular value.
_DEPENDENT_SHAPE_TOL = 1e-6
# More DOFs than this are reduced to the lowest modes and their derivatives.
_MAX_DENSE_DOFS = 250


class PairedModes(NamedTuple):
    """Modes of a model that are paired with r measured ones."""

    columns: list[Array]  # predicted values of each quantity: frequencies (r), rad/s, damping ratios, shapes
    slopes: list[Array]  # their derivatives by the values of the parameters (values x p)
    pairs: NDArray[np.int_]  # modes of the model (r), from 0
    damping: Array  # their damping ratios (r)
    shapes: NDArray[Any]  # their shapes at the sensors, scaled to the measured ones (s x r)
    mac: Array  # modal assurance criterion of all measured and computed shapes (r x m)
    pair_mac: Array  # that of each pair (r); NaN without a shape


def paired_modes(
    measured: ModalMeasurement, rows: Array, solution: ModalSolution, slopes: Any, error: Array, close: float
) -> PairedModes:
    """Return the modes of a model that are paired with the measured ones, and their derivatives.

    `rows` read the sensors (s x n); `slopes` are the derivatives of the model's matrices by each parameter,
    `error` those of its form, relative (quantities). Frequencies that are `close` to each other, relative,
    have one span of shapes.
    """
    r, s, p = measured.modes, len(measured.dofs), len(slopes)
    target, omega = measured.shapes, solution.omega
    if len(omega) < r:
        raise UsageError(
            f"{r} modes are measured, but the model has {len(omega)}",
            remedy="Refine the model, or leave modes out.",
            names=("measurement.modes",),
        )
    at_sensors = rows @ solution.shapes
    without = np.isnan(target).all(axis=0)
    table = np.zeros((r, len(omega)))
    for k in np.flatnonzero(~without).tolist():
        table[k] = _mac_of(target[:, k], at_sensors)
    pairs = paired(table, measured.omega, omega)
    poles, by_pole = np.zeros(r, dtype=complex), np.zeros((r, p), dtype=complex)
    shapes, by_shape = (
        np.full((s, r), np.nan, dtype=target.dtype),
        np.full((s, r, p), np.nan, dtype=target.dtype),
    )
    pair_mac = np.full(r, np.nan)
    turned: dict[int, Any] = {}
    scatter, form = measured.deviations()[2], error[-1] if s else 0.0
    spans = np.abs(omega - omega[pairs][:, None]) <= close * omega[pairs][:, None]
    slopes_of_modes, read = np.zeros((len(omega), p), dtype=complex), spans[without].any(axis=0)
    if without.any():
        slopes_of_modes[read] = solution.pole_slopes(solution.poles[read], solution.shapes[:, read], slopes)
    for k, pair in enumerate(pairs.tolist()):
        span = [pair, *[j for j in np.flatnonzero(spans[k]).tolist() if j != pair]]
        there = ~np.isnan(target[:, k])
        if not there.any():  # of equal modes without a shape the mean
            poles[k] = solution.poles[pair]
            by_pole[k] = np.mean(slopes_of_modes[span], axis=0)
            continue
        for j in span:
            if j not in turned:
                moved = rows @ solution.shape_slopes(j, span, slopes)
                turned[j] = _turned(at_sensors[:, j], moved, wide=bool(measured.complex_shapes))
        if measured.absolute and len(span) == 1:
            shape, moved = _scaled(solution, pair, slopes, rows, real=not measured.complex_shapes)
            scale = (-1 if np.vdot(target[there, k], shape[there]).real < 0 else 1) / measured.sizes[k]
            shapes[there, k], by_shape[there, k] = scale * shape[there], scale * moved[there]
            pair_mac[k] = _mac_of(target[:, k], shapes[:, [k]])[0]
            poles[k] = solution.poles[pair]
            by_pole[k] = solution.pole_slopes(solution.poles[pair], solution.shapes[:, pair], slopes)
            continue
        weight = np.ones(np.count_nonzero(there))
        if measured.covariance is None:
            weight = 1 / np.hypot(scatter[:, k], form)[there]
        weights, shapes[there, k], by_shape[there, k] = _best_of_span(
            [turned[j] for j in span], there, weight, target[there, k]
        )
        pair_mac[k] = _mac_of(target[:, k], shapes[:, [k]])[0]
        poles[k], shape = _pole_of_span(solution, span, weights)
        by_pole[k] = solution.pole_slopes(complex(poles[k]), shape, slopes)
    size = np.abs(poles)
    by_omega = np.real(poles.conj()[:, None] * by_pole) / size[:, None]
    zeta = -poles.real / size
    columns, changes = [size], [by_omega]
    if measured.has_damping:
        columns.append(zeta)
        changes.append((-by_pole.real - zeta[:, None] * by_omega) / size[:, None])
    if s:
        columns.append(real_parts(shapes))
        changes.append(real_parts(by_shape))
    return PairedModes(columns, changes, pairs, zeta, shapes, table, pair_mac)


def backbone_modes(
    measured: ModalMeasurement,
    model: StructuralModel,
    at: Mapping[str, float],
    backbones: Backbones,
) -> PairedModes:
    """Return frequencies and damping ratios of modes at measured amplitudes, and derivatives by parameters.

    `backbones`: as of `backbone_points`.
    """
    backbone = measured.backbone
    assert backbone is not None
    place, modes = Place(backbone.channel.row(model), backbone.channel.order), backbone.mode.astype(int)
    near, names = float(np.mean(measured.omega)), [unknown.name for unknown in model.unknowns]
    points = backbone_points(model, at, names, place, backbone.amplitude, modes, near, backbones)
    columns, slopes = [points.omega], [points.omega_slopes]
    if measured.has_damping:
        columns.append(points.damping)
        slopes.append(points.damping_slopes)
    none, r = np.zeros((0, measured.modes)), measured.modes
    return PairedModes(columns, slopes, modes, points.damping, none, np.zeros((r, 0)), np.full(r, np.nan))


def _scaled(
    solution: ModalSolution, mode: int, slopes: Any, rows: Array, *, real: bool
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return a shape of unit modal a, or real of unit modal mass, at the sensors, and its slopes."""
    psi, pole = solution.shapes[:, mode], complex(solution.poles[mode])
    M, C = solution.matrices[:2]
    moved, of_pole = (
        solution.shape_slopes(mode, [mode], slopes),
        solution.pole_slopes(pole, psi, slopes),
    )
    border = 2 * pole * np.asarray(M @ psi) + (np.asarray(C @ psi) if solution.damped else 0.0)
    a = psi @ border
    of_a = 2 * (border @ moved) + 2 * of_pole * (psi @ np.asarray(M @ psi))
    for j, changes in enumerate(slopes):
        for letter, factor in (("M", 2 * pole), ("C", 1.0 if solution.damped else 0.0)):
            if letter in changes:
                of_a[j] += factor * (psi @ np.asarray(changes[letter] @ psi))
    shape, moved = psi / np.sqrt(a), (moved - np.outer(psi, of_a / (2 * a))) / np.sqrt(a)
    if real:  # modal a is 2 i omega times modal mass
        scale = np.sqrt(2j * pole.imag)
        by_scale = np.outer(shape, of_pole.imag / (2 * pole.imag))
        shape, moved = (scale * shape).real, (scale * (moved + by_scale)).real
    return rows @ shape, rows @ moved


def _best_of_span(
    modes: list[tuple[NDArray[Any], NDArray[Any]]],
    there: NDArray[np.bool_],
    weight: Array,
    target: NDArray[Any],
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the parts of the modes in the shape nearest to a measured one, that shape, its slopes."""
    shapes = np.column_stack([shape for shape, _ in modes])
    moves = np.stack([moved for _, moved in modes], axis=1)
    Q, size, Vh = np.linalg.svd(weight[:, None] * shapes[there], full_matrices=False)
    rank = np.count_nonzero(size > _DEPENDENT_SHAPE_TOL * size[0])
    Q = Q[:, :rank]
    weights = Vh[:rank].conj().T @ (Q.conj().T @ (weight * target) / size[:rank])
    change = weight[:, None] * np.tensordot(moves[there], weights, axes=([1], [0]))
    change = change - Q @ (Q.conj().T @ change)
    return weights, shapes[there] @ weights, change / weight[:, None]


def _pole_of_span(
    solution: ModalSolution, span: list[int], weights: NDArray[Any]
) -> tuple[complex, NDArray[Any]]:
    """Return the pole of a shape with these parts of the modes of a span, and the shape at all DOFs."""
    psi = solution.shapes[:, span]
    if len(span) == 1 or not weights.any():
        return solution.poles[span[0]], psi[:, 0]
    # Without damping all of a shape has one phase.
    weights = weights if solution.damped else _turned(weights, weights[:, None], wide=False)[0]
    share = np.abs(weights) ** 2
    return share @ solution.poles[span] / share.sum(), psi @ weights


def _mac_of(measured: NDArray[Any], shapes: NDArray[Any]) -> Array:
    """Return the MAC of a measured shape (s, NaN where missing) with others (s x m)."""
    there = ~np.isnan(measured)
    return np.asarray(mac(measured[there, None], shapes[there])[0])


def _turned(shape: NDArray[Any], moved: NDArray[Any], *, wide: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return a shape at the sensors (s) and its slopes (s x p), turned to be as real as can be."""
    # One that all phases make as real is not turned. Shapes are complex only where damping makes them so;
    # `wide`: the measured ones are complex, too.
    if wide or not np.iscomplexobj(shape):
        return shape, moved
    square = shape @ shape
    if square == 0:
        return shape.real, moved.real
    turn = np.exp(-0.5j * np.angle(square))
    rate = -np.imag((shape @ moved) / square)
    return (turn * shape).real, (turn * (moved + 1j * rate * shape[:, None])).real


def real_parts(shapes: NDArray[Any]) -> Array:
    """Return components of shapes (s x r x …) as real numbers one below the other, imaginary ones last."""
    flat = shapes.reshape(shapes.shape[0] * shapes.shape[1], *shapes.shape[2:])
    return np.concatenate([flat.real, flat.imag]) if np.iscomplexobj(flat) else flat


def modes_needed(model: StructuralModel, measurement: ModalMeasurement, at: Mapping[str, float]) -> int:
    """Return how many modes of the model are computed.

    A few more than are measured, and all up to 1.5 times the highest measured frequency at these values.
    """
    near, highest = float(measurement.omega.min()), _BEYOND_MEASURED * float(measurement.omega.max())
    count = measurement.modes + _SPARE_MODES
    while count < min(model.size, _MAX_MODES):
        omega = lowest_modes(model, at, count, near, damped=False, with_shapes=False).omega
        if len(omega) < count or omega[-1] > highest:
            return max(measurement.modes + _SPARE_MODES, int(np.count_nonzero(omega <= highest)) + 1)
        count *= 2
    return min(count, model.size, _MAX_MODES)


def is_large(model: StructuralModel) -> bool:
    """Return True if modes of a structure are better computed in a basis of its lowest ones."""
    return model.is_sparse or model.size > _MAX_DENSE_DOFS


def modal_model(
    model: StructuralModel, measurement: ModalMeasurement, at: Mapping[str, float], count: int
) -> StructuralModel:
    """Return the model that modes are computed with: the structure, or of a large one a basis there."""
    if not is_large(model):
        return model
    damped = (measurement.has_damping or measurement.complex_shapes) and has_damping(model)
    near, highest = float(measurement.omega.min()), _WITH_SLOPES * float(measurement.omega.max())
    with_shapes = len(measurement.dofs) > 0
    return modal_basis(model, at, count, near, highest, damped=damped, with_shapes=with_shapes)
