"""Which sines to excite, and where: information in the frequency domain, of steady states.

A sine of amplitude A at omega gives a channel the steady motion Re(A H e^(i omega t)); N samples of it hold
the information N A^2 / (2 sigma^2) Re(g^H g) on the parameters, with g = dH/dlog(theta). All forces have the
same RMS, so that designs compare as places for one shaker. What the unknown initial state takes is left out
here; what a design gives with it is told by `exact_bounds`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.identification.augmented import augmented
from dynid.identification.identifiability import Prospect, relative_bounds
from dynid.identification.information import information
from dynid.identification.measurement import Experiment
from dynid.identification.planning.selection import Candidates
from dynid.identification.prediction import free_prediction, prediction
from dynid.lti.frequency import WORST_CONDITION
from dynid.lti.signals import Multisine
from dynid.structure.matrices import Label, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes.solve import modes
from dynid.structure.response import Load, ports

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Frequencies in all, at the most; and how far below the lowest mode, above the highest, and below Nyquist's.
_MOST_LINES, _BELOW, _ABOVE, _NYQUIST = 300, 0.3, 1.5, 0.9


@dataclass(frozen=True, eq=False)
class Lines:
    """Candidate sines for a record, and what each would tell if it had the whole force.

    Attributes
    ----------
    dofs
        Where a force may act.
    omega
        Frequencies, rad/s: whole numbers of periods in the record.
    rms
        RMS of the force, N.
    roots
        Roots of the information on the parameters' logarithms (omega x dofs x rows x p).
    bands
        Around each mode, up to the geometric means with its neighbours, rad/s.
    """

    dofs: tuple[Label, ...]
    omega: Array
    rms: float
    roots: Array
    bands: list[tuple[float, float]]

    def candidates(self, count: int) -> Candidates:
        """Return the candidates, frequency by frequency, for a design of so many lines."""
        rows, columns = self.roots.shape[2:]
        # Forces of one frequency at two DOFs make one motion: their information does not add up.
        alike = np.repeat(np.arange(len(self.omega)), len(self.dofs))
        return Candidates(self.roots.reshape(-1, rows, columns) / np.sqrt(count), 0, alike)

    def line(self, candidate: int) -> tuple[Label, float]:
        """Return DOF and frequency of a candidate."""
        at, dof = divmod(candidate, len(self.dofs))
        return self.dofs[dof], float(self.omega[at])

    def loads(self, chosen: Sequence[int]) -> list[Load]:
        """Return the forces of a design, of equal amplitudes, one multisine a DOF."""
        amplitude = self.rms * np.sqrt(2 / len(chosen))
        at = [self.line(candidate) for candidate in chosen]
        return [
            Load(dof, Multisine([amplitude] * len(mine), mine))
            for dof in self.dofs
            if (mine := [omega for place, omega in at if place == dof])
        ]


def grid(omega: Array, step: float, samples: int, band: tuple[float, float] | None = None) -> Array:
    """Return frequencies with whole numbers of periods in the record, natural ones among them.

    Parameters
    ----------
    omega
        Natural frequencies, rad/s.
    step, samples
        Sampling of the record.
    band
        Where to look, rad/s; absent: from below the lowest mode to above the highest, or to near Nyquist's.

    Raises
    ------
    UsageError
        If the record is too short to hold a period there.
    """
    spacing = 2 * np.pi / (step * samples)
    elastic = omega[omega > 0]
    nyquist = _NYQUIST * np.pi / step
    low, high = band or (
        _BELOW * elastic.min(initial=nyquist), min(nyquist, _ABOVE * elastic.max(initial=nyquist))
    )  # fmt: skip
    first, last = max(1, int(np.ceil(low / spacing))), int(min(high, nyquist) / spacing)
    if last < first:
        raise UsageError(
            f"no sine between {low:.3g} and {high:.3g} rad/s has a whole period in the record and lies below "
            "half its sampling rate",
            remedy="Record longer, sample faster, or look elsewhere (plan.excitation.band).",
            names=("plan.excitation.band", "measurement.samples"),
        )
    numbers = np.arange(first, last + 1)
    if len(numbers) > _MOST_LINES:
        numbers = np.unique(np.rint(np.geomspace(first, last, _MOST_LINES)).astype(int))
    resonant = np.rint(elastic / spacing).astype(int)
    resonant = resonant[(resonant >= first) & (resonant <= last)]
    return np.asarray(np.union1d(numbers, resonant) * spacing)


def lines(
    model: StructuralModel,
    experiment: Experiment,
    expected: Prospect,
    dofs: Sequence[Label],
    band: tuple[float, float] | None = None,
) -> Lines:
    """Return what candidate sines at DOFs would tell the record's channels, whose noise stays as it is.

    The force has the RMS of the present one; 1 N where there is none.
    """
    measurement, values = experiment.measurement, expected.values
    M, C, K = model.dense(values)
    natural = modes(M, C, K, backend="dense").omega
    omega = grid(natural, measurement.step, measurement.samples, band)
    forces, rows, orders = ports(model, dofs, measurement.channels)
    patterns = [
        (unknown.letter, values[unknown.name] * as_array(unknown.pattern)) for unknown in model.unknowns
    ]
    inputs = expected.ensemble.records[0].model.line.inputs()
    rms = float(np.sqrt(np.mean(np.sum(inputs**2, axis=1)))) if inputs.size else 0.0
    rms = rms or 1.0
    weight = rms * np.sqrt(measurement.samples) / expected.noise[0]
    kept, roots = [], []
    for w in omega:
        solved = _solved(K + 1j * w * C - w**2 * M, np.hstack([forces, rows.T]))
        if solved is None:
            continue
        by_force, by_row = solved[:, : len(dofs)], solved[:, len(dofs) :]
        power = (1j * w) ** np.array(orders)
        slopes = [-by_row.T @ (P * (1j * w if letter == "c" else 1.0)) @ by_force for letter, P in patterns]
        G = np.stack(slopes, axis=-1) * (power * weight)[:, None, None]  # channels x dofs x p
        kept.append(w)
        roots.append(np.concatenate([G.real, G.imag]).swapaxes(0, 1))
    if not kept:
        raise UsageError(
            "every candidate frequency lies on an undamped mode", names=("plan.excitation.band",)
        )
    return Lines(tuple(dofs), np.array(kept), rms, np.array(roots), _bands(np.array(kept), natural))


def _solved(Z: NDArray[np.complex128], forces: Array) -> NDArray[np.complex128] | None:
    """Solve for the steady state; None on an undamped pole, where there is none."""
    scale = 1 / np.sqrt(np.linalg.norm(Z, axis=0))  # so that units do not count
    balanced = Z * scale * scale[:, None]
    if not np.linalg.cond(balanced, 1) < WORST_CONDITION:
        return None
    return np.asarray(scale[:, None] * np.linalg.solve(balanced, scale[:, None] * forces))


def _bands(omega: Array, natural: Array) -> list[tuple[float, float]]:
    """Return a band around each natural frequency among these frequencies."""
    inside = np.unique(natural[(natural >= omega[0]) & (natural <= omega[-1])])
    edges = [float(omega[0]), *np.sqrt(inside[:-1] * inside[1:]).tolist(), float(omega[-1])]
    return list(pairwise(edges))


def exact_bounds(
    model: StructuralModel, experiment: Experiment, expected: Prospect, loads: Sequence[Load]
) -> Array:
    """Return the relative bounds (p) of a record under sines that have settled, initial state unknown."""
    measurement = experiment.measurement
    times = measurement.record.times
    joint = augmented(model, loads, measurement.channels, times)
    free, steps = free_prediction(joint, expected.fit.logs)
    x0 = _settled(model, loads, float(times[0]), expected.values) / joint.scale
    seen = prediction(joint, expected.fit.logs, x0, free, steps)
    root = expected.ensemble.records[0].root
    weight = 1 / expected.noise[0][:, None]
    by_parameter = (seen.by_parameter * weight).reshape(-1, len(expected.values))
    by_state = (seen.by_state @ root * weight).reshape(len(by_parameter), -1)
    signal = float(np.linalg.norm(seen.outputs / expected.noise[0]))
    names = tuple(expected.ensemble.names)
    return relative_bounds(information(names, by_parameter, by_state, signal, seen.outputs.size))


def _settled(model: StructuralModel, loads: Sequence[Load], time: float, values: dict[str, float]) -> Array:
    """Return displacements and velocities of the steady state at a time (2 n)."""
    M, C, K = model.dense(values)
    x = np.zeros(2 * model.size)
    for load in loads:
        assert isinstance(load.signal, Multisine)
        assert load.dof is not None
        for w, c in zip(*load.signal.lines, strict=True):
            moved = (
                np.linalg.solve(K + 1j * w * C - w**2 * M, model.row(load.dof)) * c * np.exp(1j * w * time)
            )
            x += np.concatenate([moved.real, (1j * w * moved).real])
    return x
