"""Screens: units, ranges, plurals, blank lines, and names instead of numbers."""

import re
from types import SimpleNamespace

import h5py
import pytest

pytestmark = pytest.mark.thorough

GRAPH = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: {type: Se, domain: mechanical}
    m: {type: I, value: 2}
    b: {type: R, value: 1}
    k: {type: C, value: 0.5}
    one: 1
  bonds: [F -> one -> m, one -> b, one -> k]
analysis:
  inputs: [F]
  outputs: [m.f, k.q]
  results: [properties, frequency_response]
  port: F -> one
  frequency: {start: 3, stop: 3, points: 1}
"""


@pytest.fixture
def screen(dynid, folder):
    (folder / "a.yaml").write_text(GRAPH)
    code, out, _ = dynid("run", "a.yaml", "--report", "a.html")
    assert code == 0
    return out


def test_gains_and_operating_points_have_their_units(screen, folder):
    assert "T(0) = 0 m/(s·N) · T(∞) = 0 m/(s·N)" in screen
    assert "T(0) = 0.5 m/N · T(∞) = 0 m/N" in screen
    assert "F = 1 gives e = 1 N, f = 0 m/s\n" in screen
    page = (folder / "a.html").read_text().replace("\N{NO-BREAK SPACE}", " ")
    assert "0.5 m/N" in page
    assert "F = 1 gives e = 1 N, f = 0 m/s" in page


def test_without_domains_nothing_stands_behind_the_numbers(dynid, folder):
    (folder / "b.yaml").write_text(GRAPH.replace("{type: Se, domain: mechanical}", "Se"))
    out = dynid("run", "b.yaml")[1]
    assert "T(0) = 0.5 · T(∞) = 0\n" in out
    assert "F = 1 gives e = 1, f = 0\n" in out


def test_a_verdict_without_roots_stands_on_the_line_of_its_name(screen):
    assert "    poles   stable\n" in screen
    assert "    zeros   minimum phase: there are no finite zeros\n" in screen
    assert "    zeros\n" not in screen


def test_no_two_lines_in_a_row_are_blank(screen):
    assert "\n\n\n" not in screen
    assert "\n\n  wrote " in screen


def test_a_range_of_one_frequency_is_one_number(screen):
    assert "frequency response: 1 frequency, 3 rad/s\n" in screen


BEAM = """\
dynid: 1
kind: reduction
structure: {beam: {elements: 5, length: 1, EI: 1, rhoA: 1, supports: [{node: 1, fix: [w, theta]}]}}
reduction: [{method: guyan, masters: [w_6]}, {method: irs, masters: [3, theta_4]}]
"""


def test_masters_are_named_by_their_labels(dynid, folder):
    (folder / "a.yaml").write_text(BEAM)
    out = dynid("run", "a.yaml")[1]
    assert "  guyan: master w_6\n" in out
    assert "  irs: masters w_3, theta_4\n" in out
    assert "guyan: 1 coordinate; masters w_6" in dynid("check", "--explain", "a.yaml")[1]


def test_one_of_a_thing_is_one(dynid, folder):
    (folder / "a.yaml").write_text(
        "dynid: 1\nkind: identification\nstructure: {lumped: {masses: [1]}}\nanalysis: {modes: {count: 1}}\n"
    )
    assert "  1 mode of 1 DOF; 1 rigid-body mode, no massless DOFs\n" in dynid("run", "a.yaml")[1]
    (folder / "b.h5").write_bytes((folder / "a.h5").read_bytes())
    with h5py.File(folder / "b.h5", "r+") as file:
        file["structure/modes/omega"][0] = 1.0
    assert dynid("compare", "a.h5", "b.h5")[1].startswith("1 difference\n")


def test_a_scene_in_hertz_is_answered_in_hertz(dynid, folder):
    hertz = "frequency: {start: 0.05, stop: 4, points: 3, unit: Hz}"
    scene = GRAPH.replace("frequency: {start: 3, stop: 3, points: 1}", hertz)
    scene = scene.replace("[properties,", "[poles, properties,").replace(
        "b: {type: R, value: 1}", "b: {type: R, value: 0.5}"
    )
    (folder / "a.yaml").write_text(scene)
    code, out, _ = dynid("run", "a.yaml", "--report", "a.html")
    assert code == 0
    assert "frequency response: 3 frequencies, 0.05 … 4 Hz" in out
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert "peak magnitude frequency (Hz)" in lines
    # m = 2, k = 2, b = 0.5: w = 1 rad/s; |f/F| is largest there, 1/b, |q/F| = 1/(b w_d) at sqrt(1 - 2 zeta^2)
    assert "m.f / F 2 0.1592" in lines
    assert "k.q / F 2.016 0.1566" in lines
    assert "f_n = 0.1592 Hz, ζ = 0.125" in out
    assert "poles   -0.125 ± 0.9922j rad/s\n" in out  # its natural frequency stands below
    page = (folder / "a.html").read_text()
    assert "frequency (Hz)" in page
    assert "2.016" in page
    assert "is largest, 2, at 0.1592 Hz" in page


def test_structures_in_hertz_are_answered_in_hertz(dynid, folder):
    """m = 2, c = 1, k = 800: w_n = 20 rad/s; |v/F| is largest there, 1/c."""
    structure = (
        "dynid: 1\nkind: {}\nstructure: {{lumped: {{masses: [2], links: [{{dofs: [1], k: 800, c: 1}}]}}}}\n"
    )
    hertz = "frequency: {start: 1, stop: 10, points: 5, unit: Hz}"
    (folder / "a.yaml").write_text(
        structure.format("identification")
        + f"analysis: {{inputs: [1], outputs: [{{dof: 1, quantity: velocity}}], {hertz}}}\n"
    )
    code, out, _ = dynid("run", "a.yaml", "--report", "a.html")
    assert code == 0
    assert " 1           3.183\n" in out
    assert "frequency (Hz)\n" in out
    assert "frequency (Hz)" in (folder / "a.html").read_text()
    (folder / "b.yaml").write_text(
        structure.format("reduction") + f"reduction: [{{method: guyan, masters: [1]}}]\n{hertz}\n"
    )
    code, out, _ = dynid("run", "b.yaml", "--report", "b.html")
    assert code == 0
    assert " f1 " in out
    assert "3.183" in out
    assert "f in Hz, joints included" in out
    assert "rad/s" not in out
    assert "f in Hz, joints included" in (folder / "b.html").read_text()


def test_what_is_round_off_of_a_response_is_0_and_an_end_of_the_range_is_no_peak(dynid, folder):
    """A velocity after a step of a force: v = t exp(-t), 9e-14 at t = 34; |v/F| falls from 1 rad/s on."""
    scene = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, one: 1, m: {type: I, value: 1}, b: {type: R, value: 2}, k: {type: C, value: 1}}
  bonds: [F -> one -> m, one -> b, one -> k]
analysis:
  outputs: [m.f, k.q]
  results: [frequency_response, time_response]
  frequency: {start: 2, stop: 30, points: 5}
  time: {stop: 34, step: 0.5, input: {kind: step, amplitude: 100}}
"""
    (folder / "a.yaml").write_text(scene)
    _, out, _ = dynid("run", "a.yaml", "--report", "a.html")
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert "min max final" in lines
    assert "m.f 0 36.79 0" in lines
    assert "k.q 0 100 100" in lines
    assert "m.f / F 0.4 2, the lower end of the range" in lines
    page = (folder / "a.html").read_text()
    assert "2, the lower end of the range" in page
    assert "is largest, 0.4, at 2 rad/s, the lower end of the range" in page
    (folder / "a.yaml").write_text(scene.replace("start: 2, stop: 30", "start: 0.1, stop: 0.5"))
    _, out, _ = dynid("run", "a.yaml")
    assert "m.f / F             0.4  0.5, the upper end of the range\n" in out
    (folder / "a.yaml").write_text(scene.replace("start: 2", "start: 0.1"))
    _, out, _ = dynid("run", "a.yaml")
    assert re.search(r"m.f / F +0.5 +1\n", out)


@pytest.fixture
def narrow(monkeypatch):
    """A terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    terminal = SimpleNamespace(stdout=SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr("dynid.cli.text.sys", terminal)


@pytest.mark.parametrize(
    "command",
    [
        ["bench", "--list"],
        ["library"],
        ["new"],
        ["doctor"],
        ["check", "a.yaml", "--explain"],
        ["check", "identification.yaml", "--explain"],
        ["run", "a.yaml"],
        ["show", "a.h5", "--all"],
        ["compare", "a.h5", "b.h5"],
        ["study", "study.yaml", "--dry-run"],
    ],
    ids=" ".join,
)
@pytest.mark.usefixtures("narrow")
def test_screens_are_as_wide_as_the_terminal_and_break_no_word(dynid, folder, command):
    (folder / "a.yaml").write_text(GRAPH)
    for template in ("identification", "study", "bond-graph"):
        dynid("new", template, "--no-schema")
    if "a.h5" in command:
        dynid("run", "a.yaml", "-q")
        dynid("run", "a.yaml", "-q", "--set", "graph.nodes.m.value=2.5", "-o", "b.h5")
    out = dynid(*command)[1]
    wide = [line for line in out.splitlines() if len(line) > 80 and " " in line.strip()]
    assert wide == []


def test_what_is_not_of_the_model_is_left_out_of_the_screen_but_not_of_the_trace(screen, dynid):
    assert "left out" not in screen
    trace = " ".join(dynid("show", "a.h5", "--trace")[1].split())
    assert "left out: 1 of 3 engines: float (the exact engine is used" in trace


def test_differences_are_counted_first_and_have_the_digits_that_differ(dynid, folder):
    (folder / "a.yaml").write_text(GRAPH)
    dynid("run", "a.yaml", "-q")
    dynid("run", "a.yaml", "-q", "--set", "graph.nodes.k.value=0.500000123456789", "-o", "b.h5")
    first, *listed, last = dynid("compare", "a.h5", "b.h5")[1].splitlines()
    assert int(first.split()[0]) == len(listed) + int(last.split()[0])
    assert last.endswith("in error bounds and in what was left out, which are not listed")
    (gain,) = [line for line in listed if "k.q/F/dc_gain" in line]
    assert gain == "  bond_graph/properties/k.q/F/dc_gain: 0.5 against 0.500000123"
