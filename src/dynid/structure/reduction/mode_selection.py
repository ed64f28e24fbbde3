"""Selection of the modes of a basis, by number, count or band."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.defaults import BASIS_BAND
from dynid.errors import UsageError
from dynid.number_format import frequency_text
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix
from dynid.structure.modes.modes import modes

BAND = BASIS_BAND.value
"""Without modes given, all below this many times the band of interest are kept.

Modes left out still yield statically. On the beam of Yang, excited up to 271 rad/s, joints are identified
to 3 % with modes up to twice that, and to a half with five times.
"""


@dataclass(frozen=True)
class ModeRange:
    """The lowest modes: so many, or all below a frequency."""

    count: int | None = None  # their number, rigid-body modes included
    below: float | None = None  # the highest frequency, rad/s

    def __post_init__(self) -> None:
        if (self.count is None) == (self.below is None):
            raise UsageError(
                "modes are given by their 'count' or as those 'below' a frequency", names=("modes",)
            )
        if self.count is not None and self.count < 0:
            raise UsageError("a number of modes is not negative", names=("modes",))
        if self.below is not None and not (math.isfinite(self.below) and self.below > 0):
            raise UsageError("the frequency below which modes are kept must be positive", names=("modes",))


@dataclass(frozen=True)
class Interest:
    """Purpose of a reduced model, from which masters and modes are chosen where none are given."""

    dofs: tuple[Label, ...] = ()  # DOFs of sensors and loads; those of the joints are always of interest
    band: float | None = None  # the highest frequency of excitation or response, rad/s


class SelectedModes(NamedTuple):
    """Modes by `numbers` (from 1): `omega` (r), rad/s, and `shapes` (n x r), normed to unit modal mass.

    `doubt` says which of them rounding leaves open, as `Modes.doubt` does. `free`: True if the structure has
    rigid-body modes, chosen or not; `elastic`: rad/s, the lowest frequency that is none of these, 0 if no
    such mode was computed.
    """

    numbers: tuple[int, ...]
    omega: Array
    shapes: Array
    doubt: str
    free: bool
    elastic: float

    @property
    def rigid(self) -> tuple[int, ...]:
        """The places (from 0) of rigid-body modes among them."""
        return tuple(int(index) for index in np.flatnonzero(self.omega == 0))


def selected(matrices: tuple[Matrix, Matrix, Matrix], requested: Sequence[int] | ModeRange) -> SelectedModes:
    """Compute the modes asked for.

    `matrices`: M, C, K of the structure that they are of; `requested`: numbers, from 1 upwards in frequency,
    rigid-body modes included; or the lowest ones. Raises UsageError if a number stands twice or there are not
    so many modes.
    """
    if isinstance(requested, ModeRange):
        result = modes(*matrices, count=requested.count, below=requested.below)
        if requested.below is not None and not len(result.omega):
            raise UsageError(f"no mode lies below {frequency_text(requested.below, 6)}", names=("modes",))
        numbers = tuple(range(1, len(result.omega) + 1))
    else:
        numbers = tuple(requested)
        if not numbers:
            raise UsageError("no modes are given", remedy="Name at least one.", names=("modes",))
        if min(numbers) < 1:
            raise UsageError(f"modes count from 1; there is no mode {min(numbers)}", names=("modes",))
        twice = [number for position, number in enumerate(numbers) if number in numbers[:position]]
        if twice:
            raise UsageError(f"the mode {twice[0]} is named twice", names=("modes",))
        result = modes(*matrices, count=max(numbers))
    places = np.array(numbers, dtype=np.intp) - 1
    elastic = float(result.omega[result.omega > 0].min(initial=np.inf))
    return SelectedModes(
        numbers, result.omega[places], result.shapes[:, places], result.doubt,
        free=result.rigid > 0, elastic=elastic if np.isfinite(elastic) else 0.0,
    )  # fmt: skip


def wanted_modes(
    modes: Sequence[int] | ModeRange | None, interest: Interest, masters: int | None
) -> Sequence[int] | ModeRange:
    """Return the modes to keep; where none are given one a master, else those of the band.

    `modes`: the modes asked for; `interest`: purpose of the model; `masters`: the number of masters, if that
    is fixed.
    """
    if modes is not None:
        return modes
    if masters is not None:
        return ModeRange(count=masters)
    if interest.band is not None:
        return ModeRange(below=BAND * interest.band)
    raise UsageError(
        "nothing says which modes to keep",
        remedy="Give `modes: [1, 2, …]`, `{count: N}` or `{below: OMEGA}`.",
        names=("modes",),
    )


def mode_rule(modes: Sequence[int] | ModeRange | None, interest: Interest, masters: int | None) -> str:
    """Return the rule of `wanted_modes` in words."""
    requested = wanted_modes(modes, interest, masters)
    if not isinstance(requested, ModeRange):
        return "those named are kept"
    if modes is None and masters is not None:
        return "one a master is kept"
    below = "" if requested.below is None else f"below {frequency_text(requested.below, 6)}"
    if modes is None:
        return f"kept {below}, {BAND:g} times the band of interest"
    return f"the lowest {below or requested.count} are kept, as requested"
