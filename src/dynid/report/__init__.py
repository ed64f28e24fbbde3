"""Reports of results: figures and pages, drawn from the result without running anything again."""

from dynid.report.figure import Figure, FigureTable, Picture
from dynid.report.registry import figures

__all__ = ["Figure", "FigureTable", "Picture", "figures"]
