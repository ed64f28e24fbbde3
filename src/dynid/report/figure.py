"""Figures of a result: a picture drawn on demand, as SVG, PNG and PDF files; and the registry of families."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dynid.errors import DynidError, UsageError
from dynid.report.svg import COLOURS, resolved
from dynid.result import Result

CellValue = str | bool | int | float | complex

#: Most rows of a table; the file of the result has all of them.
MOST_ROWS = 200


@dataclass(frozen=True)
class FigureTable:
    """The numbers of a figure as a table: headings with units, rows, and a note on rows that it omits."""

    columns: tuple[str, ...]
    rows: tuple[tuple[CellValue, ...], ...]
    note: str = ""


class LegendEntry(NamedTuple):
    """An entry of the legend: its label, its symbol (`line`, `band` or that of markers) and its classes."""

    label: str
    symbol: str
    cls: str


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn: an SVG document, which may also be part of a page; caption; table, if any.

    On pages, records over one axis have their samples as data of a `record`, and their legend beside them.
    """

    svg: str
    caption: str = ""
    table: FigureTable | None = None
    record: Mapping[str, Any] = field(default_factory=dict)
    legend: Sequence[LegendEntry] = ()

    def picture(self, name: str, title: str) -> Picture:  # noqa: ARG002 - they are drawn in it
        """Return it as it is."""
        return self


class _Drawable(Protocol):
    """A picture, or a chart, which is drawn under the name and the title of its figure."""

    def picture(self, name: str, title: str) -> Picture:
        """Return it drawn."""


@dataclass(frozen=True)
class Figure:
    """A figure of a result.

    Its name is unique within the result, and a valid file name: letters, digits, `-`, `_` and `.`. `draw`
    draws it, or returns the chart to draw. A page folds a `derivation`, which shows how a result was derived.
    """

    name: str
    title: str
    draw: Callable[[], _Drawable] = field(repr=False)
    derivation: bool = field(default=False, repr=False)

    @cached_property
    def picture(self) -> Picture:
        """The picture, drawn once."""
        return self.draw().picture(self.name, self.title)

    @property
    def svg(self) -> str:
        """The picture as SVG."""
        return self.picture.svg

    @property
    def caption(self) -> str:
        """The caption."""
        return self.picture.caption

    @property
    def table(self) -> FigureTable | None:
        """The table."""
        return self.picture.table


def evenly_spaced(count: int, limit: int) -> list[int]:
    """Return the indices of at most so many of `count` rows, evenly spaced, first and last included."""
    if count <= limit:
        return list(range(count))
    return sorted({round(index * (count - 1) / (limit - 1)) for index in range(limit)})


def table_of(columns: Mapping[str, ArrayLike], limit: int = MOST_ROWS) -> FigureTable:
    """Return columns of equal length as a table of at most `limit` rows, with unrounded values."""
    arrays = [np.asarray(values) for values in columns.values()]
    count = len(arrays[0]) if arrays else 0
    shown = evenly_spaced(count, limit)
    cells = ((list(map(str, v)) if v.dtype.kind == "O" else v.tolist()) for v in (a[shown] for a in arrays))
    note = f"{len(shown)} of {count:,} rows, evenly spaced; the file has all" if len(shown) < count else ""
    return FigureTable(tuple(columns), tuple(zip(*cells, strict=True)), note)


#: Pixels of a PNG per inch; the unit of a figure is 1/96 inch.
_PPI = 192
_HEAD = re.compile(r'<svg\b[^>]*\bviewBox="([^"]*)"[^>]*>')
#: A page of the size of the figure, without a date, so that equal figures are equal bytes.
_PAGE = b"""#set document(date: none)
#set page(width: auto, height: auto, margin: 0pt, fill: white)
#image(bytes(sys.inputs.svg), format: "svg")
"""


def as_file(svg: str, form: str) -> bytes:
    """Return a figure as the content of an ``svg``, ``png`` or ``pdf`` file, in light colours on white.

    PNG and PDF use the fonts of the machine.

    Raises
    ------
    UsageError
        Where typst, which writes PNG and PDF, is not installed.
    """
    alone = standalone(svg)
    if form == "svg":
        return alone.encode()
    try:
        import typst
    except ImportError:
        problem = f"figures as {form.upper()} need the package typst"
        raise UsageError(problem, remedy="Install it with: pip install 'dynid[figures]'") from None
    inputs = {"svg": alone}
    if form == "pdf":
        return bytes(typst.compile(_PAGE, format="pdf", sys_inputs=inputs))
    return bytes(typst.compile(_PAGE, format="png", ppi=_PPI, sys_inputs=inputs))


def standalone(svg: str) -> str:
    """Return a figure as an SVG document with an XML declaration, on white, without CSS variables."""
    plain = resolved(svg).lstrip()
    head = _HEAD.match(plain)
    if head is None:
        raise ValueError("a figure starts with <svg …> and has a viewBox")
    x, y, width, height = head[1].split()
    paper = COLOURS["paper"][0]
    ground = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{paper}"/>'
    end = head.end()
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{plain[:end]}{ground}{plain[end:]}'


@dataclass(frozen=True)
class _FigureFamily:
    """Figures of one kind, and the condition on results that have them; all given parts must hold.

    `function` yields them, as `module:name`. The result is of one of `kinds`, has a path that begins with one
    of `paths`, and holds the text of its `scene`, in which the word `key` stands.
    """

    function: str
    kinds: tuple[str, ...] = ()
    paths: tuple[str, ...] = ()
    scene: bool = False
    key: str = ""

    def applies(self, result: Result) -> bool:
        text = str(result.attrs.get("scene") or "")
        if (self.scene and not text) or self.key not in text:
            return False
        if self.kinds and result.kind not in self.kinds:
            return False
        return not self.paths or any(path.startswith(self.paths) for path in result)


_FREQUENCY_RESPONSES = (
    "bond_graph/frequency_response/",
    "structure/frequency_response/",
    "bond_graph/port/frequency_response/",
)
_DRAWING, _DIAGRAMS = "dynid.report.drawing", "dynid.report.diagrams"

#: In the order in which a page shows them.
FAMILIES: tuple[_FigureFamily, ...] = (
    _FigureFamily(
        f"{_DRAWING}.bond_graph:figures", kinds=("bond-graph", "identification"), scene=True, key="graph"
    ),
    _FigureFamily(f"{_DRAWING}.bond_graph:realisations", paths=("synthesis/form",)),
    _FigureFamily(
        f"{_DRAWING}.bond_graph:reduction_strips", paths=("bond_graph/reduction/steps",), scene=True
    ),
    _FigureFamily(
        f"{_DRAWING}.prototype:prototypes", paths=("bond_graph/reduction/prototype", "bond_graph/port/")
    ),
    _FigureFamily(f"{_DRAWING}.structure:figures", kinds=("identification", "reduction"), scene=True),
    _FigureFamily(f"{_DRAWING}.space:figures", paths=("structure/geometry/",), scene=True),
    _FigureFamily(f"{_DRAWING}.prototype:equivalents", paths=("bond_graph/port/prototype",)),
    _FigureFamily(f"{_DIAGRAMS}.responses:designed_responses", paths=("bond_graph/design/",)),
    _FigureFamily(
        f"{_DIAGRAMS}.responses:time_responses",
        paths=("bond_graph/time_response/", "structure/time_response/"),
    ),
    _FigureFamily(f"{_DIAGRAMS}.responses:steady_states", paths=("response/",)),
    _FigureFamily(f"{_DIAGRAMS}.responses:figures", paths=_FREQUENCY_RESPONSES),
    _FigureFamily(f"{_DIAGRAMS}.poles:figures", paths=("bond_graph/transfer_function/",)),
    _FigureFamily(f"{_DIAGRAMS}.poles:loops", paths=("bond_graph/margins/",)),
    _FigureFamily(
        f"{_DIAGRAMS}.identification:joint_figures", paths=("structure/joints/", "identification/joints/")
    ),
    _FigureFamily(f"{_DIAGRAMS}.identification:figures", paths=("identification/parameters/",)),
    _FigureFamily(f"{_DIAGRAMS}.modes:figures", paths=("identification/modes/",)),
    _FigureFamily(
        f"{_DIAGRAMS}.identification:predictions",
        paths=("identification/measurement/", "identification/diagnostics/"),
    ),
    _FigureFamily(
        f"{_DIAGRAMS}.identification:histories",
        paths=("identification/history/", "identification/first_pass/", "identification/states/"),
    ),
    _FigureFamily(
        f"{_DIAGRAMS}.responses:identified_responses", paths=("identification/derived/frequency_response/",)
    ),
    _FigureFamily(f"{_DIAGRAMS}.reduction:figures", paths=("reduction/method",)),
    _FigureFamily(f"{_DIAGRAMS}.modal_analysis:figures", kinds=("modal-analysis",)),
    _FigureFamily(f"{_DIAGRAMS}.plan:figures", paths=("plan/",)),
    _FigureFamily(f"{_DIAGRAMS}.modes:measured_shapes", paths=("structure/geometry/shape_sensor",)),
    _FigureFamily(f"{_DIAGRAMS}.modes:mode_shapes", paths=("structure/modes/shape",), scene=True),
    _FigureFamily(f"{_DIAGRAMS}.rotors:figures", paths=("structure/campbell/omega",)),
    _FigureFamily(f"{_DIAGRAMS}.work_precision:figures", paths=("bench/", "accuracy/")),
    _FigureFamily(f"{_DIAGRAMS}.study_samples:figures", kinds=("study",)),
    _FigureFamily(f"{_DIAGRAMS}.study_influence:figures", kinds=("study",)),
    _FigureFamily(f"{_DIAGRAMS}.poles:root_loci", kinds=("study",)),
    _FigureFamily(f"{_DRAWING}.prototype:performance", paths=("bond_graph/port/performance/",)),
)


def figures(result: Result) -> list[Figure]:
    """Return the figures of a result, none of them drawn yet, with unique names.

    A family that cannot list its figures is one figure, which raises the error when it is drawn.
    """
    by_name: dict[str, Figure] = {}
    for family in FAMILIES:
        for figure in _figures_of(family, result) if family.applies(result) else ():
            if figure.name in by_name:
                raise ValueError(f"two figures are called '{figure.name}'")
            by_name[figure.name] = figure
    return list(by_name.values())


#: Beginnings of the names of the figures that answer a kind of scene, the most important first.
_LEADING = {
    "bond-graph": (
        "design",
        "bode",
        "loop-nyquist",
        "loop-bode",
        "poles",
        "time-response",
        "nyquist",
        "bond-graph",
    ),
    "identification": (
        "estimates",
        "joint-forces",
        "fit",
        "prediction",
        "measured-modes",
        "correlation",
        "steady-states",
        "campbell",
        "bode",
        "time-response",
        "modes",
        "structure",
    ),
    "reduction": ("reduction-frf", "reduction-frequencies", "mac"),
    "study": ("map", "course", "distributions", "root-locus", "tornado", "scatter"),
    "synthesis": ("bond-graph",),
    "modal-analysis": ("synthesis", "stabilisation", "modal-shapes"),
    "plan": ("sensors", "excitation"),
}
#: Most figures that stand beside the answer.
_LEADERS = 3


def leading(kind: str, drawable: Sequence[Figure]) -> list[Figure]:
    """Return the figures that answer a result of a kind: at most three, one of each family."""
    leaders = []
    for start in _LEADING.get(kind, ("",)):
        leaders += [figure for figure in drawable if figure.name.startswith(start)][:1]
    return leaders[:_LEADERS]


def _figures_of(family: _FigureFamily, result: Result) -> list[Figure]:
    module, _, name = family.function.partition(":")
    build: Callable[[Result], Iterable[Figure]] = getattr(import_module(module), name)
    try:
        return list(build(result))
    except DynidError as error:
        name, problem = module.rpartition(".")[2], error

        def fail() -> Picture:
            raise problem

        return [Figure(name, f"Figure: {name}", fail)]
