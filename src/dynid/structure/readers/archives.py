"""NumPy archives of what a library reads, in a separate process, from a file of unknown origin."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from dynid import trial

KEPT = 8
"""Archives kept at a time."""
_archives: dict[tuple[object, ...], Path] = {}


class DiedError(Exception):
    """The separate process crashed, hung, or lacked memory."""


def archived(path: Path, function: Callable[..., None], *arguments: str, seconds: float, memory: int) -> Path:
    """Return the archive that a function writes of a file, anew only where the file has changed.

    Parameters
    ----------
    path
        The file.
    function
        A function of a module with the paths of the file and of its archive, and the arguments.
    seconds, memory
        Its limits, as of `trial.survives`.

    Raises
    ------
    DiedError
        If the process does not survive reading the file.
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
