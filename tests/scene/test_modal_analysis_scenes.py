"""Scenes of kind `modal-analysis`: what they read, refuse, and write."""

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError, UsageError
from tests.scene.example_scenes import MODAL, faults_of

M = np.diag([2.0, 1.5, 1.0])
K = np.array([[5e4, -3e4, 0], [-3e4, 5.5e4, -2.5e4], [0, -2.5e4, 2.5e4]])
C = 2e-4 * K
OMEGA = 2 * np.pi * np.linspace(2, 45, 400)


def receptance(response, force):
    """Return the receptance of the chain at the lines, by a solution at each."""
    unit = np.eye(3)[:, force]
    return np.array([np.linalg.solve(K + 1j * w * C - w**2 * M, unit)[response] for w in OMEGA])


def text(path, noise=0.02, seed=0):
    """Write responses as the scene has them: twice the velocity against 12:z."""
    random = np.random.default_rng(seed)
    exact = np.column_stack([-(OMEGA**2) * receptance(0, 2), -2j * OMEGA * receptance(2, 2)])
    complex_noise = random.standard_normal(exact.shape) + 1j * random.standard_normal(exact.shape)
    values = exact + noise * np.abs(exact) * complex_noise / np.sqrt(2)
    parts = np.column_stack([OMEGA / (2 * np.pi), values.view(float)])
    np.savetxt(path, parts, delimiter=",", header="f,a,b,c,d", comments="", fmt="%.12g")


@pytest.fixture
def scene(tmp_path):
    text(tmp_path / "f.csv")
    path = tmp_path / "modal.yaml"

    def written(*replacements, base=MODAL):
        for old, new in replacements:
            assert old in base
            base = base.replace(old, new)
        path.write_text(base)
        return path

    return written


def test_modes_of_a_chain(scene):
    result = dynid.run(scene(("dof: 3}", 'dof: "12:z"}'), ("shapes: real", "shapes: complex")))
    squares, shapes = np.linalg.eigh(np.diag(np.diag(M) ** -0.5) @ K @ np.diag(np.diag(M) ** -0.5))
    omega = np.sqrt(squares)
    shapes = (np.diag(np.diag(M) ** -0.5) @ shapes)[[0, 2]] / np.sqrt(2j * omega)  # small damping
    error = result["modal/frequency_standard_error"].data
    assert np.all(np.abs(result["modal/frequency"].data - omega) < 4 * error)
    assert np.all(error < 1e-3 * omega)
    assert np.allclose(result["modal/damping"].data, 1e-4 * omega, rtol=0.05)
    assert list(result["modal/channel"].data) == ["1", "12:z"]
    assert result["modal/shape"].attrs["normalisation"] == "modal a of 1"
    assert np.allclose(result["modal/shape"].data ** 2, shapes.T**2, rtol=0.05)


def test_without_a_driving_point_the_largest_entry_is_one(scene):
    shape = dynid.run(scene())["modal/shape"]
    assert shape.attrs["normalisation"] == "largest entry 1"
    assert np.allclose(np.abs(shape.data).max(axis=1), 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("high: 45", "high: 1", "'high' is not above 'low'"),
        ("file: {path: f.csv", "band: [1, 2], file: {path: f.csv", "band of a modal analysis is its key"),
        ("{dof: 1, quantity", "{dofs: [1, 2], quantity", "a shape has one DOF a channel; write 'dof'"),
        ("band: {", "excitation: [{kind: step, dof: 1}]\nband: {", "leave 'excitation' out"),
        ("file: {path: f.csv, frequency: f, columns: [[a, b], [c, d]]}, unit: Hz",
         "simulate: {lines: {start: 1, stop: 2}}", "there is no model to simulate"),
        ("band: {low", "# {low", "needs the key 'band'"),
    ],
)  # fmt: skip
def test_faults_stand_at_their_keys(old, new, message):
    assert old in MODAL
    assert any(message in fault for fault in faults_of(MODAL.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("low: 2, high: 45", "low: 60, high: 80", "no line lies in the band; they go from 2 to 45 Hz"),
        ("low: 2, high: 45", "low: 2, high: 3", "10 lines"),
        ('"12:-z", quantity: velocity, reference: {dof: 3}', "12, quantity: velocity, reference: {dof: 4}",
         "responses to some references are missing: 1/4, 12/3"),
        ('"12:-z", quantity: velocity', "1, quantity: velocity", "a response is measured twice"),
    ],
)  # fmt: skip
def test_a_measurement_that_does_not_fit_is_refused(scene, old, new, message):
    with pytest.raises((UsageError, SceneError), match=message):
        dynid.run(scene((old, new)))


def test_explanation_says_what_is_read(scene):
    from dynid.scene.explanations.explanation import explain

    facts = {fact.topic: fact.text for fact in explain(dynid.load_scene(scene())).facts}
    assert facts["responses"] == "2 responses to 1 reference (3)"
    assert facts["lines"].startswith("400 lines")
    assert "largest entry 1" in facts["scale"]
    assert "1 lines" in str(explain(dynid.load_scene(scene(("low: 2", "low: 44.99")))).obstacle)
    assert explain(dynid.load_scene(scene(("low: 2, high: 45", "low: 60, high: 80")))).obstacle is not None
