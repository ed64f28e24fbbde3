"""Laid out sketches as SVG."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.report.drawing.domains import COLOUR
from dynid.report.drawing.forest import GAP
from dynid.report.drawing.layout import Box, Layout, lay_out
from dynid.report.drawing.marks import barb_of, line_of, stroke_of
from dynid.report.drawing.sketch import PAD_Y, Link, Sketch, Vertex
from dynid.report.metrics import text_width
from dynid.report.style import SMALL
from dynid.report.svg import Point, Svg, number

_MARGIN = 12.0
_CUT_REACH = 10.0


def render_sketch(name: str, title: str, description: str, sketch: Sketch) -> str:
    """Return a sketch as an SVG document, with a legend of its domains."""
    svg, layout = Svg(name, title, description), lay_out(sketch)
    frame = layout.frame
    draw_sketch(svg, sketch, layout)
    left, top, right, bottom = frame.left, frame.top, frame.right, frame.bottom
    if sketch.cut is not None:
        top, bottom = top - 24, bottom + 6
    domains = domains_of(sketch)
    if domains:
        right = max(right, left + _legend(svg, domains, left, bottom + GAP + SMALL))
        bottom += GAP + 2 * SMALL
    width, height = right - left + 2 * _MARGIN, bottom - top + 2 * _MARGIN
    return svg.render(width, height, left - _MARGIN, top - _MARGIN)


def domains_of(sketch: Sketch) -> list[str]:
    """Return the domains in a sketch."""
    found = {vertex.domain for vertex in sketch.vertices}
    return [domain for domain in COLOUR if domain in found]


def draw_sketch(
    svg: Svg, sketch: Sketch, layout: Layout, x: float = 0, y: float = 0, scale: float = 1
) -> None:
    """Draw a laid out sketch, its origin at a place."""
    moved = (x, y, scale) != (0, 0, 1)
    if moved:
        svg.open(transform=f"translate({number(x)} {number(y)}) scale({number(scale)})")
    for link, route in zip(sketch.links, layout.routes, strict=True):
        _draw_link(svg, link, route)
    for vertex in sketch.vertices:
        _draw_vertex(svg, vertex, layout.boxes[vertex.key])
    if sketch.cut is not None:
        _draw_cut(svg, sketch, layout)
    if moved:
        svg.close()


def _draw_link(svg: Svg, link: Link, route: Sequence[Point]) -> None:
    cls = "bond mark" if link.changed else f"bond {COLOUR.get(link.domain, '')}".rstrip()
    if link.equation_only:
        svg.line(*line_of(link, route), cls=f"{cls} dashed")
        return
    barb, stroke = barb_of(link, route), stroke_of(link, route)
    svg.open(tip=f"{link.tail} → {link.head}")
    svg.line(*line_of(link, route), *(barb[1:] if barb else ()), cls=cls)
    if stroke is not None:
        svg.line(*stroke, cls=cls)
    svg.close()


def _draw_vertex(svg: Svg, vertex: Vertex, box: Box) -> None:
    colour = COLOUR.get(vertex.domain)
    cls = f"{colour} band" if colour else "node"
    svg.open(tip=vertex.key)
    size = (box.left, box.top, box.right - box.left, box.bottom - box.top)
    svg.rect(*size, cls, rx=6)
    if vertex.changed or vertex.role:
        svg.rect(*size, "line mark" if vertex.changed else "line", rx=6)
    x, middle = box.centre
    y = middle - vertex.height / 2 + PAD_Y
    for line in vertex.lines:
        cls = {"glyph": "title", "label": "strong", "note": "small muted"}[line.role]
        svg.text(x, y + line.height * 0.5 + line.size * 0.36, line.text, cls)
        y += line.height
    svg.close()


def _draw_cut(svg: Svg, sketch: Sketch, layout: Layout) -> None:
    """Draw the source-load cut across its bond: through the whole drawing, where only that bond passes."""
    assert sketch.cut is not None
    ends = set(sketch.cut)
    index = next(place for place, link in enumerate(sketch.links) if {link.tail, link.head} == ends)
    route = layout.routes[index]
    middle = (len(route) - 1) // 2
    (x1, y1), (x2, y2) = route[middle : middle + 2]
    x, y = (x1 + x2) / 2, (y1 + y2) / 2
    if abs(x2 - x1) < abs(y2 - y1):
        svg.line((x - _CUT_REACH, y), (x + _CUT_REACH, y), cls="line mark dashed")
        return
    places = [x1 + (x2 - x1) * (0.5 + side * step / 20) for step in range(8) for side in (1, -1)]
    clear = next((place for place in places if _clear(layout, place, index)), None)
    if clear is None:
        svg.line((x, y - _CUT_REACH), (x, y + _CUT_REACH), cls="line mark dashed")
        return
    top = layout.frame.top - 20
    svg.line((clear, top), (clear, layout.frame.bottom + 4), cls="line mark dashed")
    source_left = layout.boxes[sketch.cut[0]].left < clear
    for side, anchor in ((-6, "end"), (6, "start")):
        text = "source" if (side < 0) is source_left else "load"
        svg.text(clear + side, top + 10, text, "small marked", anchor=anchor)


def _clear(layout: Layout, x: float, index: int) -> bool:
    """Tell whether a vertical line meets no node and no other bond."""
    boxes = all(not box.left - 4 < x < box.right + 4 for box in layout.boxes.values())
    others = (route for place, route in enumerate(layout.routes) if place != index)
    return boxes and all(not min(p[0] for p in r) - 4 < x < max(p[0] for p in r) + 4 for r in others)


def _legend(svg: Svg, domains: Sequence[str], x: float, y: float) -> float:
    """Draw swatches with the names of domains; return the width."""
    start = x
    for domain in domains:
        svg.rect(x, y - 8, 14, 10, f"{COLOUR[domain]} band", rx=2)
        svg.line((x, y - 3), (x + 14, y - 3), cls=COLOUR[domain])
        svg.text(x + 19, y, domain, "small", anchor="start")
        x += 19 + text_width(domain, SMALL) + 16
    return x - start
