"""What is finished stays finished: an append-only file of outcomes beside the file of the study.

The journal begins with a magic line. Each record holds samples that were finished together: its length (8
bytes, little-endian) and its CRC-32 (4 bytes); then the number of samples (4 bytes), their keys, their exit
codes (a byte each), and their outcomes (`dynid.study.packing`). Whatever end a process, a disk or a power
supply comes to, all records up to the first damaged one hold.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.scene.outcomes import Block, Outcomes, Places
from dynid.study.keys import SIZE, Keys, found_in
from dynid.study.packing import Packed, unpacked

MAGIC = b"dynid journal 2\n"
_ANY_MAGIC = b"dynid journal "
_HEAD = struct.Struct("<QI")
_COUNT = struct.Struct("<I")


class Journal:
    """A journal that is open, with the place of every sample's record in it.

    Samples are numbered in the order in which they were finished.

    Parameters
    ----------
    path
        The file; where there is none, it is begun. A torn end is cut off.

    Raises
    ------
    FileError
        When it cannot be read or written, or is something else.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._places: list[int] = []  # where each record begins
        self._starts: list[int] = []  # the number of the first sample of each
        self._keys: list[bytes] = []
        self._codes: list[bytes] = []
        self._count = 0
        self._last: tuple[int, Outcomes] | None = None  # the record that was read last
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            raise self._failed(error) from error
        try:
            self._end = self._recover()
        except BaseException:
            self.close()
            raise

    @staticmethod
    def read_keys(path: str) -> Keys:
        """Return the keys of all samples in a journal (samples x bytes), and leave it as it is."""
        try:
            with open(path, "rb") as file:  # noqa: PTH123
                size = os.fstat(file.fileno()).st_size
                begun = file.read(len(MAGIC)) == MAGIC
                records = _records(file.fileno(), len(MAGIC), size) if begun else ()
                return _as_keys([_keys_of(payload) for _, payload in records])
        except OSError as error:
            problem = f"{path} cannot be read: {error.strerror or error}"
            raise FileError(problem, names=[path]) from error

    @staticmethod
    def discard(path: str) -> None:
        """Remove a journal, if there is one: all that it held is safe elsewhere."""
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # noqa: PTH108

    @property
    def keys(self) -> Keys:
        """The keys of all samples (samples x bytes); of several with one key, the last counts."""
        return _as_keys(self._keys)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which samples failed."""
        return np.frombuffer(b"".join(self._codes), np.int8).astype(np.bool_)

    def numbers(self, keys: Keys) -> NDArray[np.int64]:
        """Return the numbers of the samples with these keys, -1 where there is none."""
        return found_in(self.keys, keys)

    def append(self, chunks: Iterable[tuple[Keys, Packed]]) -> int:
        """Add outcomes by their keys; when this returns, they survive whatever comes.

        Returns
        -------
        int
            The number of the first of them; the others follow.

        Raises
        ------
        FileError
            When they cannot be written. The journal is as it was before then.
        """
        payloads = [
            b"".join([_COUNT.pack(len(one)), keys.tobytes(), one.exit_codes, one.content])
            for keys, one in chunks
        ]
        try:
            self._write(b"".join(_HEAD.pack(len(one), zlib.crc32(one)) + one for one in payloads))
        except OSError as error:
            raise self._failed(error) from error
        first = self._count
        for payload in payloads:
            self._note(self._end, payload)
            self._end += _HEAD.size + len(payload)
        return first

    def blocks(self, numbers: NDArray[np.int64], rows: Places) -> Iterator[Block]:
        """Yield samples, each in the row that it shall have; one record is in memory at a time."""
        records = np.searchsorted(self._starts, numbers, side="right") - 1
        for record in np.unique(records).tolist():
            own = np.flatnonzero(records == record)
            places = (numbers[own] - self._starts[record]).astype(np.intp)
            yield from self._read(record).picked(places, rows[own])

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def _read(self, record: int) -> Outcomes:
        """Return the outcomes of a record; the last one stays at hand."""
        if self._last is None or self._last[0] != record:
            self._last = None
            payload = self._payload(self._places[record])
            (count,) = _COUNT.unpack_from(payload)
            self._last = record, unpacked(payload[_COUNT.size + count * (SIZE + 1) :])
        return self._last[1]

    def _failed(self, error: OSError) -> FileError:
        problem = f"{self.path} cannot be written: {error.strerror or error}"
        remedy = "What it holds is safe. Make room, or see to the disk, and run the study again: it goes on."
        return FileError(problem, remedy=remedy, names=[self.path])

    def _write(self, content: bytes) -> None:
        """Write at the end, and see to it that it is on the disk; else cut off again what was written."""
        view = memoryview(content)
        written = 0
        try:
            while written < len(view):
                written += os.pwrite(self._descriptor, view[written:], self._end + written)
            os.fsync(self._descriptor)
        except BaseException:
            os.ftruncate(self._descriptor, self._end)
            raise

    def _recover(self) -> int:
        """Read all records, note where they are, and cut off what is no whole record."""
        size = os.fstat(self._descriptor).st_size
        begun = os.pread(self._descriptor, len(MAGIC), 0)
        if not MAGIC.startswith(begun):
            self._refuse(begun)
        self._end = 0
        if begun != MAGIC:
            self._begin()
            return len(MAGIC)
        end = len(MAGIC)
        for place, payload in _records(self._descriptor, end, size):
            self._note(place, payload)
            end = place + _HEAD.size + len(payload)
        if end < size:
            os.ftruncate(self._descriptor, end)
        return end

    def _refuse(self, begun: bytes) -> None:
        if begun.startswith(_ANY_MAGIC):
            problem = f"{self.path} is the journal of another version of dynid"
            remedy = "Finish the study with that version; or remove the journal, and all of it is run again."
        else:
            problem = f"{self.path} is no journal of a study"
            remedy = "Remove it, or write another file with -o."
        raise FileError(problem, remedy=remedy, names=[self.path])

    def _begin(self) -> None:
        from dynid.atomic import sync_folder

        try:
            self._write(MAGIC)
        except OSError as error:
            raise self._failed(error) from error
        sync_folder(os.path.dirname(os.path.realpath(self.path)))  # noqa: PTH120

    def _note(self, place: int, payload: bytes) -> None:
        """Take note of a record."""
        keys = _keys_of(payload)
        count = len(keys) // SIZE
        self._places.append(place)
        self._starts.append(self._count)
        self._keys.append(keys)
        self._codes.append(payload[_COUNT.size + len(keys) :][:count])
        self._count += count

    def _payload(self, place: int) -> bytes:
        length, check = _HEAD.unpack(os.pread(self._descriptor, _HEAD.size, place))
        payload = _read_at(self._descriptor, length, place + _HEAD.size)
        if zlib.crc32(payload) != check:
            raise FileError(
                f"{self.path} has changed while the study ran",
                remedy="Run the study again.",
                names=[self.path],
            )
        return payload


def _records(descriptor: int, begin: int, size: int) -> Iterator[tuple[int, bytes]]:
    """Yield where each whole record begins, and its payload."""
    place = begin
    while place + _HEAD.size <= size:
        length, check = _HEAD.unpack(os.pread(descriptor, _HEAD.size, place))
        if not _COUNT.size < length <= size - place - _HEAD.size:
            return
        payload = _read_at(descriptor, length, place + _HEAD.size)
        if len(payload) < length or zlib.crc32(payload) != check:
            return
        yield place, payload
        place += _HEAD.size + length


def _read_at(descriptor: int, length: int, place: int) -> bytes:
    parts, left = [], length
    while left and (part := os.pread(descriptor, left, place + length - left)):  # 2 GB at most at a time
        parts.append(part)
        left -= len(part)
    return b"".join(parts)


def _keys_of(payload: bytes) -> bytes:
    (count,) = _COUNT.unpack_from(payload)
    return payload[_COUNT.size : _COUNT.size + count * SIZE]


def _as_keys(parts: list[bytes]) -> Keys:
    return np.frombuffer(b"".join(parts), np.uint8).reshape(-1, SIZE)
