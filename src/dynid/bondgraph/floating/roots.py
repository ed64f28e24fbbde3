"""Roots found in floating point, brought into agreement with what is known of them exactly.

Numbers of roots, multiplicities, the roots at the origin and those in mirrored pairs are exact (`counts`);
where the roots found do not fit them, nothing is guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.floating.counts import Counts
from dynid.bondgraph.floating.discs import Discs
from dynid.errors import Undecided


@dataclass(frozen=True)
class EstimatedRoot:
    """One root.

    Parameters
    ----------
    value
        The root, rad/s.
    multiplicity
        Its multiplicity; roots that cannot be told apart stand side by side.
    radius
        Estimate of the error, rad/s.
    side
        -1 in the open left half-plane, 0 on the imaginary axis, +1 in the open right half-plane, None where
        the error leaves that open.
    residual
        Relative residual of the equations.
    """

    value: complex
    multiplicity: int
    radius: float
    side: int | None
    residual: float


def settled(discs: Discs, counts: Counts) -> tuple[EstimatedRoot, ...]:
    """Bring roots into agreement with what is known of them exactly.

    Roots at the origin become 0; roots that overlap become one root where that is what they are, and keep
    wide errors where they are distinct.

    Raises
    ------
    Undecided
        Where roots are apart that must be one, or the origin cannot be told from its neighbours.
    """
    discs = checked(discs, counts.degree).in_order()
    origin = np.arange(len(discs)) < counts.at_origin
    around = np.abs(discs.centre) <= discs.radius
    if (around != origin).any():
        raise _undecided(f"which roots lie at the origin ({counts.at_origin} do)")
    found = [EstimatedRoot(0j, counts.at_origin, 0.0, 0, 0.0)] if counts.at_origin else []
    rest = discs.where(~origin)
    labels = rest.clusters()
    groups = [np.flatnonzero(labels == label) for label in range(labels.max(initial=-1) + 1)]
    expected = sorted(counts.multiplicities)
    if counts.at_origin:
        expected.remove(counts.at_origin)
    if sorted(len(group) for group in groups) == expected:
        merged = [_merged(rest, group) for group in groups]
    elif len(groups) < len(expected):
        merged = [part for group in groups for part in _apart(rest, group)]
    else:
        raise _undecided("how often repeated roots are repeated")
    sides = _sides(merged, counts.mirrored - counts.at_origin)
    found += [
        EstimatedRoot(value, multiplicity, radius, side, residual)
        for (value, multiplicity, radius, residual), side in zip(merged, sides, strict=True)
    ]
    return tuple(sorted(found, key=lambda root: (abs(root.value), root.value.real, root.value.imag)))


_Part = tuple[complex, int, float, float]


def _merged(discs: Discs, group: NDArray[np.int64]) -> _Part:
    """Return roots that are one: their mean, real where they are closed under conjugation."""
    own = discs.centre[group]
    centre = complex(own.mean())
    if sorted(own.imag) == sorted(-own.imag):
        centre = complex(centre.real, 0.0)
    radius = float(np.max(np.abs(own - centre) + discs.radius[group]))
    return centre, len(group), radius, float(discs.residual[group].max())


def _apart(discs: Discs, group: NDArray[np.int64]) -> list[_Part]:
    """Return distinct roots that cannot be told apart: each may be any of them."""
    own = discs.centre[group]
    radius = [float(np.max(np.abs(own - value) + discs.radius[group])) for value in own]
    return [
        (complex(value), 1, r, float(residual))
        for value, r, residual in zip(own, radius, discs.residual[group], strict=True)
    ]


def _sides(parts: list[_Part], mirrored: int) -> list[int | None]:
    """Return on which side of the imaginary axis each root lies.

    A root whose error reaches across the axis lies on it if it is its own mirror image: if all mirrored
    roots are accounted for by such roots, and each is alone with its image.
    """
    sides: list[int | None] = [
        -1 if value.real + radius < 0 else 1 if value.real - radius > 0 else None
        for value, _, radius, _ in parts
    ]
    near = [part for part, side in zip(parts, sides, strict=True) if side is None]
    if 1 in sides or sum(multiplicity for _, multiplicity, _, _ in near) != mirrored:
        return sides
    centre = np.array([value for value, _, _, _ in parts])
    radius = np.array([radius for _, _, radius, _ in parts])
    for k, side in enumerate(sides):
        reach = np.abs(centre - centre[k]) <= 3 * radius[k] + radius
        if side is None and reach.sum() == 1:
            sides[k] = 0
            parts[k] = (complex(0.0, centre[k].imag), *parts[k][1:])
    return sides


def cancelling(natural: Discs, zeros: Discs, count: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which natural modes and which zeros cancel: as many pairs as are known to, the nearest first."""
    common, matches = np.zeros(len(natural), dtype=bool), np.zeros(len(zeros), dtype=bool)
    if count == 0:
        return common, matches
    rows, columns = np.nonzero(natural.overlaps(zeros))
    apart = np.abs(natural.centre[rows] - zeros.centre[columns])
    for pair in np.argsort(apart, kind="stable"):
        row, column = rows[pair], columns[pair]
        if not common[row] and not matches[column]:
            common[row] = matches[column] = True
    if common.sum() != count:
        raise _undecided(f"which {count} of the natural modes cancel")
    return common, matches


def checked(discs: Discs, count: int) -> Discs:
    """Return roots whose number is right.

    Raises
    ------
    Undecided
        Where it is not.
    """
    if len(discs) != count:
        raise _undecided(f"all roots ({len(discs)} found, there are {count})")
    return discs


def _undecided(what: str) -> Undecided:
    return Undecided(
        f"the float engine cannot tell {what}", remedy="Use 'analysis.engine: exact', which decides it."
    )
