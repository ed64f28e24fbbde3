"""Signals: their values in closed form, and their generators against their values."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from dynid.errors import UsageError
from dynid.lti.signals import Chirp, Impact, Impulse, Multisine, RecordTimes, Sampled, Sine, Step, signal

RECORD = RecordTimes(step=0.01, samples=301)
VALUES = np.random.default_rng(7).standard_normal(301)

SIGNALS = {
    "step": Step(2.0, 0.123),
    "sine": Sine(3.0, 17.0, 0.4),
    "constant": Sine(3.0, 0.0, 0.4),
    "multisine": Multisine([1, 2], [5, 9]),
    "many sines": Multisine(list(range(1, 21)), list(np.linspace(3, 90, 20)), [0.1] * 20),
    "chirp": Chirp(1.5, 10.0, 200.0, 2.0, 0.5),
    "falling chirp": Chirp(1.5, 200.0, 0.0, 0.02, 0.5),
    "resting chirp": Chirp(1.5, 0.0, 0.0, 1.0),
    "impact": Impact(10.0, 0.0437),
    "random": signal("random", {"amplitude": 2.0, "seed": 3}, RECORD),
    "band": signal("random", {"amplitude": 2.0, "seed": 3, "band": [20, 60]}, RECORD),
    "spline": Sampled(VALUES, 0.01),
    "linear": Sampled(VALUES, 0.01, "linear"),
    "zero": Sampled(VALUES, 0.01, "zero"),
}


@pytest.mark.parametrize("name", SIGNALS)
@given(place=st.floats(0.001, 2.99), part=st.floats(0.05, 0.95))
@settings(max_examples=15, deadline=None)
def test_generator_reproduces_the_signal_between_breakpoints(name, place, part):
    s = SIGNALS[name]
    edges = np.unique(np.concatenate([[0.0, 3.0], s.breakpoints(0.0, 3.0)]))
    left = edges[np.searchsorted(edges, place, side="right") - 1]
    right = edges[min(np.searchsorted(edges, place, side="right"), len(edges) - 1)]
    begin = left + part * (right - left)
    h = min(s.longest_step, right - begin) * 0.9
    G, readout = s.generator()
    w = s.states(np.array([begin]), np.array([begin + h / 2]))[0]
    size = max(1.0, float(np.abs(s.value(np.linspace(0, 2.99, 400))).max()))
    assert readout @ expm(G * h) @ w == pytest.approx(float(s.value(begin + h)), abs=2e-12 * size)


def test_values_in_closed_form():
    t = np.array([0.0, 0.05, 0.1, 0.123, 1.0, 2.5, 2.9])
    np.testing.assert_array_equal(SIGNALS["step"].value(t), 2.0 * (t >= 0.123))
    np.testing.assert_allclose(SIGNALS["sine"].value(t), 3 * np.sin(17 * t + 0.4), rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(SIGNALS["multisine"].value(t), np.sin(5 * t) + 2 * np.sin(9 * t), atol=1e-14)
    half_sine = np.where(t < 0.0437, 10 * np.sin(math.pi * t / 0.0437), 0)
    np.testing.assert_allclose(SIGNALS["impact"].value(t), half_sine, atol=1e-14)
    np.testing.assert_array_equal(Impulse(3.0).value(t), 0.0)
    assert Impulse(3.0).jump == 3.0


def test_chirp_rests_before_sweeps_over_and_stays_after_the_record():
    t = np.linspace(0, 3, 601)
    phase = 10 * t
    sweep = (t >= 0.5) & (t < 2.5)
    phase[sweep] = 10 * t[sweep] + 190 / 4 * (t[sweep] - 0.5) ** 2
    phase[t >= 2.5] = 10 * 2.5 + 190 + 200 * (t[t >= 2.5] - 2.5)
    np.testing.assert_allclose(SIGNALS["chirp"].value(t), 1.5 * np.sin(phase), atol=1e-12)


@pytest.mark.parametrize("count", [4, 5, 60])
def test_spline_hold_is_the_not_a_knot_spline(count):
    values = VALUES[:count]
    t = np.linspace(0, (count - 1) * 0.01, 997)
    np.testing.assert_allclose(
        Sampled(values, 0.01).value(t),
        CubicSpline(np.arange(count) * 0.01, values)(t),
        rtol=1e-12,
        atol=1e-12,
    )


@pytest.mark.parametrize("count", [2, 3])
def test_spline_of_few_samples_is_their_polynomial(count):
    t = np.linspace(0, (count - 1) * 0.1, 50)
    p = np.polynomial.Polynomial.fit(np.arange(count) * 0.1, VALUES[:count], count - 1)
    np.testing.assert_allclose(Sampled(VALUES[:count], 0.1).value(t), p(t), atol=1e-13)


def test_linear_and_zero_hold():
    t = np.linspace(0, 2.9, 1234)
    knots = np.arange(301) * 0.01
    np.testing.assert_allclose(SIGNALS["linear"].value(t), np.interp(t, knots, VALUES), atol=1e-12)
    held = VALUES[np.searchsorted(knots, t + 1e-12, side="right") - 1]
    np.testing.assert_array_equal(SIGNALS["zero"].value(t), held)


def test_sampled_is_not_continued_beyond_its_samples():
    with pytest.raises(UsageError, match="known from 0 s to 3 s only"):
        SIGNALS["spline"].value(np.array([3.1]))


@pytest.mark.parametrize("band", [None, [0, 310]])
def test_random_is_seeded_and_has_its_deviation(band):
    def noise(seed):
        return signal("random", {"amplitude": 2.0, "seed": seed, "band": band}, RECORD)

    first, again, other = noise(1), noise(1), noise(2)
    t = RECORD.times
    assert first.value(t).tobytes() == again.value(t).tobytes()
    assert np.abs(first.value(t) - other.value(t)).max() > 1
    if band is not None:
        np.testing.assert_allclose(first.value(t), first.value(t + 3.01), atol=1e-10)  # a sum of lines
    spread = [np.mean(noise(seed).value(t) ** 2) for seed in range(200)]
    # Chi-squared with 300 degrees a record, 200 records: 0.6 % standard error.
    assert np.mean(spread) == pytest.approx(4.0, rel=0.025)


def test_random_without_a_band_is_the_spline_of_its_samples():
    """So an estimator's spline hold is the truth, but near the ends of what it sees."""
    noise = signal("random", {"amplitude": 1.0, "seed": 3}, RecordTimes(0.01, 301, 0.5))
    seen = noise.sampled(RecordTimes(0.01, 301, 0.5))
    between = 0.5 + 0.01 * (20 + np.arange(260) + 0.37)
    np.testing.assert_allclose(seen.value(between), noise.value(between), atol=1e-9)


def test_random_keeps_to_its_band():
    s = signal("random", {"amplitude": 1.0, "seed": 1, "band": [20, 60]}, RECORD)
    omega, _ = s.lines
    assert omega.min() >= 20
    assert omega.max() <= 60
    spectrum = np.abs(np.fft.rfft(s.value(RECORD.times)))
    lines = 2 * math.pi * np.fft.rfftfreq(301, 0.01)
    assert spectrum[(lines < 20) | (lines > 60)].max() < 1e-10 * spectrum.max()


def test_random_irregular_and_regular_times_agree():
    s = SIGNALS["random"]
    t = np.sort(np.random.default_rng(0).uniform(0, 3, 200))
    grid = np.linspace(0, 3, 1001)
    np.testing.assert_allclose(s.value(t), [float(s.value(np.array([x]))[0]) for x in t], atol=1e-12)
    np.testing.assert_allclose(s.value(grid)[::7], s.value(grid[::7]), atol=1e-11)


def test_random_fills_the_settling_time_too():
    s = signal("random", {"amplitude": 1.0, "seed": 1}, RecordTimes(0.01, 100, start=1.995))
    assert s.samples == 300
    seen = s.sampled(RecordTimes(0.01, 100, start=1.995))
    np.testing.assert_allclose(
        seen.value(1.995 + 0.01 * np.arange(100)), s.value(1.995 + 0.01 * np.arange(100))
    )


def test_factory_builds_every_kind():
    record = RecordTimes(0.1, 11, 1.0)
    assert signal("step", {"amplitude": 2}, record) == Step(2)
    assert signal("impulse", {"amplitude": 2}, record) == Impulse(2)
    assert signal("sine", {"amplitude": 2, "frequency": 3}, record) == Sine(2, 3)
    assert signal("multisine", {"amplitude": [2], "frequency": [3]}, record) == Multisine([2], [3], [0])
    assert signal("impact", {"amplitude": 2, "duration": 3}, record) == Impact(2, 3)
    assert signal("chirp", {"amplitude": 2, "start": 3, "stop": 4}, record) == Chirp(2, 3, 4, 1.0, 1.0)
    assert signal("file", {"values": np.arange(11)}, record).value(np.array([1.25]))[0] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("stpe", {}),
        ("step", {"height": 1}),
        ("step", {"amplitude": math.nan}),
        ("multisine", {"amplitude": [1, 2], "frequency": [1]}),
        ("multisine", {"amplitude": [], "frequency": []}),
        ("multisine", {"amplitude": [1], "frequency": [math.inf]}),
        ("impact", {"amplitude": 1, "duration": 0}),
        ("chirp", {"amplitude": 1, "start": math.inf, "stop": 2}),
        ("random", {"amplitude": 1, "seed": 1, "band": [3, 2]}),
        ("random", {"amplitude": 1, "seed": 1, "band": [1.0, 1.001]}),
        ("file", {"values": [1.0]}),
        ("file", {"values": [1.0, math.nan]}),
        ("file", {"values": [1.0, 2.0], "hold": "cubic"}),
    ],
)
def test_nonsense_is_refused(kind, parameters):
    with pytest.raises(UsageError):
        signal(kind, parameters, RECORD)


@pytest.mark.parametrize("arguments", [(0, 5), (-1, 5), (math.nan, 5), (1, 0), (1, 5, -1)])
def test_records_must_make_sense(arguments):
    with pytest.raises(UsageError):
        RecordTimes(*arguments)
