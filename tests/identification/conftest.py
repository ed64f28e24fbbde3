"""What several tests of identifications need."""

from dataclasses import replace

import pytest

from dynid.identification.estimators import auto
from dynid.identification.results import write_derived

_STATES = write_derived._STATES


@pytest.fixture(autouse=True, scope="package")
def _derived_on_request():
    """Compute derived quantities where they are requested: they take half of a small identification."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write_derived, "_STATES", 0)
        yield


@pytest.fixture
def derived(monkeypatch):
    """Compute derived quantities of small systems, as users get them without a request."""
    monkeypatch.setattr(write_derived, "_STATES", _STATES)


@pytest.fixture
def few_starts(monkeypatch):
    """Three starts besides the given one, where any number ends at no optimum."""
    monkeypatch.setattr(auto, "MOST_STARTS", replace(auto.MOST_STARTS, value=3))


@pytest.fixture
def poor_starts(few_starts, monkeypatch):  # noqa: ARG001
    """Three starts, each the best of 16 instead of hundreds, where nothing depends on how near they are."""
    monkeypatch.setattr(auto, "_ROUNDS", [(16, reach, part) for _, reach, part in auto._ROUNDS])
