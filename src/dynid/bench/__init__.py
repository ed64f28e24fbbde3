"""Speed against error, measured now: alternatives on the same work, in one go."""

from dynid.bench.catalogue import BENCHMARKS, DEFAULT_RUN, benchmark
from dynid.bench.suite import run_benchmarks

__all__ = ["BENCHMARKS", "DEFAULT_RUN", "benchmark", "run_benchmarks"]
