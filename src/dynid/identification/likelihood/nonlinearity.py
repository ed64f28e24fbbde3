"""Score test of the joints: forces in the residual of a linear fit that no linear joint exerts.

At each joint six forces act on the linear model: d|d|, d^2, |d|v, dv, d^3 and |v|v, of the relative
displacement d and velocity v that the fit predicts. Their linear responses are the derivatives of the
prediction by the coefficients of such forces at zero, and the residual is regressed on them (score, or
Lagrange multiplier test: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50–57). No nonlinear model is fitted.
The test of a joint has the forces of two sliders as well, elastic up to parts of the largest displacement:
most of what friction leaves beside linear joints depends on the past, and is no function of d and v.

Other errors of a model leave residuals, too. So residuals and responses are first projected off the
regressors of the saturated model (`saturated_model`), in which amplitudes, residues and poles of any linear
structure are free channel by channel, off the derivatives by first states, and off those by the parameters.
Where a linear structure with the poles of the record, which need not be near those of the model, explains
what the forces do not, the test is repeated beside it, whitened: large linear errors do not fire.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.defaults import LACK_OF_FIT, NONLINEAR
from dynid.identification.likelihood.joint_responses import (
    FORCES,
    TERMS,
    JointResponses,
    forces_of,
    motions_of,
)
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.likelihood.saturated_model import (
    RegressorKind,
    Regressors,
    forced_regressors,
    regressors_in_time,
)
from dynid.identification.likelihood.saturated_record import shared_regressors
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.noise import ColouredNoise, estimated
from dynid.identification.statistics import log_f_tail
from dynid.identification.systems.prediction import Prediction, Trajectory
from dynid.identification.systems.structure_system import JointPorts, StructureSystem
from dynid.number_format import p_text, short_percent
from dynid.parameters import named

# Terms that are even in the motion.
_EVEN = ("d2", "dv")
# Most numbers of a record's columns: of a longer record the first samples are tested.
_MAX_NUMBERS = 30_000_000
# Eigenvalues of products of unit columns below this part of the largest are linear dependence, to rounding.
_RANK_TOL = 1e-9
# Part of a column's square that is left beside others below which it is one of them, to rounding.
_ABSORBED_SQUARE = 1e-8
# Most regressors of a linear structure with free poles, as a part of the samples, too; most steps of the
# poles, the longest one as a part of the pole, and the part of what is left that a step must explain.
_MAX_FREE_REGRESSORS, _ROWS_PER_REGRESSOR = 400, 6
_MAX_POLE_STEPS, _LONGEST_POLE_STEP, _POLE_GAIN = 12, 0.1, 1e-3
# p-value below which linear directions are freed further.
_FREED_LEVEL = 0.01
# Residuals below this part of the signal are errors of rounding and holds.
_RESIDUAL_ROUND_OFF = 1e-6


class _Columns(NamedTuple):
    """Products of columns that are left of all records, over noise, and what these count."""

    gram: Array  # of derivatives by parameters, responses to the forces, and residual (w x w)
    sizes: Array  # squares of the same columns before they were projected (w)
    signal_squares: (
        Array  # squares of the responses over the signals' RMS, projected, by channel and sample (8 J)
    )
    degrees: float  # values less the directions that they were projected off
    variances: Array  # those that channels are weighted by (channels)


@dataclass(frozen=True, eq=False)
class Nonlinearity:
    """The score test of the joints."""

    joints: tuple[str, ...]
    p: Array  # p-value of each force (joints x terms), NaN where its response is that of a linear model
    size: Array  # response to each force, as the residual has it, in % of the response (joints x terms)
    joint_p: Array  # p-value of all forces of a joint, sliders included (joints)
    nonlinear_p: float  # p-value of all forces of all joints: were the joints linear
    # What all forces leave of the residual: its sum of squares over the noise, and degrees of freedom.
    left: float
    degrees: float

    @property
    def nonlinear(self) -> bool:
        """True if the residuals contradict linear joints."""
        return self.nonlinear_p < NONLINEAR.value

    @cached_property
    def verdict(self) -> str:
        """The verdict in one line."""
        if not self.nonlinear:
            return f"no sign of a nonlinear joint (score test, {p_text(self.nonlinear_p)})"
        joint = int(np.nanargmin(self.joint_p))
        term = int(np.nanargmin(self.p[joint]))
        level = math.sqrt(self.p[joint, term])  # those that say at least half as much as the clearest
        significant = [name for name, p in zip(TERMS, self.p[joint], strict=True) if p <= level]
        parities = {"even" if name in _EVEN else "odd" for name in significant}
        part = short_percent(float(self.size[joint, term]))
        parity = " and ".join(sorted(parities, reverse=True))
        return (
            f"nonlinear: joint {self.joints[joint]}, {parity} in the motion "
            f"({', '.join(significant)}), {part} of the response "
            f"(score test, {p_text(self.nonlinear_p)})"
        )


def nonlinearity(likelihood: Likelihood, fit: Fit, *, white: bool) -> Nonlinearity | None:
    """Return the score test of the joints; None where no record of time has scalar joints without laws.

    `likelihood`, `fit`: records with their model, and its fit; `white`: True if its residuals are.
    """
    tested = [
        (record, record_fit, record.model.system.joint_ports(named(record.unknowns, fit.eta)))
        for record, record_fit in zip(likelihood.records, fit.parts, strict=True)
        if isinstance(record, TimeRecord)
        and isinstance(record.model.system, StructureSystem)
        and not record.model.system.model.nonlinear
        and not record.model.instruments.clocked  # joints' motions are at the record's times
    ]
    if not tested or not tested[0][-1].names:
        return None
    tested = [(*_first_samples(record, record_fit, joints), joints) for record, record_fit, joints in tested]
    motions = [motions_of(record.model, record_fit, joints) for record, record_fit, joints in tested]
    units = np.max([np.abs(motion).max(axis=1) for motion in motions], axis=0)[:, None]
    units = np.where(units > 0, units, 1.0)
    names, p = tested[0][-1].names, len(likelihood.unknowns)
    round_off = all(np.all(f.size < _RESIDUAL_ROUND_OFF * record.data.rms) for record, f, _ in tested)

    def test(
        *, free: bool, coloured: bool, weights: Sequence[_Columns] = ()
    ) -> tuple[Nonlinearity, list[_Columns]]:
        columns = []
        for k, (record, record_fit, _) in enumerate(tested):
            shared, responses = regressors[k]
            if free:  # those of the model's poles, which the prediction has, and of the record's
                if k not in freed:
                    freed[k] = _with_free_poles(record, record_fit, len(shared))
                shared = np.concatenate([shared, freed[k]], axis=1)
            variances = weights[k].variances if weights else None
            columns.append(_columns(record, record_fit, responses, shared, variances, coloured=coloured))
        return _tested(names, columns, p, round_off=round_off), columns

    freed: dict[int, Array] = {}
    regressors = []
    for (record, record_fit, joints), motion in zip(tested, motions, strict=True):
        shared = shared_regressors(record, record_fit).all.values
        regressors.append((shared, JointResponses(record, record_fit, joints, forces_of(motion / units))))
    coloured = not white or any(record.colour is not None for record, _, _ in tested)
    first, _ = test(free=False, coloured=coloured)
    if first.nonlinear_p > _FREED_LEVEL:
        return first
    # What looks nonlinear may be a linear error that is too large for derivatives at the model's poles: it is
    # one where free poles and amplitudes explain more than the forces do.
    plain, weights = test(free=False, coloured=False)
    beside, _ = test(free=True, coloured=False, weights=weights)
    count = plain.degrees - beside.degrees
    if count >= 1 and beside.degrees >= 1 and not round_off:
        ratio = max(plain.left - beside.left, 0.0) / count / (beside.left / beside.degrees)
        if log_f_tail(round(count), beside.degrees, ratio) < math.log(LACK_OF_FIT.value):
            return test(free=True, coloured=True)[0]
    return first


def _first_samples(record: TimeRecord, fit: RecordFit, joints: JointPorts) -> tuple[TimeRecord, RecordFit]:
    """Return a record and its fit, of a long one the first samples, as many as columns are held of."""
    width = record.model.parameters + record.model.states + len(joints.names) * FORCES + 1
    rows = _MAX_NUMBERS // (len(record.data.rms) * width + _MAX_FREE_REGRESSORS)
    if rows >= len(record.times):
        return record, fit
    (outputs, states, start), kept = fit.predicted, slice(0, rows)
    predicted = Trajectory(outputs[kept], states[kept], start)
    return record.first(rows), replace(fit, predicted=predicted, residual=fit.residual[kept])


def _columns(
    record: TimeRecord,
    fit: RecordFit,
    responses: JointResponses,
    shared: Array,
    variances: Array | None,
    *,
    coloured: bool,
) -> _Columns:
    """Return what free linear directions and first states leave of derivatives, responses and residual.

    `responses`: those to the forces at the joints; `shared` (samples x any): regressors of any
    linear structure; `variances`: those that channels are weighted by, default: what is left of them.
    `coloured`: the residuals are whitened.
    """
    p, n = record.model.parameters, record.model.states
    rows, width = slice(0, len(shared)), responses.count
    there = ~np.isnan(fit.residual[rows])
    total, sizes = np.zeros((n + p + width + 1,) * 2), np.zeros(n + p + width + 1)
    squares, degrees, weights = np.zeros(width), 0.0, np.ones(len(record.data.rms))
    basis = _range(shared) if there.all() else None
    decays = None if coloured else record.decays(fit.eta)
    channels: Iterable[tuple[int, Prediction | None]] = record.channelwise(fit)
    if decays is not None and basis is not None:  # derivatives by the first state are combinations of these
        channels = ((c, None) for c in range(len(weights)))
        beside = decays.columns - basis @ (basis.T @ decays.columns)
        grams, insides = responses.products(np.concatenate([basis, beside], axis=1))
        of_decays = decays.columns.T @ decays.columns, beside.T @ beside
    for c, predicted in channels:
        rms, present, order = record.data.rms[c], there[:, c], 0
        if predicted is None:
            assert decays is not None
            assert basis is not None
            Q, W = basis, decays.weights[c]
            inside, across = insides[: Q.shape[1], c], W.T @ insides[Q.shape[1] :, c]
            gram, lengths = grams[c] - inside.T @ inside, grams[c].diagonal()
            gram = np.block([[W.T @ of_decays[1] @ W, across], [across.T, gram]])
            lengths = np.concatenate([np.einsum("ij,ij->j", W, of_decays[0] @ W), lengths])
        else:
            parts = predicted.by_state[rows, 0], predicted.by_parameter[rows, 0], responses.of_channel(c)
            own = np.column_stack([*parts, fit.residual[rows, c]])
            own[~present] = 0.0
            of_channel = shared if basis is None else shared * present[:, None]
            Q = _range(of_channel) if basis is None else basis
            inside = Q.T @ own
            gram, lengths = own.T @ own - inside.T @ inside, np.sum(own**2, axis=0)
        squares += gram.diagonal()[n + p : -1] / rms**2
        if coloured:
            left = np.where(present, own[:, -1] - Q @ inside[:, -1], np.nan)[:, None]
            colour = estimated(left, [np.zeros((len(left), 0))], ColouredNoise())
            if order := colour.order:
                white = colour.whitened(np.column_stack([of_channel, own])[:, None], present[:, None])[:, 0]
                of_channel, own = white[:, : of_channel.shape[1]], white[:, of_channel.shape[1] :]
                Q = _range(of_channel)
                inside = Q.T @ own
                gram, lengths = own.T @ own - inside.T @ inside, np.sum(own**2, axis=0)
        count = np.count_nonzero(present) * min(1.0, record.data.passed) - Q.shape[1] - order
        variance = max(float(gram[-1, -1]), np.finfo(float).tiny) / max(count, 1.0)
        variance = variance if variances is None else float(variances[c])
        weights[c] = variance
        total += gram / variance
        sizes += lengths / variance
        degrees += count
    total, rank = _off(total, sizes, n)
    mean_squares = np.maximum(squares, 0.0) / max(there.sum(), 1)
    return _Columns(total, sizes[n:], mean_squares, degrees - rank, weights)


def _range(columns: Array) -> Array:
    """Return an orthonormal basis of columns, but for combinations that are zero to rounding."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0] / size[size > 0]
    squares, directions = np.linalg.eigh(unit.T @ unit)
    kept = squares > _RANK_TOL * squares.max(initial=0.0)
    return np.asarray(unit @ (directions[:, kept] / np.sqrt(squares[kept])))


def _with_free_poles(record: TimeRecord, fit: RecordFit, rows: int) -> Array:
    """Return regressors (rows x any) of a linear structure whose poles are those of the record.

    The poles of the model move by Gauss-Newton steps to where the residues of the record are stationary.
    """
    model, times = record.model.moved(fit.eta), record.model.times[:rows]
    max_count = min(_MAX_FREE_REGRESSORS, rows // _ROWS_PER_REGRESSOR)
    inputs = [model.inputs(order)[:rows] for order in (0, 1)]
    forced = forced_regressors(model.signals, inputs, times, max_count)
    poles, best, before = model.poles(fit.eta), np.zeros((rows, 0)), math.inf
    measured = np.nan_to_num(record.data.values[:rows]) / record.data.rms
    start, change = poles, np.zeros_like(poles)
    for _ in range(_MAX_POLE_STEPS):
        shared = regressors_in_time(forced, poles, max_count).all
        coefficients, left = _regression(shared.values, measured)
        if left < before:
            converged, best, before = left > (1 - _POLE_GAIN) * before, shared.values, left
            if converged or not np.any(shared.kind == RegressorKind.MODE):
                break
            start, change = _pole_step(shared, coefficients, record.sampling_step, rows)
        else:  # too far
            change = change / 4
        upper = start + change
        poles = np.concatenate([upper, upper[upper.imag != 0].conj()])
    return best


def _regression(columns: Array, values: Array) -> tuple[Array, float]:
    """Return the coefficients of columns (any x channels), and the sum of squares that is left of values."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    unit = columns / size
    squares, directions = np.linalg.eigh(unit.T @ unit)
    kept = squares > _RANK_TOL * squares.max(initial=0.0)
    D = directions[:, kept]
    coefficients = D @ ((D.T @ (unit.T @ values)) / squares[kept][:, None])
    return coefficients / size[:, None], float(np.sum((values - unit @ coefficients) ** 2))


def _pole_step(
    shared: Regressors, coefficients: Array, step: float, rows: int
) -> tuple[ComplexArray, ComplexArray]:
    """Return poles, one of each pair, and their change by the coefficients (columns x channels)."""
    modes, moves = shared.kind == RegressorKind.MODE, shared.kind == RegressorKind.POLE
    real = np.isreal(shared.pole[modes]) | (np.diff(shared.group[modes], prepend=-1) != 0)
    weight = np.where(real, 1.0, -1j)[:, None]  # Re(c z) = Re c Re z - Im c Im z
    groups = int(shared.group[modes].max(initial=-1)) + 1
    amplitude, change = np.zeros((2, groups, coefficients.shape[1]), dtype=complex)
    np.add.at(amplitude, shared.group[modes], weight * coefficients[modes])
    np.add.at(change, shared.group[moves], weight * coefficients[moves])
    squares = np.bincount(shared.group[moves], np.sum(shared.values[:, moves] ** 2, axis=0), groups)
    first = np.searchsorted(shared.group[modes], np.arange(groups))
    pole = shared.pole[modes][first]
    # Free decays stand last of each pole: their column is by time over the length of the record, those of
    # forced responses by the factor of a step.
    decay = np.append(pole[1:] != pole[:-1], True)
    rate = np.where(decay, step * (rows - 1), step * np.exp(pole * step))
    poles = np.array(list(dict.fromkeys(pole.tolist())), dtype=complex)
    changes = np.zeros_like(poles)
    for k, current in enumerate(poles):
        here = pole == current
        by_pole = rate[here, None] * amplitude[here]
        weights = squares[here, None] / np.abs(rate[here, None]) ** 2
        total = float(np.sum(weights * np.abs(by_pole) ** 2))
        shift = np.sum(weights * by_pole.conj() * change[here]) / (total or 1.0)
        longest = _LONGEST_POLE_STEP * abs(current)
        changes[k] = shift * min(1.0, longest / max(abs(shift), np.finfo(float).tiny))
    changes.imag[poles.imag == 0] = 0.0
    return poles, changes


def _tested(joints: tuple[str, ...], columns: Sequence[_Columns], p: int, *, round_off: bool) -> Nonlinearity:
    """Return the test of the columns of all records."""
    gram, sizes = sum(record.gram for record in columns), sum(record.sizes for record in columns)
    degrees = sum(record.degrees for record in columns)
    gram, rank = _off(np.asarray(gram), np.asarray(sizes), p)
    degrees -= rank
    H, b, left = gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1])
    absorbed = H.diagonal() <= _ABSORBED_SQUARE * np.asarray(sizes)[p:-1]
    shape, terms = (len(joints), FORCES), slice(0, len(TERMS))

    def p_value(chosen: NDArray[np.intp]) -> float:
        chosen = chosen[~absorbed[chosen]]
        if not len(chosen) or round_off or degrees <= len(chosen):
            return 1.0 if len(chosen) else math.nan
        explained, count = _explained(H[np.ix_(chosen, chosen)], b[chosen])
        rest = max(left - explained, np.finfo(float).tiny)
        return math.exp(log_f_tail(count, degrees - count, explained / count / (rest / (degrees - count))))

    places = np.arange(len(b)).reshape(shape)
    single = np.array([[p_value(place) for place in row[terms, None]] for row in places])
    safe = np.where(absorbed, 1.0, H.diagonal())
    responses = np.sqrt(np.mean([record.signal_squares for record in columns], axis=0))
    size = np.where(absorbed, np.nan, 100 * np.abs(b) / safe * responses).reshape(shape)[:, terms]
    joint_p = np.array([p_value(row) for row in places])
    overall = p_value(places.ravel())
    overall = 1.0 if math.isnan(overall) else overall
    kept = np.flatnonzero(~absorbed)
    explained, count = _explained(H[np.ix_(kept, kept)], b[kept]) if len(kept) else (0.0, 0)
    rest = max(left - explained, np.finfo(float).tiny)
    return Nonlinearity(joints, single, size, joint_p, overall, rest, degrees - count)


def _off(gram: Array, sizes: Array, p: int) -> tuple[Array, int]:
    """Return the products of columns beside the first p ones, and how many directions these have."""
    free = np.flatnonzero(gram.diagonal()[:p] > _ABSORBED_SQUARE * sizes[:p])
    unit = np.sqrt(gram.diagonal()[free])
    squares, directions = np.linalg.eigh(gram[np.ix_(free, free)] / np.outer(unit, unit))
    kept = squares > _RANK_TOL * squares.max(initial=0.0)
    across = (directions[:, kept] / np.sqrt(squares[kept])).T @ (gram[free][:, p:] / unit[:, None])
    return gram[p:, p:] - across.T @ across, int(np.count_nonzero(kept))


def _explained(H: Array, b: Array) -> tuple[float, int]:
    """Return the sum of squares that columns explain, by their products, and how many they are."""
    if len(b) == 1:
        return float(b[0] ** 2 / H[0, 0]), 1
    unit = np.sqrt(H.diagonal())
    squares, directions = np.linalg.eigh(H / np.outer(unit, unit))
    kept = squares > _RANK_TOL * squares[-1]
    projected = directions[:, kept].T @ (b / unit)
    return float(np.sum(projected**2 / squares[kept])), int(np.count_nonzero(kept))
