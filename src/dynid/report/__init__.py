"""Reports of results: figures and pages, drawn from the result without running anything again."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid.report.figure import Figure, FigureTable, Picture, figures

__all__ = ["Figure", "FigureTable", "Picture", "figures"]


def __getattr__(name: str) -> Any:
    """Import figures at their first use: screens need the text of a report alone."""
    if name not in __all__:
        raise AttributeError(f"module 'dynid.report' has no attribute {name!r}")
    from dynid.report import figure

    return getattr(figure, name)
