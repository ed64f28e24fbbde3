"""Results as figures: drawn from what a result holds, without running anything again."""

from dynid.report.figure import Figure, Picture, Table
from dynid.report.registry import figures

__all__ = ["Figure", "Picture", "Table", "figures"]
