"""The page as a whole: the answer first, then figures, samples, the scene, and how it came about."""

from __future__ import annotations

from collections.abc import Iterator

from dynid.errors import DynidError
from dynid.progress import counted
from dynid.report.answers import answer
from dynid.report.figure import Figure
from dynid.report.page.answer import part
from dynid.report.page.html import Markup, join, tag
from dynid.report.page.provenance import arrays, provenance, scene
from dynid.report.page.shell import Section, shell
from dynid.report.page.tables import figure_table
from dynid.report.registry import figures
from dynid.report.style import css
from dynid.result import Result

_TOOLS = (("in", "+", "Zoom in"), ("out", "−", "Zoom out"), ("all", "Whole", "Show the whole figure"))


def page(result: Result, *, live: int | None = None, note: str = "") -> str:
    """Return the page of a result.

    Parameters
    ----------
    result
        In memory, or stored in an open file.
    live
        The number of this page, where it listens to the server that it came from and shows itself anew.
    note
        What is to be said before anything else.

    Returns
    -------
    str
        HTML; the same for the same result.
    """
    found = answer(result)
    scripts = ["samples.js"] if result.kind == "study" else []
    scripts += ["watch.js"] if live is not None else []
    first = tag("p", note, class_="note") if note else ""
    sections = list(_sections(result, join(first, *map(part, found.parts))))
    return shell(result.title or "A result of dynid", found.method, sections, scripts, live)


def _sections(result: Result, said: Markup) -> Iterator[Section]:
    if said:
        yield "Answer", said
    yield from _figures(result)
    if result.kind == "study":
        from dynid.report.page.samples import samples

        yield "Samples", samples(result)
    if result.attrs.get("scene"):
        yield "Scene", scene(str(result.attrs["scene"]))
    yield "Provenance", join(provenance(result), arrays(result))


def _figures(result: Result) -> Iterator[Section]:
    drawn = [_figure(figure) for figure in counted(figures(result), "figure")]
    if drawn:
        yield "Figures", join(*drawn)


def _figure(figure: Figure) -> Markup:
    try:
        picture = figure.picture
    except DynidError as error:
        said = tag("p", f"This figure cannot be drawn: {error}", class_="note bad")
        return tag("figure", tag("h3", figure.title), said)
    drawn = Markup(picture.svg.replace(f"<style>\n{css()}</style>\n", ""))  # it stands once on the page
    return tag(
        "figure",
        tag("h3", figure.title),
        tag("div", drawn, class_="picture", tabindex="0", role="group", aria_label=figure.title),
        _tools(figure.title),
        tag("figcaption", picture.caption) if picture.caption else "",
        figure_table(picture.table, figure.title) if picture.table else "",
        id=f"figure-{figure.name}",
    )


def _tools(title: str) -> Markup:
    buttons = (
        tag("button", sign, type="button", data_do=do, aria_label=f"{label}: {title}", title=label)
        for do, sign, label in _TOOLS
    )
    return tag("div", *buttons, tag("output"), class_="tools no-script")
