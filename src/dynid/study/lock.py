"""One study at a time on one file: a lock that dies with its process."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from dynid.errors import FileError, UsageError


@contextmanager
def locked(target: str) -> Iterator[None]:
    """Hold the lock of a file, `<file>.lock`, which ends with the process that holds it.

    Raises
    ------
    FileError
        When another process holds it, with its name, or when it cannot be taken.
    UsageError
        On a system without such locks: Windows.
    """
    name = f"{target}.lock"
    descriptor = _acquire(name, target)
    try:
        os.truncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
        yield
    finally:
        os.unlink(name)  # noqa: PTH108 - while it is held: whoever waits for it sees that it is gone
        os.close(descriptor)


def _acquire(name: str, target: str) -> int:
    try:
        import fcntl
    except ModuleNotFoundError:
        raise UsageError(
            "a study cannot be run on this system: it has no locks that end with their process (flock)",
            remedy="Run it on Linux or macOS; on Windows, in its subsystem for Linux (WSL).",
        ) from None
    while True:
        try:
            descriptor = os.open(name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            raise FileError(f"{name} cannot be written: {error.strerror}", names=[name]) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 200, 0).decode(errors="replace") or "another process"
            os.close(descriptor)
            problem = f"another study is writing {target}: {holder}"
            raise FileError(
                problem, remedy="Wait for it, or write another file with -o.", names=[target]
            ) from None
        except OSError as error:
            os.close(descriptor)
            raise FileError(f"{name} cannot be locked: {error.strerror}", names=[name]) from error
        if _is_there(descriptor, name):
            return descriptor
        os.close(descriptor)  # its last holder has removed it in the meantime


def _is_there(descriptor: int, name: str) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(name))  # noqa: PTH116
    except FileNotFoundError:
        return False
