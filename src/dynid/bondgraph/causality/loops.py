"""Algebraic loops: signals that depend on themselves without an integration in between.

With strokes on the bonds every effort and flow has one origin. Cut at the storages, the dependences form
a directed graph; its strongly connected parts are the loops.
"""

from __future__ import annotations

from collections.abc import Iterator

from dynid.bondgraph.causality.report import Remark
from dynid.bondgraph.causality.strokes import Strokes
from dynid.bondgraph.causality.wording import listed, titled

_EFFORT, _FLOW = 0, 1


def algebraic_loops(strokes: Strokes) -> tuple[Remark, ...]:
    """Name every algebraic loop of a graph with all strokes put."""
    import numpy as np
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    edges = list(_dependences(strokes))
    if not edges:
        return ()
    count = 2 * len(strokes.bonds)
    ends = np.array(edges).T
    graph = csr_array((np.ones(len(edges), dtype=np.int8), (ends[0], ends[1])), shape=(count, count))
    _, label = connected_components(graph, directed=True, connection="strong")
    members: dict[int, list[int]] = {}
    for signal in range(count):
        members.setdefault(int(label[signal]), []).append(signal)
    loops: dict[tuple[int, ...], int] = {}  # efforts and flows may run round the same bonds apart
    for signals in members.values():
        bonds = tuple(dict.fromkeys(signal // 2 for signal in signals))
        if len(signals) > 1:
            free = sum(strokes.how[bond] == "free" for bond in bonds)
            loops[bonds] = loops.get(bonds, 0) + max(1, free)
    return tuple(_remark(strokes, bonds, count) for bonds, count in loops.items())


def _dependences(strokes: Strokes) -> Iterator[tuple[int, int]]:
    """Yield (signal, signal that depends on it); bond k has effort 2k and flow 2k + 1."""
    for node, kind in strokes.kinds.items():
        bonds = strokes.bonds_at[node]
        effort_in = {bond: strokes.at_head[bond] is strokes.towards(node, bond) for bond in bonds}
        match kind:
            case "0" | "1":
                common, balance = (_EFFORT, _FLOW) if kind == "0" else (_FLOW, _EFFORT)
                setter = strokes.setter[node]
                for bond in bonds:
                    if setter is not None and bond != setter:
                        yield 2 * setter + common, 2 * bond + common
                        yield 2 * bond + balance, 2 * setter + balance
            case "R":
                (bond,) = bonds
                signals = 2 * bond + _EFFORT, 2 * bond + _FLOW
                yield signals if effort_in[bond] else signals[::-1]
            case "TF" | "GY":
                for one, two in (bonds, bonds[::-1]):
                    given = _EFFORT if effort_in[one] else _FLOW
                    yield 2 * one + given, 2 * two + (given if kind == "TF" else 1 - given)


def _remark(strokes: Strokes, bonds: tuple[int, ...], count: int) -> Remark:
    nodes = dict.fromkeys(end for bond in bonds for end in strokes.bonds[bond])
    resistances = [name for name in nodes if strokes.kinds[name] == "R"]
    inner = [name for name in nodes if strokes.kinds[name] in ("0", "1", "TF", "GY")]
    solved = "one linear equation has" if count == 1 else f"{count} linear equations have"
    through = f" through {listed(inner)}" if inner else ""
    if not resistances:
        meaning = (
            f"what goes into {listed(inner)} comes back upon itself with no element in between: {solved} to "
            "be solved, which fails where the gain once round is 1"
        )
    elif len(resistances) == 1:
        meaning = (
            f"{titled(strokes.kinds, resistances)} depends on itself{through}: {solved} to be solved at once"
        )
    else:
        depend = "each depend on the other" if len(resistances) == 2 else "depend on each other"
        meaning = f"{titled(strokes.kinds, resistances)} {depend}{through}: {solved} to be solved at once"
    return Remark((*resistances, *inner), meaning, count)
