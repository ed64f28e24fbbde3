"""Scenes of rotors: Campbell diagrams, whirl, and what is refused."""

import numpy as np
import pytest

import dynid
from dynid.errors import FileError, SceneError, UsageError
from dynid.report.content import content
from dynid.report.figure import figures
from tests.scene.example_scenes import faults_of

pytestmark = pytest.mark.thorough

ROTOR = """\
dynid: 1
kind: identification
title: A disc
structure:
  matrices:
    {mass: M.txt, stiffness: K.txt, gyroscopic: {path: G.txt, factor: 2}, circulatory: N.txt, speed: 300,
      labels: D}
analysis:
  modes: {count: 3}
  campbell: {stop: 50, unit: Hz, points: 6, modes: 2}
""".replace("labels: D", "labels: " + '["1:x", "1:y", "1:rx", "1:ry"]')


@pytest.fixture
def scene(tmp_path):
    skew = np.zeros((4, 4))
    skew[2, 3], skew[3, 2] = 1.0, -1.0
    matrices = {"M": np.diag([10, 10, 0.2, 0.2]), "K": np.diag([4e5, 4e5, 9e3, 9e3])}
    for name, matrix in (matrices | {"G": 0.175 * skew, "N": 50 * skew[::-1, ::-1]}).items():
        np.savetxt(tmp_path / f"{name}.txt", matrix)

    def written(*replacements):
        text = ROTOR
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "rotor.yaml").write_text(text)
        return tmp_path / "rotor.yaml"

    return written


def test_a_rotor_has_whirling_modes_and_a_campbell_diagram(scene):
    result = dynid.run(scene())
    shift = 0.35 * 300 / 0.4
    assert result["structure/complex_modes/omega"].data[0] == pytest.approx(
        np.sqrt(shift**2 + 9e3 / 0.2) - shift
    )
    # m z'' + (k + i 50) z = 0: cross-coupling turns both whirls of the translations, one unstable.
    pole = np.sqrt(-(4e5 + 50j) / 10 + 0j)
    assert np.abs(result["structure/complex_modes/pole"].data[1:].real) == pytest.approx(
        abs(pole.real), rel=1e-6
    )
    speeds = result["structure/campbell/speed"].data
    assert speeds == pytest.approx(2 * np.pi * np.linspace(0, 50, 6))
    assert result["structure/campbell/omega"].data.shape == (6, 2)
    (section,) = [s for s in content(result).sections if s.title == "Modes of the rotor"]
    assert section.blocks[0].rows[0][-1].startswith("backward")
    assert section.blocks[1].text.startswith("unstable: mode ")
    (chart,) = [figure.picture for figure in figures(result) if figure.name == "campbell"]
    assert len(chart.table.rows) == 6
    assert "once a revolution" in chart.svg


@pytest.mark.parametrize(
    ("replacement", "message"),
    [
        (("gyroscopic: {path: G.txt, factor: 2}, ", ""), "'gyroscopic' matrix goes with the 'speed'"),
        ((", speed: 300", ""), "'gyroscopic' matrix goes with the 'speed'"),
        (("mass: M.txt, stiffness: K.txt", "model: m.op2"), "go with 'mass' and 'stiffness'"),
        (("stop: 50", "start: 60, stop: 50"), "'stop' is not above 'start'"),
    ],
)
def test_faults_stand_at_their_keys(replacement, message):
    old, new = replacement
    assert old in ROTOR
    assert any(message in fault for fault in faults_of(ROTOR.replace(old, new)))


def test_what_does_not_fit_a_rotor_is_refused(scene, tmp_path):
    with pytest.raises(UsageError, match=r"not skew-symmetric: entry \(1, 1\)"):
        dynid.run(scene(("G.txt", "K.txt")))
    np.savetxt(tmp_path / "small.txt", np.array([[0.0, 1.0], [-1.0, 0.0]]))
    with pytest.raises((UsageError, FileError), match="gyroscopic matrix is not 4 x 4"):
        dynid.run(scene(("G.txt", "small.txt")))
    plain = "gyroscopic: {path: G.txt, factor: 2}, circulatory: N.txt, speed: 300,"
    with pytest.raises(UsageError, match="a Campbell diagram is of a rotor"):
        dynid.run(scene((plain, "")))
    reduced = ("analysis:", "reduction: {method: guyan, masters: ['1:x']}\nanalysis:")
    with pytest.raises((UsageError, SceneError), match="gyroscopic and circulatory matrices are for modes"):
        dynid.run(scene(reduced))


def test_an_identified_rotor_is_explained_with_the_sensitivities_of_its_modes():
    from pathlib import Path

    from dynid.scene.explanation import explain

    scene = dynid.load_scene(Path(__file__).parents[2] / "configs/rotor.yaml")
    explanation = explain(scene)
    assert explanation.obstacle is None
    assert "identification/identifiability/modal_sensitivity/omega" in explanation.result
