"""Figures of feedback loops: Nyquist diagrams, sensitivity functions, root loci."""

import numpy as np
import pytest

import dynid
from dynid.report import figures
from dynid.report.content import content
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

SCENE = """
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, j: 1, J: {type: I, value: 0.5}, b: {type: R, value: 0.2}}
  bonds: [u -> j, j -> J, j -> b]
control:
  loops: [{from: J.f, to: u, controller: CONTROLLER, reference: r}]
analysis: {outputs: [J.f], results: [properties]}
"""


def drawn(controller):
    result = dynid.run(check_source(parse_source(SCENE.replace("CONTROLLER", controller), "scene.yaml")))
    return result, {figure.name: figure.draw() for figure in figures(result)}


def test_a_loop_without_feedback_is_drawn():
    """Its L is 0 and it has no root locus; the page says so."""
    text = SCENE.replace("CONTROLLER", "{gain: 2, delay: 0.1}").replace(
        "loops: [", "loops: [{from: F.e, to: u, controller: {gain: -1, delay: 0.2}}, "
    )
    text = text.replace("u: Se,", "u: Se, F: Se,").replace("bonds: [", "bonds: [F -> j, ")
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    pictures = {figure.name: figure.draw() for figure in figures(result)}
    assert "L = 0, nothing is fed back" in pictures["loop-nyquist"].caption
    assert "root-locus-loop-1" not in pictures
    assert "root-locus-loop-2" in pictures
    table, remark = {section.title: section for section in content(result).sections}["Feedback loops"].blocks
    assert remark.whole == "F.e -> u: L = 0: nothing is fed back, so that it moves no pole"
    assert table.rows[0] == ("F.e -> u", "∞", "∞", "∞", "1", "0", "stable")


@pytest.mark.parametrize("controller", ["{gain: 2, delay: 0.1}", "{gain: 2}"])
def test_captions_and_tables_mark_what_is_computed_from_approximants(controller):
    wanted = "[transfer_function, zeros, poles, properties, step_info, state_space, source_performance, "
    wanted += "frequency_response]"
    late = "delay" in controller
    port = "" if late else "port: j -> b, "
    more = f"results: {wanted}, {port}frequency: {{start: 0.5, stop: 50, points: 9}}"
    text = SCENE.replace("results: [properties]", more).replace("CONTROLLER", controller)
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    pictures = {figure.name: figure.draw() for figure in figures(result)}
    exact = {
        "poles-J.f-r",
        "root-locus-loop-1",
        "bode",
        "nyquist",
        "loop-bode",
        "loop-nyquist",
        "sensitivity-functions",
        *(() if late else ("performance",)),
    }
    assert exact <= pictures.keys()
    assert not any("Padé" in pictures[name].caption for name in exact)
    assert pictures["poles-J.f-r"].table.columns[0] == "root"
    sections = {section.title: section for section in content(result).sections}
    mark = " (approximate)" if late else ""
    assert {f"Sources{mark}", "State equations"} <= sections.keys()
    assert ("Port j -> b" in sections) == (not late)
    assert ("Delays" in sections) == late
    (channel,) = sections["J.f / r"].blocks
    items = dict(channel.items)
    for name in ("zeros", "poles", "step response"):
        assert not items[name][0].endswith(" (approximate)")
    order = "" if late else "order 1 · "
    assert items["properties"][0].startswith(f"{order}relative degree 1 · T(0) ")


def test_a_dead_time_neither_undershoots_nor_has_a_zero():
    """A delayed set point gives J.f = 0 until the delay is over."""
    text = SCENE.replace("CONTROLLER", "{gain: 2, delay: 0.1}").replace("reference: r", "setpoint: r")
    text = text.replace("[properties]", "[zeros, properties, step_info]")
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    assert result.value("bond_graph/properties/J.f/r/undershoot") == 0
    assert not result.value("bond_graph/properties/J.f/r/minimum_phase")
    sections = {section.title: section for section in content(result).sections}
    items = dict(sections["J.f / r"].blocks[0].items)
    assert items["zeros"][1] == "non-minimum phase: dead time of 0.1 s; there are no finite zeros"
    assert "undershoot" not in items["step response"][0]


def test_the_phase_of_a_delay_is_followed_between_the_frequencies():
    """L = 2 e^(-s 20)/(0.5 s + 0.2): it turns by 1,000 rad up to 50 rad/s, on nine frequencies."""
    text = SCENE.replace("CONTROLLER", "{gain: 0.1, delay: 20}")
    more = "[properties, frequency_response], frequency: {start: 0.5, stop: 50, points: 9}"
    result = dynid.run(check_source(parse_source(text.replace("[properties]", more), "scene.yaml")))
    omega = result["bond_graph/sensitivity_functions/omega"].data
    phase = result["bond_graph/sensitivity_functions/phase"].data[:, 0]
    expected = -20 * omega - np.arctan2(0.5 * omega, 0.2)
    np.testing.assert_allclose(phase, np.rad2deg(expected), rtol=1e-12)
    (picture,) = (figure.draw() for figure in figures(result) if figure.name == "loop-bode")
    assert f"{picture.table.rows[-1][-1]:.6g}" == f"{phase[-1]:.6g}"
    closed = result["bond_graph/frequency_response/phase"].data[:, 0, 0]
    s = 1j * omega
    response = 1 / (0.5 * s + 0.2 + 0.1 * np.exp(-20 * s))
    assert np.exp(1j * np.deg2rad(closed)) == pytest.approx(response / np.abs(response), abs=1e-9)


@pytest.mark.parametrize("controller", ["{gain: 2, delay: 0.1}", "{pid: {kp: 2, ki: 5}}"])
def test_a_loop_is_drawn(controller):
    result, pictures = drawn(controller)
    loop = result["bond_graph/sensitivity_functions/L"].data[:, 0]
    first = pictures["loop-nyquist"].table.rows[0]
    assert complex(*first[1:3]) == loop[0]
    assert "Closed: stable" in pictures["loop-nyquist"].caption
    assert ("with delays as they are" in pictures["loop-nyquist"].caption) == ("delay" in controller)
    assert "Ms" in pictures["sensitivity-functions"].caption
    locus = pictures["root-locus-loop-1"]
    assert ("with the delays as they are" in locus.caption) == ("delay" in controller)
    for gain, real, imaginary in locus.table.rows[:40]:
        if gain:
            s = complex(real, imaginary)
            own = gain * (2 * np.exp(-0.1 * s) if "delay" in controller else 2 + 5 / s)
            assert abs(0.5 * s + 0.2 + own) < 1e-9 * (abs(own) + 1)
    delay = float(result["bond_graph/margins/delay"].data[0])
    late = f"{delay:.4g} s" if np.isfinite(delay) else "∞"
    assert pictures["loop-bode"].caption.endswith(f", delay {late}.")
    assert f"delay margin {late}" in pictures["loop-bode"].picture("loop-bode", "").svg
    said = ["gain controller of ", "delay 0.1 s"] if "delay" in controller else ["PI controller of "]
    graph = next(figure.svg for figure in figures(result) if figure.name == "bond-graph")
    assert all(words in graph for words in said)
    assert np.isfinite(result["bond_graph/margins/Ms"].data).all()
    sections = {section.title: section for section in content(result).sections}
    (table,) = sections["Feedback loops"].blocks
    (row,) = table.rows
    shown = dict(zip(table.columns, row, strict=True))
    margin = float(result["bond_graph/margins/phase"].data[0])
    crossover = float(result["bond_graph/margins/gain_crossover"].data[0])
    assert shown["phase margin"] == f"{margin:.4g}° at {crossover:.4g} rad/s"
    assert shown["closed loop"] == "stable"
    assert (shown["gain margin"] == "∞") == ("delay" not in controller)
    assert sections["Feedback loops"].place == "answer"
    assert ("Poles with delays" in sections) == ("delay" in controller)


def test_an_unstable_loop_has_no_margins_and_no_peaks_on_the_page():
    """0.5 s^2 + 0.2 s - 2: one root is right of the axis; the largest |S| is stored all the same."""
    result, pictures = drawn("{pid: {ki: -2}}")
    assert np.isfinite(result["bond_graph/margins/Ms"].data).all()
    sections = {section.title: section for section in content(result).sections}
    table, note, verdict, *_ = sections["Feedback loops"].blocks
    assert table.rows == (("J.f -> u", *["not defined"] * 5, "unstable"),)
    assert note.text == "margins, Ms and Mt are not defined where the closed loop is not stable"
    assert verdict.whole.startswith("J.f -> u: unstable: pole at ")
    assert pictures["sensitivity-functions"].caption.endswith("J.f -> u: not defined (not stable).")


@pytest.mark.parametrize("controller", ["{gain: 0.01}", "{gain: 0.01, sample: 0.02}"])
def test_loci_of_lightly_damped_loops_have_no_corners(controller):
    """At a damping ratio of 1e-4 the wide grid has one frequency or none on the circle of the resonance."""
    more = "i: 1, z: 0, k: {type: C, value: 2e-3}, M: {type: I, value: 0.3}"
    text = SCENE.replace("nodes: {", f"nodes: {{{more}, ").replace("value: 0.2", "value: 0.03")
    text = text.replace("j -> J,", "j -> J, j -> z, z -> k, z -> i, i -> M,").replace(
        "CONTROLLER", controller
    )
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    (picture,) = (figure.draw() for figure in figures(result) if figure.name == "loop-nyquist")
    (curve,) = (layer for layer in picture.rows[0][0].layers if getattr(layer, "name", "") == "L")
    locus = np.asarray(curve.x) + 1j * np.asarray(curve.y)
    assert np.ptp(locus.imag) > 0.2
    turns = np.abs(np.angle(np.diff(locus)[1:] / np.diff(locus)[:-1]))
    assert turns.max() < np.deg2rad(15)
    assert len(locus) < 2000
