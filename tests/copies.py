"""Work in a copy of the process, which it may end."""

import json
import os
import signal
import warnings


def told_by_a_copy(work, seconds=30):
    """Return what a copy of this process yields of some work until that ends or it dies, and how it ends."""
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of the linear algebra are not needed
        child = os.fork()
    if child == 0:
        try:
            signal.alarm(seconds)
            for item in work():
                os.write(writer, f"{json.dumps(item)}\n".encode())
            os._exit(0)
        finally:
            os._exit(1)
    os.close(writer)
    with os.fdopen(reader) as report:
        told = [json.loads(line) for line in report]
    return told, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
