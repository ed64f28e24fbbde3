"""Which figures a result has. Who adds a figure adds a family here.

A family is a module with a function `figures(result)` that yields `Figure`s; it is imported only for
results that it has something to show of, and a figure is drawn only when somebody looks at it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from dynid.errors import DynidError
from dynid.report.figure import Figure, Picture

if TYPE_CHECKING:
    from dynid.result import Result

When = Callable[["Result"], bool]


def kind(*names: str) -> When:
    """Tell that a family applies to results of scenes of some kinds."""
    return lambda result: result.kind in names


def holds(*beginnings: str) -> When:
    """Tell that a family applies to results with an array whose path starts so."""
    return lambda result: any(path.startswith(beginnings) for path in result)


def with_scene(when: When) -> When:
    """Tell that a family applies where another condition holds and the result bears its scene's text."""
    return lambda result: bool(result.attrs.get("scene")) and when(result)


@dataclass(frozen=True)
class Family:
    """A kind of figure.

    Parameters
    ----------
    module
        Where its function `figures(result)` is.
    when
        Whether a result may have such figures.
    """

    module: str
    when: When


FREQUENCY_RESPONSES = (
    "bond_graph/frequency_response/",
    "structure/frequency_response/",
    "bond_graph/port/frequency_response/",
)

#: In the order in which a page shows them.
FAMILIES: tuple[Family, ...] = (
    Family("dynid.report.drawing.graph", with_scene(kind("bond-graph"))),
    Family("dynid.report.drawing.strip", with_scene(holds("bond_graph/reduction/steps"))),
    Family("dynid.report.drawing.prototype", holds("bond_graph/reduction/prototype", "bond_graph/port/")),
    Family("dynid.report.drawing.structure", with_scene(kind("identification", "reduction"))),
    Family("dynid.report.drawing.equivalents", holds("bond_graph/port/prototype")),
    Family("dynid.report.diagrams.bode", holds(*FREQUENCY_RESPONSES)),
    Family("dynid.report.diagrams.poles", holds("bond_graph/transfer_function/")),
    Family("dynid.report.diagrams.responses", holds("bond_graph/time_response/", "structure/time_response/")),
    Family("dynid.report.diagrams.estimates", holds("identification/parameters/")),
    Family(
        "dynid.report.diagrams.prediction",
        holds("identification/measurement/", "identification/diagnostics/"),
    ),
    Family(
        "dynid.report.diagrams.histories",
        holds("identification/history/", "identification/first_pass/", "identification/states/"),
    ),
    Family("dynid.report.diagrams.reduction", holds("reduction/method")),
    Family("dynid.report.diagrams.plan", holds("plan/")),
    Family("dynid.report.diagrams.shapes", with_scene(holds("structure/modes/shape"))),
    Family("dynid.report.diagrams.precision", holds("bench/", "accuracy/")),
    Family("dynid.report.diagrams.study.samples", kind("study")),
    Family("dynid.report.diagrams.study.influences", kind("study")),
    Family("dynid.report.diagrams.study.locus", kind("study")),
    Family("dynid.report.diagrams.port", holds("bond_graph/port/performance/")),
)


def figures(result: Result) -> list[Figure]:
    """Return the figures that a result has, none of them drawn yet.

    Parameters
    ----------
    result
        Of a run, or read back from its file.

    Returns
    -------
    list of Figure
        Their names are unique.
    """
    found: dict[str, Figure] = {}
    for family in FAMILIES:
        if family.when(result):
            for figure in _of(family, result):
                if figure.name in found:
                    raise ValueError(f"two figures are called '{figure.name}'")
                found[figure.name] = figure
    return list(found.values())


def _of(family: Family, result: Result) -> list[Figure]:
    """Return the figures of a family; where it cannot even list them, one that says why instead."""
    build: Callable[[Result], Iterable[Figure]] = import_module(family.module).figures
    try:
        return list(build(result))
    except DynidError as error:
        name, problem = family.module.rpartition(".")[2], error

        def fail() -> Picture:
            raise problem

        return [Figure(name, f"Figure: {name}", fail)]
