"""The prototype at a port: its path (Park & Kim, Fig. 3), its free motion (4), equivalent sources (5)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from dynid.report.drawing.panels import Panel, panels
from dynid.report.drawing.prototype import prototype_sketch
from dynid.report.drawing.sketch import Line, Link, Sketch, Vertex
from dynid.report.drawing.strip import drawing
from dynid.report.figure import Figure, Picture, Table
from dynid.report.numbers import raised
from dynid.report.svg import Svg

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "bond_graph/port"
#: For every prototype: where its path leads, and whose response eqs 5 to 8 set to zero.
_PATHS = {"a": ("AB", "AB"), "b": ("AB", "AB"), "c": ("B", "B"), "d": ("AB", "A")}


def figures(result: Result) -> Iterator[Figure]:
    """Yield what the prototype at the port tells, and the equivalent sources of both sides."""
    if f"{GROUP}/prototype" not in result:
        return
    yield Figure("port-dynamics", "Path and free motion at the port", partial(_dynamics, result))
    for side in ("source", "load"):
        if f"{GROUP}/{side}/Z_eq/exact" in result and f"{GROUP}/{side}/Y_eq/exact" in result:
            title = f"Equivalent sources of the {side} side"
            yield Figure(f"equivalent-{side}", title, partial(_equivalents, result, side, title))


def _dynamics(result: Result) -> Picture:
    letter = str(result.value(f"{GROUP}/prototype"))
    whole = prototype_sketch(letter)
    along, response = _PATHS[letter]
    path = replace(
        whole,
        links=tuple(replace(b, changed=b.tail == "source" or b.head in along) for b in whole.links),
        vertices=tuple(replace(v, role="output" if v.key in response else v.role) for v in whole.vertices),
    )
    free = replace(whole.without({"source"}), source="A")
    said = {what: _read(result, f"{GROUP}/{what}_dynamics/equation") for what in ("zero", "pole")}
    roots = {what: _read(result, f"{GROUP}/{what}_dynamics/polynomial") for what in ("zero", "pole")}
    shown = [
        Panel("Path from source to response (Fig. 3)", "", _sentence("zero", said, roots), *drawing(path)),
        Panel("Without the source (Fig. 4)", "", _sentence("pole", said, roots), *drawing(free)),
    ]
    title = "Path and free motion at the port"
    about = (
        f"Prototype {letter}: the path of the source is highlighted; without it, A and B move by themselves."
    )
    svg = Svg("port-dynamics", title, about)
    size = panels(svg, shown)
    rows = tuple((f"{what} dynamics", said[what], roots[what]) for what in ("zero", "pole"))
    return Picture(svg.render(*size), about, Table(("what", "equation", "polynomial"), rows))


def _sentence(what: str, said: dict[str, str], roots: dict[str, str]) -> str:
    name = f"{what.capitalize()} dynamics"
    return f"{name}: {written(said[what]) or 'none'}" + (
        f"; {written(roots[what])} = 0" if roots[what] else ""
    )


def _equivalents(result: Result, side: str, title: str) -> Picture:
    here = f"{GROUP}/{side}"
    texts = {name: written(_read(result, f"{here}/{name}/exact")) for name in ("Z_eq", "Y_eq")}
    sources = [
        (own, kind, written(str(result.value(path))))
        for kind in ("e_eq", "f_eq")
        for path in result
        if path.startswith(f"{here}/{kind}/") and path.endswith("/exact")
        for own in [path.removeprefix(f"{here}/{kind}/").removesuffix("/exact")]
    ]
    other = "load" if side == "source" else "source"
    shown = []
    for heading, junction, source, kind, relation, immittance in (
        ("Norton, on a 0-junction (Fig. 5a, eq 15)", "0", "Sf : f_eq", "f_eq", "f = f_eq − Y_eq e", "Y_eq"),
        ("Thévenin, on a 1-junction (Fig. 5b, eq 16)", "1", "Se : e_eq", "e_eq", "e = e_eq − Z_eq f", "Z_eq"),
    ):
        amounts = "; ".join(f"{kind} of {own} = {text}" for own, what, text in sources if what == kind)
        text = f"{relation}; {immittance} = {texts[immittance]}" + (f"; {amounts}" if amounts else "")
        active = any(what == kind for _, what, _ in sources)
        shown.append(
            Panel(heading, "", text, *drawing(_side(junction, source if active else "", immittance, other)))
        )
    about = f"Either may stand for the {side} side without changing the power through the port."
    svg = Svg(f"equivalent-{side}", title, about)
    size = panels(svg, shown)
    rows = [(name, "", text) for name, text in texts.items()] + [
        (kind, own, text) for own, kind, text in sources
    ]
    return Picture(svg.render(*size), about, Table(("what", "of", "value"), tuple(rows)))


def _side(junction: str, source: str, immittance: str, other: str) -> Sketch:
    flow = junction == "0"
    vertices = [
        Vertex("junction", (Line(junction, "glyph"),)),
        Vertex("own", (Line(immittance), Line("admittance" if flow else "impedance", "note"))),
        Vertex("other", (Line(other), Line("side", "note"))),
    ]
    # One bond sets what all at a junction share: that of the other side.
    links = [
        Link("junction", "own", "head" if flow else "tail"),
        Link("junction", "other", "tail" if flow else "head"),
    ]
    if source:
        vertices.insert(0, Vertex("source", (Line(source),)))
        links.insert(0, Link("source", "junction", "tail" if flow else "head"))
    return Sketch(tuple(vertices), tuple(links), "source" if source else "own", "other")


def _read(result: Result, path: str) -> str:
    return str(result.value(path)) if path in result else ""


def written(formula: str) -> str:
    """Write a formula as people do: `s**2*A_p` is s² A_p."""
    powers = re.sub(r"\*\*(\d+)", lambda found: raised(int(found[1])), formula)
    return powers.replace("->", "→").replace("*", " ").replace("-", "−")
