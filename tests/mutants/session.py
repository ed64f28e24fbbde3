"""A session of pytest that collects once, and tries every mutant in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.mutants.graft import graft
from tests.mutants.operators import Mutant
from tests.mutants.targets import LEFT_OUT, MODULES, ROOT, TESTS

_BYTES = 8 * 2**30
#: CPU seconds that a test of a mutant may take: so many times what it takes without, and some more.
_TIMES, _MORE = 4, 2


class Session:
    """A plugin: measures which test reaches which line, and tries mutants on the tests that reach theirs.

    Parameters
    ----------
    chosen
        The mutants.
    sources
        The modules' sources.
    told
        Called with each mutant and what became of it: killed, survived, timeout, or not reached.
    known
        A file of what tests reach, from another time, and for the next; what is in it is not measured anew.
    jobs
        How many mutants are tried at a time.
    """

    def __init__(
        self,
        chosen: list[Mutant],
        sources: dict[str, str],
        told: Callable[[Mutant, str], None],
        known: Path | None = None,
        jobs: int = 1,
    ) -> None:
        self._chosen, self._sources, self._told, self._known = chosen, sources, told, known
        self._jobs, self._failed = jobs, list[str]()

    def pytest_configure(self) -> None:
        """Let hypothesis try the same examples each time."""
        from hypothesis import HealthCheck, Phase, settings

        settings.register_profile(
            "mutants",
            derandomize=True,
            database=None,
            deadline=None,
            phases=[Phase.explicit, Phase.generate],  # a failure is enough, whether small or not
            suppress_health_check=list(HealthCheck),
        )
        settings.load_profile("mutants")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note what fails."""
        if report.failed:
            self._failed.append(report.nodeid)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Try the mutants instead of running the tests."""
        if session.testsfailed:
            raise session.Interrupted("the tests cannot be collected")
        known = json.loads(self._known.read_text()) if self._known and self._known.exists() else {}
        known |= _in_child(lambda: self._map([item for item in session.items if item.nodeid not in known]))
        if self._known:
            self._known.write_text(json.dumps(known))
        seconds = {item: known[item.nodeid][0] for item in session.items}
        reached = {item: set(known[item.nodeid][1]) for item in session.items}
        quick = sorted(session.items, key=seconds.__getitem__)
        running: dict[int, Mutant] = {}
        for mutant in self._chosen:
            wanted = {f"{mutant.module}:{line}" for line in mutant.lines}
            tests = [item for item in quick if mutant.names or wanted & reached[item]]
            if not tests:
                self._told(mutant, "not reached")
                continue
            running[self._start(mutant, {item: _TIMES * seconds[item] + _MORE for item in tests})] = mutant
            if len(running) >= self._jobs:
                self._await(running)
        while running:
            self._await(running)
        return True

    def _map(self, items: list[pytest.Item]) -> dict[str, tuple[float, list[str]]]:
        """Run tests; return the CPU seconds that each takes, and the lines that it reaches."""
        files = {str(path): name for name, path in MODULES.items()}
        found = {}
        for item in items:
            lines: set[str] = set()

            def local(frame, _event, _argument, lines=lines):
                lines.add(f"{files[frame.f_code.co_filename]}:{frame.f_lineno}")
                return local

            began = time.process_time()
            sys.settrace(lambda frame, *_: local if frame.f_code.co_filename in files else None)
            try:
                item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
            finally:
                sys.settrace(None)
            found[item.nodeid] = time.process_time() - began, sorted(lines)
        if self._failed:
            raise SystemExit(f"these fail without a mutant: {', '.join(self._failed)}")
        return found

    def _start(self, mutant: Mutant, limits: dict[pytest.Item, float]) -> int:
        """Try a mutant on tests, in a process whose number is returned."""
        child = os.fork()
        if child:
            return child
        with contextlib.suppress(BaseException):
            _quiet()
            graft(mutant, str(MODULES[mutant.module]), self._sources[mutant.module])
            for item, seconds in limits.items():
                signal.setitimer(signal.ITIMER_PROF, seconds)  # its signal ends the process
                item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
                if self._failed:
                    break
            else:
                os._exit(0)
        os._exit(1)

    def _await(self, running: dict[int, Mutant]) -> None:
        """Wait for one of the processes, and tell what became of its mutant."""
        child, status = os.waitpid(-1, 0)
        late = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGPROF
        self._told(running.pop(child), "timeout" if late else "killed" if status else "survived")


def _quiet() -> None:
    """Let this process print nothing, and take no more memory than so much."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))


def _in_child(work: Callable[[], dict[str, tuple[float, list[str]]]]) -> dict[str, tuple[float, list[str]]]:
    """Do this in a process of its own, so that this one remains as it is."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        child = os.fork()
        if child == 0:
            code = 1
            try:
                answer.write_text(json.dumps(work()))
                code = 0
            except SystemExit as failed:
                print(failed, file=sys.stderr, flush=True)
            finally:
                os._exit(code)
        if os.waitpid(child, 0)[1]:
            raise pytest.exit.Exception("the tests must pass before mutants are tried", returncode=2)
        found: dict[str, tuple[float, list[str]]] = json.loads(answer.read_text())
    return found


def run(session: Session) -> int:
    """Try a session's mutants; return pytest's exit code."""
    arguments = [
        *("-q", "--tb=no", "--no-header", "--no-summary", "-p", "no:cacheprovider", "--capture=no"),
        f"--rootdir={ROOT}",
        *(str(ROOT / test) for test in TESTS),
        *(f"--deselect={test}" for test in LEFT_OUT),
    ]
    return int(pytest.main(arguments, plugins=[session]))
