"""HTML that cannot be broken by what stands in it: every text is escaped unless it is markup already."""

from __future__ import annotations

import re
from html import escape


class Markup(str):
    """A text that is HTML already."""

    __slots__ = ()


#: What no HTML document may hold, and what would turn the direction of the text after it.
_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069]")
_VOID = frozenset({"meta", "br", "input", "link"})


def text(value: str) -> Markup:
    """Return a text as HTML; control characters are shown by their number."""
    if isinstance(value, Markup):
        return value
    return Markup(escape(printable(value)))


def printable(value: str) -> str:
    """Return a text with control characters by their number, and with lines that end in one way."""
    return _UNFIT.sub(_shown, value)


def _shown(found: re.Match[str]) -> str:
    letter = found[0]
    return "\n" if letter == "\r" else f"⟨U+{ord(letter):04X}⟩"


def join(*parts: str) -> Markup:
    """Return parts one after another."""
    return Markup("".join(map(text, parts)))


def tag(name: str, *content: str, **attrs: str | bool | None) -> Markup:
    """Return an element.

    Parameters
    ----------
    name
        Its name.
    *content
        Texts, which are escaped, and markup.
    **attrs
        Attributes: `class_` stands for class, `aria_label` for aria-label; True has no value, and what is
        None or False is left out.
    """
    said = "".join(
        f" {_name(key)}" + ("" if value is True else f'="{text(value)}"')
        for key, value in attrs.items()
        if value is not None and value is not False
    )
    if name in _VOID:
        return Markup(f"<{name}{said}>")
    return Markup(f"<{name}{said}>{join(*content)}</{name}>")


def _name(key: str) -> str:
    return key.rstrip("_").replace("_", "-")


_POWER = re.compile(r"(?:\*\*|\^)(-?\d+(?:\.\d+)?|\([^()]*\))")


def formula(value: str) -> Markup:
    """Return a formula in Python's notation with raised powers and dots for products."""
    safe = _POWER.sub(lambda found: f"<sup>{found[1].strip('()')}</sup>", text(value))
    return Markup(safe.replace("*", "\N{DOT OPERATOR}"))
