"""Designs in scenes: results of the designed graph, exported scenes, sub-models, controllers, faults."""

from math import pi
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError, Unreachable
from dynid.report.scenes import scene_of
from dynid.scene.identified import designed_scene_text, holds_design
from dynid.scene.load import check_source
from dynid.scene.run import preparation_errors
from dynid.scene.yaml.source import parse_source

ROOT = Path(__file__).parents[2]

SCENE = """
dynid: 1
kind: bond-graph
parameters:
  m: 2
  c: {start: 1, min: 0.1}
  k: 8
  twice: 2*m
  spare: 1
graph:
  nodes:
    F: Se
    j: 1
    m: {type: I, value: m}
    c: {type: R, value: c}
    k: {type: C, value: 1/k}
  bonds: [F -> j -> m, j -> c, j -> k]
design:
  free: {c: }
  targets: [{pole: {frequency: 2, damping: 0.25}}]
analysis:
  outputs: [k.q]
"""


def scene(text=SCENE, **changes):
    for old, new in changes.items():
        text = text.replace({"free": "{c: }", "targets": "[{pole: {frequency: 2, damping: 0.25}}]"}[old], new)
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


def faults(text=SCENE, **changes):
    with pytest.raises(SceneError) as error:
        scene(text, **changes)
    return [str(fault) for fault in error.value.faults]


def test_all_results_are_those_of_the_designed_graph():
    result = dynid.run(scene())
    group = "bond_graph/design"
    assert result[f"{group}/value"].data == pytest.approx([2.0], rel=1e-13)
    assert result[f"{group}/start"].data.tolist() == [1.0]
    assert (result[f"{group}/min"].data.tolist(), result[f"{group}/max"].data.tolist()) == ([0.1], [np.inf])
    poles = result["bond_graph/transfer_function/k.q/F/poles"].data
    assert sorted(poles.imag) == pytest.approx([-np.sqrt(3.75), np.sqrt(3.75)], rel=1e-13)
    assert poles.real == pytest.approx([-0.5, -0.5], rel=1e-13)
    assert result[f"{group}/targets/reached"].data == pytest.approx([2.0], rel=1e-14)
    assert result[f"{group}/targets/start_damping"].data == pytest.approx([0.125], rel=1e-14)
    assert result.value(f"{group}/met") is True
    assert scene_of(result).source.data["parameters"]["c"] == result[f"{group}/value"].data[0]


@pytest.mark.parametrize("target", ["pole: {frequency: 0.5, unit: Hz}", "pole: 0.5, unit: Hz"])
def test_hertz_stand_beside_a_frequency_or_beside_a_root(target):
    result = dynid.run(scene(free="{k: }", targets=f"[{{{target}}}]"))
    assert result["bond_graph/design/value"].data == pytest.approx([2 * np.pi**2], rel=1e-13)


def test_the_designed_scene_has_the_designed_values():
    result = dynid.run(ROOT / "configs/isolator_design.yaml")
    assert holds_design(result)
    text = designed_scene_text(result)
    assert "# motion of the base" in text  # comments stay
    assert "design:" not in text
    again = dynid.run(check_source(parse_source(text)))
    zeros = again["bond_graph/transfer_function/m_s.f/v_in/zeros"].data
    assert zeros == pytest.approx([-19j * pi, 19j * pi], rel=1e-13)
    assert again["bond_graph/frequency_response/response"].data == pytest.approx(
        result["bond_graph/frequency_response/response"].data
    )
    (kept,) = parse_source(text).data["expect"]  # those of the design are left out
    assert kept["path"].startswith("bond_graph/properties/")


def test_a_scene_without_its_text_is_not_exported():
    result = dynid.run(scene())
    result.attrs["scene"] = ""
    with pytest.raises(dynid.errors.UsageError, match="holds no scene"):
        designed_scene_text(result)


NESTED = """
dynid: 1
kind: bond-graph
models:
  body:
    ports: [p]
    parameters: {m: 2, c: 1, k: 8}
    nodes: {p: 1, m: {type: I, value: m}, c: {type: R, value: c}, k: {type: C, value: 1/k}}
    bonds: [p -> m, p -> c, p -> k]
graph:
  nodes:
    F: Se
    one: {model: body, c: 3}
  bonds: [F -> one.p]
design:
  free: {NAME: {}}
  targets: [{pole: {frequency: 2, damping: 0.25}}]
analysis:
  outputs: [one.k.q]
expect:
  - {path: bond_graph/design/met, value: true}
"""


@pytest.mark.parametrize("name", ["one.c", "one.k"])
def test_parameters_of_sub_models_are_free(name):
    target = "{frequency: 2, damping: 0.25}" if name == "one.c" else "{frequency: 3, damping: 0.25}"
    result = dynid.run(scene(NESTED.replace("NAME", name).replace("{frequency: 2, damping: 0.25}", target)))
    expected = 2.0 if name == "one.c" else 18.0  # with c = 3, zeta = c/(2 m w) = 0.25
    assert result["bond_graph/design/value"].data == pytest.approx([expected], rel=1e-13)
    text = designed_scene_text(result)
    again = dynid.run(check_source(parse_source(text)))
    roots = again["bond_graph/transfer_function/one.k.q/F/poles"].data
    assert abs(roots) == pytest.approx([2.0 if name == "one.c" else 3.0] * 2, rel=1e-13)


def test_gains_of_controllers_are_free():
    control = (
        "control: {loops: [{from: k.q, to: F, controller: {pid: {kp: kp, kd: kd, tf: 0.01}}, reference: r}]}"
    )
    text = SCENE.replace("design:", f"{control}\ndesign:").replace("  spare: 1", "  kp: 5\n  kd: 1")
    result = dynid.run(scene(text, free="{kp: , kd: }", targets="[{pole: {frequency: 4, damping: 0.7}}]"))
    kp, kd = result["bond_graph/design/value"].data
    s = 4 * (-0.7 + 1j * np.sqrt(0.51))
    assert abs(2 * s**2 + s + 8 + kp + kd * s / (0.01 * s + 1)) < 1e-12 * kp


@pytest.mark.thorough
def test_minima_are_reported_with_others_beside():
    result = dynid.run(ROOT / "configs/absorber_design.yaml")
    group = "bond_graph/design"
    assert result[f"{group}/value"].data == pytest.approx([0.909058, 0.168603], abs=1e-6)
    assert result.value(f"{group}/objective") == pytest.approx(4.58917, abs=1e-5)
    assert result[f"{group}/compared/value"].data[0] == pytest.approx([0.909091, 0.167852], abs=1e-6)
    assert result[f"{group}/compared/reached"].data[0] == pytest.approx([4.59022], abs=1e-5)
    assert result.value(f"{group}/active_maxima") == 2
    assert result[f"{group}/optima/count"].data.sum() == result.group_attrs[group]["ended"]
    assert "bond_graph/design/warnings" not in result


def test_a_peak_is_that_in_the_band_of_the_analysis():
    grid = "outputs: [k.q]\n  frequency: {start: 0.1, stop: 1, points: 50}"
    text = SCENE.replace("outputs: [k.q]", grid)
    found = [dynid.run(scene(text, free="{k: {min: 4, max: 9}}", targets=targets)) for targets in (
        "[{minimise: peak}]", "[{minimise: peak, band: [0.1, 1]}]", "[{minimise: peak, band: [1, 3]}]"
    )]  # fmt: skip
    one, same, other = (result.value("bond_graph/design/objective") for result in found)
    assert one == same != other
    assert found[0]["bond_graph/frequency_peaks/magnitude"].data.item() == pytest.approx(one, rel=1e-10)


def test_what_is_unreachable_is_located():
    made = scene(targets="[{pole: {frequency: 3, damping: 0.25}}]")
    with pytest.raises(Unreachable) as error:
        dynid.run(made)
    assert str(made.locate(error.value)).startswith(
        f"{H}the pole of k.q/F at 3 rad/s with damping ratio 0.25 cannot be reached: the natural "
        "frequency of this pole does not depend on c; the nearest that is reached is 2 rad/s"
    )
    assert error.value.exit_code == 3
    assert preparation_errors(made) == []


H = "scene.yaml:19:13: "
FAULTS = {
    "scene.yaml:18:10: no parameter 'g'": {"free": "{g: }"},
    "scene.yaml:18:10: no parameter 'j'; 'j' is a node: name its value in 'parameters', and free that": {
        "free": "{j: }"
    },
    "scene.yaml:18:10: 'twice' is computed from m; free these, or write a number for it": {
        "free": "{twice: }"
    },
    "scene.yaml:18:10: nothing in the graph depends on this parameter; use it in a value, or do not free "
    "it": {"free": "{spare: }"},
    "scene.yaml:18:10: the parameter c starts outside its limits": {"free": "{c: 0.01}"},
    "scene.yaml:18:10: the parameter m starts outside its limits": {"free": "{m: {min: 3}}"},
    "scene.yaml:18:13: 'min' is not below 'max'": {"free": "{m: {min: 3, max: 1}}"},
    "scene.yaml:18:13: 'start' does not lie between 'min' and 'max'": {"free": "{m: {start: 3, max: 1}}"},
    "scene.yaml:18:13: 'start' is -3; with 'scale: log' the parameter is positive: write 'scale: linear' "
    "where zero or negative values are possible": {"free": "{m: {start: -3, scale: log}}"},
    "scene.yaml:18:9: 'free' is empty": {"free": "{}"},
    "scene.yaml:18:9: 'free' must be a mapping, not a list": {"free": "[c]"},
    "scene.yaml:19:12: 'targets' is empty": {"targets": "[]"},
    f"{H}a target is one of {{zero: …}}, {{pole: …}}, {{minimise: peak | h2 | hinf}}, {{phase_margin: …}}, "
    "{gain_margin: …}, {Ms: …}, {Mt: …}, {maximise: …}": {"targets": "[{zero: 1, pole: 2}]"},
    "scene.yaml:19:20: a damping ratio lies between -1 and 1, not at 2; two real roots are two targets of "
    "damping 1": {"targets": "[{zero: {frequency: 1, damping: 2}}]"},
    f"{H}'band' belongs to 'minimise: peak'; the other norms are over all frequencies": {
        "targets": "[{minimise: h2, band: [1, 2]}]"
    },
    "scene.yaml:19:36: a band is [low, high], and low is not below high": {
        "targets": "[{minimise: peak, band: [2, 1]}]"
    },
    f"{H}'weight' belongs to norms to minimise; zeros and poles are met exactly": {
        "targets": "[{pole: 1, weight: 2}]"
    },
    "scene.yaml:20:21: 'm' is not free; values to compare are those of free parameters": {
        "targets": "[{minimise: h2}]\n  compare: {other: {m: 1}}"
    },
    "scene.yaml:20:21: no parameter 'x'": {"targets": "[{minimise: h2}]\n  compare: {other: {x: 1}}"},
}


@pytest.mark.parametrize("message", FAULTS)
def test_faults_are_located(message):
    assert faults(**FAULTS[message]) == [message]


def test_a_channel_is_named_where_there_are_several():
    text = SCENE.replace("outputs: [k.q]", "outputs: [k.q, m.f]")
    assert faults(text) == [H + "the target needs an 'output'; the analysis has several: k.q, m.f"]
    named = scene(text, targets="[{pole: {frequency: 2, damping: 0.25}, output: m.f}]")
    assert dynid.run(named)["bond_graph/design/targets/output"].data.tolist() == ["m.f"]
    text = SCENE.replace("F: Se", "F: Se\n    G: Se").replace("[F ->", "[G -> j, F ->")
    assert faults(text)[0].endswith("the target needs an 'input'; the analysis has several: F, G")


def test_faults_of_parameters_are_reported_once():
    (fault,) = faults(SCENE.replace("m: 2\n", "m: 2*\n"), free="{m: }")
    assert fault.startswith("scene.yaml:4:6: ")


@pytest.mark.parametrize("mass", ["1e-170", "1e-300"])
def test_a_design_whose_equations_overflow_is_refused(mass):
    text = SCENE.replace("{type: I, value: m}", f"{{type: I, value: {mass}}}")
    with pytest.raises(Unreachable, match=r"the state equations reach \S+; a design takes up to 1e\+150"):
        dynid.run(scene(text))


@pytest.mark.parametrize("count", [51, 300])
def test_too_many_free_parameters_are_counted(count):
    free = ", ".join(f"p{k}: {{start: 1}}" for k in range(count))
    text = SCENE.replace("free: {c: }", f"free: {{{free}}}")
    assert any(f"'free' has {count} entries; it takes at most 50" in fault for fault in faults(text))


def test_graphs_with_laws_are_not_designed():
    text = SCENE.replace("c: {type: R, value: c}", 'c: {type: R, law: {e: "c*f*abs(f)"}}')
    message = "a design is of a linear graph, and 'c' has a law; write the slope at its point as a value"
    assert faults(text) == [f"scene.yaml:17:1: {message}"]


def test_a_free_parameter_may_be_written_as_arithmetic():
    plain = dynid.run(scene(SCENE.replace("c: {start: 1, min: 0.1}", "c: 1")))
    result = dynid.run(scene(SCENE.replace("c: {start: 1, min: 0.1}", 'c: "3/4 + 1/4"')))
    assert result["bond_graph/design/start"].data.tolist() == [1.0]
    assert result["bond_graph/design/value"].data == plain["bond_graph/design/value"].data
    assert result["bond_graph/design/value"].data == pytest.approx([2.0], rel=1e-13)


def test_graphs_with_delays_are_not_designed():
    loop = "{from: k.q, to: F, controller: {gain: 1, delay: 0.1}, reference: r}"
    text = SCENE.replace("design:", f"control: {{loops: [{loop}]}}\ndesign:")
    message = (
        "only margins (phase_margin, gain_margin, Ms, Mt) are designed with a delay in a loop; write it "
    )
    message += "as {numerator: …, denominator: …}"
    assert faults(text) == [f"scene.yaml:17:60: {message}"]


def test_numbers_that_cannot_depend_on_parameters_are_located():
    beam = "structure: {beam: {elements: 2, length: 1, EI: 1, rhoA: 1}}"
    reduction = "reduction: {method: craig-bampton, masters: [1], modes: {below: e}}"
    node = f"s: {{type: structure, {beam}, {reduction}, ports: {{tip: 1}}}}"
    text = SCENE.replace("k: {type: C, value: 1/k}", f"k: {{type: C, value: 1/k}}\n    {node}")
    text = text.replace("j -> k]", "j -> k, j -> s.tip]").replace("  spare: 1", "  e: 200")
    (fault,) = faults(text, free="{e: }")
    assert fault.startswith("scene.yaml:16:")
    assert "this depends on 'e'" in fault


def test_every_sample_of_a_study_is_designed():
    from dynid.scene.batch import why_alone

    made = scene()
    assert why_alone(made, ["parameters.m"], ()) == "every sample is designed by itself"


def test_expectations_of_a_design_that_fill_lines_are_left_out():
    text = SCENE + "expect:\n  - {path: bond_graph/design/met,\n     value: true}\n"
    text += "  - {path: bond_graph/properties/k.q/F/stable, value: true}\n"
    made = designed_scene_text(dynid.run(scene(text)))
    (kept,) = parse_source(made).data["expect"]
    assert kept["path"] == "bond_graph/properties/k.q/F/stable"


def test_the_screen_and_the_page_show_the_design():
    from dynid.cli.screen import summary
    from dynid.report.content.design import design_sections
    from dynid.report.figure import figures

    compared = (
        "[{zero: {frequency: 1.2, damping: 0.3}}, {minimise: h2}]\n  compare: {other: {f: 1, zeta: 0.1}}"
    )
    text = (ROOT / "configs/absorber_design.yaml").read_text().partition("\nexpect:")[0]
    text = text.replace("zeta: {start: 0.2, min: 0.01, max: 1}", "zeta: {max: 0.36}")
    start, _, rest = text.partition("    - {minimise: hinf}")
    result = dynid.run(
        scene(start.replace("targets:", f"targets: {compared}") + "\n" + rest.partition("3))}\n")[2])
    )
    screen = summary(result, "")
    assert "zero of K.q / F, rad/s, ζ  1.2, 0.3" in screen
    assert "zeta    0.2      0.36    0.1" in screen
    (section,) = design_sections(result)
    assert section.title == "Design"
    drawn = next(figure for figure in figures(result) if figure.name == "design")
    assert "Frequency response of K.q/F at the start" in drawn.draw().caption
