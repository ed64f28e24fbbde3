"""Several drawings in one figure, each with a heading, a formula and a sentence under it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from dynid.report.formula import Formula, draw_formula, typeset
from dynid.report.metrics import text_width
from dynid.report.style import SIZE, SMALL
from dynid.report.svg import Svg

#: Draws something with its upper left corner at a place.
Draw = Callable[[Svg, float, float], None]

_WIDTH, _PAD, _LEADING, _READABLE = 1400.0, 14.0, 1.4, 300.0


@dataclass(frozen=True)
class Panel:
    """A drawing with what is said of it.

    Parameters
    ----------
    heading, latex, text
        Over it, and under it; a formula in LaTeX, a sentence.
    width, height, draw
        Its extent, and what draws it.
    """

    heading: str
    latex: str
    text: str
    width: float
    height: float
    draw: Draw

    @cached_property
    def formulas(self) -> list[Formula]:
        """Its equations, one a line."""
        return [typeset(part) for part in self.latex.split(r";\quad ") if part]

    @property
    def full_width(self) -> float:
        """The width with texts, px."""
        formulas = max((formula.width for formula in self.formulas), default=0.0)
        heading = text_width(self.heading, SIZE, bold=True)
        return max(self.width, formulas, heading, _READABLE if self.text else 0.0) + 2 * _PAD

    @cached_property
    def lines(self) -> list[str]:
        """Its sentence, wrapped."""
        return list(wrapped(self.text, self.full_width - 2 * _PAD, SMALL))

    @property
    def full_height(self) -> float:
        """The height with texts, px."""
        formulas = sum(formula.height + 6 for formula in self.formulas)
        return self.height + formulas + len(self.lines) * SMALL * _LEADING + SIZE * 2 + 4 * _PAD


def wrapped(text: str, width: float, size: float) -> Iterator[str]:
    """Yield the lines of a text that are no wider than a width, words kept whole."""
    line = ""
    for word in text.split():
        longer = f"{line} {word}".lstrip()
        if line and text_width(longer, size) > width:
            yield line
            longer = word
        line = longer
    if line:
        yield line


def panels(svg: Svg, shown: Sequence[Panel]) -> tuple[float, float]:
    """Draw panels in rows from left to right; return width and height of the whole."""
    rows: list[list[Panel]] = []
    for panel in shown:
        if rows and sum(other.full_width + _PAD for other in rows[-1]) + panel.full_width <= _WIDTH:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    y, width = _PAD, 0.0
    for row in rows:
        x, height = _PAD, max(panel.full_height for panel in row)
        for panel in row:
            _draw(svg, panel, x, y, height)
            x += panel.full_width + _PAD
        width, y = max(width, x), y + height + _PAD
    return width, y


def _draw(svg: Svg, panel: Panel, x: float, y: float, height: float) -> None:
    svg.open()
    svg.rect(x, y, panel.full_width, height, "grid", rx=8)
    svg.text(x + _PAD, y + _PAD + SIZE, panel.heading, "strong", anchor="start")
    top = y + 2 * _PAD + SIZE
    panel.draw(svg, x + (panel.full_width - panel.width) / 2, top)
    y = top + panel.height + _PAD
    for formula in panel.formulas:
        y += formula.above + 3
        draw_formula(svg, formula, x + _PAD, y)
        y += formula.below + 3
    for line in panel.lines:
        y += SMALL * _LEADING
        svg.text(x + _PAD, y, line, "small muted", anchor="start")
    svg.close()
