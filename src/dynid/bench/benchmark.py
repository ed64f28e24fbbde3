"""Benchmarks: alternatives that do the same work at several sizes, and the catalogue of all benchmarks.

Alternatives with packages that no part of dynid uses are not in the package: the environment variable
`DYNID_PEER_MODULE` names a module whose `ALTERNATIVES` has more of them by benchmark, and `DYNID_PEERS` a
Python with their packages.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

#: Environment variables with the module of the alternatives of peers, and with the Python that has their
#: packages, and dynid.
PEER_MODULE, PEERS = "DYNID_PEER_MODULE", "DYNID_PEERS"
#: Environment variable with the folder of measured data, which are not in the package.
DATA = "DYNID_DATA"
#: Longest default run, s.
DEFAULT_RUN = 170.0


@dataclass(frozen=True)
class Alternative:
    """One way to do the work of a benchmark."""

    name: str  # in the results
    work: Callable[[Any], Any]  # function of the problem, which is timed: its result
    #: Prepares the problem of a size, untimed; default: that of the benchmark
    problem: Callable[[int], Any] | None = None
    needs: tuple[str, ...] = ()  # packages besides the dependencies of dynid
    min_size: int = 0  # at which it is measured
    max_size: int | None = None
    peer: bool = False  # of another project; the default of dynid should not lose to it
    #: Returns what else is missing, such as a file of data, or an empty text
    unavailable: Callable[[], str] = str

    def missing(self) -> str:
        """Return the packages or data that are missing, as text; '' where it can run."""
        if reason := self.unavailable():
            return reason
        absent = _absent(self.needs) if self.interpreter != sys.executable else self._absent
        return f"{', '.join(absent)} not installed" if absent else ""

    def prepared(self, size: int, problem: Callable[[int], Any] = int) -> Callable[[], Any]:
        """Return the work on the problem of a size; `problem` is that of the benchmark."""
        return partial(self.work, (self.problem or problem)(size))

    def at(self, size: int) -> bool:
        """Return True if it is measured at a size."""
        return self.min_size <= size and (self.max_size is None or size <= self.max_size)

    @cached_property
    def interpreter(self) -> str:
        """The Python that runs it: that of the peers where packages are not installed here."""
        return os.environ.get(PEERS, sys.executable) if self._absent else sys.executable

    @property
    def _absent(self) -> list[str]:
        return [package for package in self.needs if find_spec(package) is None]


class TimeLimit(NamedTuple):
    """Largest ratio of the time of an alternative to that of another (`of`)."""

    alternative: str
    of: str
    max_ratio: float


@dataclass(frozen=True)
class Benchmark:
    """A task of several sizes, and the alternatives for it."""

    title: str
    size: str  # unit of the sizes
    sizes: tuple[int, ...]  # of a default run
    alternatives: Sequence[Alternative]  # those of dynid first
    error: Callable[[int, Any], float]  # of a size and a result, against an exact or high-precision reference
    problem: Callable[[int], Any] = int  # of a size: what the alternatives work on
    measure: str = "largest relative error"  # definition of the error
    default: Callable[[int], str] | None = None  # the alternative that dynid uses by default at a size
    full: tuple[int, ...] = ()  # sizes that `--full` adds
    limits: tuple[TimeLimit, ...] = ()
    remark: str = ""


class _CatalogueEntry(NamedTuple):
    """The module of a benchmark, or `module:name`, and its time in a default run on two idle cores, s.

    It may use time that those after it do not need; on a slower machine larger sizes are left out, and named.
    With no time it is not in a default run, and runs where it is named.
    """

    module: str
    seconds: float


#: The benchmarks by name, in the order of a run.
BENCHMARKS = {
    "frequency-response": _CatalogueEntry("frequency_response", 18),
    "frequency-response-on-loops": _CatalogueEntry("frequency_response:LADDER", 8),
    "frequency-response-of-trees": _CatalogueEntry("frequency_response:TREE", 0),
    "mesh-response": _CatalogueEntry("graph_shapes:MESH_RESPONSE", 0),
    "mesh-roots": _CatalogueEntry("graph_shapes:MESH_ROOTS", 0),
    "ladder-peaks": _CatalogueEntry("graph_shapes:LADDER_PEAKS", 0),
    "chain-whole": _CatalogueEntry("graph_shapes:CHAIN_WHOLE", 0),
    "chain-reading": _CatalogueEntry("graph_shapes:CHAIN_READING", 0),
    "zeros-poles": _CatalogueEntry("zeros_poles:CHAIN", 12),
    "polynomials": _CatalogueEntry("chain:POLYNOMIALS", 3),
    "loops": _CatalogueEntry("zeros_poles:MESH", 3),
    "symbolic": _CatalogueEntry("chain:FORMULA", 3),
    "pencils": _CatalogueEntry("zeros_poles:PENCIL", 2),
    "propagation": _CatalogueEntry("propagation", 7),
    "filters": _CatalogueEntry("estimators:FILTERS", 16),
    "estimators": _CatalogueEntry("estimators:ESTIMATORS", 11),
    "wide-record": _CatalogueEntry("long_records:WIDE_RECORD", 0),
    "long-record": _CatalogueEntry("long_records:LONG_RECORD", 0),
    "reduction": _CatalogueEntry("reduction:PLATE", 9),
    "basis": _CatalogueEntry("reduction:BASIS", 3),
    "residuals": _CatalogueEntry("reduction:RESIDUAL_VECTORS", 2),
    "modes": _CatalogueEntry("modes:PLATE", 13),
    "modes-of-solids": _CatalogueEntry("modes:SOLID", 3),
    "many-modes": _CatalogueEntry("modes:MANY", 2),
    "structure-response": _CatalogueEntry("structure_response", 3),
    "large-structure-response": _CatalogueEntry("structure_response:LARGE", 0),
    "frf-joints": _CatalogueEntry("structure_response:JOINTS", 5),
    "frf-many-joints": _CatalogueEntry("structure_response:MANY_JOINTS", 0),
    "modal-updating": _CatalogueEntry("modal_updating", 0),
    "plate-process": _CatalogueEntry("startup:PLATE", 0),  # minutes at the size that matters
    "craig-bampton": _CatalogueEntry("startup:CRAIG_BAMPTON", 0),
    "many-modes-process": _CatalogueEntry("startup:MANY_MODES", 0),
    "startup": _CatalogueEntry("startup", 17),
    "study": _CatalogueEntry("study", 15),
    "study-of-reductions": _CatalogueEntry("study:REDUCTIONS", 0),
    "study-of-reductions-process": _CatalogueEntry("study:REDUCTION_COMMANDS", 0),
    "study-of-identifications": _CatalogueEntry("study:IDENTIFICATIONS", 0),
    "robot-arm": _CatalogueEntry("robot_arm", 0),  # its data are not in the package
}


def benchmark(name: str) -> Benchmark:
    """Return a benchmark, loaded now, with the alternatives of peers where `DYNID_PEER_MODULE` is set."""
    module, _, attribute = BENCHMARKS[name].module.partition(":")
    case: Benchmark = getattr(import_module(f"dynid.bench.cases.{module}"), attribute or "BENCHMARK")
    if PEER_MODULE not in os.environ:
        return case
    peers = import_module(os.environ[PEER_MODULE]).ALTERNATIVES.get(name, ())
    return replace(case, alternatives=(*case.alternatives, *peers))


def _absent(packages: Sequence[str]) -> list[str]:
    """Return the packages that the Python of the peers lacks."""
    script = (
        "import sys; from importlib.util import find_spec as found; "
        "print(*(name for name in sys.argv[1:] if not found(name)))"
    )
    asked = [os.environ[PEERS], "-c", script, "dynid", *packages]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()
    except (OSError, subprocess.CalledProcessError):
        return list(packages)
