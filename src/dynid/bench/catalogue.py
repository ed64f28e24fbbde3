"""The benchmarks by name; a benchmark is loaded when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.bench.alternative import Benchmark

#: Names, and the module that holds each, in the order of a run.
BENCHMARKS = {
    "frequency-response": "frequency_response",
    "frequency-response-on-loops": "frequency_response_on_loops",
    "zeros-poles": "zeros_poles",
    "loops": "loops",
    "symbolic": "symbolic",
    "propagation": "propagation",
    "filters": "filters",
    "estimators": "estimators",
    "reduction": "reduction",
    "basis": "basis",
    "modes": "modes",
    "startup": "startup",
    "study": "study",
}


#: Longest default run, s, and what each benchmark needs of it on a machine of two quiet cores. Each may
#: take what those after it do not need; on a slower machine its larger sizes are left out, and named.
DEFAULT_RUN = 170.0
BUDGETS = {
    "frequency-response": 22.0,
    "zeros-poles": 14.0,
    "loops": 3.0,
    "symbolic": 3.0,
    "propagation": 8.0,
    "filters": 20.0,
    "estimators": 11.0,
    "reduction": 9.0,
    "basis": 5.0,
    "modes": 14.0,
    "startup": 16.0,
    "study": 20.0,
}


def benchmark(name: str) -> Benchmark:
    """Load a benchmark."""
    found: Benchmark = import_module(f"dynid.bench.cases.{BENCHMARKS[name]}").BENCHMARK
    return found
