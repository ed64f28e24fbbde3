"""What several tests of identifications need."""

import pytest

from dynid.identification import identify
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
