"""Errors over many noisy records, against the Cramér–Rao bound and the intervals that are reported."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynid

CONFIGS = Path(__file__).parents[2] / "configs"
RECORDS = 300


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table2", "table4"])
def test_errors_are_as_small_as_any_can_be_and_as_large_as_they_are_said_to_be(name):
    errors, held = [], []
    for seed in range(1, RECORDS + 1):
        scene = dynid.load_scene(CONFIGS / f"{name}.yaml", [f"measurement.simulate.seed={seed}"])
        result = dynid.run(scene)
        assert result.value("identification/diagnostics/converged"), seed
        group = "identification/parameters"
        estimate, true, deviation, bound = (
            result[f"{group}/{part}"].data for part in ("estimate", "true", "standard_error", "cramer_rao")
        )
        errors.append((estimate - true) / bound)
        held.append(np.abs(np.log(true / estimate)) <= 1.959964 * deviation / estimate)
    # Three standard errors of the figures themselves, from so many records: 12 % and 3.8 %.
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(rms, 1, atol=3 / np.sqrt(2 * RECORDS))
    np.testing.assert_allclose(np.mean(held, axis=0), 0.95, atol=3 * np.sqrt(0.95 * 0.05 / RECORDS))


@pytest.mark.slow
def test_intervals_of_joints_from_frequency_responses():
    """The frame of the benchmark with 2 % proportional noise; 2,000 records with DYNID_RECORDS=2000."""
    from dynid.bench.cases.structure_response import ONE_AXIS, TRUE, measured_frame, unknowns
    from dynid.identification.identify import identify
    from dynid.identification.systems.frf_system import FrfSystem

    count = int(os.environ.get("DYNID_RECORDS", "200"))
    model, measurement, _ = measured_frame(791)
    clean = FrfSystem.of(model, measurement.channels).response(measurement.omega).values
    true = np.array(list(unknowns(TRUE, ONE_AXIS).values()))
    held = []
    for seed in range(count):
        noise = np.random.default_rng(1000 + seed).standard_normal((2, *clean.shape)) / np.sqrt(2)
        values = clean * (1 + 0.02 * (noise[0] + 1j * noise[1]))
        result = identify(model, replace(measurement, source=values))
        assert result.value("identification/diagnostics/converged"), seed
        estimate, deviation = (
            result[f"identification/parameters/{part}"].data for part in ("estimate", "standard_error")
        )
        held.append(np.abs(np.log(true / estimate)) <= 1.959964 * deviation / estimate)
    np.testing.assert_allclose(np.mean(held, axis=0), 0.95, atol=3 * np.sqrt(0.95 * 0.05 / count))
