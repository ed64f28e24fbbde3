"""HDF5 files of unknown origin, opened after a trial.

The HDF5 library trusts its input: a changed byte can make it crash or loop, and the process with it.
Therefore a file is first read by a separate process; only a file that this has read is opened here. Starting
a process takes some 0.15 s, so results carry a checksum behind their data, where HDF5 does not look: where it
matches, the file is as it was written, and needs no trial. Any HDF5 library that opens a file for writing
cuts the checksum off.
"""

from __future__ import annotations

import os
import stat
import zlib
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from dynid.errors import FileError

if TYPE_CHECKING:
    import h5py

CHECKED = 64 * 2**20
"""Larger files, bytes, have no checksum: a trial, which does not read all of them, takes less."""
_MARK = b"\ndynid crc32 "
_LENGTH = len(_MARK) + 9
_MOST_BYTES = 64 * 2**20  # of values read on trial; of larger ones headers and the beginning
_survived: set[tuple[str, int, int]] = set()
_MOST_GROWTH = 2000  # of stored bytes by decompression; deflate reaches 1032
_USUAL_CHUNK = 64 * 2**20  # bytes of a chunk that are read whatever is stored
_MAX_REFERENCES = 1000  # that are followed on trial
_HOPS = 16  # most soft links on the path to an object


class Refused(ValueError):
    """An object of an HDF5 file is not read, although the library might read it."""


def open_hdf5(path: str | os.PathLike[str]) -> h5py.File:
    """Open an HDF5 file for reading, after a trial.

    Raises `FileError` where it is no regular file, or does not match its checksum; `OSError` as `h5py.File`
    does, and where the HDF5 library does not survive reading it.
    """
    import h5py

    name = os.fspath(path)
    facts = os.stat(name)  # noqa: PTH116
    if not stat.S_ISREG(facts.st_mode):
        raise FileError(f"{name} is not a regular file", names=[name])
    key = (os.path.realpath(name), facts.st_mtime_ns, facts.st_size)
    if key not in _survived:
        intact = _matches(name, facts.st_size)
        if intact is False:
            problem = f"{name} is damaged: it does not match its checksum"
            raise FileError(problem, remedy="Run its scene again.", names=[name])
        if intact is None:
            from dynid.trial import survives

            if survives("dynid.hdf5:read_all", name) is False:
                raise OSError("it is damaged, so that the HDF5 library does not survive reading it")
        _survived.add(key)
    # Files are replaced and never changed in place, so that nothing needs a lock.
    try:
        return h5py.File(name, "r", locking=False)
    except OSError as error:
        if "already open for write" not in str(error):
            raise
        # The library advises to clear the mark, which damages a file that is being written.
        raise OSError(
            "another program is still writing it, or ended without closing it: close it there, or read a "
            "copy that is closed"
        ) from None


def checksum(blocks: Iterable[bytes]) -> bytes:
    """Return the checksum of the content of a file, as it stands behind the content."""
    crc = 0
    for block in blocks:
        crc = zlib.crc32(block, crc)
    return b"%b%08x\n" % (_MARK, crc)


def _matches(name: str, size: int) -> bool | None:
    """Return True if a file matches the checksum at its end, None if it has none."""
    if not _LENGTH < size <= CHECKED + _LENGTH:
        return None
    with open(name, "rb") as stream:  # noqa: PTH123
        stream.seek(size - _LENGTH)
        stated = stream.read()
        if not stated.startswith(_MARK):
            return None
        stream.seek(0)
        blocks = (stream.read(min(2**20, size - _LENGTH - at)) for at in range(0, size - _LENGTH, 2**20))
        return checksum(blocks) == stated


def inside(group: Any, path: str) -> Any:
    """Return the object at a path of a file, or None where there is none.

    Raises `Refused` where a link on the way leads into another file, or links go in a circle.
    """
    import h5py

    item = group["/"] if path.startswith("/") else group
    parts, hops = deque(path.split("/")), _HOPS
    while parts:
        key = parts.popleft()
        if key in ("", "."):
            continue
        link = item.get(key, getlink=True) if isinstance(item, h5py.Group) else None
        if link is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise Refused(f"'{path}' is a link to another file, '{link.filename}'; name that file instead")
        if isinstance(link, h5py.SoftLink):
            hops -= 1
            if not hops:
                raise Refused(f"the links to '{path}' go in a circle")
            parts.extendleft(reversed(link.path.split("/")))
            item = group["/"] if link.path.startswith("/") else item
        else:
            item = item[key]
    return item


def check_stored(dataset: Any) -> None:
    """Raise `Refused` unless the values of a dataset are stored in the file itself, all of them.

    They are refused, too, where reading them would take far more memory than the file justifies.
    """
    name = str(dataset.name).lstrip("/")
    if dataset.shape is None:
        raise Refused(f"'{name}' has no values")
    if missing := _missing_filter(dataset):
        raise Refused(
            f"'{name}' is stored through the filter {missing}, which this HDF5 library has not; write it "
            "without, or name the folder of its plugin in HDF5_PLUGIN_PATH"
        )
    if dataset.is_virtual:
        raise Refused(f"'{name}' is put together from other files; name these files instead")
    if dataset.external:
        raise Refused(f"the values of '{name}' are in another file")
    stored = int(dataset.id.get_storage_size())
    claimed = int(dataset.size) * int(dataset.dtype.itemsize)
    chunk = int(dataset.dtype.itemsize)
    for length in dataset.chunks or ():
        chunk *= int(length)
    if dataset.chunks and chunk > max(_USUAL_CHUNK, _MOST_GROWTH * stored):
        raise Refused(f"'{name}' is stored in chunks of {chunk:,} bytes, but has {stored:,} in the file")
    if claimed > _MOST_GROWTH * stored:
        raise Refused(f"'{name}' claims {claimed:,} bytes of values, but has {stored:,} bytes in the file")


#: Filters by their registered numbers (The HDF Group, "Registered Filter Plugins").
_FILTERS = {
    4: "SZIP", 305: "LZO", 307: "bzip2", 32000: "LZF", 32001: "Blosc", 32004: "LZ4", 32008: "bitshuffle",
    32013: "ZFP", 32015: "Zstandard", 32017: "SZ", 32019: "JPEG-XR", 32024: "SZ3", 32026: "Blosc2",
}  # fmt: skip


def _missing_filter(dataset: Any) -> str:
    """Return name and number of a filter of a dataset that the library has not; empty where it has all."""
    import h5py

    properties = dataset.id.get_create_plist()
    for index in range(properties.get_nfilters()):
        number, _, _, named = properties.get_filter(index)
        if h5py.h5z.filter_avail(number):
            continue
        chunks = dataset.id.get_num_chunks() if dataset.chunks else 0
        if chunks and dataset.id.get_chunk_info(0).filter_mask & (1 << index):
            continue  # an optional one that was left out
        name = _FILTERS.get(number) or named.partition(b"\0")[0].decode(errors="replace")
        return f"{name} ({number})" if name else f"number {number}"
    return ""


def check_all_stored(file: Any) -> None:
    """Raise `Refused` unless the values of all datasets are stored in a file, and no link leads out."""
    import h5py

    groups = [file]
    while groups:
        group = groups.pop()
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise Refused(f"'{name}' is a link to another file, '{link.filename}'")
            if isinstance(link, h5py.HardLink):
                item = group[name]
                if isinstance(item, h5py.Group):
                    groups.append(item)
                # Of an array that was never written nothing is stored; its values are a fill value.
                elif isinstance(item, h5py.Dataset) and (
                    item.is_virtual or item.external or (item.size and item.id.get_storage_size())
                ):
                    check_stored(item)


def read_all(name: str) -> None:
    """Read names, attributes, axes and values of a file, as far as the budget goes. Errors are suppressed."""
    import h5py

    budget = _MOST_BYTES
    with suppress(Exception), h5py.File(name, "r", locking=False) as file:
        seen, groups = {hash(file.id)}, [file]
        while groups:
            group = groups.pop()
            for key in _names(group):
                with suppress(Exception):
                    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
                        continue  # of another file, or found under its own name
                    item = group[key]
                    dict(item.attrs)
                    if isinstance(item, h5py.Group) and hash(item.id) not in seen:
                        seen.add(hash(item.id))
                        groups.append(item)
                    elif isinstance(item, h5py.Dataset):
                        _scales(item)
                        budget -= _value(item, budget)


def _names(group: Any) -> list[str]:
    with suppress(Exception):
        dict(group.attrs)
        return list(group)
    return []


def _scales(dataset: Any) -> None:
    """Follow the axes to what scales them, and ask where the values are stored."""
    for axis in dataset.dims:
        with suppress(Exception):
            for index in range(len(axis)):
                dict(axis[index].attrs)
    with suppress(Exception):
        _ = dataset.is_virtual, dataset.external, dataset.id.get_storage_size()


def _value(dataset: Any, budget: int) -> int:
    """Read the values of a dataset within a budget, and return their size."""
    size = int(dataset.dtype.itemsize) * int(dataset.size or 0)
    if not 0 <= size <= budget:
        return 0
    with suppress(Exception):
        check_stored(dataset)
        values = dataset[()]
        if dataset.dtype.kind == "O":
            for reference in values.ravel()[:_MAX_REFERENCES]:  # of structure arrays
                with suppress(Exception):
                    _ = dataset.file[reference].shape
    return size
