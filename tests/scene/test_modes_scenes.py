"""Scenes with measured modes: listed, in files, with records; faults at their places."""

from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.errors import DynidError

pytestmark = pytest.mark.usefixtures("untried")

CHAIN = (Path(__file__).parents[2] / "configs" / "chain_modes.yaml").read_text()
HEAD = CHAIN.partition("measurement:")[0]
TRUE = (
    HEAD.replace("start: 10}", "start: 10, true: 8}")
    .replace(
        "upper: {dofs: [2, 3], k: {start: 1.0e4}", "upper: {dofs: [2, 3], k: {start: 1.0e4, true: 2.0e4}"
    )
    .replace(
        "lower: {dofs: [3, 4], k: {start: 1.0e4}", "lower: {dofs: [3, 4], k: {start: 1.0e4, true: 2.4e4}"
    )
)


def scene(tmp_path, measurement, head=HEAD):
    path = tmp_path / "scene.yaml"
    path.write_text(head + measurement)
    return dynid.load_scene(path)


def estimates(result):
    return np.asarray(result.value("identification/parameters/estimate"))


@pytest.fixture(scope="module")
def listed():
    """What the shipped scene, which lists its modes, identifies."""
    return dynid.run(dynid.load_scene(Path(__file__).parents[2] / "configs" / "chain_modes.yaml"))


def test_shipped_scene_finds_the_joints(listed):
    error = np.asarray(listed.value("identification/parameters/standard_error"))
    assert np.all(np.abs(estimates(listed) - [2e4, 8.0, 2.4e4]) < 3 * error)
    assert listed.value("identification/diagnostics/converged")
    assert listed["identification/modes/frequency"].units == "Hz"
    np.testing.assert_allclose(listed.value("identification/modes/frequency_measured")[0], 6.078)


@pytest.mark.thorough
def test_table_gives_what_the_list_gives(tmp_path, listed):
    rows = ["frequency [Hz],frequency_std,damping,damping_std,1,3,5,std 1,std 3,std 5"]
    get = {
        name: listed.value(f"identification/modes/{name}") for name in ("frequency_measured", "frequency_std")
    }
    for line in CHAIN.splitlines():
        if "{frequency" in line:
            found = [part.split(": ")[-1].strip("{} ") for part in line.replace("shape: ", "").split(", ")]
            rows.append(",".join([*found[:7], *[found[7]] * 3]))
    (tmp_path / "modes.csv").write_text("\n".join(rows) + "\n")
    read = dynid.run(scene(tmp_path, "measurement: {modes: {file: modes.csv}}"))
    np.testing.assert_allclose(estimates(read), estimates(listed), rtol=1e-9)
    np.testing.assert_allclose(read.value("identification/modes/frequency_std"), get["frequency_std"])


@pytest.mark.thorough
def test_matlab_file_with_scatter_of_single_tests(tmp_path, listed):
    from scipy.io import savemat

    get = {
        name: np.asarray(listed.value(f"identification/modes/{name}"))
        for name in (
            "frequency_measured",
            "frequency_std",
            "damping_measured",
            "damping_std",
            "shape_measured",
        )
    }
    omega = 2 * np.pi * get["frequency_measured"]
    savemat(
        tmp_path / "survey.mat",
        {
            "lam": omega**2,
            "lam_std": 2 * omega * 2 * np.pi * get["frequency_std"] * 2,
            "n": np.full(4, 4.0),
            "zeta": get["damping_measured"],
            "zeta_std": get["damping_std"],
            "psi": get["shape_measured"],
            "psi_std": 0.06 * np.ones((3, 4)),
            "count": np.full((3, 4), 9.0),
        },
    )
    names = (
        "eigenvalue: lam, eigenvalue_std: lam_std, frequency_tests: n, damping: zeta, damping_std: zeta_std, "
        "shape: psi, shape_std: psi_std, tests: count"
    )
    read = dynid.run(
        scene(
            tmp_path,
            f"measurement: {{modes: {{unit: Hz, file: {{path: survey.mat, {names}}}, sensors: [1, 3, 5]}}}}",
        )
    )
    np.testing.assert_allclose(estimates(read), estimates(listed), rtol=1e-6)
    file = f"{{path: survey.mat, modes: [1, 3], {names}}}"
    some = dynid.run(scene(tmp_path, f"measurement: {{modes: {{sensors: [1, 3, 5], file: {file}}}}}"))
    np.testing.assert_allclose(some.value("identification/modes/frequency_measured"), omega[[0, 2]])


@pytest.mark.parametrize("sensors", ["", ", sensors: {path: survey.mat, name: dofs}"])
def test_numbers_of_dofs_are_whole(tmp_path, sensors):
    """A node with its component, 3.02, is no DOF 3."""
    from scipy.io import savemat

    shapes = {"frequency": [1.0, 3.0], "shape": [[1.0, 1], [0, 2]]}
    savemat(tmp_path / "survey.mat", {**shapes, "dofs": [1.0, 3.02]})
    with pytest.raises(DynidError, match=r"survey.mat has 3.02 in 'dofs', no whole number"):
        dynid.run(scene(tmp_path, f"measurement: {{modes: {{file: survey.mat{sensors}}}}}"))


def test_modes_together_with_a_record(tmp_path):
    measurement = (
        "excitation: [{dof: 5, kind: multisine, amplitude: [100, 100], frequency: [40, 110]}]\n"
        + "measurement:"
        + CHAIN.partition("measurement:")[2]
        + "  step: 0.005\n  samples: 300\n  channels: [{dof: 2, quantity: velocity}]\n"
        + "  simulate: {noise_ratio: 0.02, seed: 3}\n"
    )
    both = dynid.run(scene(tmp_path, measurement, TRUE))
    assert both.value("identification/diagnostics/optimum")
    assert "identification/measurement/measured" in both
    assert "identification/modes/mac" in both
    error = np.asarray(both.value("identification/parameters/standard_error"))
    assert np.all(np.abs(estimates(both) - [2e4, 8.0, 2.4e4]) < 4 * error)


def test_modes_together_with_frequency_responses(tmp_path):
    measurement = (
        "measurement:"
        + CHAIN.partition("measurement:")[2]
        + "  channels: [{dof: 2, quantity: velocity, reference: {dof: 5}}]\n"
        + "  frf: {simulate: {noise_ratio: 0.02, seed: 3, lines: {start: 2, stop: 35, points: 60, unit: Hz}}}"
    )
    both = dynid.run(scene(tmp_path, measurement, TRUE))
    assert both.value("identification/diagnostics/optimum")
    error = np.asarray(both.value("identification/parameters/standard_error"))
    assert np.all(np.abs(estimates(both) - [2e4, 8.0, 2.4e4]) < 4 * error)


@pytest.mark.parametrize(
    ("modes", "line", "message"),
    [
        ("{unit: Hz}", 13, "either listed as 'values' or read from a 'file'"),
        ("{values: [{frequency: 0}]}", 13, "0 is not positive"),
        ("{values: [{frequency: 3, damping_std: 0.1}]}", 13, "'damping_std' is the scatter of a 'damping'"),
        ("{values: [{frequency: 3, shape: {1: 1}, shape_std: {2: 0.1}}]}", 13, "'shape_std' names 2"),
        ("{values: [{frequency: 3, shape: {9: 1}}]}", 13, "there is no DOF 9"),
        ("{values: [{frequency: 3}], sensors: [1]}", 13, "'sensors' are those of the rows in a 'file'"),
    ],
)
def test_faults_are_located(tmp_path, modes, line, message):
    with pytest.raises(DynidError) as caught:
        dynid.run(scene(tmp_path, f"measurement: {{modes: {modes}}}\n"))
    assert message in str(caught.value)
    assert f"scene.yaml:{line}:" in str(caught.value)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("excitation: [{dof: 5, kind: step}]\n", "modes are measured without an 'excitation'"),
        ("estimator: {method: filter}\n", "is for records of time, not for 'modes'"),
        ("estimator: {loss: huber}\n", "no loss 'huber'"),
    ],
)
def test_what_modes_do_not_go_with_is_refused(tmp_path, more, message):
    with pytest.raises(DynidError, match=message):
        scene(tmp_path, more + "measurement: {modes: {values: [{frequency: 3}]}}\n")


def test_responses_and_records_beside_modes_are_refused(tmp_path):
    text = (
        "measurement:\n  modes: {values: [{frequency: 3}]}\n"
        "  frf: {simulate: {noise_ratio: 0.02, seed: 3, lines: {start: 2, stop: 35, points: 60, unit: Hz}}}\n"
        "  channels: [{dof: 5, quantity: velocity, reference: {dof: 1}}]\n"
    )
    scene(tmp_path, text, TRUE)
    with pytest.raises(DynidError, match="'step' is that of a record of time"):
        scene(tmp_path, text + "  step: 0.01\n", TRUE)
    record = (
        "{step: 0.01, samples: 9, channels: [{dof: 5, quantity: velocity}], simulate: {noise_ratio: 0.1}}"
    )
    with pytest.raises(DynidError, match="frequency responses stand alone"):
        scene(tmp_path, f"{text}  records: [{record}]\n", TRUE)


def test_report_and_summary_show_the_modes(listed):
    from dynid.cli.screen import summary
    from dynid.report.figure import figures

    names = [figure.name for figure in figures(listed)]
    assert {"measured-modes", "mac"} <= set(names)
    for figure in figures(listed):
        figure.draw()
    assert "MAC at start" in summary(listed, "")
