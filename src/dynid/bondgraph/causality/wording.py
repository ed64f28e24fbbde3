"""Causality in words: what storages follow, and which rules contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from dynid.bondgraph.causality.report import Remark
from dynid.bondgraph.causality.strokes import Contradiction, Strokes
from dynid.bondgraph.graph import JUNCTIONS, SOURCES, STORAGES, TWO_PORTS

#: Most nodes that a sentence lists.
_MOST = 6


def listed(names: Sequence[str]) -> str:
    """Write names as a reader would: a, b and c."""
    if len(names) > _MOST:
        return f"{', '.join(names[:_MOST])} and {len(names) - _MOST} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def titled(kinds: Mapping[str, str], names: Iterable[str]) -> str:
    """Write nodes with their types: I m1 and C k."""
    return listed(
        [
            f"{kinds[name]}-junction {name}" if kinds[name] in JUNCTIONS else f"{kinds[name]} {name}"
            for name in names
        ]
    )


def explain_dependent(strokes: Strokes, name: str) -> Remark:
    """Say what a storage in derivative causality follows."""
    (bond,) = strokes.bonds_at[name]
    roots, inner = strokes.roots([bond])
    owners = [owner for owner in _owners(strokes, roots) if owner != name]
    quantity = "momentum" if strokes.kinds[name] == "I" else "displacement"
    subject = f"{strokes.kinds[name]} {name}"
    two_ports = [node for node in inner if strokes.kinds[node] in TWO_PORTS]
    through = f" through {titled(strokes.kinds, two_ports or inner)}" if inner else ""
    sources = [owner for owner in owners if strokes.kinds[owner] in SOURCES]
    storages = [owner for owner in owners if strokes.kinds[owner] in STORAGES]
    if storages:
        alike = {strokes.kinds[owner] for owner in (name, *storages)}
        rigidly = "rigidly " if alike == {"I"} else ""
        meaning = (
            f"{subject} is {rigidly}tied to {titled(strokes.kinds, [*storages, *sources])}{through}: "
            f"its {quantity} is not a state of its own"
        )
    elif sources:
        meaning = (
            f"{subject} is driven by {titled(strokes.kinds, sources)} with nothing in between"
            f"{through if two_ports else ''}: its {quantity} follows the source"
        )
    else:
        meaning = f"{subject} is held by the junctions around it{through}: its {quantity} is no state"
    return Remark((name, *storages, *sources, *(two_ports or inner)), meaning)


def explain_conflict(strokes: Strokes, bond: int, problem: Contradiction) -> Remark:
    """Say which rules contradict each other, and where."""
    found = set(_owners(strokes, [bond, *problem.roots]))
    owners = [name for name in strokes.kinds if name in found]
    kind = strokes.kinds.get(problem.node, "")
    sources = len(owners) > 1 and all(strokes.kinds[owner] in SOURCES for owner in owners)
    who = titled(strokes.kinds, owners or problem.nodes)
    if kind in JUNCTIONS:
        common, others = ("effort", "flow") if kind == "0" else ("flow", "effort")
        where = titled(strokes.kinds, [problem.node])
        if problem.surplus:
            meaning = f"{who} {'both' if len(owners) == 2 else 'at once'} set the {common} of {where}"
        else:
            verb = "imposes" if len(owners) == 1 else "impose"
            meaning = f"nothing is left to set the {common} of {where}: {who} {verb} every {others} on it"
    else:
        meaning = f"{who} cannot both impose on the bond {' -> '.join(strokes.bonds[bond])}"
    if sources:
        meaning += "; ideal sources meet with no element between them to take up the difference"
    return Remark(tuple(dict.fromkeys([*owners, problem.node, *problem.nodes])), meaning)


def _owners(strokes: Strokes, bonds: Iterable[int]) -> list[str]:
    """Return the sources, storages and resistances at the ends of bonds."""
    one_ports = SOURCES | STORAGES | {"R"}
    ends = (end for bond in bonds for end in strokes.bonds[bond])
    return list(dict.fromkeys(end for end in ends if strokes.kinds[end] in one_ports))
