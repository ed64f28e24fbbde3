"""The screen of sensitivities: what moves where when a parameter grows by one per cent."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.numerals import root_text
from dynid.result import Result

#: Most parameters and roots that are listed.
_ROWS, _COLUMNS = 8, 4


def sensitivity_lines(result: Result, group: str) -> Iterable[str]:
    """Return a table of the most influential parameters of one channel."""
    if f"{group}/parameter" not in result:
        return
    columns = _columns(result, group)
    if not columns:
        return
    yield "    a parameter larger by 1 % moves"
    shown = columns[:_COLUMNS]
    widths = [max(len(title), 20) for title, _ in shown]
    titles = "  ".join(title.rjust(width) for (title, _), width in zip(shown, widths, strict=True))
    names = result[f"{group}/parameter"].data
    left = max(len(str(name)) for name in names)
    yield f"      {'':{left}}  {titles}"
    influence = _influence(columns)
    order = [place for place in np.argsort(-influence, kind="stable") if influence[place]]
    for place in order[:_ROWS]:
        cells = "  ".join(
            _cell(moved[place] / 100).rjust(width) for (_, moved), width in zip(shown, widths, strict=True)
        )
        yield f"      {names[place]!s:{left}}  {cells}"
    if len(columns) > _COLUMNS or len(order) > _ROWS:
        yield "      … more in the file"


def _columns(result: Result, group: str) -> list[tuple[str, NDArray[Any]]]:
    """Return a title and the relative sensitivities of whatever moves: poles, zeros, gains."""
    columns = []
    for name in ("pole", "zero"):
        moved = result[f"{group}/{name}_sensitivity_relative"].data
        for place, root in enumerate(result[f"{group}/{name}s"].data):
            if root.imag >= 0:
                columns.append((f"{name} {root_text(root)}", moved[place]))
    for title, name in (("T(0)", "dc_gain"), ("T(∞)", "high_frequency_gain")):
        columns.append((title, result[f"{group}/{name}_sensitivity_relative"].data))
    return [(title, moved) for title, moved in columns if moved.any()]


def _influence(columns: list[tuple[str, NDArray[Any]]]) -> NDArray[np.float64]:
    """Rank parameters by the largest part of any column that they are responsible for."""
    shares = []
    for _, moved in columns:
        sizes = np.where(np.isfinite(moved), np.abs(moved), 0.0)
        shares.append(sizes / (sizes.max() or 1.0))
    return np.asarray(np.max(shares, axis=0), dtype=float)


def _cell(moved: complex) -> str:
    if not np.isfinite(moved):
        return "∞"
    if isinstance(moved, complex | np.complexfloating) and moved.imag:
        return f"{moved.real:+.3g} {'+' if moved.imag > 0 else '-'} {abs(moved.imag):.3g}j"
    return f"{moved.real:+.3g}" if moved else "0"
