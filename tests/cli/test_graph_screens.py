"""Screens of bond graphs with loops, laws and engines: the lines that say how far a result holds."""

import re

import pytest

from dynid.cli.screen import summary
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

#: Its closed loop is s^3 + 500.1 s^2 + 1050 s + 10^4 C: stable up to C = 52.51 (Routh).
SERVO = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    voltage: Se
    m: {model: dc_motor, R: 2, L: 0.01, k: 0.1, J: 0.001, b: 0.0001}
    shaft: 1
  bonds: [voltage -> m.supply, m.shaft -> shaft]
control:
  loops:
    - {from: m.L.f, to: voltage, controller: {gain: 3}}
    - {from: shaft.q, to: voltage, controller: CONTROLLER, reference: target}
analysis: {outputs: [shaft.q]}
"""

SPRING = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    x: 1
    m: {type: I, value: 2}
    c: {type: R, law: {e: "0.5*f + f*abs(f)"}}
    k: {type: C, law: {e: "-q + 4*q**3"}}
  bonds: [F -> x, x -> m, x -> c, x -> k]
operating_point: {start: {k.q: 0.4}}
analysis: {outputs: [k.q], reading: binary}
"""


def screen(text):
    return summary(run_scene(check_source(parse_source(text.lstrip("\n"), "scene.yaml"))), "")


def test_margins_stand_below_their_loop():
    loops = screen(SERVO.replace("CONTROLLER", "{gain: 4}")).partition("  feedback loops\n")[2]
    heads, inner, outer = (re.split(r"  +", line.strip()) for line in loops.splitlines()[:3])
    assert heads == ["gain margin", "phase margin", "delay margin", "Ms", "Mt", "closed loop"]
    assert inner[:2] == ["m.L.f -> voltage", "∞"]
    # L = 0.4/(1e-5 s^3 + 0.005001 s^2 + 0.0105 s): Im L = 0 at w^2 = 0.0105/1e-5
    assert outer[:3] == ["shaft.q -> voltage", "13.13 at 32.4 rad/s", "12.4° at 8.838 rad/s"]
    assert outer[-1] == "stable"


def test_an_unstable_loop_has_the_gains_at_which_its_roots_cross():
    text = screen(SERVO.replace("CONTROLLER", "{gain: 4000}"))
    assert "    shaft.q -> voltage: unstable: poles at 53.43 ± 251.1j lie in the right half-plane" in text
    assert "    margins, Ms and Mt are not defined where the closed loop is not stable\n" in text
    assert "    shaft.q -> voltage: its roots cross the axis at gain times 0.01313\n" in text


def test_poles_with_delays_stand_below_the_loops():
    text = screen(SERVO.replace("CONTROLLER", "{gain: 20, delay: 0.02}"))
    assert "  delays are Padé approximants of order 6 in what is a rational function; " in text
    assert (
        "    shaft.q -> voltage: unstable: 2 roots lie in the right half-plane (Nyquist count with delays)\n"
        in text
    )
    assert "  poles with delays\n    poles   2.962 ± 18.94j, " in text


def test_what_is_computed_from_approximants_is_marked_on_the_screen():
    """Zeros, poles, steps and state equations have the delay as it is; no root of approximants shows."""
    wanted = "[transfer_function, zeros, poles, properties, step_info, bandwidth, state_space, sensitivities]"
    asked = f"analysis: {{outputs: [shaft.q], inputs: [target], results: {wanted}}}"
    text = SERVO.replace("analysis: {outputs: [shaft.q]}", asked)
    late = screen(text.replace("CONTROLLER", "{gain: 4, delay: 0.002}"))
    marked = [line.strip().partition(" ")[0] for line in late.splitlines() if "(approximate)" in line]
    assert not {"zeros", "poles", "properties:"} & set(marked)
    assert "minimum phase: there are no finite zeros\n" in late
    assert "    properties: relative degree 3 · T(0) = 0.25 rad/V · " in late
    steps, band = (late.partition(f"    {name}: ")[2] for name in ("step response", "bandwidth"))
    assert "(approximate)" not in steps.partition("bandwidth: ")[0]
    assert "(approximate)" not in band.partition("\n  changes")[0]
    table = band.partition("\n  changes if a parameter is larger by 1 %")[2].partition("\n\n")[0]
    assert "T(0)" in table
    assert "pole" not in table
    assert "  state equations\n" in late
    for name in ("margin ", "poles with delays"):
        assert not [line for line in late.splitlines() if name in line and "approx" in line]
    assert "approx" not in screen(text.replace("CONTROLLER", "{gain: 4}"))


@pytest.mark.parametrize(("most", "left"), [(1, "    … 1 more slope in the file\n"), (2, "")])
def test_the_operating_point_and_its_slopes_are_listed(most, left, monkeypatch):
    monkeypatch.setattr("dynid.report.content.bond_graph.MOST_ROOTS", most)
    text = screen(SPRING)
    assert "  every value is read as the double nearest to it (reading: binary)\n" in text
    assert "  warning: 3 equilibria were found; number 1 is analysed (nearest)" in text
    assert "    point   3 equilibria found (stable, unstable, stable); number 1 is" in text
    shown = "    d c.e / d c.f    0.5\n" + ("" if most == 1 else "    d k.e / d k.q      2\n")
    assert f"    slope          value\n{shown}{left}\n" in text


def test_an_engine_that_rounds_says_so():
    text = SERVO[: SERVO.index("control:")] + "analysis: {outputs: [shaft.q], engine: ENGINE}\n"
    assert "  float engine: " in screen(text.replace("ENGINE", "float"))
    assert "float engine: " not in screen(text.replace("ENGINE", "exact"))


def test_energy_and_a_port_have_their_own_lines():
    text = SPRING.replace('law: {e: "0.5*f + f*abs(f)"}', "value: 0.5").replace(
        'law: {e: "-q + 4*q**3"}', "value: 0.5"
    )
    text = text.replace("operating_point: {start: {k.q: 0.4}}\n", "")
    text = screen(text.replace("reading: binary", "port: x -> k, results: [poles, energy]"))
    assert "  port x -> k\n    prototype: " in text
    # s^2 + 0.25 s + 1: half of the energy in each, all lost in the resistance
    assert (
        "  energy of the modes\n    -0.125 ± 0.9922j: energy in k 50 %, m 50 %; dissipated in c 100 %\n"
        in text
    )
