"""What is finished stays finished: an append-only file of outcomes beside the file of the study.

The journal begins with a magic line. Each record is its length and its CRC-32 (little-endian, 4 bytes
each), and its payload: the letter `L` and a layout (JSON: the arrays of an outcome), or the letter `S` (`F`
where it failed) and a sample: its key, the number of its layout, what is particular of it (JSON), and the
values. Whatever end a process, a disk or a power supply comes to, all records up to the first damaged one
hold.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Variable
from dynid.scene.batch import Outcome
from dynid.study.keys import SIZE

MAGIC = b"dynid journal 1\n"
_HEAD = struct.Struct("<II")
_SAMPLE = struct.Struct(f"<{SIZE}sII")
_MAX_RECORD = 2**31
_MAX_LAYOUTS = 256  # that many are kept in memory; a layout beyond stands in the record of its sample
_OWN = 2**32 - 1


class Journal:
    """A journal that is open, with the place of every sample's record in it.

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
        self.places: dict[bytes, int] = {}  # key: where its record begins
        self.failures: set[bytes] = set()  # keys of samples that failed
        self._layouts: list[list[dict[str, Any]]] = []
        self._numbers: dict[str, int] = {}  # layout as text: its number
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
    def read_keys(path: str) -> set[bytes]:
        """Return the keys of all samples in a journal, and leave it as it is."""
        try:
            with open(path, "rb") as file:  # noqa: PTH123
                size = os.fstat(file.fileno()).st_size
                records = _records(file.fileno(), len(MAGIC), size)
                return {_key_of(payload) for _, payload in records if payload[:1] != b"L"}
        except OSError as error:
            problem = f"{path} cannot be read: {error.strerror or error}"
            raise FileError(problem, names=[path]) from error

    @staticmethod
    def discard(path: str) -> None:
        """Remove a journal, if there is one: all that it held is safe elsewhere."""
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # noqa: PTH108

    def __contains__(self, key: bytes) -> bool:
        return key in self.places

    def append(self, outcomes: Iterable[tuple[bytes, Outcome]]) -> None:
        """Add outcomes by their keys; when this returns, they survive whatever comes.

        Raises
        ------
        FileError
            When they cannot be written. The journal is as it was before then.
        """
        content, places, failures = bytearray(), {}, set()
        layouts = len(self._layouts)
        try:
            for key, outcome in outcomes:
                layout, particular, values = self._encoded(outcome, content)
                places[key] = self._end + len(content)
                failures |= {key} if outcome.error else set()
                letter = b"F" if outcome.error else b"S"
                content += _record(letter + _SAMPLE.pack(key, layout, len(particular)) + particular + values)
            self._write(content)
        except BaseException as error:
            for text in list(self._numbers)[layouts:]:
                del self._numbers[text]
            del self._layouts[layouts:]
            if isinstance(error, OSError):
                raise self._failed(error) from error
            raise
        self._end += len(content)
        self.places |= places
        self.failures |= failures

    def outcome(self, key: bytes) -> Outcome:
        """Read an outcome back."""
        payload = self._payload(self.places[key])
        _, number, length = _SAMPLE.unpack_from(payload, 1)
        begin = 1 + _SAMPLE.size
        particular = json.loads(payload[begin : begin + length])
        layout = particular["layout"] if number == _OWN else self._layouts[number]
        return _decoded(layout, particular, payload[begin + length :])

    def forget(self, keys: Iterable[bytes]) -> None:
        """Take samples for unfinished, so that they are run again; the last record of a key counts."""
        for key in list(keys):
            del self.places[key]
            self.failures.discard(key)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def _failed(self, error: OSError) -> FileError:
        problem = f"{self.path} cannot be written: {error.strerror or error}"
        remedy = "What it holds is safe. Make room, or see to the disk, and run the study again: it goes on."
        return FileError(problem, remedy=remedy, names=[self.path])

    def _write(self, content: bytes | bytearray) -> None:
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
            problem = f"{self.path} is no journal of a study"
            raise FileError(problem, remedy="Remove it, or write another file with -o.", names=[self.path])
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

    def _begin(self) -> None:
        from dynid.atomic import sync_folder

        try:
            self._write(MAGIC)
        except OSError as error:
            raise self._failed(error) from error
        sync_folder(os.path.dirname(os.path.realpath(self.path)))  # noqa: PTH120

    def _note(self, place: int, payload: bytes) -> None:
        if payload[:1] == b"L":
            text = payload[1:].decode()
            self._numbers[text] = len(self._layouts)
            self._layouts.append(json.loads(text))
        else:
            key = _key_of(payload)
            self.places[key] = place
            self.failures.discard(key)
            if payload[:1] == b"F":
                self.failures.add(key)

    def _payload(self, place: int) -> bytes:
        length, check = _HEAD.unpack(os.pread(self._descriptor, _HEAD.size, place))
        payload = os.pread(self._descriptor, length, place + _HEAD.size)
        if zlib.crc32(payload) != check:
            raise FileError(
                f"{self.path} has changed while the study ran",
                remedy="Run the study again.",
                names=[self.path],
            )
        return payload

    def _encoded(self, outcome: Outcome, content: bytearray) -> tuple[int, bytes, bytes]:
        """Return the number of an outcome's layout, what is particular of it, and its values as bytes."""
        layout = [
            {"path": path, "dims": v.dims, "type": v.data.dtype.str, "units": v.units, "attrs": dict(v.attrs)}
            for path, v in outcome.values.items()
        ]
        number, particular = self._numbered(layout, content)
        shapes, texts, values = [], [], []
        for variable in outcome.values.values():
            shapes.append(variable.data.shape)
            if variable.data.dtype.kind == "O":
                texts += variable.data.ravel().tolist()
            else:
                values.append(variable.data.tobytes())
        particular["shapes"] = shapes
        if texts:
            particular["texts"] = texts
        if outcome.error:
            particular |= {"error": outcome.error, "exit_code": outcome.exit_code}
        if outcome.expectations:
            particular["met"] = outcome.expectations
        return number, _text(particular).encode(), b"".join(values)

    def _numbered(self, layout: list[dict[str, Any]], content: bytearray) -> tuple[int, dict[str, Any]]:
        """Return the number of a layout, and what of it a record must bear itself."""
        text = _text(layout)
        if text not in self._numbers:
            if len(self._layouts) >= _MAX_LAYOUTS:
                return _OWN, {"layout": layout}
            self._numbers[text] = len(self._layouts)
            self._layouts.append(json.loads(text))
            content += _record(b"L" + text.encode())
        return self._numbers[text], {}


def _text(data: Any) -> str:
    return json.dumps(data, separators=(",", ":"), default=lambda value: value.item())


def _records(descriptor: int, begin: int, size: int) -> Iterator[tuple[int, bytes]]:
    """Yield where each whole record begins, and its payload."""
    place = begin
    while place + _HEAD.size <= size:
        length, check = _HEAD.unpack(os.pread(descriptor, _HEAD.size, place))
        if not 0 < length <= min(size - place - _HEAD.size, _MAX_RECORD):
            return
        payload = os.pread(descriptor, length, place + _HEAD.size)
        if len(payload) < length or zlib.crc32(payload) != check:
            return
        yield place, payload
        place += _HEAD.size + length


def _key_of(payload: bytes) -> bytes:
    key: bytes = _SAMPLE.unpack_from(payload, 1)[0]
    return key


def _record(payload: bytes) -> bytes:
    return _HEAD.pack(len(payload), zlib.crc32(payload)) + payload


def _decoded(layout: list[dict[str, Any]], particular: dict[str, Any], values: bytes) -> Outcome:
    found: dict[str, Variable] = {}
    texts = iter(particular.get("texts", ()))
    begin = 0
    for array, given in zip(layout, particular["shapes"], strict=True):
        shape, dtype = tuple(given), np.dtype(array["type"])
        count = int(np.prod(shape, dtype=np.int64))
        data: NDArray[Any]
        if dtype.kind == "O":
            data = np.empty(count, dtype=object)
            data[:] = [next(texts) for _ in range(count)]
        else:
            data = np.frombuffer(values, dtype, count, begin)
            begin += count * dtype.itemsize
        found[array["path"]] = Variable(
            tuple(array["dims"]), data.reshape(shape), array["units"], array["attrs"]
        )
    return Outcome(
        found,
        particular.get("error", ""),
        particular.get("exit_code", 0),
        tuple(particular.get("met", ())),
    )
