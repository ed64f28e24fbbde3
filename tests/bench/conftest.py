"""What several tests look at: one benchmark, measured once."""

import pytest

from dynid.bench import run_benchmarks


@pytest.fixture(scope="session")
def result():
    return run_benchmarks(["propagation"], {"propagation": [100, 200]}, clock="processor")
