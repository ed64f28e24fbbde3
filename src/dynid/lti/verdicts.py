"""What zeros and poles mean: stability and phase verdicts in words, whichever engine found the roots."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

#: Most zeros or poles that a verdict names.
_SHOWN = 4
#: A zero is far where it lies so many times beyond the largest pole: the dynamics below never feel it.
FAR = 1e3


class Root(Protocol):
    """A zero or pole, exact or estimated."""

    @property
    def value(self) -> complex:
        """Where it lies, rad/s."""

    @property
    def multiplicity(self) -> int:
        """How often."""

    @property
    def radius(self) -> float:
        """How far the true root may lie from it, rad/s."""

    @property
    def side(self) -> int | None:
        """-1 left of the imaginary axis, 0 on it, +1 right of it; None where the error leaves that open."""


class Verdicts(ABC):
    """A transfer function by its zeros, poles and gains, and what follows from them."""

    @property
    @abstractmethod
    def vanishes(self) -> bool:
        """Whether the input does not reach the output at all."""

    @property
    @abstractmethod
    def zeros(self) -> Sequence[Root]:
        """The finite zeros; none where the channel vanishes."""

    @property
    @abstractmethod
    def poles(self) -> Sequence[Root]:
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
        """Whether every pole lies in the open left half-plane; None where that is undecided."""
        return all_left(self.poles)

    @property
    def stability(self) -> str:
        """The stability verdict in words, with the poles that decide it."""
        return stability(self.poles)

    @property
    def minimum_phase(self) -> bool | None:
        """Whether every zero lies in the open left half-plane (no zeros: yes; a vanishing channel: no).

        None where that is undecided.
        """
        return False if self.vanishes else all_left(self.zeros)

    @property
    def zero_stability(self) -> str:
        """The phase verdict in words, with the zeros that decide it."""
        return zero_stability(self.zeros, self.poles, vanishes=self.vanishes)


def stability(poles: Sequence[Root]) -> str:
    """Return the stability verdict in words, with the poles that decide it."""
    right, axis, open_ones = _by_side(poles)
    repeated = [pole for pole in axis if pole.multiplicity > 1]
    if right or repeated:
        where = "in the right half-plane" if right else "repeated on the imaginary axis"
        return f"unstable: {_place(right or repeated, 'pole')} {where}"
    if open_ones:
        return _undecided(open_ones, "pole")
    if axis:
        return f"marginal, not stable: {_place(axis, 'pole')} on the imaginary axis"
    return "stable" if poles else "stable: there are no poles"


def zero_stability(zeros: Sequence[Root], poles: Sequence[Root], *, vanishes: bool) -> str:
    """Return the phase verdict in words, with the zeros that decide it, and whether those are far."""
    right, axis, open_ones = _by_side(zeros)
    if vanishes:
        return "undefined: the input does not reach the output"
    if right:
        where = f"{_place(right, 'zero')} in the right half-plane"
        return f"non-minimum phase: {where}; its inverse is unstable{_remoteness(right, zeros, poles)}"
    if open_ones:
        return _undecided(open_ones, "zero")
    if axis:
        where = f"{_place(axis, 'zero')} on the imaginary axis"
        return f"marginal, not minimum phase: {where}, so {_consequence(axis)}"
    if not zeros:
        return "minimum phase: there are no finite zeros"
    return "minimum phase: every zero lies in the open left half-plane"


def far(zeros: Sequence[Root], poles: Sequence[Root]) -> tuple[Root, ...]:
    """Return the zeros more than `FAR` times beyond the largest pole; none where all poles are 0."""
    largest = _largest(poles)
    return tuple(zero for zero in zeros if largest and abs(zero.value) > FAR * largest)


def _remoteness(deciding: Sequence[Root], zeros: Sequence[Root], poles: Sequence[Root]) -> str:
    """Say so where a verdict hangs on far zeros alone, and what it would be without them."""
    remote = far(deciding, poles)
    if len(remote) < len(deciding):
        return ""
    ratio = min(abs(zero.value) for zero in remote) / _largest(poles)
    near = [zero for zero in zeros if zero not in remote]
    rest, _, _ = zero_stability(near, poles, vanishes=False).partition(":")
    them = "it" if len(remote) == remote[0].multiplicity == 1 else "them"
    return f"; far, {ratio:.1g} times beyond the largest pole, and without {them} {rest}"


def _largest(poles: Sequence[Root]) -> float:
    return max((abs(pole.value) for pole in poles), default=0.0)


def _by_side(roots: Sequence[Root]) -> tuple[list[Root], list[Root], list[Root]]:
    """Return the roots on the right of the axis, on it, and those of which that is open."""
    right = [root for root in roots if root.side is not None and root.side > 0]
    axis = [root for root in roots if root.side == 0]
    return right, axis, [root for root in roots if root.side is None]


def all_left(roots: Sequence[Root]) -> bool | None:
    """Tell whether all roots lie in the open left half-plane; None where that is open."""
    right, axis, open_ones = _by_side(roots)
    return False if right or axis else None if open_ones else True


def _undecided(roots: list[Root], what: str) -> str:
    error = max(root.radius for root in roots)
    return (
        f"undecided within the error of the float engine ({error:.1g} rad/s): {_place(roots, what)} too near "
        "the imaginary axis; 'engine: exact' decides"
    )


def _consequence(zeros: list[Root]) -> str:
    """Say what zeros on the axis mean: an internal motion that neither decays nor shows."""
    repeated = any(zero.multiplicity > 1 for zero in zeros)
    ringing = sorted({f"{abs(zero.value):.4g}" for zero in zeros if zero.value}, key=float)
    motion = f"ring unseen at {', '.join(ringing)} rad/s" if ringing else "hold a constant state unseen"
    return f"with the output held at zero the inside can {motion}" + (" and grow" if repeated else "")


def _place(roots: list[Root], what: str) -> str:
    count = sum(root.multiplicity for root in roots)
    upper = [root.value for root in roots if root.value.imag >= 0]
    shown = [_number(value) for value in upper[:_SHOWN]]
    text = ", ".join(shown) + (", …" if len(upper) > _SHOWN else "")
    return f"{what} at {text} lies" if count == 1 else f"{what}s at {text} lie"


def _number(value: complex) -> str:
    if value.imag == 0:
        return f"{value.real:.4g}"
    return f"±{abs(value.imag):.4g}j" if value.real == 0 else f"{value.real:.4g} ± {abs(value.imag):.4g}j"
