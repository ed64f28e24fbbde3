"""Schematics of structures: everything in the scene is drawn, and no texts overlap."""

import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import pytest

from dynid.errors import UsageError
from dynid.report.drawing.structure import figures
from dynid.report.svg import SIZE, SMALL, text_width
from dynid.result import Result

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
SHAPES = ("\n  lumped:", "\n  beam:", "\n  frame:")
STRUCTURES = [file for file in CONFIGS if any(shape in file.read_text(encoding="utf-8") for shape in SHAPES)]

CHAIN = """
dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 3, 4]
    links:
      - {dofs: [1], k: 5}
      - {dofs: [1, 2], k: 6, c: 7}
      - {dofs: [2, 3], c: 8}
      - {dofs: [1, 3], k: 9}
      - {dofs: [2], k: 1}
joints: {hold: {dofs: [3], k: {start: 10, true: 12}}}
excitation: [{dof: 2, kind: step}]
measurement:
  {step: 0.1, samples: 10, channels: [{dof: 3, quantity: acceleration}], simulate: {noise_ratio: 0}}
"""
FRAME = """
dynid: 1
kind: reduction
structure:
  frame:
    nodes: [[0, 0], [0, 3], [4, 3], [4, 0]]
    members:
      - {nodes: [1, 2], EA: 1.0e6, EI: 1.0e4, rhoA: 1, elements: 3}
      - {nodes: [2, 3], EA: 1.0e6, EI: 1.0e4, rhoA: 1, elements: 4}
      - {nodes: [3, 4], EA: 1.0e6, EI: 1.0e4, rhoA: 1, elements: 3}
    supports: [{node: 1, fix: [u, w, theta]}, {node: 4, fix: [u, w]}]
    masses: [{node: 3, m: 2}]
joints: {foot: {dofs: [theta_4], k: 100}, stay: {dofs: [u_2], k: 5}}
reduction: [{method: guyan, masters: [u_2, u_3, theta_4]}]
frequency: {start: 1, stop: 10}
inputs: [u_2]
outputs: [{dof: u_3}]
"""


def drawn(text):
    (figure,) = figures(Result(kind="", title="t", attrs={"scene": text}))
    return figure


def text_boxes(svg):
    boxes = []
    for element in ET.fromstring(svg).findall(".//{*}text"):
        classes = element.get("class", "").split()
        size = SMALL if "small" in classes else SIZE
        width = text_width(element.text, size, bold="strong" in classes)
        x, y = float(element.get("x")), float(element.get("y"))
        left = x - {"middle": 0.5, "end": 1.0}.get(element.get("text-anchor"), 0.0) * width
        boxes.append((element.text, left, y - 0.75 * size, left + width, y + 0.2 * size))
    return boxes


def assert_texts_apart(svg):
    for (a, *one), (b, *other) in combinations(text_boxes(svg), 2):
        apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
        assert apart, (a, b)
    left, top, width, height = map(float, ET.fromstring(svg).get("viewBox").split())
    for text, x1, y1, x2, y2 in text_boxes(svg):
        assert left <= x1 and x2 <= left + width, text  # noqa: PT018
        assert top <= y1 and y2 <= top + height, text  # noqa: PT018


@pytest.mark.parametrize("file", STRUCTURES, ids=lambda file: file.stem)
def test_the_structures_of_the_scenes_are_drawn_with_every_text_apart(file):
    assert_texts_apart(drawn(file.read_text(encoding="utf-8")).svg)


def test_a_chain_shows_what_ties_its_masses():
    figure = drawn(CHAIN)
    assert_texts_apart(figure.svg)
    texts = {text for text, *_ in text_boxes(figure.svg)}
    assert {
        "2 kg",
        "3 kg",
        "4 kg",
        "k = 6 N/m",
        "c = 7 N·s/m",
        "k = 9 N/m",
        "k = 1 N/m",
        "hold",
        "k = ?",
        "F",
        "a",
    } <= texts
    rows = figure.table.rows
    assert ("1, 3", "link", "k = 9 N/m") in rows
    assert ("3", "joint", "hold, k = ?") in rows
    assert ("2", "force", "") in rows
    assert ("3", "sensor", "acceleration") in rows


def test_a_frame_shows_its_members_supports_and_masters():
    figure = drawn(FRAME)
    texts = {text for text, *_ in text_boxes(figure.svg)}
    assert {"1", "4", "foot", "stay", "k = 100 N·m/rad", "k = 5 N/m", "F at u_2", "displacement u_3"} <= texts
    assert ("theta_4", "master", "") in figure.table.rows
    assert_texts_apart(figure.svg)


def test_numbers_of_dofs_are_their_labels_of_a_beam():
    file = next(file for file in STRUCTURES if file.stem == "beam_reduction")
    rows = drawn(file.read_text(encoding="utf-8")).table.rows
    assert ("w_4", "force", "") in rows
    assert ("theta_1", "master", "") in rows


def test_matrices_have_no_shape_to_draw():
    file = next(file for file in CONFIGS if file.stem == "table3")
    assert list(figures(Result(kind="", attrs={"scene": file.read_text(encoding="utf-8")}))) == []


def test_a_scene_that_was_changed_in_its_file_is_not_drawn_and_that_is_said():
    for text in (
        "",
        "[",
        CHAIN.replace("dofs: [1, 2]", "dofs: 3"),
        CHAIN.replace("masses: [2, 3, 4]", "masses: 2"),
    ):
        with pytest.raises(UsageError, match="Run the scene again"):
            drawn(text)


def test_values_may_be_parameters_and_expressions():
    text = CHAIN.replace("masses: [2, 3, 4]", "masses: [m, 2*m, m**2]") + "parameters: {m: 1.5, half: m/2}\n"
    figure = drawn(text.replace("k: 6", "k: 8*half"))
    texts = {text for text, *_ in text_boxes(figure.svg)}
    assert {"1.5 kg", "3 kg", "2.25 kg", "k = 6 N/m"} <= texts


def test_values_that_are_to_be_estimated_are_not_drawn_by_their_starts():
    unknown = (
        "parameters: {top: {start: 7, true: 7}, m_of_the_platform: {start: 8, true: 8}, twice: 2*top, "
        "sure: {value: 3, std: 1}}"
    )
    text = CHAIN.replace("masses: [2, 3, 4]", "masses: [top, m_of_the_platform, sure]")
    figure = drawn(text.replace("k: 6, c: 7", "k: twice, c: 3*sure") + unknown)
    assert_texts_apart(figure.svg)
    texts = {text for text, *_ in text_boxes(figure.svg)}
    assert {"top = ?", "m = ?", "3 kg", "k = twice = ?", "c = 9 N·s/m"} <= texts
    assert not {"7 kg", "8 kg", "k = 14 N/m"} & texts
    masses = [row for row in figure.table.rows if row[1] == "mass"]
    assert masses == [("1", "mass", "top = ?"), ("2", "mass", "m_of_the_platform = ?"), ("3", "mass", "3 kg")]


def test_a_joint_names_its_laws():
    text = CHAIN.replace("k: {start: 10, true: 12}", "laws: [{kind: cubic, k3: {start: 5, true: 6}}]")
    assert ("3", "joint", "hold, cubic") in drawn(text).table.rows


def test_records_with_sensors_of_their_own_show_them_all():
    text = (
        CHAIN[: CHAIN.index("measurement:")]
        + """
measurement:
  step: 0.1
  samples: 10
  simulate: {noise_ratio: 0}
  channels: [{dof: 1, quantity: velocity}]
  records: [{}, {channels: [{dofs: [2, 3], quantity: displacement}]}]
"""
    )
    rows = drawn(text).table.rows
    assert {row[:2] for row in rows if row[1] == "sensor"} == {(n, "sensor") for n in "123"}
    assert ("2", "sensor", "displacement") in rows


def test_names_by_node_and_direction_draw_the_same_picture():
    text = FRAME.replace("theta_4", "4:rz").replace("u_2", "2:x").replace("u_3", "3:x")
    assert drawn(text).svg == drawn(FRAME).svg
    assert drawn(text).table == drawn(FRAME).table


def test_the_force_on_a_signed_dof_points_the_other_way():
    def arrow(dof):
        svg = drawn(FRAME.replace("inputs: [u_2]", f"inputs: ['{dof}']")).svg
        paths = [ET.fromstring(svg).findall(f".//{{*}}path[@class='{cls}']") for cls in ("bond s2", "s2 dot")]
        # The line starts at the tail; the head starts at the tip.
        return [tuple(map(float, path.get("d")[1:].partition(" L")[0].split())) for (path,) in paths]

    for way in "xy":
        assert arrow(f"2:-{way}") == arrow(f"2:{way}")[::-1]
    (x1, _), (x2, _) = arrow("2:x")
    (_, y1), (_, y2) = arrow("2:y")
    assert x2 > x1
    assert y2 < y1  # upwards
