"""What moves where when a parameter grows, in columns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.numerals import root_text
from dynid.result import Result


def columns(result: Result, group: str) -> list[tuple[str, NDArray[Any]]]:
    """Return a title and the relative sensitivities of whatever moves: poles, zeros, gains."""
    found = []
    for name in ("pole", "zero"):
        moved = result[f"{group}/{name}_sensitivity_relative"].data
        for place, root in enumerate(result[f"{group}/{name}s"].data):
            if root.imag >= 0:
                found.append((f"{name} {root_text(root)}", moved[place]))
    for title, name in (("T(0)", "dc_gain"), ("T(∞)", "high_frequency_gain")):
        found.append((title, result[f"{group}/{name}_sensitivity_relative"].data))
    return [(title, moved) for title, moved in found if moved.any()]


def influence(columns: list[tuple[str, NDArray[Any]]]) -> NDArray[np.float64]:
    """Rank parameters by the largest part of any column that they are responsible for."""
    shares = []
    for _, moved in columns:
        sizes = np.where(np.isfinite(moved), np.abs(moved), 0.0)
        shares.append(sizes / (sizes.max() or 1.0))
    return np.asarray(np.max(shares, axis=0), dtype=float)


def cell(moved: complex) -> str:
    """Write by how much something moves."""
    if not np.isfinite(moved):
        return "∞"
    if isinstance(moved, complex | np.complexfloating) and moved.imag:
        return f"{moved.real:+.3g} {'+' if moved.imag > 0 else '-'} {abs(moved.imag):.3g}j"
    return f"{moved.real:+.3g}" if moved else "0"
