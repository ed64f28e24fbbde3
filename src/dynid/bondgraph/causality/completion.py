"""Whether strokes that are put can be completed: a perfect matching of junctions.

Every junction takes its common variable from exactly one bond. A bond between a 0 and a 1 sets both or
neither, so that the setting bonds pair up the junctions that no element sets: a perfect matching, which
exists exactly where the matrix D + S of random entries (D: junctions that an open element can set; S
skew-symmetric: open bonds between junctions) has a determinant (Tutte 1947). Only junctions on loops need
it: what hangs on them as a tree, and is still open, can be completed either way.
"""

from __future__ import annotations

import random

from dynid.bondgraph.causality.strokes import Strokes
from dynid.choices import LOOKING_AHEAD

_PRIME = (1 << 61) - 1


class Completion:
    """The loops of a graph, and whether strokes on them can be completed.

    Parameters
    ----------
    strokes
        Strokes on the graph.
    """

    def __init__(self, strokes: Strokes) -> None:
        self.loops = _junctions_on_loops(strokes)
        #: Whether there is anything to look at, and not too much of it.
        self.feasible = 0 < len(self.loops) <= LOOKING_AHEAD.value

    def possible(self, strokes: Strokes) -> bool:
        """Tell whether the open bonds can be given strokes that obey every rule."""
        from flint import nmod_mat

        links, alone = self._links(strokes)
        names = sorted({*(name for pair in links for name in pair), *alone, *self._unset(strokes)})
        place = {name: index for index, name in enumerate(names)}
        draw = random.Random(0x5CA9)
        matrix = nmod_mat(len(names), len(names), _PRIME)
        for name in sorted(alone):
            matrix[place[name], place[name]] = draw.randrange(1, _PRIME)
        for a, b in links:
            size = draw.randrange(1, _PRIME)
            matrix[place[a], place[b]] = matrix[place[a], place[b]] + size
            matrix[place[b], place[a]] = matrix[place[b], place[a]] - size
        return int(matrix.det()) != 0

    def _unset(self, strokes: Strokes) -> list[str]:
        return [name for name in self.loops if strokes.setter[name] is None]

    def _links(self, strokes: Strokes) -> tuple[list[tuple[str, str]], set[str]]:
        """Return the open links between unset junctions, and the junctions that something else can set.

        Two junctions of which a link sets exactly one are linked through a junction of its own.
        """
        links: list[tuple[str, str]] = []
        alone: set[str] = set()
        for name in self._unset(strokes):
            for bond in strokes.bonds_at[name]:
                if strokes.at_head[bond] is not None:
                    continue
                end, last, sets_both = _follow(strokes, name, bond)
                if end not in self.loops:
                    alone.add(name)
                elif bond < last or (bond == last and name < end):  # each link is met from both of its ends
                    if sets_both:
                        links += [(name, end)] if name != end else []
                    else:
                        links += [(name, f"\0{bond}"), (f"\0{bond}", end)]
        return links, alone


def _follow(strokes: Strokes, start: str, bond: int) -> tuple[str, int, bool]:
    """Follow a bond through TF and GY; return the end, the last bond, and whether it sets both ends."""
    at_head = strokes.setting(start, bond)
    node = strokes.other_end(bond, start)
    while strokes.kinds[node] in ("TF", "GY"):
        stroke_here = (at_head is strokes.towards(node, bond)) is (strokes.kinds[node] == "GY")
        bond = next(other for other in strokes.bonds_at[node] if other != bond)
        at_head = stroke_here is strokes.towards(node, bond)
        node = strokes.other_end(bond, node)
    return node, bond, node in strokes.setter and strokes.sets(node, bond, at_head)


def _junctions_on_loops(strokes: Strokes) -> dict[str, None]:
    """Return the junctions that are left when those with a single link to others are taken off in turn."""
    ends = {
        name: [_follow(strokes, name, bond)[0] for bond in strokes.bonds_at[name]] for name in strokes.setter
    }
    neighbours = {name: [end for end in found if end in strokes.setter] for name, found in ends.items()}
    degree = {name: len(found) for name, found in neighbours.items()}
    leaves = [name for name, count in degree.items() if count < 2]
    left = dict.fromkeys(strokes.setter)
    while leaves:
        leaf = leaves.pop()
        del left[leaf]
        for end in neighbours[leaf]:
            degree[end] -= 1
            if end in left and degree[end] == 1:
                leaves.append(end)
    return left
