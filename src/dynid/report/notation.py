"""Notation in figures: numbers, units and labels, and LaTeX formulas typeset as SVG text.

Only the LaTeX of `bondgraph.reduction.writing.Latex` is parsed; anything else is shown as plain text.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dynid.number_format import sentence, unit_text
from dynid.report.svg import TITLE, Svg, number, plain, text_width
from dynid.result import Result, Scalar
from dynid.units import FrequencyUnit

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Separator of thousands.
_THIN = "\N{NARROW NO-BREAK SPACE}"


def raised(power: int) -> str:
    """Return an integer as superscript digits."""
    return str(power).translate(_RAISED)


def unit(text: str) -> str:
    """Return units in mathematical notation: `N.s/m` is N·s/m, `m/s2` is m/s²."""
    return "1" if text == "1" else unit_text(text)


def labelled(name: str, units: str = "") -> str:
    """Return the label of an axis or a column: its name with its units, if there are any (`1` is none)."""
    return f"{name} ({unit(units)})" if units not in ("", "1") else name


def frequency_label(unit: FrequencyUnit) -> str:
    """Return the label of an axis of frequencies."""
    return f"{'frequency' if unit.name == 'Hz' else 'angular frequency'} ({unit.name})"


def approximation(attrs: Mapping[str, Scalar]) -> str:
    """Return the sentence of a caption on the delays of an array or group, after a space; empty if exact."""
    text = str(attrs.get("approximate", ""))
    return f" {sentence(text)}" if text else ""


def in_decibels(name: str, units: str = "") -> str:
    """Return the label of an axis in dB, with the reference unit of 0 dB where it is known."""
    reference = {"": "dB, of SI units", "1": "dB"}.get(units, f"dB re {unit(units)}")
    return f"{name} ({reference})"


def with_infinity(remark: str) -> str:
    """Return a remark on infinite numbers with their sign, as tables of pages have it."""
    return remark.replace("inf: ", "∞: ")


def short(value: float, digits: int = 4) -> str:
    """Return a number with a few significant digits: 20 000, 0.0137, 10⁻⁸.

    Powers of ten are used from 10⁶ on and below 10⁻³; thousands are separated.
    """
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    if not power:  # infinite or unknown
        return {"inf": "∞", "-inf": "−∞", "nan": "—"}.get(mantissa, mantissa)
    if value and not -3 <= int(power) < 6:
        mantissa = mantissa.rstrip("0").rstrip(".")
        times = {"1": "", "-1": "−"}.get(mantissa, f"{mantissa}·")
        return f"{times}10{raised(int(power))}".replace("-", "−")
    text = f"{float(f'{value:.{digits}g}'):.12g}"
    integer, dot, rest = text.partition(".")
    sign, figures = ("−", integer[1:]) if integer.startswith("-") else ("", integer)
    if len(figures) > 4:
        figures = f"{int(figures):,}".replace(",", _THIN)
    return f"{sign}{figures}{dot}{rest}"


def texts(result: Result, path: str) -> list[str]:
    """Return an array of texts of a result; empty where there is none."""
    return list(map(str, result[path].data)) if path in result else []


def labels_with_units(result: Result, group: str, axis: str, count: int = 0, units: str = "") -> list[str]:
    """Return the labels of an axis, each with its units: those of `unit` in the group, or the given ones."""
    names = texts(result, f"{group}/{axis}") or [str(index + 1) for index in range(count)]
    unit_names = texts(result, f"{group}/unit") or [units] * len(names)
    return [labelled(name, unit) for name, unit in zip(names, unit_names, strict=True)]


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
class _TextRun:
    """A run of text within a formula: its font size (px), and its origin from the formula's left baseline."""

    text: str
    size: float
    italic: bool
    x: float
    y: float

    @property
    def width(self) -> float:
        """Width, px; serif fonts are narrower than the upper bound."""
        return text_width(self.text, self.size) * 0.92


@dataclass(frozen=True)
class TypesetFormula:
    """A typeset formula: runs of text, and the bars of fractions and roots as (x, y, width).

    Its extent is in px: `width` from its left end, `above` and `below` its baseline.
    """

    pieces: tuple[_TextRun, ...] = ()
    bars: tuple[tuple[float, float, float], ...] = ()
    width: float = 0.0
    above: float = 0.0
    below: float = 0.0

    @property
    def height(self) -> float:
        """Height, px."""
        return self.above + self.below

    def moved(self, x: float, y: float) -> TypesetFormula:
        """Return it moved by x and y; its extent remains relative to the old baseline."""
        pieces = tuple(_TextRun(p.text, p.size, p.italic, p.x + x, p.y + y) for p in self.pieces)
        bars = tuple((a + x, b + y, width) for a, b, width in self.bars)
        return TypesetFormula(
            pieces, bars, self.width + x, max(self.above - y, 0.0), max(self.below + y, 0.0)
        )

    def then(self, formula: TypesetFormula) -> TypesetFormula:
        """Return it with another formula appended."""
        appended = formula.moved(self.width, 0)
        pieces, bars = self.pieces + appended.pieces, self.bars + appended.bars
        above, below = max(self.above, formula.above), max(self.below, formula.below)
        return TypesetFormula(pieces, bars, self.width + formula.width, above, below)


def typeset(latex: str, size: float = TITLE) -> TypesetFormula:
    """Typeset LaTeX of a reduction, in mathematical mode, at a font size (px)."""
    return _Typesetter(latex).row(size)


def draw_formula(svg: Svg, formula: TypesetFormula, x: float, y: float) -> None:
    """Draw a formula with the left end of its baseline at a point."""
    for piece in formula.pieces:
        styles = "math it" if piece.italic else "math"
        options: dict[str, str | float] = {"textLength": piece.width, "lengthAdjust": "spacingAndGlyphs"}
        style = f"font-size: {number(piece.size)}px"
        svg.element("text", styles, plain(piece.text), x=x + piece.x, y=y + piece.y, style=style, **options)
    for left, height, width in formula.bars:
        svg.line((x + left, y + height), (x + left + width, y + height), cls="line")


class _Typesetter:
    """Parser that typesets a formula from left to right."""

    def __init__(self, latex: str) -> None:
        self.tokens = _TOKEN.findall(latex)
        self.at = 0

    def row(self, size: float, end: str = "") -> TypesetFormula:
        """Typeset everything up to a token."""
        formula = TypesetFormula(above=0.75 * size, below=0.22 * size)
        while self.at < len(self.tokens):
            token = self._next()
            if token == end:
                break
            if token in "^_":
                below = token == "_"
                index = self._argument(size * _SMALLER)
                formula = formula.then(index.moved(0, size * (_LOWER if below else -_RAISE)))
            else:
                formula = formula.then(self._atom(token, size))
        return formula

    def _next(self) -> str:
        token: str = self.tokens[self.at]
        self.at += 1
        return token

    def _argument(self, size: float) -> TypesetFormula:
        if self.at >= len(self.tokens):
            return TypesetFormula()
        token = self._next()
        return self.row(size, "}") if token == "{" else self._atom(token, size)

    def _atom(self, token: str, size: float) -> TypesetFormula:
        name = token[1:] if token.startswith("\\") and len(token) > 1 else ""
        if token == "{":
            return self.row(size, "}")
        if name == "frac":
            return _fraction(self._argument(size * 0.9), self._argument(size * 0.9), size)
        if name == "sqrt":
            under = self._argument(size)
            sign = _text("√", size, italic=False)
            bar = (sign.width, -under.above - 1, under.width)
            return TypesetFormula(bars=(bar,)).then(sign).then(under)
        if name == "mathrm":
            return _text("".join(self._upright()), size, italic=False)
        if name in _FUNCTIONS:
            return _text(f"{name}\u2009", size, italic=False)
        if name:
            text = _SIGNS[name] if name in _SIGNS else _greek(name)
            return _text(text, size, italic=len(text) == 1 and text.isalpha() and text.islower())
        if token.isspace():
            return TypesetFormula()
        if token in "+-=":
            return _text(f"\u2005{token.replace('-', '−')}\u2005", size, italic=False)
        return _text(token, size, italic=token.isalpha())

    def _upright(self) -> Iterator[str]:
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


def _text(text: str, size: float, *, italic: bool) -> TypesetFormula:
    if not text:
        return TypesetFormula()
    piece = _TextRun(text, size, italic, 0.0, 0.0)
    return TypesetFormula((piece,), (), piece.width, 0.75 * size, 0.22 * size)


def _fraction(top: TypesetFormula, bottom: TypesetFormula, size: float) -> TypesetFormula:
    """Typeset one formula over another, centred on the axis of the line."""
    width, axis, gap = max(top.width, bottom.width) + 4, -_BAR * size, 0.22 * size
    over = top.moved((width - top.width) / 2, axis - gap - top.below)
    under = bottom.moved((width - bottom.width) / 2, axis + gap + bottom.above)
    return TypesetFormula(
        over.pieces + under.pieces,
        (*over.bars, *under.bars, (1.0, axis, width - 2)),
        width + 2,
        top.height + gap - axis,
        bottom.height + gap + axis,
    )
