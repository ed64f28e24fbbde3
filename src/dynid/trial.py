"""Work in a separate process, which is ended at a limit of time or of memory, or by the work itself.

Compiled parsers trust their input: a changed byte can make them crash, loop, or ask for any amount of memory.
A process started for the purpose meets that first. It runs on all systems and beside threads, which a copy
by `fork` does not. Samples of studies and alternatives of benchmarks run in such processes, too.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib import import_module
from typing import IO, Any, Self

#: The time that a trial may take, s.
SECONDS = 30.0
# Elapsed over processor time, at most: of a machine with many other processes.
_LOADED = 5.0
#: Environment that limits linear algebra to one thread.
ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)

_BOOT = (
    "import json, sys; paths, memory = json.loads(sys.argv[1]); sys.path[:] = paths or sys.path; "
    "from dynid.trial import serve; serve(memory)"
)
_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)
_LENGTH = struct.Struct("<Q")
_RETURNED, _RAISED, _SENT = range(3)  # kinds of replies


class TimeLimitExceeded(Exception):
    """A call exceeded its time limit."""


class ProcessDied(Exception):
    """The process of a call ended before the call."""


class ChildProcess:
    """A silent process that runs one call at a time, can be killed, and ends with this one.

    Calls and replies are pickled. The process imports what this one can; another interpreter (`python`) has
    its own paths. `environment` are variables besides those of this process, `memory` is the most memory that
    it may claim, bytes, where the system can limit it; 0: no limit.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(
        self, environment: Mapping[str, str] | None = None, *, python: str | None = None, memory: int = 0
    ) -> None:
        own = python in (None, sys.executable)
        paths = [path for path in sys.path if isinstance(path, str)] if own else []
        self._process = subprocess.Popen(
            [python or sys.executable, *(["-P"] if own else []), "-c", _BOOT, json.dumps([paths, memory])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **(environment or {})},
            # Ctrl-C is handled by this process.
            process_group=0 if os.name == "posix" else None,
            creationflags=_NO_WINDOW,
        )
        self._replies: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        threading.Thread(target=_receive, args=(self._process.stdout, self._replies), daemon=True).start()

    def run(self, seconds: float | None, call: Callable[..., Any] | str, *arguments: Any) -> Any:
        """Return the value of a call, a function or ``package.module:function``, or raise its exception.

        Raises
        ------
        TimeLimitExceeded
            If the call takes longer than `seconds`, unless that is None. The process is killed.
        ProcessDied
            If the process ends.
        """
        self._begin(call, arguments, sends=False)
        kind, value = self._reply(seconds)
        if kind == _RAISED:
            raise value
        return value

    def messages(self, seconds: float, call: Callable[..., Any] | str, *arguments: Any) -> Iterator[Any]:
        """Yield what a call sends by its first argument, a function, until it ends or `seconds` are over."""
        until = time.monotonic() + seconds
        with contextlib.suppress(TimeLimitExceeded, ProcessDied):
            self._begin(call, arguments, sends=True)
            while (reply := self._reply(until - time.monotonic()))[0] == _SENT:
                yield reply[1]

    def close(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.wait()
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin(self, call: Callable[..., Any] | str, arguments: tuple[Any, ...], sends: bool) -> None:
        assert self._process.stdin is not None
        message = pickle.dumps((call, arguments, sends))
        with contextlib.suppress(OSError, ValueError):  # the pipe is closed, as that of the replies
            _write(self._process.stdin, message)

    def _reply(self, seconds: float | None) -> tuple[int, Any]:
        try:
            message = self._replies.get(timeout=None if seconds is None else max(0.0, seconds))
        except queue.Empty:
            self.close()
            raise TimeLimitExceeded from None
        if message is None:
            self._replies.put(None)
            self.close()
            raise ProcessDied
        reply: tuple[int, Any] = pickle.loads(message)
        return reply


def survives(function: str, *arguments: str, seconds: float = SECONDS, memory: int = 0) -> bool | None:
    """Return True if a separate process survives calling a function, False if not, None where none can start.

    An error that the function (``package.module:function``) raises counts as a process that could not start;
    a lack of memory (`memory` as of `ChildProcess`) and one that takes longer than `seconds`, of processor
    time where the system limits it, as one that did not survive.
    """
    if not _can_start():
        return None
    try:
        child = ChildProcess({"OPENBLAS_NUM_THREADS": "1"}, memory=memory)
    except OSError:
        return None
    outcome, elapsed = None, seconds * (_LOADED if limits_processor_time() else 1.0)
    with child:
        try:
            child.run(elapsed, bool)
            outcome = False  # from here on it has started
            child.run(elapsed, limit_processor_time, seconds)
            child.run(elapsed, function, *arguments)
        except (TimeLimitExceeded, MemoryError):
            return False
        except ProcessDied:
            return outcome
        except Exception:
            return None
    return True


def messages(function: str, *arguments: str, seconds: float) -> Iterator[Any] | None:
    """Return what a separate process sends while it calls a function; None where none can start.

    The function (``package.module:function``) is called with a function that sends. After `seconds` the
    process is ended, and what it has sent until then is all there is.
    """
    try:
        child = ChildProcess() if _can_start() else None
    except OSError:
        child = None
    return None if child is None else _messages_of(child, function, arguments, seconds)


def _messages_of(
    child: ChildProcess, function: str, arguments: tuple[str, ...], seconds: float
) -> Iterator[Any]:
    with child:
        yield from child.messages(seconds, function, *arguments)


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


def serve(memory: int) -> None:
    """Run calls from standard input, in the separate process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _limit(memory)
    requests, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1):
        os.dup2(nothing, descriptor)  # output of calls must not mix with replies

    def reply(kind: int, value: Any) -> None:
        _write(replies, pickle.dumps((kind, value)))

    calls: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(requests, calls, True), daemon=True).start()
    while (message := calls.get()) is not None:
        try:
            call, arguments, sends = pickle.loads(message)
            if isinstance(call, str):
                module, _, name = call.partition(":")
                call = getattr(import_module(module), name)
            value = call(*([partial(reply, _SENT)] if sends else []), *arguments)
        except Exception as error:
            reply(_RAISED, error)
        else:
            reply(_RETURNED, value)


def _write(stream: IO[bytes], message: bytes) -> None:
    stream.write(_LENGTH.pack(len(message)))
    stream.write(message)
    stream.flush()


def _receive(stream: IO[bytes], arrived: queue.SimpleQueue[bytes | None], last: bool = False) -> None:
    """Queue messages until the other side has closed; then end this process, if it is `last`."""
    with stream:
        while len(head := stream.read(_LENGTH.size)) == _LENGTH.size:
            (length,) = _LENGTH.unpack(head)
            if len(message := stream.read(length)) < length:
                break
            arrived.put(message)
    if last:
        os._exit(0)
    arrived.put(None)


def _limit(memory: int) -> None:
    """Let a crash leave no file and no dialog, and limit the memory where a number of bytes is given."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    except (ImportError, AttributeError, OSError, ValueError):  # Windows, or limits that are lower already
        if sys.platform == "win32":
            import msvcrt

            msvcrt.SetErrorMode(msvcrt.SEM_FAILCRITICALERRORS | msvcrt.SEM_NOGPFAULTERRORBOX)
