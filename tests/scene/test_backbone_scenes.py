"""Scenes with backbones: listed, in files, and what is refused at its place."""

import numpy as np
import pytest

import dynid
from dynid.errors import DynidError

HEAD = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1.0], links: [{dofs: [1], k: 1000, c: 2}]}}
joints: {spring: {dofs: [1], laws: [{kind: cubic, k3: {start: 3.0e5}}]}}
"""
POINTS = ((2e-3, 31.66, 0.0314), (1e-2, 32.6, 0.0308), (3e-2, 39.2, 0.0252))
LISTED = "".join(
    f"      - {{amplitude: {a}, frequency: {w}, damping: {z}, frequency_std: 0.2}}\n" for a, w, z in POINTS
)
SCENE = f"{HEAD}measurement:\n  modes:\n    amplitude_of: {{dof: 1}}\n    values:\n{LISTED}"


def scene(tmp_path, text):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return dynid.load_scene(path)


@pytest.mark.thorough
def test_a_file_gives_what_the_list_gives(tmp_path):
    from scipy.io import savemat

    listed = dynid.run(scene(tmp_path, SCENE))
    table = "amplitude [mm];frequency [rad/s];frequency_std;damping [%];mode\n"
    table += "".join(f"{1e3 * a};{w};0.2;{100 * z};1\n" for a, w, z in POINTS)
    (tmp_path / "backbone.csv").write_text(table)
    a, w, z = np.transpose(POINTS)
    columns = {"a1": a, "frequency": w, "frequency_std": np.full(3, 0.2), "damping": z, "mode": np.ones(3)}
    savemat(tmp_path / "backbone.mat", columns)
    assert listed.value("identification/diagnostics/converged")
    k3 = listed.value("identification/parameters/estimate")
    for file in ("backbone.csv", "{path: backbone.mat, amplitude: a1}"):
        text = f"{HEAD}measurement: {{modes: {{amplitude_of: {{dof: 1}}, file: {file}}}}}"
        read = dynid.run(scene(tmp_path, text))
        np.testing.assert_allclose(read.value("identification/modes/amplitude"), a)
        np.testing.assert_allclose(read.value("identification/parameters/estimate"), k3, rtol=1e-9)
    assert read["identification/modes/amplitude"].units == "m"


@pytest.mark.thorough
def test_accelerations_and_differences_are_amplitudes_too(tmp_path):
    """The amplitude of an acceleration is omega squared times that of the displacement."""
    k3 = dynid.run(scene(tmp_path, SCENE)).value("identification/parameters/estimate")
    text = SCENE.replace("{dof: 1}\n", "{dof: 1, quantity: acceleration}\n")
    for a, w, _ in POINTS:
        text = text.replace(f"amplitude: {a},", f"amplitude: {a * w**2},")
    other = dynid.run(scene(tmp_path, text))
    assert other["identification/modes/amplitude"].units == "m/s2"
    np.testing.assert_allclose(other.value("identification/parameters/estimate"), k3, rtol=0.02)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "    amplitude_of: {dof: 1}\n",
            "",
            "either all modes have an 'amplitude', with 'amplitude_of', or none",
        ),
        ("amplitude: 0.01, ", "", "either all modes have an 'amplitude', with 'amplitude_of', or none"),
        ("{dof: 1}\n", "{output: 1j.e}\n", "'amplitude_of' is a motion at a DOF of the structure"),
        (
            "{dof: 1}\n",
            "{dof: 1, quantity: acceleration, frame: absolute}\n",
            "'amplitude_of' is a motion at a",
        ),
        ("damping: 0.0308", "damping: 0.0308, shape: {1: 1}", "a mode at an 'amplitude' has no 'shape'"),
        ("    amplitude_of: {dof: 1}\n", "    sensors: [1]\n", "'sensors' are those of the rows in a 'file'"),
        ("{amplitude: 0.01,", "{mode: 1,", "'mode' is that of a backbone, whose points have an 'amplitude'"),
        ("laws: [{kind: cubic, k3: {start: 3.0e5}}]", "k: {start: 10}", "but no joint has a law"),
        ("{dof: 1}\n", "{dof: 2}\n", "2"),
    ],
)
def test_what_backbones_do_not_go_with_is_refused(tmp_path, old, new, message):
    assert old in SCENE
    with pytest.raises(DynidError, match=message):
        dynid.run(scene(tmp_path, SCENE.replace(old, new)))


@pytest.mark.parametrize(
    ("columns", "of", "message"),
    [
        ("amplitude;frequency\n1;2\n", "", "has modes at amplitudes"),
        ("frequency;damping\n1;0.2\n", "amplitude_of: {dof: 1}, ", "has no column 'amplitude'"),
        (
            "amplitude;frequency;1\n1;2;1\n",
            "amplitude_of: {dof: 1}, ",
            "has shapes, which modes at amplitudes lack",
        ),
        ("amplitude [g];frequency [Hz]\n1;2\n", "amplitude_of: {dof: 1}, ", "has amplitudes in m/s2, but"),
        ("amplitude [N];frequency [Hz]\n1;2\n", "amplitude_of: {dof: 1}, ", "has 'amplitude' in N"),
        ("amplitude;frequency\n0;2\n", "amplitude_of: {dof: 1}, ", "point 1 has no positive amplitude"),
        (
            "amplitude;frequency\n1;2\n",
            "amplitude_of: {dof: 1}, sensors: [1], ",
            "'sensors' and 'match' say nothing",
        ),
    ],
)
def test_files_without_amplitudes_of_the_motion_are_refused(tmp_path, columns, of, message):
    (tmp_path / "backbone.csv").write_text(columns)
    with pytest.raises(DynidError, match=message):
        dynid.run(scene(tmp_path, f"{HEAD}measurement: {{modes: {{{of}file: backbone.csv}}}}"))


@pytest.mark.thorough
def test_a_reduced_structure_has_the_backbones_of_the_whole(tmp_path):
    beam = """
dynid: 1
kind: identification
structure:
  beam: {elements: 8, length: 1, EI: 500, rhoA: 3, supports: [{node: 1, fix: [w, theta]}]}
joints: {tip: {dofs: [w_9], laws: [{kind: cubic, k3: {start: 1.0e8}}]}}
measurement:
  modes:
    amplitude_of: {dof: w_9}
    values:
      - {amplitude: 1.0e-3, frequency: 45.9, frequency_std: 0.1}
      - {amplitude: 5.0e-3, frequency: 55.0, frequency_std: 0.1}
"""
    whole = dynid.run(scene(tmp_path, beam))
    reduced = dynid.run(scene(tmp_path, beam + "reduction: {method: joint-aware}\n"))
    k3, same = (result.value("identification/parameters/estimate") for result in (whole, reduced))
    np.testing.assert_allclose(same, k3, rtol=1e-3)
