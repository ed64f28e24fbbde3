"""What several tests look at: one benchmark, measured once, in this process."""

import warnings

import pytest

from dynid.bench import run_benchmarks


class Here:
    """Stands for a process that measures an alternative; this one does it."""

    def __init__(self, *_, **__):
        pass

    def run(self, _, call, *arguments):
        with warnings.catch_warnings(action="ignore"):  # what peers say of their own work
            return call(*arguments)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def _measure_here(patch):
    patch.setattr("dynid.bench.suite.ChildProcess", Here)
    patch.setattr("dynid.bench.suite._MIN_SECONDS", 0.0)


@pytest.fixture
def here(monkeypatch):
    """Benchmarks are measured in this process; starting others takes longer than small works."""
    _measure_here(monkeypatch)


@pytest.fixture(scope="session")
def result():
    with pytest.MonkeyPatch.context() as patch:
        _measure_here(patch)
        return run_benchmarks(["propagation"], {"propagation": [100, 200]}, clock="processor")
