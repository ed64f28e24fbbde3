"""Sampled loops around lines and delayed loops: lifted polynomials, sums over aliases, responses."""

import re

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError, UsageError
from dynid.scene.kinds.bond_graph import question
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

LINE = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    u: Se
    a: 1
    Rs: {type: R, value: 0.4}
    cable: {type: TL, impedance: 2, delay: 0.15}
    b: 0
    RL: {type: R, value: 5}
    C: {type: C, value: 0.5}
  bonds: [u -> a, a -> Rs, a -> cable -> b, b -> RL, b -> C]
control:
  loops:
    - {from: C.e, to: u, controller: {pid: {kp: 0.8, ki: 0.5}, sample: 0.1, computation: 0.04}, setpoint: w}
analysis: {inputs: [w], outputs: [C.e], results: [properties]}
"""
T, LATE = 0.1, 0.04


def scene(text):
    return check_source(parse_source(text, "scene.yaml"))


def loops_of(text):
    return question(scene(text))[1].sampled_loops


def pulse_transfer(z, Rs, RL=5.0, C=0.5, Z=2.0, delay=0.15):
    """Return L by the sum over aliases of the held response through chain matrices."""
    w = np.angle(z) / T
    s = 1j * (w + 2 * np.pi / T * np.arange(-30000, 30001))
    Y = 1 / RL + C * s
    cosh, sinh = np.cosh(s * delay), np.sinh(s * delay)
    plant = 1 / (cosh + Z * sinh * Y + Rs * (sinh / Z + cosh * Y))
    held = (1 - np.exp(-s * T)) / s * np.exp(-s * LATE)
    return (0.8 + 0.5 * T / 2 * (z + 1) / (z - 1)) * np.sum(plant * held) / T


@pytest.mark.parametrize("Rs", [0.4, 2.0, 7.0])
def test_the_loop_is_the_sum_over_aliases(Rs):
    loops = loops_of(LINE.replace("value: 0.4", f"value: {Rs}"))
    for omega in (0.3, 2.0, 11.0, 30.0):
        expected = pulse_transfer(np.exp(1j * omega * T), Rs)
        assert loops.gain(0, np.array([omega]))[0] == pytest.approx(expected, abs=2e-5 * abs(expected) + 1e-6)


@pytest.mark.parametrize("delay", [0.15, 0.123])
def test_a_matched_line_is_a_dead_time(delay):
    """Rs = Z: the plant is exp(-0.15 s)/(2 (1 + ...)), whose polynomial in z is finite."""
    loops = loops_of(LINE.replace("value: 0.4", "value: 2").replace("delay: 0.15", f"delay: {delay}"))
    rest = delay + 0.04 - T  # x' = -rate x + gain u(t - T - rest)
    rate, gain = (1 / 2 + 1 / 5) / 0.5, 1 / (2 * 0.5)
    decay = np.exp(-rate * T)
    late, early = (gain / rate * (1 - np.exp(-rate * t)) for t in (T - rest, rest))
    newest, before = late, np.exp(-rate * (T - rest)) * early
    plant = np.array([newest, before])  # over z (z - decay), times z^-1
    controller = np.array([0.8 + 0.025, -0.8 + 0.025])
    closed = np.polyadd(np.polymul([1, -decay, 0, 0], [1, -1]), np.polymul(plant, controller))
    expected = sorted(np.roots(closed), key=lambda pole: (-abs(pole), pole.imag))
    listed = loops.listed_poles
    assert listed == pytest.approx(np.array(expected[: len(listed)]), abs=1e-12)
    assert loops.verdict.stable


def peak(text, start, stop):
    response = dynid.run(scene(text))["bond_graph/time_response/response"]
    times = response.data[:, 0]
    return float(np.abs(np.diff(times[start:stop])).max())


@pytest.mark.parametrize("kind", ["line", "loop"])
def test_the_gain_margin_is_where_responses_begin_to_grow(kind):
    if kind == "line":
        text = LINE
    else:
        text = LINE.replace("cable: {type: TL, impedance: 2, delay: 0.15}", "cable: 1")
        inner = "{from: C.e, to: v, controller: {gain: 0.4, delay: 0.25}}"
        text = text.replace("u: Se", "u: Se\n    v: Se").replace("u -> a,", "u -> a, v -> a,")
        text = text.replace("loops:\n", f"loops:\n    - {inner}\n")
    loops = loops_of(text)
    margin = loops.margins(0)
    assert loops.verdict.stable
    assert 1 < margin.gain < 100
    timed = text.replace("results: [properties]", "time: {stop: 14, step: 0.1, input: {kind: step}}")
    for factor, grows in ((0.9, False), (1.1, True)):
        scaled = re.sub(
            r"kp: 0.8, ki: 0.5", f"kp: {0.8 * margin.gain * factor}, ki: {0.5 * margin.gain * factor}", timed
        )
        assert (peak(scaled, 110, 140) > peak(scaled, 40, 70)) is grows
        verdict = loops_of(scaled).verdict
        assert verdict.kind == ("unstable" if grows else "stable")
        assert verdict.unstable_poles == (2 if grows else 0)


def test_phase_and_delay_margins_from_both_sides():
    loops = loops_of(LINE)
    margin = loops.margins(0)
    L = loops.gain(0, np.array([margin.gain_crossover]))[0]
    assert abs(L) == pytest.approx(1, rel=1e-12)
    assert np.degrees(np.angle(-L)) % 360 == pytest.approx(margin.phase, abs=1e-9)
    at = loops.gain(0, np.array([margin.modulus_at]))[0]
    assert 1 / abs(1 + at) == pytest.approx(margin.Ms, rel=1e-12)
    for factor, stable in ((1 - 1e-6, True), (1 + 1e-6, False)):
        later = LINE.replace("computation: 0.04", f"computation: {0.04 + margin.delay * factor:.17g}")
        assert loops_of(later).verdict.stable is stable


def test_results_of_a_sampled_loop_behind_a_line():
    text = LINE.replace("results: [properties]", "time: {stop: 20, step: 0.1, input: {kind: step}}").replace(
        "analysis: {", "analysis: {frequency: {start: 0.1, stop: 9, points: 12}, "
    )
    result = dynid.run(scene(text))
    assert result.value("bond_graph/system/stability") == "stable"
    assert result["bond_graph/margins/phase"].data[0] == pytest.approx(loops_of(LINE).margins(0).phase)
    assert len(result["bond_graph/sampled/poles"].data) > 2
    assert "bond_graph/system/largest_sample_time" not in result
    assert "infinitely many" in result.group_attrs["bond_graph/root_locus"]["left_out"]
    response = result["bond_graph/frequency_response/response"].data[0, 0, 0]
    assert abs(response) == pytest.approx(1, abs=0.1)


def test_the_fundamental_response_behind_a_line_is_that_of_a_sine():
    omega = 2.0
    text = LINE.replace(
        "results: [properties]",
        f"frequency: {{start: {omega}, stop: 3, points: 2}}, "
        f"time: {{stop: {8 * np.pi}, step: {np.pi / 100}, input: {{kind: sine, frequency: {omega}}}}}",
    )
    result = dynid.run(scene(text))
    response = result["bond_graph/frequency_response/response"].data[0, 0, 0]
    times = result["bond_graph/time_response/time"].data
    values = result["bond_graph/time_response/response"].data[:, 0]
    last = times >= times[-1] - 4 * np.pi + 1e-9  # four periods
    fundamental = 2 * np.mean(values[last] * np.exp(-1j * omega * times[last])) * 1j
    assert response == pytest.approx(fundamental, abs=1e-2)


def test_delays_without_a_common_part_are_refused_with_the_reason():
    loops = loops_of(LINE.replace("delay: 0.15", "delay: 0.1501234"))
    assert loops.verdict.kind == "undecided"
    assert "the common part of the sample time, 0.1 s, and the delays" in loops.verdict.reason
    result = dynid.run(scene(LINE.replace("delay: 0.15", "delay: 0.1501234")))
    assert result.value("bond_graph/system/stability") == "undecided"


@pytest.mark.parametrize(
    ("Rs", "RL", "kind"),
    [("0", "1.0e12", "at the limit"), ("-1", "50", "unstable"), ("-1.6", "2.01", "stable")],
)
def test_where_poles_gather(Rs, RL, kind):
    """The reflections alone: |Γs Γl| on, outside and inside the circle."""
    text = LINE.replace("value: 0.4", f"value: {Rs}").replace("value: 5}", f"value: {RL}}}")
    text = text.replace(", b -> C]", "]").replace("    C: {type: C, value: 0.5}\n", "").replace("C.e", "RL.e")
    text = text.replace("kp: 0.8, ki: 0.5", "kp: 1.0e-4")
    if Rs == "0":
        text = text.replace("    Rs: {type: R, value: 0}\n", "").replace("a -> Rs, ", "")
    loops = loops_of(text)
    assert loops.verdict.kind == kind


def test_poles_that_gather_on_the_circle_leave_no_margins():
    text = LINE.replace("    Rs: {type: R, value: 0.4}\n", "").replace("a -> Rs, ", "")
    text = text.replace("    RL: {type: R, value: 5}\n", "").replace("b -> RL, ", "").replace("C.e", "Q.f")
    text = text.replace("C: {type: C, value: 0.5}", "Q: {type: R, value: 1.0e12}").replace("b -> C", "b -> Q")
    text = text.replace("results: [properties]", "results: [properties, step_info]")
    result = dynid.run(scene(text))
    assert result.value("bond_graph/system/stability") == "at the limit"
    assert "bond_graph/margins/loop" not in result
    with pytest.raises(UsageError, match="the frequency response of sampled loops is not computed"):
        dynid.run(
            scene(
                text.replace(
                    "[properties, step_info]",
                    "[frequency_response], frequency: {start: 1, stop: 2, points: 2}",
                )
            )
        )


NONLINEAR = LINE.replace("RL: {type: R, value: 5}", "RL: {type: R, law: {f: 0.2*e + 0.1*e**3}}").replace(
    "results: [properties]", "time: {stop: 2, step: 0.1, input: {kind: step}}"
)


@pytest.mark.parametrize(
    ("drop", "message"),
    [
        ("", "the response of nonlinear laws is not computed with sampled loops"),
        (", sample: 0.1, computation: 0.04", "is not computed with a line"),
    ],
)
def test_nonlinear_responses_are_refused(drop, message):
    with pytest.raises(SceneError, match=message):
        dynid.run(scene(NONLINEAR.replace(drop, "") if drop else NONLINEAR))
