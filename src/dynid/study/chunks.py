"""How many samples go to a worker at a time."""

from __future__ import annotations

_SECONDS = 0.5  # a chunk: long against what a message costs, short against what a user waits for
_MOST = 4096
_GROWTH = 4
_BYTES = 16 * 2**20  # a chunk: what is in memory at a time


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

    def learn(self, count: int, seconds: float, size: int = 0) -> None:
        """Take note of what a chunk has cost in time and bytes.

        Samples that run together cost less time each, the more they are.
        """
        fitting = int(count * min(_SECONDS / max(seconds, 1e-9), _BYTES / max(size, 1)))
        self._size = max(1, min(fitting, _GROWTH * count, _MOST))
