"""Prediction of a record by a model whose joints have nonlinear laws, with its exact sensitivities.

`predicted(model, eta, x0, z0)` is the counterpart of `prediction.free_prediction` and `prediction.prediction`
of linear models. Nothing is superposed: `by_state` and `by_hidden` are tangents at this motion, and the
responses to single loads do not add up.

- `eta` (p): coordinates of the parameters, as of `ParametricModel`; those of laws are among its unknowns
  (``bolt.k3``, ``bolt.fs``, ``bolt.offset``), linear where they may be negative.
- `x0` (n): first state at the first node of the timeline, scaled by ``model.scale``.
- `z0` (h): first hidden states of the laws that have one, in the order of `hidden_states(model)`, in the unit
  of their deflection: of Jenkins the position of the slider, of Bouc-Wen d - e. `hidden_start` maps numbers
  from -1 to 1 to the range in which a motion may start, with derivatives.
- `steps`: regular steps in each interval of the timeline. `steps_needed(model, eta, x0, z0)` chooses them so
  that halving changes the states by less than 1e-7 of the largest; keep them while estimates move, and ask
  again at the end. Raises NumericalError where no number suffices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self
from weakref import WeakKeyDictionary

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti.exponential import rescaled
from dynid.lti.state_space import Matrices
from dynid.parameters import named, rates
from dynid.structure.excitation import drive
from dynid.structure.law import BoundLaw
from dynid.structure.matrices import as_array
from dynid.structure.model_laws import ModelLaw, model_laws
from dynid.structure.nonlinear.accuracy import accurate_march
from dynid.structure.nonlinear.march import march
from dynid.structure.nonlinear.tables import Columns, LinearRest, Steps

# Singular values of what parameters act on below this part of the largest are round-off.
_RANK_TOL = 1e-12

_STEPS: WeakKeyDictionary[ParametricModel, dict[int, Steps]] = WeakKeyDictionary()


class NonlinearPrediction(NamedTuple):
    """Prediction at given parameters and first states, with sensitivities.

    `outputs` (times x channels), `states` (times x n, scaled), `by_parameter` (times x channels x p) with
    respect to the coordinates, `by_state` (times x channels x n), `by_hidden` (times x channels x h);
    `hidden` (times x h); `deflections` (times x joints with laws), m, and their `forces`, N; `events`: how
    often regimes changed.
    """

    outputs: Array
    states: Array
    by_parameter: Array
    by_state: Array
    by_hidden: Array
    hidden: Array
    deflections: Array
    forces: Array
    events: int
    state_slopes: Array  # of the states by parameters, first and first hidden states (times x n x p + n + h)
    force_slopes: Array  # of the forces by the same
    regimes: Array  # of the laws (times x laws)


def hidden_states(model: ParametricModel) -> tuple[str, ...]:
    """Return the names of the hidden states of the laws of a model (h)."""
    assert isinstance(model.system, StructureSystem)
    laws = [(joint, item.law) for joint in model.system.model.joints for item in joint.laws]
    names = [f"{joint.name}.{law.kind}.z" for joint, law in laws if law.hidden]
    return tuple(
        f"{name}#{names[: k + 1].count(name)}" if names.count(name) > 1 else name
        for k, name in enumerate(names)
    )


class HiddenStart(NamedTuple):
    """First hidden states (h); derivatives by their numbers (h), first state (h x n), eta (h x p)."""

    z0: Array
    by_number: Array
    by_state: Array
    by_parameter: Array


def hidden_start(model: ParametricModel, eta: Array, x0: Array, numbers: Array) -> HiddenStart:
    """Return hidden states ``centre + width s`` within the range in which a motion may start.

    `numbers` (h): s, from -1 to 1; 0 is the centre: an unloaded spring.
    """
    laws, rows = _laws(model, eta), _deflections(model)
    rate = rates(model.unknowns, eta)
    z0, by_number = np.zeros((2, len(numbers)))
    out = HiddenStart(z0, by_number, np.zeros((len(numbers), len(x0))), np.zeros((len(numbers), len(eta))))
    with_hidden = [law for law in laws if law.bound.law.hidden]
    for k, (law, s) in enumerate(zip(with_hidden, numbers.tolist(), strict=True)):
        bound = law.bound
        row = np.concatenate([rows[bound.row], np.zeros_like(rows[bound.row])]) * model.scale
        d = float(row @ x0)
        centre, width = bound.law.range_of_hidden(bound.values, d)
        width = width if np.isfinite(width) else 1.0
        out.z0[k], out.by_number[k] = centre + width * s, width
        out.by_state[k] = row * (centre != 0 or d == centre)
        for place, slopes in enumerate(law.slopes[:-1]):
            step = 1e-6 * (abs(bound.values[place]) or 1.0)
            moved = [list(bound.values), list(bound.values)]
            moved[0][place] += step
            moved[1][place] -= step
            high, low = (bound.law.range_of_hidden(values, d)[1] for values in moved)
            if np.isfinite(high) and np.isfinite(low):
                change = s * (high - low) / (2 * step)
                for name, slope in slopes.items():
                    p = _place(model, name)
                    out.by_parameter[k, p] += change * slope * rate[p]
    return out


def predicted(
    model: ParametricModel,
    eta: Array,
    x0: Array,
    z0: Array,
    steps: int,
    *,
    sensitive: bool = True,
) -> NonlinearPrediction:
    """Return the prediction from first states, with its sensitivities unless they are not asked for.

    Raises Refine if the steps are too long.
    """
    model = model.moved(eta)
    prepared = _Prepared.of(model, eta)
    n, p, laws, matrices, direct = (
        model.states, model.parameters, prepared.laws, prepared.matrices, prepared.direct
    )  # fmt: skip
    rest, columns = prepared.rest(model, sensitive=sensitive)
    hidden = np.flatnonzero([law.bound.law.hidden for law in laws])
    z = np.zeros(len(laws))
    z[hidden] = z0
    motion = march(rest, [law.bound for law in laws], _steps(model, steps), x0, z, columns, first=sensitive)
    nf = rest.forces
    through, through_slopes = matrices.D[0][:, -nf:], matrices.D_slopes[:, 0, :, -nf:]
    outputs = motion.states @ matrices.C.T + motion.forces @ through.T + direct.value
    moved = np.einsum("cn,tnq->tcq", matrices.C, motion.slopes)
    moved += np.einsum("cf,tfq->tcq", through, motion.force_slopes)
    if sensitive:
        moved[..., :p] += np.einsum("pcn,tn->tcp", matrices.C_slopes, motion.states)
        moved[..., :p] += np.einsum("pcf,tf->tcp", through_slopes, motion.forces)
        if direct.slopes is not None:
            moved[..., :p] += np.moveaxis(direct.slopes, 0, -1)
    gathered = model.gathered(moved)
    kept = np.concatenate([np.arange(p + n), p + n + hidden])
    return NonlinearPrediction(
        model.gathered(outputs),
        model.own(motion.states),
        gathered[..., :p],
        gathered[..., p : p + n],
        gathered[..., p + n :][..., hidden] if sensitive else gathered[..., :0],
        model.own(motion.hidden[:, hidden]),
        model.own(motion.states @ rest.rows[:nf].T),
        model.own(motion.forces),
        motion.events,
        model.own(motion.slopes[..., kept]) if sensitive else motion.slopes,
        model.own(motion.force_slopes[..., kept]) if sensitive else motion.force_slopes,
        model.own(motion.regimes),
    )


class ForcedRest(NamedTuple):
    """The linear rest under joint forces, scaled: ``x' = A x + E f``, ``d = rows x``, ``y = C x + D f``."""

    A: Array
    E: Array
    rows: Array
    C: Array
    D: Array


def forced_rest(model: ParametricModel, eta: Array) -> ForcedRest:
    """Return how joint forces move the rest, the laws themselves left out."""
    model = model.moved(eta)
    prepared = _Prepared.of(model, eta)
    rest, _ = prepared.rest(model, sensitive=False)
    nf, matrices = rest.forces, prepared.matrices
    return ForcedRest(rest.A, rest.D[:, :nf], rest.rows[:nf], matrices.C, matrices.D[0][:, -nf:])


def steps_needed(model: ParametricModel, eta: Array, x0: Array, z0: Array) -> int:
    """Return how many regular steps each interval needs, as of `accurate_march`."""
    model = model.moved(eta)
    prepared = _Prepared.of(model, eta)
    laws, (rest, _) = prepared.laws, prepared.rest(model, sensitive=False)
    z = np.zeros(len(laws))
    z[[law.bound.law.hidden for law in laws]] = z0
    return accurate_march(rest, [law.bound for law in laws], model.line, x0, z)[1].enough


@dataclass(frozen=True, eq=False)
class _Prepared:
    """What predictions from all first states share at coordinates `eta` of the parameters."""

    eta: Array
    laws: Sequence[ModelLaw]
    matrices: Matrices
    direct: Any  # what the channels have beside states and forces
    _rests: dict[bool, tuple[LinearRest, Columns | None]] = field(default_factory=dict)

    @classmethod
    def of(cls, model: ParametricModel, eta: Array) -> Self:
        """Return it, kept with the model until there are other coordinates; it does not hold the model."""
        kept = _PREPARED.get(model)
        if kept is None or not np.array_equal(kept.eta, eta):
            kept = _PREPARED[model] = cls(
                eta.copy(), _laws(model, eta), _matrices(model, eta), model.direct(eta)
            )
        return kept

    def rest(self, model: ParametricModel, *, sensitive: bool) -> tuple[LinearRest, Columns | None]:
        """Return the linear rest of a march, and what parameters act on."""
        if sensitive not in self._rests:
            self._rests[sensitive] = _rest(model, self.eta, self.matrices, self.laws, sensitive=sensitive)
        return self._rests[sensitive]


_PREPARED: WeakKeyDictionary[ParametricModel, Any] = WeakKeyDictionary()


def _steps(model: ParametricModel, parts: int) -> Steps:
    """Return the regular steps of the model's timeline, kept as long as the model."""
    kept = _STEPS.setdefault(model, {})
    if parts not in kept:
        kept[parts] = Steps.of(model.line, parts)
    return kept[parts]


def _matrices(model: ParametricModel, eta: Array) -> Matrices:
    """Return the scaled matrices of the rest, whose last inputs are the joint forces."""
    system = model.system
    assert isinstance(system, StructureSystem)
    if model.instruments.unknown_delays:
        raise UsageError(
            "a delay is unknown, and a joint has nonlinear laws: their records have known delays",
            remedy="Identify the delay with linear joints first, and give its value.",
        )
    structure = system.model.without_laws()
    linear = StructureSystem(structure, system.loads, system.channels)
    every = named(model.unknowns, eta)
    values = {unknown.name: every[unknown.name] for unknown in linear.unknowns}
    base, driven = linear.at(values), drive(structure, system.loads, system.channels, values)
    mass, n = driven.mass(structure.dense(values)[0]), structure.size
    places = [_place(model, unknown.name) for unknown in linear.unknowns]
    E = -np.linalg.solve(mass, driven.others(_deflections(model).T))
    accelerations = np.array(driven.orders)[:, None] == 2
    through = np.where(accelerations, driven.rows @ E, 0.0)
    E_slopes, nf = np.zeros((len(every), n, E.shape[1])), E.shape[1]
    for place, change in zip(places, structure.slopes(values), strict=True):
        if "M" in change:
            E_slopes[place] = -np.linalg.solve(mass, driven.free(as_array(change["M"])) @ E)

    def joined(loads: Array, forces: Array) -> Array:
        return np.concatenate([loads, np.broadcast_to(forces, (*loads.shape[:-1], nf))], axis=-1)

    def spread(slopes: Array) -> Array:
        out = np.zeros((len(every), *slopes.shape[1:]))
        out[places] = slopes
        return out

    upper = np.zeros_like(E)
    B_slopes = joined(spread(base.B_slopes), np.concatenate([np.zeros_like(E_slopes), E_slopes], axis=1))
    D_slopes = joined(spread(base.D_slopes), np.where(accelerations, driven.rows @ E_slopes, 0.0)[:, None])
    matrices = Matrices(
        base.A, joined(base.B, np.concatenate([upper, E])), base.C, joined(base.D, through[None]),
        spread(base.A_slopes), B_slopes, spread(base.C_slopes), D_slopes,
    )  # fmt: skip
    instruments = model.instruments
    instruments = replace(
        instruments,
        load_gains=(*instruments.load_gains, *(1.0,) * nf),
        load_delays=(*instruments.load_delays, *(0.0,) * nf),
    )
    matrices, d = instruments.applied(matrices, every), model.scale
    rate = rates(model.unknowns, eta)
    slopes = (slope * rate.reshape(-1, *(1,) * (slope.ndim - 1)) for slope in matrices[4:])
    A_slopes, B_slopes, C_slopes, D_slopes = slopes
    return Matrices(
        rescaled(matrices.A, d), matrices.B / d[:, None], matrices.C * d, matrices.D,
        rescaled(A_slopes, d), B_slopes / d[:, None], C_slopes * d, D_slopes,
    )  # fmt: skip


def _place(model: ParametricModel, name: str) -> int:
    return next(k for k, unknown in enumerate(model.unknowns) if unknown.name == name)


def _laws(model: ParametricModel, eta: Array) -> Sequence[ModelLaw]:
    assert isinstance(model.system, StructureSystem)
    return model_laws(model.system.model.joints, named(model.unknowns, eta))


def _deflections(model: ParametricModel) -> Array:
    assert isinstance(model.system, StructureSystem)
    return model.system.model.deflections()


def _rest(
    model: ParametricModel, eta: Array, matrices: Matrices, laws: Sequence[ModelLaw], *, sensitive: bool
) -> tuple[LinearRest, Columns | None]:
    """Return the linear rest for the march, scaled, and what parameters act on."""
    rows = _deflections(model)
    n, nf = model.states, len(rows)
    nu = matrices.B.shape[1] - nf
    B = np.where(np.append(model.acting, np.ones(nf, dtype=bool)), matrices.B, 0.0)
    E, U = B[:, nu:], B[:, :nu]
    read = np.kron(np.eye(2), rows) * model.scale
    if not sensitive:
        return LinearRest(matrices.A, np.concatenate([E, U], axis=1), read, nf, nu), None
    # What parameters add to the state's rate, A_slopes x + B_slopes [u, f], in as few directions as it needs.
    p, width = model.parameters, n + nu + nf
    added = np.concatenate([matrices.A_slopes, matrices.B_slopes], axis=2).reshape(p, n, width)
    left, sizes, _ = np.linalg.svd(np.concatenate(added, axis=1), full_matrices=False)
    rank = int(np.count_nonzero(sizes > _RANK_TOL * sizes[:1].max(initial=0.0)))
    directions = left[:, :rank]
    read_states = np.linalg.svd(matrices.A_slopes.reshape(p * n, n), full_matrices=False)
    w = int(np.count_nonzero(read_states[1] > _RANK_TOL * read_states[1][:1].max(initial=0.0)))
    further = read_states[2][:w]
    coefficients = directions.T @ added
    columns = Columns(
        coefficients[:, :, :n] @ further.T,
        coefficients[:, :, n : n + nu],
        coefficients[:, :, n + nu :],
        _by_parameters(model, eta, laws),
    )
    all_directions = np.concatenate([E, U, directions], axis=1)
    return LinearRest(matrices.A, all_directions, np.concatenate([read, further]), nf, nu), columns


def _by_parameters(model: ParametricModel, eta: Array, laws: Sequence[ModelLaw]) -> tuple[Array, ...]:
    """Return the derivatives of the parameters and the offset of each law by the coordinates (… x p)."""
    rate, by_laws = rates(model.unknowns, eta), []
    for law in laws:
        by = np.zeros((len(law.slopes), model.parameters))
        for k, slopes in enumerate(law.slopes):
            for name, slope in slopes.items():
                place = _place(model, name)
                by[k, place] += slope * rate[place]
        by_laws.append(by)
    return tuple(by_laws)


class RateTables(NamedTuple):
    """The rest and the laws about coordinates, each array before its derivatives by these (1 + p).

    ``x' = A x + B u + E f``, ``y = C x + T f + direct`` with the joint forces f at the deflections and their
    rates ``rows x``; `laws` with the derivatives of their parameters and offsets (… x p).
    """

    A: Array
    B: Array
    E: Array
    C: Array
    T: Array
    direct: Array  # 1 + p x times x channels
    rows: Array
    laws: tuple[BoundLaw, ...]
    by_laws: tuple[Array, ...]


def rate_tables(model: ParametricModel, eta: Array) -> RateTables:
    """Return the terms of the equations of motion about coordinates of the parameters."""
    prepared = _Prepared.of(model, eta)
    matrices, laws, rows = prepared.matrices, prepared.laws, _deflections(model)
    nf = len(rows)
    A, B, C, D = (
        np.concatenate([value[None], slopes])
        for value, slopes in zip(matrices[:4], matrices[4:], strict=True)
    )
    acting = B[:, :, :-nf] * model.acting
    direct, p = prepared.direct, model.parameters
    slopes = np.zeros((p, *direct.value.shape)) if direct.slopes is None else direct.slopes
    return RateTables(
        A, acting, B[:, :, -nf:], C, D[:, 0, :, -nf:], np.concatenate([direct.value[None], slopes]),
        np.kron(np.eye(2), rows) * model.scale, tuple(law.bound for law in laws),
        _by_parameters(model, eta, laws),
    )  # fmt: skip


def bound_laws(model: ParametricModel, eta: Array) -> tuple[BoundLaw, ...]:
    """Return the laws of a model at coordinates of the parameters, for pictures and ranges."""
    return tuple(law.bound for law in _laws(model, eta))
