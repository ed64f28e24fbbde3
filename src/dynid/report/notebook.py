"""Results in notebooks: the screen as HTML, figures on axes of matplotlib, tables as data frames."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from html import escape
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.checks.comparison import word
from dynid.checks.expectations import axis_of
from dynid.errors import UsageError
from dynid.report.figure import figures
from dynid.report.plot import (
    Annotation,
    BandLayer,
    Bars,
    Chart,
    Curve,
    Heatmap,
    Layer,
    Markers,
    ReferenceLine,
    Subplot,
)
from dynid.report.scenes import frequency_unit
from dynid.result import Result, Variable
from dynid.store.reader import in_unit
from dynid.suggestions import did_you_mean, did_you_mean_path, shortened
from dynid.units import HERTZ, RADIANS

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Most rows of a table that are shown.
_ENTRIES = 12
#: Markers of matplotlib by the symbols of figures; hollow ones are not filled.
_SYMBOLS = {
    "o": "o",
    "ring": "o",
    "x": "x",
    "+": "+",
    "square": "s",
    "diamond": "D",
    "up": "^",
    "down": "v",
    "kite": "D",
}
_HOLLOW = ("ring", "kite")
#: Columns that stand first in a table.
_FIRST = ("omega", "frequency", "frequencies")
#: Share of rcParams["figure.figsize"] that each of several subplots has.
_SHARE = 0.55


def html(result: Result) -> str:
    """Return a result as HTML for a notebook: title, method, and each section of its report, folded."""
    from dynid.report.content import content
    from dynid.report.page.html import node, page_sections

    answer = content(result)
    parts = [f"<p><strong>{escape(result.title or result.kind)}</strong><br>{escape(answer.method)}</p>"]
    places = (page_sections(answer.sections, name) for name in ("answer", "details", "derivation"))
    for k, section in enumerate(chain.from_iterable(places)):
        blocks = "".join(node(block, section.title, most=_ENTRIES) for block in section.blocks)
        state = " open" if k == 0 else ""
        parts.append(f"<details{state}><summary>{escape(section.title)}</summary>{blocks}</details>")
    return f"<div>{''.join(parts)}</div>"


def axes(result: Result, name: str) -> Any:
    """Draw a figure of a result by matplotlib, in the style of its rcParams (`Result.plot`).

    Returns
    -------
    matplotlib.axes.Axes or numpy.ndarray of them
        The axes of a figure with one subplot; of several an array of shape (rows, columns), also where one of
        these is 1.

    Raises
    ------
    UsageError
        If there is no such figure, or it is a drawing without axes.
    """
    import matplotlib.pyplot as plt

    by_name = {figure.name: figure for figure in figures(result)}
    if name not in by_name:
        raise UsageError(
            f"the result has no figure '{name}'{_near_figure(name, by_name)}",
            remedy=f"It has {shortened([*by_name])}.",
        )
    chart = by_name[name].draw()
    if not isinstance(chart, Chart):
        raise UsageError(
            f"the figure '{name}' is a drawing without axes", remedy="Write it to a file: dynid plot."
        )
    rows = chart.rows
    longest = max(rows, key=len)
    across, down = plt.rcParams["figure.figsize"]
    figure, grid = plt.subplots(
        len(rows),
        len(longest),
        squeeze=False,
        layout="constrained",
        width_ratios=[plot.weight for plot in longest],
        figsize=(across * max(1, _SHARE * len(longest)), down * max(1, _SHARE * len(rows))),
    )
    figure.suptitle(by_name[name].title)
    entries = dict[str, Any]()
    for row, places in zip(rows, grid, strict=True):
        for plot, subaxes in zip(row, places, strict=False):
            _draw(plot, subaxes)
            handles, labels = subaxes.get_legend_handles_labels()
            entries |= dict(zip(labels, handles, strict=True))
        for empty in places[len(row) :]:
            empty.set_axis_off()
    if entries:  # above the axes, where it covers no curve
        figure.legend([*entries.values()], [*entries], loc="outside upper center", ncols=min(len(entries), 4))
    return grid[0, 0] if grid.size == 1 else grid


def _near_figure(name: str, names: Collection[str]) -> str:
    """Return a suggestion for a name of figures, also for a path or a beginning: poles of poles-m.f-F."""
    beginnings: dict[str, str] = {}
    for figure in names:
        parts = figure.split("-")
        for length in range(len(parts), 0, -1):
            beginnings.setdefault("-".join(parts[:length]), figure)
    word = {"frequency-response": "bode"}.get(short := _last(name).replace("_", "-"), short)
    if word not in beginnings:
        return did_you_mean(word, names) or did_you_mean(word, beginnings)
    return f"; did you mean '{beginnings[word]}'?"


def _draw(plot: Subplot, ax: Axes) -> None:
    for layer in plot.layers:
        _draw_layer(layer, ax)
    ax.set(xlabel=plot.x.label, ylabel=plot.y.label, title=plot.title)
    for axis, scale, ticks in (
        (plot.x, ax.set_xscale, ax.set_xticks),
        (plot.y, ax.set_yscale, ax.set_yticks),
    ):
        if axis.names:
            ticks(range(len(axis.names)), axis.names)
        else:
            scale("log" if axis.log else "linear")
    if plot.square:  # the view is widened in one direction
        x, y = plot.scales
        ax.update_datalim([(x.low, y.low), (x.high, y.high)])
        ax.autoscale_view()
        ax.set_aspect("equal", adjustable="datalim")
    else:
        ax.set(xlim=(plot.x.low, plot.x.high), ylim=(plot.y.low, plot.y.high))


def _draw_layer(layer: Layer, ax: Axes) -> None:
    from matplotlib.lines import Line2D

    series = re.search(r"\bs(\d)\b", layer.cls)
    colour = f"C{int(series[1]) - 1}" if series else "gray"
    style: dict[str, Any] = {"color": colour, "label": layer.label or None}
    line = "--" if "dash" in layer.cls else "-"
    match layer:
        case Curve() if not layer.spans:  # part of the grid, which the axes need not contain
            ax.add_artist(Line2D(np.asarray(layer.x), np.asarray(layer.y), color="lightgray", linewidth=0.6))
        case Curve():
            ax.plot(np.asarray(layer.x), np.asarray(layer.y), linestyle=line, **style)
        case BandLayer():
            x, low, high = (np.asarray(values) for values in (layer.x, layer.low, layer.high))
            ax.fill_between(x, low, high, alpha=0.25, **style)
        case Markers():
            face: dict[str, Any] = {"markerfacecolor": "none"} if layer.symbol in _HOLLOW else {}
            x, y = np.atleast_1d(layer.x), np.atleast_1d(layer.y)
            style |= {"linestyle": "none", "marker": _SYMBOLS[layer.symbol], "markersize": 2 * layer.size}
            ax.plot(x, y, **style, **face)
        case Bars():
            low, length = np.asarray(layer.low), np.asarray(layer.high) - np.asarray(layer.low)
            if layer.flat:
                ax.barh(layer.at, length, height=layer.thick, left=low, **style)
            else:
                ax.bar(layer.at, length, width=layer.thick, bottom=low, **style)
        case ReferenceLine():
            (ax.axvline if layer.upright else ax.axhline)(layer.value, linestyle=line, **style)
        case Annotation():
            side = {"start": "left", "middle": "center", "end": "right"}[layer.anchor]
            ax.text(layer.x, layer.y, layer.text, horizontalalignment=side, color="gray", clip_on=True)
        case Heatmap():
            _draw_heatmap(layer, ax)


def _draw_heatmap(layer: Heatmap, ax: Axes) -> None:
    columns, rows = layer.borders
    signs = {"cmap": "RdBu_r", "vmin": -layer.high} if layer.low < 0 else {"vmin": layer.low}
    cells = ax.pcolormesh(columns, rows, np.ma.masked_invalid(layer.values), vmax=layer.high, **signs)
    x, y = ((edges[1:] + edges[:-1]) / 2 for edges in (columns, rows))
    for row, texts in enumerate(layer.texts):
        for column, text in enumerate(texts):
            red, green, blue, _ = cells.to_rgba(layer.values[row, column])
            shade = "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
            ax.text(float(x[column]), float(y[row]), text, color=shade, ha="center", va="center")


def frame(result: Result, name: str) -> pandas.DataFrame:
    """Return a table of a result as a data frame of pandas (`Result.to_pandas`)."""
    try:
        import pandas
    except ImportError as error:
        raise UsageError(
            "data frames need pandas, which is not installed",
            remedy="Install it: pip install 'dynid[pandas]'.",
        ) from error
    late: dict[str, Any] = {}
    if result.kind == "study" and name.strip("/") == "study":
        numbers: dict[str, Any] = {}
        columns, units = _samples(result)
        index = pandas.Index(columns.pop("sample"), name="sample")
    else:
        path, unit = _path_of(result, name), frequency_unit(result)
        axis, arrays = _table_at(result, path)
        arrays = {key: in_unit(key, variable, unit) for key, variable in arrays.items()}
        if not axis:  # numbers, with different units
            rows = {_last(path): (variable.data.item(), variable.units) for path, variable in arrays.items()}
            table = pandas.DataFrame.from_dict(rows, "index", columns=["value", "unit"])
            table.attrs |= _approximate(arrays)
            return table.rename_axis("quantity")
        array_path, first = next(iter(arrays.items()))
        labels = axis_of(result, array_path, axis, first.shape[0])
        if labels.units == RADIANS.name and unit.factor != 1:
            labels = replace(labels, labels=labels.labels * unit.factor, units=unit.name)
        heading = _heading(axis, labels.units)
        index = pandas.Index(labels.labels, name=f"{heading} [{labels.units}]" if labels.units else axis)
        columns, units = _columns(result, arrays)
        single = {
            _last(key): in_unit(key, variable, unit)
            for key, variable in result.items()
            if _group(key) == path and not variable.dims
        }
        numbers = {key: variable.data.item() for key, variable in single.items()}
        units |= {key: variable.units for key, variable in single.items() if variable.units}
        late = _approximate({**arrays, **single})
    table = pandas.DataFrame(columns, index=index)
    table.attrs |= {"title": result.title, "units": units} | ({"numbers": numbers} if numbers else {}) | late
    return table


def _approximate(arrays: Mapping[str, Variable]) -> dict[str, Any]:
    """Return the attribute of a frame that has the names of what is approximate, with the reason of each."""
    reasons = {
        _last(key): variable.attrs["approximate"]
        for key, variable in arrays.items()
        if "approximate" in variable.attrs
    }
    return {"approximate": reasons} if reasons else {}


def _samples(result: Result) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the columns of a study, a row for each sample, as it is exported, and their units."""
    from dynid.study.analysis.table import StudyTable, flat_table

    table = flat_table(StudyTable(result), "study")
    types: dict[str, type] = {"integer": np.int64, "truth": np.bool_}
    columns = {}
    for column, parts in zip(table.fields, zip(*table.batches(), strict=True), strict=True):
        values = np.concatenate(parts)
        if column.kind in types and (values.dtype.kind != "f" or bool(np.isfinite(values).all())):
            values = values.astype(types[column.kind])
        columns[column.name] = values
    return columns, {column.name: column.units for column in table.fields if column.units}


def _heading(name: str, units: str) -> str:
    """Return the name of a column or an axis: omega is an angular frequency."""
    return "frequency" if (name, units) == ("omega", HERTZ.name) else name


def _last(path: str) -> str:
    return path.rpartition("/")[2]


def _group(path: str) -> str:
    return path.rpartition("/")[0]


def _path_of(result: Result, name: str) -> str:
    """Return the path of a group, of an array, or of an axis in a group, given whole or by its end."""
    groups = dict.fromkeys(map(_group, result))
    axes = [f"{_group(path)}/{variable.dims[0]}" for path, variable in result.items() if variable.dims]
    arrays, wanted = dict.fromkeys([*result, *axes]), name.strip("/")
    ends = [wanted] if wanted in groups or wanted in arrays else []
    ends = ends or [path for path in groups if path.endswith(f"/{wanted}")]
    ends = ends or [path for path in arrays if path.endswith(f"/{wanted}")]
    if len(ends) > 1:
        raise UsageError(f"several tables are called '{name}'", remedy=f"Name one: {shortened(ends)}.")
    if not ends:
        close = did_you_mean_path(wanted, arrays)
        raise UsageError(f"the result has no table '{name}'{close}", remedy=f"It has {shortened([*groups])}.")
    return ends[0]


def _table_at(result: Result, path: str) -> tuple[str, dict[str, Variable]]:
    """Return the axis of a table and its arrays by path; no axis for the single numbers of a group.

    The path is that of an array, of an axis in a group (all arrays along it), or of a group: the arrays along
    its modes, or along the only axis that does not label columns of others, else its single numbers.
    """
    along = {
        key: variable
        for key, variable in result.items()
        if _group(key) == _group(path) and variable.dims[:1] == (_last(path),)
    }
    if along:
        return _last(path), {key: along[key] for key in along if key != path} or along
    if path in result:
        return next(iter(result[path].dims), ""), {path: result[path]}
    below = {key: variable for key, variable in result.items() if _group(key) == path}
    arrays = {key: variable for key, variable in below.items() if variable.dims not in ((), (_last(key),))}
    if any(variable.dims == ("mode",) for variable in arrays.values()):  # not the shapes, a row for each DOF
        return "mode", {key: variable for key, variable in arrays.items() if variable.dims[0] == "mode"}
    labels = {dim for variable in arrays.values() for dim in variable.dims[1:]}
    axes = dict.fromkeys(variable.dims[0] for variable in arrays.values() if variable.dims[0] not in labels)
    if len(axes) == 1:
        (axis,) = axes
        return axis, {key: variable for key, variable in arrays.items() if variable.dims[0] == axis}
    numbers = {key: variable for key, variable in below.items() if not variable.dims}
    if not numbers:
        inner = dict.fromkeys(_group(key) for key in result if _group(key).startswith(f"{path}/"))
        names = [f"{path}/{axis}" for axis in axes] or [*inner] or [*below]
        raise UsageError(f"'{path}' has several tables", remedy=f"Name one: {shortened(names)}.")
    return "", numbers


def _columns(
    result: Result, arrays: Mapping[str, Variable]
) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the columns of arrays along their first axis, and their units.

    Labels of further axes stand in brackets. Estimates are followed by their 95 % intervals where these hold.
    """
    from dynid.report.content.identification import interval, is_rejected, linear_parameters

    columns: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {}
    for path, variable in sorted(arrays.items(), key=lambda item: (_last(item[0]) not in _FIRST, item[0])):
        name, data = _last(path), variable.data
        if data.dtype.names:
            columns |= {field: data[field] for field in data.dtype.names}
            continue
        axes = [
            axis_of(result, path, dim, length)
            for dim, length in zip(variable.dims[1:], data.shape[1:], strict=True)
        ]
        for entry_index in np.ndindex(data.shape[1:]):
            labels = [axis.labels[k] for axis, k in zip(axes, entry_index, strict=True)]
            texts = (label if isinstance(label, str) else word(label) for label in labels)
            heading = _heading(name, variable.units)
            entry = f"{heading}[{','.join(texts)}]" if axes else heading
            columns[entry] = data[(slice(None), *entry_index)]
            if variable.units:
                units[entry] = variable.units
    first = ("estimate", "standard_error")
    estimates: dict[str, NDArray[Any]] = {name: columns[name] for name in first if name in columns}
    if "identification/parameters/name" in arrays:
        ends: dict[str, NDArray[Any]] = {
            name: columns.pop(name) for name in ("low", "high") if name in columns
        }
        if not ends:  # a file of an earlier version
            bars = zip(*estimates.values(), linear_parameters(result), strict=True)
            low, high = np.transpose([interval(*bar) for bar in bars])
            ends = {"low": low, "high": high}
        if not is_rejected(result):
            estimates |= ends
    return estimates | columns, units
