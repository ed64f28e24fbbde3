"""SVG writer: text stays text, numbers have one form, equal figures are equal bytes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape
from itertools import chain

from dynid.report.style import css

Point = tuple[float, float]

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
    return f'"{_SPACE.sub(lambda found: f"&#{ord(found[0])};", legal)}"'


def path_of(points: Iterable[Point], *, closed: bool = False) -> str:
    """Return the path data of a polyline, with numbers in the form of `number`."""
    flat = tuple(chain.from_iterable(points))
    text = "L%.2f %.2f " * (len(flat) // 2) % flat
    text = _TRAILING.sub("", text.replace(".00 ", " ")).replace("-0 ", "0 ")
    return "M" + text[1:-1] + ("Z" if closed else "")


class Svg:
    """A figure being drawn; y points down, lengths are px.

    Parameters
    ----------
    name
        The figure's name, unique on a page: every id of the figure starts with it.
    title, description
        Title and description for screen readers.
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

    def open(self, cls: str = "", *, tip: str = "", **attrs: str | float) -> None:
        """Open a group, with a text shown under the pointer."""
        self._parts.append(f"<{_opening('g', cls, attrs)}>" + (f"<title>{plain(tip)}</title>" if tip else ""))
        self._open.append("</g>")

    def close(self) -> None:
        """Close the innermost group."""
        self._parts.append(self._open.pop())

    def line(self, *points: Point, cls: str = "line", **attrs: str | float) -> None:
        """Draw a polyline."""
        self.element("path", cls, d=path_of(points), **attrs)

    def polygon(self, *points: Point, cls: str = "solid", **attrs: str | float) -> None:
        """Draw a closed polygon."""
        self.element("path", cls, d=path_of(points, closed=True), **attrs)

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
