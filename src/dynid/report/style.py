"""The one style of all figures: colours for light and dark, fonts, sizes and line widths.

Colours are CSS variables with the light value as fallback, so that a figure is right alone, within a page
and in dark mode; a page may force either theme by `data-theme` on its root element. The hues are those of
Okabe & Ito (2008), which colour-blind readers tell apart, lightened for dark ground.
"""

from __future__ import annotations

import re

FONT = "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"
MATH = "'STIX Two Math', 'Cambria Math', 'Times New Roman', 'DejaVu Serif', serif"

#: Font sizes, px.
TITLE, SIZE, SMALL = 14.0, 12.0, 10.0

#: Line widths, px: data and bonds, axes and strokes, grids.
BOLD, LINE, HAIR = 2.0, 1.2, 0.6

#: Colours by name: light, dark. `s1` … `s7` are those of series, in the order of their use.
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
#: Dashes of series, to tell them apart without colour.
DASHES = ("none", "7 3", "2 3", "9 3 2 3", "5 2", "1 2", "12 4")


def colour(name: str) -> str:
    """Return a colour for an SVG style: a variable, with its light value where nobody sets it."""
    return f"var(--{name}, {COLOURS[name][0]})"


def _rules() -> str:
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
    return "".join(f".fig {selector} {{ {body} }}\n" for selector, body in rules.items())


def _theme(place: int) -> str:
    return "; ".join(f"--{name}: {both[place]}" for name, both in COLOURS.items())


def css() -> str:
    """Return the style sheet of figures, the same within each of them."""
    light, dark = (f".fig {{ {_theme(place)} }}" for place in (0, 1))
    forced = "".join(
        f':root[data-theme="{name}"] .fig {{ {_theme(place)} }}\n'
        for place, name in enumerate(("light", "dark"))
    )
    return f"{light}\n@media (prefers-color-scheme: dark) {{ {dark} }}\n{forced}{_rules()}"


def resolved(svg: str, *, dark: bool = False) -> str:
    """Return a figure with plain colours of one theme, for programs that know no CSS variables."""
    known = "|".join(COLOURS)  # motion has variables, too
    text = re.sub(rf"var\(--({known})(?:, [^)]*)?\)", lambda found: COLOURS[found[1]][dark], svg)
    start, end = text.find(".fig {"), text.find(".fig text {")
    return text[:start] + text[end:] if 0 <= start < end else text
