"""Reports of results: figures and pages, drawn from the result without running anything again; warnings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid.report.figure import Figure, FigureTable, Picture, figures
    from dynid.result import Result

_OF_FIGURES = ("Figure", "FigureTable", "Picture", "figures")
__all__ = ["Figure", "FigureTable", "Picture", "figures", "warnings", "without_warnings"]

#: Arrays of warnings.
_OF_GRAPH = ("bond_graph/warnings", "bond_graph/design/warnings", "modal/warnings")
_OF_IDENTIFICATION = "identification/diagnostics/warnings"


def __getattr__(name: str) -> Any:
    """Import figures at their first use: screens need the text of a report alone."""
    if name not in _OF_FIGURES:
        raise AttributeError(f"module 'dynid.report' has no attribute {name!r}")
    from dynid.report import figure

    return getattr(figure, name)


def warnings(result: Result) -> list[str]:
    """Return what users must know of a result: warnings of its graph, nodes and identification."""
    of_graph = [str(text) for path in _OF_GRAPH if path in result for text in result[path].data]
    of_nodes = result.group_attrs.get("structure/nodes", {}).get("doubt")
    said = [*of_graph, *([] if of_nodes is None else [str(of_nodes)])]
    if "identification/diagnostics/converged" not in result:
        return said
    from dynid.report.content.identification import cautions

    return [*said, *cautions(result)]


def without_warnings(result: Result) -> Result:
    """Return a result for a screen beside which its `warnings` are printed."""
    shown = result
    for path in (*_OF_GRAPH, _OF_IDENTIFICATION):
        shown = shown.without(path)
    shown.group_attrs.get("structure/nodes", {}).pop("doubt", None)
    return shown
