"""The response of a graph with several sources, without any signal: to a unit step of each of them alone."""

import numpy as np
import pytest
from scipy.linalg import expm

import dynid
from dynid import open_result
from dynid.checks import check_expectations, compare
from dynid.cli.screen import section_lines
from dynid.report.content.responses import response_sections
from dynid.report.figure import figures
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

MASS, COMPLIANCE, DAMPING, RESISTANCE = 2.0, 0.5, 1.5, 3.0
GRAPH = f"""
dynid: 1
kind: bond-graph
graph:
  nodes: {{F: Se, V: Sf, x: 1, z: 0, m: {{type: I, value: {MASS}}}, k: {{type: C, value: {COMPLIANCE}}},
          b: {{type: R, value: {DAMPING}}}, r: {{type: R, value: {RESISTANCE}}}}}
  bonds: [F -> x, x -> m, x -> b, V -> z, z -> k, z -> r, z -> x]
analysis: {{outputs: [m.f, k.e], results: [time_response], time: {{stop: 3, step: 0.1}}}}
"""
TIME = "bond_graph/time_response"


def run(text=GRAPH):
    return dynid.run(check_source(parse_source(text.lstrip("\n"), "scene.yaml")))


def exact():
    """Return the step responses (time x output x source) by the matrix exponential of the state equations.

    States: the momentum p of the mass and the charge q of the spring; dp/dt = F + q/C - b p/m,
    dq/dt = V - q/(C r) - p/m.
    """
    A = np.array([[-DAMPING / MASS, 1 / COMPLIANCE], [-1 / MASS, -1 / (COMPLIANCE * RESISTANCE)]])
    C = np.diag([1 / MASS, 1 / COMPLIANCE])
    times = 0.1 * np.arange(31)
    return np.array([C @ np.linalg.solve(A, expm(A * t) - np.eye(2)) for t in times])


def test_each_source_is_stepped_alone():
    result = run()
    assert result[f"{TIME}/response"].dims == ("time", "output", "source")
    np.testing.assert_allclose(result[f"{TIME}/response"].data, exact(), rtol=1e-12, atol=1e-14)
    assert list(result[f"{TIME}/source"].data) == ["F", "V"]
    np.testing.assert_array_equal(result[f"{TIME}/input"].data, np.ones((31, 2)))


@pytest.mark.parametrize("inputs", [["V", "F"], ["F", "V"]])
def test_sources_stand_in_the_order_of_the_inputs(inputs):
    result = run(GRAPH.replace("outputs:", f"inputs: [{', '.join(inputs)}], outputs:"))
    order = list(result[f"{TIME}/source"].data)
    expected = exact()[..., [["F", "V"].index(name) for name in order]]
    np.testing.assert_allclose(result[f"{TIME}/response"].data, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("source", ["F", "V"])
def test_one_source_has_responses_by_output_alone(source):
    result = run(GRAPH.replace("outputs:", f"inputs: [{source}], outputs:"))
    assert result[f"{TIME}/response"].dims == ("time", "output")
    expected = exact()[..., ["F", "V"].index(source)]
    np.testing.assert_allclose(result[f"{TIME}/response"].data, expected, rtol=1e-12, atol=1e-14)


def test_signals_that_are_written_add_up():
    result = run(GRAPH.replace("step: 0.1}", "step: 0.1, input: {kind: step}}"))
    assert result[f"{TIME}/response"].dims == ("time", "output")
    np.testing.assert_allclose(result[f"{TIME}/response"].data, exact().sum(axis=2), rtol=1e-12, atol=1e-14)


def test_stored_energy_without_signals_is_a_free_response():
    result = run(f"{GRAPH}initial: {{m: {{f: 1}}}}\n")
    assert result[f"{TIME}/response"].dims == ("time", "output")
    assert not result[f"{TIME}/input"].data.any()


def test_each_response_is_printed_drawn_expected_and_compared():
    result = run()
    lines = "\n".join(section_lines(response_sections(result, "bond_graph")))
    assert "to F, V, each alone, 0 … 3 s" in lines
    largest = exact().max(axis=0)
    for k, output in enumerate(("m.f", "k.e")):
        for m, source in enumerate(("F", "V")):
            assert f"\n    {output} to {source} " in lines
            demand = {"path": f"{TIME}/response", "at": {"output": output, "source": source}}
            (outcome,) = check_expectations(result, [{**demand, "max": largest[k, m] + 1e-9}])
            assert outcome.passed
            (outcome,) = check_expectations(result, [{**demand, "max": largest[k, m] - 1e-3}])
            assert not outcome.passed
    (section,) = [part for part in response_sections(result, "bond_graph") if part.title == "Time response"]
    assert [row[0] for row in section.blocks[0].rows] == ["m.f to F", "m.f to V", "k.e to F", "k.e to V"]
    (figure,) = [each for each in figures(result) if each.name == "time-response"]
    assert "m.f to V" in figure.svg
    assert compare(result, result) == []
    frame = result.to_pandas(TIME)
    np.testing.assert_array_equal(frame["response[k.e,V]"], result[f"{TIME}/response"].data[:, 1, 1])
    assert result.to_xarray(TIME).response.sel(output="m.f", source="F").dims == ("time",)


LAW = GRAPH.replace(f"type: R, value: {DAMPING}", 'type: R, law: {e: "1.5*f + 0.1*f**3"}')


@pytest.mark.thorough
def test_nonlinear_responses_are_those_to_each_source_alone():
    together = run(LAW)
    assert together[f"{TIME}/nonlinear"].dims == ("time", "output", "source")
    assert together[f"{TIME}/nonlinear_deviation"].dims == ("output", "source")
    for place, source in enumerate(("F", "V")):
        alone = run(LAW.replace("step: 0.1}", f"step: 0.1, input: {{kind: step, source: {source}}}}}"))
        np.testing.assert_array_equal(
            together[f"{TIME}/nonlinear"].data[..., place], alone[f"{TIME}/nonlinear"].data
        )
    assert f"m.f to {source}" in "\n".join(section_lines(response_sections(together, "bond_graph")))


def test_samples_of_a_study_have_each_source_alone(dynid, folder):
    (folder / "one.yaml").write_text(GRAPH.lstrip("\n"))
    (folder / "s.yaml").write_text(
        "dynid: 1\nkind: study\nscene: one.yaml\nvary: {graph.nodes.m.value: {values: [2, 5]}}\n"
        f"collect: [{TIME}/response]\n"
    )
    assert dynid("study", "s.yaml", "--executor", "serial", "-q")[0] == 0
    result = open_result("s.h5")
    samples = result[f"study/results/{TIME}/response"]
    assert samples.dims == ("sample", "time", "output", "source")
    np.testing.assert_allclose(samples.data[0], exact(), rtol=1e-12, atol=1e-14)
