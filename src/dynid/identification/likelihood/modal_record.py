"""Likelihood of measured modes: frequencies, damping ratios, and shapes of a free scale, Gaussian each.

Every evaluation pairs measured modes with those of the model anew (`paired_modes`); modes at amplitudes are
points of the backbones of theirs.

Values are in units of their deviations, ``sigma^2 = scatter^2 + (e size)^2`` with the error e of the model's
form that the scene states for each quantity. Fit, error bars and verdict are all for these deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, guarded
from dynid.errors import UsageError
from dynid.identification.information import BACKBONE, MODAL_SURVEY, Observed
from dynid.identification.likelihood.paired_modes import PairedModes, backbone_modes, paired_modes, real_parts
from dynid.identification.likelihood.record_likelihood import HIDDEN, RecordFit, RecordLikelihood, ScatterTest
from dynid.identification.likelihood.saturated_model import SaturatedCoordinates
from dynid.identification.records.measurement import RecordData
from dynid.identification.records.modal_measurement import ModalChannel, ModalMeasurement, channels_of
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import system_of
from dynid.parameters import Parameter, named, rates
from dynid.structure.mode_derivatives import ModalSolution, has_damping, lowest_modes
from dynid.structure.model import StructuralModel
from dynid.structure.nonlinear.backbone_points import Backbones

#: Frequencies nearer to each other, relative, have one span of shapes.
CLOSE = 1e-4


@lru_cache(maxsize=4)
def _solution(
    model: StructuralModel,
    at: tuple[tuple[str, float], ...],
    count: int,
    near: float,
    damped: bool,
    with_shapes: bool,
) -> ModalSolution:
    """Return modes, kept for records that differ in weights alone, as of frequencies that are left out."""
    return lowest_modes(model, dict(at), count, near, damped=damped, with_shapes=with_shapes)


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalFit(RecordFit):
    """A fit of measured modes to the modes of the model that they are paired with."""

    modes: PairedModes

    @property
    def omega(self) -> Array:
        """Natural frequencies (r), rad/s."""
        return self.modes.columns[0]


@dataclass(frozen=True, eq=False)
class ModalRecord(RecordLikelihood):
    """Likelihood of measured modes with a structure."""

    model: StructuralModel  # the structure, full or reduced
    measurement: ModalMeasurement  # the measured modes
    # The measured values over their deviations (values x quantities), NaN where there is none.
    data: RecordData
    error: Array  # errors of the model's form, relative (quantities)
    sharing: int = 1  # number of records that share the parameters
    count: int = 0  # how many modes of the model are computed
    close: float = CLOSE  # frequencies nearer to each other, relative, have one span of shapes
    left_out: tuple[int, ...] = ()
    # Lower root of the covariance of the values that are there, and their mask; None of independent ones.
    root: tuple[Array, NDArray[np.bool_]] | None = None
    backbones: Backbones = field(default_factory=Backbones, repr=False)
    modal: ClassVar[bool] = True
    outlier_remedy: ClassVar[str] = ""  # modes have no robust loss

    @classmethod
    def of(cls, model: StructuralModel, measurement: ModalMeasurement, count: int, sharing: int = 1) -> Self:
        """Return the likelihood of modes with the scatter that is given.

        Raises UsageError if a sensor's DOF does not exist, or a damping ratio is measured and the structure
        has none.
        """
        if measurement.has_damping and not (has_damping(model) or model.nonlinear):
            raise UsageError(
                "damping ratios are measured, but the structure has no damping",
                remedy="Give it one, or leave the damping ratios out.",
                names=("measurement.modes",),
            )
        error = np.array(
            [getattr(measurement.model_error, quantity.name) for quantity in channels_of(measurement)]
        )
        record = cls(model, measurement, RecordData(np.zeros((0, 0))), error, sharing, count)
        return record.with_error(error)

    def with_error(self, error: Array, left_out: tuple[int, ...] | None = None) -> Self:
        """Return the likelihood with other errors of the model's form (quantities).

        `left_out`: modes whose frequencies do not count, from 0.
        """
        left_out = self.left_out if left_out is None else left_out
        record = replace(self, error=error, left_out=left_out)
        columns = record.measured_columns
        if self.measurement.covariance is not None:
            record = replace(record, root=record.covariance_root(columns))
        values = _side_by_side(record.standardised(columns))
        return replace(record, data=RecordData(values, given=np.ones(values.shape[1])))

    # Description.

    @property
    def observed(self) -> Observed:
        """Words for a set of measured modes; without shapes, these have no scales."""
        if self.measurement.backbone is not None:
            return BACKBONE
        return MODAL_SURVEY if self.nuisances else MODAL_SURVEY._replace(nuisances="one another")

    @property
    def channels(self) -> Sequence[ModalChannel]:
        """The quantities."""
        return channels_of(self.measurement)

    def row_label(self, row: int) -> str:
        """Return the mode of a row, and of a component of a shape its sensor."""
        sensor, mode = divmod(row, self.measurement.modes)
        at = (
            f" at {self.measurement.dofs[sensor % len(self.measurement.dofs)]}"
            if self.measurement.dofs
            else ""
        )
        return f"{self.measurement.noun} {mode + 1}{at}"

    def series(self, residual: Array) -> Array:
        """Return nothing: modes have no order in which they could be correlated."""
        return residual[:0]

    def residual_rms(self, fit: RecordFit) -> Array:
        """Return the RMS of the residuals in units of the deviations (quantities)."""
        return fit.size

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters (p)."""
        return self.model.unknowns

    @cached_property
    def system_model(self) -> LinearSystem:
        """The structure without loads and channels."""
        return system_of(self.model, (), ())

    @property
    def nuisances(self) -> int:
        """Number of scales of shapes."""
        if self.measurement.absolute:
            return 0
        shapes = np.count_nonzero((~np.isnan(self.measurement.shapes)).any(axis=0))
        return int(shapes) * (2 if self.measurement.complex_shapes else 1)

    # Values and their deviations.

    @property
    def measured_columns(self) -> list[Array]:
        """The measured values of each quantity, NaN of frequencies that are left out."""
        survey = self.measurement
        columns = [survey.omega.copy()]
        columns[0][list(self.left_out)] = np.nan
        if survey.has_damping:
            assert survey.damping is not None
            columns.append(survey.damping)
        if len(survey.dofs):
            columns.append(real_parts(survey.shapes))
        return columns

    @cached_property
    def scatter_and_size(self) -> list[tuple[Array, Array]]:
        """Scatter of the values of each quantity, and their sizes, to which errors of the form relate."""
        frequency, damping, shape = self.measurement.deviations()
        omega, zeta = self.measurement.omega, self.measurement.damping
        pairs = [(frequency * omega, omega)]
        if self.measurement.has_damping:
            assert zeta is not None
            size = np.where(zeta == 0, 1.0, np.abs(zeta))
            pairs.append((damping * size, size))
        if len(self.measurement.dofs):
            # Of a complex component half of the variance in each part.
            deviation = shape / np.sqrt(2) if self.measurement.complex_shapes else shape
            flat = (
                real_parts(deviation + 1j * deviation)
                if self.measurement.complex_shapes
                else deviation.ravel()
            )
            pairs.append((flat, np.full(len(flat), 1 / np.sqrt(len(flat) // shape.size or 1))))
        return pairs

    @cached_property
    def spread(self) -> list[Array]:
        """Deviations of the values of each quantity: scatter and error of the form."""
        pairs = zip(self.scatter_and_size, self.error, strict=True)
        return [np.hypot(scatter, error * size) for (scatter, size), error in pairs]

    def covariance_root(self, columns: Sequence[Array]) -> tuple[Array, NDArray[np.bool_]]:
        """Return the lower root of the covariance of measured values, errors of the form included.

        Frequencies stand first: their standardised values do not depend on damping and shapes.
        """
        there = ~np.isnan(np.concatenate(columns))
        covariance = self.measurement.relative_covariance[np.ix_(there, there)]
        form = np.concatenate(
            [e * size for (_, size), e in zip(self.scatter_and_size, self.error, strict=True)]
        )
        scale = np.sqrt(np.diag(covariance) + form[there] ** 2)
        with guarded("the covariance of the measured modes", remedy="State a 'model_error' of shapes."):
            correlation = covariance / np.outer(scale, scale)
            correlation[np.diag_indices(len(scale))] = 1.0
            return scale[:, None] * np.linalg.cholesky(correlation), there

    def standardised(self, columns: Sequence[Array]) -> list[Array]:
        """Return values of each quantity, or slopes (values x p), as independent ones of unit variance."""
        if self.root is None:
            pairs = zip(columns, self.spread, strict=True)
            return [a / (b if a.ndim == 1 else b[:, None]) for a, b in pairs]
        from scipy.linalg import solve_triangular

        lower, there = self.root
        joint = np.concatenate(columns)
        values = np.full(joint.shape, np.nan)
        values[there] = solve_triangular(lower, joint[there], lower=True)
        return np.split(values, np.cumsum([len(column) for column in columns])[:-1])

    # Prediction.

    @cached_property
    def damped(self) -> bool:
        """True if damping is taken into account."""
        return (self.measurement.has_damping or self.measurement.complex_shapes) and has_damping(self.model)

    @cached_property
    def rows(self) -> Array:
        """Rows that read the sensors (s x n)."""
        return np.array([self.model.row(dof) for dof in self.measurement.dofs]).reshape(-1, self.model.size)

    def solution(self, at: Mapping[str, float]) -> ModalSolution:
        """Return the modes of the model at values of the parameters."""
        near = float(self.measurement.omega.min())  # of the size of the lowest elastic ones
        with_shapes = len(self.measurement.dofs) > 0
        return _solution(self.model, tuple(at.items()), self.count, near, self.damped, with_shapes)

    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> ModalFit:  # noqa: ARG002
        """Predict the modes at coordinates of the parameters, and compare them with `values`."""
        at = named(self.unknowns, eta)
        return self.fit_of(eta, self._paired(at), values)

    def _paired(self, at: Mapping[str, float], *, slopes: bool = True) -> PairedModes:
        """Return the modes paired with the measured ones, with or without their derivatives."""
        if self.measurement.backbone is not None:
            return backbone_modes(self.measurement, self.model, at, self.backbones)
        by = self.model.slopes(at) if slopes else ()
        return paired_modes(self.measurement, self.rows, self.solution(at), by, self.error, self.close)

    def residual(self, eta: Array) -> Array:
        """Return the residual at coordinates `eta` (rows x quantities), without derivatives."""
        paired = self._paired(named(self.unknowns, eta), slopes=False)
        return np.asarray(self.data.values - _side_by_side(self.standardised(paired.columns)))

    def fit_of(self, eta: Array, paired: PairedModes, values: Array | None = None) -> ModalFit:
        """Compare modes paired at these coordinates with `values`; default: the measured ones."""
        values = self.data.values if values is None else values
        rate = rates(self.unknowns, eta)
        outputs = _side_by_side(self.standardised(paired.columns))
        slopes = self.standardised([slope * rate for slope in paired.slopes])
        by_parameter = np.stack([_filled(slope, len(outputs)) for slope in slopes], axis=1)
        return ModalFit(**vars(self._fit_at(eta, outputs, by_parameter, values)), modes=paired)

    # Residuals and information.

    def nuisance_degrees(self, fit: RecordFit, noise: Array) -> Array:  # noqa: ARG002
        """Return the number of scales of each quantity (quantities)."""
        return np.array([self.nuisances if channel.name == "shape" else 0.0 for channel in self.channels])

    def on(self, data: RecordData) -> Self:
        """Return the likelihood of other values of the same modes."""
        return replace(self, data=data)

    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:  # noqa: ARG002
        """Return nothing: modes are tested against their scatter; see `tested`."""
        return []

    # Verdict.

    def tested(self, fit: RecordFit, root: Callable[[], Array]) -> ScatterTest:
        """Return the residuals over their deviations, with what parameters and scales take of them."""
        assert isinstance(fit, ModalFit)
        slopes = self.slopes(fit, np.ones(len(self.error)))
        moved = (slopes @ root()).reshape(*fit.residual.shape, -1)
        share = np.sum(moved**2, axis=(0, 2))
        off = fit.omega / self.measurement.omega - 1
        explained = [1 - float(np.sqrt(np.mean(off**2)))]
        if np.isfinite(fit.modes.pair_mac).any():
            explained.append(float(np.nanmean(fit.modes.pair_mac)))
        return ScatterTest(
            fit.residual,
            np.sum(moved**2, axis=2),
            np.maximum(fit.counts - self.nuisance_degrees(fit, fit.noise) - share, 0.0),
            slopes,
            int(fit.counts.sum()) - self.nuisances,
            float(np.clip(min(explained), 0.0, 1.0)),
            self._groups(fit.residual, moved),
        )

    def _groups(self, residual: Array, moved: Array) -> list[tuple[float, int]]:
        """Return independent sums of squares of the frequencies, and of the damping ratios beside them."""
        # That of some residuals r with the covariance V = I - A A' is r' V^+ r: by so much chi-squared is
        # less where these values are left out. `moved`: A, derivatives times a root of the covariance
        # (values x quantities x p).
        groups: list[tuple[float, int]] = []
        before, rank = 0.0, 0
        several = [k for k, channel in enumerate(self.channels) if channel.name != "shape"]
        for count in range(1, len(several) + 1) if len(self.channels) > 1 else ():
            r = residual[:, several[:count]].T.ravel()
            A = moved[:, several[:count]].transpose(1, 0, 2).reshape(len(r), -1)
            there = ~np.isnan(r)
            variance, axes = np.linalg.eigh(np.eye(int(there.sum())) - A[there] @ A[there].T)
            shown = variance > HIDDEN
            parts = (axes.T @ r[there])[shown]
            squares, degrees = float(np.sum(parts**2 / variance[shown])), int(np.count_nonzero(shown))
            groups.append((squares - before, degrees - rank))
            before, rank = squares, degrees
        return groups


def _filled(values: Array, rows: int) -> Array:
    """Return values with rows of NaN below them."""
    return np.concatenate([values, np.full((rows - len(values), *values.shape[1:]), np.nan)])


def _side_by_side(columns: Sequence[Array]) -> Array:
    """Return columns of any length side by side, filled with NaN."""
    rows = max(map(len, columns))
    return np.column_stack([_filled(column, rows) for column in columns])
