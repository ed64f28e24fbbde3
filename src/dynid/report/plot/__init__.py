"""Plots as SVG: axes with round ticks, lines thinned out to what a picture can show, legends beside the data.

A plot is declared (`Panel`s of layers on `Axis`es) and drawn by `chart`. Every panel is a group of class
`plot` that tells a script what its pixels mean: `data-box` (left, top, width, height), `data-x` and `data-y`
(`lin` or `log`, then the values at the two ends), `data-x-label`, `data-y-label`; lines bear a `data-name`.
"""

from dynid.report.plot.axis import Axis
from dynid.report.plot.cells import Cells
from dynid.report.plot.chart import chart
from dynid.report.plot.layers import Band, Bars, Line, Marks, Note, Rule
from dynid.report.plot.panel import Panel
from dynid.report.plot.tables import MOST_ROWS, listed, thinned

__all__ = [
    "MOST_ROWS",
    "Axis",
    "Band",
    "Bars",
    "Cells",
    "Line",
    "Marks",
    "Note",
    "Panel",
    "Rule",
    "chart",
    "listed",
    "thinned",
]
