"""Every scene that the project ships runs, and is what it says of itself."""

from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.checks import check_expectations

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[1]
TEMPLATES = set((ROOT / "src/dynid/templates").glob("*.yaml")) - {ROOT / "src/dynid/templates/study.yaml"}
SCENES = sorted([*(ROOT / "configs").glob("*.yaml"), *TEMPLATES])


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_shipped_scene_meets_its_expectations(path):
    if "mesh:" in path.read_text():
        pytest.importorskip("meshio")  # of the extra `laboratory`
    scene = dynid.load_scene(path)
    result = dynid.run(scene)
    outcomes = check_expectations(result, [item.model_dump(exclude_none=True) for item in scene.model.expect])
    assert [outcome.message for outcome in outcomes if not outcome.passed] == []
    absent = (
        "identification/parameters/error_percent",
        "identification/diagnostics/noise_p",
        "identification/laws/p",
    )
    if "identification/measurement/channel_time" in result:  # channels of other lengths and rates
        of_channels = ("channel_time", "measured", "predicted")
        absent += (*(f"identification/measurement/{name}" for name in of_channels),)
        absent += ("identification/residual_spectrum/amplitude",)
    for name, variable in result.items():
        if variable.data.dtype.kind in "fc" and name not in absent:
            known = name != "identification/parameters/true" or np.isfinite(variable.data).any()
            assert not known or not np.isnan(variable.data).any(), f"NaN in {name}"


def test_the_isolator_agrees_with_equations_20_to_23():
    result = dynid.run(ROOT / "configs/isolator.yaml")
    m_s, b, A_p, I_f, C_a = 10, 50, 0.01, 2.0e4, 1.0e-8
    mu = A_p**2 * I_f / m_s  # m_e / m_s
    omega_0 = np.sqrt(A_p**2 / (m_s * C_a) / mu)  # eq 20
    K = mu / (1 + mu)  # eq 23
    group = "bond_graph/transfer_function/m_s.f/v_in"
    assert np.sort_complex(result[f"{group}/zeros"].data) == pytest.approx(
        [-1j * omega_0, 1j * omega_0], rel=1e-12
    )
    sigma, stiffness = b / m_s / (1 + mu), A_p**2 / (m_s * C_a) / (1 + mu)  # eq 21
    damped = np.sqrt(stiffness - sigma**2 / 4)
    expected = [-sigma / 2 - 1j * damped, -sigma / 2 + 1j * damped]
    assert np.sort_complex(result[f"{group}/poles"].data) == pytest.approx(expected, rel=1e-12)
    properties = "bond_graph/properties/m_s.f/v_in"
    assert result.value(f"{properties}/high_frequency_gain") == pytest.approx(K, rel=1e-12)
    assert pytest.approx(stiffness / omega_0**2, rel=1e-12) == K  # (omega_n / omega_0)^2
    assert result.value(f"{properties}/dc_gain") == 1
    assert result.value(f"{properties}/relative_degree") == 0
    assert result.value(f"{properties}/zero_stability").startswith(
        "marginal, not minimum phase: zeros at ±70.71j"
    )


def test_the_suspension_is_within_a_thousandth_of_a_percent():
    result = dynid.run(ROOT / "configs/suspension.yaml")
    # Yang's Table 1 has 0.45 to 1.15 %; 0.05 % is asked for, two passes reach 3e-6 %
    assert result["identification/parameters/error_percent"].data == pytest.approx(0, abs=1e-3)


def test_the_record_in_data_is_that_of_the_noisy_scene():
    from dynid.files.read_measured import read_columns

    stored = read_columns(ROOT / "data/suspension_noisy.h5", None).values
    made = dynid.run(ROOT / "configs/suspension_noisy.yaml")["identification/measurement/measured"].data
    np.testing.assert_allclose(stored, made, rtol=1e-9, atol=1e-12)  # other processors round otherwise


def test_equation_25_has_the_frequencies_that_the_erratum_gives():
    from scipy.io import mmread
    from scipy.linalg import eigh

    mass, damping, stiffness = (
        np.asarray(mmread(ROOT / f"data/eq25_{name}.mtx")) for name in ("mass", "damping", "stiffness")
    )
    frequencies = np.sqrt(eigh(stiffness, mass, eigvals_only=True))
    assert frequencies == pytest.approx([37.2, 114.1, 231.2], abs=0.05)  # printed to a tenth
    np.testing.assert_allclose(damping, 0.1 * mass)
    with_joints = stiffness + np.diag([5e3, 0, 1e4])
    assert np.sqrt(eigh(with_joints, mass, eigvals_only=True)) == pytest.approx(
        [97.0, 154.0, 401.4], abs=0.05
    )
