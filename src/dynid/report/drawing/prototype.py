"""The prototype that a reduction ends in (Park & Kim, Fig. 2), and the block diagram it equals (Fig. 1)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from dynid.report.drawing.blocks import Loop
from dynid.report.drawing.panels import Panel, panels
from dynid.report.drawing.sketch import Line, Link, Sketch, Vertex
from dynid.report.drawing.strip import drawing
from dynid.report.figure import Figure, Picture, Table
from dynid.report.svg import Svg

if TYPE_CHECKING:
    from dynid.result import Result

#: For every prototype: source, junction, and the ends of the strokes at source, A and B (Fig. 2).
_STROKES = {
    "a": ("Sf", "1", "tail", "tail", "tail"),
    "b": ("Se", "0", "head", "head", "head"),
    "c": ("Sf", "0", "tail", "head", "tail"),
    "d": ("Se", "1", "head", "tail", "head"),
}
_LOOPS = {
    "a": ("feedforward", "Z_{A}", "Z_{B}", "f", "e", "e_{A}", "e_{B}"),
    "b": ("feedforward", "Y_{A}", "Y_{B}", "e", "f", "f_{A}", "f_{B}"),
    "c": ("feedback", "Z_{B}", "Y_{A}", "f", "e", "f_{B}", "f_{A}"),
    "d": ("feedback", "Y_{B}", "Z_{A}", "e", "f", "e_{B}", "e_{A}"),
}
_EQUATIONS = {"a": 1, "b": 2, "c": 3, "d": 4}


def figures(result: Result) -> Iterator[Figure]:
    """Yield the prototype at every output, and that at the port."""
    group = "bond_graph/reduction"
    if f"{group}/prototype" in result:
        letters = result[f"{group}/prototype"].data.reshape(-1)
        for place, port in enumerate(result[f"{group}/output"].data):
            formulas = [
                str(result[f"{group}/{part}_latex"].data[place])
                for part in ("prototype_equation", "system_a", "system_b")
            ]
            draw = partial(
                prototype_picture, f"prototype-{port}", str(letters[place]), formulas, f"at {port}"
            )
            yield Figure(f"prototype-{port}", f"Prototype at {port}", draw)
    group = "bond_graph/port"
    if f"{group}/prototype_equation_latex" in result:
        letter = str(result.value(f"{group}/prototype"))
        parts = ("prototype_equation", "system_a", "system_b")
        formulas = [str(result.value(f"{group}/{part}_latex")) for part in parts]
        draw = partial(prototype_picture, "prototype-port", letter, formulas, "at the port")
        yield Figure("prototype-port", "Prototype at the port", draw)


def prototype_picture(name: str, letter: str, formulas: list[str], where: str) -> Picture:
    """Draw a prototype with its two systems filled in, beside the block diagram it equals.

    Parameters
    ----------
    name
        The figure's name.
    letter
        a, b, c or d.
    formulas
        Its driving-point relation, and its systems A and B, in LaTeX.
    where
        Of which port it is, in words.
    """
    kind, *_ = _LOOPS[letter]
    title = f"Prototype {letter} {where}: {kind}"
    svg = Svg(name, title, "; ".join(formulas))
    loop = Loop(*_LOOPS[letter])
    shown = [
        Panel(
            f"Prototype {letter} (Fig. 2)",
            r";\quad ".join(formulas[1:]),
            "",
            *drawing(prototype_sketch(letter)),
        ),
        Panel(
            f"{kind.capitalize()} (Fig. 1), eq {_EQUATIONS[letter]}", formulas[0], "", *loop.size(), loop.draw
        ),
    ]
    width, height = panels(svg, shown)
    table = Table(("prototype", "relation", "A", "B"), ((letter, *formulas),))
    flow = "the source sets what A and B share, both answer it"
    back = "B sets what they share, A answers and acts back on it"
    return Picture(svg.render(width, height), f"{title}; {flow if kind == 'feedforward' else back}.", table)


def prototype_sketch(letter: str) -> Sketch:
    """Return one of the four prototypes, with its causal strokes."""
    source, junction, at_source, at_a, at_b = _STROKES[letter]
    _, forward, back, entering, *_ = _LOOPS[letter]
    a, b = sorted((forward, back), key=lambda name: name[2:])
    names = {key: text.replace("{", "").replace("}", "") for key, text in (("A", a), ("B", b))}
    vertices = (
        Vertex("source", (Line(f"{source} : {entering}"),)),
        Vertex("junction", (Line(junction, "glyph"),)),
        *(
            Vertex(key, (Line(text), Line("impedance" if text[0] == "Z" else "admittance", "note")))
            for key, text in names.items()
        ),
    )
    links = (
        Link("source", "junction", at_source),
        Link("junction", "A", at_a),
        Link("junction", "B", at_b),
    )
    return Sketch(vertices, links, "source", "B")
