"""How wide a text is, before anybody knows the reader's font."""

from __future__ import annotations

import unicodedata

from dynid.report.style import SIZE

# Advances of ASCII from the space on, in hundredths of the font size: those of DejaVu Sans, as wide as any
# system font, so that what is kept clear of the estimate is clear of the text.
_ADVANCES = (
    "32 40 46 84 64 95 78 27 39 39 50 84 32 36 32 34 64 64 64 64 64 64 64 64 64 64 34 34 84 84 84 53 "
    "100 68 69 70 77 63 58 77 75 29 29 66 56 86 75 79 60 79 69 63 61 73 68 99 69 61 69 39 34 39 84 50 "
    "50 61 63 55 63 62 35 63 63 28 28 58 28 97 63 61 63 63 41 52 39 63 59 82 59 59 52 64 34 64 84"
)
_WIDTHS = {chr(32 + place): int(width) for place, width in enumerate(_ADVANCES.split())}
_WIDTHS |= {"\u2003": 100, "\u2004": 33, "\u2005": 25, "\u2009": 20, "\u202f": 20, "·": 32}
_BOLD = 1.12


def text_width(text: str, size: float = SIZE, *, bold: bool = False) -> float:
    """Return an upper estimate of the width of a text, px."""
    return sum(map(_advance, text)) * size / 100 * (_BOLD if bold else 1)


def _advance(character: str) -> int:
    width = _WIDTHS.get(character)
    if width is not None:
        return width
    if unicodedata.combining(character):
        return 0
    return 100 if unicodedata.east_asian_width(character) in "WF" else 84
