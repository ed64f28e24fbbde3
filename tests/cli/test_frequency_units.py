"""Units of frequencies: scenes in Hz have screens and pages in Hz; complex roots stay in rad/s."""

import re

import numpy as np
import pytest

from dynid.scene.schema.raw import unit_of_frequencies
from dynid.units import HERTZ, RADIANS

#: A force on a mass between a spring and an absorber (k = 900, m = 1): zeros of the mass at ±30j.
ABSORBER = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    a: 1
    m: {type: I, value: 10}
    k: {type: C, value: 1/4000}
    d: 0
    c: {type: C, value: 1/900}
    b: 1
    n: {type: I, value: 1}
  bonds: [F -> a -> m, a -> k, a -> d -> c, d -> b -> n]
analysis:
  outputs: [m.f]
  results: [zeros, poles, properties, hidden_modes, sensitivities]
  port: a -> d
  frequency: {start: 1, stop: 10, points: 20, unit: UNIT}
"""
RECORD = """\
dynid: 1
kind: identification
structure: {lumped: {masses: [2, 2], links: [{dofs: [1], k: 2.0e4, c: 20}]}}
joints: {j: {dofs: [1, 2], k: {start: 1.0e4, true: 2.0e4}, c: {value: 20}}}
excitation: [{dof: 2, kind: sine, amplitude: 1, frequency: 15, unit: UNIT}]
measurement:
  step: 0.002
  samples: 500
  channels: [{dof: 2, quantity: velocity}]
  simulate: {noise_ratio: 0.01}
"""


def test_roots_are_labelled_and_their_frequencies_are_in_hertz(dynid, folder):
    (folder / "a.yaml").write_text(ABSORBER.replace("UNIT", "Hz"))
    code, out, _ = dynid("run", "a.yaml", "--report", "a.html")
    assert code == 0
    hertz = f"{30 / (2 * np.pi):.4g} Hz"
    assert f"    zeros   0 rad/s, ± 30j rad/s ({hertz})\n" in out
    assert f"at 30 rad/s ({hertz})" in " ".join(out.split())
    modes = next(line for line in out.splitlines() if "natural modes" in line)
    assert modes.count(" rad/s (") == modes.count(" Hz)") == 2
    page = (folder / "a.html").read_text()
    assert "f_n (Hz)" in page
    assert "ω_n" not in page
    assert f"± 30j rad/s ({hertz})" in page.replace("\N{NO-BREAK SPACE}", " ")


def test_roots_of_a_scene_in_radians_stand_alone(dynid, folder):
    (folder / "a.yaml").write_text(ABSORBER.replace("UNIT", "rad/s"))
    out = dynid("run", "a.yaml", "--report", "a.html")[1]
    assert "zeros   0, ± 30j rad/s\n" in out
    page = (folder / "a.html").read_text()
    assert "ω_n (rad/s)" in page
    assert "f_n" not in page


@pytest.mark.thorough
@pytest.mark.parametrize(("unit", "other"), [("Hz", "rad/s"), ("rad/s", "Hz")])
def test_a_plan_is_in_the_unit_of_its_scene(dynid, folder, unit, other):
    (folder / "a.yaml").write_text(RECORD.replace("UNIT", unit))
    code, out, _ = dynid("plan", "a.yaml", "-o", "p.h5")
    assert code == 0
    assert f" {unit}" in out
    assert other not in out
    assert dynid("report", "p.h5", "-o", "p.html")[0] == 0
    page = (folder / "p.html").read_text()
    text = page[page.index("<main") : page.index("</main")] if "<main" in page else page
    assert re.search(rf"^ +(DOF 2 at [0-9.]+ {unit})", out, re.MULTILINE)[1] in text


@pytest.mark.thorough
@pytest.mark.parametrize(("unit", "expected"), [("Hz", "excited up to 15 Hz"), ("rad/s", "up to 15 rad/s")])
def test_what_is_explained_is_in_the_unit_of_the_scene(dynid, folder, unit, expected):
    (folder / "a.yaml").write_text(RECORD.replace("UNIT", unit))
    code, out, _ = dynid("check", "--explain", "a.yaml")
    assert code == 0
    assert expected in out
    heads = next(line for line in out.splitlines() if line.split()[:1] == ["mode"])
    assert heads.split()[1] == unit


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ({"analysis": {"frequency": {"start": 1, "unit": "Hz"}}}, HERTZ),
        ({"analysis": {"frequency": {"start": 1}}}, RADIANS),
        ({"analysis": {"frequency": {"start": 1}}, "excitation": [{"kind": "sine", "unit": "Hz"}]}, RADIANS),
        ({"excitation": [{"kind": "sine", "unit": "Hz"}]}, HERTZ),
        ({"excitation": [{"kind": "sine", "frequency": 3.0}]}, RADIANS),
        ({"excitation": [{"kind": "sine", "frequency": 3.0, "unit": "rad/s"}]}, RADIANS),
        ({"measurement": {"frf": {"simulate": {"lines": {"start": 1, "unit": "Hz"}}}}}, HERTZ),
        ({"measurement": {"frf": {"file": {"path": "a.uff"}, "unit": "Hz"}}}, HERTZ),
        ({"plan": {"excitation": {"band": [1, 2], "unit": "Hz"}}}, HERTZ),
        ({"reduction": [{"method": "dynamic", "frequency": 10, "unit": "Hz"}]}, HERTZ),
        ({}, RADIANS),
    ],
)
def test_the_frequency_axes_decide_the_unit(data, expected):
    assert unit_of_frequencies(data) is expected
