"""Figures of all scenes: drawn, readable, reproducible, with the result's own numbers."""

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.report import figures
from dynid.report.figure import FAMILIES, as_file
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
    "slipping_bolt",
    "duffing_beam",
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
    alone = as_file(drawings["modes-animated"].svg, "svg").decode()
    assert "to { d: var(--back) }" in alone  # it moves in a file of its own
    assert "var(--s1" not in alone
    path = next(p for p in ET.fromstring(drawings["modes"].svg).iter() if p.get("class") == "s1").get("d")
    points = np.array([tuple(map(float, pair.split())) for pair in path[1:].split(" L")])
    slope = (points[-1, 1] - points[0, 1]) / (points[-1, 0] - points[0, 0])
    assert np.abs(points[:, 1] - points[0, 1] - slope * (points[:, 0] - points[0, 0])).max() < 0.02


FRAME = """
dynid: 1
kind: identification
structure:
  frame:
    nodes: [[0, 0], [0, 2], [3, 2], [3, 0]]
    members:
      - {nodes: [1, 2], EA: 1.0e7, EI: 1.0e4, rhoA: 1, elements: 2}
      - {nodes: [2, 3], EA: 1.0e7, EI: 1.0e4, rhoA: 1, elements: 2}
      - {nodes: [3, 4], EA: 1.0e7, EI: 1.0e4, rhoA: 1, elements: 2}
    supports: [{node: 1, fix: [u, w, theta]}, {node: 4, fix: [u, w, theta]}]
joints: {}
analysis: {modes: {count: 3}}
"""
CHAIN = """
dynid: 1
kind: identification
structure:
  lumped:
    masses: [1, 2, 1]
    links: [{dofs: [1], k: 10}, {dofs: [1, 2], k: 20}, {dofs: [2, 3], k: 5}]
joints: {}
analysis: {modes: {count: 2}}
"""


def shapes(text):
    """Return the result, the still figure's lines at rest and moved, as arrays, and the figures."""
    from tests.report.pages import run

    found = run(text)
    made = {figure.name: figure for figure in figures(found)}
    elements = list(ET.fromstring(made["modes"].svg).iter())
    lines = {
        cls: [
            np.array([tuple(map(float, pair.split())) for pair in e.get("d")[1:].split(" L")])
            for e in elements
            if e.get("class") == cls and e.get("d")
        ]
        for cls in ("hair", "s1")
    }
    return found, lines["hair"], lines["s1"], made


def test_a_frame_sways_as_its_first_mode_says():
    found, rest, moved, made = shapes(FRAME)
    assert len(rest) == len(moved) == 9  # three members in each of three modes
    labels = list(found["structure/modes/dof"].data)
    shape = found["structure/modes/shape"].data[:, 0]
    # Where the girder meets the columns: both ends move sideways alike, as the mode shape has it, px right.
    left, right = moved[1][0] - rest[1][0], moved[1][-1] - rest[1][-1]
    assert left == pytest.approx(right, abs=0.07)
    assert abs(left[0]) > 20 * abs(left[1])
    half = moved[0][8] - rest[0][8]  # the node within the left column
    ratio = shape[labels.index("u_5")] / shape[labels.index("u_2")]
    assert half[0] / left[0] == pytest.approx(ratio, abs=0.002)  # two decimals of a px
    assert np.abs(moved[0][0] - rest[0][0]).max() == 0  # clamped
    assert moved[0][-1] == pytest.approx(moved[1][0], abs=0.011)  # the corner holds together
    omega = found["structure/modes/omega"].data[0]
    assert f"mode 1: {omega:.4g} rad/s" in made["modes"].svg
    assert made["modes-animated"].svg.count("--there:") == 9


def test_masses_of_a_chain_move_as_their_modes_say():
    found, rest, moved, made = shapes(CHAIN)
    for mode, shape in enumerate(found["structure/modes/shape"].data.T):
        up = -(moved[mode] - rest[mode])[:, 1]
        assert up / np.abs(up).max() == pytest.approx(shape / np.abs(shape).max(), abs=0.001)
    assert column(made["modes"].table, "mode 2") == found["structure/modes/shape"].data[:, 1].tolist()


def test_a_family_is_imported_only_for_results_it_shows_something_of():
    assert not any(family.applies(Result("other")) for family in FAMILIES)
