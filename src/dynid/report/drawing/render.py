"""Sketches as SVG, alone or as panels of one figure, each with a heading, formulas and a sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from dynid.report.drawing.layout import GAP, GraphLayout, lay_out
from dynid.report.drawing.sketch import COLOUR, PAD_Y, Sketch
from dynid.report.notation import TypesetFormula, draw_formula, typeset
from dynid.report.plot.chart import embedded
from dynid.report.svg import SIZE, SMALL, Svg, number, text_width

#: Greatest width of a drawing within a panel, px.
_WIDEST = 1040.0
_MARGIN, _CUT_REACH = 12.0, 10.0
_WIDTH, _PAD, _LEADING, _READABLE = 1096.0, 14.0, 1.4, 300.0

#: Function that draws with the upper left corner at a point.
Draw = Callable[[Svg, float, float], None]


def render_sketch(name: str, title: str, description: str, sketch: Sketch) -> str:
    """Return a sketch as an SVG document, with a legend of its domains."""
    svg, layout = Svg(name, title, description), lay_out(sketch)
    frame = layout.frame
    _draw_sketch(svg, sketch, layout)
    left, top, right, bottom = frame.left, frame.top, frame.right, frame.bottom
    if sketch.cut is not None:
        top, bottom = top - 24, bottom + 6
    present = {node.domain for node in sketch.nodes}
    domains = [domain for domain in COLOUR if domain in present]
    if domains:
        x, y = left, bottom + GAP + SMALL
        for domain in domains:
            svg.rect(x, y - 8, 14, 10, f"{COLOUR[domain]} band", rx=2)
            svg.line((x, y - 3), (x + 14, y - 3), cls=COLOUR[domain])
            svg.text(x + 19, y, domain, "small", anchor="start")
            x += 19 + text_width(domain, SMALL) + 16
        right = max(right, left + (x - left))
        bottom += GAP + 2 * SMALL
    width, height = right - left + 2 * _MARGIN, bottom - top + 2 * _MARGIN
    return svg.render(width, height, left - _MARGIN, top - _MARGIN)


def _draw_sketch(
    svg: Svg, sketch: Sketch, layout: GraphLayout, x: float = 0, y: float = 0, scale: float = 1
) -> None:
    """Draw a sketch with its origin at a point."""
    moved = (x, y, scale) != (0, 0, 1)
    if moved:
        svg.open(transform=f"translate({number(x)} {number(y)}) scale({number(scale)})")
    for bond, route in zip(sketch.bonds, layout.routes, strict=True):
        cls = "bond mark" if bond.changed else f"bond {COLOUR.get(bond.domain, '')}".rstrip()
        arrow, stroke = bond.arrow_on(route), bond.stroke_on(route)
        if bond.dashed:
            svg.line(*bond.line_on(route), cls=f"{cls} dashed")
            if arrow:
                svg.line(*arrow, cls=cls)
            continue
        svg.open(tip=f"{bond.tail} → {bond.head}")
        svg.line(*bond.line_on(route), *arrow[1:], cls=cls)
        if stroke is not None:
            svg.line(*stroke, cls=cls)
        svg.close()
    for node in sketch.nodes:
        box, colour = layout.boxes[node.key], COLOUR.get(node.domain)
        svg.open(tip=node.key, href=f"#figure-{node.opens}" if node.opens else "")
        size = (box.left, box.top, box.right - box.left, box.bottom - box.top)
        svg.rect(*size, f"{colour} band" if colour else "node", rx=6)
        if node.changed or node.role:
            svg.rect(*size, "line mark" if node.changed else "line", rx=6)
        centre, middle = box.centre
        baseline = middle - node.height / 2 + PAD_Y
        for line in node.lines:
            cls = {"glyph": "title", "label": "strong", "note": "small muted"}[line.role]
            svg.text(centre, baseline + line.height * 0.5 + line.size * 0.36, line.text, cls)
            baseline += line.height
        svg.close()
    if sketch.cut is not None:
        _draw_cut(svg, sketch, layout, sketch.cut)
    if moved:
        svg.close()


def _draw_cut(svg: Svg, sketch: Sketch, layout: GraphLayout, cut: tuple[str, str]) -> None:
    """Draw the source-load cut across its bond: through the whole drawing where it meets nothing else."""
    index = next(k for k, bond in enumerate(sketch.bonds) if {bond.tail, bond.head} == set(cut))
    route = layout.routes[index]
    middle = (len(route) - 1) // 2
    (x1, y1), (x2, y2) = route[middle : middle + 2]
    x, y = (x1 + x2) / 2, (y1 + y2) / 2
    if abs(x2 - x1) < abs(y2 - y1):
        svg.line((x - _CUT_REACH, y), (x + _CUT_REACH, y), cls="line mark dashed")
        return
    spans = [(box.left, box.right) for box in layout.boxes.values()]
    others = (route for place, route in enumerate(layout.routes) if place != index)
    spans += [(min(p[0] for p in r), max(p[0] for p in r)) for r in others]
    places = [x1 + (x2 - x1) * (0.5 + side * step / 20) for step in range(8) for side in (1, -1)]
    clear = next((at for at in places if all(not a - 4 < at < b + 4 for a, b in spans)), None)
    if clear is None:
        svg.line((x, y - _CUT_REACH), (x, y + _CUT_REACH), cls="line mark dashed")
        return
    top = layout.frame.top - 20
    svg.line((clear, top), (clear, layout.frame.bottom + 4), cls="line mark dashed")
    source_left = layout.boxes[cut[0]].left < clear
    for side, anchor in ((-6, "end"), (6, "start")):
        text = "source" if (side < 0) is source_left else "load"
        svg.text(clear + side, top + 10, text, "small marked", anchor=anchor)


@dataclass(frozen=True)
class Panel:
    """A drawing (px) within a figure: heading above, a formula in LaTeX and a sentence below, if any."""

    heading: str
    latex: str
    text: str
    width: float
    height: float
    draw: Draw

    @classmethod
    def of_sketch(cls, heading: str, latex: str, text: str, sketch: Sketch) -> Panel:
        """Return a panel of a sketch, which is scaled down where it is wider than `_WIDEST`."""
        layout = lay_out(sketch)
        frame = layout.frame
        scale = round(min(1.0, _WIDEST / (frame.right - frame.left)), 2)

        def draw(svg: Svg, x: float, y: float) -> None:
            _draw_sketch(svg, sketch, layout, x - scale * frame.left, y - scale * frame.top, scale)

        width, height = scale * (frame.right - frame.left), scale * (frame.bottom - frame.top)
        return cls(heading, latex, text, width, height, draw)

    @cached_property
    def formulas(self) -> list[TypesetFormula]:
        """Its equations, one a line."""
        return [typeset(latex) for latex in self.latex.split(r";\quad ") if latex]

    @property
    def full_width(self) -> float:
        """Width with texts, px."""
        formulas = max((formula.width for formula in self.formulas), default=0.0)
        heading = text_width(self.heading, SIZE, bold=True)
        return max(self.width, formulas, heading, _READABLE if self.text else 0.0) + 2 * _PAD

    @cached_property
    def lines(self) -> list[str]:
        """The lines of its sentence."""
        return list(wrapped(self.text, self.full_width - 2 * _PAD, SMALL))

    @property
    def full_height(self) -> float:
        """Height with texts, px."""
        formulas = sum(formula.height + 6 for formula in self.formulas)
        return self.height + formulas + len(self.lines) * SMALL * _LEADING + SIZE * 2 + 4 * _PAD

    def render(self, svg: Svg, x: float, y: float, height: float) -> None:
        """Draw the panel, its texts included, into a frame of a height."""
        svg.open()
        svg.rect(x, y, self.full_width, height, "grid", rx=8)
        svg.text(x + _PAD, y + _PAD + SIZE, self.heading, "strong", anchor="start")
        top = y + 2 * _PAD + SIZE
        self.draw(svg, x + (self.full_width - self.width) / 2, top)
        y = top + self.height + _PAD
        for formula in self.formulas:
            y += formula.above + 3
            draw_formula(svg, formula, x + _PAD, y)
            y += formula.below + 3
        for line in self.lines:
            y += SMALL * _LEADING
            svg.text(x + _PAD, y, line, "small muted", anchor="start")
        svg.close()


def wrapped(text: str, width: float, size: float) -> Iterator[str]:
    """Yield the lines of a text that is wrapped between words to a width."""
    line = ""
    for word in text.split():
        longer = f"{line} {word}".lstrip()
        if line and text_width(longer, size) > width:
            yield line
            longer = word
        line = longer
    if line:
        yield line


def draw_panels(svg: Svg, panels: Sequence[Panel]) -> tuple[float, float]:
    """Draw panels in rows from left to right, on a page one a row; return the width and height of all."""
    rows: list[list[Panel]] = []
    widest = _WIDTH if embedded.get() is None else 0.0
    for panel in panels:
        if rows and sum(neighbour.full_width + _PAD for neighbour in rows[-1]) + panel.full_width <= widest:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    y, width = _PAD, 0.0
    for row in rows:
        x, height = _PAD, max(panel.full_height for panel in row)
        for panel in row:
            panel.render(svg, x, y, height)
            x += panel.full_width + _PAD
        width, y = max(width, x), y + height + _PAD
    return width, y
