"""What may come of a scene that nobody means well with."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import signal
import time
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from dynid.cli import main

_ROOT = Path(__file__).parents[2]
_MATRIX = "%%MatrixMarket matrix coordinate real symmetric\n2 2 3\n1 1 2\n2 2 2\n2 1 -1\n"
_LOCATED = re.compile(r".+?:\d+:\d+: \S")
_COUNT = re.compile(r"\d+ faults?$")
#: Exit codes that a command may leave with.
CODES = {"check": (0, 2, 3, 4), "run": (0, 1, 2, 3, 4)}
#: Wall-clock seconds for each second of CPU time, on a busy machine or where something waits for ever.
_PATIENCE = 30


class Verdict(NamedTuple):
    """What a command did: exit code, what is wrong with that (nothing: empty), messages, CPU seconds."""

    code: int | None
    wrong: str
    messages: int
    seconds: float


class _TooLong(BaseException):  # which nobody catches on the way
    pass


def _too_long(*_):
    raise _TooLong


@contextlib.contextmanager
def _limited(seconds):
    """Raise in what takes longer, in CPU time; a wait that takes none ends, too."""
    clocks = (
        (signal.ITIMER_PROF, signal.SIGPROF, seconds),
        (signal.ITIMER_REAL, signal.SIGALRM, seconds * _PATIENCE),
    )
    before = [signal.signal(number, _too_long) for _, number, _ in clocks]
    for clock, _, limit in clocks:
        signal.setitimer(clock, limit)
    try:
        yield
    finally:
        for clock, _, _ in clocks:
            signal.setitimer(clock, 0)
        for (_, number, _), handler in zip(clocks, before, strict=True):
            signal.signal(number, handler)


class Sandbox:
    """A folder with a scene among things that a scene may name, and must not change.

    Parameters
    ----------
    folder
        An empty folder.
    """

    def __init__(self, folder):
        self._root = folder
        scenes = shutil.copytree(_ROOT / "configs", folder / "configs")
        shutil.copytree(_ROOT / "data", folder / "data")
        shutil.copytree(_ROOT / "data", scenes / "data")  # what the scenes of the folder above name
        self.folder, self.scene = scenes / "studies", scenes / "studies" / "scene.yaml"
        for table in (_ROOT / "src" / "dynid" / "templates").glob("*.csv"):
            shutil.copy(table, self.folder)
        self.output = folder / "out" / "scene.h5"
        for made in (self.output.parent, self.folder / "folder"):
            made.mkdir()
        os.mkfifo(self.folder / "pipe")
        (self.folder / "loop").symlink_to("loop")
        (self.folder / "empty.csv").touch()
        (self.folder / "kept.csv").write_text("a,b\n" + "".join(f"{k},{k * k % 7}\n" for k in range(60)))
        (self.folder / "kept.mtx").write_text(_MATRIX)
        (self.folder / "kept.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
        np.savez(self.folder / "kept.npz", K=np.eye(2), M=np.array([[{}]], dtype=object))
        with h5py.File(self.folder / "kept.h5", "w") as store:
            store["K"] = np.eye(2)
        self._kept = self._listing()

    def _listing(self):
        """Return what there is but for the scene and its result: names, sizes, times of the last change."""
        found, waiting = [], [self._root]
        while waiting:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    status = entry.stat(follow_symlinks=False)
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    elif entry.path not in (str(self.scene), str(self.output)):
                        found.append((entry.path, status.st_size, status.st_mtime_ns))
        return sorted(found)

    def judge(self, text, command="check", *, seconds=10):
        """Give a scene to a command, and say what is wrong with what it does.

        A scene may be refused with one of the exit codes; then every line of the message has its place. It
        may not take more CPU seconds, end in a traceback, be called a fault of dynid, or touch a file.
        """
        self.scene.write_bytes(text.encode("utf-8", "surrogatepass"))
        arguments = [command, str(self.scene), "-q"]
        if command == "run":
            self.output.unlink(missing_ok=True)
            arguments += ["-o", str(self.output)]
        errors, began, code, wrong = io.StringIO(), time.process_time(), None, ""
        try:
            with (
                contextlib.chdir(self.folder),
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(errors),
                _limited(seconds),
            ):
                main(arguments)
        except SystemExit as left:
            code = left.code
        except _TooLong:
            wrong = f"took more than {seconds} s"
        except BaseException as error:
            wrong = f"escaped: {error!r}"
        took, told = time.process_time() - began, errors.getvalue()
        wrong = wrong or _judged(code, told, CODES[command])
        if not wrong and self._listing() != self._kept:
            changed = sorted(set(self._listing()) ^ set(self._kept))
            self._kept, wrong = self._listing(), f"changed the folder: {changed}"
        return Verdict(code, wrong, len(told.splitlines()), took)


def _judged(code, errors, codes):
    if "fault of dynid itself" in errors or "Traceback" in errors:
        return errors
    if code not in codes:
        return f"exit code {code}: {errors}"
    if code in (2, 4):
        wrong = [line for line in errors.splitlines() if not _LOCATED.match(line) and not _COUNT.match(line)]
        if wrong or not errors:
            return f"not located: {wrong[:3]}"
    return "" if code in (0, 1, 2) or errors.strip() else "no message"
