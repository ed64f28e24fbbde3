"""Processes that need not import: what `python` and `dynid` do, without what loading their modules costs.

A server that has loaded the heavy modules forks a process for each call; `python` and `dynid` on the path are
clients that hand it their arguments, folder, environment and streams. `python -m tests.warm SOCKET` serves.
"""

import atexit
import gc
import importlib
import marshal
import os
import pkgutil
import socket
import subprocess
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import numpy as np

HEAVY = [
    *["control", "pyuff", "pyyeti.nastran.op4", "sympy"],
    *[
        f"scipy.{name}"
        for name in ("integrate", "interpolate", "linalg", "optimize", "signal", "special", "stats")
    ],
    "scipy.sparse.linalg",
]
CLIENT = """\
#!{python} -ISE
import _socket, marshal, os, sys
PREFIX = {prefix!r}
arguments = PREFIX + sys.argv[1:]
if arguments[:1] != ["-c"] and arguments[:2] != ["-m", "dynid"]:
    os.execv({python!r}, [{python!r}, *arguments])
server = _socket.socket(_socket.AF_UNIX, _socket.SOCK_SEQPACKET)
server.connect({path!r})
streams = b"".join(one.to_bytes(4, sys.byteorder) for one in (0, 1, 2))
call = marshal.dumps((arguments, os.getcwd(), dict(os.environ)))
server.sendmsg([call], [(_socket.SOL_SOCKET, _socket.SCM_RIGHTS, streams)])
left = marshal.loads(server.recv(100))
if left < 0:
    os.kill(os.getpid(), -left)
sys.exit(left)
"""


class Warm:
    """A server, which is started when the first client is written."""

    def __init__(self, folder: Path) -> None:
        self._path = str(folder / "socket")
        self._server: subprocess.Popen[str] | None = None

    def clients(self, folder: Path) -> None:
        """Write `python` and `dynid` into a folder."""
        if self._server is None:
            self._server = subprocess.Popen(
                [sys.executable, "-m", "tests.warm", self._path],
                stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1],
            )  # fmt: skip
            assert self._server.stdout is not None
            assert self._server.stdout.readline() == "ready\n"
        for name, prefix in {"python": [], "dynid": ["-m", "dynid"]}.items():
            client = folder / name
            client.write_text(CLIENT.format(python=sys.executable, prefix=prefix, path=self._path))
            client.chmod(0o755)

    def stop(self) -> None:
        """End the server."""
        if self._server is not None:
            self._server.terminate()
            self._server.communicate()


def serve(path: str) -> list[str]:
    """Fork a process for each call; in that process, return the arguments."""
    for name in HEAVY:
        with suppress(ImportError), np.printoptions():  # pyyeti sets them
            importlib.import_module(name)
    dynid = importlib.import_module("dynid")
    for module in pkgutil.walk_packages(dynid.__path__, "dynid."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    gc.freeze()
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(path)
    listener.listen()
    print("ready", flush=True)
    while True:
        connection, _ = listener.accept()
        if os.fork() == 0:
            listener.close()
            break
        connection.close()
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
    call, streams, _, _ = socket.recv_fds(connection, 1 << 20, 3)
    child = os.fork()
    if child:
        left = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        connection.send(marshal.dumps(left))
        os._exit(0)
    connection.close()
    arguments, folder, environment = marshal.loads(call)
    for stream, own in zip(streams, (0, 1, 2), strict=True):
        os.dup2(stream, own)
        os.close(stream)
    sys.stdin, sys.stdout, sys.stderr = (os.fdopen(own, way) for own, way in enumerate("rww"))
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    return arguments


def run(arguments: list[str]) -> None:
    """Do what an interpreter does that is started with `-c CODE` or `-m dynid`."""
    main = sys.modules["__main__"] = ModuleType("__main__")
    sys.path[0] = ""
    if arguments[0] == "-c":
        sys.argv = ["-c", *arguments[2:]]
        exec(compile(arguments[1], "<string>", "exec"), main.__dict__)
    else:
        sys.argv = ["dynid", *arguments[2:]]
        sys.modules["dynid.cli"].main()


if __name__ == "__main__":
    words, code = serve(sys.argv[1]), 0
    try:
        run(words)
    except SystemExit as left:
        code = left.code or 0
    except Exception as error:
        traceback.print_exception(error.with_traceback(error.__traceback__.tb_next))
        code = 1
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # without taking the modules down one by one
