"""Error of an estimate by the reduction of the model, apart from the noise."""

from functools import cache

import numpy as np
import pytest

import dynid
from dynid.identification.diagnosis import model_error
from tests.identification.test_reduced_models import AWARE, BEAM, SEREP
from tests.scene.example_scenes import check

# Near the truth and without a filter: quick, and it is the optimum that counts here.
CLEAN = BEAM.replace("{method: filter, passes: 2}", "{method: output-error}").replace("800", "400")
CLEAN = (
    CLEAN.replace("2.5e3", "4.5e3").replace("start: 5.0e3", "start: 9.0e3").replace("start: 10", "start: 18")
)
NOISY = CLEAN.replace("noise_ratio: 0", "noise_ratio: 0.05")


@cache
def identified(text):
    return dynid.run(check(text))


def estimate(result):
    return result["identification/parameters/estimate"].data


@pytest.mark.parametrize("text", [CLEAN, NOISY], ids=["clean", "noisy"])
def test_the_shift_is_what_the_full_model_would_change(text):
    reduced = identified(text)
    full = estimate(dynid.run(check(text.replace(f"reduction: {AWARE}\n", ""))))
    found = reduced["identification/model_error/shift"].data
    # Two steps leave little; of noisy records, the weights of the channels differ a little as well.
    left = 0.05 * reduced["identification/model_error/noise_error"].data
    assert np.all(np.abs(found - (full - estimate(reduced))) <= np.maximum(0.01 * np.abs(found), left))


def test_the_larger_one_of_the_two_errors_is_named():
    clean, noisy = identified(CLEAN), identified(NOISY)
    group = "identification/model_error"
    assert clean[f"{group}/dominant"].data.all()
    warning = clean.value(f"{group}/warning")
    assert "with the full model of 15 DOFs" in warning
    assert warning in list(clean["identification/diagnostics/warnings"].data)
    # 5 % of noise leave more than the reduction does.
    assert not noisy[f"{group}/dominant"].data.any()
    assert noisy.value(f"{group}/warning") == ""
    np.testing.assert_allclose(
        noisy[f"{group}/noise_error"].data, noisy["identification/parameters/standard_error"].data, rtol=0.1
    )
    # Modes with the joints as estimated: those of the full model.
    assert np.abs(clean[f"{group}/frequency_error"].data).max() < 1e-9


def test_a_basis_that_is_far_off_is_told_so():
    result = dynid.run(check(NOISY.replace(AWARE, SEREP)))
    group = "identification/model_error"
    assert "are far from these" in result.value(f"{group}/warning")
    assert np.abs(result[f"{group}/frequency_error"].data).max() > 0.1
    assert result[f"{group}/response_error"].data.max() > 0.1


def test_a_large_model_is_stood_for_by_more_modes(monkeypatch):
    text = CLEAN.replace("elements: 7", "elements: 14").replace("dofs: [1]", "dofs: [theta_1]")
    text = text.replace("[10]", "[w_11]").replace("dof: 10", "dof: w_11").replace("dof: 6", "dof: w_7")
    text = text.replace("count: 8", "count: 5").replace("400", "200").replace("300]", "100]")
    full = dynid.run(check(text))
    assert full.value("identification/model_error/reference") == "full model of 29 DOFs"
    monkeypatch.setattr(model_error, "_MAX_REFERENCE_DOFS", 10)
    result = dynid.run(check(text))
    assert result.value("identification/model_error/reference") == "model of 15 modes and residual vectors"
    shifts = [each["identification/model_error/shift"].data for each in (result, full)]
    np.testing.assert_allclose(shifts[0], shifts[1], rtol=1e-4)  # what modes from the 16th on would do


def test_a_record_of_the_reduced_model_has_no_model_error():
    text = CLEAN.replace(AWARE, SEREP).replace("model: full", "model: reduced")
    assert not any("model_error" in path for path in dynid.run(check(text)))
