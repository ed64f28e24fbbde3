"""Frequency responses of a model at measured lines, and the measured values, simulated where they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NotIdentifiable, UsageError
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement, stacked, unstacked
from dynid.identification.records.measurement import RecordData, Simulation
from dynid.identification.statistics import root_mean_square
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import Model, freed_model, system_of
from dynid.parameters import named, rates, true_values
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from dynid.structure.nonlinear.branch import Branch

# The most numbers that the solutions at all lines may take.
_MAX_RESPONSE_NUMBERS = 100_000_000
# The most multiplications of one evaluation: some seconds.
_MAX_RESPONSE_WORK = 3e10


class Response(NamedTuple):
    """Responses at all lines: `values` (L x channels), `slopes` (L x channels x p) by the coordinates."""

    values: ComplexArray
    slopes: ComplexArray


def check_cost(model: Model, lines: int) -> None:
    """Refuse a computation that would take too long or too much memory.

    Raises UsageError, with the remedy.
    """
    size = model.size if isinstance(model, StructuralModel) else 0
    if lines * float(size) ** 3 > _MAX_RESPONSE_WORK or lines * size > _MAX_RESPONSE_NUMBERS:
        raise UsageError(
            f"{lines} lines of a model of {size} DOFs are too many to solve again and again",
            remedy="Reduce the structure: reduction: {method: joint-aware}; or give fewer lines.",
            names=("measurement.frf", "measurement"),
        )


@dataclass(frozen=True, eq=False)
class FrfSystem:
    """A model with the channels and forces of measured frequency response functions."""

    system: LinearSystem  # the model with the distinct channels and loads
    pairs: tuple[tuple[int, int], ...]  # of each function the places of its channel and its load
    instruments: Instruments  # gains and delays of the functions' channels
    # `model`, `functions`: the model and the functions that it is made of
    model: Model | None = None
    functions: tuple[Frf, ...] = ()
    _branches: dict[tuple[Label, float, str], Branch] = field(default_factory=dict, init=False, repr=False)

    @property
    def nonlinear(self) -> bool:
        """True if joints have laws: responses then depend on the amplitude of the force."""
        return isinstance(self.model, StructuralModel) and self.model.nonlinear

    def freed(self, *, known_parts: bool) -> FrfSystem | None:
        """Return the same system with considered parameters among the unknown ones; None without such.

        `known_parts`: also known masses and stiffnesses.
        """
        assert self.model is not None
        channels = [function.channel for function in self.functions]
        freed = freed_model(self.model, channels, known_parts=known_parts)
        return None if freed is None else self.of(freed, self.functions)

    @classmethod
    def of(cls, model: Model, functions: Sequence[Frf]) -> FrfSystem:
        """Return the system of a model for some functions.

        Raises UsageError if a channel or a load does not exist.
        """
        channels = list(dict.fromkeys(function.channel for function in functions))
        loads = list(dict.fromkeys(function.load for function in functions))
        pairs = tuple(
            (channels.index(function.channel), loads.index(function.load)) for function in functions
        )
        names = [unknown.name for unknown in model.unknowns]
        instruments = Instruments.of(names, (), [function.channel for function in functions])
        return cls(system_of(model, loads, channels), pairs, instruments, model, tuple(functions))

    def response(self, omega: Array, eta: Array | None = None, *, slopes: bool = True) -> Response:
        """Return the responses at lines (L), rad/s, and their exact slopes by the coordinates.

        `omega`: the lines; `eta`: coordinates of the unknown parameters (p); default: their true values, and
        no slopes. `slopes`: False: no slopes (p = 0). Raises Singular if a line lies on an undamped pole, to
        rounding. Raises UsageError if a true value is missing.
        """
        unknowns = self.system.unknowns
        at = true_values(unknowns) if eta is None else named(unknowns, eta)
        slopes = slopes and eta is not None
        self.system.evaluations += 1
        if self.nonlinear:
            H, moved = self._steady_states(at, omega, slopes=slopes)
        else:
            H, moved = self.system.paired_response(at, omega, self.pairs, slopes=slopes)
        if not self.instruments.ideal:
            gains_and_delays = self.instruments.gains, self.instruments.delays
            (gain, by_gain), (delay, by_delay) = (
                self.instruments.numbers(numbers, at) for numbers in gains_and_delays
            )
            late = -1j * omega[:, None]
            turned = np.exp(late * delay)
            changed = by_gain.T + (late * gain)[..., None] * by_delay.T
            moved = turned[..., None] * (
                gain[:, None] * moved + H[..., None] * changed[..., : moved.shape[2]]
            )
            H = turned * gain * H
        return Response(H, moved * rates(unknowns, eta) if eta is not None and slopes else moved)

    def _steady_states(
        self, values: Mapping[str, float], omega: Array, *, slopes: bool
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return first harmonics of steady states over the force, and their derivatives by the values.

        NaN where the branch of the sweep does not exist.
        """
        from dynid.structure.nonlinear.branch import Branch
        from dynid.structure.nonlinear.stepped_sine import Motions, Sine, stepped_sine

        assert isinstance(self.model, StructuralModel)
        names = [unknown.name for unknown in self.system.unknowns]
        sines: dict[tuple[Label, float, str], Motions] = {}
        H = np.zeros((len(omega), len(self.functions)), dtype=complex)
        moved = np.zeros((*H.shape, len(names)), dtype=complex)
        for column, function in enumerate(self.functions):
            assert function.amplitude is not None
            key = function.force, function.amplitude, function.sweep
            if key not in sines:
                branch = self._branches.setdefault(key, Branch())
                sines[key] = stepped_sine(self.model, values, names, Sine(*key), omega, branch)
            motions, channel = sines[key], function.channel
            row, factor = channel.row(self.model) @ motions.shapes, (1j * omega) ** channel.order
            H[:, column] = factor * (motions.motion @ row)
            moved[:, column] = factor[:, None] * np.einsum("lnp,n->lp", motions.slopes, row)
        return H, moved if slopes else moved[..., :0]


def frf_data(model: Model, measurement: FrfMeasurement) -> RecordData:
    """Return the measured values as real ones, simulated with `model` where they are to be simulated.

    Raises NotIdentifiable if a response has no lines or is nothing but zeros. Raises Singular if a simulated
    line lies on an undamped pole.
    """
    given_noise = measurement.given_noise
    if given_noise is not None:
        given_noise = given_noise / np.sqrt(2)  # of real and imaginary part each
    source = measurement.source
    if isinstance(source, Simulation):
        check_cost(model, len(measurement.omega))
        clean = stacked(FrfSystem.of(model, measurement.channels).response(measurement.omega).values)
        noise, by_line, spread = source.deviation(clean), None, np.ones(())
        if source.noise is not None:
            noise = noise / np.sqrt(2)  # half of the power in each part
        if source.noise_by_line:
            spread = np.abs(unstacked(clean)) / root_mean_square(np.abs(unstacked(clean)))
            by_line = np.sqrt(2) * noise * spread
            spread = np.concatenate([spread, spread])
        generator = np.random.Generator(np.random.PCG64(source.seed))
        added = noise * spread * generator.standard_normal(clean.shape)
        data = RecordData(clean + added, noise, clean, given_noise, by_line=by_line if noise.all() else None)
    else:
        values = np.asarray(source)
        complete = np.where(np.isnan(values), complex(np.nan, np.nan), values)
        data = RecordData(stacked(np.asarray(complete / measurement.profile)), given=given_noise)
    for column, channel in enumerate(measurement.channels):
        if not np.any(np.nan_to_num(data.values[:, column])):
            raise NotIdentifiable(
                f"the frequency response {channel.name} is nothing but zeros or missing lines",
                remedy="Leave it out, or check the sensor and the excitation.",
                names=("measurement",),
            )
    return data
