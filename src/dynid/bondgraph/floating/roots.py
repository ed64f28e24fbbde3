"""Roots found in floating point, brought into agreement with exact counts.

The program is run on rational functions of s modulo a large prime. Degrees, multiplicities, roots at the
origin and the roots that come with their mirror image about the imaginary axis are the same there as over
the rationals, but for accidents with a probability of about degree/2^61. Where the roots found do not fit
these counts, nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.program.factored import RationalFunction, polynomial, rational_functions_modulo
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Undecided
from dynid.lti.stability import SidedRoot
from dynid.number_format import root_text
from dynid.suggestions import shortened

# --- exact counts ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class RootCounts:
    """Exact counts of the roots of one polynomial."""

    polynomial: Any  # the polynomial modulo a prime (flint `nmod_poly`, or `fmpz_mod_poly` of a long one)

    @property
    def degree(self) -> int:
        """The number of roots, by multiplicity (-1 of the zero polynomial)."""
        return int(self.polynomial.degree())

    @cached_property
    def at_origin(self) -> int:
        """The multiplicity of the root 0."""
        return next((power for power in range(self.degree + 1) if self.polynomial[power] != 0), 0)

    @cached_property
    def mirrored(self) -> int:
        """The number of roots, by multiplicity, that come with their mirror image about the imaginary axis.

        All roots on the axis do. With p(s) = E(s^2) + s O(s^2) they are the roots of gcd(E, O).
        """
        shared, factors = 0, self.polynomial.factor_squarefree()[1]
        for factor, multiplicity in factors:
            coefficients = factor.coeffs()
            origin = int(coefficients[0] == 0)
            even, odd = (self._made(coefficients[origin + k :: 2]) for k in (0, 1))
            shared += multiplicity * (origin + 2 * max(int(even.gcd(odd).degree()), 0))
        return int(shared)

    @cached_property
    def multiplicities(self) -> list[int]:
        """The multiplicities of the distinct roots, in order."""
        if self.degree < 1:
            return []
        factors = self.polynomial.factor_squarefree()[1]
        return sorted(int(power) for factor, power in factors for _ in range(int(factor.degree())))

    def times_s(self) -> RootCounts:
        """Return the counts with one more root at the origin."""
        return RootCounts(self.polynomial * self._made([0, 1]))

    def _made(self, coefficients: list[Any]) -> Any:
        return polynomial([int(c) for c in coefficients], self.polynomial.modulus())


def modular_ratios(
    reduced: ReducedGraph, registers: Iterable[int]
) -> dict[int, tuple[RootCounts, RootCounts]]:
    """Return the counts of numerator and denominator, in lowest terms, of these registers.

    Raises `ZeroDivisionError` where a pivot vanishes with the graph's values.
    """
    registers, point = list(registers), reduced.modulo()
    prime = point.prime
    bits = {name: 1 << index for index, name in enumerate(reduced.storages)}
    residue, unity = rational_functions_modulo(prime), polynomial([1], prime)

    def constant(value: int, storages: int = 0) -> RationalFunction:
        return residue.of(polynomial([value], prime), unity, storages)

    values = {name: constant(int(value), bits.get(name, 0)) for name, value in point.values.items()}
    run = reduced.run(registers, values, residue.of(polynomial([0, 1], prime), unity), constant(1))
    lowest = {register: run[register].lowest_terms() for register in registers}
    return {register: (RootCounts(above), RootCounts(below)) for register, (above, below) in lowest.items()}


# --- roots with error estimates -------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RootDiscs:
    """Roots of a polynomial, one for each multiplicity."""

    centre: NDArray[np.complex128]  # approximate roots, rad/s
    radius: NDArray[np.float64]  # estimates of their errors, rad/s; 0 of what is exact
    #: Relative residual of the equations at each, entry by entry: about 1e-16 where the root is exact for
    #: coefficients that were changed in their last digit.
    residual: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.centre)

    @classmethod
    def none(cls) -> RootDiscs:
        """Return no roots."""
        return cls(np.zeros(0, dtype=np.complex128), np.zeros(0), np.zeros(0))

    @classmethod
    def joined(cls, parts: list[RootDiscs]) -> RootDiscs:
        """Return the roots of a product."""
        if not parts:
            return cls.none()
        return cls(
            np.concatenate([discs.centre for discs in parts]),
            np.concatenate([discs.radius for discs in parts]),
            np.concatenate([discs.residual for discs in parts]),
        )

    def where(self, mask: NDArray[np.bool_]) -> RootDiscs:
        """Return some of them."""
        return RootDiscs(self.centre[mask], self.radius[mask], self.residual[mask])

    def overlaps(self, discs: RootDiscs) -> NDArray[np.bool_]:
        """Return for every pair whether they may be one root, shape (len(self), len(other))."""
        apart = np.abs(self.centre[:, None] - discs.centre[None, :])
        return apart <= self.radius[:, None] + discs.radius[None, :]

    def clusters(self) -> NDArray[np.int64]:
        """Return a number for every root: the same for those that overlap, also by way of others."""
        overlaps = self.overlaps(self)
        if np.count_nonzero(overlaps) == len(self):  # each with itself alone
            return np.arange(len(self))
        from scipy.sparse.csgraph import connected_components

        _, label = connected_components(overlaps.astype(np.int8), directed=False)
        return np.asarray(label, dtype=np.int64)

    def in_order(self) -> RootDiscs:
        """Return them by modulus, then real part, then imaginary part, conjugates side by side."""
        size = np.abs(self.centre)
        order = np.lexsort((self.centre.imag, self.centre.real, size))
        return RootDiscs(self.centre[order], self.radius[order], self.residual[order])


# --- agreement of both ----------------------------------------------------------------------------

#: Relative error above which repeated roots are certified: within one block eigenvalues have half the digits.
_REPEATED_ROOT_RTOL = 2.0**-40


@dataclass(frozen=True)
class EstimatedRoot(SidedRoot):
    """A root with an error estimate, and the relative residual of the equations."""

    residual: float


def settled(discs: RootDiscs, counts: RootCounts, *, strict: bool = False) -> tuple[EstimatedRoot, ...]:
    """Bring roots into agreement with their exact counts.

    Roots at the origin become 0; roots that overlap become one root where that is what they are, and keep
    wide errors where they are distinct.

    `strict`: True: distinct roots that overlap, a side that is open, and repeated roots with a relative error
    above `_REPEATED_ROOT_RTOL` are undecided as well. Raises `Undecided` where roots are apart that must be
    one, or the origin cannot be distinguished from its neighbours.
    """
    discs = checked(discs, counts.degree).in_order()
    origin = np.arange(len(discs)) < counts.at_origin
    around = np.abs(discs.centre) <= discs.radius
    if (around != origin).any():
        what = f"which roots lie at the origin ({counts.at_origin} do)"
        raise _undecided(what, discs.where(around | origin))
    roots = [EstimatedRoot(0j, counts.at_origin, 0.0, 0, 0.0)] if counts.at_origin else []
    rest = discs.where(~origin)
    labels = rest.clusters()
    order = np.argsort(labels, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1) if len(rest) else []
    expected = sorted(counts.multiplicities)
    if counts.at_origin:
        expected.remove(counts.at_origin)
    merged = [_merged(rest, group) for group in groups]
    agree = sorted(len(group) for group in groups) == expected
    blurred = not agree or any(
        power > 1 and radius > _REPEATED_ROOT_RTOL * abs(value) for value, power, radius, _ in merged
    )
    if (strict and blurred) or not (agree or len(groups) < len(expected)):
        clustered = rest.where(np.bincount(labels, minlength=len(rest))[labels] > 1)
        powers = ", ".join(str(power) for power in expected if power > 1) or "none is"
        what = f"how often repeated roots are repeated ({powers})"
        raise _undecided(what, clustered if len(clustered) else rest)
    if not agree:
        merged = []  # enclosures that cannot be separated: each root may be any of them
        for group in groups:
            centres, residuals = rest.centre[group], rest.residual[group].tolist()
            radii = [float(np.max(np.abs(centres - value) + rest.radius[group])) for value in centres]
            merged += zip(centres.tolist(), [1] * len(group), radii, residuals, strict=True)
    sides = _sides(merged, counts.mirrored - counts.at_origin)
    if strict and None in sides:
        near = np.array([side is None for side in sides])
        centre, radius = (np.array([root[k] for root in merged])[near] for k in (0, 2))
        raise _undecided("on which side of the imaginary axis roots lie", RootDiscs(centre, radius, radius))
    roots += [
        EstimatedRoot(value, multiplicity, radius, side, residual)
        for (value, multiplicity, radius, residual), side in zip(merged, sides, strict=True)
    ]
    return tuple(sorted(roots, key=lambda root: (abs(root.value), root.value.real, root.value.imag)))


_Part = tuple[complex, int, float, float]


def _merged(discs: RootDiscs, group: NDArray[np.int64]) -> _Part:
    """Return roots that are one: their mean, real where they are closed under conjugation."""
    if len(group) == 1:
        (index,) = group.tolist()
        return complex(discs.centre[index]), 1, float(discs.radius[index]), float(discs.residual[index])
    centres = discs.centre[group]
    centre = complex(centres.mean())
    if sorted(centres.imag) == sorted(-centres.imag):
        centre = complex(centre.real, 0.0)
    radius = float(np.max(np.abs(centres - centre) + discs.radius[group]))
    return centre, len(group), radius, float(discs.residual[group].max())


def _sides(parts: list[_Part], mirrored: int) -> list[int | None]:
    """Return on which side of the imaginary axis each root lies.

    A root whose error reaches across the axis lies on it if it is its own mirror image: if all mirrored
    roots are accounted for by such roots, and each is alone with its image.
    """
    sides: list[int | None] = [
        -1 if value.real + radius < 0 else 1 if value.real - radius > 0 else None
        for value, _, radius, _ in parts
    ]
    near = [root for root, side in zip(parts, sides, strict=True) if side is None]
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


def cancelling(
    natural: RootDiscs, zeros: RootDiscs, count: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
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
        raise _undecided(f"which {count} of the natural modes cancel", natural)
    return common, matches


def checked(discs: RootDiscs, count: int) -> RootDiscs:
    """Return the roots where their number is right."""
    if len(discs) != count:
        raise _undecided(f"all roots ({len(discs)} found, there are {count})", discs)
    return discs


#: Most roots that a message names.
_MAX_NAMED_ROOTS = 6


def _undecided(what: str, discs: RootDiscs) -> Undecided:
    """Return the error of roots that are undecided, with these roots and their errors."""
    names = [
        f"{root_text(value)} (error {radius:.1g})"
        for value, radius in zip(discs.centre.tolist(), discs.radius.tolist(), strict=True)
        if value.imag >= 0
    ]
    roots = shortened(names, _MAX_NAMED_ROOTS) if names else "none"
    return Undecided(
        f"the floating-point engine cannot determine {what}: {roots}, rad/s",
        remedy="Use 'analysis.engine: exact', which decides it.",
    )
