"""Files that are either complete or not there."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Iterator

from dynid.errors import FileError


def replace_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file so that, whatever happens, its name holds the old content or the new, never a part.

    Parameters
    ----------
    path
        The file; where it is a symbolic link, what the link points to.
    content
        All of the new content.

    Raises
    ------
    FileError
        When it cannot be written; the old file is untouched then.
    """
    with replacing(path) as part, os.fdopen(os.open(part, os.O_WRONLY), "wb") as file:
        file.write(content)


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[str]:
    """Give the name of an empty file to fill, which takes the place of `path` when all went well.

    Raises
    ------
    FileError
        When it cannot be written; the old file is untouched then.
    """
    name = os.fspath(path)
    try:
        target = os.path.realpath(name)
        _check_target(target, name)
        folder = os.path.dirname(target)  # noqa: PTH120 - bytes of odd names pass through os.path untouched
        part = os.path.join(folder, f".dynid-{secrets.token_hex(8)}.part")  # noqa: PTH118
        try:
            _create(part, target)
            yield part
            _sync(part)
            os.replace(part, target)  # noqa: PTH105
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(part)  # noqa: PTH108
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


def _create(part: str, target: str) -> None:
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    with contextlib.suppress(FileNotFoundError):
        os.chmod(part, stat.S_IMODE(os.stat(target).st_mode))  # noqa: PTH101, PTH116


def _sync(part: str) -> None:
    descriptor = os.open(part, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(folder: str) -> None:
    """Make the new name itself durable, where the system lets a folder be synchronised."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
