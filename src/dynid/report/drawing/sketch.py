"""Sketches, which are laid out and drawn: nodes with lines of text, bonds with strokes, boxes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from dynid.number_format import counted
from dynid.report.svg import SIZE, SMALL, TITLE, Point, text_width

#: Padding around the text of a node, and the least distance of neighbouring bonds at a node, px.
PAD_X, PAD_Y, PORT = 8.0, 5.0, 22.0
#: Distances from the node, px: start of a bond, its stroke, the tip of its arrow beyond a stroke.
START, STROKE, BEYOND = 2.0, 4.0, 8.0
#: Half a stroke's length; length and width of the half arrow, px.
HALF, BARB, WING = 8.0, 11.0, 7.0

#: Colour of each physical domain, one of `svg.SERIES`.
COLOUR = {
    "mechanical": "s1",
    "electrical": "s2",
    "hydraulic": "s3",
    "acoustic": "s4",
    "thermal": "s5",
    "rotational": "s6",
    "magnetic": "s7",
}
#: SI units of inertia, compliance and resistance (thermal: temperature and heat flow, a pseudo bond graph).
ELEMENT_UNITS = {
    "mechanical": {"I": "kg", "C": "m/N", "R": "N·s/m"},
    "rotational": {"I": "kg·m²", "C": "rad/(N·m)", "R": "N·m·s/rad"},
    "electrical": {"I": "H", "C": "F", "R": "Ω"},
    "magnetic": {"C": "H", "R": "1/Ω"},
    "hydraulic": {"I": "kg/m⁴", "C": "m³/Pa", "R": "Pa·s/m³"},
    "acoustic": {"I": "kg/m⁴", "C": "m³/Pa", "R": "Pa·s/m³"},
    "thermal": {"C": "J/K", "R": "K/W"},
}

_SIZES = {"glyph": TITLE, "label": SIZE, "note": SMALL}
_LEADING = 1.35

Segment = tuple[Point, Point]


@dataclass(frozen=True)
class TextLine:
    """A line of text in a node: `glyph` (the 0 or 1 of a junction), `label` or `note`."""

    text: str
    role: str = "label"

    @property
    def size(self) -> float:
        """Font size, px."""
        return _SIZES[self.role]

    @property
    def width(self) -> float:
        """Width, px."""
        return text_width(self.text, self.size, bold=self.role != "note")

    @property
    def height(self) -> float:
        """Height, px."""
        return self.size * _LEADING


@dataclass(frozen=True)
class SketchNode:
    """A node of a drawing with its lines of text; the physical domain gives the colour.

    Its role (`input`, `output`, `both`) outlines it, a change highlights it; `opens` is the figure of its
    inside, to which it leads.
    """

    key: str
    lines: tuple[TextLine, ...]
    domain: str = ""
    role: str = ""
    changed: bool = False
    opens: str = ""

    @property
    def width(self) -> float:
        """Least width of its box, px."""
        return max(max((line.width for line in self.lines), default=0) + 2 * PAD_X, 24)

    @property
    def height(self) -> float:
        """Least height of its box, px."""
        return sum(line.height for line in self.lines) + 2 * PAD_Y


@dataclass(frozen=True)
class SketchBond:
    """A bond of a drawing with power positive from tail to head, and its stroke at `tail`, `head` or neither.

    A coupling that only the equations define is dashed and has no arrow; a signal (an activated bond), which
    takes no power, is dashed, with a full arrow.
    """

    tail: str
    head: str
    stroke: str = ""
    domain: str = ""
    changed: bool = False
    equation_only: bool = False
    signal: bool = False

    @property
    def dashed(self) -> bool:
        """True if it is no bond with power."""
        return self.equation_only or self.signal

    def stroke_on(self, route: Sequence[Point]) -> Segment | None:
        """Return the causal stroke, across the end of a route from tail to head; None without causality."""
        if not self.stroke:
            return None
        end, inner = (route[-1], route[-2]) if self.stroke == "head" else (route[0], route[1])
        x, y = _towards(end, inner, STROKE)
        across = (0.0, HALF) if end[1] == inner[1] else (HALF, 0.0)
        return (x - across[0], y - across[1]), (x + across[0], y + across[1])

    def arrow_on(self, route: Sequence[Point]) -> list[Point]:
        """Return the arrow at the head of a route: its tip and right barb, of a signal also the left one.

        Empty for a coupling without an arrow.
        """
        if self.equation_only:
            return []
        (x0, y0), end = route[-2], route[-1]
        tip = _towards(end, route[-2], self._tip)
        x, y = _towards(end, route[-2], self._tip + BARB)
        dx, dy = end[0] - x0, end[1] - y0
        right = ((dy < 0) - (dy > 0), (dx > 0) - (dx < 0))
        barbs = [(x + side * right[0], y + side * right[1]) for side in (WING, -WING)]
        return [barbs[1], tip, barbs[0]] if self.signal else [tip, barbs[0]]

    def line_on(self, route: Sequence[Point]) -> list[Point]:
        """Return the points of the line: clear of the nodes, ending at the tip of the arrow."""
        end = _towards(route[-1], route[-2], self._tip)
        return [_towards(route[0], route[1], START), *route[1:-1], end]

    @property
    def _tip(self) -> float:
        return BEYOND if self.stroke == "head" else START


@dataclass(frozen=True)
class Sketch:
    """A graph to lay out and draw.

    The source is placed as far to the left, the target as far to the right as possible; `cut` is the bond of
    a source-load decomposition, from the source side to the load side.
    """

    nodes: tuple[SketchNode, ...]
    bonds: tuple[SketchBond, ...]
    source: str | None = None
    target: str | None = None
    cut: tuple[str, str] | None = None

    def without(self, keys: set[str]) -> Sketch:
        """Return the sketch without some nodes and their bonds."""
        return replace(
            self,
            nodes=tuple(node for node in self.nodes if node.key not in keys),
            bonds=tuple(bond for bond in self.bonds if bond.tail not in keys and bond.head not in keys),
        )


def _towards(start: Point, end: Point, distance: float) -> Point:
    """Return the point at a distance from the start of a horizontal or vertical segment."""
    length = max(abs(end[0] - start[0]) + abs(end[1] - start[1]), 1e-9)
    along = distance / length
    return start[0] + along * (end[0] - start[0]), start[1] + along * (end[1] - start[1])


def instances(names: Iterable[str]) -> Iterator[str]:
    """Yield the instances of a graph as the beginning of their nodes' names, each after the one around it.

    Of the copies `line.1`, `line.2` … only the first is yielded: they are alike.
    """
    prefixes = dict.fromkeys(
        ".".join(parts[:level])
        for parts in (name.split(".") for name in names)
        for level in range(1, len(parts))
    )
    for name in sorted(prefixes, key=lambda path: path.split(".")):
        if all(number == "1" for number in name.split(".") if number.isdecimal()):
            yield name


def folded(sketch: Sketch, within: str = "") -> Sketch:
    """Return a drawing of one level of a graph: what lies deeper, or in other instances, is in boxes.

    `within` is the instance whose inside is shown with its neighbours; empty: the outermost level.
    """
    above = within.split(".") if within else []
    places = {node.key: _shown(node.key.split("."), above) for node in sketch.nodes}
    bonds = tuple(
        replace(bond, tail=places[bond.tail], head=places[bond.head])
        for bond in sketch.bonds
        if places[bond.tail] != places[bond.head]
    )
    inside = {box for box in places.values() if not within or box.startswith(f"{within}.")}
    shown = inside.union(
        *({bond.tail, bond.head} for bond in bonds if bond.tail in inside or bond.head in inside)
    )
    sizes = Counter(places.values())
    nodes: dict[str, SketchNode] = {}
    for node in sketch.nodes:
        box = places[node.key]
        if box not in shown:
            continue
        roles = {node.role, nodes[box].role if box in nodes else ""} - {""}
        role = "both" if len(roles) > 1 else "".join(roles)
        if box == node.key:
            nodes[box] = node
        else:
            text = counted(sizes[box], "node")
            nodes[box] = SketchNode(
                box, (TextLine(box), TextLine(text, "note")), "", role, opens=f"inside-{box}"
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
    pairs = enumerate(zip(name, above, strict=False))
    common = next((k for k, (part, part_above) in pairs if part != part_above), len(above))
    return ".".join(name[: common + 1])
