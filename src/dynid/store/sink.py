"""A file object for HDF5 whose writes never raise.

HDF5 does not survive a full disk: it can no longer close the file, and crashes the process at the end.
Therefore the first error is kept, later writes go to memory, and the writer calls `check`.
"""

from __future__ import annotations

import os
from typing import Any

from dynid.file_access import descriptor_of, read_at, write_at


class Sink:
    """A file open for reading and writing, as h5py takes it.

    Parameters
    ----------
    path
        The file, which exists.
    """

    def __init__(self, path: str) -> None:
        self._descriptor = descriptor_of(path, links=True)
        self._place = 0
        self._end = os.fstat(self._descriptor).st_size
        self._kept: list[tuple[int, bytes]] = []  # content that the disk did not take, in order
        self.error: OSError | None = None

    def check(self) -> None:
        """Raise the first error, if any."""
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def write(self, content: Any) -> int:
        """Write at the current place."""
        view = memoryview(content).cast("B")
        done = 0
        try:
            while self.error is None and done < len(view):
                done += write_at(self._descriptor, view[done:], self._place + done)
        except OSError as error:
            self.error = error
        if done < len(view):
            self._kept.append((self._place + done, bytes(view[done:])))
        self._place += len(view)
        self._end = max(self._end, self._place)
        return len(view)

    def readinto(self, buffer: Any) -> int:
        """Read from the current place."""
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._end - self._place))
        content = read_at(self._descriptor, count, self._place)
        view[:count] = content.ljust(count, b"\0")
        for place, kept in self._kept:
            begin, end = max(place, self._place), min(place + len(kept), self._place + count)
            if begin < end:
                view[begin - self._place : end - self._place] = kept[begin - place : end - place]
        self._place += count
        return count

    def read(self, size: int) -> bytes:
        """Read from the current place."""
        content = bytearray(size)
        return bytes(content[: self.readinto(content)])

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move the current place."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._end}[whence]
        self._place = base + offset
        return self._place

    def tell(self) -> int:
        """Return the current place."""
        return self._place

    def truncate(self, size: int | None = None) -> int:
        """Set the length."""
        self._end = self._place if size is None else size
        try:
            if self.error is None:
                os.ftruncate(self._descriptor, self._end)
        except OSError as error:
            self.error = error
        return self._end

    def flush(self) -> None:
        """Do nothing: writes are not buffered."""
