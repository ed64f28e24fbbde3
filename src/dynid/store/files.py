"""Results to and from HDF5 files, whole or not at all, with interrupts deferred."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dynid._version import __version__
from dynid.errors import FileError, UsageError
from dynid.file_access import replace_file, replacing
from dynid.hdf5 import CHECKED, checksum, open_hdf5
from dynid.result import REJECTED, Result, Scalar
from dynid.store.reader import CURRENT, INTERRUPTED, StoredVariable, read_root, reading
from dynid.store.writer import ArrayWriter, Sink, write_attrs

_PACKAGES = ("numpy", "scipy", "h5py", "pydantic", "pyyaml", "python-flint", "sympy", "control")
#: Environment variable of reproducible builds: the time in place of the clock, seconds since 1970.
EPOCH = "SOURCE_DATE_EPOCH"


def write_result(result: Result, path: str | os.PathLike[str], scene_text: str | None = None) -> None:
    """Write a result to an HDF5 file, whole or not at all.

    Parameters
    ----------
    result
        The result. Its provenance (`created`, `python`, …) is kept, missing attributes are added.
    path
        The file; an existing one is replaced.
    scene_text
        The YAML text as run; default: the one in the result, if any.

    Raises
    ------
    FileError
        When the file cannot be written, or the result cannot be held by HDF5. An existing file is
        untouched then.
    """
    name = os.fspath(path)
    text = str(result.attrs.get("scene", "")) if scene_text is None else scene_text
    try:
        import h5py

        # Built in memory: disk errors then never affect an open HDF5 file.
        with h5py.File("result", "w", driver="core", backing_store=False, libver="earliest") as file:
            _write_root(file, result, text)
            ArrayWriter(file, result).write()
            file.flush()
            content = bytes(file.id.get_file_image())
    except (OSError, RuntimeError, ValueError, TypeError, OverflowError) as error:
        raise FileError(f"{name} cannot be written: {error}", names=[name]) from error
    replace_file(name, content + (checksum([content]) if len(content) <= CHECKED else b""))


#: Rows of an array: its path, the number of the first row, the rows.
Block = tuple[str, int, NDArray[Any]]


#: Yields whole arrays computed from those in the file.
Finish = Callable[[Result], Iterable[tuple[str, NDArray[Any]]]]


def write_blocks(
    result: Result,
    path: str | os.PathLike[str],
    blocks: Iterable[Block],
    complete: bool = True,
    finish: Finish | None = None,
) -> None:
    """Write a result whose long arrays come in blocks, so that they are never in memory as a whole.

    Of hollow arrays of the result only axes, shape and type are used; `blocks` have every row of them.
    `finish` computes further hollow arrays once all blocks are written.

    Raises
    ------
    FileError
        When the file cannot be written. An existing file is untouched then.
    """
    import h5py

    name = os.fspath(path)
    hollow = {
        index
        for index, variable in result.items()
        if variable.data.ndim > 0 and not any(variable.data.strides)
    }
    with replacing(name) as temporary, Sink(temporary) as sink, deferred_interrupts() as check:
        try:
            with h5py.File(sink, "w", libver="earliest") as file:
                _write_root(file, result, str(result.attrs.get("scene", "")), complete)
                ArrayWriter(file, result, hollow).write()
                for index, first, rows in blocks:
                    file[index][first : first + len(rows)] = rows
                    sink.check()
                    check()
                if finish is not None:
                    for index, values in finish(read_root(file, name, stored=True, partial=True)):
                        file[index][...] = values
                        check()
            if sink.seek(0, os.SEEK_END) <= CHECKED:
                sink.seek(0)
                sink.write(checksum(iter(lambda: sink.read(2**20), b"")))
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            sink.check()
            raise FileError(f"{name} cannot be written: {error}", names=[name]) from error
        sink.check()


def hollow(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array of a shape and type without values, which takes no memory."""
    return np.broadcast_to(np.empty((), dtype), shape)


def read_result(path: str | os.PathLike[str], partial: bool = False) -> Result:
    """Read a result back from an HDF5 file.

    Parameters
    ----------
    path
        The file.
    partial
        True to accept an interrupted result.

    Raises
    ------
    FileError
        When there is no such file, or it is not a complete result of a known format.
    """
    name = os.fspath(path)
    with reading(name), open_hdf5(name) as file:
        return read_root(file, name, partial=partial)


@contextmanager
def open_stored(path: str | os.PathLike[str], partial: bool = False) -> Iterator[Result]:
    """Open a result whose arrays stay in the file, and are read on request; `partial` as of `read_result`.

    Raises
    ------
    FileError
        As `read_result`; also when damaged values are read.
    """
    name = os.fspath(path)
    with ExitStack() as stack:
        with reading(name):
            result = read_root(stack.enter_context(open_hdf5(name)), name, stored=True, partial=partial)
        yield result


def loaded(stored: Result) -> Result:
    """Return an opened result with all of its arrays in memory."""
    result = Result(stored.kind, stored.title, stored.attrs)
    for path, variable in stored.items():
        result.put(path, variable.loaded() if isinstance(variable, StoredVariable) else variable)
    for group, attrs in stored.group_attrs.items():
        result.annotate(group, **attrs)
    return result


@cache
def _version(package: str) -> str | None:
    """Return the version of an installed package; its metadata take as long as writing a small result."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _created() -> datetime:
    """Return the time of creation: now, or SOURCE_DATE_EPOCH, for the same bytes each time."""
    if (epoch := os.environ.get(EPOCH)) is None:
        return datetime.now(UTC)
    try:
        return datetime.fromtimestamp(int(epoch), UTC)
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{EPOCH} is {epoch!r}", remedy="Set it to a number of seconds since 1970.", names=(EPOCH,)
        ) from None


def _write_root(file: Any, result: Result, scene_text: str, complete: bool = True) -> None:
    import platform

    import h5py

    packages = [f"{package} {installed}" for package in _PACKAGES if (installed := _version(package))]
    stamps: dict[str, Scalar] = {
        "created": _created().isoformat(timespec="seconds"),
        "dynid_version": __version__,
        "packages": ", ".join(packages),
        "python": platform.python_version(),
    }
    fixed: dict[str, Scalar] = {
        "format": CURRENT,
        "kind": result.kind,
        "title": result.title,
        "status": INTERRUPTED if not complete else REJECTED if result.rejected else "complete",
    }
    attrs = result.group_attrs.get("", {}) | result.attrs
    scalars = {name: value for name, value in attrs.items() if name not in ("scene", "status")}
    if clash := sorted(scalars.keys() & fixed.keys()):
        raise ValueError(f"the attribute '{clash[0]}' is set by the store")
    write_attrs(file, stamps | scalars | fixed)
    file.create_dataset("scene", data=scene_text, dtype=h5py.string_dtype())


@contextmanager
def deferred_interrupts() -> Iterator[Callable[[], None]]:
    """Defer interrupts until the end, or until the yielded function is called.

    HDF5 does not survive an interrupt during writing.
    """
    came: list[int] = []
    before: dict[int, Any] = {}

    def check() -> None:
        if came:
            number = came.pop()
            came.clear()
            before[number](number, None)

    if threading.current_thread() is not threading.main_thread():
        yield check  # only the main thread receives interrupts
        return
    for number in (int(signal.SIGINT), int(signal.SIGTERM)):
        if callable(handler := signal.getsignal(number)):  # the default action ends the process at once
            before[number] = handler
            signal.signal(number, lambda came_now, _: came.append(came_now))
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    check()


class Terminated(KeyboardInterrupt):
    """The system asked this process to end (SIGTERM)."""


@contextmanager
def terminations() -> Iterator[None]:
    """Let SIGTERM interrupt like Ctrl-C, as `Terminated`."""

    def end(*_: Any) -> None:
        raise Terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
