"""Modes of responses alone against chains in closed form."""

import numpy as np
import pytest

from dynid.errors import NumericalError
from dynid.modal.subspace import analyse_outputs
from tests.modal.outputs import accelerations, chain, standardised_outputs

pytestmark = pytest.mark.thorough

STEP, BAND = 1 / 40, (6.0, 120.0)


def acceleration(s):
    """Return the factors from displacements of six channels."""
    return np.full(6, s**2)


@pytest.fixture(scope="module")
def record():
    return accelerations(chain(), STEP, 16000, seed=1)


def test_standard_errors_are_those_of_records():
    errors = [[], [], []]
    for seed in range(2):
        analysis = analyse_outputs([accelerations(chain(), STEP, 24000, seed)], STEP, BAND, acceleration)
        assert len(analysis.modes.omega) == 6
        assert not len(analysis.harmonics)
        for pooled, values in zip(errors, standardised_outputs(analysis.modes, *chain()), strict=True):
            pooled.append(values)
    for pooled, low in zip(errors, (0.5, 0.5, 0.7), strict=True):
        assert low < np.sqrt(np.mean(np.concatenate(pooled) ** 2)) < 1.5


def test_a_sine_is_a_harmonic_and_no_mode(record):
    times = STEP * np.arange(len(record))
    shaken = record + 4 * np.outer(np.sin(2 * np.pi * 8.3 * times), np.arange(1, 7))
    analysis = analyse_outputs([shaken], STEP, BAND, acceleration)
    assert analysis.harmonics == pytest.approx([2 * np.pi * 8.3], rel=1e-4)
    assert analysis.modes.omega == pytest.approx(chain()[0], rel=5e-3)


def test_records_are_joined_and_channels_have_any_scale(record):
    scale = np.array([1e6, 1, 1, 1e-6, 1, 1])
    together = analyse_outputs([record], STEP, BAND, acceleration).modes
    halves = [record[:8000] * scale, record[8000:] * scale]
    parts = analyse_outputs(halves, STEP, BAND, lambda s: scale * s**2).modes
    by_omega, by_damping, _ = together.standard_errors
    assert np.all(np.abs(parts.omega - together.omega) < 0.5 * by_omega)
    assert np.all(np.abs(parts.damping - together.damping) < 0.5 * by_damping)
    assert np.allclose(parts.shape, together.shape, atol=0.05)


def test_shapes_are_those_of_displacements(record):
    """A channel that integrates its acceleration has the same shape, with the same standard error."""
    times = np.arange(len(record))
    spectrum = np.fft.rfft(record[:, 2] - record[:, 2].mean())
    omega = 2 * np.pi * np.fft.rfftfreq(len(times), STEP)
    spectrum[1:] /= 1j * omega[1:]
    spectrum[omega < 4] = 0.0
    integrated = record.copy()
    integrated[:, 2] = np.fft.irfft(spectrum, len(times))
    power = np.array([2, 2, 1, 2, 2, 2])
    modes = analyse_outputs([integrated], STEP, BAND, lambda s: s**power).modes
    reference = analyse_outputs([record], STEP, BAND, acceleration).modes
    assert np.allclose(modes.shape, reference.shape, atol=0.02)
    of_shapes, of_reference = modes.standard_errors[2], reference.standard_errors[2]
    assert np.median(of_shapes[of_shapes > 0] / of_reference[of_reference > 0]) == pytest.approx(1, abs=0.2)


def test_the_covariance_of_few_blocks_is_regular(record):
    modes = analyse_outputs([record], STEP, BAND, acceleration).modes
    n, channels = modes.shape.shape
    covariance = modes.common @ modes.common.T
    of_shapes = covariance[2 * n :, 2 * n :].reshape(2, channels, n, 2, channels, n)
    for channel, factor in enumerate(modes.by_channel.reshape(channels, 2, n, -1)):
        of_shapes[:, channel, :, :, channel] += np.einsum("pmf,qnf->pmqn", factor, factor)
    deviation = np.sqrt(np.diag(covariance))
    free = deviation > 0
    assert np.count_nonzero(~free) == 2 * n  # the largest entries
    correlation = covariance[np.ix_(free, free)] / np.outer(deviation[free], deviation[free])
    assert np.linalg.eigvalsh(correlation)[0] > 0.01
    assert deviation[:n] == pytest.approx(modes.standard_errors[0])


@pytest.mark.parametrize(
    ("samples", "scale", "band", "message"),
    [
        (1000, 1.0, BAND, "too short for correlations over 82 lags"),
        (8000, 0.0, BAND, "channel 1 is constant"),
        (8000, 1.0, (70.0, 75.0), "the band has no pole with a determined damping ratio"),
    ],
)
def test_what_has_no_modes_is_refused(record, samples, scale, band, message):
    with pytest.raises(NumericalError, match=message):
        analyse_outputs([record[:samples] * np.array([scale, 1, 1, 1, 1, 1])], STEP, band, acceleration)
