"""Every study that the project ships runs, and finds what it says of itself."""

from pathlib import Path

import numpy as np
import pytest

from dynid.checks import check_expectations
from dynid.scene.load import load_scene
from dynid.store import read_result
from dynid.study.executors import make_executor
from dynid.study.plan import make_plan
from dynid.study.run import run_study

pytestmark = pytest.mark.thorough

STUDIES = sorted((Path(__file__).parents[2] / "configs/studies").glob("*.yaml"))
SMALLER = {
    "table2_monte_carlo": ["vary.measurement.simulate.seed.stop=6", "vary.measurement.simulate.seed.points=6"]
}


def run(path, folder):
    scene = load_scene(path, SMALLER.get(path.stem, []))
    progress = run_study(make_plan(scene), folder / "study.h5", make_executor("serial"))
    return scene, progress, read_result(folder / "study.h5")


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_a_shipped_study_finds_what_it_expects(path, tmp_path):
    scene, progress, result = run(path, tmp_path)
    assert progress.failed == 0
    expected = [item.model_dump(exclude_none=True) for item in scene.model.expect]
    assert expected
    assert [one.message for one in check_expectations(result, expected) if not one.passed] == []


def test_the_map_of_the_isolator_is_that_of_equations_20_to_23(tmp_path):
    _, _, result = run(next(path for path in STUDIES if path.stem == "isolator_tuning"), tmp_path)
    m_s, b, A_p = 10, 50, 0.01
    I_f, C_a = (result[f"study/samples/parameters.{name}"].data for name in ("I_f", "C_a"))
    group = "study/results/bond_graph"
    notch = np.abs(result[f"{group}/transfer_function/m_s.f/v_in/zeros"].data[:, 0])
    resonance = result[f"{group}/properties/m_s.f/v_in/natural_frequency"].data[:, 0]
    damping = result[f"{group}/properties/m_s.f/v_in/damping_ratio"].data[:, 0]
    m_e = A_p**2 * I_f
    np.testing.assert_allclose(notch, 1 / np.sqrt(I_f * C_a), rtol=1e-12)
    np.testing.assert_allclose(resonance, A_p / np.sqrt(C_a * (m_s + m_e)), rtol=1e-12)
    np.testing.assert_allclose(damping, b / (2 * (m_s + m_e) * resonance), rtol=1e-11)
