"""Journal of finished samples: an append-only file of outcomes beside the file of the study.

The journal begins with a magic line. Each record holds samples that were finished together: its length (8
bytes, little-endian) and its CRC-32 (4 bytes); then the number of samples (4 bytes), their keys, their exit
codes (one byte each), and their outcomes (`dynid.study.work`). Every record with a correct CRC is kept,
even after damaged ones: the next record is found by the beginning of its outcomes.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import re
import shutil
import struct
import zlib
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.file_access import descriptor_of, read_at, replacing, sync_folder, write_at
from dynid.number_format import counted
from dynid.scene.outcomes import Indices, SampleBlock, SampleOutcomes
from dynid.study.keys import SIZE, Keys, found_in
from dynid.study.work import START, Packed, unpacked

MAGIC = b"dynid journal 2\n"
_ANY_MAGIC = b"dynid journal "
_HEAD = struct.Struct("<QI")
_COUNT = struct.Struct("<I")
_MARK = re.compile(re.escape(START) + rb"(\d{1,9}),")  # beginning of outcomes, with their number
_BEFORE = _HEAD.size + 2 * _COUNT.size  # bytes before a mark, except keys and exit codes


class Journal:
    """Open journal, with the places of its records.

    Samples are numbered in the order in which they were finished. The file is created if it does not exist; a
    record at its end whose writing was interrupted is cut off. If anything else is damaged (`damage`), the
    file is kept as `<path>.damaged`, and its valid records are written to a new one.

    Raises
    ------
    FileError
        If it cannot be read or written, or is no journal.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.damage: _Scan | None = None
        self._offsets: list[int] = []  # of the records
        self._starts: list[int] = []  # the number of the first sample of each
        self._keys: list[bytes] = []
        self._codes: list[bytes] = []
        self._count = 0
        self._last: tuple[int, SampleOutcomes] | None = None  # the last record read
        self._kept = ""  # name of the copy of a damaged file
        try:
            self._descriptor = descriptor_of(path, os.O_CREAT)
        except OSError as error:
            raise self._failed(error) from error
        try:
            self._end = self._recover()
        except BaseException:
            self.close()
            raise

    @staticmethod
    def read_keys(path: str) -> Keys:
        """Return the keys of all samples in a journal (samples x bytes), which is only read."""
        try:
            with open(path, "rb") as file:  # noqa: PTH123
                size = os.fstat(file.fileno()).st_size
                begun = file.read(len(MAGIC))
                if begun != MAGIC and begun.startswith(_ANY_MAGIC):
                    return _as_keys([])
                return _as_keys([_keys_of(payload) for _, payload in _Scan(file.fileno(), size).records()])
        except OSError as error:
            problem = f"{path} cannot be read: {error.strerror or error}"
            raise FileError(problem, names=[path]) from error

    @staticmethod
    def discard(path: str) -> None:
        """Remove a journal, if it exists, whose samples have been written to the file of the study."""
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # noqa: PTH108

    @property
    def damage_text(self) -> str:
        """What was damaged and lost, in words; empty of an intact journal."""
        if self.damage is None:
            return ""
        bound = "" if self.damage.known else "at least "
        loss = f"{bound}{counted(self.damage.lost, 'finished sample')} in it cannot be read"
        what = loss if self.damage.lost else "no sample is lost"
        return f"{self.path} was damaged: {what}. It is kept as {self._kept}"

    @property
    def keys(self) -> Keys:
        """The keys of all samples (samples x bytes); of samples with equal keys, the last one is valid."""
        return _as_keys(self._keys)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Mask of the failed samples."""
        return np.frombuffer(b"".join(self._codes), np.int8).astype(np.bool_)

    def numbers(self, keys: Keys) -> NDArray[np.int64]:
        """Return the numbers of the samples with given keys; -1 for a key that is not there."""
        return found_in(self.keys, keys)

    def append(self, chunks: Iterable[tuple[Keys, Packed]]) -> int:
        """Append outcomes with their keys, and return the number of the first one.

        When this returns, they are on the disk. After a `FileError` the journal is unchanged.
        """
        payloads = [
            b"".join([_COUNT.pack(len(record)), keys.tobytes(), record.exit_codes, record.content])
            for keys, record in chunks
        ]
        try:
            self._write(b"".join(_HEAD.pack(len(record), zlib.crc32(record)) + record for record in payloads))
        except OSError as error:
            raise self._failed(error) from error
        first = self._count
        for payload in payloads:
            self._index(self._end, payload)
            self._end += _HEAD.size + len(payload)
        return first

    def blocks(self, numbers: NDArray[np.int64], rows: Indices) -> Iterator[SampleBlock]:
        """Yield samples in given rows, with one record in memory at a time."""
        records = np.searchsorted(self._starts, numbers, side="right") - 1
        for record in np.unique(records).tolist():
            members = np.flatnonzero(records == record)
            places = (numbers[members] - self._starts[record]).astype(np.intp)
            yield from self._read(record).picked(places, rows[members])

    def close(self) -> None:
        """Close the file, unless it is closed."""
        if self._descriptor >= 0:
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)

    def _read(self, record: int) -> SampleOutcomes:
        """Return the outcomes of a record; the last one is cached."""
        if self._last is None or self._last[0] != record:
            self._last = None
            payload = _valid_payload(self._descriptor, self._offsets[record], self._end)
            if payload is None:
                problem = f"{self.path} has changed while the study ran"
                raise FileError(problem, remedy="Run the study again.", names=[self.path])
            (count,) = _COUNT.unpack_from(payload)
            try:
                self._last = record, unpacked(payload[_COUNT.size + count * (SIZE + 1) :])
            except (ValueError, LookupError, TypeError, struct.error) as error:
                problem = f"{self.path} holds samples that cannot be read"
                raise FileError(
                    problem, remedy="Remove it: its samples are run again.", names=[self.path]
                ) from error
        return self._last[1]

    def _failed(self, error: OSError) -> FileError:
        problem = f"{self.path} cannot be written: {error.strerror or error}"
        held = f"The {counted(self._count, 'finished sample')} in it stay safe. " if self._count else ""
        remedy = f"{held}Free space on the disk, or repair it, and run the study again to resume it."
        return FileError(problem, remedy=remedy, names=[self.path])

    def _write(self, content: bytes) -> None:
        """Append content and sync it to the disk; if this fails, cut the content off again."""
        view = memoryview(content)
        written = 0
        try:
            while written < len(view):
                written += write_at(self._descriptor, view[written:], self._end + written)
            os.fsync(self._descriptor)
        except BaseException:
            os.ftruncate(self._descriptor, self._end)
            raise

    def _recover(self) -> int:
        """Index all records, repair a damaged journal, and return the end of the last record."""
        size = os.fstat(self._descriptor).st_size
        begun = read_at(self._descriptor, len(MAGIC), 0)
        self._end = 0
        if MAGIC.startswith(begun) and begun != MAGIC:
            try:
                self._write(MAGIC)
            except OSError as error:
                raise self._failed(error) from error
            sync_folder(os.path.dirname(os.path.realpath(self.path)))  # noqa: PTH120
            return len(MAGIC)
        if begun != MAGIC and begun.startswith(_ANY_MAGIC):
            self._refuse(begun)
        end, scan = len(MAGIC), _Scan(self._descriptor, size)
        for offset, payload in scan.records():
            self._index(offset, payload)
            end = offset + _HEAD.size + len(payload)
        if begun != MAGIC and not self._offsets:
            self._refuse(begun)
        if scan.damaged or begun != MAGIC:
            end = self._renew(scan.lengths)
            self.damage = scan
        elif end < size:
            os.ftruncate(self._descriptor, end)
        return end

    def _renew(self, lengths: list[int]) -> int:
        """Copy the damaged file, write its valid records to a new one, and return their end."""
        try:
            self._kept = _copied(self._descriptor, f"{self.path}.damaged")
        except OSError as error:
            raise self._failed(error) from error
        places, end = self._offsets, len(MAGIC)
        self._offsets = []
        with replacing(self.path) as temporary, open(temporary, "wb") as file:  # noqa: PTH123
            file.write(MAGIC)
            for offset, length in zip(places, lengths, strict=True):
                payload = _read_at(self._descriptor, length, offset + _HEAD.size)
                file.write(_HEAD.pack(length, zlib.crc32(payload)) + payload)
                self._offsets.append(end)
                end += _HEAD.size + length
            self.close()  # Windows replaces no open file
        self._descriptor = descriptor_of(self.path)
        return end

    def _refuse(self, begun: bytes) -> None:
        if begun.startswith(_ANY_MAGIC):
            problem = f"{self.path} is the journal of another version of dynid"
            remedy = "Finish the study with that version; or remove the journal: its samples are run again."
        else:
            problem = f"{self.path} is no journal of a study"
            remedy = "Remove it, or write another file with -o."
        raise FileError(problem, remedy=remedy, names=[self.path])

    def _index(self, offset: int, payload: bytes) -> None:
        keys = _keys_of(payload)
        count = len(keys) // SIZE
        self._offsets.append(offset)
        self._starts.append(self._count)
        self._keys.append(keys)
        self._codes.append(payload[_COUNT.size + len(keys) :][:count])
        self._count += count


class _Scan:
    """Scan of a journal for valid records and damage.

    A record at the end whose writing was interrupted is no damage: its samples were never reported as
    finished.
    """

    def __init__(self, descriptor: int, size: int) -> None:
        self._descriptor, self._size = descriptor, size
        self.lengths: list[int] = []
        self.damaged, self.lost, self.known = False, 0, True

    def records(self) -> Iterator[tuple[int, bytes]]:
        """Yield the place and the payload of each valid record."""
        offset = len(MAGIC)
        while offset < self._size:
            payload = _valid_payload(self._descriptor, offset, self._size)
            following = self._next(offset + 1) if payload is None else offset + _HEAD.size + len(payload)
            if payload is None:
                payload = self._salvaged(offset, following)
            if payload is not None:
                self.lengths.append(len(payload))
                yield offset, payload
            offset = following

    def _next(self, begin: int) -> int:
        with mmap.mmap(self._descriptor, 0, access=mmap.ACCESS_READ) as content:
            for mark in _MARK.finditer(content, begin):
                offset = mark.start() - _BEFORE - int(mark[1]) * (SIZE + 1)
                if offset >= begin and _valid_payload(self._descriptor, offset, self._size) is not None:
                    return offset
        return self._size

    def _salvaged(self, offset: int, following: int) -> bytes | None:
        """Return the payload of a record whose length alone is wrong; else count the lost samples."""
        content = _read_at(self._descriptor, following - offset, offset)
        length, check = _HEAD.unpack(content[: _HEAD.size].ljust(_HEAD.size, b"\xff"))
        payload = content[_HEAD.size :]
        if _is_whole(payload, check):
            self.damaged = True
            return payload
        interrupted = following == self._size and len(payload) < length
        if interrupted and len(_MARK.findall(content)) < 2:
            return None
        self.damaged = True
        self._count(content)
        return None

    def _count(self, content: bytes) -> None:
        """Count the samples of damaged records, as far as their beginnings can be read."""
        offset = 0
        while offset < len(content):
            length, _, count = struct.unpack("<QII", content[offset : offset + 16].ljust(16, b"\xff"))
            mark = _MARK.search(content, offset)
            if mark and mark.start() == offset + _BEFORE + int(mark[1]) * (SIZE + 1):
                count = int(mark[1])
            if not 0 < count <= (len(content) - offset) // (SIZE + 1):
                count, self.known = 1, False
            self.lost += count
            if length <= len(content) - offset - _HEAD.size:
                offset += _HEAD.size + length
                continue
            starts = (
                match.start() - _BEFORE - int(match[1]) * (SIZE + 1)
                for match in _MARK.finditer(content, offset)
            )
            offset = next((start for start in starts if start > offset), len(content))


def _valid_payload(descriptor: int, offset: int, end: int) -> bytes | None:
    """Return the payload of the record at an offset; None if there is no valid one before `end`."""
    head = read_at(descriptor, _HEAD.size, offset)
    if len(head) < _HEAD.size:
        return None
    length, check = _HEAD.unpack(head)
    if length > end - offset - _HEAD.size:
        return None
    payload = _read_at(descriptor, length, offset + _HEAD.size)
    return payload if _is_whole(payload, check) else None


def _is_whole(payload: bytes, check: int) -> bool:
    if len(payload) <= _COUNT.size or zlib.crc32(payload) != check:
        return False
    (count,) = _COUNT.unpack_from(payload)
    return bool(0 < count <= (len(payload) - _COUNT.size) // (SIZE + 1))


def _copied(descriptor: int, path: str) -> str:
    """Copy an open file to a new one with this name, or with a number appended; return the name."""
    name, number = path, 1
    while True:
        try:
            target = descriptor_of(name, os.O_CREAT | os.O_EXCL)
            break
        except FileExistsError:
            number += 1
            name = f"{path}-{number}"
    with open(target, "wb") as copy, open(os.dup(descriptor), "rb") as source:  # noqa: PTH123
        source.seek(0)
        shutil.copyfileobj(source, copy)
        copy.flush()
        os.fsync(copy.fileno())
    return name


def _read_at(descriptor: int, length: int, offset: int) -> bytes:
    parts, left = [], length
    while left and (piece := read_at(descriptor, left, offset + length - left)):  # 2 GB at most at a time
        parts.append(piece)
        left -= len(piece)
    return b"".join(parts)


def _keys_of(payload: bytes) -> bytes:
    (count,) = _COUNT.unpack_from(payload)
    return payload[_COUNT.size : _COUNT.size + count * SIZE]


def _as_keys(parts: list[bytes]) -> Keys:
    return np.frombuffer(b"".join(parts), np.uint8).reshape(-1, SIZE)
