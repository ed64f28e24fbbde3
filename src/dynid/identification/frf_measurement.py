"""Measured frequency response functions: lines, channels, and their data, measured or simulated.

Complex values are treated as real ones, their real parts above their imaginary parts, over a deviation by
line where that differs: residuals then are white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import NotIdentifiable, Singular, UsageError
from dynid.identification.measurement import RecordData, Simulation, per_channel
from dynid.lti.frequency_response import second_order_response
from dynid.number_format import frequency_text
from dynid.structure.matrices import Label, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# The most numbers that the solutions at all lines may take.
_MOST_NUMBERS = 100_000_000
# The most multiplications of one evaluation: some seconds.
_MOST_WORK = 3e10
# Least deviation of a line, as a part of the largest.
_LEAST_DEVIATION = 1e-6


class Frf(NamedTuple):
    """A frequency response function: the response of `channel` to a unit force at the DOF `force`."""

    channel: Channel
    force: Label

    @property
    def name(self) -> str:
        """Its name in results, ``<dof>.<quantity>/<force>``."""
        return f"{self.channel.name}/{self.force}"

    @property
    def unit(self) -> str:
        """Its unit, SI."""
        return f"{self.channel.unit}/N"


@dataclass(frozen=True, eq=False)
class FrfMeasurement:
    """Frequency response functions at common lines.

    Parameters
    ----------
    omega
        Lines (L), rad/s, increasing.
    channels
        The frequency response functions.
    source
        Measured values (L x channels, complex, SI units, NaN where a line is missing), or how to simulate
        them: complex noise whose standard deviation is the ratio times the channel's RMS.
    noise
        Standard deviation of the complex noise, root of E |n|^2: one number, or one a channel, NaN where it
        is unknown. Absent: it is estimated from the residuals.
    deviation
        The noise's standard deviation by line (L x channels).
    relative
        True if only the ratio of deviations from line to line is known; their size is then `noise`.
    """

    omega: Array
    channels: tuple[Frf, ...]
    source: Simulation | ArrayLike = field(default_factory=Simulation)
    noise: float | Sequence[float] | None = None
    deviation: Array | None = None
    relative: bool = False

    def __post_init__(self) -> None:
        omega = np.atleast_1d(np.array(self.omega, dtype=float))
        object.__setattr__(self, "omega", omega)
        if not (np.isfinite(omega).all() and np.all(omega >= 0) and np.all(np.diff(omega) > 0)):
            raise UsageError(
                "the lines of a frequency response must be finite, not negative, and increase",
                names=("measurement.frf",),
            )
        names = [channel.name for channel in self.channels]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise UsageError(f"the frequency response {twice} is named twice", names=("measurement",))
        shape = (len(omega), len(names))
        if not isinstance(self.source, Simulation):
            values = np.array(self.source, dtype=complex)
            if values.shape != shape:
                raise UsageError(f"measured responses are {values.shape}, but must be {shape}")
            if np.isinf(values).any():
                raise UsageError("measured responses must be finite, or NaN where a line is missing")
            object.__setattr__(self, "source", values)
        if self.deviation is not None:
            self._check_deviation(np.asarray(self.deviation, dtype=float), shape)

    def _check_deviation(self, deviation: Array, shape: tuple[int, int]) -> None:
        if deviation.shape != shape:
            raise UsageError(f"deviations by line are {deviation.shape}, but must be {shape}")
        good = np.isnan(deviation) | (np.isfinite(deviation) & (deviation >= 0))
        if not good.all():
            raise UsageError("deviations by line must be finite and not negative", names=("measurement.frf",))
        if isinstance(self.source, Simulation):
            raise UsageError("simulated responses have the same noise at all lines")
        if self.noise is not None and not self.relative:
            raise UsageError("the noise is given by line already", names=("measurement.noise", "measurement"))

    @property
    def given_noise(self) -> Array | None:
        """The given deviations of the complex noise (channels), in units of `profile`."""
        if self.deviation is not None and not self.relative:
            return np.ones(len(self.channels))
        return (
            None if self.noise is None else per_channel("measurement.noise", self.noise, len(self.channels))
        )

    @property
    def profile(self) -> Array:
        """Deviation by line (L x channels) by which values are divided; 1 where none is given."""
        if self.deviation is None:
            return np.ones((len(self.omega), len(self.channels)))
        deviation = np.asarray(self.deviation, dtype=float)
        most = np.nanmax(deviation, axis=0, initial=0.0)
        floored = np.maximum(
            np.nan_to_num(deviation, nan=0.0), _LEAST_DEVIATION * np.where(most > 0, most, 1)
        )
        return np.asarray(np.where(np.isnan(deviation), np.nan, floored))


class Response(NamedTuple):
    """Responses at all lines: `values` (L x channels), `slopes` (L x channels x p) by the logarithms."""

    values: ComplexArray
    slopes: ComplexArray


def check_cost(model: StructuralModel, lines: int) -> None:
    """Refuse a computation that would take too long or too much memory.

    Raises
    ------
    UsageError
        With the remedy.
    """
    if lines * float(model.size) ** 3 > _MOST_WORK or lines * model.size > _MOST_NUMBERS:
        raise UsageError(
            f"{lines} lines of a model of {model.size} DOFs are too many to solve again and again",
            remedy="Reduce the structure: reduction: {method: joint-aware}; or give fewer lines.",
            names=("measurement.frf", "measurement"),
        )


def responses(
    model: StructuralModel, channels: Sequence[Frf], omega: Array, logs: Array | None = None
) -> Response:
    """Return frequency response functions and their exact slopes, ``dH = -H dZ H`` on the dynamic stiffness.

    Parameters
    ----------
    model
        The structure.
    channels, omega
        The functions, and their lines (L), rad/s.
    logs
        Logarithms of the unknown parameters (p); absent: their true values, and no slopes.

    Raises
    ------
    Singular
        If a line lies on an undamped pole, to rounding.
    UsageError
        If a DOF does not exist or a true value is missing.
    """
    names = [unknown.name for unknown in model.unknowns]
    values = model.true_values() if logs is None else dict(zip(names, np.exp(logs).tolist(), strict=True))
    M, C, K = model.dense(values)
    forces = np.array([model.row(channel.force) for channel in channels])
    rows = np.array([channel.channel.row(model) for channel in channels])
    ends, where = np.unique(np.concatenate([forces, rows]), axis=0, return_inverse=True)
    where = where.reshape(2, len(channels))
    n = len(M)
    solved = second_order_response(M, C, K, ends.T, np.eye(n), np.zeros(n, dtype=int), omega)
    infinite = ~np.isfinite(solved).all(axis=(1, 2))
    if infinite.any():
        raise Singular(
            f"at {frequency_text(float(omega[np.argmax(infinite)]), 6)} a frequency response is infinite: "
            "that line lies on an undamped pole",
            remedy="Leave that line out, or give the structure some damping.",
            names=("measurement.frf", "measurement"),
        )
    driven, read = solved[:, :, where[0]], solved[:, :, where[1]]
    factor = (1j * omega[:, None]) ** [channel.channel.order for channel in channels]
    H = factor * np.einsum("cn,lnc->lc", rows, driven)
    slopes = np.empty((*H.shape, 0 if logs is None else len(names)), dtype=complex)
    for k, unknown in enumerate(model.unknowns[: slopes.shape[-1]]):
        pattern = as_array(unknown.pattern)
        here = np.flatnonzero(pattern.any(axis=0))
        bent = pattern[np.ix_(here, here)] @ driven[:, here]
        rate = values[unknown.name] * (1j * omega[:, None] if unknown.letter == "c" else 1.0)
        slopes[..., k] = -factor * rate * np.sum(read[:, here] * bent, axis=1)
    return Response(H, slopes)


def frf_data(model: StructuralModel, measurement: FrfMeasurement) -> RecordData:
    """Return the measured values as real ones, simulated with `model` where they are to be simulated.

    Raises
    ------
    NotIdentifiable
        If a response has no lines or is nothing but zeros.
    Singular
        If a simulated line lies on an undamped pole.
    """
    given = measurement.given_noise
    if given is not None:
        given = given / np.sqrt(2)  # of real and imaginary part each
    source = measurement.source
    if isinstance(source, Simulation):
        check_cost(model, len(measurement.omega))
        clean = stacked(responses(model, measurement.channels, measurement.omega).values)
        noise = source.deviation(clean)
        if source.noise is not None:
            noise = noise / np.sqrt(2)  # half of the power in each part
        generator = np.random.Generator(np.random.PCG64(source.seed))
        data = RecordData(clean + noise * generator.standard_normal(clean.shape), noise, clean, given)
    else:
        values = np.asarray(source)
        whole = np.where(np.isnan(values), complex(np.nan, np.nan), values)
        data = RecordData(stacked(np.asarray(whole / measurement.profile)), given=given)
    for column, channel in enumerate(measurement.channels):
        if not np.any(np.nan_to_num(data.values[:, column])):
            raise NotIdentifiable(
                f"the frequency response {channel.name} is nothing but zeros or missing lines",
                remedy="Leave it out, or check the sensor and the excitation.",
                names=("measurement",),
            )
    return data


def stacked(values: ComplexArray) -> Array:
    """Return complex values (L x …) as real ones (2 L x …), the imaginary parts below the real ones."""
    return np.concatenate([values.real, values.imag])


def unstacked(values: Array) -> ComplexArray:
    """Return real values (2 L x …) as the complex ones they were stacked from (L x …)."""
    real, imaginary = np.split(values, 2)
    return np.asarray(real + 1j * imaginary)
