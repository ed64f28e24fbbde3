"""Work on files of unknown origin in a separate process, which the work may end.

Compiled parsers trust their input: a changed byte can make them crash, loop, or ask for any amount of memory.
A process started for the purpose meets that first. It runs on all systems and beside threads, which a copy
by `fork` does not.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import import_module

#: The time that a trial may take, s.
SECONDS = 30.0
_START = """
import json, sys
sys.path[:], *call = json.load(sys.stdin)
from dynid.trial import work
work(*call)
"""
_ENDED, _NOT_STARTED = 0, 1  # what Python itself returns


def survives(function: str, *arguments: str, seconds: float = SECONDS, memory: int = 0) -> bool | None:
    """Return True if a separate process survives calling a function, False if not, None where none can start.

    The process is silent, and imports what this one can.

    Parameters
    ----------
    function
        As ``package.module:function``. An error that it raises counts as a process that could not start; a
        lack of memory as one that did not survive.
    *arguments
        Its arguments.
    seconds
        After this time the process is ended, and did not survive.
    memory
        The most memory that it may claim, bytes, where the system can limit it; 0: no limit.
    """
    program = os.path.basename(sys.executable or "").lower()  # noqa: PTH119 - may be empty
    if getattr(sys, "frozen", False) or not program.startswith(("python", "pypy")):
        return None  # embedded in another program, which must not be started again
    paths = [place for place in sys.path if isinstance(place, str)]
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-c", _START],
            input=json.dumps([paths, function, memory, *arguments]).encode(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            timeout=seconds,
            check=False,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except subprocess.TimeoutExpired:
        return False
    except OSError:
        return None
    return {_ENDED: True, _NOT_STARTED: None}.get(ended.returncode, False)


def work(function: str, memory: int, *arguments: str) -> None:
    """Call a function within limits: what the separate process does."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    except (ImportError, AttributeError, OSError, ValueError):  # Windows, or limits that are lower already
        _no_dialogs()
    module, _, name = function.partition(":")
    try:
        getattr(import_module(module), name)(*arguments)
    except MemoryError:
        os._exit(2)


def _no_dialogs() -> None:
    """Let a crash on Windows end the process without a dialog that waits."""
    if sys.platform == "win32":
        import msvcrt

        msvcrt.SetErrorMode(msvcrt.SEM_FAILCRITICALERRORS | msvcrt.SEM_NOGPFAULTERRORBOX)
