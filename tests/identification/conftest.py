"""What several tests of identifications need."""

from dataclasses import replace

import pytest

from dynid.identification import identify
from dynid.identification.estimators import multi_start
from dynid.identification.results import write_derived

_STATES, _MISTAKES = write_derived._MAX_STATES, identify.instrument_mistakes


@pytest.fixture(autouse=True, scope="package")
def _estimates_alone():
    """Leave out what takes most of the time of a small identification and few tests are about.

    These are derived quantities without a request, and mistakes of instruments that explain a lack of fit.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write_derived, "_MAX_STATES", 0)
        patch.setattr(identify, "instrument_mistakes", lambda *_: [])
        yield


@pytest.fixture
def complete(monkeypatch):
    """Give a test all that users get without a request, see `_estimates_alone`."""
    monkeypatch.setattr(write_derived, "_MAX_STATES", _STATES)
    monkeypatch.setattr(identify, "instrument_mistakes", _MISTAKES)


@pytest.fixture
def few_starts(monkeypatch):
    """Three starts besides the given one, where any number ends at no optimum."""
    monkeypatch.setattr(multi_start, "MOST_STARTS", replace(multi_start.MOST_STARTS, value=3))


@pytest.fixture
def poor_starts(few_starts, monkeypatch):  # noqa: ARG001
    """Three starts, each the best of 16 instead of hundreds, where nothing depends on how near they are."""
    monkeypatch.setattr(multi_start, "_ROUNDS", [(16, reach, part) for _, reach, part in multi_start._ROUNDS])
