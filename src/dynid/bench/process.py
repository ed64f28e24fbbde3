"""A worker process that serves requests one by one, and can be stopped after a time limit."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Timer
from types import TracebackType
from typing import Any, Self

#: Environment variables with the number of threads of numerical libraries.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Environment variables with the folder of temporary files.
_FOLDERS = ("TMPDIR", "TEMP", "TMP")


class Process:
    """A process of its own that runs the function `main` of a module, which calls `serve`.

    Requests and responses are pickled: both ends are the same installation.

    Parameters
    ----------
    module
        The module.
    arguments
        Arguments of `main`.
    python
        The interpreter that runs it.
    threads
        Threads of numerical libraries; absent: their default, or that of the environment.
    folder
        Folder of its temporary files; absent: that of this process.
    """

    def __init__(
        self,
        module: str,
        *arguments: str,
        python: str = sys.executable,
        threads: int | None = None,
        folder: str | None = None,
    ) -> None:
        # Imported rather than run: what is pickled must not belong to a module called __main__.
        command = [python, "-c", f"from {module} import main; main(*{arguments!r})"]
        limited = {} if threads is None else dict.fromkeys(_THREADS, str(threads))
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**limited, **os.environ, **({} if folder is None else dict.fromkeys(_FOLDERS, folder))},
        )

    def ask(self, question: Any, seconds: float | None = None) -> Any:
        """Return the response to a request; None where the process ended, or was stopped after `seconds`."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        timer = Timer(seconds if seconds is not None else 0.0, self._process.kill)
        if seconds is not None:
            timer.start()
        try:
            pickle.dump(question, self._process.stdin)
            self._process.stdin.flush()
            return pickle.load(self._process.stdout)
        except (BrokenPipeError, EOFError, pickle.UnpicklingError):
            return None
        finally:
            timer.cancel()

    def close(self) -> None:
        """End the process and abandon its current work."""
        self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(BrokenPipeError):
                if stream is not None:
                    stream.close()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve(answer: Callable[[Any], Any]) -> None:
    """Serve requests from standard input until it ends; output of the work goes to standard error."""
    answers, sys.stdout = sys.stdout.buffer, sys.stderr
    while True:
        try:
            question = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        pickle.dump(answer(question), answers)
        answers.flush()
