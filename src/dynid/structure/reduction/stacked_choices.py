"""Masters and modes that reduction methods choose, for many structures side by side.

A choice is sure where rounding cannot change it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.condensation import OnMasters
from dynid.structure.reduction.masters import (
    Indices,
    Masters,
    completed,
    indices_of,
    interesting,
    masters_alone,
    masters_for_modes,
    mode_count,
    modes_to_see,
)
from dynid.structure.reduction.modal import CraigBampton, ModalTruncation
from dynid.structure.reduction.mode_selection import ModeRange, wanted_modes
from dynid.structure.reduction.serep import JointAware, Serep
from dynid.structure.reduction.stacked_modes import Stack, Sure, diagonal

# Relative change of shapes and frequencies that must not change a choice: far above the rounding of either.
_CHOICE_MARGIN = 1e-8


class Choice(NamedTuple):
    """The masters, by index, and the numbers of the modes that a reduction of one structure is made of."""

    masters: tuple[int, ...]
    modes: tuple[int, ...]


def _numbers_of(requested: Sequence[int] | ModeRange, stack: Stack) -> tuple[list[tuple[int, ...]], Sure]:
    """Return for each structure the numbers of the modes to keep, and which are sure."""
    count = len(stack.M)
    sure = np.ones(count, dtype=bool)
    if not isinstance(requested, ModeRange):
        return [tuple(requested)] * count, sure
    if requested.count is not None:
        return [tuple(range(1, requested.count + 1))] * count, sure
    assert requested.below is not None
    omega = stack.frequencies
    sure = np.all(np.abs(omega - requested.below) > _CHOICE_MARGIN * requested.below, axis=1)
    return [tuple(range(1, number + 1)) for number in np.sum(omega < requested.below, axis=1).tolist()], sure


def _pick(
    pick: Callable[[Array, Array], Indices],
    stack: Stack,
    mass: Array,
    numbers: Sequence[tuple[int, ...]],
    sure: Sure,
) -> tuple[list[Choice], Sure]:
    """Return the masters that a rule picks for these modes, and where a small change picks the same."""
    modes = stack.modes(max(map(max, filter(None, numbers)), default=1))
    sure = sure & modes.sure
    random = np.random.Generator(np.random.PCG64(0))
    noise = 1 + _CHOICE_MARGIN * random.standard_normal(modes.shapes.shape[1:])
    choices = []
    for s, kept in enumerate(numbers):
        columns = np.array(kept, dtype=np.intp) - 1
        masters: Sequence[int] = ()
        sure[s] &= len(kept) > 0
        if sure[s]:
            try:
                masters = pick(modes.shapes[s][:, columns], mass[s]).tolist()
                changed = pick((noise * modes.shapes[s])[:, columns], noise[:, 0] * mass[s])
                sure[s] = masters == changed.tolist()
            except UsageError:
                sure[s] = False
        choices.append(Choice(tuple(masters), kept))
    return choices, sure


def choose_for_modes(
    method: Serep | JointAware, model: StructuralModel, joint_aware: bool, bare: Stack, jointed: Stack
) -> tuple[list[Choice], Sure]:
    """Return the choices of SEREP and of the joint-aware method."""
    masters, interest = method.masters, method.interest
    count, ends = mode_count(model, masters, interest), interesting(model, interest)
    of = jointed if joint_aware else bare
    numbers, sure = _numbers_of(wanted_modes(method.modes, interest, count), of)
    if masters is not None and not isinstance(masters, Masters):
        fixed = tuple(indices_of(model, masters).tolist())
        return [Choice(fixed, kept) for kept in numbers], sure & np.array([len(kept) > 0 for kept in numbers])

    def pick(shapes: Array, mass: Array) -> Indices:
        if masters is None:
            return completed(ends, shapes)
        return masters_for_modes(model, masters, interest, shapes, mass)

    return _pick(pick, of, diagonal(bare.M), numbers, sure)


def choose_masters(
    method: OnMasters, model: StructuralModel, bare: Stack, jointed: Stack
) -> tuple[list[Choice], Sure]:
    """Return the masters of a method that is not made of modes, as `masters_alone` does."""
    given, interest, count = method.masters, method.interest, len(bare.M)
    if not isinstance(given, Masters):
        masters = masters_alone(model, given, interest)
        return [Choice(tuple(masters.tolist()), ())] * count, np.ones(count, dtype=bool)
    choices, sure = _pick(
        partial(masters_for_modes, model, given, interest),
        jointed,
        diagonal(bare.M),
        *_numbers_of(modes_to_see(given, interest, model.size), jointed),
    )
    return [Choice(choice.masters, ()) for choice in choices], sure


def choose_for_fixed_interface(
    method: CraigBampton, model: StructuralModel, bare: Stack, jointed: Stack
) -> tuple[list[Choice], Sure]:
    """Return the boundary and the fixed-interface modes of a component mode synthesis."""
    choices, sure = choose_masters(method, model, bare, jointed)
    requested = wanted_modes(method.modes, method.interest, None)
    complete = list(choices)
    for masters in {choice.masters for choice in choices}:
        slaves = np.setdiff1d(np.arange(model.size), masters)
        numbers, certain = _numbers_of(requested, jointed.block(slaves))
        # Modes that are asked for below a frequency must exist; those of the band may be none.
        exist = np.array([len(kept) > 0 or requested == ModeRange(count=0) for kept in numbers])
        certain &= exist | (method.modes is None)
        for s, choice in enumerate(choices):
            if choice.masters == masters:
                complete[s], sure[s] = Choice(masters, numbers[s]), sure[s] and certain[s]
    return complete, sure


def choose_modes(method: ModalTruncation | JointAware, _: Stack, jointed: Stack) -> tuple[list[Choice], Sure]:
    """Return the modes of a method without masters."""
    numbers, sure = _numbers_of(wanted_modes(method.modes, method.interest, None), jointed)
    return [Choice((), kept) for kept in numbers], sure & np.array([len(kept) > 0 for kept in numbers])
