"""The measured footbridge: 946 DOFs, 17 parts of unknown stiffness, five modes at 58 sensors with scatter.

Y. Wang and others; the figures to compare with are those of an independent prototype.
"""

import re
from pathlib import Path

import numpy as np
import pytest

import dynid

DATA = Path(__file__).parents[3] / "shared" / "data" / "updating"
SURVEY, MODEL = DATA / "ExpModeInfo_FEM.mat", DATA / "SteelPedestrianBridgeExp.mat"
PARTS = ["Frame", "Truss", "y1", "y2", "z1", "z2", *(f"Conc{k}" for k in range(1, 12))]

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not SURVEY.exists(), reason=f"no data in {DATA}")]


@pytest.fixture(scope="module")
def scene():
    """All parts unknown with priors of 50 %, from one scene."""
    prior = "min: 0.01, max: 100, prior: {value: 1, relative_deviation: 0.5}"
    names = (
        "eigenvalue: lambdaExp, eigenvalue_std: std_lambdaExp, frequency_tests: numTest, shape: psiExp_m, "
        "shape_std: std_psiExp, tests: numVldCH"
    )
    parts = "\n".join(f"      - {{path: {MODEL}, name: K_{name}, factor: {name}}}" for name in PARTS)
    parameters = "\n".join(f"  {name}: {{start: 1, {prior}}}" for name in PARTS)
    return f"""dynid: 1
kind: identification
title: Measured footbridge
parameters:
{parameters}
structure:
  matrices:
    mass: {{path: {MODEL}, name: M0}}
    stiffness:
{parts}
measurement:
  modes:
    unit: Hz
    file: {{path: {SURVEY}, {names}}}
    sensors: {{path: {MODEL}, name: measDOFs}}
"""


def identified(scene, folder):
    path = folder / "bridge.yaml"
    path.write_text(scene)
    return dynid.run(dynid.load_scene(path))


@pytest.fixture(scope="module")
def result(scene, tmp_path_factory):
    return identified(scene, tmp_path_factory.mktemp("bridge"))


@pytest.fixture(scope="module")
def stated(scene, result, tmp_path_factory):
    """With the errors of the form that the warning of the first fit names."""
    keys = re.search(r"model_error: \{[^}]*\}", warnings_of(result)).group()
    return identified(f"{scene}    {keys}\n", tmp_path_factory.mktemp("stated"))


def warnings_of(result):
    return "\n".join(result.value("identification/diagnostics/warnings"))


def modes(result, name):
    return np.asarray(result.value(f"identification/modes/{name}"))


def test_the_start_is_that_of_the_prototype(result):
    np.testing.assert_allclose(
        100 * modes(result, "frequency_error_start"), [20.0, 2.4, -2.5, 14.4, -1.0], atol=0.06
    )
    np.testing.assert_allclose(modes(result, "mac_start"), [0.971, 0.986, 0.955, 0.966, 0.903], atol=6e-4)


def test_modes_1_and_2_cross(result):
    assert modes(result, "model_mode_start").tolist() == [2, 1, 3, 4, 5]


def test_both_ends_of_the_trade_off(result):
    """Better frequencies cost MAC: the prototype had 0.94, 0.98, 0.94, 0.91, 0.89 with frequencies alone."""
    ends = {
        name: (modes(result, f"trade_off/{name}/frequency_error"), modes(result, f"trade_off/{name}/mac"))
        for name in ("frequencies", "shapes")
    }
    assert np.all(np.abs(ends["frequencies"][0]) < 0.01)
    np.testing.assert_allclose(ends["frequencies"][1], [0.938, 0.980, 0.941, 0.910, 0.890], atol=0.01)
    assert ends["shapes"][1].mean() > 0.96
    assert np.sqrt(np.mean(ends["shapes"][0] ** 2)) > 0.08


def test_scatter_that_does_not_explain_the_survey_is_rejected_with_the_keys_that_decide(result):
    assert result.value("identification/diagnostics/lack_of_fit_p") < 1e-3
    assert not result.value("identification/diagnostics/explained")
    assert result.value("identification/diagnostics/optimum")
    assert np.all(modes(result, "model_error") == 0)
    needed = modes(result, "model_error_needed")
    assert np.all((needed > 0.04) & (needed < 0.15))
    left, bar = (modes(result, f"left_out_{name}") for name in ("error", "deviation"))
    assert np.all(np.abs(left) > 4 * bar)
    assert any("the form of the model contradicts the data" in one for one in modes(result, "statements"))


def test_fit_with_the_stated_error_of_the_form_passes(stated):
    """Fit, intervals and verdict are for one model: the frequencies left out are within their bars, too."""
    assert stated.value("identification/diagnostics/converged")
    assert stated.value("identification/diagnostics/lack_of_fit_p") > 0.01
    assert "model_error" not in warnings_of(stated)
    left, bar, scatter = (modes(stated, f"left_out_{name}") for name in ("error", "deviation", "by_scatter"))
    assert np.all(np.abs(left) > 4 * scatter)
    assert np.all(np.abs(left) < 2 * bar)


def test_what_the_data_determine(stated):
    """Frame, truss and y1 are known best, the deck's parts by their priors alone."""
    names = [str(name) for name in stated.value("identification/parameters/name")]
    error = np.asarray(stated.value("identification/parameters/standard_error"))
    relative = dict(
        zip(names, error / np.asarray(stated.value("identification/parameters/estimate")), strict=True)
    )
    assert set(sorted(relative, key=lambda name: relative[name])[:3]) == {"Frame", "Truss", "y1"}
    blind = next(one for one in modes(stated, "statements") if "priors alone" in one)
    assert all(f"Conc{k}" in blind for k in range(3, 12))
    strength = modes(stated, "directions/strength")
    assert strength[0] > 20
    assert 4 <= np.count_nonzero(strength > 1) <= 9


def test_weights_of_the_prototype_give_its_fit(scene, tmp_path):
    """Shapes with a floor of 10 %, an error of the model of 0.5 % of the frequencies."""
    given = "    floor: {frequency: 0, shape: 0.1}\n    model_error: {frequency: 0.005, shape: 0}\n"
    result = identified(scene + given, tmp_path)
    np.testing.assert_allclose(100 * modes(result, "frequency_error"), [1.0, 0.6, -1.8, 0.5, 0.1], atol=0.15)
    np.testing.assert_allclose(modes(result, "mac"), [0.943, 0.980, 0.945, 0.923, 0.891], atol=3e-3)
    np.testing.assert_allclose(100 * modes(result, "left_out_error"), [12.6, 2.5, -8.0, 2.7, 0.5], atol=0.6)
    assert any("the form of the model contradicts the data" in one for one in modes(result, "statements"))
