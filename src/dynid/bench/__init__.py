"""Speed against error, measured now: alternatives for the same task."""

from dynid.bench.benchmark import BENCHMARKS, DEFAULT_RUN, benchmark
from dynid.bench.suite import run_benchmarks

__all__ = ["BENCHMARKS", "DEFAULT_RUN", "benchmark", "run_benchmarks"]
