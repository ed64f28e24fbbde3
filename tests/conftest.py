"""What all tests stand on."""

import os
import signal
import sys
from dataclasses import replace

# OpenBLAS would start a thread for each core in every worker, once NumPy is loaded; commands start one, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

from tests.warm import Warm

# The same examples in every run, so that a failure is of the change that is tested; other examples are
# drawn with `--hypothesis-profile fresh`.
_NO_CLOCK = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, max_examples=40, **_NO_CLOCK)
settings.register_profile("fresh", derandomize=False, print_blob=True, **_NO_CLOCK)
settings.load_profile("same")

# Who starts the tests in the background of a script lets them ignore Ctrl-C, and with them every command
# that they start; some tests are about just that signal.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Every worker, and every process that a test starts, would compile all modules anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.fixture
def untried(monkeypatch):
    """Read files of other programs without a trial, which takes the start of a process for each of them."""
    monkeypatch.setattr("dynid.trial.survives", lambda *_, **__: None)


@pytest.fixture
def few_starts(monkeypatch):
    """Three starts besides the given one, where any number ends at no optimum."""
    from dynid.identification.estimators import multi_start

    monkeypatch.setattr(multi_start, "MOST_STARTS", replace(multi_start.MOST_STARTS, value=3))


@pytest.fixture
def poor_starts(few_starts, monkeypatch):  # noqa: ARG001
    """Three starts, each the best of 16 instead of hundreds, where nothing depends on how near they are."""
    from dynid.identification.estimators import multi_start

    monkeypatch.setattr(multi_start, "_ROUNDS", [(16, reach, part) for _, reach, part in multi_start._ROUNDS])


@pytest.fixture(scope="session")
def warm(tmp_path_factory):
    """Commands that need not import what is heavy."""
    server = Warm(tmp_path_factory.mktemp("warm"))
    yield server
    server.stop()
