"""Files of unknown origin: errors of parsers, claims of headers, and reading in a separate process.

A library may crash at a damaged file. It reads the file in a process of its own, which copies what is numbers
into a NumPy archive; this process reads the archive.
"""

from __future__ import annotations

import atexit
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np

from dynid import trial
from dynid.errors import DynidError, FileError

#: Numbers that are read into memory, at most: 2 GB of double precision.
MOST_NUMBERS = 250_000_000


# What parsers say in terms of their own interface, and what is meant.
_WORDS = (
    (r"the number of columns changed from (\d+) to (\d+) at row (\d+).*", r"row \3 has \2 numbers, not \1"),
    (r"(invalid literal for int\(\) with base 10|could not convert string to float): ?(''|\"\").*",
     "a number is missing; the file may end too early"),
    (r"(invalid literal for int\(\) with base 10|could not convert string to float): ?(.+)",
     r"\2 is not a number"),
    (r"Object arrays cannot be loaded.*", "an array holds Python objects, which are not read"),
)  # fmt: skip


@contextmanager
def read_errors(path: Path, what: str, *, claims: bool = False) -> Iterator[None]:
    """Turn any error of a library that parses a user's file into a `FileError`.

    `claims`: the library allocates what a record claims, so that a lack of memory is a damaged file.
    """
    try:
        yield
    except MemoryError:
        if not claims:
            raise
        raise FileError(f"{path} cannot be read as {what}: a record claims more than the memory") from None
    except (DynidError, KeyboardInterrupt):
        raise
    except OSError as error:
        raise FileError(f"{path} cannot be read as {what}: {error.strerror or error}") from None
    except Exception as error:  # parsers fail in many ways on damaged files
        said = " ".join(str(error).split())
        for pattern, text in _WORDS:
            said = re.sub(pattern, text, said)
        said = said[:200] or type(error).__name__
        raise FileError(f"{path} cannot be read as {what}: {said}") from None


def check_size(path: Path, what: str = "", limit: int = 0) -> None:
    """Refuse a file of more bytes than the limit, too many for what it is; default: 8 for each number."""
    limit = limit or 8 * MOST_NUMBERS
    if path.stat().st_size > limit:
        bound = f"larger than the {limit} bytes that are read"
        raise FileError(f"{path} is {f'too large for {what}' if what else bound}")


def check_claim(path: Path, shape: tuple[int, ...], entries: int | None = None) -> None:
    """Refuse a header that claims more than is read; a sparse matrix has so many `entries`."""
    numbers = max(shape[0], shape[-1], entries) if entries is not None else int(np.prod(shape, dtype=object))
    if numbers > MOST_NUMBERS:
        size = f"{' x '.join(map(str, shape))}{f' with {entries} entries' if entries is not None else ''}"
        raise FileError(
            f"{path} claims a matrix of {size}, more than the {MOST_NUMBERS:.2g} numbers that are read",
            remedy="Large models are read from sparse formats.",
        )


def check_backed(path: Path, rows: int, entries: int, bytes_each: int) -> None:
    """Refuse a text file that is too short for what it claims (`bytes_each` bytes an entry)."""
    size = path.stat().st_size
    if entries * bytes_each > size or rows > max(size, 1000):
        raise FileError(
            f"{path} claims {rows} rows and {entries} entries in {size} bytes: it is truncated, "
            "or its header is wrong"
        )


def check_count(path: Path, count: int, what: str, available: int, bytes_each: int = 1) -> None:
    """Refuse a count of something that the `available` bytes behind it cannot hold."""
    if not 0 <= count * bytes_each <= available:
        raise FileError(
            f"{path} claims {count:,} {what}, more than {available:,} bytes hold: it is truncated or damaged"
        )


KEPT = 8
"""Archives kept at a time."""

_archives: dict[tuple[object, ...], Path] = {}


class DiedError(Exception):
    """The separate process crashed, hung, or lacked memory."""


def archived(path: Path, function: Callable[..., None], *arguments: str, seconds: float, memory: int) -> Path:
    """Return the archive that a function of a module writes of a file, anew only where the file has changed.

    `seconds` and `memory` limit its process; `DiedError` where that does not survive.
    """
    facts = path.stat()
    key = (function, *arguments, os.path.realpath(path), facts.st_mtime_ns, facts.st_size)
    if key not in _archives or not _archives[key].exists():
        handle, target = tempfile.mkstemp(".npz", dir=_folder(os.getpid()))
        os.close(handle)
        call = (f"{function.__module__}:{function.__name__}", str(path), target, *arguments)
        ended = trial.survives(*call, seconds=seconds, memory=memory)
        if ended is None:  # there are no other processes here
            function(str(path), target, *arguments)
        elif not ended:
            raise DiedError
        _archives[key] = Path(target)
        if len(_archives) > KEPT:
            _archives.pop(next(iter(_archives))).unlink(missing_ok=True)
    return _archives[key]


@cache
def _folder(process: int) -> str:
    """Return the folder of the archives of a process, which is removed at its end."""
    folder = tempfile.mkdtemp(prefix="dynid-")

    def remove() -> None:
        if os.getpid() == process:  # not in a copy of it
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return folder
