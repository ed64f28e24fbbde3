"""What cannot be computed is refused in words, before any work; what is merely extreme is computed."""

import math

import numpy as np
import pytest

from dynid.arrays import finite, guarded
from dynid.errors import Diverged, NumericalError, UsageError
from dynid.lti.exponential import balance, rescaled
from dynid.lti.signals import Multisine, Random, RecordTimes, Step, signal
from dynid.lti.state_space import StateSpace
from dynid.lti.time_response import propagate, timeline
from dynid.lti.waveforms import sum_lines

OSCILLATOR = StateSpace([[0, 1], [-900.0, -0.6]], [[0], [1]], [[1, 0]], [[0]])


@pytest.mark.parametrize(
    ("kind", "parameters", "record", "key"),
    [
        ("chirp", {"amplitude": 1, "start": 1, "stop": 1e9}, RecordTimes(0.01, 31), "stop"),
        ("chirp", {"amplitude": 1, "start": 1e9, "stop": 1}, RecordTimes(0.01, 501), "stop"),
        ("chirp", {"amplitude": 1, "start": 1, "stop": 1e150}, RecordTimes(0.01, 501), "stop"),
        ("chirp", {"amplitude": 1, "start": 0, "stop": 1e308}, RecordTimes(1e-300, 501), "stop"),
        ("chirp", {"amplitude": 1, "start": 5.858, "stop": 3.919}, RecordTimes(2e4, 51), "stop"),
        ("random", {"amplitude": 1, "seed": 1, "band": (1, 1e5)}, RecordTimes(1.0, 1_000_001), "band"),
        ("random", {"amplitude": 1, "seed": 1, "band": (1, 1e300)}, RecordTimes(1.0, 101), "band"),
        ("random", {"amplitude": 1, "seed": 1}, RecordTimes(1e-3, 3, 1e9), "band"),
        ("multisine", {"amplitude": [1] * 10, "frequency": [1e9] * 10}, RecordTimes(1.0, 51), "frequency"),
        (
            "multisine",
            {"amplitude": [1] * 9, "frequency": [1] * 9},
            RecordTimes(1e-5, 2_800_000),
            "frequency",
        ),
    ],
)
def test_a_signal_that_takes_too_long_is_refused_by_kind_and_key(kind, parameters, record, key):
    with pytest.raises(UsageError, match="too") as caught:
        timeline([signal(kind, parameters, record)], record.times, 0.0)
    assert caught.value.names == (kind, key)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("kind", "parameters", "names"),
    [
        ("stpe", {}, ("stpe",)),
        ("step", {"height": 1}, ("step", "height")),
        ("sine", {"amplitude": 1, "frequency": math.nan}, ("sine", "frequency")),
        ("multisine", {"amplitude": [1, 2], "frequency": [1]}, ("multisine", "amplitude")),
        ("multisine", {"amplitude": [1], "frequency": [1], "phase": []}, ("multisine", "phase")),
        ("multisine", {"amplitude": [], "frequency": []}, ("multisine", "frequency")),
        ("chirp", {"amplitude": 1, "start": 1}, ("chirp", "stop")),
        ("impact", {"amplitude": 1, "duration": 1e-310}, ("impact", "duration")),
        ("random", {"amplitude": 1, "seed": 1, "band": (3, 2)}, ("random", "band")),
        ("random", {"amplitude": 1, "seed": -1}, ("random", "seed")),
        ("file", {"values": [1.0]}, ("file", "path", "samples")),
        ("file", {"values": [1.0, 2.0], "hold": "cubic"}, ("file", "hold")),
    ],
)
def test_faults_of_a_signal_name_its_kind_and_key(kind, parameters, names):
    with pytest.raises(UsageError) as caught:
        signal(kind, parameters, RecordTimes(0.01, 301))
    assert caught.value.names == names


@pytest.mark.parametrize("arguments", [(1e-20, 5, 1.0), (1e300, 10**9), (1e-300, 2, 1e300)])
def test_a_record_whose_samples_coincide_or_overflow_is_refused(arguments):
    with pytest.raises(UsageError):
        RecordTimes(*arguments)


@pytest.mark.parametrize("first", [0.0, 0.37])
@pytest.mark.parametrize("finer", [1, 3])
def test_sums_on_the_grid_of_the_record_are_those_of_their_definition(first, finer):
    rng = np.random.default_rng(3)
    period, numbers = 0.01 * 301, np.array([1, 7, 150, 151, 300, 301, 302, 1000])  # some beyond the grid
    omega = 2 * math.pi * numbers / period
    weights = rng.standard_normal((8, 2)) + 1j * rng.standard_normal((8, 2))
    times = first + np.arange(500) * (0.01 / finer)
    exact = (np.exp(1j * np.outer(times, omega)) @ weights).real
    np.testing.assert_allclose(sum_lines(omega, weights, times, period), exact, atol=1e-10)
    np.testing.assert_allclose(sum_lines(omega, weights, times), exact, atol=1e-10)


def test_blocks_of_many_lines_and_times_are_those_of_their_definition():
    rng = np.random.default_rng(3)
    omega, c = rng.uniform(0, 50, 40_000), rng.standard_normal((40_000, 1)) + 0j
    for times in (np.arange(70) * 0.01, np.sort(rng.uniform(0, 1, 5))):
        exact = np.array([(c[:, 0] * np.exp(1j * omega * t)).sum().real for t in times])
        np.testing.assert_allclose(sum_lines(omega, c, times)[:, 0], exact, atol=1e-9)


def test_a_long_random_record_has_its_deviation_and_off_the_grid_too_long_a_sum_is_refused():
    record = RecordTimes(0.01, 100_001)
    noise = signal("random", {"amplitude": 2.0, "seed": 1, "band": [0, 400]}, record)
    # Chi-squared with 1e5 degrees: 0.2 % standard deviation.
    assert np.std(noise.value(record.times)) == pytest.approx(2.0, rel=0.02)
    with pytest.raises(UsageError, match="takes too long") as caught:
        noise.value(np.linspace(0, 1, 1_000_001) ** 2)
    assert caught.value.names == ("random", "band")


def test_long_random_responses_are_those_of_the_lines_one_by_one():
    noise = Random(1.0, seed=2, step=0.01, samples=20_000, band=(25.0, 35.0))  # 30 rad/s: the pole
    t = np.arange(20_000) * 0.01
    y = propagate(OSCILLATOR, [noise], t).outputs[:, 0]
    omega, c = noise.lines
    gain = 1 / (900 - omega**2 + 0.6j * omega)
    late = np.flatnonzero(t > 120)[::997]  # the start has decayed by e^36
    exact = [(gain * c * np.exp(1j * omega * t[k])).sum().real for k in late]
    np.testing.assert_allclose(y[late], exact, rtol=0, atol=1e-10 * np.abs(y).max())


@pytest.mark.parametrize("size", [1e-300, 2.3e-308, 1e300])
def test_balancing_survives_the_whole_range_of_numbers(size):
    A = np.array([[0.0, size, 0.0], [1 / max(size, 1e-300), 0.0, 1.0], [1e-300, 1e300, 0.0]])
    d = balance(A)
    assert np.all(d > 0)
    assert np.isfinite(rescaled(A, d)).all()
    assert rescaled(A, d).max() <= A.max()


def test_motions_without_a_phase_are_refused():
    stiff = StateSpace([[0, 1], [-1e30, 0]], [[0], [1]], [[1, 0]], [[0]])
    with pytest.raises(NumericalError, match="beyond the phase that double precision resolves"):
        propagate(stiff, [Step()], np.arange(10.0))
    damped = StateSpace([[0, 1], [-1e30, -1e15]], [[0], [1]], [[1, 0]], [[0]])
    y = propagate(damped, [Step()], np.arange(1.0, 10.0)).outputs
    np.testing.assert_allclose(y, 1e-30, rtol=1e-6)  # it has decayed: where it rests is known


@pytest.mark.parametrize("force", [1e308, 1e-308])
def test_a_response_beyond_double_precision_is_refused_not_warned_of(force):
    soft = StateSpace([[0, 1], [-1e-6, 0]], [[0], [1]], [[1, 0]], [[0]])
    t = np.arange(0.0, 100.0)
    if force < 1:
        assert np.isfinite(propagate(soft, [Step(force)], t).outputs).all()
        return
    with pytest.raises(NumericalError) as caught:
        propagate(soft, [Step(force)], t)
    assert caught.value.remedy


def test_anomalies_become_the_error_that_is_asked_for():
    one, zero = np.ones(1), np.zeros(1)
    for anomaly in (lambda: one / zero, lambda: zero / zero, lambda: np.exp(1e4 * one)):
        with (
            pytest.raises(Diverged, match="the sum is beyond double precision") as caught,
            guarded("the sum", Diverged, names=["a"]),
        ):
            anomaly()
        assert caught.value.names == ("a",)
    with pytest.raises(NumericalError), guarded("the factors"):
        np.linalg.cholesky(-np.eye(2))
    with guarded("underflow"):
        assert np.exp(-1e4 * one)[0] == 0
    with pytest.raises(NumericalError):
        finite("it", one, np.array([np.inf]))


def test_ten_constants_need_no_substep():
    constants = Multisine([1.0] * 10, [0.0] * 10, [math.pi / 2] * 10)
    np.testing.assert_allclose(constants.value([0.0, 1e6]), 10.0)
