"""Errors of a motor's values over seeds and starts: `tests.identification.motor_seeds`."""

import numpy as np
import pytest

from tests.identification.motor_seeds import from_starts, over_seeds


@pytest.mark.slow
def test_errors_of_a_motor_are_those_of_the_bound():
    ratio, inside, failed = over_seeds(range(100))
    assert failed == 0
    # Five standard deviations of what 100 seeds leave to chance, about 1 and 95 %.
    assert np.sqrt(np.mean(ratio**2)) < 1 + 5 * np.sqrt(1 / 200)
    assert 0.95 - 5 * np.sqrt(0.95 * 0.05 / 100) < inside


@pytest.mark.slow
def test_nearly_all_starts_reach_the_optimum():
    assert from_starts(range(25)) >= 24
