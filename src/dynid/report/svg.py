"""SVG writer, and the style of all figures: colours, fonts, line widths, widths of texts.

Text stays text, numbers have one form, and equal figures are equal bytes.

Colours are CSS variables with the light value as fallback, so that a figure is right alone, within a page
and in dark mode; a page may force either theme by `data-theme` on its root element. The hues are those of
Okabe & Ito (2008), which colour-blind readers can distinguish, lightened for the dark theme.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable
from html import escape
from itertools import chain

Point = tuple[float, float]

_FONT = "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"
_MATH = "'STIX Two Math', 'Cambria Math', 'Times New Roman', 'DejaVu Serif', serif"

#: Font sizes, px.
TITLE, SIZE, SMALL = 14.0, 12.0, 10.0

#: Line widths, px: data and bonds, axes and strokes, grids.
BOLD, LINE, HAIR = 2.0, 1.2, 0.6

#: Colours by name: light, dark. Series use `s1` … `s7`, in this order.
COLOURS: dict[str, tuple[str, str]] = {
    "ink": ("#1c2024", "#e8eaec"),
    "muted": ("#5b6470", "#a3acb6"),
    "paper": ("#ffffff", "#15181c"),
    "grid": ("#d5d9de", "#3a4149"),
    "accent": ("#c2410c", "#ff9a5c"),
    "s1": ("#0072b2", "#4ba3e3"),
    "s2": ("#d55e00", "#ff8a47"),
    "s3": ("#009e73", "#2cc295"),
    "s4": ("#b2588f", "#e394c0"),
    "s5": ("#b8860b", "#f0b73a"),
    "s6": ("#2b93cf", "#8ccbf2"),
    "s7": ("#5f6670", "#b4bac2"),
}
#: Faces of surfaces, from those that face the light to those that lie along it.
FACES: dict[str, tuple[str, str]] = {
    "f1": ("#eef2f6", "#56616d"),
    "f2": ("#dfe6ed", "#4a545f"),
    "f3": ("#cfd8e1", "#3e4751"),
    "f4": ("#bfcad5", "#333b44"),
    "f5": ("#aebbc8", "#292f37"),
}
COLOURS |= FACES
SERIES = tuple(name for name in COLOURS if re.fullmatch(r"s\d", name))
#: Dashes of series, which distinguish them without colour.
_DASHES = ("none", "7 3", "2 3", "9 3 2 3", "5 2", "1 2", "12 4")


def colour(name: str) -> str:
    """Return a colour for an SVG style: a variable with the light value as fallback."""
    return f"var(--{name}, {COLOURS[name][0]})"


def css() -> str:
    """Return the style sheet of figures, the same within each of them."""
    light, dark = (
        f".fig {{ {'; '.join(f'--{name}: {both[place]}' for name, both in COLOURS.items())} }}"
        for place in (0, 1)
    )
    forced = "".join(
        f':root[data-theme="{name}"] {theme}\n' for name, theme in (("light", light), ("dark", dark))
    )
    ink, muted = colour("ink"), colour("muted")
    rules = {
        "text": f"font-family: {_FONT}; font-size: {SIZE:g}px; fill: {ink}; stroke: none",
        ".title": f"font-size: {TITLE:g}px; font-weight: 600",
        ".strong": "font-weight: 600",
        ".small": f"font-size: {SMALL:g}px",
        ".muted": f"fill: {muted}",
        ".math": f"font-family: {_MATH}; font-size: {TITLE:g}px",
        ".it": "font-style: italic",
        ".line": f"fill: none; stroke: {ink}; stroke-width: {LINE:g}",
        ".hair": f"fill: none; stroke: {muted}; stroke-width: {HAIR:g}",
        ".grid": f"fill: none; stroke: {colour('grid')}; stroke-width: {HAIR:g}",
        ".frame": f"fill: none; stroke: {muted}; stroke-width: {LINE:g}",
        ".dashed": "stroke-dasharray: 6 4",
        ".solid": f"fill: {ink}; stroke: none",
        ".paper": f"fill: {colour('paper')}; stroke: none",
        ".bond": f"fill: none; stroke: {ink}; stroke-width: {BOLD:g}; stroke-linejoin: round",
        ".node": f"fill: {muted}; fill-opacity: .1; stroke: none",
        ".mark": f"stroke: {colour('accent')}",
        ".marked": f"fill: {colour('accent')}",
    }
    for name, dash in zip(SERIES, _DASHES, strict=True):
        rules[f".{name}"] = f"fill: none; stroke: {colour(name)}; stroke-width: {BOLD:g}"
        rules[f".{name}.dash"] = f"stroke-dasharray: {dash}"
        rules[f".{name}.dot"] = f"fill: {colour(name)}; stroke: none"
        rules[f".{name}.band"] = f"fill: {colour(name)}; fill-opacity: .18; stroke: none"
        rules[f"text.{name}"] = f"fill: {colour(name)}; stroke: none"
    rules[".halo"] = f"paint-order: stroke; stroke: {colour('paper')}; stroke-width: 3px"
    for name in FACES:
        rules[f"path.{name}"] = f"fill: {colour(name)}; stroke-linejoin: round"
    rules["path.fine"] = f"stroke-width: {LINE:g}"
    rules[".hollow"] = f"fill: {colour('paper')}"
    rules[".tick"] = f"fill: {muted}"
    texts = "".join(f".fig {selector} {{ {body} }}\n" for selector, body in rules.items())
    return f"{light}\n@media (prefers-color-scheme: dark) {{ {dark} }}\n{forced}{texts}"


def resolved(svg: str, *, dark: bool = False) -> str:
    """Return a figure with the colours of one theme in place of CSS variables."""
    names = "|".join(COLOURS)  # animations have variables, too
    text = re.sub(rf"var\(--({names})(?:, [^)]*)?\)", lambda match: COLOURS[match[1]][dark], svg)
    start, end = text.find(".fig {"), text.find(".fig text {")
    return text[:start] + text[end:] if 0 <= start < end else text


# Advances of ASCII from the space on, in hundredths of the font size: those of DejaVu Sans, which is as wide
# as any system font, so that widths of texts are upper bounds for every reader.
_ADVANCES = (
    "32 40 46 84 64 95 78 27 39 39 50 84 32 36 32 34 64 64 64 64 64 64 64 64 64 64 34 34 84 84 84 53 "
    "100 68 69 70 77 63 58 77 75 29 29 66 56 86 75 79 60 79 69 63 61 73 68 99 69 61 69 39 34 39 84 50 "
    "50 61 63 55 63 62 35 63 63 28 28 58 28 97 63 61 63 63 41 52 39 63 59 82 59 59 52 64 34 64 84"
)
_WIDTHS = {chr(32 + place): int(width) for place, width in enumerate(_ADVANCES.split())}
_WIDTHS |= {"\u2003": 100, "\u2004": 33, "\u2005": 25, "\u2009": 20, "\u202f": 20, "·": 32}
#: Width of bold text, relative to that of the same text.
BOLD_WIDTH = 1.12


def text_width(text: str, size: float = SIZE, *, bold: bool = False) -> float:
    """Return an upper bound of the width of a text, px."""
    width = 0
    for character in text:
        if character in _WIDTHS:
            width += _WIDTHS[character]
        elif not unicodedata.combining(character):
            width += 100 if unicodedata.east_asian_width(character) in "WF" else 84
    return width * size / 100 * (BOLD_WIDTH if bold else 1)


# Characters that are illegal in XML, control characters, and those that change the direction of writing.
_ILLEGAL = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069]"
)
# White space that XML parsers normalize to spaces in attributes.
_SPACE = re.compile("[\t\n\r]")
# The last zero of 1.50 among numbers with two decimals.
_TRAILING = re.compile(r"(?<=\.\d)0(?= )")


def number(value: float) -> str:
    """Return a coordinate as text: at most two decimals, no negative zero."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def plain(text: str) -> str:
    """Return a text escaped for XML, with illegal characters replaced."""
    return escape(_ILLEGAL.sub("\N{REPLACEMENT CHARACTER}", text), quote=False)


def quoted(text: str) -> str:
    """Return a text as the value of an attribute, with its quotes."""
    legal = escape(_ILLEGAL.sub("\N{REPLACEMENT CHARACTER}", text))
    return f'"{_SPACE.sub(lambda match: f"&#{ord(match[0])};", legal)}"'


def path_of(points: Iterable[Point], *, closed: bool = False) -> str:
    """Return the path data of a polyline, with numbers in the form of `number`."""
    flat = tuple(chain.from_iterable(points))
    text = "L%.2f %.2f " * (len(flat) // 2) % flat
    text = _TRAILING.sub("", text.replace(".00 ", " ")).replace("-0 ", "0 ")
    return "M" + text[1:-1] + ("Z" if closed else "")


class Svg:
    """A figure being drawn; y points down, lengths are px.

    The name is unique on a page: every id of the figure starts with it. Title and description are for screen
    readers.
    """

    def __init__(self, name: str, title: str, description: str = "") -> None:
        self.name = re.sub(r"[^\w-]+", "-", name).strip("-") or "figure"
        self.title, self.description = title, description
        self._parts: list[str] = []
        self._open: list[str] = []
        self._ids = 0

    def id(self) -> str:
        """Return a new id, unique to this figure."""
        self._ids += 1
        return f"{self.name}-{self._ids}"

    def raw(self, markup: str) -> None:
        """Append markup."""
        self._parts.append(markup)

    def element(self, tag: str, cls: str = "", content: str = "", /, **attrs: str | float) -> None:
        """Append an element; `content` is markup, `font_size=9` becomes `font-size="9"`."""
        opening = _opening(tag, cls, attrs)
        self._parts.append(f"<{opening}>{content}</{tag}>" if content else f"<{opening}/>")

    def open(self, cls: str = "", *, tip: str = "", href: str = "", **attrs: str | float) -> None:
        """Open a group, with a text shown under the pointer; with `href` it is a link."""
        kind = "a" if href else "g"
        opening = _opening(kind, cls, {**attrs, "href": href} if href else attrs)
        self._parts.append(f"<{opening}>" + (f"<title>{plain(tip)}</title>" if tip else ""))
        self._open.append(f"</{kind}>")

    def close(self) -> None:
        """Close the innermost group."""
        self._parts.append(self._open.pop())

    def line(self, *points: Point, cls: str = "line", **attrs: str | float) -> None:
        """Draw a polyline."""
        self.element("path", cls, d=path_of(points), **attrs)

    def polygon(self, *points: Point, cls: str = "solid", **attrs: str | float) -> None:
        """Draw a closed polygon."""
        self.element("path", cls, d=path_of(points, closed=True), **attrs)

    def arrow(self, *points: Point, cls: str, head: str, size: Point = (9.0, 4.0), heads: int = 1) -> None:
        """Draw a line that ends with filled heads, one behind another, of a length and half a width."""
        (x1, y1), (x2, y2) = points[-2:]
        distance, (length, half) = max(math.hypot(x2 - x1, y2 - y1), 1e-9), size
        dx, dy = (x2 - x1) / distance, (y2 - y1) / distance
        # The line ends within the head.
        self.line(*points[:-1], (x2 - 0.5 * length * dx, y2 - 0.5 * length * dy), cls=cls)
        for k in range(heads):
            x, y = x2 - 7 * k * dx, y2 - 7 * k * dy
            base = (x - length * dx, y - length * dy)
            sides = [(base[0] - side * dy, base[1] + side * dx) for side in (half, -half)]
            self.polygon((x, y), *sides, cls=head)

    def rect(
        self, x: float, y: float, width: float, height: float, cls: str = "frame", **attrs: str | float
    ) -> None:
        """Draw a rectangle from its upper left corner."""
        self.element("rect", cls, x=x, y=y, width=width, height=height, **attrs)

    def circle(self, x: float, y: float, radius: float, cls: str = "line", **attrs: str | float) -> None:
        """Draw a circle."""
        self.element("circle", cls, cx=x, cy=y, r=radius, **attrs)

    def text(
        self, x: float, y: float, text: str, cls: str = "", *, anchor: str = "middle", **attrs: str | float
    ) -> None:
        """Write a line of text on a baseline; `anchor` is start, middle or end."""
        if anchor != "start":
            attrs["text_anchor"] = anchor
        self.element("text", cls, plain(text), x=x, y=y, **attrs)

    def render(self, width: float, height: float, x: float = 0, y: float = 0) -> str:
        """Return the figure as an SVG document, which may also be part of a page."""
        box = " ".join(map(number, (x, y, width, height)))
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="fig" id={quoted(self.name)} viewBox="{box}" '
            f'width="{number(width)}" height="{number(height)}" role="img" '
            f'aria-labelledby="{self.name}-title {self.name}-desc">'
        )
        title = f'<title id="{self.name}-title">{plain(self.title)}</title>'
        about = f'<desc id="{self.name}-desc">{plain(self.description or self.title)}</desc>'
        body = "\n".join(self._parts + self._open[::-1])
        return f"{head}\n{title}\n{about}\n<style>\n{css()}</style>\n{body}\n</svg>\n"


def _opening(tag: str, cls: str, attrs: dict[str, str | float]) -> str:
    texts = [tag, *([f"class={quoted(cls)}"] if cls else [])]
    for name, value in attrs.items():
        text = _ILLEGAL.sub("", value) if isinstance(value, str) else number(value)
        texts.append(f"{name.rstrip('_').replace('_', '-')}={quoted(text)}")
    return " ".join(texts)
