"""Drawings of a graph of sub-models: each instance as a box, which opens the drawing of what is in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace

from dynid.number_format import counted
from dynid.report.drawing.sketch import Sketch, SketchNode, TextLine


def instances(names: Iterable[str]) -> Iterator[str]:
    """Yield the instances of a graph as the beginning of their nodes' names, each after the one around it.

    Of the copies `line.1`, `line.2` … only the first is yielded: they are alike.
    """
    found = dict.fromkeys(
        ".".join(parts[:level])
        for parts in (name.split(".") for name in names)
        for level in range(1, len(parts))
    )
    for name in sorted(found, key=lambda one: one.split(".")):
        if all(part == "1" for part in name.split(".") if part.isdecimal()):
            yield name


def folded(sketch: Sketch, within: str = "") -> Sketch:
    """Return a drawing of one level of a graph: what lies deeper, or in other instances, is in boxes.

    Parameters
    ----------
    sketch
        The whole graph.
    within
        The instance whose inside is shown with its neighbours; empty: the outermost level.
    """
    above = within.split(".") if within else []
    places = {node.key: _shown(node.key.split("."), above) for node in sketch.nodes}
    bonds = tuple(
        replace(bond, tail=places[bond.tail], head=places[bond.head])
        for bond in sketch.bonds
        if places[bond.tail] != places[bond.head]
    )
    own = {place for place in places.values() if _inside(place, within)}
    shown = own.union(*({bond.tail, bond.head} for bond in bonds if bond.tail in own or bond.head in own))
    sizes = Counter(places.values())
    nodes: dict[str, SketchNode] = {}
    for node in sketch.nodes:
        place = places[node.key]
        if place not in shown:
            continue
        role = node.role if place not in nodes else _both(nodes[place].role, node.role)
        if place == node.key:
            nodes[place] = node
        else:
            text = counted(sizes[place], "node")
            nodes[place] = SketchNode(
                place, (TextLine(place), TextLine(text, "note")), "", role, opens=f"inside-{place}"
            )
    source, target = (
        places[end] if end is not None and places[end] in shown else None
        for end in (sketch.source, sketch.target)
    )
    cut = None if sketch.cut is None else (places[sketch.cut[0]], places[sketch.cut[1]])
    if cut is not None and (cut[0] == cut[1] or not shown.issuperset(cut)):
        cut = None
    kept = tuple(bond for bond in bonds if {bond.tail, bond.head} <= shown)
    return Sketch(tuple(nodes.values()), kept, source, target, cut)


def _shown(name: list[str], above: list[str]) -> str:
    """Return the node or box that stands for a node: one part of its name below the place that is shown."""
    common = next(
        (k for k, (one, other) in enumerate(zip(name, above, strict=False)) if one != other), len(above)
    )
    return ".".join(name[: common + 1])


def _inside(name: str, within: str) -> bool:
    return not within or name.startswith(f"{within}.")


def _both(one: str, other: str) -> str:
    return one if not other or one == other else other if not one else "both"
