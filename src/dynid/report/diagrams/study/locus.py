"""Root loci: poles and zeros while one parameter varies."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

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
        roots = numbers.table.variable(path).data[drawn]
        parameter = np.repeat(own.values[drawn], roots.shape[1])
        shade = np.repeat(np.linspace(0.25, 1.0, len(drawn)), roots.shape[1])
        flat = roots.reshape(-1)
        kept = np.isfinite(flat)
        flat, parameter, shade = flat[kept], parameter[kept], shade[kept]
        tips = [
            f"{own.name} {short(float(p))}: {short(r.real)} {'−+'[r.imag >= 0]} {short(abs(r.imag))}j"
            for p, r in zip(parameter, flat.tolist(), strict=True)
        ]
        layers.append(Marks(flat.real, flat.imag, what, cls, symbol, 3.5, tips, shade.tolist()))
        rows += [
            (own_value, what[:-1], r.real, r.imag)
            for own_value, r in zip(parameter.tolist(), flat.tolist(), strict=True)
        ]
    ends = own.values[order[[0, -1]]]
    about = f"{own.path} from {short(float(ends[0]))} (faint) to {short(float(ends[1]))} (full)."
    panel = Panel(Axis("real part (rad/s)"), Axis("imaginary part (rad/s)"), layers, square=True)
    title = f"Root locus of {group.removeprefix('bond_graph/transfer_function/')} over {own.name}"
    svg = chart(name, title, [[panel]], about, width=560.0, height=420.0)
    return Picture(
        svg,
        about,
        Table((own.label, "what", "real part (rad/s)", "imaginary part (rad/s)"), tuple(rows[:1000])),
    )
