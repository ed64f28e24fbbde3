"""Work on files of unknown origin in a separate process, which the work may end.

Compiled parsers trust their input: a changed byte can make them crash, loop, or ask for any amount of memory.
A process started for the purpose meets that first. It runs on all systems and beside threads, which a copy
by `fork` does not.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from importlib import import_module
from typing import Any

#: The time that a trial may take, s.
SECONDS = 30.0
_START = """
import json, sys
sys.path[:], task, *call = json.load(sys.stdin)
import dynid.trial
getattr(dynid.trial, task)(*call)
"""
_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)
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
    if not _can_start():
        return None
    try:
        ended = subprocess.run(
            _command(),
            input=_call("work", function, memory, *arguments),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            timeout=seconds,
            check=False,
            creationflags=_NO_WINDOW,
        )
    except subprocess.TimeoutExpired:
        return False
    except OSError:
        return None
    return {_ENDED: True, _NOT_STARTED: None}.get(ended.returncode, False)


def messages(function: str, *arguments: str, seconds: float) -> Iterator[Any] | None:
    """Return what a separate process sends while it calls a function; None where none can start.

    Parameters
    ----------
    function
        As ``package.module:function``; called with a function that sends what JSON can write.
    *arguments
        Its further arguments.
    seconds
        After this time the process is ended, and what it has sent until then is all there is.
    """
    if not _can_start():
        return None
    try:
        process = subprocess.Popen(
            _command(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            creationflags=_NO_WINDOW,
        )
    except OSError:
        return None
    return _messages_of(process, _call("send_messages", function, *arguments), seconds)


def _messages_of(process: subprocess.Popen[bytes], call: bytes, seconds: float) -> Iterator[Any]:
    assert process.stdin is not None
    assert process.stdout is not None
    timer = threading.Timer(seconds, process.kill)
    timer.daemon = True
    timer.start()
    try:
        with process, contextlib.suppress(BrokenPipeError):
            try:
                process.stdin.write(call)
                process.stdin.close()
                for line in process.stdout:
                    if line.endswith(b"\n"):  # else it was ended in the middle
                        yield json.loads(line)
            finally:
                process.kill()
    finally:
        timer.cancel()


def send_messages(function: str, *arguments: str) -> None:
    """Call a function with one that sends messages: what the separate process does."""
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # of whatever else writes there

    def send(message: object) -> None:
        stream.write(f"{json.dumps(message)}\n")
        stream.flush()

    _limit_core()
    module, _, name = function.partition(":")
    getattr(import_module(module), name)(send, *arguments)


def limits_processor_time() -> bool:
    """Return True where the system can end a process after a processor time; Windows cannot."""
    return hasattr(signal, "ITIMER_PROF")


def limit_processor_time(seconds: float) -> None:
    """End this process after so much more processor time, whatever it does, where the system can."""
    if limits_processor_time():
        signal.signal(signal.SIGPROF, signal.SIG_DFL)  # the system ends it, not Python
        signal.setitimer(signal.ITIMER_PROF, seconds)


def _can_start() -> bool:
    """Return False where Python is embedded in another program, which must not be started again."""
    program = os.path.basename(sys.executable or "").lower()  # noqa: PTH119 - may be empty
    return not getattr(sys, "frozen", False) and program.startswith(("python", "pypy"))


def _command() -> list[str]:
    return [sys.executable, "-P", "-c", _START]


def _call(task: str, *call: object) -> bytes:
    paths = [path for path in sys.path if isinstance(path, str)]
    return json.dumps([paths, task, *call]).encode()


def work(function: str, memory: int, *arguments: str) -> None:
    """Call a function within limits: what the separate process does."""
    _limit_core(memory)
    module, _, name = function.partition(":")
    try:
        getattr(import_module(module), name)(*arguments)
    except MemoryError:
        os._exit(2)


def _limit_core(memory: int = 0) -> None:
    """Let a crash leave no file, and limit the memory where a number of bytes is given."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    except (ImportError, AttributeError, OSError, ValueError):  # Windows, or limits that are lower already
        _no_dialogs()


def _no_dialogs() -> None:
    """Let a crash on Windows end the process without a dialog that waits."""
    if sys.platform == "win32":
        import msvcrt

        msvcrt.SetErrorMode(msvcrt.SEM_FAILCRITICALERRORS | msvcrt.SEM_NOGPFAULTERRORBOX)
