"""Block diagrams: signals that flow one way, as Park & Kim's Fig. 1(b)."""

from __future__ import annotations

from dataclasses import dataclass

from dynid.report.formula import Formula, draw_formula, typeset
from dynid.report.svg import Point, Svg

_HEIGHT, _LEAST, _GAP, _SUM = 38.0, 64.0, 34.0, 9.0


@dataclass(frozen=True)
class Loop:
    """Two blocks, side by side (feedforward) or in a loop (feedback).

    Parameters
    ----------
    kind
        feedforward: both are driven by the input, and their answers add up; feedback: the second acts back on
        the first.
    forward, back
        What stands in the two blocks, in LaTeX.
    entering, leaving, inner, second
        The signals: input, output, what the first block gets (feedback) or gives (feedforward), and what the
        second block gives.
    """

    kind: str
    forward: str
    back: str
    entering: str
    leaving: str
    inner: str
    second: str

    def size(self) -> tuple[float, float]:
        """Return width and height, px."""
        return self._width() + 4 * _GAP + 2 * self._side(), 2 * _HEIGHT + 58

    def draw(self, svg: Svg, x: float, y: float) -> None:
        """Draw it with its upper left corner at a place."""
        (self._feedback if self.kind == "feedback" else self._feedforward)(svg, x, y)

    def _width(self) -> float:
        return max(_LEAST, *(typeset(text).width + 20 for text in (self.forward, self.back)))

    def _side(self) -> float:
        return max(typeset(text).width for text in (self.entering, self.leaving)) + 12

    def _feedback(self, svg: Svg, x: float, y: float) -> None:
        """Draw the first block behind a difference, the second one on the way back."""
        width, side = self._width(), self._side()
        top, low = y + 20 + _HEIGHT / 2, y + 48 + 1.5 * _HEIGHT
        node, left = x + side + _GAP, x + side + 2 * _GAP
        tap, end = left + width + _GAP, x + self.size()[0]
        _arrow(svg, (x + side, top), (node - _SUM, top))
        svg.circle(node, top, _SUM)
        _arrow(svg, (node + _SUM, top), (left, top))
        _block(svg, self.forward, left, top, width)
        _arrow(svg, (left + width, top), (end - side, top))
        svg.circle(tap, top, 2.5, "solid")
        _arrow(svg, (tap, top), (tap, low), (left + width, low))
        _block(svg, self.back, left, low, width)
        _arrow(svg, (left, low), (node, low), (node, top + _SUM))
        svg.text(node - 13, top - 6, "+", "small")
        svg.text(node - 9, top + _SUM + 12, "−", "small")
        self._signals(svg, x, top, end - side)
        _note(svg, self.inner, (node + left) / 2 + 2, top - 12)
        _note(svg, self.second, (node + left) / 2 + 2, low - 6)

    def _feedforward(self, svg: Svg, x: float, y: float) -> None:
        """Draw both blocks behind a branching, and the sum of what they answer."""
        width, side = self._width(), self._side()
        top, low = y + 20 + _HEIGHT / 2, y + 48 + 1.5 * _HEIGHT
        middle, tap = (top + low) / 2, x + side + _GAP
        left, node = x + side + 2 * _GAP, x + side + 3 * _GAP + width
        end = x + self.size()[0]
        svg.line((x + side, middle), (tap, middle), cls="line")
        svg.circle(tap, middle, 2.5, "solid")
        for height, text in ((top, self.forward), (low, self.back)):
            _arrow(svg, (tap, middle), (tap, height), (left, height))
            _block(svg, text, left, height, width)
            reach = _SUM if height < middle else -_SUM
            _arrow(svg, (left + width, height), (node, height), (node, middle - reach))
        svg.circle(node, middle, _SUM)
        svg.text(node - 9, middle - _SUM - 4, "+", "small")
        svg.text(node - 9, middle + _SUM + 12, "+", "small")
        _arrow(svg, (node + _SUM, middle), (end - side, middle))
        self._signals(svg, x, middle, end - side)
        _note(svg, self.inner, left + width + _GAP / 2, top - 6)
        _note(svg, self.second, left + width + _GAP / 2, low - 6)

    def _signals(self, svg: Svg, x: float, y: float, right: float) -> None:
        entering = typeset(self.entering)
        draw_formula(svg, entering, x + self._side() - entering.width - 4, y + 4)
        draw_formula(svg, typeset(self.leaving), right + 4, y + 4)


def _note(svg: Svg, latex: str, x: float, y: float) -> None:
    formula = typeset(latex, 11)
    draw_formula(svg, formula, x - formula.width / 2, y)


def _block(svg: Svg, latex: str, left: float, middle: float, width: float) -> None:
    svg.rect(left, middle - _HEIGHT / 2, width, _HEIGHT, "line", rx=3)
    formula: Formula = typeset(latex)
    draw_formula(
        svg, formula, left + (width - formula.width) / 2, middle + (formula.above - formula.below) / 2
    )


def _arrow(svg: Svg, *points: Point) -> None:
    """Draw a signal: a line with a full arrow head."""
    svg.line(*points, cls="line")
    (x1, y1), (x2, y2) = points[-2:]
    length = max(abs(x2 - x1) + abs(y2 - y1), 1e-9)
    dx, dy = (x2 - x1) / length, (y2 - y1) / length
    svg.polygon(
        (x2, y2),
        (x2 - 8 * dx + 3.5 * dy, y2 - 8 * dy - 3.5 * dx),
        (x2 - 8 * dx - 3.5 * dy, y2 - 8 * dy + 3.5 * dx),
    )
