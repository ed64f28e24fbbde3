"""Measured modes: natural frequencies, damping ratios and mode shapes at sensors, with their scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.matrices import Label

#: Quantities of a mode, in the order of the channels.
QUANTITIES = ("frequency", "damping", "shape")


class Scatter(NamedTuple):
    """Standard deviations relative to the value: of frequencies, damping ratios, and shapes.

    That of shapes is relative to the largest component of each shape.
    """

    frequency: float
    damping: float
    shape: float


#: Scatter of quantities for which none is given: usual values of a careful modal survey.
USUAL = Scatter(0.005, 0.2, 0.05)
#: Least scatter where one is given: a scatter of few tests may be zero by chance, as that of a reference is.
FLOORS = Scatter(0.001, 0.02, 0.02)
#: Standard deviation of a free scale, relative: so wide that a shape says nothing of it.
_FREE_SCALE = 1e2
#: No error of the model's form.
NO_ERROR = Scatter(0.0, 0.0, 0.0)


class Backbone(NamedTuple):
    """Amplitudes of a motion at which modes of a structure with nonlinear joints were measured.

    `channel`: the motion, a `Channel`; `amplitude` (r): of its first harmonic, SI; `mode` (r): numbers of
    the modes at small amplitudes, from 0, NaN where it is the one nearest in frequency.
    """

    channel: Any
    amplitude: Array
    mode: Array


@dataclass(frozen=True, eq=False)
class ModalMeasurement:
    """Modes of a structure, as a modal survey gives them, or tests at several amplitudes."""

    omega: Array  # natural frequencies (r), rad/s
    dofs: tuple[Label, ...] = ()  # dOFs of the sensors (s); none without shapes
    # Mode shapes at the sensors (s x r), real or complex, each of any scale; NaN where a sensor is missing.
    shape: NDArray[Any] | None = None
    damping: Array | None = None  # damping ratios (r), NaN where one is missing
    # `omega_std`, `damping_std`, `shape_std`: standard deviations, each as its values, in their units; NaN
    # where none is given
    omega_std: Array | None = None
    damping_std: Array | None = None
    shape_std: Array | None = None
    # Least scatter where one is given; absent: `FLOORS`. Where none is given, `USUAL` counts.
    floors: Scatter = FLOORS
    # Errors of the model's form, relative as `Scatter`, which add to the scatter.
    model_error: Scatter = NO_ERROR
    # Covariance of frequencies, damping ratios, and parts of shapes (sensors x r; real parts first);
    # absent: the deviations are independent.
    covariance: Array | None = None
    absolute: bool = False  # True of shapes of unit modal a, or if they are real, of unit modal mass
    unit: str = "rad/s"  # unit of the frequencies in results: rad/s or Hz
    backbone: Backbone | None = None  # the amplitudes at which they were measured, without shapes

    def __post_init__(self) -> None:
        r, s = len(self.omega), len(self.dofs)
        if not (r and np.all(np.isfinite(self.omega)) and np.all(self.omega > 0)):
            raise UsageError("measured modes need positive frequencies", names=("measurement.modes",))
        for name, expected_shape in (("damping", (r,)), ("omega_std", (r,)), ("damping_std", (r,))):
            array = getattr(self, name)
            if array is not None and array.shape != expected_shape:
                raise UsageError(f"'{name}' is {array.shape}, but must be {expected_shape}")
        for name in ("shape", "shape_std"):
            array = getattr(self, name)
            if array is not None and array.shape != (s, r):
                raise UsageError(
                    f"'{name}' is {array.shape}, but there are {s} sensors and {r} modes",
                    names=("measurement.modes",),
                )

    @property
    def modes(self) -> int:
        """Number of modes."""
        return len(self.omega)

    @property
    def noun(self) -> str:
        """What each is called: mode, or point of a backbone."""
        return "mode" if self.backbone is None else "point"

    @property
    def shapes(self) -> NDArray[Any]:
        """Mode shapes (s x r), the largest component of each 1 in magnitude; NaN where missing."""
        if self.shape is None:
            return np.zeros((0, self.modes))
        return np.asarray(self.shape / self.sizes)

    @property
    def sizes(self) -> Array:
        """Magnitudes of the largest components of the shapes (r); 1 of modes without a shape."""
        if self.shape is None or not len(self.dofs):
            return np.ones(self.modes)
        largest = np.max(np.nan_to_num(np.abs(self.shape)), axis=0)
        return np.where(largest > 0, largest, 1.0)

    @cached_property
    def relative_covariance(self) -> Array:
        """Covariance of frequencies, damping ratios and `shapes`, whose free scales have no weight."""
        assert self.covariance is not None
        parts = 2 if self.complex_shapes else 1
        scale = np.ones(len(self.covariance))
        scale[2 * self.modes :] = np.tile(1 / self.sizes, parts * len(self.dofs))
        covariance = self.covariance * np.outer(scale, scale)
        for k in range(0 if self.absolute else self.modes):
            shape = np.zeros_like(self.shapes, dtype=complex)
            shape[:, k] = self.shapes[:, k]
            for turn in (1, 1j)[:parts]:
                flat = (turn * shape).ravel()
                along = np.concatenate([np.zeros(2 * self.modes), *(flat.real, flat.imag)[:parts]])
                covariance += _FREE_SCALE**2 * np.outer(along, along)
        return np.asarray(covariance)

    @property
    def complex_shapes(self) -> bool:
        """True if shapes are complex."""
        return self.shape is not None and np.iscomplexobj(self.shape)

    @property
    def has_damping(self) -> bool:
        """True if there is a damping ratio."""
        return self.damping is not None and not np.isnan(self.damping).all()

    @property
    def raised(self) -> list[str]:
        """Quantities of which a stated scatter is below its floor, which counts in its place."""
        damping = None if self.damping is None else np.abs(self.damping)
        stated = (self.omega_std, self.omega), (self.damping_std, damping), (self.shape_std, self.sizes)
        return [
            name
            for name, floor, (std, size) in zip(QUANTITIES, self.floors, stated, strict=True)
            if std is not None and size is not None and np.any(std < floor * size)
        ]

    def deviations(self) -> tuple[Array, Array, Array]:
        """Return the relative scatter of frequencies (r), damping ratios (r), and shapes (s x r)."""
        damping = np.full(self.modes, np.nan) if self.damping is None else self.damping
        size = np.where(np.isnan(damping) | (damping == 0), 1.0, np.abs(damping))
        return (
            _floored(self.omega_std, self.omega, USUAL.frequency, self.floors.frequency),
            _floored(self.damping_std, size, USUAL.damping, self.floors.damping),
            _floored(
                self.shape_std,
                np.broadcast_to(self.sizes, (len(self.dofs), self.modes)),
                USUAL.shape,
                self.floors.shape,
            ),
        )


def _floored(deviations: Array | None, size: Array, usual: float, floor: float) -> Array:
    """Return deviations over sizes: those given, not below a floor, else the usual one."""
    if deviations is None:
        return np.full(size.shape, usual)
    relative = deviations / size
    return np.asarray(np.where(np.isnan(relative), usual, np.maximum(relative, floor)))


class ModalChannel(NamedTuple):
    """One quantity of all modes; its values are in units of their deviations."""

    name: str
    unit: str = ""


def channels_of(measurement: ModalMeasurement) -> Sequence[ModalChannel]:
    """Return the quantities that were measured."""
    there = (True, measurement.has_damping, bool(len(measurement.dofs)))
    return [ModalChannel(name) for name, yes in zip(QUANTITIES, there, strict=True) if yes]
