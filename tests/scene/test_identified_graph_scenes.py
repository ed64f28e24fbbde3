"""Scenes that identify bond graphs: what is said before a run, plans, screens, pages and faults."""

import re

import numpy as np
import pytest
import yaml

import dynid
from dynid.cli.screen import summary
from dynid.errors import FileError, SceneError
from dynid.identification.planning.plan import every_variable
from dynid.report.content import content
from dynid.report.figure import figures
from dynid.scene.batch import why_alone
from dynid.scene.explanation import explain
from dynid.scene.kinds.planning import run_plan
from dynid.scene.load import check_source
from dynid.scene.run import preparation_errors, run_scene
from dynid.scene.schema.base import aspects_of
from dynid.scene.yaml.source import parse_source
from dynid.study.executors import SerialExecutor
from dynid.study.run import run_study
from tests.bondgraph.graphs import build, parse
from tests.study.small import planned

DRIVE = """
dynid: 1
kind: identification
title: Drive
parameters:
  R: {start: 1, true: 2}
  J: {start: 0.02, true: 0.01}
  g: {start: 1, true: 1.2}
graph:
  nodes:
    U: Se
    circuit: 1
    R: {type: R, value: R}
    L: {type: I, value: 0.05, domain: electrical}
    motor: {type: GY, value: 0.1}
    rotor: 1
    J: {type: I, value: J, domain: rotational}
    b: {type: R, value: 1.0e-3}
  bonds: [U -> circuit -> motor -> rotor -> J, circuit -> L, circuit -> R, rotor -> b]
excitation: [{source: U, kind: multisine, amplitude: [6, 6], frequency: [2, 20]}]
measurement:
  step: 0.01
  samples: 400
  channels: [{output: L.f}, {output: J.f, gain: g}]
  simulate: {noise_ratio: 0.02, seed: 1, settle: 3}
identifiability: true
analysis: {inputs: [U], outputs: [J.f], results: [poles, zeros]}
"""


def scene(text=DRIVE, **changes):
    data = yaml.safe_load(text) | changes
    data = {key: value for key, value in data.items() if value is not None}
    return check_source(parse_source(yaml.safe_dump(data, sort_keys=False), "drive.yaml"))


def faults(**changes):
    with pytest.raises(SceneError) as raised:
        scene(**changes)
    return str(raised.value)


@pytest.fixture(scope="module")
def result():
    return run_scene(scene())


def test_a_graph_is_explained_with_the_bounds_of_the_run(result):
    explained = explain(scene())
    told = {fact.topic: fact.text for fact in explained.facts}
    assert explained.obstacle is None
    assert told["graph"] == "8 nodes, 7 bonds; 2 of 5 values depend on 3 unknowns"
    assert told["model"] == "2 states: L.f, J.f"
    assert told["record"].startswith("400 samples of 2 channels every 0.01 s")
    assert told["analysis"] == "poles, zeros"
    path = "identification/identifiability/relative_bound"
    np.testing.assert_allclose(explained.result[path].data, result[path].data, rtol=1e-9)


def test_a_graph_from_frequency_responses_is_explained():
    channels = [{"output": "J.f", "reference": {"source": "U"}}]
    frf = {"simulate": {"lines": {"start": 1, "stop": 50, "points": 40}, "noise_ratio": 0.01}}
    measured = scene(excitation=None, measurement={"channels": channels, "frf": frf}, parameters={
        "R": {"start": 1, "true": 2}, "J": {"start": 0.02, "true": 0.01}})  # fmt: skip
    told = {fact.topic: fact.text for fact in explain(measured).facts}
    assert "80 real values" in told["record"]
    found = run_scene(measured)
    np.testing.assert_allclose(found["identification/parameters/estimate"].data, [2, 0.01], rtol=0.02)
    assert "frequency responses" in summary(found, "")


def test_frequency_responses_of_a_graph_are_referred_to_a_source():
    channels = [{"output": "J.f", "reference": {"source": "u"}}]
    said = faults(measurement={"channels": channels, "frf": {"file": {"path": "a.h5"}}}, excitation=None)
    assert "'u' is no source (Se, Sf); did you mean 'U'?" in said


def test_measured_frequency_responses_of_a_graph_are_read_from_a_file(tmp_path):
    R, L, J, k, b = 2.0, 0.05, 0.01, 0.1, 1e-3
    hertz = np.geomspace(0.2, 10, 60)
    s = 2j * np.pi * hertz
    H = k / ((L * s + R) * (J * s + b) + k**2)
    noise = np.random.default_rng(1).standard_normal((2, 60)) * 1e-3 * np.abs(H)
    H = H + noise[0] + 1j * noise[1]
    rows = [",".join(map(repr, row)) for row in np.column_stack([hertz, H.real, H.imag]).tolist()]
    (tmp_path / "h.csv").write_text("\n".join(["f,re,im", *rows]))
    file = {"path": str(tmp_path / "h.csv"), "frequency": "f", "columns": [["re", "im"]]}
    measurement = {
        "channels": [{"output": "J.f", "reference": {"source": "U"}}],
        "frf": {"file": file, "unit": "Hz"},
    }
    parameters = {"R": {"start": 1}, "J": {"start": 0.02}}
    found = run_scene(scene(excitation=None, measurement=measurement, parameters=parameters))
    np.testing.assert_allclose(found["identification/parameters/estimate"].data, [2, 0.01], rtol=5e-3)
    assert found.value("identification/diagnostics/converged")


def test_candidates_are_efforts_and_flows_each_once():
    types, values, pairs = parse(
        "Se U, 1 a, I L 1, R r 1, 0 z, C k 1, 1 b, I m 1", "U -> a -> L, a -> r, a -> z -> k, z -> b -> m"
    )
    names = [str(port) for port in every_variable(build(types, values, pairs))]
    # The flow of L is that of the junction a, the effort of k that of z, the flow of m that of b.
    assert names == ["L.e", "L.f", "k.e", "k.f", "m.e", "m.f"]


def test_sensors_and_sources_of_a_graph_are_planned():
    plan = run_plan(scene())
    candidates = list(plan["plan/sensors/candidate"].data)
    assert sorted(candidates) == ["J.e", "J.f", "L.e", "L.f"]
    assert set(plan["plan/excitation/choice_dof"].data) == {"U"}
    assert plan["plan/excitation/amplitude"].units == "V"
    present = plan["plan/sensors/present_bound"].data
    np.testing.assert_allclose(present, plan["identification/identifiability/relative_bound"].data, rtol=1e-6)
    screen = summary(plan, "")
    assert "the present sources" in screen or "no better sources" in screen
    assert " N " not in screen
    assert all(len(line) <= 140 for line in screen.splitlines())


def test_the_bound_of_the_best_sines_is_that_of_the_record_that_they_make():
    plan = run_plan(scene(), lines=2)
    amplitude = float(plan["plan/excitation/amplitude"].data)
    omega = plan["plan/excitation/choice_omega"].data.tolist()
    sines = [{"source": "U", "kind": "multisine", "amplitude": [amplitude] * 2, "frequency": omega}]
    measurement = yaml.safe_load(DRIVE)["measurement"]
    levels = plan["identification/identifiability/noise/deviation"].data.tolist()
    measurement["simulate"] = {
        "noise": levels,
        "seed": 1,
        "settle": 43,
    }  # whole periods more: the same phases
    made = explain(scene(excitation=sines, measurement=measurement)).result
    bound = made["identification/identifiability/relative_bound"].data
    np.testing.assert_allclose(plan["plan/excitation/best_bound"].data, bound, rtol=1e-4)


def test_candidates_of_a_plan_are_listed():
    plan = run_plan(scene(plan={"candidates": [{"output": "rotor.q"}], "excitation": {"sources": ["U"]}}))
    assert sorted(plan["plan/sensors/candidate"].data) == ["J.f", "L.f", "rotor.q"]


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        ({"quantities": ["velocity"]}, "a graph has efforts and flows"),
        ({"noise": {"velocity": 0.1}}, "leave 'noise' out"),
        ({"excitation": {"dofs": [1]}}, "a graph has sources; write 'sources'"),
    ],
)
def test_keys_of_structures_in_a_plan_are_refused(plan, said):
    assert said in faults(plan=plan)


def test_the_screen_has_parameters_bounds_modes_and_the_graph(result):
    screen = summary(result, "")
    assert "2 physical states, 3 unknown parameters" in screen
    assert "modal sensitivities per +1 % of each parameter" in screen
    heading = next(line for line in screen.splitlines() if line.split()[:1] == ["mode"])
    assert heading.split()[3:] == ["R", "J"]  # a gain moves no pole
    assert re.search(r"poles +-", screen)
    assert screen.count("left out:") == 1
    assert "left out: 3 of 5 values: L, motor, b (" in " ".join(screen.split())
    assert "estimation methods" not in screen
    assert "3 of 5 values: L, motor, b" in summary(result, "", trace=True)
    assert all(len(line) <= 140 for line in screen.splitlines() if "warning" not in line)


def test_elements_are_counted_once(result):
    parts = list(result["identification/need/part"].data)
    assert parts.count("elements") == 1
    assert len(parts) == len(set(parts))
    assert "bond_graph/need/part" not in result


def test_changes_of_modes_are_those_of_the_poles(result):
    group = "identification/identifiability/modal_sensitivity"
    names = list(result[f"{group}/parameter"].data)

    def sizes(R, J):
        A = np.array([[-R / 0.05, -0.1 / 0.05], [0.1 / J, -1e-3 / J]])
        return np.sort(np.abs(np.linalg.eigvals(A)))

    h = 1e-6
    by_R = (sizes(2 + h, 0.01) - sizes(2 - h, 0.01)) / (2 * h)
    by_J = (sizes(2, 0.01 + 1e-3 * h) - sizes(2, 0.01 - 1e-3 * h)) / (2e-3 * h)
    found = result[f"{group}/omega_by_parameter"].data
    np.testing.assert_allclose(found[:, names.index("R")], by_R, rtol=1e-6)
    np.testing.assert_allclose(found[:, names.index("J")], by_J, rtol=1e-6)
    np.testing.assert_array_equal(found[:, names.index("g")], 0)


def test_a_page_draws_the_graph_and_shows_its_results(result):
    names = [figure.name for figure in figures(result)]
    assert "bond-graph" in names
    assert "structure" not in names
    for figure in figures(result):
        figure.draw()
    titles = [section.title for section in content(result).sections]
    assert "Graph" in titles
    assert titles.count("Model scope") == 1


def test_without_an_analysis_the_measured_graph_is_drawn():
    found = run_scene(scene(analysis=None, identifiability=None))
    figure = next(figure for figure in figures(found) if figure.name == "bond-graph")
    assert "rotor" in figure.draw().svg


def test_parameters_that_may_be_negative_have_symmetric_intervals():
    parameters = yaml.safe_load(DRIVE)["parameters"] | {"z": {"start": 0.1, "true": -0.3, "scale": "linear"}}
    measurement = yaml.safe_load(DRIVE)["measurement"]
    measurement["channels"][0]["offset"] = "z"
    found = run_scene(scene(parameters=parameters, measurement=measurement, analysis=None))
    line = next(line for line in summary(found, "").splitlines() if line.split()[:1] == ["z"])
    low, high = (float(text.replace(" ", "")) for text in re.search(r"(-[\d.]+) … (-[\d.]+)", line).groups())
    group = "identification/parameters"
    place = list(found[f"{group}/name"].data).index("z")
    estimate, error = (float(found[f"{group}/{name}"].data[place]) for name in ("estimate", "standard_error"))
    assert (low, high) == pytest.approx((estimate - 1.96 * error, estimate + 1.96 * error), abs=0.02 * error)


def test_samples_of_a_study_are_those_run_alone(tmp_path):
    (tmp_path / "drive.yaml").write_text(DRIVE)
    assert "one by one" in why_alone(scene(), ("measurement.simulate.seed",), ())
    study = {
        "dynid": 1, "kind": "study", "scene": "drive.yaml",
        "vary": {"measurement.simulate.seed": {"values": [1, 2]}},
        "sampling": {"method": "grid"}, "collect": ["identification/parameters/estimate"],
    }  # fmt: skip
    run_study(planned(tmp_path, yaml.safe_dump(study)), tmp_path / "s.h5", SerialExecutor())
    found = dynid.open_result(tmp_path / "s.h5")
    for place, seed in enumerate((1, 2)):
        measurement = yaml.safe_load(DRIVE)["measurement"]
        measurement["simulate"]["seed"] = seed
        alone = run_scene(scene(measurement=measurement))["identification/parameters/estimate"].data
        np.testing.assert_allclose(
            found["study/results/identification/parameters/estimate"].data[place], alone, rtol=1e-12
        )


@pytest.mark.thorough
def test_alternatives_of_a_graph_are_estimators_and_holds():
    assert aspects_of(scene().model) == ["estimator"]
    small = {"alternatives": {"estimator": ["output-error"]}, "budget": 20, "repeats": 1}
    measured = yaml.safe_load(DRIVE)["measurement"] | {"samples": 100}
    found = dynid.run(
        scene(accuracy=small, identifiability=None, analysis=None, measurement=measured, derived=[])
    )
    assert set(found["accuracy/estimator/alternative"].data) == {"auto", "output-error"}
    assert "a record of a structure is" in faults(accuracy={"alternatives": {"basis": "all"}})


def test_the_step_response_of_an_identified_graph_has_alternatives():
    analysis = {"outputs": ["J.f"], "results": ["time_response"], "time": {"stop": 1, "step": 0.01}}
    assert "propagation" in aspects_of(scene(analysis=analysis).model)


def test_frequency_responses_tell_what_they_identify_without_an_analysis():
    channels = [{"output": "J.f", "reference": {"source": "U"}}]
    frf = {"simulate": {"lines": {"start": 1, "stop": 50, "points": 40}, "noise_ratio": 0.01}}
    parameters = {"R": {"start": 1, "true": 2}, "J": {"start": 0.02, "true": 0.01}}
    measured = {"channels": channels, "frf": frf}
    asked = scene(excitation=None, measurement=measured, parameters=parameters, analysis=None)
    explained = explain(asked)
    assert "analysis" not in {fact.topic for fact in explained.facts}
    path = "identification/identifiability/relative_bound"
    found = run_scene(asked)
    np.testing.assert_allclose(explained.result[path].data, found[path].data, rtol=1e-9)
    plain = run_scene(
        scene(
            excitation=None, measurement=measured, parameters=parameters, analysis=None, identifiability=None
        )
    )
    assert path not in plain


def test_a_graph_without_a_record_has_the_analysis_of_the_true_values():
    unmeasured = scene(
        measurement=None,
        identifiability=None,
        parameters={"R": {"start": 1, "true": 2}, "J": {"start": 0.02, "true": 0.01}},
    )
    told = {fact.topic: fact.text for fact in explain(unmeasured).facts}
    assert told.keys() == {"graph", "analysis"}
    A = np.array([[-2 / 0.05, -0.1 / 0.05], [0.1 / 0.01, -1e-3 / 0.01]])
    found = run_scene(unmeasured)
    poles = found["bond_graph/transfer_function/J.f/U/poles"].data
    np.testing.assert_allclose(np.sort(poles.real), np.sort(np.linalg.eigvals(A).real), rtol=1e-12)
    assert "identification/parameters/estimate" not in found


def test_sensitivities_of_an_identified_graph_are_by_its_values():
    asked = {"inputs": ["U"], "outputs": ["J.f"], "results": ["sensitivities"]}
    found = run_scene(scene(analysis=asked, identifiability=None))
    names = list(found["bond_graph/sensitivities/J.f/U/parameter"].data)
    R = found["identification/parameters/estimate"].data[0]
    by = found["bond_graph/sensitivities/J.f/U/dc_gain_sensitivity"].data
    assert sorted(names) == ["J", "L", "R", "b", "motor"]
    # The gain is k / (R b + k^2).
    assert by[names.index("R")] == pytest.approx(-0.1 * 1e-3 / (R * 1e-3 + 0.01) ** 2, rel=1e-12)
    assert by[names.index("J")] == 0


def test_what_a_record_cannot_tell_is_said_before_the_run():
    text = DRIVE.replace("start: 1, true: 2}", "start: 1, true: 2}\n  S: {start: 1, true: 1}")
    changed = scene(text.replace("{type: R, value: R}", "{type: R, value: R*S}"))
    told = explain(changed)
    assert told.obstacle is None
    group = "identification/identifiability"
    flags = dict(
        zip(told.result[f"{group}/parameter"].data, told.result[f"{group}/identifiable"].data, strict=True)
    )
    assert not flags["R"]
    assert not flags["S"]
    result = run_scene(changed)
    assert result.value("identification/parameters/identifiable").tolist() == list(flags.values())
    assert any(
        "R, S cannot be distinguished" in text for text in result.value("identification/diagnostics/warnings")
    )


@pytest.mark.parametrize("frf", [False, True])
def test_a_missing_record_is_found_before_anything_is_computed(frf):
    channel = {"output": "J.f"} | ({"reference": {"source": "U"}} if frf else {})
    file = {"file": {"path": "no.csv"}}
    record = {"frf": file | {"unit": "Hz"}} if frf else {"step": 0.01, "samples": 40} | file
    changes = {"excitation": None} if frf else {}
    parameters = {"R": {"start": 1}, "J": {"start": 0.02}}
    asked = scene(measurement={"channels": [channel]} | record, parameters=parameters, **changes)
    (error,) = preparation_errors(asked)
    assert isinstance(error, FileError)
    assert "no.csv" in str(error)


def test_nothing_is_wrong_before_a_run_of_any_question():
    analysis = {"analysis": None, "identifiability": None}
    record = {"measurement": None, "identifiability": None, "parameters": {"R": 1, "J": {"start": 0.02}}}
    for changes in ({}, analysis, record):
        assert preparation_errors(scene(**changes)) == []


def test_responses_are_derived_at_the_frequencies_of_the_analysis():
    asked = {"outputs": ["J.f"], "results": ["poles"], "frequency": {"start": 1, "stop": 9, "points": 5}}
    found = run_scene(scene(derived=["frequency_response"], analysis=asked, identifiability=None))
    group = "identification/derived/frequency_response/L.f/U/magnitude"
    R, J, _ = found["identification/parameters/estimate"].data
    s = 1j * np.geomspace(1, 9, 5)
    expected = np.abs((J * s + 1e-3) / ((0.05 * s + R) * (J * s + 1e-3) + 0.01))
    np.testing.assert_allclose(found[f"{group}/omega"].data, s.imag, rtol=1e-12)
    np.testing.assert_allclose(found[f"{group}/value"].data, expected, rtol=1e-9)


def test_a_sensor_in_a_graph_has_no_mass():
    with pytest.raises(SceneError, match="the 'mass' of a sensor is at the one 'dof' that it measures"):
        scene(DRIVE.replace("{output: L.f}", "{output: L.f, mass: 1}"))
