"""Formulas in figures: the LaTeX that the reduction writes, set as SVG text with fractions and indices.

Only what `bondgraph.reduction.writing.Latex` writes is understood; anything else is shown as it is written.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass

from dynid.report.metrics import text_width
from dynid.report.style import TITLE
from dynid.report.svg import Svg, number, plain

_TOKEN = re.compile(r"\\[a-zA-Z]+|\\.|[{}^_]|\s+|[\d.]+|.")
_SIGNS = {
    "cdot": "\u2009·\u2009",
    ",": "\u2009",
    "quad": "\u2003",
    ";": "\u2004",
    "_": "_",
    "left": "",
    "right": "",
}
_FUNCTIONS = {"ln", "sin", "cos", "tan", "min", "max"}
_SMALLER, _RAISE, _LOWER, _BAR = 0.72, 0.38, 0.2, 0.28


@dataclass(frozen=True)
class Piece:
    """A run of text within a formula.

    Parameters
    ----------
    text, size, italic
        What is written, how large, and whether in italics.
    x, y
        Where it begins, from the formula's beginning and its baseline.
    """

    text: str
    size: float
    italic: bool
    x: float
    y: float

    @property
    def width(self) -> float:
        """How wide it is, px: serif faces are narrower than what the estimate is of."""
        return text_width(self.text, self.size) * 0.92


@dataclass(frozen=True)
class Formula:
    """A set formula: texts, and the bars of fractions and roots as (x, y, width).

    Parameters
    ----------
    width, above, below
        Its extent, px: from its beginning, and from its baseline.
    """

    pieces: tuple[Piece, ...] = ()
    bars: tuple[tuple[float, float, float], ...] = ()
    width: float = 0.0
    above: float = 0.0
    below: float = 0.0

    @property
    def height(self) -> float:
        """Its height, px."""
        return self.above + self.below

    def moved(self, x: float, y: float) -> Formula:
        """Return it with its baseline elsewhere; its extent is from the old one."""
        pieces = tuple(Piece(p.text, p.size, p.italic, p.x + x, p.y + y) for p in self.pieces)
        bars = tuple((a + x, b + y, width) for a, b, width in self.bars)
        return Formula(pieces, bars, self.width + x, max(self.above - y, 0.0), max(self.below + y, 0.0))

    def then(self, other: Formula) -> Formula:
        """Return this with another one behind."""
        beside = other.moved(self.width, 0)
        return Formula(
            self.pieces + beside.pieces,
            self.bars + beside.bars,
            self.width + other.width,
            max(self.above, other.above),
            max(self.below, other.below),
        )


def typeset(latex: str, size: float = TITLE) -> Formula:
    """Set a formula.

    Parameters
    ----------
    latex
        As the reduction writes it, in mathematical mode.
    size
        Font size, px.
    """
    return _Setter(latex).row(size)


def draw_formula(svg: Svg, formula: Formula, x: float, y: float, cls: str = "") -> None:
    """Draw a set formula, its baseline beginning at a place."""
    for piece in formula.pieces:
        styles = " ".join(filter(None, ("math", "it" if piece.italic else "", cls)))
        svg.element(
            "text",
            styles,
            plain(piece.text),
            x=x + piece.x,
            y=y + piece.y,
            style=f"font-size: {number(piece.size)}px",
            textLength=piece.width,
            lengthAdjust="spacingAndGlyphs",
        )
    for left, height, width in formula.bars:
        svg.line((x + left, y + height), (x + left + width, y + height), cls="line")


class _Setter:
    """Reads a formula once from left to right."""

    def __init__(self, latex: str) -> None:
        self.tokens = _TOKEN.findall(latex)
        self.at = 0

    def row(self, size: float, end: str = "") -> Formula:
        """Set what follows up to a token."""
        found = Formula(above=0.75 * size, below=0.22 * size)
        while self.at < len(self.tokens):
            token = self._next()
            if token == end:
                break
            if token in "^_":
                below = token == "_"
                index = self._argument(size * _SMALLER)
                found = found.then(index.moved(0, size * (_LOWER if below else -_RAISE)))
            else:
                found = found.then(self._atom(token, size))
        return found

    def _next(self) -> str:
        token: str = self.tokens[self.at]
        self.at += 1
        return token

    def _argument(self, size: float) -> Formula:
        if self.at >= len(self.tokens):
            return Formula()
        token = self._next()
        return self.row(size, "}") if token == "{" else self._atom(token, size)

    def _atom(self, token: str, size: float) -> Formula:
        name = token[1:] if token.startswith("\\") and len(token) > 1 else ""
        if token == "{":
            return self.row(size, "}")
        if name == "frac":
            return _fraction(self._argument(size * 0.9), self._argument(size * 0.9), size)
        if name == "sqrt":
            under = self._argument(size)
            sign = _text("√", size, italic=False)
            bar = (sign.width, -under.above - 1, under.width)
            return Formula(bars=(bar,)).then(sign).then(under)
        if name == "mathrm":
            return _text("".join(self._plain()), size, italic=False)
        if name in _FUNCTIONS:
            return _text(f"{name}\u2009", size, italic=False)
        if name:
            text = _SIGNS.get(name, _greek(name))
            return _text(text, size, italic=len(text) == 1 and text.isalpha() and text.islower())
        if token.isspace():
            return Formula()
        if token in "+-=":
            return _text(f"\u2005{token.replace('-', '−')}\u2005", size, italic=False)
        return _text(token, size, italic=token.isalpha())

    def _plain(self) -> Iterator[str]:
        """Yield the upright text of a group."""
        if self.at < len(self.tokens) and self.tokens[self.at] == "{":
            self._next()
            depth = 1
            while self.at < len(self.tokens):
                token = self._next()
                depth += (token == "{") - (token == "}")
                if not depth:
                    return
                if token not in "{}":
                    yield token.removeprefix("\\") if len(token) == 2 else token


def _greek(name: str) -> str:
    size = "SMALL" if name.islower() else "CAPITAL"
    try:
        return unicodedata.lookup(f"GREEK {size} LETTER {name.upper().replace('LAMBDA', 'LAMDA')}")
    except KeyError:
        return name


def _text(text: str, size: float, *, italic: bool) -> Formula:
    if not text:
        return Formula()
    piece = Piece(text, size, italic, 0.0, 0.0)
    return Formula((piece,), (), piece.width, 0.75 * size, 0.22 * size)


def _fraction(top: Formula, bottom: Formula, size: float) -> Formula:
    """Set one formula over another, centred on the axis of the line."""
    width, axis, gap = max(top.width, bottom.width) + 4, -_BAR * size, 0.14 * size
    over = top.moved((width - top.width) / 2, axis - gap - top.below)
    under = bottom.moved((width - bottom.width) / 2, axis + gap + bottom.above)
    return Formula(
        over.pieces + under.pieces,
        (*over.bars, *under.bars, (1.0, axis, width - 2)),
        width + 2,
        top.height + gap - axis,
        bottom.height + gap + axis,
    )
