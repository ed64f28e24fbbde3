"""Responses refined in multiple precision, against closed forms in many digits."""

from functools import partial

import mpmath
import numpy as np
import pytest
from flint import fmpq, fmpq_mat

from dynid.errors import NumericalError
from dynid.lti.refined_response import RationalMatrices, refined_response
from dynid.lti.signals import Impulse, Multisine, Random, Step
from dynid.lti.state_space import StateSpace

TIMES = np.linspace(0, 4, 9)


def near_rates(gap):
    """Two decays, and their difference as output: of rates 1 and 1 + 2^-gap."""
    rates = [fmpq(-1), fmpq(-1) - fmpq(1, 2**gap)]
    A = fmpq_mat([[rates[0], 0], [0, rates[1]]])
    exact = RationalMatrices(A, fmpq_mat([[1], [1]]), fmpq_mat([[1, -1]]), (fmpq_mat([[0]]),))
    floats = StateSpace(np.diag([float(r.p) / float(r.q) for r in rates]), [[1], [1]], [[1, -1]], [[0]])
    return floats, exact


@pytest.mark.parametrize("gap", [30, 60, 200])
@pytest.mark.parametrize("signal", [Impulse(3.0), Step(2.0), Multisine((0.5,), (7.0,), (0.3,))])
def test_digits_that_doubles_lose_are_recovered(gap, signal):
    system, exact = near_rates(gap)
    found, error = refined_response(system, [signal], TIMES, lambda: exact)
    with mpmath.workdps(150):
        rate = 1 + mpmath.mpf(2) ** -gap

        def one(a, t):
            if isinstance(signal, Impulse):
                return 3 * mpmath.exp(-a * t)
            if isinstance(signal, Step):
                return 2 * (1 - mpmath.exp(-a * t)) / a
            w, phase = mpmath.mpf(7), mpmath.mpc(0, mpmath.mpf(0.3))
            whole = mpmath.exp(phase) * (mpmath.exp(mpmath.mpc(0, w * t)) - mpmath.exp(-a * t))
            return (whole / mpmath.mpc(a, w)).imag / 2

        known = [float(one(mpmath.mpf(1), t) - one(rate, t)) for t in map(mpmath.mpf, TIMES.tolist())]
    assert error == 0
    tolerance = 1e-13 * max(map(abs, known))  # sines are rounded at every instant
    assert found.outputs[:, 0] == pytest.approx(known, rel=1e-13, abs=tolerance)


def test_accurate_responses_are_not_refined():
    system, _ = near_rates(2)
    found, error = refined_response(system, [Step(1.0)], TIMES, partial(pytest.fail, "not needed"))
    assert error == 0
    known = (1 - np.exp(-TIMES)) - (1 - np.exp(-1.25 * TIMES)) / 1.25
    assert found.outputs[:, 0] == pytest.approx(known, rel=1e-13, abs=1e-15)


def test_a_response_that_cannot_be_refined_is_reported_or_refused(monkeypatch):
    monkeypatch.setattr("dynid.lti.refined_response._MAX_PRODUCTS", 0)
    system, exact = near_rates(20)
    _, error = refined_response(system, [Step(1.0)], TIMES, lambda: exact)
    assert 1e-10 < error < 1e-8
    system, exact = near_rates(60)
    with pytest.raises(NumericalError, match="'y1' is lost to rounding") as refused:
        refined_response(system, [Step(1.0)], TIMES, lambda: exact)
    assert refused.value.remedy


def test_random_signals_are_not_refined():
    system, exact = near_rates(60)
    with pytest.raises(NumericalError, match="is lost to rounding"):
        refined_response(system, [Random(1.0, seed=1, step=0.5, samples=40)], TIMES, lambda: exact)
