"""The trees that hang on a node, drawn level by level away from it, as narrow as their outlines allow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dynid.report.drawing.sketch import PORT

#: Straight length of a bond at a node, for its stroke and arrow; least distance of boxes; px.
RUN, GAP = 26.0, 16.0

Size = Callable[[str], tuple[float, float]]


@dataclass
class Forest:
    """Trees side by side over one node, which is at x = 0.

    Parameters
    ----------
    x
        The place of every node across.
    levels
        The nodes at every level, from left to right.
    parent
        What a node hangs on.
    """

    x: dict[str, float] = field(default_factory=dict)
    levels: list[list[str]] = field(default_factory=list)
    parent: dict[str, str] = field(default_factory=dict)


def grow(root: str, trees: list[str], children: Mapping[str, list[str]], size: Size) -> Forest:
    """Lay out trees over a node.

    Parameters
    ----------
    root
        The node that they hang on.
    trees
        Their first nodes, from left to right.
    children
        What hangs on every node.
    size
        Width and height of a node.
    """
    forest = Forest()
    order: list[tuple[str, int]] = []
    stack = [(name, root, 0) for name in reversed(trees)]
    while stack:
        name, parent, level = stack.pop()
        forest.parent[name] = parent
        if level == len(forest.levels):
            forest.levels.append([])
        forest.levels[level].append(name)
        order.append((name, level))
        stack += [(child, name, level + 1) for child in reversed(middled(children[name], children))]
    outlines: dict[
        str, list[tuple[float, float]]
    ] = {}  # left and right of a subtree, by level, from its root
    offsets: dict[str, dict[str, float]] = {}
    for name, _ in reversed(order):
        offsets[name], below = _beside(middled(children[name], children), outlines)
        half = size(name)[0] / 2
        outlines[name] = [(-half, half), *below]
    offsets[root], _ = _beside(trees, outlines)
    forest.x[root] = 0.0
    for name, _ in order:
        parent = forest.parent[name]
        forest.x[name] = forest.x[parent] + offsets[parent][name]
    return forest


def middled(names: list[str], children: Mapping[str, list[str]]) -> list[str]:
    """Order siblings so that the deepest tree is in the middle."""
    if len(names) < 3:
        return names
    by_depth = sorted(names, key=lambda name: depth(name, children))
    return [*by_depth[0::2], *by_depth[1::2][::-1]]


def depth(name: str, children: Mapping[str, list[str]]) -> int:
    """Count the levels of a tree."""
    level, count = [name], 0
    while level:
        level = [child for parent in level for child in children[parent]]
        count += 1
    return count


def _beside(
    names: list[str], outlines: Mapping[str, list[tuple[float, float]]]
) -> tuple[dict[str, float], list[tuple[float, float]]]:
    """Put subtrees side by side, centred; return their offsets and their common outline."""
    if not names:
        return {}, []
    places: list[float] = []
    joint: list[tuple[float, float]] = []
    for name in names:
        own = outlines[name]
        least = places[-1] + PORT if places else 0.0
        shift = max([least, *(right + GAP - left for (_, right), (left, _) in zip(joint, own, strict=False))])
        shift = shift if places else 0.0
        places.append(shift)
        moved = [(left + shift, right + shift) for left, right in own]
        shared = [(a[0], b[1]) for a, b in zip(joint, moved, strict=False)]
        joint = [*shared, *joint[len(shared) :], *moved[len(shared) :]]
    centre = places[len(places) // 2] if len(places) % 2 else (places[0] + places[-1]) / 2
    offsets = {name: place - centre for name, place in zip(names, places, strict=True)}
    return offsets, [(left - centre, right - centre) for left, right in joint]
