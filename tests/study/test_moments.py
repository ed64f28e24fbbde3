import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from dynid.study.analysis.sample_statistics import NAMES, statistics

NUMBERS = npst.arrays(
    float,
    npst.array_shapes(min_dims=1, max_dims=3, max_side=8),
    elements=st.floats(-1e6, 1e6) | st.just(np.nan),
)


@settings(max_examples=40)
@given(NUMBERS)
def test_statistics_are_those_of_the_values_that_there_are(values):
    found = statistics(values)
    assert tuple(found) == NAMES
    for place in np.ndindex(values.shape[1:]):
        column = values[(slice(None), *place)]
        column = column[~np.isnan(column)]
        own = {name: part[place] for name, part in found.items()}
        assert own["count"] == column.size
        if not column.size:
            assert all(np.isnan(own[name]) for name in NAMES[:-1])
            continue
        scale = np.abs(column).max() + 1e-300
        assert own["mean"] == pytest.approx(column.mean(), rel=1e-12, abs=1e-12 * scale)
        expected = np.quantile(column, [0, 0.05, 0.5, 0.95, 1])
        assert [own[q] for q in NAMES[2:-1]] == pytest.approx(list(expected), rel=1e-12, abs=1e-12 * scale)
        if column.size == 1:
            assert np.isnan(own["std"])
        else:
            # the deviation's rounding is that of the values, not of itself
            assert own["std"] == pytest.approx(column.std(ddof=1), rel=1e-9, abs=1e-12 * scale)


def test_what_does_not_vary_has_no_deviation():
    found = statistics(np.full(1000, 0.1))
    assert (found["mean"], found["std"]) == (0.1, 0.0)


def test_infinite_gains_leave_the_quantiles_whole():
    found = statistics(np.array([1.0, 2.0, 3.0, np.inf, np.inf]))
    assert (found["median"], found["max"], found["mean"]) == (3.0, np.inf, np.inf)
    assert np.isnan(found["std"])
    assert found["count"] == 5
