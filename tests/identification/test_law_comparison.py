"""Candidates for the law of a joint: which one a record was made with, and which it does not distinguish."""

import numpy as np
import pytest

import dynid
from dynid.identification.diagnosis.law_comparison import TIED_BIC
from dynid.report.content import content
from dynid.result import Selection
from dynid.scene.kinds.identification import run
from dynid.scene.load import load_scene
from tests.identification.cases import diagnostic

pytestmark = pytest.mark.thorough

SCENE = """
dynid: 1
kind: identification
structure: {{lumped: {{masses: [1, 0.7], links: [{{dofs: [1], k: 1.5e4, c: 5}}]}}}}
joints:
  bolt: {{dofs: [1, 2], k: {{start: 9800, true: 1.0e4}}, c: {{start: 4.1, true: 4}}{more}}}
excitation:
  - {{dof: 2, kind: multisine, amplitude: [{size}, {size}, {size}], frequency: [60, 85, 120]}}
measurement:
  step: 0.0025
  samples: {samples}
  channels: [{{dof: 1, quantity: velocity}}, {{dof: 2, quantity: velocity}}]
  simulate: {{noise_ratio: 0.01, seed: {seed}}}
estimator: {{method: output-error, laws: [{laws}]}}
derived: [poles]
"""
JENKINS = ", laws: [{kind: jenkins, kt: {start: 3100, true: 3000}, fs: {start: 0.97, true: 1}}]"
CUBIC = ", laws: [{kind: cubic, k3: {start: 1.8e8, true: 2.0e8}}]"


def compared(folder, laws, more="", *, size=8, samples=80, seed=1, whole=False):
    path = folder / "scene.yaml"
    path.write_text(SCENE.format(laws=laws, more=more, size=size, samples=samples, seed=seed))
    scene = load_scene(path)
    return run(scene, None if whole else Selection("identification", ["identification/laws"]))


def columns(result):
    names = result["identification/laws/name"].data.tolist()
    return {
        column: dict(zip(names, result[f"identification/laws/{column}"].data.tolist(), strict=True))
        for column in ("log_likelihood", "bic", "p", "distinguishable")
    }


def test_the_law_of_the_record_has_the_least_bic(tmp_path):
    result = compared(tmp_path, "linear, cubic, jenkins", JENKINS, whole=True)
    laws = columns(result)
    assert min(laws["bic"], key=laws["bic"].get) == "jenkins"
    assert laws["distinguishable"] == dict.fromkeys(("linear", "cubic", "jenkins"), True)
    # The stated law is that of the scene: its numbers are those of the diagnostics.
    assert laws["log_likelihood"]["jenkins"] == result.value("identification/diagnostics/log_likelihood")
    assert laws["bic"]["jenkins"] == result.value("identification/diagnostics/bic")
    assert laws["log_likelihood"]["cubic"] >= laws["log_likelihood"]["linear"]
    estimates = dict(zip(laws["bic"], result["identification/laws/estimates"].data.tolist(), strict=True))
    parameters = result["identification/parameters/parameter"].data.tolist()
    for name, value in zip(parameters, result["identification/parameters/estimate"].data, strict=True):
        assert f"{name} {value:.5g}" in estimates["jenkins"].split(", ")
    assert "k3" in estimates["cubic"]
    assert np.isnan(laws["p"]["jenkins"])  # the linear joint is one with an infinite slip force
    (section,) = (part for part in content(result).sections if part.title == "Laws of joints")
    assert [row[0] for row in section.blocks[0].rows] == ["linear", "cubic", "jenkins"]
    assert "distinguishes jenkins from the others" in section.blocks[1].text


def test_laws_of_a_linear_joint_are_not_distinguishable(tmp_path):
    result = compared(tmp_path, "linear, cubic")
    laws = columns(result)
    assert laws["bic"]["cubic"] - laws["bic"]["linear"] < TIED_BIC
    assert not any(laws["distinguishable"].values())
    assert laws["p"]["cubic"] > 0.01
    ratio = 2 * (laws["log_likelihood"]["cubic"] - laws["log_likelihood"]["linear"])
    from scipy.stats import chi2

    assert laws["p"]["cubic"] == pytest.approx(chi2.sf(ratio, 1), rel=1e-6)
    verdict = result.group_attrs["identification/laws"]["verdict"]
    assert "linear and cubic are not distinguishable by this record" in verdict


def test_a_cubic_spring_is_told_from_quadratic_damping_and_a_gap(tmp_path):
    laws = columns(compared(tmp_path, "quadratic_damping, cubic, gap, linear", CUBIC, size=12))
    assert min(laws["bic"], key=laws["bic"].get) == "cubic"
    assert laws["p"]["cubic"] < 1e-6
    best = max(value for name, value in laws["log_likelihood"].items() if name != "cubic")
    assert laws["log_likelihood"]["cubic"] > best + 10


def test_without_stated_laws_the_joint_of_the_score_test_has_the_candidates(tmp_path):
    result = compared(tmp_path, "linear, cubic, bouc_wen", samples=50)
    assert result.group_attrs["identification/laws"]["joints"] == "bolt"
    laws = columns(result)
    assert all(value >= laws["log_likelihood"]["linear"] for value in laws["log_likelihood"].values())


def test_candidates_act_at_a_linear_joint_of_a_measured_record(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(laws="linear, cubic", more=JENKINS, size=8, samples=80, seed=1))
    measured = "identification/measurement/measured"
    record = run(load_scene(path), Selection("identification", [measured]))[measured].data
    np.savetxt(tmp_path / "bolt.csv", record, "%.12g", ",", header="v1,v2", comments="")
    text = SCENE.format(laws="linear, jenkins", more="", size=8, samples=80, seed=1)
    text = text.replace("simulate: {noise_ratio: 0.01, seed: 1}", "file: {path: bolt.csv, columns: [v1, v2]}")
    path.write_text(text.replace(", true: 1.0e4", "").replace(", true: 4", ""))
    result = run(load_scene(path), None)
    laws = columns(result)
    assert laws["distinguishable"] == {"linear": True, "jenkins": True}
    assert laws["bic"]["jenkins"] < laws["bic"]["linear"] - 100
    # The warning says how the best law is stated, at its estimates, and no longer that laws be compared.
    (said,) = (text for text in diagnostic(result, "warnings") if text.startswith("the model lacks fit"))
    assert "to compare laws" not in said
    statement = said.partition("state the best of the compared laws, in joint bolt: ")[2]
    assert statement.startswith("laws: [{kind: jenkins, kt: {start: ")
    path.write_text(path.read_text().replace("c: {start: 4.1}", f"c: {{start: 4.1}}, {statement}"))
    stated = run(load_scene(path), None)
    assert diagnostic(stated, "log_likelihood") == pytest.approx(laws["log_likelihood"]["jenkins"], abs=0.1)


@pytest.mark.slow
def test_distributed_sliders_and_friction_are_candidates(tmp_path):
    laws = columns(compared(tmp_path, "jenkins, iwan, coulomb, linear", JENKINS))
    assert laws["bic"]["jenkins"] < laws["bic"]["iwan"] + 10  # one slider is a limit of many
    assert laws["log_likelihood"]["iwan"] > laws["log_likelihood"]["coulomb"]
    assert laws["log_likelihood"]["coulomb"] >= laws["log_likelihood"]["linear"]


@pytest.mark.parametrize(
    ("laws", "said"),
    [
        ("linear", "name two or more"),
        ("linear, linear", "names a law twice"),
        ("linear, cubik", "cubik"),
        ("linear, power", "'power' needs more than its kind"),
    ],
)
def test_faults_of_candidates_name_their_place(tmp_path, laws, said):
    with pytest.raises(dynid.errors.SceneError, match=said) as refused:
        compared(tmp_path, laws)
    assert "scene.yaml:" in str(refused.value)


def test_candidates_need_a_likelihood_of_a_record_of_time(tmp_path):
    path = tmp_path / "scene.yaml"
    text = SCENE.format(laws="linear, cubic", more="", size=8, samples=80, seed=1)
    path.write_text(text.replace("method: output-error", "method: output-error, loss: huber"))
    with pytest.raises(dynid.errors.SceneError, match="the loss 'huber' has not"):
        dynid.load_scene(path)
    beginning, _, _ = text.partition("measurement:")
    path.write_text(
        beginning.replace("{start: 9800, true: 1.0e4}", "9800").replace("{start: 4.1, true: 4}", "4")
        + "estimator: {laws: [linear, cubic]}\nanalysis: {outputs: [{dof: 1}], time: {step: 0.01, stop: 1}}\n"
    )
    with pytest.raises(dynid.errors.SceneError, match="compared by a record of time"):
        dynid.load_scene(path)


def test_candidates_find_what_a_rejected_linear_fit_has_lost(tmp_path):
    """Its damping went to zero, where it has no effect, and its stiffness to more than twice the joint's."""
    more = ", laws: [{kind: cubic, k3: {start: 6.0e8, true: 6.0e8}}]"
    text = SCENE.format(laws="linear", more=more, size=30, samples=200, seed=1)
    text = text.replace("{start: 9800, true: 1.0e4}", "8000").replace("{start: 4.1, true: 4}", "2")
    text = text.replace(
        "amplitude: [30, 30, 30], frequency: [60, 85, 120]", "amplitude: [30, 30], frequency: [40, 200]"
    )
    (tmp_path / "record.yaml").write_text(text.replace(", laws: [linear]}", "}"))
    group = "identification/measurement"
    record = run(load_scene(tmp_path / "record.yaml"), Selection("identification", [group]))
    columns_of_file = np.column_stack([record[f"{group}/time"].data, record[f"{group}/measured"].data])
    np.savetxt(tmp_path / "record.csv", columns_of_file, delimiter=",", header="t,one,two", comments="")
    text = text.replace(more, "").replace("k: 8000", "k: {start: 1.0e4}").replace("c: 2", "c: {start: 4}")
    text = text.replace(
        "simulate: {noise_ratio: 0.01, seed: 1}", "file: {path: record.csv, columns: [one, two]}"
    )
    found = {}
    for candidates in ("linear, cubic", "linear, gap", "linear, quadratic_damping"):
        (tmp_path / "scene.yaml").write_text(text.replace("laws: [linear]", f"laws: [{candidates}]"))
        result = run(load_scene(tmp_path / "scene.yaml"))
        found[candidates] = columns(result), result.group_attrs["identification/laws"]["verdict"], result
    laws, verdict, result = found["linear, cubic"]
    assert "distinguishes cubic" in verdict
    assert set(laws["distinguishable"].values()) == {True}
    estimates = result["identification/laws/estimates"].data[1]
    values = dict(part.split(" ") for part in estimates.split(", "))
    for name, true in (("k", 8000), ("c", 2), ("k3", 6e8)):
        assert float(values[f"bolt.{name}"]) == pytest.approx(true, rel=0.005)
    # What a candidate cannot explain is said, and none is told from the others.
    laws, verdict, result = found["linear, gap"]
    assert "all lack fit, gap least: p " in verdict
    laws, verdict, result = found["linear, quadratic_damping"]
    assert "none explains this record; linear and quadratic_damping, the best: p " in verdict
    assert set(laws["distinguishable"].values()) == {False}
    warned = " ".join(diagnostic(result, "warnings").tolist())
    assert "none of the compared laws explains it" in warned
    assert "coloured" not in warned
    assert "huber" not in warned
