"""Beams and frames in scenes: what hangs on them counts, and mistakes have their place."""

import numpy as np
import pytest

import dynid
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from tests.scene.example_scenes import faults_of

BEAM = """\
dynid: 1
kind: identification
structure:
  beam:
    elements: 4
    length: 2
    EI: 100
    rhoA: 2
    supports: [{node: 1, fix: [w, theta]}]
    springs: [{node: 5, direction: w, k: 25, c: 3}]
    masses: [{node: 5, m: 0.5}]
    damping: {beta: 0.0}
analysis: {inputs: [w_5], outputs: [{dof: w_5}], frequency: {start: 0, stop: 1, points: 2, scale: linear}}
"""
FRAME = """\
dynid: 1
kind: identification
structure:
  frame:
    nodes: [[0, 0], [2, 0]]
    members: [{nodes: [1, 2], EA: 1.0e6, EI: 100, rhoA: 2, elements: 4}]
    supports: [{node: 1, fix: [u, w, theta]}]
    springs: [{node: 2, direction: w, k: 25, c: 3}]
    masses: [{node: 2, m: 0.5}]
analysis: {inputs: [w_2], outputs: [{dof: w_2}], frequency: {start: 0, stop: 1, points: 2, scale: linear}}
"""


@pytest.mark.parametrize("text", [BEAM, FRAME], ids=["beam", "frame"])
def test_a_spring_at_the_tip_carries_its_share(text):
    """A cantilever and a spring are two springs side by side: 3 E I / L^3 + k, and c in the first order."""
    result = dynid.run(check_source(parse_source(text, "s.yaml")))
    still, slow = result["structure/frequency_response/response"].data.ravel()
    stiffness = 3 * 100 / 2**3 + 25
    np.testing.assert_allclose(still, 1 / stiffness, rtol=1e-12)
    # At 1 rad/s the damper alone gives the dynamic stiffness an imaginary part.
    np.testing.assert_allclose((1 / slow).imag, 3.0, rtol=1e-9)


CLAMPS = ", ".join(f"{{node: {k}, fix: [w, theta]}}" for k in range(1, 6))


@pytest.mark.parametrize(
    ("text", "right", "wrong", "fault"),
    [
        (BEAM, "{beta: 0.0}", "{beta: 0, ratio: 0.01}", "12:14: damping is either proportional ('alpha',"),
        (
            BEAM,
            "{beta: 0.0}",
            "{}",
            "12:14: damping is either proportional ('alpha', 'beta', 'eta') or modal",
        ),
        (BEAM, ", m: 0.5", "", "11:14: a mass has its 'm', a rotary inertia 'J', or both"),
        (BEAM, ", k: 25, c: 3", "", "10:15: a spring has a stiffness 'k', a damping 'c', or both"),
        (BEAM, "{node: 5, m", "{node: 6, m", "11:21: there is no node 6; there are 5"),
        (
            BEAM.replace("w_5", "w_1"),
            "[{node: 1, fix: [w, theta]}]",
            f"[{CLAMPS}]",
            "9:15: the supports leave nothing to move",
        ),
        (
            FRAME,
            "elements: 4",
            "elements: 100000}, {nodes: [1, 2], EA: 1.0e6, EI: 100, rhoA: 2",
            "6:14: the members have more than 100,000 elements together",
        ),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(text, right, wrong, fault):
    assert right in text
    assert faults_of(text.replace(right, wrong, 1))[0].startswith(fault)
