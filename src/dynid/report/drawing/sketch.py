"""What is to be laid out: nodes with lines of text, bonds between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dynid.report.metrics import text_width
from dynid.report.style import SIZE, SMALL, TITLE

#: Room around the text of a node, and the least distance of neighbouring bonds at a node, px.
PAD_X, PAD_Y, PORT = 8.0, 5.0, 22.0

_SIZES = {"glyph": TITLE, "label": SIZE, "note": SMALL}
_LEADING = 1.35


@dataclass(frozen=True)
class Line:
    """A line of text in a node.

    Parameters
    ----------
    text
        The text.
    role
        glyph (a junction's 0 or 1), label, or note.
    """

    text: str
    role: str = "label"

    @property
    def size(self) -> float:
        """The font size, px."""
        return _SIZES[self.role]

    @property
    def width(self) -> float:
        """The width, px."""
        return text_width(self.text, self.size, bold=self.role != "note")

    @property
    def height(self) -> float:
        """The height, px."""
        return self.size * _LEADING


@dataclass(frozen=True)
class Vertex:
    """A node of a drawing.

    Parameters
    ----------
    key
        Unique in the drawing.
    lines
        Its text, from top to bottom.
    domain
        The physical domain whose colour it has; empty: none.
    role
        `input`, `output`, `both` or nothing: how it is marked.
    changed
        Whether it is highlighted.
    """

    key: str
    lines: tuple[Line, ...]
    domain: str = ""
    role: str = ""
    changed: bool = False

    @property
    def width(self) -> float:
        """The least width of its box, px."""
        return max(max((line.width for line in self.lines), default=0) + 2 * PAD_X, 24)

    @property
    def height(self) -> float:
        """The least height of its box, px."""
        return sum(line.height for line in self.lines) + 2 * PAD_Y


@dataclass(frozen=True)
class Link:
    """A bond of a drawing.

    Parameters
    ----------
    tail, head
        Keys of the nodes; power is positive from tail to head.
    stroke
        The end of the causal stroke: `tail`, `head`, or nothing.
    domain
        As of a node.
    changed
        Whether it is highlighted.
    equation_only
        Whether it is no bond, but a coupling that only equations show: dashed and without an arrow.
    """

    tail: str
    head: str
    stroke: str = ""
    domain: str = ""
    changed: bool = False
    equation_only: bool = False


@dataclass(frozen=True)
class Sketch:
    """A graph to be laid out.

    Parameters
    ----------
    vertices
        The nodes.
    links
        The bonds.
    source, target
        Nodes that are drawn as far to the left and to the right as may be, if any.
    cut
        The bond of a source-load decomposition, as (tail, head) from the source side to the load side.
    """

    vertices: tuple[Vertex, ...]
    links: tuple[Link, ...]
    source: str | None = None
    target: str | None = None
    cut: tuple[str, str] | None = None

    def without(self, keys: set[str]) -> Sketch:
        """Return the sketch without some nodes and their bonds."""
        return replace(
            self,
            vertices=tuple(v for v in self.vertices if v.key not in keys),
            links=tuple(b for b in self.links if b.tail not in keys and b.head not in keys),
        )
