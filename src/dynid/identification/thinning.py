"""What is stored of histories that are too long to look at.

Estimates use every sample. Of what they are along a record, beyond some hundred thousand rows only every
second, third, … is kept, the last one always: nothing shows more, and a result is read in a moment.
"""

from __future__ import annotations

from dynid.identification.filtering.filter import Pass

#: Rows of a history, at the most.
MOST_ROWS = 100_000


def kept(samples: int) -> slice:
    """Return which rows of a history over so many samples are kept."""
    every = max(1, -(-samples // MOST_ROWS))
    return slice((samples - 1) % every, None, every)


def thinned(history: Pass) -> Pass:
    """Return a pass with the rows that are kept; innovations stay whole."""
    rows = kept(len(history.logs))
    if rows.step == 1:
        return history
    names = ("logs", "deviations", "states", "state_deviations")
    # Copies: a view would keep all of it in memory.
    return history._replace(**{name: getattr(history, name)[rows].copy() for name in names})
