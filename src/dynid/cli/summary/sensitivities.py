"""The screen of sensitivities: what moves where when a parameter grows by one per cent."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dynid.report.content.transfer_functions import influence, sensitivity_columns, sensitivity_text
from dynid.result import Result

#: Most parameters and roots that are listed.
_ROWS, _COLUMNS = 8, 4


def sensitivity_lines(result: Result, group: str) -> Iterable[str]:
    """Return a table of the most influential parameters of one channel."""
    if f"{group}/parameter" not in result:
        return
    every = sensitivity_columns(result, group)
    if not every:
        return
    yield "    a parameter larger by 1 % moves"
    shown = every[:_COLUMNS]
    widths = [max(len(title), 20) for title, _ in shown]
    titles = "  ".join(title.rjust(width) for (title, _), width in zip(shown, widths, strict=True))
    names = result[f"{group}/parameter"].data
    left = max(len(str(name)) for name in names)
    yield f"      {'':{left}}  {titles}"
    weight = influence(every)
    order = [place for place in np.argsort(-weight, kind="stable") if weight[place]]
    for place in order[:_ROWS]:
        cells = "  ".join(
            sensitivity_text(moved[place] / 100).rjust(width)
            for (_, moved), width in zip(shown, widths, strict=True)
        )
        yield f"      {names[place]!s:{left}}  {cells}"
    if len(every) > _COLUMNS or len(order) > _ROWS:
        yield "      … more in the file"
