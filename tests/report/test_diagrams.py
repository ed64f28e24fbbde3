"""Diagrams of results: drawn of every scene, readable, the same each time, with the result's own numbers."""

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.report import figures
from dynid.report.registry import FAMILIES
from dynid.result import Result
from tests.report.test_plot import well_laid_out

CONFIGS = Path(__file__).parents[2] / "configs"
DRAWN = ("bond-graph", "reduction-", "prototype", "structure", "port-dynamics", "equivalent")
SCENES = (
    "isolator",
    "isolator_port",
    "dc_motor",
    "lattice_all_pass",
    "hoist",
    "beam_reduction",
    "beam_frf",
    "table2",
)


@cache
def result(name):
    return dynid.run(dynid.load_scene(CONFIGS / f"{name}.yaml"))


@cache
def drawn(name):
    return {figure.name: figure for figure in figures(result(name))}


def plots(name):
    return [
        f for f in drawn(name).values() if not f.name.startswith(DRAWN) or f.name.startswith("reduction-fr")
    ]


@pytest.mark.parametrize("scene", SCENES)
def test_every_diagram_is_readable_and_the_same_each_time(scene):
    again = {figure.name: figure for figure in figures(result(scene))}
    assert plots(scene)
    for figure in plots(scene):
        ET.fromstring(figure.svg)
        assert figure.svg == again[figure.name].svg
        assert well_laid_out(figure.svg) == [], figure.name
        assert figure.caption.endswith(".")
        assert len(figure.svg) < 500_000
        assert figure.table.rows or figure.name == "sobol"


def column(table, name):
    return [row[table.columns.index(name)] for row in table.rows]


def test_the_table_under_a_bode_diagram_is_the_response_itself():
    own, table = result("isolator"), drawn("isolator")["bode"].table
    omega = own["bond_graph/frequency_response/omega"].data
    response = own["bond_graph/frequency_response/response"].data[:, 0, 0]
    places = [int(np.flatnonzero(omega == value)[0]) for value in column(table, "angular frequency (rad/s)")]
    assert places[0] == 0
    assert places[-1] == len(omega) - 1
    assert column(table, "|m_s.f / v_in| (dB)") == (20 * np.log10(np.abs(response[places]))).tolist()
    assert column(table, "frequency (Hz)") == (omega[places] / (2 * np.pi)).tolist()  # the scene is in Hz


def test_axes_are_in_hertz_where_the_scene_is():
    assert "frequency (Hz)" in drawn("isolator")["bode"].svg
    assert "frequency (Hz)" not in drawn("beam_reduction")["reduction-frf"].svg
    assert "angular frequency (rad/s)" in drawn("beam_reduction")["reduction-frf"].svg


def test_a_pole_zero_map_lists_roots_damping_and_their_certified_bounds():
    own, figure = result("isolator"), drawn("isolator")["poles-m_s.f-v_in"]
    group = "bond_graph/transfer_function/m_s.f/v_in"
    poles = own[f"{group}/poles"].data
    rows = [row for row in figure.table.rows if row[0] == "pole"]
    assert [complex(row[1], row[2]) for row in rows] == poles.tolist()
    zeta = own["bond_graph/properties/m_s.f/v_in/damping_ratio"].data[0]
    assert rows[0][4] == pytest.approx(zeta, rel=1e-12)
    assert [row[5] for row in rows] == own[f"{group}/pole_error_bound"].data.tolist()
    assert "too small to be seen" in figure.caption


def test_a_wide_error_is_drawn_as_a_disc_and_hidden_modes_are_marked():
    wide = Result("bond-graph", "roots known badly")
    group = "bond_graph/transfer_function/y/u"
    wide.add_axis(f"{group}/pole", [1, 2])
    wide.add(f"{group}/poles", [-1 + 2j, -1 - 2j], ("pole",), "rad/s")
    wide.add(f"{group}/pole_error_bound", [0.3, 0.3], ("pole",), "rad/s")
    found = {figure.name: figure for figure in figures(wide)}
    assert "drawn as discs" in found["poles-y-u"].caption
    assert "hidden modes" in drawn("lattice_all_pass")["poles-R.e-source"].svg


def test_a_wide_gap_of_roots_has_a_panel_of_its_own():
    stiff = Result("bond-graph", "stiff")
    group = "bond_graph/transfer_function/y/u"
    stiff.add_axis(f"{group}/pole", [1, 2, 3])
    stiff.add(f"{group}/poles", [-1e6, -1 + 2j, -1 - 2j], ("pole",), "rad/s")
    svg = next(figure for figure in figures(stiff) if figure.name == "poles-y-u").svg
    assert svg.count('class="plot"') == 2
    assert "near the origin" in svg


def test_histories_hold_the_estimates_their_bands_and_the_truth():
    own, figure = result("table2"), drawn("table2")["history"]
    estimate = own["identification/history/estimate"].data
    assert figure.table.rows[-1][1] == estimate[-1, 0]
    assert figure.svg.count('class="s2 dashed"') == 4 + 1  # a rule a parameter, and the legend
    for name in ("upper.k (N/m)", "upper.c (N·s/m)", "time (s)"):
        assert name in figure.svg


def test_the_error_of_states_is_estimate_less_truth():
    own, table = result("table2"), drawn("table2")["state-error"].table
    error = own["identification/history/state"].data - own["identification/history/true_state"].data
    names = own["identification/history/component"].data
    for place, name in enumerate(table.columns[1:]):
        own_place = next(k for k, component in enumerate(names) if f" {component} " in f"{name} ")
        assert table.rows[0][place + 1] == error[0, own_place]


def test_estimates_correlations_and_criteria_are_those_of_the_result():
    own, found = result("table2"), drawn("table2")
    assert (
        column(found["estimates"].table, "estimate")
        == own["identification/parameters/estimate"].data.tolist()
    )
    matrix = own["identification/parameters/correlation"].data
    assert [row[-1] for row in found["correlation"].table.rows] == matrix.reshape(-1).tolist()
    mac = drawn("beam_reduction")["mac"].table
    first = result("beam_reduction")["reduction/serep/mac"].data
    assert [row[-1] for row in mac.rows if row[0] == "serep"] == first.reshape(-1).tolist()


def test_modes_swing_only_where_motion_is_wanted():
    found = Result("identification", "beam", {"scene": (CONFIGS / "beam_joints.yaml").read_text()})
    found.add_axis("structure/modes/mode", [1])
    labels = [f"{along}_{node}" for node in range(1, 9) for along in ("w", "theta")][1:]
    found.add_axis("structure/modes/dof", labels)
    found.add("structure/modes/omega", [3.0], ("mode",), "rad/s")
    # A straight line that turns about the pin: what lies between the nodes is on it, too.
    shape = [1.0 if label.startswith("theta") else float(label[2:]) - 1 for label in labels]
    found.add("structure/modes/shape", np.array(shape)[:, None], ("dof", "mode"))
    drawings = {figure.name: figure for figure in figures(found)}
    assert "@keyframes" not in drawings["modes"].svg
    assert "prefers-reduced-motion" in drawings["modes-animated"].svg
    path = next(p for p in ET.fromstring(drawings["modes"].svg).iter() if p.get("class") == "s1").get("d")
    points = np.array([tuple(map(float, pair.split())) for pair in path[1:].split(" L")])
    slope = (points[-1, 1] - points[0, 1]) / (points[-1, 0] - points[0, 0])
    assert np.abs(points[:, 1] - points[0, 1] - slope * (points[:, 0] - points[0, 0])).max() < 0.02


def test_a_family_is_imported_only_for_results_it_shows_something_of():
    assert not any(family.when(Result("other")) for family in FAMILIES)
