"""Prototypes of a reduction and of a port (Park & Kim): Figs. 1 to 5 of the paper, filled in.

Figs. 1 and 2: a prototype beside the equivalent block diagram. Figs. 3 and 4: its path from source to
response and its free motion. Fig. 5: the equivalent sources of both sides. Last, the performance
characteristic: the static lines of source and load that meet at the operating point.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

from dynid.report.drawing.render import Panel, draw_panels
from dynid.report.drawing.sketch import Sketch, SketchBond, SketchNode, TextLine
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import approximation, draw_formula, labelled, raised, short, typeset
from dynid.report.plot import Chart, Curve, Markers, PlotAxis, Subplot
from dynid.report.svg import Svg
from dynid.result import Result

PORT = "bond_graph/port"
_PERFORMANCE = f"{PORT}/performance"
_HEIGHT, _LEAST, _GAP, _SUM = 38.0, 64.0, 34.0, 9.0

#: Of every prototype: source, junction, and the ends of the strokes at source, A and B (Fig. 2).
_STROKES = {
    "a": ("Sf", "1", "tail", "tail", "tail"),
    "b": ("Se", "0", "head", "head", "head"),
    "c": ("Sf", "0", "tail", "head", "tail"),
    "d": ("Se", "1", "head", "tail", "head"),
}
_DIAGRAMS = {
    "a": ("feedforward", "Z_{A}", "Z_{B}", "f", "e", "e_{A}", "e_{B}"),
    "b": ("feedforward", "Y_{A}", "Y_{B}", "e", "f", "f_{A}", "f_{B}"),
    "c": ("feedback", "Z_{B}", "Y_{A}", "f", "e", "f_{B}", "f_{A}"),
    "d": ("feedback", "Y_{B}", "Z_{A}", "e", "f", "e_{B}", "e_{A}"),
}
_EQUATIONS = {"a": 1, "b": 2, "c": 3, "d": 4}
#: Of every prototype: the systems on its path, and those whose response eqs 5 to 8 set to zero.
_PATHS = {"a": ("AB", "AB"), "b": ("AB", "AB"), "c": ("B", "B"), "d": ("AB", "A")}


@dataclass(frozen=True)
class _BlockDiagram:
    """Block diagram of two systems in parallel (feedforward) or in a loop (feedback), labelled in LaTeX.

    The signals are input, output, the input (feedback) or output (feedforward) of the first block, and the
    output of the second block.
    """

    kind: str
    forward: str
    back: str
    entering: str
    leaving: str
    inner: str
    second: str

    @property
    def size(self) -> tuple[float, float]:
        return self._width + 4 * _GAP + 2 * self._side, 2 * _HEIGHT + 58

    @property
    def _width(self) -> float:
        return max(_LEAST, *(typeset(text).width + 20 for text in (self.forward, self.back)))

    @property
    def _side(self) -> float:
        return max(typeset(text).width for text in (self.entering, self.leaving)) + 12

    def draw(self, svg: Svg, x: float, y: float) -> None:
        """Draw it with its upper left corner at a point."""
        width, side, (full_width, _) = self._width, self._side, self.size
        arrow = partial(svg.arrow, cls="line", head="solid", size=(8.0, 3.5))
        top, low = y + 20 + _HEIGHT / 2, y + 48 + 1.5 * _HEIGHT
        left, end = x + side + 2 * _GAP, x + full_width
        if self.kind == "feedback":
            middle, node, tap = top, x + side + _GAP, left + width + _GAP
            arrow((x + side, top), (node - _SUM, top))
            svg.circle(node, top, _SUM)
            arrow((node + _SUM, top), (left, top))
            _block(svg, self.forward, left, top, width)
            arrow((left + width, top), (end - side, top))
            svg.circle(tap, top, 2.5, "solid")
            arrow((tap, top), (tap, low), (left + width, low))
            _block(svg, self.back, left, low, width)
            arrow((left, low), (node, low), (node, top + _SUM))
            svg.text(node - 13, top - 6, "+", "small")
            svg.text(node - 9, top + _SUM + 12, "−", "small")
            notes = (((node + left) / 2 + 2, top - 12), ((node + left) / 2 + 2, low - 6))
        else:
            middle, tap, node = (top + low) / 2, x + side + _GAP, x + side + 3 * _GAP + width
            svg.line((x + side, middle), (tap, middle), cls="line")
            svg.circle(tap, middle, 2.5, "solid")
            for height, text in ((top, self.forward), (low, self.back)):
                arrow((tap, middle), (tap, height), (left, height))
                _block(svg, text, left, height, width)
                reach = _SUM if height < middle else -_SUM
                arrow((left + width, height), (node, height), (node, middle - reach))
            svg.circle(node, middle, _SUM)
            svg.text(node - 9, middle - _SUM - 4, "+", "small")
            svg.text(node - 9, middle + _SUM + 12, "+", "small")
            arrow((node + _SUM, middle), (end - side, middle))
            notes = ((left + width + _GAP / 2, top - 6), (left + width + _GAP / 2, low - 6))
        entering = typeset(self.entering)
        draw_formula(svg, entering, x + side - entering.width - 4, middle + 4)
        draw_formula(svg, typeset(self.leaving), end - side + 4, middle + 4)
        for latex, (at, height) in zip((self.inner, self.second), notes, strict=True):
            formula = typeset(latex, 11)
            draw_formula(svg, formula, at - formula.width / 2, height)


def _block(svg: Svg, latex: str, left: float, middle: float, width: float) -> None:
    svg.rect(left, middle - _HEIGHT / 2, width, _HEIGHT, "line", rx=3)
    formula = typeset(latex)
    draw_formula(
        svg, formula, left + (width - formula.width) / 2, middle + (formula.above - formula.below) / 2
    )


def prototypes(result: Result) -> Iterator[Figure]:
    """Yield the prototype at every output, and the prototype at the port."""
    group, parts = "bond_graph/reduction", ("prototype_equation", "system_a", "system_b")
    if f"{group}/prototype" in result:
        letters = result[f"{group}/prototype"].data.reshape(-1)
        for index, output in enumerate(result[f"{group}/output"].data):
            formulas = [str(result[f"{group}/{formula}_latex"].data[index]) for formula in parts]
            name = f"prototype-{output}"
            draw = partial(prototype_picture, name, str(letters[index]), formulas, f"at {output}")
            yield Figure(name, f"Prototype at {output}", draw, derivation=True)
    if f"{PORT}/prototype_equation_latex" in result:
        letter = str(result.value(f"{PORT}/prototype"))
        formulas = [str(result.value(f"{PORT}/{formula}_latex")) for formula in parts]
        draw = partial(prototype_picture, "prototype-port", letter, formulas, "at the port")
        yield Figure("prototype-port", "Prototype at the port", draw, derivation=True)


def prototype_picture(name: str, letter: str, formulas: list[str], where: str) -> Picture:
    """Draw a prototype (a, b, c or d) with its two systems, beside the equivalent block diagram.

    The formulas are its driving-point relation, and its systems A and B, in LaTeX; `where` is its place in
    words.
    """
    kind, *_ = _DIAGRAMS[letter]
    title = f"Prototype {letter} {where}: {kind}"
    svg = Svg(name, title, "; ".join(formulas))
    diagram = _BlockDiagram(*_DIAGRAMS[letter])
    systems = r";\quad ".join(formulas[1:])
    heading = f"{kind.capitalize()} (Fig. 1), eq {_EQUATIONS[letter]}"
    panels = [
        Panel.of_sketch(f"Prototype {letter} (Fig. 2)", systems, "", prototype_sketch(letter)),
        Panel(heading, formulas[0], "", *diagram.size, diagram.draw),
    ]
    width, height = draw_panels(svg, panels)
    table = FigureTable(("prototype", "relation", "A", "B"), ((letter, *formulas),))
    meaning = {
        "feedforward": "the source determines the common variable of A and B, and both respond to it",
        "feedback": "B determines their common variable, and A responds to it and acts back on B",
    }
    return Picture(svg.render(width, height), f"{title}; {meaning[kind]}.", table)


def _noted_node(key: str, text: str, note: str) -> SketchNode:
    return SketchNode(key, (TextLine(text), TextLine(note, "note")))


def prototype_sketch(letter: str) -> Sketch:
    """Return one of the four prototypes, with its causal strokes."""
    source, junction, at_source, at_a, at_b = _STROKES[letter]
    _, forward, back, entering, *_ = _DIAGRAMS[letter]
    a, b = sorted((forward, back), key=lambda name: name[2:])
    names = {key: text.replace("{", "").replace("}", "") for key, text in (("A", a), ("B", b))}
    nodes = (
        SketchNode("source", (TextLine(f"{source} : {entering}"),)),
        SketchNode("junction", (TextLine(junction, "glyph"),)),
        *(
            _noted_node(key, text, "impedance" if text[0] == "Z" else "admittance")
            for key, text in names.items()
        ),
    )
    bonds = (
        SketchBond("source", "junction", at_source),
        SketchBond("junction", "A", at_a),
        SketchBond("junction", "B", at_b),
    )
    return Sketch(nodes, bonds, "source", "B")


def equivalents(result: Result) -> Iterator[Figure]:
    """Yield the dynamics of the prototype at the port, and the equivalent sources of both sides."""
    if f"{PORT}/prototype" not in result:
        return
    yield Figure("port-dynamics", "Path and free motion at the port", partial(_dynamics, result))
    for side in ("source", "load"):
        if f"{PORT}/{side}/Z_eq/exact" in result and f"{PORT}/{side}/Y_eq/exact" in result:
            title = f"Equivalent sources of the {side} side"
            yield Figure(f"equivalent-{side}", title, partial(_equivalents, result, side, title))


def _dynamics(result: Result) -> Picture:
    letter = str(result.value(f"{PORT}/prototype"))
    prototype = prototype_sketch(letter)
    along, response = _PATHS[letter]
    path = replace(
        prototype,
        bonds=tuple(replace(b, changed=b.tail == "source" or b.head in along) for b in prototype.bonds),
        nodes=tuple(replace(n, role="output" if n.key in response else n.role) for n in prototype.nodes),
    )
    free = replace(prototype.without({"source"}), source="A")
    equations = {what: _text(result, f"{PORT}/{what}_dynamics/equation") for what in ("zero", "pole")}
    roots = {what: _text(result, f"{PORT}/{what}_dynamics/polynomial") for what in ("zero", "pole")}
    panels = []
    for what, heading, sketch in (
        ("zero", "Path from source to response (Fig. 3)", path),
        ("pole", "Without the source (Fig. 4)", free),
    ):
        text = f"{what.capitalize()} dynamics: {_in_unicode(equations[what]) or 'none'}"
        text += f"; {_in_unicode(roots[what])} = 0" if roots[what] else ""
        panels.append(Panel.of_sketch(heading, "", text, sketch))
    title = "Path and free motion at the port"
    late = approximation(result[f"{PORT}/prototype"].attrs)
    about = (
        f"Prototype {letter}: the path of the source is highlighted; without it, A and B move freely.{late}"
    )
    svg = Svg("port-dynamics", title, about)
    size = draw_panels(svg, panels)
    rows = [(f"{what} dynamics", equations[what], roots[what]) for what in ("zero", "pole")]
    name, exact = (_text(result, f"{PORT}/zero_dynamics/response{suffix}") for suffix in ("_name", "/exact"))
    if exact:
        rows.append((name, "the response whose zeros are the zero dynamics", exact))
    table = FigureTable(("quantity", "equation", "polynomial or ratio"), tuple(rows))
    return Picture(svg.render(*size), about, table)


def _equivalents(result: Result, side: str, title: str) -> Picture:
    here = f"{PORT}/{side}"
    texts = {name: _in_unicode(_text(result, f"{here}/{name}/exact")) for name in ("Z_eq", "Y_eq")}
    sources = [
        (source_name, kind, _in_unicode(str(result.value(path))))
        for kind in ("e_eq", "f_eq")
        for path in result
        if path.startswith(f"{here}/{kind}/") and path.endswith("/exact")
        for source_name in [path.removeprefix(f"{here}/{kind}/").removesuffix("/exact")]
    ]
    panels = []
    for heading, junction, source, kind, relation, immittance in (
        ("Norton, on a 0-junction (Fig. 5a, eq 15)", "0", "Sf : f_eq", "f_eq", "f = f_eq − Y_eq e", "Y_eq"),
        ("Thévenin, on a 1-junction (Fig. 5b, eq 16)", "1", "Se : e_eq", "e_eq", "e = e_eq − Z_eq f", "Z_eq"),
    ):
        amounts = "; ".join(
            f"{kind} of {source_name} = {text}" for source_name, what, text in sources if what == kind
        )
        text = f"{relation}; {immittance} = {texts[immittance]}" + (f"; {amounts}" if amounts else "")
        active = any(what == kind for _, what, _ in sources)
        flow = junction == "0"
        nodes = [
            SketchNode("junction", (TextLine(junction, "glyph"),)),
            _noted_node("own", immittance, "admittance" if flow else "impedance"),
            _noted_node("other", "load" if side == "source" else "source", "side"),
        ]
        # The bond of the other side determines the common variable of the junction.
        bonds = [
            SketchBond("junction", "own", "head" if flow else "tail"),
            SketchBond("junction", "other", "tail" if flow else "head"),
        ]
        if active:
            nodes.insert(0, SketchNode("source", (TextLine(source),)))
            bonds.insert(0, SketchBond("source", "junction", "tail" if flow else "head"))
        sketch = Sketch(tuple(nodes), tuple(bonds), "source" if active else "own", "other")
        panels.append(Panel.of_sketch(heading, "", text, sketch))
    late = approximation(result[f"{here}/Z_eq/exact"].attrs)
    about = f"Either one replaces the {side} side without changing the power through the port.{late}"
    svg = Svg(f"equivalent-{side}", title, about)
    size = draw_panels(svg, panels)
    rows = [(name, "", text) for name, text in texts.items()]
    rows += [(kind, source_name, text) for source_name, kind, text in sources]
    return Picture(svg.render(*size), about, FigureTable(("quantity", "source", "value"), tuple(rows)))


def _text(result: Result, path: str) -> str:
    return str(result.value(path)) if path in result else ""


def _in_unicode(formula: str) -> str:
    """Return a formula in mathematical notation: `s**2*A_p` is s² A_p."""
    powers = re.sub(r"\*\*(\d+)", lambda match: raised(int(match[1])), formula)
    return powers.replace("->", "→").replace("*", " ").replace("-", "−")


def performance(result: Result) -> Iterator[Figure]:
    """Yield the performance characteristics of the port, where they are finite lines."""
    if f"{_PERFORMANCE}/source_flow" in result and len(result[f"{_PERFORMANCE}/input"].data):
        yield Figure("performance", "Performance characteristic of the port", partial(_performance, result))


def _performance(result: Result) -> Chart:
    data = {
        name: result[f"{_PERFORMANCE}/{name}"].data
        for name in ("source_flow", "source_effort", "load_flow", "load_effort")
    }
    flows, efforts = (result[f"{_PERFORMANCE}/operating_{name}"].data for name in ("flow", "effort"))
    axes = [
        labelled(name, result[f"{_PERFORMANCE}/source_{name}"].units or "SI") for name in ("flow", "effort")
    ]
    subplots, rows = [], list[tuple[CellValue, ...]]()
    for index, source in enumerate(map(str, result[f"{_PERFORMANCE}/input"].data)):
        points = {name: values[index] for name, values in data.items()}
        flow, effort = float(flows[index]), float(efforts[index])
        lines = [
            Curve(points[f"{side}_flow"], points[f"{side}_effort"], side, cls)
            for side, cls in (("source", "s1"), ("load", "s2"))
        ]
        tip = f"flow {short(flow)}, effort {short(effort)}"
        mark = Markers([flow], [effort], "operating point", "s3", "o", 5, [tip])
        subplots.append(Subplot(PlotAxis(axes[0]), PlotAxis(axes[1]), [*lines, mark], source))
        for side in ("source", "load"):
            rows += [
                (source, side, float(f), float(e))
                for f, e in zip(points[f"{side}_flow"], points[f"{side}_effort"], strict=True)
            ]
        rows.append((source, "operating point", flow, effort))
    about = (
        "Effort over flow of source and load in the steady state (s → 0); "
        "the lines meet at the operating point."
    )
    table, width = FigureTable(("input", "what", *axes), tuple(rows)), 480.0 if len(subplots) == 1 else 760.0
    return Chart([subplots[:3]], about, table, width, 300.0)
