"""Small things of the screens: units, ranges, plurals, blank lines, and names instead of numbers."""

import h5py
import pytest

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
    assert "T(0) = 0 m/(s.N) · T(∞) = 0 m/(s.N)" in screen
    assert "T(0) = 0.5 m/N · T(∞) = 0 m/N" in screen
    assert "F = 1 gives e = 1 N, f = 0 m/s\n" in screen
    page = (folder / "a.html").read_text()
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
    assert "\n\n  left out" in screen


def test_a_range_of_one_frequency_is_one_number(screen):
    assert "frequency response at 1 frequency, 3 rad/s\n" in screen


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
    assert dynid("compare", "a.h5", "b.h5")[1].endswith("\n1 difference\n")
