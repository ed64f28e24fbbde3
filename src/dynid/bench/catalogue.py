"""The benchmarks by name; a benchmark is loaded when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from dynid.bench.alternative import Benchmark

#: Longest default run, s.
DEFAULT_RUN = 170.0


class Place(NamedTuple):
    """The module that holds a benchmark, and what it needs of a default run on two quiet cores, s.

    It may take what those after it do not need; on a slower machine its larger sizes are left out, and named.
    """

    module: str
    seconds: float


#: The benchmarks by name, in the order of a run.
BENCHMARKS = {
    "frequency-response": Place("frequency_response", 18),
    "frequency-response-on-loops": Place("frequency_response_on_loops", 8),
    "zeros-poles": Place("zeros_poles", 12),
    "polynomials": Place("polynomials", 3),
    "loops": Place("loops", 3),
    "symbolic": Place("symbolic", 3),
    "pencils": Place("pencils", 2),
    "propagation": Place("propagation", 7),
    "filters": Place("filters", 18),
    "estimators": Place("estimators", 11),
    "reduction": Place("reduction", 9),
    "basis": Place("basis", 3),
    "residuals": Place("residuals", 2),
    "modes": Place("modes", 13),
    "modes-of-solids": Place("modes_of_solids", 3),
    "many-modes": Place("many_modes", 2),
    "structure-response": Place("structure_response", 3),
    "startup": Place("startup", 17),
    "study": Place("study", 18),
}


def benchmark(name: str) -> Benchmark:
    """Load a benchmark."""
    found: Benchmark = import_module(f"dynid.bench.cases.{BENCHMARKS[name].module}").BENCHMARK
    return found
