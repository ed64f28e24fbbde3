"""What a benchmark is: alternatives that do the same work at several sizes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any, NamedTuple

#: Environment variable: a Python with peers that are not installed beside dynid, and with dynid itself.
PEERS = "DYNID_PEERS"


@dataclass(frozen=True)
class Alternative:
    """One way to do the work of a benchmark.

    Parameters
    ----------
    name
        Its name, as in the results.
    prepare
        Given a size, everything that is not to be timed; returns the work to time.
    needs
        Packages that it needs beyond dynid's own.
    least, most
        Smallest and largest size that it is tried at: below the one it is the same as another, say.
    peer
        Whether another project's users do it so: the suite's default should not lose to it.
    """

    name: str
    prepare: Callable[[int], Callable[[], Any]]
    needs: tuple[str, ...] = ()
    least: int = 0
    most: int | None = None
    peer: bool = False

    def missing(self) -> str:
        """Say which packages are not installed; empty where it can run."""
        absent = _absent(self.needs) if self.interpreter != sys.executable else self._absent
        return f"{', '.join(absent)} not installed" if absent else ""

    def at(self, size: int) -> bool:
        """Tell whether it is tried at a size."""
        return self.least <= size and (self.most is None or size <= self.most)

    @cached_property
    def interpreter(self) -> str:
        """The Python that runs it: the peers' one, if there is one, where packages are not installed here."""
        return os.environ.get(PEERS, sys.executable) if self._absent else sys.executable

    @property
    def _absent(self) -> list[str]:
        return [package for package in self.needs if find_spec(package) is None]


def _absent(packages: Sequence[str]) -> list[str]:
    """Return which packages the peers' interpreter does not have."""
    script = (
        "import sys; from importlib.util import find_spec as found; "
        "print(*(name for name in sys.argv[1:] if not found(name)))"
    )
    asked = [os.environ[PEERS], "-c", script, "dynid", *packages]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()
    except (OSError, subprocess.CalledProcessError):
        return list(packages)


class Limit(NamedTuple):
    """How many times the time of another (`of`) an alternative may take."""

    alternative: str
    of: str
    most: float


@dataclass(frozen=True)
class Benchmark:
    """Work of several sizes, and the ways to do it.

    Parameters
    ----------
    title
        The work, in a few words.
    size
        What a size counts.
    sizes
        The sizes of a default run.
    alternatives
        The ways, the house's own first.
    error
        Given a size and what the work returned: its error against an exact or high-precision reference.
    measure
        What the error is.
    default
        Given a size, the alternative that the suite itself takes there; absent where it leaves that open.
    full
        Sizes that `--full` adds.
    limits
        What an alternative may take beside another.
    remark
        What the figures do not show.
    """

    title: str
    size: str
    sizes: tuple[int, ...]
    alternatives: Sequence[Alternative]
    error: Callable[[int, Any], float]
    measure: str = "largest relative error"
    default: Callable[[int], str] | None = None
    full: tuple[int, ...] = ()
    limits: tuple[Limit, ...] = ()
    remark: str = ""
