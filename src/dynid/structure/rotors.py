"""Rotors at a given speed: gyroscopic and circulatory matrices, complex modes, whirl, Campbell diagrams.

``M x'' + (C + speed G) x' + (K + N) x = f`` with G and N skew-symmetric: gyroscopic moments of discs, and the
circulatory part of the stiffness, as of cross-coupled seals and bearings or of damping that rotates
(R. Gasch, R. Nordmann & H. Pfützner, Rotordynamik, 2002; G. Genta, Dynamics of Rotating Systems, 2005).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import UsageError
from dynid.lti.frequency_response import second_order_response
from dynid.result import Result
from dynid.structure.frf import FrequencyResponse
from dynid.structure.labels import Label, node_direction
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Ports

#: Group of the modes of rotors.
MODES = "structure/complex_modes"
#: Group of Campbell diagrams.
CAMPBELL = "structure/campbell"
# A limit of cost: eigenvalues of twice as many states take a minute.
_MAX_DOFS = 1000
# A pole below this part of the largest is a rigid-body motion, as a double pole at 0 moves by the root of
# rounding; one whose imaginary part is below that part of it does not oscillate.
_ZERO, _STILL = 1e-7, 1e-9
# Two directions in which a shaft moves, in the sense of a rotation about the axis normal to them.
_PLANES = (("x", "y"), ("y", "z"), ("z", "x"))
# Squared motion of translations beside that of rotations, below which a disc tilts only.
_TILTS = 1e-20


class WhirlModes(NamedTuple):
    """Poles with Im > 0 (m), 1/s, in the order of their sizes, and shapes (n x m), largest entry 1."""

    poles: ComplexArray
    shapes: ComplexArray


@guarded("the modes of the rotor")
def whirl_modes(
    model: StructuralModel, values: Mapping[str, float] | None = None, speed: float | None = None
) -> WhirlModes:
    """Return the oscillating modes of a rotor, at a `speed` (rad/s) of rotation; default: its own.

    Raises `UsageError` where a DOF has no mass, or there are too many of them.
    """
    rotor = model.rotor
    assert rotor is not None
    if model.size > _MAX_DOFS:
        raise UsageError(
            f"the rotor has {model.size} DOFs, more than the {_MAX_DOFS} of which all poles are computed",
            names=("structure.matrices",),
        )
    at = model if speed is None else model.rotating(rotor._replace(speed=speed))
    M, C, K = at.dense(values, rotating=True)
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        raise UsageError(
            "the modes of a rotor need mass in every direction, and its mass matrix is singular",
            remedy="Condense DOFs without mass or rotary inertia, or give them some.",
            names=("structure.matrices.mass", "structure"),
        ) from None
    inverse = np.linalg.solve(L, np.eye(len(L)))
    stiffness, damping = inverse @ K @ inverse.T, inverse @ C @ inverse.T
    w = np.sqrt(np.linalg.norm(stiffness, 2)) or 1.0  # balances displacements and velocities
    n, zero = len(M), np.zeros_like(M)
    poles, vectors = np.linalg.eig(np.block([[zero, w * np.eye(n)], [-stiffness / w, -damping]]))
    size = np.abs(poles)
    kept = np.flatnonzero((size > _ZERO * size.max(initial=0.0)) & (poles.imag > _STILL * size))
    kept = kept[np.lexsort((poles[kept].real, size[kept]))]
    shapes = inverse.T @ vectors[:n, kept]
    largest = np.argmax(np.abs(shapes), axis=0)
    return WhirlModes(poles[kept].astype(complex), shapes / shapes[largest, np.arange(len(kept))])


def whirl(dofs: Sequence[Label], shapes: ComplexArray) -> Array:
    """Return the whirl of shapes (n x m): 1 of circles forward, -1 of circles backward, 0 of lines.

    Forward is the positive sense of rotation about the axis normal to the plane of the translations, x to y,
    y to z or z to x; of discs that only tilt that of the rotations. NaN where nodes do not move in one plane.
    """
    moving, tilting = (_circles(dofs, shapes, kind) for kind in ("", "r"))
    both = np.stack([moving, tilting])
    circles = np.where(both[0].sum(axis=0) > _TILTS * both[1].sum(axis=0), both[0], both[1])
    total = circles.sum(axis=0)
    return np.asarray(np.where(total > 0, circles[0] - circles[1], np.nan) / np.where(total > 0, total, 1.0))


def _circles(dofs: Sequence[Label], shapes: ComplexArray, kind: str) -> Array:
    """Return the squared sizes of circles forward and backward (2 x m) of translations, or of rotations."""
    places: dict[Any, dict[str, int]] = {}
    for row, dof in enumerate(dofs):
        at = node_direction(dof)
        if at is not None and at[1].startswith("r") == bool(kind):
            places.setdefault(at[0], {})[at[1].removeprefix("r")] = row
    directions = {direction for along in places.values() for direction in along}
    plane = next((plane for plane in _PLANES if set(plane) == directions), None)
    if plane is None:
        return np.zeros((2, shapes.shape[1]))
    nodes = [along for along in places.values() if len(along) == len(plane)]
    u, v = (shapes[[along[direction] for along in nodes]] for direction in plane)
    return np.stack([np.sum(np.abs(u + turn * v) ** 2, axis=0) for turn in (1j, -1j)])


def add_whirl_modes(
    result: Result,
    model: StructuralModel,
    values: Mapping[str, float] | None,
    count: int | None,
    below: float | None,
) -> None:
    """Add the lowest modes of a rotor: a `count`, or all below a frequency, rad/s."""
    poles, shapes = whirl_modes(model, values)
    chosen = slice(count) if below is None else slice(int(np.count_nonzero(np.abs(poles) <= below)))
    poles, shapes = poles[chosen], shapes[:, chosen]
    result.add_axis(f"{MODES}/mode", np.arange(1, len(poles) + 1))
    result.add_all(MODES, ("mode",), "rad/s", pole=poles, omega=np.abs(poles))
    result.add_all(MODES, ("mode",), damping=-poles.real / np.abs(poles), whirl=whirl(model.dofs, shapes))
    result.add_axis(f"{MODES}/dof", [str(dof) for dof in model.dofs])
    result.add(f"{MODES}/shape", shapes, ("dof", "mode"))


def add_campbell(
    result: Result, model: StructuralModel, speeds: Array, values: Mapping[str, float] | None, count: int
) -> None:
    """Add frequencies, damping ratios and whirl of the lowest modes over speeds of rotation (rad/s).

    A mode is followed from speed to speed by its shape and pole.
    """
    from scipy.optimize import linear_sum_assignment

    tables = np.full((3, len(speeds), count), np.nan)
    before: WhirlModes | None = None
    for k, speed in enumerate(speeds.tolist()):
        modes = whirl_modes(model, values, speed)
        order = np.arange(len(modes.poles))
        if before is not None and len(order):
            distance = np.abs(before.poles[:, None] - modes.poles) / np.abs(before.poles)[:, None]
            unlike = distance + 1 - _likeness(before, modes)
            order = np.full(len(before.poles), -1)
            rows, columns = linear_sum_assignment(unlike)
            order[rows] = columns
        followed = order[:count]
        there = followed >= 0
        poles, shapes = modes.poles[followed[there]], modes.shapes[:, followed[there]]
        columns = np.flatnonzero(there)
        tables[:, k, columns] = np.abs(poles), -poles.real / np.abs(poles), whirl(model.dofs, shapes)
        rest = np.setdiff1d(np.arange(len(modes.poles)), order)
        ordered = np.concatenate([order[order >= 0], rest])
        before = WhirlModes(modes.poles[ordered], modes.shapes[:, ordered])
    result.add_axis(f"{CAMPBELL}/speed", speeds, "rad/s")
    result.add_axis(f"{CAMPBELL}/mode", np.arange(1, count + 1))
    result.add(f"{CAMPBELL}/omega", tables[0], ("speed", "mode"), "rad/s")
    result.add_all(CAMPBELL, ("speed", "mode"), damping=tables[1], whirl=tables[2])


def _likeness(first: WhirlModes, second: WhirlModes) -> Array:
    """Return the MAC of displacements and velocities of two sets of modes."""
    from dynid.structure.correlation import mac

    scale = np.abs(first.poles).mean()
    states = (np.vstack([modes.shapes, modes.shapes * modes.poles / scale]) for modes in (first, second))
    return np.asarray(mac(*states))


def rotor_response(
    model: StructuralModel, where: Ports, omega: Array, values: Mapping[str, float] | None
) -> FrequencyResponse:
    """Return the frequency responses of a rotor, by a solution at every frequency."""
    matrices = model.dense(values, loss=True, rotating=True)

    def evaluate(lines: Array) -> ComplexArray:
        return second_order_response(*matrices, *where, lines)

    near = np.abs(whirl_modes(model, values).poles) if model.size <= _MAX_DOFS else np.zeros(0)
    return FrequencyResponse(evaluate(omega), "direct", 0, 0, 0.0, evaluate, near)
