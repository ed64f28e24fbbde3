"""Stability and minimum phase, decided by zeros and poles from any engine, with verdicts in words.

The engines compute on which side of the imaginary axis a root lies, from its error bound: the exact engine in
`lti/enclosures.py`, the floating-point engine in `bondgraph/floating/roots.py`, pencils in
`lti/pencil/zeros_poles.py`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from dynid.number_format import frequency_text

#: Most zeros or poles that a verdict names.
_MAX_NAMED_VALUES = 4
#: A zero is far if its modulus exceeds that of the largest pole by this factor.
FAR = 1e3


@dataclass(frozen=True)
class SidedRoot:
    """A zero or pole, exact or estimated."""

    value: complex  # the root, rad/s
    #: Its multiplicity; roots that coincide within an estimated error are listed side by side.
    multiplicity: int
    radius: float  # bound on the distance from the true root, or an estimate, rad/s
    #: -1 left of the imaginary axis, 0 on it, +1 right of it; None if undecided within the error.
    side: int | None


class TransferProperties(ABC):
    """Zeros, poles and gains of a transfer function, and its stability and phase."""

    @property
    @abstractmethod
    def vanishes(self) -> bool:
        """True if the input does not affect the output."""

    @property
    @abstractmethod
    def zeros(self) -> Sequence[SidedRoot]:
        """The finite zeros; none where the channel vanishes."""

    @property
    @abstractmethod
    def poles(self) -> Sequence[SidedRoot]:
        """The poles."""

    @property
    @abstractmethod
    def order(self) -> int:
        """The number of poles."""

    @property
    @abstractmethod
    def relative_degree(self) -> int | float:
        """Poles minus zeros: negative where the channel differentiates, infinite where it vanishes."""

    @property
    @abstractmethod
    def dc_gain(self) -> float:
        """The limit of T(s) as s falls to 0 through positive values; may be infinite."""

    @property
    @abstractmethod
    def high_frequency_gain(self) -> float:
        """The limit of T(s) as s grows through positive values; may be infinite."""

    @property
    def stable(self) -> bool | None:
        """True if every pole lies in the open left half-plane; None if undecided."""
        return all_left(self.poles)

    @property
    def stability(self) -> str:
        """The stability verdict in words, with the poles that decide it."""
        return stability(self.poles)

    @property
    def minimum_phase(self) -> bool | None:
        """True if every zero lies in the open left half-plane (also without zeros); None if undecided.

        False where the channel vanishes.
        """
        return False if self.vanishes else all_left(self.zeros)

    @property
    def zero_stability(self) -> str:
        """The phase verdict in words, with the zeros that decide it."""
        return zero_stability(self.zeros, self.poles, vanishes=self.vanishes)


@dataclass(frozen=True)
class Verdict:
    """Stability of a system, and why.

    Kinds: stable, marginal, at the limit (of loops with delays, see `lti/delay_stability.py`), unstable,
    singular (no unique solution, of which stability is not defined) or undecided. Of unstable poles there may
    be infinitely many (inf); NaN where that is undecided or not defined.
    """

    kind: str
    reason: str
    unstable_poles: float

    @property
    def stable(self) -> bool:
        """True if all poles provably lie left of the axis, and stay there when delays change by little."""
        return self.kind == "stable"

    @property
    def text(self) -> str:
        """The verdict in words."""
        return f"{self.kind}: {self.reason}" if self.reason else self.kind


#: Kinds of verdicts, of which the first that a part of a system has is that of the whole.
KINDS = ("unstable", "singular", "undecided", "at the limit", "marginal", "stable")


def verdict(poles: Sequence[SidedRoot]) -> Verdict:
    """Return the verdict on the poles of a system; repeated ones on the axis may belong to several parts."""
    right, axis, open_ones = _by_side(poles)
    count = sum(pole.multiplicity for pole in right)
    if right:
        return Verdict("unstable", f"{_place(right, 'pole')} in the right half-plane", count)
    if open_ones:
        return Verdict("undecided", _undecided(open_ones, "pole"), math.nan)
    if axis:
        return Verdict("marginal", f"{_place(axis, 'pole')} on the imaginary axis", 0)
    return Verdict("stable", "" if poles else "there are no poles", 0)


def no_solution(causes: Sequence[str]) -> Verdict:
    """Return the verdict on a system of which a part has no unique solution."""
    return Verdict("singular", ": ".join(["a part has no unique solution", *causes[:1]]), math.nan)


def combined(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict on a system of several parts."""
    parts = sorted(verdicts, key=lambda verdict: KINDS.index(verdict.kind))
    first = next((verdict for verdict in parts if verdict.reason and verdict.kind == parts[0].kind), parts[0])
    count = sum(verdict.unstable_poles for verdict in parts)
    return replace(first, unstable_poles=count)


def stability(poles: Sequence[SidedRoot]) -> str:
    """Return the stability verdict in words, with the poles that decide it."""
    right, axis, open_ones = _by_side(poles)
    repeated = [pole for pole in axis if pole.multiplicity > 1]
    if right or repeated:
        where = "in the right half-plane" if right else "repeated on the imaginary axis"
        return f"unstable: {_place(right or repeated, 'pole')} {where}"
    on_axis = f"{_place(axis, 'pole')} on the imaginary axis" if axis else ""
    if open_ones:
        undecided = _undecided(open_ones, "pole")
        return f"not stable: {on_axis}; marginal or unstable is {undecided}" if axis else undecided
    if axis:
        return f"marginal, not stable: {on_axis}"
    return "stable" if poles else "stable: there are no poles"


def zero_stability(zeros: Sequence[SidedRoot], poles: Sequence[SidedRoot], *, vanishes: bool) -> str:
    """Return the phase verdict in words, with the zeros that decide it, noting where all of these are far."""
    right, axis, open_ones = _by_side(zeros)
    if vanishes:
        return "undefined: the input does not reach the output"
    if right:
        where = f"{_place(right, 'zero')} in the right half-plane"
        return f"non-minimum phase: {where}; its inverse is unstable{_remoteness(right, zeros, poles)}"
    where = f"{_place(axis, 'zero')} on the imaginary axis" if axis else ""
    if open_ones:
        undecided = _undecided(open_ones, "zero")
        return (
            f"not minimum phase: {where}; marginal or non-minimum phase is {undecided}" if axis else undecided
        )
    if axis:
        repeated = any(zero.multiplicity > 1 for zero in axis)
        frequencies = sorted({float(f"{abs(zero.value):.4g}") for zero in axis if zero.value})
        named = ", ".join(map(frequency_text, frequencies))
        motion = f"oscillate at {named}" if named else "hold a constant state"
        growth = " and grow" if repeated else ""
        dynamics = f"the zero dynamics {motion}{growth}, unobservable at the output"
        return f"marginal, not minimum phase: {where}: {dynamics}"
    if not zeros:
        return "minimum phase: there are no finite zeros"
    return "minimum phase: every zero lies in the open left half-plane"


def far(zeros: Sequence[SidedRoot], poles: Sequence[SidedRoot]) -> tuple[SidedRoot, ...]:
    """Return the zeros more than `FAR` times beyond the largest pole; none where all poles are 0."""
    largest = _largest(poles)
    return tuple(zero for zero in zeros if largest and abs(zero.value) > FAR * largest)


def _remoteness(deciding: Sequence[SidedRoot], zeros: Sequence[SidedRoot], poles: Sequence[SidedRoot]) -> str:
    """Return a note where far zeros alone decide a verdict, with the verdict without them; else ''."""
    remote = far(deciding, poles)
    if len(remote) < len(deciding):
        return ""
    ratio = min(abs(zero.value) for zero in remote) / _largest(poles)
    near = [zero for zero in zeros if zero not in remote]
    rest, _, _ = zero_stability(near, poles, vanishes=False).partition(":")
    them = "it" if len(remote) == remote[0].multiplicity == 1 else "them"
    return f"; far, {ratio:.1g} times beyond the largest pole, and without {them} {rest}"


def _largest(poles: Sequence[SidedRoot]) -> float:
    return max((abs(pole.value) for pole in poles), default=0.0)


def _by_side(roots: Sequence[SidedRoot]) -> tuple[list[SidedRoot], list[SidedRoot], list[SidedRoot]]:
    """Return the roots to the right of the axis, on it, and those that are undecided."""
    right = [root for root in roots if root.side is not None and root.side > 0]
    axis = [root for root in roots if root.side == 0]
    return right, axis, [root for root in roots if root.side is None]


def all_left(roots: Sequence[SidedRoot]) -> bool | None:
    """Return True if all roots lie in the open left half-plane; None if undecided."""
    right, axis, open_ones = _by_side(roots)
    return False if right or axis else None if open_ones else True


def _undecided(roots: list[SidedRoot], what: str) -> str:
    error = max(root.radius for root in roots)
    return (
        f"undecided within the error of the floating-point engine ({error:.1g} rad/s): {_place(roots, what)} "
        "too near the imaginary axis; use 'engine: exact'"
    )


def _place(roots: list[SidedRoot], what: str) -> str:
    """Return the places of roots in words, with the verb."""
    count = sum(root.multiplicity for root in roots)
    upper = [root.value for root in roots if root.value.imag >= 0]
    named = []
    for value in upper[:_MAX_NAMED_VALUES]:
        real = f"{value.real:.4g}"
        pair = f"{real} ± {abs(value.imag):.4g}j" if value.real else f"±{abs(value.imag):.4g}j"
        named.append(pair if value.imag else real)
    text = ", ".join(named) + (", …" if len(upper) > _MAX_NAMED_VALUES else "")
    return f"{what} at {text} lies" if count == 1 else f"{what}s at {text} lie"
