"""Page of a result as one HTML document: the answer with its figures first, then details and derivations.

Every page has a policy that lets it load nothing and run only its own scripts, a theme button, and links to
its sections.
"""

from __future__ import annotations

import math
import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import NamedTuple

from dynid._version import __version__
from dynid.errors import DynidError
from dynid.number_format import counted
from dynid.progress import tracked
from dynid.report.content import array_rows, content
from dynid.report.content.blocks import DefinitionList, ReportSection, Statement
from dynid.report.figure import Figure, LegendEntry, figures, leading
from dynid.report.page.html import (
    Markup,
    figure_table,
    grid,
    join,
    json_data,
    node,
    page_sections,
    scrolling,
    tag,
    text,
)
from dynid.report.plot.chart import PageSpace, embedded
from dynid.report.plot.layers import legend_key
from dynid.report.svg import css
from dynid.result import Result

_TOOLS = (("in", "+", "Zoom in"), ("out", "−", "Zoom out"), ("all", "Whole", "Show the whole figure"))
#: Most arrays, and most lines of a scene, that are listed.
_ARRAYS, _LINES = 500, 3000
#: Width of a picture, and that above which it takes the whole width of the page, px.
_WIDTH, _WIDE = re.compile(r'<svg[^>]*\bwidth="([\d.]+)"'), 520
#: Largest height of a figure beside the answer, px: with the widest column there, that of the style sheet.
_TALL = 370.0
#: Columns of figures beside the answer.
_LEADING_COLUMNS = 3
_FIRST = ("created", "dynid_version", "python", "packages", "seed", "folder")

#: Most rows of a table of the answer that are not folded.
_UNFOLDED_ROWS = 12


class _PagePart(NamedTuple):
    """A part of a page: its heading, its content, and the names and titles of what it has (for the index)."""

    heading: str
    inside: Markup
    entries: Sequence[tuple[str, str]] = ()


def page(result: Result, *, live: int | None = None, note: str = "") -> str:
    """Return the page of a result, which may be stored in an open file; the same for the same result.

    `live` is the number of a page that listens to the server that it came from and reloads itself; `note` is
    a statement before everything else.
    """
    answer = content(result)
    scripts = ["samples.js"] if result.kind == "study" else []
    scripts += ["watch.js"] if live is not None else []
    drawable = figures(result)
    first, drawn = leading(result.kind, drawable), dict[str, Markup]()
    previews, space = dict[str, Markup](), PageSpace()
    for figure in tracked(drawable, "figure"):
        if figure in first:
            drawn[figure.name] = _drawn(figure, space, _TALL)
            if space.omitted:
                previews[figure.name] = drawn[figure.name]
        if figure not in first or figure.name in previews:
            drawn[figure.name] = _drawn(figure, space, math.inf)
    leading_pictures = drawn | previews
    # A wide figure would push the others down; a record has the width of two.
    first = [one for one in first if one is first[0] or 'class="wide"' not in leading_pictures[one.name]]
    room, shown_first = _LEADING_COLUMNS, list[Figure]()
    for one in first:
        room -= 2 if 'class="record"' in leading_pictures[one.name] else 1
        shown_first += [one] if room >= 0 else []
    first = shown_first
    others = [figure for figure in drawable if figure not in first or figure.name in previews]
    unfolded = None if result.kind == "bench" else _UNFOLDED_ROWS  # of a benchmark every row is an answer
    parts = [
        _answer(
            page_sections(answer.sections, "answer"),
            [leading_pictures[one.name] for one in first],
            note,
            unfolded,
        )
    ]
    parts[0] = parts[0]._replace(entries=[_entry(one) for one in first if one.name not in previews])
    if shown := [figure for figure in others if not figure.derivation]:
        cells = tag("div", *(drawn[figure.name] for figure in shown), class_="figures")
        parts.append(_PagePart("Figures", cells, [_entry(figure) for figure in shown]))
    for kind, heading in (("details", "Details"), ("derivation", "Derivations")):
        sections = page_sections(answer.sections, kind)
        derived = [figure for figure in others if figure.derivation] if kind == "derivation" else []
        names = [(f"{kind}-{number}", section.title) for number, section in enumerate(sections, 1)]
        inside = [
            _folded(name, title, *(node(block, title) for block in section.blocks))
            for (name, title), section in zip(names, sections, strict=True)
        ]
        inside += [_folded(f"fold-{figure.name}", figure.title, drawn[figure.name]) for figure in derived]
        if inside:
            parts.append(_PagePart(heading, join(*inside), [*names, *map(_entry, derived)]))
    if result.kind == "study":
        from dynid.report.page.samples import samples

        parts.append(_PagePart("Samples", samples(result)))
    if result.attrs.get("scene"):
        lines = str(result.attrs["scene"]).splitlines()
        numbered = join(*(tag("span", f"{line}\n", class_="line") for line in lines[:_LINES]))
        left = len(lines) - _LINES
        more = tag("p", f"… {left:,} more lines in the file", class_="quiet") if left > 0 else ""
        scene = scrolling(tag("pre", tag("code", numbered), class_="scene"), "Text of the scene")
        parts.append(_PagePart("Scene", _folded("scene-text", counted(len(lines), "line"), scene, more)))
    parts.append(_PagePart("Provenance", _provenance(result)))
    return document(result.title or "A result of dynid", answer.method, parts, scripts, live)


def _answer(
    sections: Iterable[ReportSection], first: Sequence[Markup], note: str, unfolded: int | None
) -> _PagePart:
    """Return the answer with the figures that show it; tables fold all but the first `unfolded` rows."""
    cells = []
    for section in sections:
        blocks = (
            tag("div", node(block, section.title, unfolded), class_="block") for block in section.blocks
        )
        # Sentences need no heading.
        head = (
            "" if all(isinstance(block, Statement) for block in section.blocks) else tag("h3", section.title)
        )
        terms = all(isinstance(block, DefinitionList) for block in section.blocks)
        cells.append(tag("section", head, *blocks, class_="terms" if terms else None))
    inside = join(
        tag("p", note, class_="note") if note else "",
        tag("div", *cells, class_="answers") if cells else "",
        tag("div", *first, class_="figures") if first else "",
    )
    return _PagePart("Answer", inside)


def _entry(figure: Figure) -> tuple[str, str]:
    return f"figure-{figure.name}", figure.title


def _folded(name: str, title: str, *inside: str) -> Markup:
    return tag("details", tag("summary", tag("h3", title)), *inside, id=name, class_="fold")


def document(
    title: str,
    subtitle: str,
    parts: Iterable[_PagePart],
    scripts: Sequence[str] = (),
    live: int | None = None,
) -> str:
    """Return a page of several parts, with a policy that lets it load nothing and run only its own scripts.

    Empty parts are omitted. `scripts` are files beside those of all pages; `live` is as of `page`.
    """

    def asset(name: str) -> str:
        return (files("dynid.report.page") / name).read_text(encoding="utf-8")

    code = [asset(name) for name in ("record.js", "page.js", "print.js", *scripts)]
    sections = [(section, section.heading.lower()) for section in parts if section.inside]
    theme = tag(
        "button",
        "Dark",
        id="theme",
        type="button",
        class_="no-script",
        title="Switch between light and dark",
    )
    links = (tag("li", tag("a", section.heading, href=f"#{name}")) for section, name in sections)
    listed = [(section.heading, section.entries) for section, _ in sections if section.entries]
    index = ""
    if listed:
        lists = (
            tag("dt", heading)
            + tag("dd", *(join(tag("a", entry, href=f"#{name}"), " ") for name, entry in entries))
            for heading, entries in listed
        )
        index = tag("details", tag("summary", "Index"), tag("dl", *map(Markup, lists)), class_="index")
    header = tag(
        "header",
        tag("div", tag("h1", tag("bdi", title)), tag("p", subtitle, class_="quiet"), theme, class_="row"),
        tag("nav", tag("ul", *links), index, aria_label="Sections"),
    )
    state = []
    if live is not None:
        state.append(tag("div", id="state", class_="quiet", role="status", data_version=str(live)))
        state.append(tag("div", id="fault", class_="card", role="alert"))
    cards = []
    for section, name in sections:
        top = tag("h2", section.heading, id=f"{name}-title")
        cards.append(
            tag("section", top, section.inside, id=name, class_="card", aria_labelledby=f"{name}-title")
        )
    body = join(
        header,
        *state,
        tag("main", *cards, id="main", tabindex="-1"),
        tag("footer", f"Made by dynid {__version__}"),
    )
    digests = (b64encode(sha256(script.encode()).digest()).decode() for script in code)
    hashes = " ".join(f"'sha256-{digest}'" for digest in digests)
    connect = "connect-src 'self'; " if live is not None else ""
    policy = (
        f"default-src 'none'; style-src 'unsafe-inline'; script-src {hashes}; {connect}"
        "base-uri 'none'; form-action 'none'"
    )
    return Template(asset("page.html")).substitute(
        policy=policy,
        title=text(title),
        css=asset("page.css") + css(),
        body=body,
        scripts="\n".join(f"<script>{script}</script>" for script in code),
    )


def _drawn(figure: Figure, space: PageSpace, tallest: float) -> Markup:
    """Return a figure for a page, of a largest height; `space` has the number of subplots that it omits."""
    space.tallest, space.omitted = tallest, 0
    token = embedded.set(space)
    try:
        return _figure(replace(figure), space)
    finally:
        embedded.reset(token)


def _figure(figure: Figure, space: PageSpace) -> Markup:
    """Return a figure with its tools, caption and table, or the reason why it cannot be drawn.

    A figure that omits subplots has a link to the whole one in place of its table.
    """
    try:
        picture = figure.picture
    except DynidError as error:
        reason = tag("p", f"This figure cannot be drawn: {error}", class_="note bad")
        return tag("figure", tag("h3", figure.title), reason)
    drawn = Markup(picture.svg.replace(f"<style>\n{css()}</style>\n", ""))  # the page has it once
    buttons = (
        tag("button", sign, type="button", data_do=do, aria_label=f"{label}: {figure.title}", title=label)
        for do, sign, label in _TOOLS
    )
    every = 2 * picture.record.get("samples", 1)
    thinned = f" The page has the extremes of every {every} samples, the file all." if every > 2 else ""
    tools = tag("div", *buttons, tag("output"), class_="tools no-script")
    size = _WIDTH.search(drawn)
    cls = "record" if picture.record else "wide" if size and float(size[1]) > _WIDE else None
    return tag(
        "figure",
        tag("h3", figure.title),
        tools if picture.record else "",  # a record may be higher than the screen
        _legend(picture.legend) if picture.legend else "",
        tag("div", drawn, class_="picture", tabindex="0", role="group", aria_label=figure.title),
        json_data(picture.record) if picture.record else "",
        "" if picture.record else tools,
        tag("figcaption", picture.caption, thinned) if picture.caption else "",
        tag("p", tag("a", f"All plots: {space.omitted} more", href=f"#figure-{figure.name}"))
        if space.omitted
        else figure_table(picture.table, figure.title)
        if picture.table
        else "",
        id=f"figure-{figure.name}{'-first' if space.omitted else ''}",
        class_=cls,
    )


def _legend(entries: Iterable[LegendEntry]) -> Markup:
    """Return the legend of a record, each entry with its key as a picture."""
    keys = []
    for entry in entries:
        cls, drawn = legend_key(entry, 0, 6)
        path = tag("path", class_=cls, d=drawn)
        key = tag("svg", path, class_="fig", viewBox="0 0 20 12", width="20", height="12", aria_hidden="true")
        keys.append(tag("li", key, entry.label))
    return tag("ul", *keys, class_="legend")


def _provenance(result: Result) -> Markup:
    """Return the attributes of a result and the list of all its arrays, folded."""
    attributes = {name: str(value) for name, value in result.attrs.items() if name not in ("scene", "status")}
    names = [name for name in _FIRST if name in attributes] + sorted(attributes.keys() - set(_FIRST))
    items = (join(tag("dt", name.replace("_", " ")), tag("dd", attributes[name])) for name in names)
    rows = array_rows(result)
    body = join(*(tag("tr", *(tag("td", value) for value in row)) for row in rows[:_ARRAYS]))
    more = f", of which the first {_ARRAYS} are listed" if len(rows) > _ARRAYS else ""
    table = grid(("path", "type", "axes", "units"), body, (False,) * 4)
    count = tag("span", f"({len(rows):,}{more})", class_="quiet")
    inside = scrolling(table, "Arrays of the file")
    arrays = tag("details", tag("summary", "Arrays of the file ", count), inside, class_="table")
    return join(tag("dl", *items), arrays)
