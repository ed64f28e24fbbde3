"""Time scales that lie far apart in a model, as a value in the wrong unit leaves them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from dynid.errors import DynidError
from dynid.number_format import general
from dynid.scene.explanation import Fact

if TYPE_CHECKING:
    from dynid.arrays import Array
    from dynid.bondgraph.reduced_graph import ReducedGraph
    from dynid.structure.model import StructuralModel

#: Poles or natural frequencies whose neighbours differ by more than this factor are of two time scales.
APART = 1e5
# Larger models are left out: state equations are derived for each element, matrices are dense.
_MAX_STORAGES, _MAX_DOFS = 40, 300
# An element sets a group of poles if a factor of two in its value moves their mean logarithm by this.
_SETS = 0.1
# A DOF moves in a mode if it has this part of the kinetic energy.
_MOVES = 0.1


def graph_time_scales(reduced: ReducedGraph) -> list[Fact]:
    """Return a warning with the elements that set poles far from the others; none where there are none."""
    from dynid.bondgraph.graph_state_space import state_space

    def rates(plan: ReducedGraph) -> Array:
        return np.sort(np.abs(np.linalg.eigvals(state_space(plan).A)))

    def names(group: slice) -> list[str]:
        before = np.log(rates(reduced)[group])
        moved = {
            name: np.mean(np.log(rates(reduced.with_values({name: 2 * value}))[group]) - before)
            for name, value in reduced.exact.items()
        }
        return [
            f"{name} = {general(float(reduced.exact[name]))}" for name in moved if abs(moved[name]) > _SETS
        ]

    if len(reduced.storages) > _MAX_STORAGES:
        return []
    return _warned("poles", lambda: rates(reduced), names)


def structure_time_scales(structure: StructuralModel, values: Mapping[str, float]) -> list[Fact]:
    """Return a warning with the DOFs of natural frequencies far from the others; none where there are none.

    `values`: those of the unknown parameters.
    """
    from scipy.linalg import eigh

    if structure.size > _MAX_DOFS:
        return []
    shapes = np.zeros((0, 0))

    def rates() -> Array:
        nonlocal shapes
        M, _, K = structure.dense(values)
        squares, shapes = eigh(K, M)
        shapes = shapes * (M @ shapes)
        return np.sqrt(np.abs(squares))

    def names(group: slice) -> list[str]:
        return [str(structure.dofs[k]) for k in np.flatnonzero(shapes[:, group].mean(axis=1) > _MOVES)]

    return _warned("natural frequencies", rates, names)


def _warned(what: str, rates: Callable[[], Array], names: Callable[[slice], list[str]]) -> list[Fact]:
    """Return the warning of the widest gap between rates, with what sets those of the smaller group."""
    try:
        omega = rates()
        first = int(
            np.searchsorted(omega, len(omega) * np.finfo(float).eps * omega.max(initial=0.0), "right")
        )
        steps = np.diff(np.log(omega[first:]))
        if not len(steps) or steps.max() < np.log(APART):
            return []
        gap = first + int(np.argmax(steps)) + 1
        groups = {"upper": slice(gap, len(omega)), "lower": slice(first, gap)}
        smaller = min(len(omega) - gap, gap - first)  # of groups of one size either may be meant
        causes = [
            f"the {which} ones are set by {', '.join(names(group))}"
            for which, group in groups.items()
            if group.stop - group.start == smaller
        ]
    except (DynidError, np.linalg.LinAlgError):  # the run says what is wrong
        return []
    low, high = (general(omega[k]) for k in (gap - 1, gap))
    text = (
        f"no {what} lie between {low} and {high} rad/s, a factor of {omega[gap] / omega[gap - 1]:.0e}; "
        f"{', '.join(causes)}: check the units of the values there"
    )
    return [Fact("warning", text)]
