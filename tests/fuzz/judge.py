"""What may come of a scene that nobody means well with."""

from __future__ import annotations

import contextlib
import io
import re
import signal

from dynid.cli import main

_LOCATED = re.compile(r".+?:\d+:\d+: \S")
_COUNT = re.compile(r"\d+ faults?$")


class _TooLongError(Exception):
    pass


def _too_long(*_):
    raise _TooLongError


def verdict(text, scene, *command, seconds=10, codes=(0, 2, 4)):
    """Give a scene to a command, and say what is wrong with what it does: nothing, for an empty text.

    A scene may be refused with one of the exit codes; then every line of the message has its place. It may
    not take longer than so many seconds, leave with a traceback, or be called a fault of dynid.
    """
    scene.write_bytes(text.encode("utf-8", "surrogatepass"))
    said, errors = io.StringIO(), io.StringIO()
    before = signal.signal(signal.SIGALRM, _too_long)
    signal.alarm(seconds)
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
            main([command[0], str(scene), "-q", *command[1:]])
    except SystemExit as left:
        code = left.code
    except _TooLongError:
        return f"took more than {seconds} s"
    except BaseException as error:
        return f"escaped: {error!r}"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return _judged(code, errors.getvalue(), codes)


def _judged(code, errors, codes):
    if "fault of dynid itself" in errors or "Traceback" in errors:
        return errors
    if code not in codes:
        return f"exit code {code}: {errors}"
    if code == 2:
        wrong = [line for line in errors.splitlines() if not _LOCATED.match(line) and not _COUNT.match(line)]
        if wrong or not errors:
            return f"not located: {wrong[:3]}"
    return "" if code in (0, 1, 2) or errors.strip() else "no message"
