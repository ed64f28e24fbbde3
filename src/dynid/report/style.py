"""Style of all figures: colours of the light and dark theme, fonts, sizes, line widths, widths of texts.

Colours are CSS variables with the light value as fallback, so that a figure is right alone, within a page
and in dark mode; a page may force either theme by `data-theme` on its root element. The hues are those of
Okabe & Ito (2008), which colour-blind readers can distinguish, lightened for the dark theme.
"""

from __future__ import annotations

import re
import unicodedata

FONT = "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"
MATH = "'STIX Two Math', 'Cambria Math', 'Times New Roman', 'DejaVu Serif', serif"

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
SERIES = tuple(name for name in COLOURS if re.fullmatch(r"s\d", name))
#: Dashes of series, which distinguish them without colour.
DASHES = ("none", "7 3", "2 3", "9 3 2 3", "5 2", "1 2", "12 4")


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
        "text": f"font-family: {FONT}; font-size: {SIZE:g}px; fill: {ink}; stroke: none",
        ".title": f"font-size: {TITLE:g}px; font-weight: 600",
        ".strong": "font-weight: 600",
        ".small": f"font-size: {SMALL:g}px",
        ".muted": f"fill: {muted}",
        ".math": f"font-family: {MATH}; font-size: {TITLE:g}px",
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
    for name, dash in zip(SERIES, DASHES, strict=True):
        rules[f".{name}"] = f"fill: none; stroke: {colour(name)}; stroke-width: {BOLD:g}"
        rules[f".{name}.dash"] = f"stroke-dasharray: {dash}"
        rules[f".{name}.dot"] = f"fill: {colour(name)}; stroke: none"
        rules[f".{name}.band"] = f"fill: {colour(name)}; fill-opacity: .18; stroke: none"
        rules[f"text.{name}"] = f"fill: {colour(name)}; stroke: none"
    rules[".halo"] = f"paint-order: stroke; stroke: {colour('paper')}; stroke-width: 3px"
    rules["path.fine"] = f"stroke-width: {LINE:g}"
    rules[".hollow"] = f"fill: {colour('paper')}"
    rules[".tick"] = f"fill: {muted}"
    texts = "".join(f".fig {selector} {{ {body} }}\n" for selector, body in rules.items())
    return f"{light}\n@media (prefers-color-scheme: dark) {{ {dark} }}\n{forced}{texts}"


def resolved(svg: str, *, dark: bool = False) -> str:
    """Return a figure with the colours of one theme in place of CSS variables."""
    known = "|".join(COLOURS)  # animations have variables, too
    text = re.sub(rf"var\(--({known})(?:, [^)]*)?\)", lambda found: COLOURS[found[1]][dark], svg)
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
_BOLD = 1.12


def text_width(text: str, size: float = SIZE, *, bold: bool = False) -> float:
    """Return an upper bound of the width of a text, px."""
    return sum(map(_advance, text)) * size / 100 * (_BOLD if bold else 1)


def _advance(character: str) -> int:
    width = _WIDTHS.get(character)
    if width is not None:
        return width
    if unicodedata.combining(character):
        return 0
    return 100 if unicodedata.east_asian_width(character) in "WF" else 84
