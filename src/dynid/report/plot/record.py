"""Records for pages: the samples of subplots over one axis, quantised, from which a script draws a window."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array
from dynid.report.plot.layers import BandLayer, Curve, Layer, Markers, ReferenceLine, symbol_class

#: Steps of a quantised array over its range, in 16 bits; the code above them stands for no value.
_STEPS, _NO_VALUE = 65_534, 65_535
#: Deviation from equal distances, relative to one, up to which samples of x are stored by their ends alone.
_EVEN = 1e-3
#: Least number of values of a figure, whatever a page has left for it.
_LEAST = 20_000


def thinning(layers: Iterable[Layer], space: int) -> tuple[int, int]:
    """Return of how many samples a record keeps the extremes, and how many values: about `space`."""
    count = sum(map(_size, layers))
    every = math.ceil(count / max(space, _LEAST)) or 1
    return every, count // every


def plot_layers(plots: Sequence[Sequence[Layer]], every: int, logs: Sequence[tuple[bool, bool]]) -> list[Any]:
    """Return the layers of plots for a script; `logs`: of each plot, if x and y are logarithmic.

    A difference of two curves stands there as the positions (plot, layer) of these.
    """
    places, stored = dict[int, tuple[int, int]](), list[list[dict[str, Any]]]()
    for plot, (layers, (log_x, log_y)) in enumerate(zip(plots, logs, strict=True)):
        stored.append([])
        for layer in layers:
            if (data := layer_data(layer, log_x, log_y, every)) is not None:
                places[id(layer)] = plot, len(stored[-1])
                stored[-1].append(data)
    curves = (layer for layers in plots for layer in layers if isinstance(layer, Curve) and layer.difference)
    for curve in curves if every == 1 else ():
        terms = [places.get(id(term)) for term in curve.difference or ()]
        if None not in terms:
            plot, index = places[id(curve)]
            data = stored[plot][index]
            stored[plot][index] = {"cls": data["cls"], "name": data["name"], "difference": terms}
    return stored


def _size(layer: Layer) -> int:
    match layer:
        case Curve() | Markers():
            return np.size(layer.y)
        case BandLayer():
            return 2 * np.size(layer.low)
    return 0


def layer_data(layer: Layer, log_x: bool, log_y: bool, every: int) -> dict[str, Any] | None:
    """Return what a script needs to draw a layer: the extremes of `every` samples; None: nothing."""
    match layer:
        case ReferenceLine() if math.isfinite(layer.value):
            return {"cls": layer.cls, "x" if layer.upright else "y": layer.value}
        case BandLayer():
            x, low = _extremes(layer.x, layer.low, every)
            _, high = _extremes(layer.x, layer.high, every)
            ends = {"y": _quantised(low, log_y), "high": _quantised(high, log_y)}
            return {"cls": f"{layer.cls} band", "x": _spaced(x, log_x), **ends}
        case Curve() | Markers():
            x, y = _extremes(layer.x, layer.y, every)
            series = {"x": _spaced(x, log_x), "y": _quantised(y, log_y)}
            if isinstance(layer, Curve):
                return {"cls": layer.cls, "name": layer.name or layer.label, **series}
            name = layer.tips[0] if len(layer.tips) == 1 else layer.label
            return {"cls": symbol_class(layer.symbol, layer.cls), "name": name, "r": layer.size, **series}
    return None


def _extremes(x: ArrayLike, y: ArrayLike, every: int) -> tuple[Array, Array]:
    """Return least and greatest value of every 2 x `every` samples, at two positions of theirs."""
    at, values = np.atleast_1d(np.asarray(x, dtype=float)), np.atleast_1d(np.asarray(y, dtype=float))
    if every == 1 or len(values) <= 2 * every:
        return at, values
    starts = np.arange(0, len(values), 2 * every)
    low, high = (end.reduceat(values, starts) for end in (np.fmin, np.fmax))
    positions = np.minimum(np.column_stack([starts, starts + every]).ravel(), len(values) - 1)
    return at[positions], np.column_stack([low, high]).ravel()


def _spaced(x: Array, log: bool) -> dict[str, Any]:
    """Return samples of x by their ends where they are evenly spaced on their axis, else as numbers."""
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.log(x) if log else x
    step = (place[-1] - place[0]) / max(len(x) - 1, 1)
    even = place[0] + step * np.arange(len(x))
    if np.isfinite(step) and np.all(np.abs(place - even) <= _EVEN * abs(step)):
        return {"from": float(x[0]), "to": float(x[-1]), "count": len(x)}
    return {"numbers": b64encode(x.astype("<f4").tobytes()).decode()}


def _quantised(values: Array, log: bool) -> dict[str, Any]:
    """Return values in 16 bits between the least and the greatest, of a logarithmic axis their logarithms."""
    with np.errstate(divide="ignore", invalid="ignore"):
        data = np.log(values) if log else values
    finite = np.isfinite(data)
    low, high = (float(data[finite].min()), float(data[finite].max())) if finite.any() else (0.0, 0.0)
    codes = np.full(len(data), _NO_VALUE, dtype="<u2")
    codes[finite] = np.rint((data[finite] - low) / ((high - low) or 1.0) * _STEPS)
    return {"low": low, "high": high, "codes": b64encode(codes.tobytes()).decode()}
