"""Plots as SVG: axes with ticks at round values, decimated curves, heat maps, legends beside the data.

A plot is declared (`Subplot`s of layers on `PlotAxis`es) and drawn by `Chart`. Every subplot is a group of
class `plot` that tells a script the meaning of its pixels: `data-box` (left, top, width, height), `data-x`
and `data-y` (`lin` or `log`, then the values at the two ends), `data-x-label`, `data-y-label`; curves have a
`data-name`.
"""

from dynid.report.figure import LegendEntry
from dynid.report.plot.axis import PlotAxis
from dynid.report.plot.chart import Chart, Subplot, in_rows
from dynid.report.plot.heatmap import Heatmap, Matrix, matrix_chart
from dynid.report.plot.layers import (
    Annotation,
    BandLayer,
    Bars,
    Curve,
    Layer,
    Markers,
    ReferenceLine,
    series_class,
)
from dynid.report.plot.parallel import parallel_coordinates

__all__ = [
    "Annotation",
    "BandLayer",
    "Bars",
    "Chart",
    "Curve",
    "Heatmap",
    "Layer",
    "LegendEntry",
    "Markers",
    "Matrix",
    "PlotAxis",
    "ReferenceLine",
    "Subplot",
    "in_rows",
    "matrix_chart",
    "parallel_coordinates",
    "series_class",
]
