"""The benchmarks by name; a benchmark is loaded when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.bench.alternative import Benchmark

#: Names, and the module that holds each.
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


def benchmark(name: str) -> Benchmark:
    """Load a benchmark."""
    found: Benchmark = import_module(f"dynid.bench.cases.{BENCHMARKS[name]}").BENCHMARK
    return found
