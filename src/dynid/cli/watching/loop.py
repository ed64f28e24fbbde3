"""The loop of `dynid watch`: wait for a change, run, show."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from dynid.cli.watching.files import Stamp, files_of, stamp
from dynid.errors import DynidError

if TYPE_CHECKING:
    from dynid.cli.watching.board import Board
    from dynid.result import Result
    from dynid.scene.load import Scene

#: Seconds between two looks; a file counts as saved when two looks in a row see the same.
_LOOK = 0.15


class Watch:
    """A scene that is watched.

    Parameters
    ----------
    scene
        Its file.
    overrides
        As of `--set`.
    output
        The HDF5 file of the last good result, if it is wanted.
    board
        What the page shows.
    """

    def __init__(self, scene: str, overrides: Sequence[str], output: str | None, board: Board) -> None:
        self.scene, self.overrides, self.output, self.board = scene, tuple(overrides), output, board
        self._files: list[Path] = []
        board.put(page=self._waiting())

    def run(self) -> None:
        """Run the scene now and after every change, until interrupted."""
        while True:
            self._files = files_of(self.scene)
            before = stamp(self._files)
            self.show()
            self._wait(before)

    def show(self) -> None:
        """Run the scene once, and show its result or its faults."""
        started = time.perf_counter()
        self.board.put(running=True)
        fault = self._attempt()
        self.board.put(running=False, fault=fault)
        said = fault or f"{self.scene}: done in {time.perf_counter() - started:.2g} s"
        click.echo(said, err=True)

    def _attempt(self) -> str:
        """Run the scene; return what is wrong, if anything is."""
        try:
            self._compute()
        except DynidError as error:
            return str(error)
        except MemoryError:
            return f"{self.scene}: this needs more memory than there is"
        except Exception as error:
            return f"{self.scene}: a fault of dynid itself: {type(error).__name__} {error}"
        return ""

    def _compute(self) -> None:
        from dynid.scene.load import load_scene

        scene = load_scene(self.scene, self.overrides)
        if scene.kind == "study":
            self._look_at(scene)
            return
        from dynid.cli.run import compute

        result = compute(scene, lambda _: None, accuracy=False)
        if self.output:
            from dynid.store import write_result

            write_result(result, self.output)
        self._publish(result)

    def _look_at(self, study: Scene) -> None:
        """Run some of a study's samples, and show what they tell; more of them where they are quick."""
        from dynid.atomic import replace_file
        from dynid.cli.watching.sample import looks
        from dynid.store import open_stored

        with TemporaryDirectory() as folder:
            target = Path(folder) / "study.h5"
            for note in looks(study, target):
                with open_stored(target) as result:
                    self._publish(result, note)
            if self.output:
                replace_file(self.output, target.read_bytes())

    def _publish(self, result: Result, note: str = "") -> None:
        from dynid.report.page import page

        version = self.board.now.version + 1
        self.board.put(page=page(result, live=version, note=note), version=version, fault="")

    def _wait(self, before: Stamp) -> None:
        """Return when a file has changed, and no longer does."""
        last = before
        while True:
            time.sleep(_LOOK)
            now = stamp(self._files)
            if now == last and now != before:
                return
            last = now

    def _waiting(self) -> str:
        from dynid.report.page.shell import shell

        return shell(Path(self.scene).name, "waiting for a first result", [], ["watch.js"], live=0)
