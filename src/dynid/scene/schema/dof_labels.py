"""Labels of the free degrees of freedom of beams and frames, node by node."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set

#: A degree of freedom: its direction and its node.
Freedom = tuple[str, int]


def beam_labels(elements: int, fixed: Iterable[Freedom]) -> list[int | str]:
    """Return the labels of the free degrees of freedom of a beam.

    Parameters
    ----------
    elements
        The number of its elements, in a row.
    fixed
        The degrees of freedom that its supports fix.
    """
    return _free(elements + 1, ("w", "theta"), set(fixed))


def frame_labels(
    nodes: int,
    members: Iterable[tuple[Sequence[int], Sequence[int], int]],
    fixed: Iterable[Freedom],
    turning: Iterable[int],
) -> list[int | str]:
    """Return the labels of the free degrees of freedom of a frame, those at nodes within members last.

    Parameters
    ----------
    nodes
        The number of given nodes.
    members
        Of each: its two nodes, which ends are hinged (1, 2), and its number of elements.
    fixed
        The degrees of freedom that the supports fix.
    turning
        The nodes with a rotary inertia or a rotational spring, which rotate even between hinges.
    """
    carried, inner = set(turning), 0
    for ends, hinges, elements in members:
        carried |= {node for end, node in enumerate(ends, 1) if end not in hinges}
        inner += elements - 1
    held = set(fixed) | {("theta", node) for node in range(1, nodes + 1) if node not in carried}
    return _free(nodes + inner, ("u", "w", "theta"), held)


def _free(nodes: int, directions: Sequence[str], fixed: Set[Freedom]) -> list[int | str]:
    return [f"{d}_{node}" for node in range(1, nodes + 1) for d in directions if (d, node) not in fixed]
