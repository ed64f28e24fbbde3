"""One channel of a large graph: roots as eigenvalues, and around them what is exact.

Numbers of roots, multiplicities, the roots at the origin and those in mirrored pairs are exact (`counts`),
and so are the gains (`series`); where the roots found do not fit them, nothing is guessed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.floating.counts import Counts, modular_ratios
from dynid.bondgraph.floating.discs import Discs
from dynid.bondgraph.floating.series import as_float, leading_terms
from dynid.bondgraph.floating.spectrum import spectrum
from dynid.bondgraph.floating.systems import natural_equations, zero_equations
from dynid.bondgraph.natural import determinant
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.errors import Undecided
from dynid.lti.verdicts import Verdicts


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


class FloatEngine:
    """The channels of a graph, their roots found in floating point where they are asked for.

    Parameters
    ----------
    reduced
        The graph.
    """

    def __init__(self, reduced: ReducedGraph) -> None:
        self.reduced = reduced
        self.channels = reduced.channels()
        determinants = {port: determinant(reduced, each) for port, each in reduced.reductions.items()}
        counted = modular_ratios(reduced, [*self.channels.values(), *determinants.values()])
        self.counts = {channel: counted[register] for channel, register in self.channels.items()}
        self.natural_counts = {port: counted[register][0] for port, register in determinants.items()}
        self._spectra: dict[frozenset[str], Discs] = {}
        self._found: dict[Channel, FloatTransferFunction] = {}

    def channel(self, channel: Channel) -> FloatTransferFunction:
        """Return one channel."""
        if channel not in self._found:
            self._found[channel] = FloatTransferFunction(self, channel)
        return self._found[channel]

    def hidden_modes(self, channel: Channel) -> tuple[EstimatedRoot, ...]:
        """Return the natural modes that cancel in a channel."""
        return self.channel(channel).hidden_modes

    def natural(self, channel: Channel) -> Discs:
        """Return all natural modes of the part behind an output, its integrator included."""
        port = channel[0]
        junctions = frozenset(self.reduced.reductions[port].junctions)
        if junctions not in self._spectra:
            self._spectra[junctions] = _checked(
                spectrum(natural_equations(self.reduced, port)), self.natural_counts[port].degree
            )
        origin = Discs(np.zeros(1, dtype=np.complex128), np.zeros(1), np.zeros(1))
        return Discs.joined([self._spectra[junctions], *[origin] * self.reduced.graph.integrates(port)])

    def invariant_zeros(self, channel: Channel) -> Discs:
        """Return what an input can do while its output is held at zero: zeros and hidden modes."""
        return spectrum(zero_equations(self.reduced, channel))

    @cached_property
    def at_zero(self) -> dict[int, tuple[int, Any]]:
        """How every channel begins as s falls to 0: the power and the coefficient."""
        return leading_terms(self.reduced, self._reached(), at_infinity=False)

    @cached_property
    def at_infinity(self) -> dict[int, tuple[int, Any]]:
        """How every channel ends as s grows."""
        return leading_terms(self.reduced, self._reached(), at_infinity=True)

    def _reached(self) -> list[int]:
        return [self.channels[c] for c, (above, _) in self.counts.items() if above.degree >= 0]


class FloatTransferFunction(Verdicts):
    """One channel: see `FloatEngine`.

    Raises
    ------
    Undecided
        Where the roots found do not fit what is known of them exactly.
    """

    def __init__(self, engine: FloatEngine, channel: Channel) -> None:
        self.engine, self.channel = engine, channel
        self.above, self.below = engine.counts[channel]

    @property
    def vanishes(self) -> bool:
        """Whether the input does not reach the output at all."""
        return self.above.degree < 0

    @property
    def order(self) -> int:
        """The number of poles."""
        return self.below.degree

    @property
    def relative_degree(self) -> int | float:
        """Poles minus zeros."""
        return math.inf if self.vanishes else self.below.degree - self.above.degree

    @property
    def gain(self) -> float:
        """The factor k of T(s) = k prod(s - zeros) / prod(s - poles)."""
        return 0.0 if self.vanishes else as_float(self.engine.at_infinity[self._register][1])

    @property
    def dc_gain(self) -> float:
        """The limit of T(s) as s falls to 0 through positive values."""
        return 0.0 if self.vanishes else _limit(*self.engine.at_zero[self._register])

    @property
    def high_frequency_gain(self) -> float:
        """The limit of T(s) as s grows through positive values."""
        if self.vanishes:
            return 0.0
        power, coefficient = self.engine.at_infinity[self._register]
        return _limit(-power, coefficient)

    @property
    def zeros(self) -> tuple[EstimatedRoot, ...]:
        """The finite zeros; none where the channel vanishes."""
        return self._roots[0]

    @property
    def poles(self) -> tuple[EstimatedRoot, ...]:
        """The poles."""
        return self._roots[1]

    @property
    def hidden_modes(self) -> tuple[EstimatedRoot, ...]:
        """The natural modes that cancel; an output's own integrator is none."""
        hidden = self._roots[2]
        if not self.engine.reduced.graph.integrates(self.channel[0]) or self.below.at_origin:
            return hidden
        rest = [replace(root, multiplicity=root.multiplicity - (root.value == 0)) for root in hidden]
        return tuple(root for root in rest if root.multiplicity)

    @property
    def _register(self) -> int:
        return self.engine.channels[self.channel]

    @cached_property
    def _roots(self) -> tuple[tuple[EstimatedRoot, ...], ...]:
        """Return zeros, poles and hidden modes."""
        natural, all_counts = self.engine.natural(self.channel), self._natural_counts()
        if self.vanishes:
            return (), (), settled(natural, all_counts)
        hidden_counts = Counts(all_counts.polynomial // self.below.polynomial)
        zeros = _checked(self.engine.invariant_zeros(self.channel), self.above.degree + hidden_counts.degree)
        common, matches = _cancelling(natural, zeros, hidden_counts.degree)
        return (
            settled(zeros.where(~matches), self.above),
            settled(natural.where(~common), self.below),
            settled(natural.where(common), hidden_counts),
        )

    def _natural_counts(self) -> Counts:
        """Return the counts of all natural modes, the output's integrator included."""
        port = self.channel[0]
        counts = self.engine.natural_counts[port]
        return counts.times_s() if self.engine.reduced.graph.integrates(port) else counts


def settled(discs: Discs, counts: Counts) -> tuple[EstimatedRoot, ...]:
    """Bring roots into agreement with what is known of them exactly.

    Roots at the origin become 0; roots that overlap become one root where that is what they are, and keep
    wide errors where they are distinct.

    Raises
    ------
    Undecided
        Where roots are apart that must be one, or the origin cannot be told from its neighbours.
    """
    discs = _checked(discs, counts.degree).in_order()
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


def _cancelling(natural: Discs, zeros: Discs, count: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
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


def _checked(discs: Discs, count: int) -> Discs:
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


def _limit(power: int, coefficient: Any) -> float:
    """Return the limit of c x^k as x falls to 0."""
    if power == 0:
        return as_float(coefficient)
    return 0.0 if power > 0 else math.copysign(math.inf, 1 if coefficient > 0 else -1)
