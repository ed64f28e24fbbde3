"""`dynid check` names the files of data that a run would miss, and what is wrong in them, in its words."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from dynid.scene.files import file_places

RECORD = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [2, 2], links: [{dofs: [1], k: 2.0e4, c: 20}]}
joints:
  path: {dofs: [1, 2], k: {start: 1.0e4, true: 2.0e4}, c: {value: 20}}
excitation:
  - {dof: 2, kind: file, path: force.csv}
measurement:
  step: 0.002
  samples: 50
  channels: [{dof: 2, quantity: velocity}]
  file:
    path: record.csv
"""
END = "    path: record.csv\n"
DRIVEN = "  records: [{excitation: [{dof: 1, kind: step}]}]\n"
MATRICES = """\
dynid: 1
kind: reduction
structure:
  matrices:
    mass: M.h5:/mass
    stiffness: {path: deep/K.mtx}
    damping: {path: C.npz, name: C}
    labels: labels.txt
reduction: [{method: guyan, masters: [1]}]
"""
GRAPH = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {path: Se, m: {type: I, value: 2}, b: {type: R, value: 1}, one: 1}
  bonds: [path -> one -> m, one -> b]
analysis:
  outputs: [m.f]
  results: [RESULT]
  time: {stop: 1, step: 0.1, input: {kind: file, path: gone.csv}}
"""
STUDY = """\
dynid: 1
kind: study
scene: deep/record.yaml
vary:
  joints.path.c.value: [1, 2]
"""


def said(text):
    """Where, and what, line by line."""
    return [line.partition(": ")[::2] for line in text.splitlines()]


def test_every_missing_file_of_a_record_is_told_at_its_key_in_the_words_of_the_run(dynid, folder):
    (folder / "a.yaml").write_text(RECORD)
    code, out, err = dynid("check", "a.yaml")
    remedy = "Paths in a scene are relative to the scene's folder."
    assert said(err) == [
        ("a.yaml:8:26", f"force.csv is no file. {remedy}"),
        ("a.yaml:14:5", f"record.csv is no file. {remedy}"),
    ]
    assert (code, out) == (4, "")
    ran = dynid("run", "a.yaml")
    assert ran[0] == 4
    assert ran[2].strip() in err
    for name in ("force.csv", "record.csv"):
        (folder / name).write_text("not a table")
    code, _, err = dynid("check", "a.yaml")
    assert code == 4
    assert dynid("run", "a.yaml")[2].strip() in err
    for name in ("force.csv", "record.csv"):
        (folder / name).write_text("1\n" * 50)
    assert dynid("check", "a.yaml")[::2] == (0, "")


def test_matrices_and_labels_are_looked_for(dynid, folder):
    (folder / "a.yaml").write_text(MATRICES)
    code, _, err = dynid("check", "a.yaml")
    assert code == 4
    assert [place for place, _ in said(err)] == [f"a.yaml:{line}" for line in ("5:5", "6:17", "7:15", "8:5")]
    assert re.findall(r"(\S+) is no file", err) == ["M.h5", "deep/K.mtx", "C.npz", "labels.txt"]
    (folder / "M.h5").touch()
    assert "M.h5" not in dynid("check", "a.yaml")[2]


def test_a_scene_that_is_invalid_and_one_whose_data_are_missing_are_both_told(dynid, folder):
    (folder / "a.yaml").write_text(RECORD)
    (folder / "b.yaml").write_text(RECORD.replace("samples", "sample"))
    code, out, err = dynid("check", "a.yaml", "b.yaml", "small.yaml")
    assert code == 4
    assert "record.csv is no file" in err
    assert "'sample' is not a key" in err
    assert out.startswith("small.yaml: valid")


@pytest.mark.parametrize(
    ("kind", "word"), [("folder", "is no file"), ("pipe", "is no file"), ("locked", "cannot be read")]
)
def test_what_is_there_but_no_file_to_read_is_told_without_waiting(dynid, folder, monkeypatch, kind, word):
    (folder / "a.yaml").write_text(RECORD)
    (folder / "force.csv").write_text("1\n" * 50)
    there = folder / "record.csv"
    if kind == "folder":
        there.mkdir()
    elif kind == "pipe":
        os.mkfifo(there)
    else:
        there.touch(mode=0o000)  # which hinders all but root
        monkeypatch.setattr(os, "access", lambda path, _: Path(path).name != there.name)
    code, _, err = dynid("check", "a.yaml")
    assert code == 4
    assert word in err
    assert err.startswith("a.yaml:14:5: record.csv")


@pytest.mark.parametrize(
    ("change", "missed"),
    [
        ({"file:\n    path: record.csv": "simulate: {noise_ratio: 0.1}"}, ["force.csv"]),
        # every record is simulated, or has a file of its own
        ({END: END + "  records: [{simulate: {}}, {file: {path: b.csv}}]\n"}, ["force.csv", "b.csv"]),
        ({END: END + "  records: [{simulate: {}}, {step: 1}]\n"}, ["force.csv", "record.csv"]),
        ({END: END + DRIVEN}, ["record.csv"]),
        # the excitation drives the time response, too, where that has no input
        (
            {END: f"{END}{DRIVEN}analysis: {{time: {{stop: 0.1, step: 0.002}}}}\n"},
            ["force.csv", "record.csv"],
        ),
    ],
)
def test_what_a_run_does_not_read_may_be_missing(dynid, folder, change, missed):
    text = RECORD
    for old, new in change.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "a.yaml").write_text(text)
    code, _, err = dynid("check", "a.yaml")
    assert re.findall(r"(\S+) is no file", err) == missed
    assert code == 4


@pytest.mark.parametrize(("result", "code"), [("poles", 0), ("time_response", 4)])
def test_the_input_of_a_response_is_looked_for_where_the_response_is_asked_for(dynid, folder, result, code):
    (folder / "a.yaml").write_text(GRAPH.replace("RESULT", result))
    assert dynid("check", "a.yaml")[0] == code
    assert dynid("run", "a.yaml")[0] == code


def test_a_study_looks_for_the_files_of_the_scene_it_varies_and_of_what_it_sets(dynid, folder):
    (folder / "deep").mkdir()
    (folder / "deep/record.yaml").write_text(RECORD)
    (folder / "a.yaml").write_text(STUDY)
    code, _, err = dynid("check", "a.yaml")
    assert code == 4
    assert [place for place, _ in said(err)] == ["deep/record.yaml:8:26", "deep/record.yaml:14:5"]
    assert "deep/record.csv is no file" in err
    (folder / "deep/force.csv").touch()
    (folder / "deep/one.csv").touch()
    set_here = STUDY + "  measurement.file.path: [one.csv, two.csv]\n"
    (folder / "a.yaml").write_text(set_here)
    code, _, err = dynid("check", "a.yaml")
    assert code == 4
    assert [(place, words[:23]) for place, words in said(err)] == [("a.yaml:6:36", "deep/two.csv is no file")]
    (folder / "a.yaml").write_text(set_here.replace(", two.csv", ""))
    assert dynid("check", "a.yaml")[::2] == (0, "")


def test_what_the_user_gave_a_name_is_no_file():
    data = {
        "kind": "identification",
        "parameters": {"path": "2*a"},
        "graph": {"nodes": {"path": "Se"}},
        "joints": {"path": {"k": {"path": "x"}}},
        "many": [[float(x) for x in np.arange(3)]],
        "measurement": {"file": {"path": "a.csv"}},
    }
    assert list(file_places(data)) == [("measurement", "file", "path")]
