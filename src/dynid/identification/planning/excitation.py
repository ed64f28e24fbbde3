"""Ranking of excitations: sines by the information of their steady states, in the frequency domain.

A sine of amplitude A at omega gives a channel the steady motion Re(A H e^(i omega t)); N samples of it hold
the information N A^2 / (2 sigma^2) Re(g^H g) on the parameters, with g = dH/dlog(theta). All forces have the
same RMS, so that designs compare as places for one shaker. What the unknown initial state takes is left out
here; `exact_bounds` takes it into account.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import Singular, UsageError
from dynid.identification.identifiability import ExpectedRecords
from dynid.identification.information import information
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.planning.selection import Candidates, relative_slopes, select
from dynid.identification.records.measurement import Experiment
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import Model, parametric_model, system_of
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.lti.signals import Impulse, Multisine, Signal, Sine
from dynid.number_format import frequency_text
from dynid.parameters import rates
from dynid.result import Result, common_unit
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import modes
from dynid.structure.ports import Load

# Poles below this part of the largest are at zero.
_ZERO_POLE_TOL = 1e-9
# Frequencies in all, at the most; and how far below the lowest mode, above the highest, and below Nyquist's.
_MAX_LINES, _BELOW, _ABOVE, _NYQUIST = 300, 0.3, 1.5, 0.9


@dataclass(frozen=True, eq=False)
class _CandidateSines:
    """Candidate sines for a record, with the information of each if it had the whole force."""

    model: Model  # the structure or graph
    dofs: tuple[Label, ...]  # where a force may act: DOFs, or sources of a graph
    omega: Array  # frequencies, rad/s: whole numbers of periods in the record
    rms: float  # RMS of the excitation
    roots: Array  # roots of the information on relative changes of parameters (omega x dofs x rows x p)
    bands: list[tuple[float, float]]  # around each mode, up to the geometric means with its neighbours, rad/s

    def candidates(self, count: int) -> Candidates:
        """Return the candidates, frequency by frequency, for a design of so many lines."""
        rows, columns = self.roots.shape[2:]
        # Forces of one frequency at two DOFs cause one motion: their information does not add up.
        alike = np.repeat(np.arange(len(self.omega)), len(self.dofs))
        return Candidates(self.roots.reshape(-1, rows, columns) / np.sqrt(count), 0, alike)

    def line(self, candidate: int) -> tuple[Label, float]:
        """Return DOF and frequency of a candidate."""
        at, dof = divmod(candidate, len(self.dofs))
        return self.dofs[dof], float(self.omega[at])

    def loads(self, chosen: Sequence[int]) -> list[Any]:
        """Return the forces of a design, of equal amplitudes, one multisine a DOF."""
        amplitude = self.rms * np.sqrt(2 / len(chosen))
        at = [self.line(candidate) for candidate in chosen]
        return [
            _load_at(self.model, dof, Multisine([amplitude] * len(mine), mine))
            for dof in self.dofs
            if (mine := [omega for at_dof, omega in at if at_dof == dof])
        ]


def grid(omega: Array, step: float, samples: int, band: tuple[float, float] | None = None) -> Array:
    """Return frequencies with whole numbers of periods in the record, those near the natural ones `omega`.

    `band`, rad/s: where to look; default: from below the lowest mode to above the highest, or near Nyquist's.
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
            f"no sine between {frequency_text(low, 3)} and {frequency_text(high, 3)} has a whole period in "
            "the record and lies below half its sampling rate",
            remedy="Record longer, sample faster, or look elsewhere (plan.excitation.band).",
            names=("plan.excitation.band", "measurement.samples"),
        )
    numbers = np.arange(first, last + 1)
    if len(numbers) > _MAX_LINES:
        numbers = np.unique(np.rint(np.geomspace(first, last, _MAX_LINES)).astype(int))
    resonant = np.rint(elastic / spacing).astype(int)
    resonant = resonant[(resonant >= first) & (resonant <= last)]
    return np.asarray(np.union1d(numbers, resonant) * spacing)


def candidate_sines(
    model: Model,
    experiment: Experiment,
    expected: ExpectedRecords,
    dofs: Sequence[Label],
    band: tuple[float, float] | None = None,
) -> _CandidateSines:
    """Return candidate sines at DOFs with their information, the noise of the record's channels unchanged.

    The force or source has the RMS of the present one; 1 where there is none.
    """
    measurement, values = experiment.measurement, expected.values
    loads = [_load_at(model, dof, Impulse(1.0)) for dof in dofs]
    system = system_of(model, loads, measurement.channels)
    natural = natural_frequencies(model, system, values)
    omega = grid(natural, measurement.step, measurement.samples, band)
    rate = rates(system.unknowns, expected.fit.eta)
    record = expected.likelihood.records[0]
    assert isinstance(record, TimeRecord)
    inputs = record.model.inputs()
    rms = float(np.sqrt(np.mean(np.sum(inputs**2, axis=1)))) if inputs.size else 0.0
    rms = rms or 1.0
    weight = rms * np.sqrt(measurement.samples) / expected.noise[0]
    channels = range(len(measurement.channels))
    pairs = [(channel, load) for channel in channels for load in range(len(dofs))]
    kept, roots = [], []
    for w in omega:
        try:
            _, slopes = system.paired_response(values, np.array([w]), pairs)
        except Singular:
            continue  # an undamped pole, where there is no steady state
        G = (slopes[0] * rate).reshape(len(channels), len(dofs), -1) * weight[:, None, None]
        kept.append(w)
        roots.append(np.concatenate([G.real, G.imag]).swapaxes(0, 1))
    if not kept:
        raise UsageError(
            "every candidate frequency lies on an undamped mode", names=("plan.excitation.band",)
        )
    inside = np.unique(natural[(natural >= kept[0]) & (natural <= kept[-1])])
    edges = [float(kept[0]), *np.sqrt(inside[:-1] * inside[1:]).tolist(), float(kept[-1])]
    relative = relative_slopes(np.array(roots), expected.relative_rates)
    return _CandidateSines(model, tuple(dofs), np.array(kept), rms, relative, list(pairwise(edges)))


def _load_at(model: Model, where: Label, signal: Signal) -> Any:
    """Return a force at a DOF of a structure, or a signal of a source of a graph."""
    if isinstance(model, StructuralModel):
        return Load(where, signal, kind=model.kind(where))
    assert isinstance(model, IdentifiedGraph)
    return model.load(str(where), signal)


def natural_frequencies(model: Model, system: LinearSystem, values: Mapping[str, float]) -> Array:
    """Return the natural frequencies of a structure without damping; of a graph the sizes of its poles."""
    if isinstance(model, StructuralModel):
        return modes(*model.dense(values), backend="dense").omega
    poles = system.poles(values)
    sizes = np.abs(poles[poles.imag >= 0])
    return np.unique(sizes[sizes > _ZERO_POLE_TOL * sizes.max(initial=0.0)])


def exact_bounds(
    model: Model, experiment: Experiment, expected: ExpectedRecords, loads: Sequence[Any]
) -> Array:
    """Return bounds on coordinates (p) of a record of the steady state under sines, initial state unknown."""
    measurement = experiment.measurement
    times = measurement.record.times
    joint = parametric_model(model, loads, measurement.channels, times)
    eta, n = expected.fit.eta, joint.states
    free, steps = free_prediction(joint, eta)
    matrices = joint.at(eta)
    settled = np.zeros(n)  # state of the steady state at the first time, scaled
    for column, load in enumerate(loads):
        assert isinstance(load.signal, Multisine)
        for w, c in zip(*load.signal.lines, strict=True):
            moved = np.linalg.solve(1j * w * np.eye(n) - matrices.A, matrices.B[:, column].astype(complex))
            settled += (moved * c * np.exp(1j * w * float(joint.line.nodes[0]))).real
    predicted = prediction(joint, eta, settled, free, steps)
    record = expected.likelihood.records[0]
    assert isinstance(record, TimeRecord)
    root = record.root
    weight = 1 / expected.noise[0][:, None]
    by_parameter = (predicted.by_parameter * weight).reshape(-1, len(expected.values))
    by_state = (predicted.by_state @ root * weight).reshape(len(by_parameter), -1)
    signal = float(np.linalg.norm(predicted.outputs / expected.noise[0]))
    names = tuple(expected.likelihood.names)
    return information(names, by_parameter, by_state, signal, predicted.outputs.size).bounds()


def add_excitation(
    result: Result,
    model: Model,
    experiment: Experiment,
    expected: ExpectedRecords,
    sines: _CandidateSines,
    count: int,
) -> None:
    """Add the ranking of excitations to a result.

    ``plan/excitation/``: `dof` and `omega` of the candidates with the `worth` of each alone (omega x dof: the
    geometric mean of what the bounds would be, relative; of steady states, whole force in that line);
    the best set: `choice_dof`, `choice_omega`, `amplitude` with its `gain` (by which factor each line, at the
    amplitude of the set, narrows the bounds) and its `best_bound` (parameter), initial state unknown;
    `settling_time`, in which the slowest mode decays to a hundredth, if it does;
    `present_bound` of the excitation as it is, `efficiency`, the geometric mean of the best bounds over
    these; and `bands/`: the force spread evenly over the surroundings of each mode, band by band.
    """
    group, names = "plan/excitation", expected.likelihood.names
    result.add_axis(f"{group}/parameter", names)
    result.add_axis(f"{group}/dof", [str(dof) for dof in sines.dofs])
    result.add_axis(f"{group}/omega", sines.omega, "rad/s")
    alone = sines.candidates(1).gains([]).reshape(len(sines.omega), len(sines.dofs))
    result.add(f"{group}/worth", np.exp(-alone / (2 * len(names))), ("omega", "dof"))
    candidates = sines.candidates(count)
    chosen = select(candidates, count)
    at = [sines.line(candidate) for candidate in chosen]
    result.add_axis(f"{group}/choice", [f"{dof} at {omega:.5g} rad/s" for dof, omega in at])
    dofs, gains = [str(dof) for dof, _ in at], candidates.steps(chosen)
    result.add_all(group, ("choice",), choice_dof=dofs, gain=gains)
    result.add(f"{group}/choice_omega", [omega for _, omega in at], ("choice",), "rad/s")
    units = common_unit(load.unit for load in sines.loads(chosen))
    result.add(f"{group}/amplitude", sines.rms * np.sqrt(2 / len(chosen)), (), units)
    result.annotate(group, driven="source" if isinstance(model, IdentifiedGraph) else "force")
    best = exact_bounds(model, experiment, expected, sines.loads(chosen))
    present = expected.information().bounds()
    relative = expected.relative_rates
    result.add_all(group, ("parameter",), best_bound=relative * best, present_bound=relative * present)
    both = np.isfinite(best).all() and np.isfinite(present).all()
    ratio = (
        float(np.exp(np.mean(np.log(best) - np.log(present)))) if both else float(np.isfinite(present).all())
    )
    result.add(f"{group}/efficiency", ratio)
    slowest = float(np.min(-result["identification/identifiability/modal_sensitivity/pole"].data.real))
    if slowest > 0:
        result.add(f"{group}/settling_time", np.log(100) / slowest, (), "s")
    _add_bands(result, sines, names, np.where(np.isfinite(relative), 1.0, np.inf))


def present_lines(experiment: Experiment) -> int:
    """Return the number of sines of the present excitation, 3 where it is none of sines."""
    signals = [load.signal for load in experiment.loads]
    counts = [
        len(signal.frequency) if isinstance(signal, Multisine) else int(isinstance(signal, Sine))
        for signal in signals
    ]
    return sum(counts) if all(counts) and counts else 3


def _add_bands(result: Result, sines: _CandidateSines, names: Sequence[str], relative: Array) -> None:
    group = "plan/excitation/bands"
    columns = len(names)
    rows = []
    for number, (low, high) in enumerate(sines.bands, 1):
        inside = np.flatnonzero((sines.omega >= low) & (sines.omega <= high))
        for k, dof in enumerate(sines.dofs):
            if len(inside):
                # Lines that are not evenly spaced are weighted by the width that each represents.
                width = np.gradient(sines.omega)[inside] if len(sines.omega) > 1 else np.ones(1)
                share = np.sqrt(width / width.sum())[:, None, None]
                root = np.linalg.qr((sines.roots[inside, k] * share).reshape(-1, columns), mode="r")
                design = Candidates(np.asarray(root)[None], 0)
                worth, bound = design.worth([0]), relative * design.bounds([0])
                rows.append((f"{dof} in band {number}", str(dof), low, high, worth, bound))
    rows.sort(key=lambda row: -row[4])
    bands, dofs, lows, highs, _, bounds = zip(*rows, strict=True) if rows else [()] * 6
    result.add_axes(group, band=bands, parameter=names)
    result.add(f"{group}/dof", dofs, ("band",))
    result.add_all(group, ("band",), "rad/s", low=lows, high=highs)
    result.add(f"{group}/bound", np.reshape(bounds, (len(rows), columns)), ("band", "parameter"))
