"""Values changed in the text of a scene, which stays as it was otherwise."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynid.scene.files import file_places, moved
from dynid.scene.yaml.parser import MAX_DEPTH
from dynid.scene.yaml.source import parse_source, path_of, set_values
from dynid.scene.yaml.writer import dump, edited, plain

SCENE = """\
# A scene.
dynid: 1
parameters:
  m_s: 10                     # mass, kg
  b: "50"   # damper
graph:
  nodes: {v: Sf, m: {type: I, value: m_s}, 1: {type: R, value: 2}}
list:
  - a: 1
    b: 2
  - [1, 2, 3]
text: |
  two
  lines
shared: &s {x: 1}
again: *s
about:
  note: |
    three
nothing:
empty: {}
"""


def change(values, notes=None):
    """Return the text with values at dotted paths, and what it shall say."""
    source = parse_source(SCENE)
    whole = set_values(source, values).data
    places = {path_of(source, dotted): value for dotted, value in values.items()}
    said = {path_of(source, dotted): note for dotted, note in (notes or {}).items()}
    return edited(SCENE, whole, places, said), whole


@pytest.mark.parametrize(
    ("dotted", "value", "old", "new"),
    [
        ("parameters.m_s", 12.5, "m_s: 10  ", "m_s: 12.5  "),
        ("parameters.b", "1e3", 'b: "50"', 'b: "1e3"'),
        ("graph.nodes.m.value", "a, b", "value: m_s", "value: 'a, b'"),
        ("graph.nodes.1.value", 3, "value: 2", "value: 3"),
        ("graph.nodes.m", "Se", "m: {type: I, value: m_s}", "m: Se"),
        ("list.0.b", [1, {"c": 2}], "    b: 2", "    b: [1, {c: 2}]"),
        ("list.1.2", 1e-7, "[1, 2, 3]", "[1, 2, 1e-07]"),
        ("parameters.k", 1, "  # damper", "  # damper\n  k: 1"),
        ("list.0.c", 1, "    b: 2", "    b: 2\n    c: 1"),
        ("graph.nodes.new.value", 1, "value: 2}}", "value: 2}, new: {value: 1}}"),
        ("empty.x", 1, "empty: {}", "empty: {x: 1}"),
        ("more.deep", True, "empty: {}", "empty: {}\nmore: {deep: true}"),
    ],
)
def test_only_the_value_changes(dotted, value, old, new):
    text, whole = change({dotted: value})
    assert text == SCENE.replace(old, new, 1)
    assert dump(parse_source(text).data) == dump(whole)


def test_several_values_with_notes_at_the_ends_of_their_lines():
    text, _ = change(
        {"parameters.m_s": 1, "list.1.0": 7, "list.1.2": 9},
        {"parameters.m_s": "was 10", "list.1.0": "was 1", "list.1.2": "was 3"},
    )
    assert "  m_s: 1                     # mass, kg  # was 10\n" in text
    assert "  - [7, 2, 9]  # list.1.0: was 1; list.1.2: was 3\n" in text
    assert parse_source(text).data["list"][1] == [7, 2, 9]


@pytest.mark.parametrize(
    "dotted", ["text", "shared.x", "again.x", "parameters", "list", "about.x", "nothing.x"]
)
def test_what_cannot_be_edited_is_written_anew(dotted):
    text, whole = change({dotted: {"y": 2} if dotted in ("parameters", "list") else 2})
    assert text == dump(whole)


def test_notes_of_one_line_are_one_with_names_in_the_order_of_the_line():
    text, _ = change(
        {"graph.nodes.1.value": 5, "graph.nodes.m.value": 3, "graph.nodes.new": "Se"},
        {
            "graph.nodes.1.value": "set by the study; was 2",
            "graph.nodes.m.value": "set by the study; was m_s",
            "graph.nodes.new": "set by the study",
        },
    )
    line = next(line for line in text.splitlines() if "value: 5" in line)
    assert line.endswith("  # set by the study: m.value was m_s, nodes.1.value was 2, new")


PLAIN = st.recursive(
    st.integers() | st.floats(allow_nan=False) | st.text(max_size=8) | st.booleans() | st.none(),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("abc:#,", min_size=1), inner, max_size=2)
    ),
    max_leaves=6,
)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(["parameters.m_s", "graph.nodes.m.value", "list.1.1", "parameters.n", "empty.q"]), PLAIN
)
def test_the_text_always_reads_as_it_shall(dotted, value):
    text, whole = change({dotted: value}, {dotted: "a note"})
    try:
        expected = parse_source(dump(whole)).data
    except Exception:
        return  # no scene can say it, however it is written
    assert dump(parse_source(text).data) == dump(expected)


def test_files_of_a_scene_and_where_they_are_from_elsewhere(tmp_path):
    data = {
        "kind": "identification",
        "measurement": {
            "file": {"path": "run.csv", "columns": [1]},
            "records": [{"file": {"path": "/abs.csv"}}],
        },
        "structure": {
            "matrices": {"mass": "M.mtx", "damping": {"alpha": 1}, "stiffness": {"path": "../K.npz"}}
        },
        "analysis": {"time": {"input": {"kind": "file", "path": "u.csv", "column": "f"}}},
        "expect": [{"path": "a/b", "value": 1}],
        "title": "mass",
    }
    assert set(file_places(data)) == {
        ("measurement", "file", "path"),
        ("measurement", "records", 0, "file", "path"),
        ("structure", "matrices", "mass"),
        ("structure", "matrices", "stiffness", "path"),
        ("analysis", "time", "input", "path"),
    }
    there = tmp_path / "out"
    there.mkdir()
    assert moved("run.csv", tmp_path, there) == "../run.csv"
    assert moved("/abs.csv", tmp_path, there) == "/abs.csv"
    assert moved("K.h5:/k/K", tmp_path, tmp_path) == "K.h5:/k/K"
    assert Path(os.path.normpath(there / moved("../K.npz", tmp_path, there))) == tmp_path.parent / "K.npz"


def test_what_no_scene_can_hold_is_not_written():
    nested = 1
    for _ in range(MAX_DEPTH):
        nested = [nested]
    assert plain(nested) == nested
    for value in ([nested], "a\x00b", 10**400, {1: 0, "1": 0}, {(1,): 0}):
        with pytest.raises(ValueError):  # noqa: PT011
            plain(value)
