"""`dynid plan`, and `identifiability: true`: screens, files, exit codes and located faults."""

from pathlib import Path

import numpy as np
import pytest

from dynid.store import read_result
from tests.cli.conftest import SMALL
from tests.scene.example_scenes import faults_of

pytestmark = pytest.mark.usefixtures("folder")

SCENE = """\
dynid: 1
kind: identification
title: Three masses
structure:
  lumped: {masses: [2, 1, 1], links: [{dofs: [1], k: 4000, c: 4}, {dofs: [2, 3], k: 3000, c: 3}]}
joints:
  j: {dofs: [1, 2], k: {start: 1000, true: 2000}, c: {start: 1, true: 2}}
excitation: {dof: 3, kind: multisine, amplitude: [1, 1], frequency: [20, 50]}
measurement:
  step: 0.01
  samples: 300
  channels: [{dof: 1, quantity: velocity}]
  simulate: {noise_ratio: 0.05, seed: 1, settle: 20}
"""


def write(text):
    Path("s.yaml").write_text(text)
    return "s.yaml"


@pytest.mark.thorough
def test_a_plan_is_a_screen_and_on_request_a_file(dynid, folder):
    code, out, err = dynid("plan", write(SCENE))
    assert (code, err) == (0, "")
    assert not list(folder.glob("*.h5"))
    for said in (
        "Three masses",
        "identifiability: Cramér–Rao bounds at the true values, initial state unknown",
        "best sensor of 9 candidates",
        "present: 1.velocity",
        "best 2 sines, amplitude",
        "best frequency bands",
        "the present",
    ):
        assert said in out
    assert all(len(line) <= 140 for line in out.splitlines())
    code, out, _ = dynid("plan", "s.yaml", "-o", "p.h5", "--sensors", "2", "--lines", "3")
    assert code == 0
    assert "wrote p.h5" in out
    result = read_result("p.h5")
    assert result.kind == "plan"
    assert result["plan/sensors/choice"].data.size == 2
    assert result["plan/excitation/choice"].data.size == 3
    assert np.isfinite(result["identification/identifiability/bound"].data).all()
    _, shown, _ = dynid("show", "p.h5")
    assert "best 2 of 9 candidate sensors" in shown


def test_a_quiet_plan_says_nothing(dynid):
    assert dynid("plan", write(SCENE), "-q") == (0, "", "")


def test_a_scene_says_what_to_look_for(dynid):
    text = SCENE + (
        "plan:\n  sensors: 2\n  candidates: [{dof: 2, quantity: velocity}, {dof: 3, quantity: velocity}]\n"
        "  noise: {velocity: 0.001}\n  excitation: {dofs: [1], band: [2, 8], unit: Hz}\n"
    )
    assert dynid("plan", write(text), "-o", "p.h5")[0] == 0
    result = read_result("p.h5")
    assert set(result["plan/sensors/candidate"].data) == {"1.velocity", "2.velocity", "3.velocity"}
    assert np.all(result["plan/sensors/noise"].data == 0.001)
    assert set(result["plan/excitation/choice_dof"].data) == {"1"}
    omega = result["plan/excitation/choice_omega"].data
    assert np.all((omega >= 4 * np.pi) & (omega <= 16 * np.pi))


@pytest.mark.thorough
def test_a_run_tells_its_identifiability_where_asked(dynid):
    assert dynid("run", write(SCENE))[0] == 0
    assert not [path for path in read_result("s.h5") if "identifiability" in path]
    code, out, _ = dynid("run", write(SCENE + "identifiability: true\n"))
    assert code == 0
    assert "identifiability: Cramér–Rao bounds from the record at the true values" in out
    result = read_result("s.h5")
    np.testing.assert_allclose(
        result["identification/identifiability/bound"].data,
        result["identification/parameters/cramer_rao"].data,
        rtol=1e-9,
    )


@pytest.mark.thorough
def test_joints_side_by_side_are_named_with_what_is_seen_of_them(dynid):
    text = SCENE.replace("joints:\n", "joints:\n  i: {dofs: [1, 2], k: {start: 500, true: 900}}\n")
    code, out, _ = dynid("plan", write(text))
    assert code == 0
    assert "i.k, j.k cannot be distinguished: the record shows only i.k + j.k" in out
    assert "interchangeable" not in out
    code, _, err = dynid("run", "s.yaml")
    assert code == 0
    assert "i.k, j.k cannot be distinguished: the record shows only i.k + j.k" in err


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        (
            SMALL,
            2,
            "s.yaml:2:1: there is nothing to plan in a scene of kind bond-graph. A plan is for scenes of",
        ),
        (
            SCENE[: SCENE.index("measurement:")] + "analysis: {modes: {}}\n",
            2,
            "s.yaml:2:1: there is no measurement to plan. Add the block",
        ),
        (
            SCENE.replace("k: {start: 1000, true: 2000}, c: {start: 1, true: 2}", "k: 2000"),
            2,
            "s.yaml:9:1: there is nothing to identify: no parameter has a 'start'",
        ),
        (SCENE.replace("samples: 300", "samples: 1"), 2, "s.yaml:11:3: no sine between"),
        (
            SCENE + "plan: {excitation: {band: [9000, 9900]}}\n",
            2,
            "s.yaml:14:21: no sine between 9e+03 rad/s (1.43e+03 Hz) and 9.9e+03 rad/s",
        ),
        (SCENE.replace("dof: 3, kind", "dof: 3, knid"), 2, "s.yaml:8:"),
    ],
)
def test_what_cannot_be_planned_is_one_located_sentence(dynid, text, code, said):
    left, out, err = dynid("plan", write(text))
    assert (left, out) == (code, "")
    assert err.startswith(said), err


@pytest.mark.parametrize(
    ("excitation", "said"),
    [
        (
            "{base: acceleration, kind: multisine, amplitude: [1, 1], frequency: [20, 50]}",
            "prescribed motion",
        ),
        ("{dof: 3, kind: random, amplitude: 2, seed: 4}", "best 3 sines, amplitude"),
        ("{dof: 3, kind: impact, amplitude: 50, duration: 0.02}", "best 3 sines, amplitude"),
    ],
)
def test_whatever_drives_the_structure_sensors_are_ranked(dynid, excitation, said):
    settle = "settle: 0" if "impact" in excitation else "settle: 20"
    text = SCENE.replace(SCENE.splitlines()[7], f"excitation: {excitation}").replace("settle: 20", settle)
    code, out, err = dynid("plan", write(text))
    assert (code, err) == (0, "")
    assert "best sensor of 9 candidates" in out
    assert said in out


def test_a_reduced_model_has_candidates_at_all_dofs(dynid):
    text = SCENE + "reduction: {method: joint-aware, modes: {count: 2}}\n"
    code, out, err = dynid("plan", write(text))
    assert (code, err) == (0, "")
    assert "best sensor of 9 candidates" in out


def test_usage(dynid):
    assert dynid("plan", "nowhere.yaml")[0] == 4
    assert dynid("plan", write(SCENE), "--sensors", "0")[0] == 2
    assert dynid("plan", "s.yaml", "-o", "s.yaml")[0] == 2
    assert dynid("plan", "s.yaml", "-o", "no/p.h5")[0] == 4


@pytest.mark.parametrize(
    ("block", "fault"),
    [
        ("plan: {sensors: 0}", "14:17: 'sensors' must be at least 1, not 0"),
        (
            "plan: {candidates: [{dof: 9, quantity: velocity}]}",
            "14:27: there is no DOF 9; the structure has 3",
        ),
        ("plan: {excitation: {dofs: [4]}}", "14:28: there is no DOF 4; the structure has 3"),
        ("plan: {excitation: {band: [8, 2]}}", "14:27: a band is [low, high], and low is not below high"),
        ("plan: {noise: {speed: 1}}", "14:16: "),
        ("plan: {quantities: [speed]}", "14:21: this entry cannot be 'speed'"),
        ("plan: {lins: 3}", "14:8: 'lins' is not a key of plan; did you mean 'lines'?"),
        ("identifiability: maybe", "14:18: 'identifiability' must be true or false"),
    ],
)
def test_faults_of_the_plan_are_located(block, fault):
    found = faults_of(SCENE + block + "\n")
    assert len(found) == 1, found
    assert found[0].startswith(fault), found
