"""Access to files: reading those that users name, and replacing a file whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import re
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from hashlib import sha256
from pathlib import Path
from typing import Any

from dynid.errors import FileError

#: Flags of `os.open` that are absent on some systems: bytes as they are; no symbolic link is followed; not
#: inherited by other programs.
_BINARY = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)


#: Names of devices on Windows, which no file can have there, whatever follows a dot.
_DEVICES = frozenset({"CON", "PRN", "AUX", "NUL"}) | {
    f"{port}{n}" for port in ("COM", "LPT") for n in range(10)
}
#: Bytes of a name, to which an ending and a number are added; file systems take 255.
_MAX_NAME = 200
#: Temporary files of `replacing`: host and process that write them, and random digits.
_PART = re.compile(r"\.dynid-(?:(?P<host>[0-9a-f]{8})-(?P<process>\d+)-)?[0-9a-f]{16}\.part")
#: Seconds since the last change after which no process writes a temporary file any more.
_ABANDONED = 600.0


#: Arrays in place of files, by their absolute paths.
_supplied: ContextVar[Mapping[str, Any] | None] = ContextVar("supplied", default=None)


@contextlib.contextmanager
def supplying(arrays: Mapping[Path, Any]) -> Iterator[None]:
    """Let arrays stand in place of files."""
    token = _supplied.set({os.path.abspath(path): array for path, array in arrays.items()})  # noqa: PTH100
    try:
        yield
    finally:
        _supplied.reset(token)


def supplied(path: Path) -> Any:
    """Return what stands in place of a file, as `supplying` has it; None: the file itself counts."""
    arrays = _supplied.get()
    return arrays.get(os.path.abspath(path)) if arrays else None  # noqa: PTH100 - links are not followed


def check_readable(path: Path, names: Sequence[str] = ()) -> None:
    """Raise `FileError`, with `names` of keys, for a path that is no file, or one that cannot be read.

    Nothing is opened: a pipe would wait. Arrays may stand in place of the file.
    """
    if supplied(path) is not None:
        return
    if not os.path.isfile(path):  # noqa: PTH113 (False, too, for a name that no file can have)
        remedy = "Paths in a scene are relative to the scene's folder."
        raise FileError(f"{path} is no file", remedy=remedy, names=names)
    if not os.access(path, os.R_OK):
        raise FileError(f"{path} cannot be read: Permission denied", names=names)


def descriptor_of(path: str, flags: int = 0, *, links: bool = False) -> int:
    """Return the descriptor of a file of bytes, open for reading and writing, with flags of `os.open`.

    Raises `OSError` if it cannot be opened, or is a symbolic link and `links` are not followed.
    """
    if not links and not _NO_LINK and os.path.islink(path):  # noqa: PTH114 - Windows
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
    return os.open(path, os.O_RDWR | _BINARY | (0 if links else _NO_LINK) | flags, 0o666)


def read_at(descriptor: int, count: int, offset: int) -> bytes:
    """Return at most `count` bytes of an open file from a place on."""
    if hasattr(os, "pread"):
        return os.pread(descriptor, count, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)  # Windows
    return os.read(descriptor, count)


def write_at(descriptor: int, content: memoryview, offset: int) -> int:
    """Write to an open file from a place on, and return how many bytes it took."""
    if hasattr(os, "pwrite"):
        return os.pwrite(descriptor, content, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)  # Windows
    return os.write(descriptor, content)


def dataset_of(path: str) -> tuple[str, str | None]:
    """Split `file.h5:/path` into the file and the path of the dataset; None for other files."""
    bare, colon, inside = path.partition(":/")
    return (bare, inside) if colon and bare.lower().endswith((".h5", ".hdf5")) else (path, None)


def file_names(names: Iterable[str]) -> list[str]:
    """Return names of files on all systems, all different, for names that may hold anything.

    Anything but letters, digits, ``.``, ``+``, ``-`` and ``_`` is replaced; devices of Windows and hidden
    files get a leading underscore, long names are cut, and equal ones numbered, also where they differ in
    case alone.

    Examples
    --------
    >>> file_names(["m.f-F", "a/b", "A:B", "a_b", "con"])
    ['m.f-F', 'a_b', 'A_B_2', 'a_b_3', '_con']
    """
    used: set[str] = set()
    result = []
    for name in names:
        plain = re.sub(r"[^\w.+-]", "_", name)
        if plain[:1] in ("", ".") or plain.partition(".")[0].upper() in _DEVICES:
            plain = f"_{plain}"
        plain = plain.encode()[:_MAX_NAME].decode(errors="ignore").rstrip(".")
        unique, number = plain, 1
        while unique.casefold() in used:
            number += 1
            unique = f"{plain}_{number}"
        used.add(unique.casefold())
        result.append(unique)
    return result


def remove_parts(folder: str | os.PathLike[str]) -> None:
    """Remove the temporary files that killed processes left in a folder.

    Those of processes of this host that have ended go at once, others when they have not changed for long.
    """
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = _PART.fullmatch(entry.name)
            if match is None or not entry.is_file(follow_symlinks=False):
                continue
            with contextlib.suppress(OSError):
                ended = match["host"] == _host() and not _runs(int(match["process"]))
                if ended or time.time() - entry.stat(follow_symlinks=False).st_mtime > _ABANDONED:
                    os.unlink(entry.path)  # noqa: PTH108


def _host() -> str:
    return sha256(platform.node().encode()).hexdigest()[:8]


def _runs(process: int) -> bool:
    """Return False for the number of a process that has ended, as far as the system says."""
    if sys.platform == "win32":  # where a signal 0 would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # of another user
        return True
    return True


def replace_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Replace a file, of a link its target: its name refers to the old content or the new, never to a part.

    Raises `FileError` when it cannot be written; the old file is untouched then.
    """
    with replacing(path) as temporary, os.fdopen(os.open(temporary, os.O_WRONLY), "wb") as file:
        file.write(content)


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[str]:
    """Yield the name of an empty file that replaces `path` at the end, unless an exception is raised.

    Raises `FileError` when it cannot be written; the old file is untouched then.
    """
    name = os.fspath(path)
    try:
        target = os.path.realpath(name)
        _check_target(target, name)
        folder = os.path.dirname(target)  # noqa: PTH120 - bytes of odd names pass through os.path untouched
        temporary = f".dynid-{_host()}-{os.getpid()}-{os.urandom(8).hex()}.part"
        temporary = os.path.join(folder, temporary)  # noqa: PTH118
        try:
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            with contextlib.suppress(FileNotFoundError):
                os.chmod(temporary, stat.S_IMODE(os.stat(target).st_mode))  # noqa: PTH101, PTH116
            yield temporary
            descriptor = os.open(temporary, os.O_RDWR)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
            os.replace(temporary, target)  # noqa: PTH105
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)  # noqa: PTH108
            raise
        sync_folder(folder)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{name} cannot be written: {reason}", names=[name]) from error


def _check_target(target: str, name: str) -> None:
    try:
        mode = os.stat(target).st_mode  # noqa: PTH116
    except FileNotFoundError:
        return
    # Replacing a device or a pipe would remove it.
    if not stat.S_ISREG(mode):
        raise FileError(f"{name} cannot be written: it is not a regular file", names=[name])
    if not os.access(target, os.W_OK):
        raise FileError(f"{name} cannot be written: it is write-protected", names=[name])


def sync_folder(folder: str) -> None:
    """Make a new name in a folder durable, where the system can synchronise folders."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
