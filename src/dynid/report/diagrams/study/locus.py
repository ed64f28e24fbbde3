"""Root loci: poles and zeros while one parameter varies."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.report.diagrams.study.columns import Number, StudyNumbers
from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Marks, Panel, Rule, chart, thinned
from dynid.report.plot.layers import Layer

if TYPE_CHECKING:
    from dynid.result import Result

#: Most samples that are drawn.
POINTS = 600


def figures(result: Result) -> Iterator[Figure]:
    """Yield a locus for each array of poles, or of the zeros beside it, that was gathered."""
    numbers = StudyNumbers(result)
    if len(numbers.inputs) != 1:
        return
    own = numbers.inputs[0]
    groups = dict.fromkeys(
        path.rpartition("/")[0]
        for path in numbers.table.paths
        if path.endswith(("/poles", "/zeros")) and numbers.table.variable(path).dtype.kind == "c"
    )
    for group in groups:
        pair = group.removeprefix("bond_graph/transfer_function/")
        name = f"root-locus-{pair.replace('/', '-')}"
        yield Figure(
            name, f"Root locus of {pair} over {own.name}", partial(_picture, numbers, own, group, name)
        )


def _picture(numbers: StudyNumbers, own: Number, group: str, name: str) -> Picture:
    order = np.argsort(own.values, kind="stable")
    drawn = order[thinned(len(order), POINTS)]
    layers: list[Layer] = [Rule(0.0, "", "frame"), Rule(0.0, "", "frame", upright=True)]
    rows: list[tuple[Cell, ...]] = []
    for what, symbol, cls in (("poles", "x", "s1"), ("zeros", "ring", "s2")):
        path = f"{group}/{what}"
        if path not in numbers.table.paths:
            continue
        roots = _gathered(numbers.table.variable(path).data[drawn], own.values[drawn])
        tips = [
            f"{own.name} {short(p)}: {short(r.real)} {'−+'[r.imag >= 0]} {short(abs(r.imag))}j"
            for r, p in zip(roots.values.tolist(), roots.parameter, strict=True)
        ]
        x, y = roots.values.real, roots.values.imag
        layers.append(Marks(x, y, what, cls, symbol, 3.5, tips, roots.shade))
        rows += zip(roots.parameter, [what[:-1]] * len(tips), x.tolist(), y.tolist(), strict=True)
    ends = own.values[order[[0, -1]]]
    about = f"{own.path} from {short(float(ends[0]))} (faint) to {short(float(ends[1]))} (full)."
    parts = ("real part (rad/s)", "imaginary part (rad/s)")
    panel = Panel(Axis(parts[0]), Axis(parts[1]), layers, square=True)
    title = f"Root locus of {group.removeprefix('bond_graph/transfer_function/')} over {own.name}"
    svg = chart(name, title, [[panel]], about, width=560.0, height=420.0)
    return Picture(svg, about, Table((own.label, "what", *parts), tuple(rows[:1000])))


class _Roots(NamedTuple):
    """Roots of all samples in a row, with the parameter of each, and how full its mark is."""

    values: NDArray[np.complex128]
    parameter: list[float]
    shade: list[float]


def _gathered(roots: NDArray[np.complex128], parameter: NDArray[np.float64]) -> _Roots:
    """Return the roots (samples × roots) that are there."""
    kept = np.isfinite(roots)
    shade = np.linspace(0.25, 1.0, len(roots))
    each = (np.broadcast_to(column[:, None], roots.shape)[kept].tolist() for column in (parameter, shade))
    return _Roots(roots[kept], *each)
