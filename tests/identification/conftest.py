"""What several tests of identifications need."""

from dataclasses import replace

import pytest

from dynid.identification.estimators import auto


@pytest.fixture
def few_starts(monkeypatch):
    """Three starts besides the given one, where any number ends at no optimum."""
    monkeypatch.setattr(auto, "MOST_STARTS", replace(auto.MOST_STARTS, value=3))
