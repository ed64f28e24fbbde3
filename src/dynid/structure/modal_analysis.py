"""Modal analysis as a result: modes, rigid-body motions by name, massless DOFs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.result import Result
from dynid.structure import labels
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix
from dynid.structure.model import TANGENT, StructuralModel
from dynid.structure.modes import Modes, modes
from dynid.structure.state_space import massless

# A motion belongs to the rigid ones if what sticks out of their span is smaller, relative to it.
_RIGID_SPAN_TOL = 1e-5
# DOFs a node, and how many of them are translations, of matrices that are not labelled.
_PERIODS = ((6, 3), (3, 3), (2, 2), (1, 1))
_AXES = "xyz"
_MAX_NAMED_DOFS = 3
#: Rigid-body modes of a free structure.
_RIGID_BODY_MODES = 6


def _rigid_names(dofs: Sequence[Label], shapes: Array) -> tuple[str, ...]:
    """Name rigid-body motions: translations first, then rotations, then mechanisms.

    Labels show directions (``w_4``, ``12:UX``); without them DOFs are taken to come node by node, 6, 3, 2 or
    1 a node, where uniform motions of every such set are among the rigid ones. The rest of the span are
    rotations: those that turn all rotational DOFs alike, or as many as the translations allow for. What is
    left are mechanisms, named by the DOFs that move most.

    `dofs`: labels of the DOFs (n); `shapes`: independent rigid-body motions (n x r), in any combination.
    """
    count = shapes.shape[1]
    if not count:
        return ()
    basis = np.linalg.qr(shapes / np.abs(shapes).max(axis=0))[0]
    names, moved = _translations(dofs, basis)
    rest = basis
    if moved:
        orthonormal = np.linalg.qr(np.array(moved).T)[0]
        left, sizes, _ = np.linalg.svd(basis - orthonormal @ (orthonormal.T @ basis), full_matrices=False)
        rest = left[:, : count - len(names)]
        assert sizes[: rest.shape[1]].min(initial=1.0) > _RIGID_SPAN_TOL
    turning, mechanisms = _rotations(dofs, rest, len(names))
    names += ["rotation"] * turning if turning < 2 else [f"rotation {k}" for k in range(1, turning + 1)]
    for motion in mechanisms.T:
        size = np.abs(motion)
        largest = [
            at for at in np.argsort(-size, kind="stable")[:_MAX_NAMED_DOFS] if size[at] > 1e-3 * size.max()
        ]
        names.append(f"mechanism of {labels.listed([dofs[at] for at in largest])}")
    return tuple(names)


def _translations(dofs: Sequence[Label], basis: Array) -> tuple[list[str], list[Array]]:
    """Return names and motions of the uniform translations within a span."""
    along = [labels.direction(dof) for dof in dofs]
    translating = {
        direction: np.array([float(axis_of_dof == direction) for axis_of_dof in along])
        for direction, dof in dict(zip(along, dofs, strict=True)).items()
        if labels.kind(dof) == "translation"
    }
    if translating:
        within = {name: motion for name, motion in translating.items() if _is_within(motion, basis)}
        return [f"translation {name}" for name in within], list(within.values())
    for period, count in _PERIODS:
        motions = [np.arange(len(dofs)) % period == axis for axis in range(count)]
        if len(dofs) % period == 0 and all(_is_within(motion.astype(float), basis) for motion in motions):
            names = [f"translation {_AXES[axis]}" for axis in range(count)] if count > 1 else ["translation"]
            return names, [motion.astype(float) for motion in motions]
    return [], []


def _rotations(dofs: Sequence[Label], rest: Array, translations: int) -> tuple[int, Array]:
    """Return the number of rotations among the remaining motions, and the others (n x m)."""
    kinds = np.array([labels.kind(dof) for dof in dofs])
    turns = rest[kinds == "rotation"]
    if len(turns) and len({labels.direction(dof) for dof, kind in zip(dofs, kinds, strict=True)
                           if kind == "rotation"}) == 1:  # fmt: skip
        # In a plane one motion turns all alike; the rest of the span turns nothing, or parts only.
        solution = np.linalg.lstsq(turns, np.ones(len(turns)), rcond=None)[0]
        if np.linalg.norm(turns @ solution - 1) > _RIGID_SPAN_TOL * np.sqrt(len(turns)):
            return 0, rest
        direction = solution / np.linalg.norm(solution)
        others = np.linalg.svd(rest - np.outer(rest @ direction, direction), full_matrices=False)[0]
        return 1, others[:, : rest.shape[1] - 1]
    allowed = min(rest.shape[1], {0: 0, 1: 0, 2: 1, 3: 3}[min(translations, 3)])
    return (allowed, rest[:, allowed:]) if rest.shape[1] <= allowed else (0, rest)


def _is_within(motion: Array, basis: Array) -> bool:
    outside = motion - basis @ (basis.T @ motion)
    return bool(np.linalg.norm(outside) <= _RIGID_SPAN_TOL * np.linalg.norm(motion) > 0)


def _beyond_rigid(matrices: tuple[Matrix, Matrix, Matrix], lowest: Modes) -> Modes:
    """Return modes with all rigid-body modes of the structure among them.

    Where the lowest modes are all of the rigid body there may be more of these, and any few of them are
    motions of all of its translations and rotations together.
    """
    M, C, K = matrices
    computed = lowest
    while computed.rigid == len(computed.omega) < (max_modes := M.shape[0] - computed.massless):
        computed = modes(M, C, K, min(2 * len(computed.omega) + _RIGID_BODY_MODES, max_modes))
    return computed


def modal_analysis(
    model: StructuralModel,
    count: int | None = None,
    below: float | None = None,
    values: Mapping[str, float] | None = None,
) -> Result:
    """Return the lowest modes of a structure, rigid-body modes named.

    `count`, `below`: how many modes, or all below a frequency, rad/s; with neither all of a small structure;
    `values`: unknown joint parameters by name.

    Returns
    -------
    Result
        ``structure/modes/{mode, omega, uncertainty, undecided, damping, name, dof, shape, rigid,
        massless}``: `uncertainty` is how far rounding of the matrices leaves a frequency open, `undecided`
        whether that is so far that the mode may be a rigid-body one (an attribute `doubt` of the group says
        so in words, and where a frequency has few digits), `name` is empty for elastic modes, `shape` (dof x
        mode) has unit modal mass, `rigid` counts the rigid-body modes of the structure, of which `count` may
        leave some out, `massless` lists the DOFs without mass; `counted` is the frequency up to which no mode
        is missing, proved by signs of pivots. With structural damping also `loss_factor`, the ratio of
        ``phi^T H phi`` and ``phi^T K phi``, whose damping ratio is part of `damping`; and
        ``structure/complex_modes/{mode, pole, omega, loss_factor, damping, dof, shape}``: the poles, 1/s, of
        the structure with all of its damping, in the order of their sizes, and their complex shapes. Of a
        rotor these alone, with their `whirl`.
    """
    if model.rotor is not None:
        from dynid.structure.rotors import add_whirl_modes

        result = Result("structure")
        add_whirl_modes(result, model, values, count, below)
        return result
    M, C, K = model.with_joints(values)
    lowest = modes(M, C, K, count, below)
    complete = lowest if count is None else _beyond_rigid((M, C, K), lowest)
    rigid = _rigid_names(model.dofs, complete.shapes[:, : complete.rigid])
    result, group = Result("structure"), "structure/modes"
    result.add_axis(f"{group}/mode", np.arange(1, len(lowest.omega) + 1))
    result.add_all(group, ("mode",), "rad/s", omega=lowest.omega, uncertainty=lowest.uncertainty)
    names = [*rigid, *[""] * len(lowest.omega)][: len(lowest.omega)]
    damping = lowest.damping
    if model.hysteretic:
        damping = damping + _add_complex_modes(result, model, values or {}, lowest)
    result.add_all(group, ("mode",), undecided=lowest.undecided, damping=damping, name=names)
    result.add_axis(f"{group}/dof", [str(dof) for dof in model.dofs])
    result.add(f"{group}/shape", lowest.shapes, ("dof", "mode"))
    result.add(f"{group}/rigid", complete.rigid)
    result.add(f"{group}/counted", lowest.counted, (), "rad/s")
    if lowest.doubt:
        result.annotate(group, doubt=lowest.doubt)
    if model.nonlinear:
        result.annotate(group, note=TANGENT)
    if without_mass := massless(M):
        result.add_axis(f"{group}/massless", [str(model.dofs[at]) for at in without_mass])
    return result


def _add_complex_modes(
    result: Result, model: StructuralModel, values: Mapping[str, float], lowest: Modes
) -> Array:
    """Add loss factors and complex modes; return the damping ratios that the loss factors add (modes)."""
    from dynid.structure.damping import damping_ratio, loss_factors
    from dynid.structure.mode_derivatives import lowest_modes

    H: Any = model.with_joints(values, loss=True)[2].imag
    elastic = lowest.omega > 0
    loss = np.einsum("im,im->m", lowest.shapes, H @ lowest.shapes)
    loss = np.where(elastic, loss, 0.0) / np.where(elastic, lowest.omega, 1.0) ** 2
    result.add("structure/modes/loss_factor", loss, ("mode",))
    near = float(lowest.omega[elastic].min(initial=np.inf))
    count = int(np.count_nonzero(elastic))
    if count:
        whole = count + (lowest.rigid if lowest.method != "dense matrices" else 0)
        solution = lowest_modes(model, values, whole, near, damped=True)
        moving = solution.omega > 0
        poles, group = solution.poles[moving][:count], "structure/complex_modes"
        result.add_axis(f"{group}/mode", np.arange(1, len(poles) + 1))
        result.add_all(group, ("mode",), "rad/s", pole=poles, omega=np.abs(poles))
        ratios = {"loss_factor": loss_factors(poles), "damping": -poles.real / np.abs(poles)}
        result.add_all(group, ("mode",), **ratios)
        result.add_axis(f"{group}/dof", [str(dof) for dof in model.dofs])
        result.add(f"{group}/shape", _real_as_can_be(solution.shapes[:, moving][:, :count]), ("dof", "mode"))
    return damping_ratio(loss)


def _real_as_can_be(shapes: ComplexArray) -> ComplexArray:
    """Return shapes turned to be as real as can be, the largest component of each positive and of size 1."""
    turned = shapes * np.exp(-0.5j * np.angle(np.sum(shapes**2, axis=0)))
    largest = np.take_along_axis(turned, np.abs(turned).argmax(axis=0)[None], axis=0)
    return np.asarray(turned / (np.abs(largest) * np.where(largest.real < 0, -1.0, 1.0)))
