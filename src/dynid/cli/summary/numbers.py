"""Numbers as a reader wants them: as many digits as mean something."""

from __future__ import annotations

import math


def quantity(value: float, error: float | None = None) -> str:
    """Write a number; with an error, to the error's second digit, thousands apart.

    Parameters
    ----------
    value
        The number.
    error
        Its standard error; absent: four significant digits.
    """
    if not math.isfinite(value):
        return "-" if math.isnan(value) else ("∞" if value > 0 else "-∞")
    size = abs(value)
    if size and not 1e-4 <= size < 1e7:
        return f"{value:.4g}"
    step = error / 10 if error else size / 1e3
    decimals = max(0, min(6, -math.floor(math.log10(step)))) if step else 0
    return f"{value:,.{decimals}f}".replace(",", " ")
