"""The performance characteristic at a port, at rest and over frequency, and what a scene shows of it."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph import Bond
from dynid.bondgraph.results.port import static_characteristics
from dynid.store import write_result
from tests.bondgraph.graphs import ISOLATOR, written
from tests.bondgraph.test_port import decomposed
from tests.scene.example_scenes import faults_of

CONFIGS = Path(__file__).parents[2] / "configs"


def test_the_operating_point_of_a_battery_and_a_lamp():
    """12 V behind 2 ohm, a lamp of 4 ohm: 2 A at 8 V, between 12 V open and 6 A shorted."""
    parts = decomposed("Se u, 1 a, R r 2, R lamp 4", "u -> a -> r, a -> lamp", "a -> lamp")
    line = static_characteristics(parts)["u"]
    flow, effort = line.operating
    assert (12 * flow, 12 * effort) == (2, 8)
    for f, e in line.source:
        assert e == 1 - 2 * f
    for f, e in line.load:
        assert e == 4 * f
    assert min(f for f, _ in line.source) < 0 < Fraction(1, 2) < max(f for f, _ in line.source)


def test_a_source_that_is_stiff_at_rest_has_a_vertical_line():
    """The isolator's tuning part locks at rest: the base moves the body whatever force that takes."""
    line = static_characteristics(decomposed(*ISOLATOR, "base -> body"))["v_in"]
    assert line.operating == (1, 50)
    assert [f for f, _ in line.source] == [1, 1]


@pytest.mark.parametrize(
    ("nodes", "bonds", "link"),
    [
        ("Sf u, 0 j, C c 2, 1 k, C d 3", "u -> j -> c, j -> k -> d", "j -> k"),  # integrated without end
        ("Se u, 1 j, I m 2, 0 k, I n 3", "u -> j -> m, j -> k -> n", "j -> k"),
    ],
)
def test_where_nothing_comes_to_rest_there_is_a_note(nodes, bonds, link):
    graph = written(nodes, bonds, "u.e", inputs=["u"])
    port = Bond(*(end.strip() for end in link.split("->")))
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, frozenset(), port=port))
    note = str(result.group_attrs["bond_graph/port/performance"]["note"])
    assert note.startswith("u: no static characteristic")
    assert "bond_graph/port/performance/input" not in result


def test_a_matched_load_takes_the_power_that_is_available():
    """1 V behind R = 2, L = 0.5; a load of R = 2, C = 1/(0.5 ω²) takes 1/16 W at ω = 4, else less."""
    omega = np.array([4.0, 9.0])
    graph = written(
        "Se u, 1 a, R r 2, I l 1/2, 1 b, R lamp 2, C c 1/8",
        "u -> a -> r, a -> l, a -> b, b -> lamp, b -> c",
        "lamp.e",
    )
    asked, port = frozenset({"frequency_response"}), Bond("a", "b")
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, asked, omega=omega, port=port))
    group = "bond_graph/port/frequency_response"
    available, active, reactive = (
        result[f"{group}/{name}_power"].data[:, 0] for name in ("available", "active", "reactive")
    )
    np.testing.assert_allclose(available, 1 / 16, rtol=1e-14)
    flow = 1 / abs(4 + 1j * (omega / 2 - 8 / omega)) ** 2
    np.testing.assert_allclose(active, flow, rtol=1e-13)
    np.testing.assert_allclose(reactive, -flow * 4 / omega, rtol=1e-13)
    assert active[0] == pytest.approx(available[0], rel=1e-14)


def test_a_lossless_source_can_give_any_power():
    omega = np.array([1.0, 2.0])
    graph = written(*ISOLATOR, "b.e")
    asked, port = frozenset({"frequency_response"}), Bond("base", "body")
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, asked, omega=omega, port=port))
    assert np.isinf(result["bond_graph/port/frequency_response/available_power"].data).all()


def test_over_frequency_the_port_is_where_source_and_load_meet():
    graph = written(*ISOLATOR, "b.e")
    omega = np.array([0.5, 28.8, 70.7, 400.0])
    asked = frozenset({"frequency_response"})
    port = Bond("base", "body")
    result = analyse(graph.graph, Analysis(graph.inputs, graph.outputs, asked, omega=omega, port=port))
    group = "bond_graph/port/frequency_response"
    values = {
        name: result[f"{group}/{name}"].data
        for name in ("source_Z_eq", "source_e_eq", "load_Z_eq", "effort", "flow")
    }
    s = 1j * omega
    tuning = 2 * s + 1e4 / s  # eq 17 with A_p^2 I_f = 2, A_p^2 / C_a = 1e4
    assert values["source_Z_eq"] == pytest.approx(tuning, rel=1e-13)
    assert values["load_Z_eq"] == pytest.approx(10 * s + 50, rel=1e-13)
    assert values["source_e_eq"][:, 0] == pytest.approx(tuning, rel=1e-13)  # eq 18: e = Z_t (v_in - f)
    flow = tuning / (tuning + 10 * s + 50)
    assert values["flow"][:, 0] == pytest.approx(flow, rel=1e-11)  # Z_t nearly vanishes at 70.7
    assert values["effort"][:, 0] == pytest.approx(flow * (10 * s + 50), rel=1e-11)
    # the damper's force is that of the whole graph
    assert result["bond_graph/frequency_response/response"].data[:, 0, 0] == pytest.approx(
        50 * flow, rel=1e-11
    )


SCENE = (CONFIGS / "isolator.yaml").read_text(encoding="utf-8")


def with_port(port):
    return SCENE.replace("  outputs: [m_s.f]\n", f"  outputs: [m_s.f]\n  port: {port}\n", 1)


@pytest.mark.thorough
def test_a_scene_with_a_port_writes_it_and_reads_it_back(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(with_port("base -> body"), encoding="utf-8")
    result = dynid.run(dynid.load_scene(file))
    assert result.value("bond_graph/port/prototype") == "d"
    assert result.value("bond_graph/port/source/Z_eq/exact") == "(2*s**2 + 10000)/s"
    assert result.value("bond_graph/port/type").startswith("independent: B (the load side)")
    requested = result["bond_graph/port/requested/m_s.f/v_in/zeros"].data
    assert np.abs(requested) == pytest.approx([np.sqrt(5000)] * 2, rel=1e-14)  # eq 20
    zeros = result["bond_graph/port/zero_dynamics/roots"].data
    assert np.sort_complex(zeros).tolist() == np.sort_complex(requested).tolist()
    assert result["bond_graph/port/net_power"].data.max() < 1e-30
    write_result(result, tmp_path / "result.h5")
    assert dynid.open_result(tmp_path / "result.h5").equals(result)


def test_either_direction_of_the_bond_may_be_written():
    """What is written first is the source side; the flow counts from there."""
    there = decomposed(*ISOLATOR, "base -> body")
    back = decomposed(*ISOLATOR, "body -> base")
    assert there.source.nodes == back.load.nodes
    at = there.program.run([there.flow["v_in"]], values_of(there), Fraction(3), Fraction(1))
    turned = back.program.run([back.flow["v_in"]], values_of(back), Fraction(3), Fraction(1))
    assert at[there.flow["v_in"]] == -turned[back.flow["v_in"]]


def values_of(parts):
    return {name: parts.graph.value(name) for name in parts.valued}


@pytest.mark.parametrize(
    ("port", "words"),
    [
        ("bas -> body", "no node 'bas'; did you mean 'base'?"),
        ("base -> b", "there is no bond between 'base' and 'b'; did you mean 'base -> body'?"),
        ("base", "a port is one bond of the graph"),
        ("base -> body -> m_s", "a port is one bond of the graph"),
        ("[base, body]", "a port is one bond of the graph"),
        ("17", "a port is one bond of the graph"),
    ],
)
def test_a_port_that_is_no_bond_is_refused_at_its_place(port, words):
    (fault,) = faults_of(with_port(port))
    assert words in fault
    line = 1 + with_port(port)[: with_port(port).index("\n  port:") + 1].count("\n")
    assert fault.startswith(f"{line}:9: ")


def test_a_port_on_a_loop_is_refused_with_the_reason():
    text = with_port("base -> body").replace("    - body -> b\n", "    - body -> b\n    - body -> base\n")
    (fault,) = faults_of(text)
    assert "lies on a loop" in fault
    assert "neither side has an impedance of its own" in fault


def test_a_loop_through_an_ideal_source_parts_the_graph_all_the_same():
    """Two branches under one voltage, joined at their far ends: at its bus the source is all there is."""
    nodes = "Se u, 0 bus, 1 a, R r 2, 0 m, 1 b, R q 3, C c 5"
    bonds = "u -> bus -> a -> r, a -> m, bus -> b -> q, b -> m -> c"
    parts = decomposed(nodes, bonds, "bus -> a")
    assert parts.source.ideal == "effort"
    assert parts.source.nodes == ("u", "bus")
    assert "u" in parts.load.effort
