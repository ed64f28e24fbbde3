"""The filter at its limits: a run-away, and deviations whose squares no number holds."""

import numpy as np
import pytest

from dynid.errors import Diverged
from dynid.identification.estimators.filter import Pass, check_run_away, filter_pass, thinned
from dynid.identification.estimators.filter_passes import wide_prior
from dynid.identification.likelihood.state_deviations import MAX_STORED_ROWS
from dynid.native import VARIABLE
from tests.identification.cases import suspension
from tests.identification.test_kernels import fits_of, origin_of

MILLION = np.log(1e6)


@pytest.mark.parametrize("sign", [1, -1])
def test_an_estimate_may_leave_its_start_by_a_factor_of_a_million(sign):
    unknowns = suspension().unknowns
    origin = np.linspace(-1, 2, len(unknowns))
    inside, outside = origin.copy(), origin.copy()
    inside[1] += sign * (MILLION - 1e-6)
    outside[1] += sign * (MILLION + 1e-6)
    check_run_away(unknowns, inside, origin)
    with pytest.raises(Diverged) as caught:
        check_run_away(unknowns, outside, origin)
    assert list(caught.value.names) == [unknowns[1].name]


def test_an_estimate_that_is_no_number_has_run_away():
    unknowns = suspension().unknowns
    eta = np.zeros(len(unknowns))
    eta[0] = np.nan
    with pytest.raises(Diverged, match=unknowns[0].name):
        check_run_away(unknowns, eta, np.zeros(len(unknowns)))


@pytest.mark.parametrize("wish", ["0", "1"])
def test_deviations_scale_with_the_prior_however_small(monkeypatch, wish):
    """A prior to which the record adds nothing is carried along linearly; no number holds its squares."""
    monkeypatch.setenv(VARIABLE, wish)
    model = suspension()
    fits, origin = fits_of(model, samples=20), origin_of(model)
    prior = wide_prior(fits, origin)

    def narrow(scale):
        given = prior._replace(root=scale * prior.root)
        found = filter_pass(fits.model, fits.data.values, given, 0.1 * fits.data.rms, origin)
        return found.deviations / scale, found.state_deviations / scale

    for small, tiny in zip(narrow(1e-100), narrow(1e-180), strict=True):
        assert (small > 0).any()
        np.testing.assert_allclose(tiny, small, rtol=1e-12)  # rounding of some twenty steps


@pytest.mark.parametrize(("samples", "every"), [(MAX_STORED_ROWS, 1), (2 * MAX_STORED_ROWS + 1, 3)])
def test_of_a_long_history_every_so_many_rows_are_stored_the_last_among_them(samples, every):
    column = np.arange(float(samples))[:, None]
    history = Pass(column, column + 0.25, column + 0.5, column + 0.75, np.eye(1), column)
    kept = thinned(history)
    assert kept.eta[-1] == samples - 1
    np.testing.assert_array_equal(np.diff(kept.eta[:, 0]), every)
    assert len(kept.eta) <= MAX_STORED_ROWS
    for name, offset in (("deviations", 0.25), ("states", 0.5), ("state_deviations", 0.75)):
        np.testing.assert_array_equal(getattr(kept, name), kept.eta + offset)
    assert len(kept.innovations) == samples
