"""Run the code of documentation pages and update their outputs: `python docs/replay.py PAGE…`.

A page's blocks with a title become files; `console` blocks hold commands after `$ `, each followed by
what it prints; Python blocks are run in the same folder, and a `text` block right after one holds what it
prints. All of a page happens in one empty folder, in order. In a printed output `…` stands for anything.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

BLOCK = re.compile(
    r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<code>.*?)^```$', re.DOTALL | re.MULTILINE
)
#: What a run took differs from run to run, and with it the space before it.
TIME = re.compile(r" {2,}(\S.* · )\d[\d.e+]* m?s$", re.MULTILINE)


def write_commands(folder: Path) -> None:
    """Write the commands `dynid` and `python` of this interpreter into a folder."""
    for name, call in {"dynid": f"{sys.executable} -m dynid", "python": sys.executable}.items():
        (folder / name).write_text(f'#!/bin/sh\nexec {call} "$@"\n')
        (folder / name).chmod(0o755)


class Session:
    """An empty folder, and a shell and a Python in it; `write` writes the commands `dynid` and `python`."""

    def __init__(self, folder: Path, write: Callable[[Path], None] = write_commands) -> None:
        self.folder = folder
        self._commands = commands = folder / ".bin"
        commands.mkdir()
        write(commands)
        self.environment = os.environ | {"PATH": f"{commands}:{os.environ['PATH']}", "COLUMNS": "110"}

    def shell(self, command: str) -> str:
        """Return what a command prints."""
        return self._run(["bash", "-c", command])

    def python(self, code: str) -> str:
        """Return what some Python prints."""
        return self._run([str(self._commands / "python"), "-c", code])

    def _run(self, call: list[str]) -> str:
        left = subprocess.run(
            call, cwd=self.folder, env=self.environment, text=True, timeout=300, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        return left.stdout


def commands(code: str) -> Iterator[tuple[str, str]]:
    """Yield the commands of a console block, each with what is printed below it."""
    for part in re.split(r"^\$ ", code, flags=re.MULTILINE)[1:]:
        command, _, printed = part.partition("\n")
        yield command, printed


def matches(printed: str, said: str) -> bool:
    """Tell whether an output is what is printed on a page; `…` on a line of its own stands for any lines."""
    wanted, found = (TIME.sub(r"  \1§", text.strip("\n")) for text in (printed, said))
    wanted = re.sub(r"^ +…$", "…", wanted, flags=re.MULTILINE)
    lines = [".*".join(map(re.escape, line.split("…"))) for line in ["", *wanted.split("\n"), ""]]
    pattern = "\n".join(lines).replace("\n.*\n", "\n(?:.*\n)*?")
    return re.fullmatch(pattern, f"\n{found}\n") is not None


class Replay:
    """One page, replayed in one folder."""

    def __init__(self, page: str, folder: Path, write: Callable[[Path], None] = write_commands) -> None:
        self.page = page
        self.outputs: list[tuple[str, str, str]] = []  # the command, what the page prints, what it says now
        self._session = Session(folder, write)
        self._folder = folder
        self._printed = ""  # by the Python before

    def run(self) -> str:
        """Replay the page, and return it with the outputs of now; what still matches stays as it is."""
        return BLOCK.sub(self._block, self.page)

    def _block(self, block: re.Match[str]) -> str:
        kind, code = block["kind"], block["code"]
        if block["title"]:
            (self._folder / block["title"]).write_text(code)
        elif kind == "python":
            self._printed = self._session.python(code)
        elif kind == "text" and self._printed:
            said, self._printed = self._printed, ""
            return f"```text\n{self._output('python', code, said)}```"
        elif kind == "console":
            parts = [
                f"$ {command}\n{self._output(command, printed, self._session.shell(command))}"
                for command, printed in commands(code)
            ]
            return f"```console\n{''.join(parts)}```"
        return block.group()

    def _output(self, command: str, printed: str, said: str) -> str:
        self.outputs.append((command, printed, said))
        if matches(printed, said):
            return printed
        return said if not said or said.endswith("\n") else f"{said}\n"


def main(pages: list[str]) -> None:
    """Write the outputs of pages anew."""
    for name in pages:
        with tempfile.TemporaryDirectory() as folder:
            Path(name).write_text(Replay(Path(name).read_text(), Path(folder)).run())


if __name__ == "__main__":
    main(sys.argv[1:])
