"""Labels of axes: name, power of ten and units; shortened where space is short."""

from __future__ import annotations

from dynid.report.notation import raised
from dynid.report.plot.axis import Ticks
from dynid.report.svg import BOLD_WIDTH, SIZE, SMALL, text_width

#: Symbols that replace names of axes where space is short.
_SYMBOLS = {"real part": "Re", "imaginary part": "Im"}


def with_power(label: str, ticks: Ticks) -> str:
    """Return the label of an axis with the power of ten of its ticks before the units.

    An axis without a label belongs to a grid of subplots, whose edge has both.
    """
    if not (ticks.power and label):
        return label
    power = f"10{raised(ticks.power)}"
    name, units = in_parts(label)
    return f"{name} ({power} {units})" if units else f"{label} ({power})"


def in_parts(label: str) -> tuple[str, str]:
    """Return the name and the units of a label: `time (s)`."""
    name, bracket, units = label.rpartition(" (")
    return (name, units.removesuffix(")")) if bracket and units.endswith(")") else (label, "")


def fitted_label(text: str, space: float) -> tuple[str, str]:
    """Return the label of an axis and its classes: small, then with a shorter name, where space is short.

    The shorter name is the symbol, if there is one. Other names mostly differ at their ends, so that they
    lose their middle. Units stay whole.
    """
    if text_width(text, SIZE) <= space:
        return text, "label"
    name, units = in_parts(text)
    if name in _SYMBOLS and text_width(text, SMALL) > space:
        return fitted_label(f"{_SYMBOLS[name]} ({units})" if units else _SYMBOLS[name], space)
    return _shortened(name, f" ({units})" if units else "", space), "label small"


def fitted_title(text: str, space: float) -> tuple[str, str]:
    """Return the title of a plot and its classes: small, then without its middle, where space is short."""
    if text_width(text, SIZE, bold=True) <= space:
        return text, "strong"
    return _shortened(text, "", space / BOLD_WIDTH), "small strong"


def _shortened(name: str, end: str, space: float) -> str:
    """Return a small name with what follows it, without its middle where it is wider than a space, px."""
    kept, shown = len(name), f"{name}{end}"
    while kept > 2 and text_width(shown, SMALL) > space:
        kept -= 1
        shown = f"{name[: kept // 3]}…{name[len(name) - (kept - kept // 3) :]}{end}"
    return shown


def fitted(text: str, space: float) -> str:
    """Return a text, cut off with an ellipsis where it is wider than its space, px."""
    if text_width(text, SIZE) <= space:
        return text
    while len(text) > 1 and text_width(f"{text}…", SIZE) > space:
        text = text[:-1]
    return f"{text}…"
