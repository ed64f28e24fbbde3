"""Pole–zero maps: certified error discs, hidden modes, lines of constant damping and natural frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Line, Marks, Note, Panel, Rule, chart
from dynid.report.plot.layers import Key, Layer

if TYPE_CHECKING:
    from dynid.result import Result

Complex = NDArray[np.complex128]
ROOT = "bond_graph/transfer_function"
#: A gap between magnitudes above which what lies below it has a panel of its own.
_FAR = 25.0
_DAMPING = (0.1, 0.3, 0.5, 0.7, 0.9)
_MOST = 400


def figures(result: Result) -> Iterator[Figure]:
    """Yield the map of every transfer function."""
    groups = dict.fromkeys(
        path.rpartition("/")[0]
        for path in result
        if path.startswith(ROOT) and path.endswith(("/poles", "/zeros"))
    )
    for group in groups:
        pair = group.removeprefix(f"{ROOT}/")
        name = f"poles-{pair.replace('/', '-')}"
        yield Figure(name, f"Poles and zeros of {_pair(pair)}", partial(_picture, result, group, name, pair))


def _pair(pair: str) -> str:
    output, _, source = pair.rpartition("/")
    return f"{output} / {source}"


def roots_of(result: Result, group: str, pair: str) -> list[tuple[str, Complex, NDArray[np.float64]]]:
    """Return poles, zeros and hidden modes with the bounds of their errors (NaN: none is known)."""
    found = []
    for what in ("pole", "zero"):
        if f"{group}/{what}s" in result:
            values = result[f"{group}/{what}s"].data
            path = f"{group}/{what}_error_bound"
            bounds = result[path].data if path in result else np.full(len(values), np.nan)
            found.append((what, values, bounds))
    path = f"bond_graph/properties/{pair}/hidden_modes"
    if path in result and len(result[path].data):
        values = result[path].data
        found.append(("hidden mode", values, np.full(len(values), np.nan)))
    return found


_SYMBOLS = {"pole": ("x", "s1"), "zero": ("ring", "s2"), "hidden mode": ("kite", "s4")}


def _picture(result: Result, group: str, name: str, pair: str) -> Picture:
    kinds = roots_of(result, group, pair)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (what, value.real, value.imag, abs(value), _damping(value), float(bound))
        for what, values, bounds in kinds
        for value, bound in zip(values.tolist(), bounds, strict=True)
    )
    columns = (
        "what",
        "real part (rad/s)",
        "imaginary part (rad/s)",
        "ω_n (rad/s)",
        "ζ",
        "error bound (rad/s)",
    )
    sizes = np.abs(np.concatenate([values for _, values, _ in kinds] or [np.zeros(0, complex)]))
    reaches = _reaches(sizes[np.isfinite(sizes)])
    panels = [_map(kinds, reach, title) for reach, title in reaches]
    title = f"Poles and zeros of {_pair(pair)}"
    about = _about(kinds, panels[0] if panels else None)
    keys = [Key(f"{what}s", _SYMBOLS[what][0], _SYMBOLS[what][1]) for what, values, _ in kinds if len(values)]
    svg = chart(
        name, title, [panels], about, width=480.0 if len(panels) == 1 else 860.0, height=360.0, keys=keys
    )
    return Picture(svg, about, Table(columns, rows))


def _damping(value: complex) -> float:
    return -value.real / abs(value) if abs(value) > 0 else math.nan


def _reaches(sizes: NDArray[np.float64]) -> list[tuple[float, str]]:
    """Return how far from the origin each panel reaches: all roots, and those before a wide gap."""
    positive = np.sort(sizes[sizes > 0])
    if not positive.size:
        return [(1.0, "")]
    whole = float(positive[-1])
    gaps = positive[1:] / positive[:-1]
    wide = np.flatnonzero(gaps > _FAR)
    if whole / positive[0] <= 2 * _FAR and not wide.size:
        return [(whole, "")]
    near = positive[wide[-1]] if wide.size else positive[positive <= whole / _FAR][-1]
    return [(whole, "all"), (float(near), "near the origin")]


def _map(kinds: Sequence[tuple[str, Complex, NDArray[np.float64]]], reach: float, title: str) -> Panel:
    """Return the panel of the roots within a distance from the origin."""
    within = [
        (what, values[np.abs(values) <= 1.001 * reach], bounds[np.abs(values) <= 1.001 * reach])
        for what, values, bounds in kinds
    ]
    every = np.concatenate([values for _, values, _ in within] or [np.zeros(0, complex)])
    layers: list[Layer] = [*_grid(reach)] if every.size and (every.real < 0).any() else []
    layers += [Rule(0.0, "", "frame"), Rule(0.0, "", "frame", upright=True)]
    margin = 0.06 * reach
    for what, values, bounds in within:
        symbol, cls = _SYMBOLS[what]
        distinct, counts = _counted(values[:_MOST])
        tips = [
            f"{what} {_complex(v)} rad/s" + (f", {c} times" if c > 1 else "")
            for v, c in zip(distinct, counts, strict=True)
        ]
        points = np.array(distinct, dtype=complex)
        layers.append(Marks(points.real, points.imag, "", cls, symbol, 8 if symbol == "kite" else 5, tips))
        layers += [
            Note(v.real, v.imag, f"×{c}", f"small {cls}", shift=(7.0, -5.0))
            for v, c in zip(distinct, counts, strict=True)
            if c > 1
        ]
        layers += [
            _disc(v, bound) for v, bound in zip(values.tolist(), bounds, strict=True) if bound > reach / 300
        ]
    room = 1.14 * np.append(every, [-margin, margin, 1j * margin, -1j * margin])
    across = Axis("real part (rad/s)", low=float(room.real.min()), high=float(room.real.max()))
    up = Axis("imaginary part (rad/s)", low=float(room.imag.min()), high=float(room.imag.max()))
    return Panel(across, up, layers, title, square=True)


def _disc(centre: complex, radius: float) -> Line:
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 73))
    around = centre + radius * turn
    return Line(around.real, around.imag, "", "s3 fine")


def _counted(values: Complex) -> tuple[list[complex], list[int]]:
    """Return the distinct values, and how often each is there."""
    found: dict[complex, int] = {}
    for value in values.tolist():
        found[value] = found.get(value, 0) + 1
    return list(found), list(found.values())


def _grid(reach: float) -> Iterator[Layer]:
    """Yield lines of constant damping ratio and circles of constant natural frequency, left of the axis."""
    for zeta in _DAMPING:
        end = 4 * reach * complex(-zeta, math.sqrt(1 - zeta * zeta))
        yield Line([end.real, 0, end.real], [end.imag, 0, -end.imag], "", "grid dashed", spans=False)
        at = 1.08 * reach * complex(-zeta, math.sqrt(1 - zeta * zeta))
        yield Note(at.real, at.imag, f"ζ {zeta:g}", "small muted", "end", (-3.0, 3.0))
    turn = np.exp(1j * np.linspace(0.5 * np.pi, 1.5 * np.pi, 61))
    for share in (0.25, 0.5, 0.75, 1.0):
        circle = share * reach * turn
        yield Line(circle.real, circle.imag, "", "grid", spans=False)


def _complex(value: complex) -> str:
    sign = "+" if value.imag >= 0 else "−"
    return f"{short(value.real)} {sign} {short(abs(value.imag))}j"


def _about(kinds: Sequence[tuple[str, Complex, NDArray[np.float64]]], panel: Panel | None) -> str:
    counts = ", ".join(f"{len(values)} {what}{'s' * (len(values) != 1)}" for what, values, _ in kinds)
    bounds = np.concatenate([b for _, _, b in kinds] or [np.zeros(0)])
    known = bounds[np.isfinite(bounds)]
    said = ""
    if known.size and panel is not None:
        drawn = any(isinstance(layer, Line) and layer.cls == "s3 fine" for layer in panel.layers)
        where = "drawn as discs" if drawn else "too small to be seen, they stand in the table"
        said = f" Certified error bounds, at most {short(float(known.max()), 2)} rad/s: {where}."
    return (
        f"{counts}; dashed lines are of constant damping ratio, circles of constant natural frequency.{said}"
    )
