"""How many samples go to a worker at a time."""

from __future__ import annotations

_SECONDS = 0.5  # a chunk: long against what a message costs, short against what a user waits for
_MOST = 4096
_GROWTH = 4


class Chunks:
    """Sizes of chunks from what samples were measured to cost."""

    def __init__(self) -> None:
        self._size = 1

    def size(self, remaining: int, width: int) -> int:
        """Return how many of the remaining samples to take next; towards the end, fewer, for all workers.

        Parameters
        ----------
        remaining
            How many samples there are to take.
        width
            How many chunks run at once.
        """
        return max(1, min(self._size, remaining // (2 * width)))

    def learn(self, count: int, seconds: float) -> None:
        """Take note of what a chunk has cost. Samples that run together cost less each, the more they are."""
        fitting = int(count * _SECONDS / max(seconds, 1e-9))
        self._size = max(1, min(fitting, _GROWTH * count, _MOST))
