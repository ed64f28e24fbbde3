"""The first commands of a new user: what is there, what is installed, a tour, and answers to wrong ones."""

import json
from types import SimpleNamespace

import pytest

from dynid.cli import doctor as doctor_module
from dynid.cli import summary
from dynid.result import Result
from dynid.store.export import answer_json

MOTOR = """dynid: 1
kind: bond-graph
title: Motor
parameters: {R: 2, J: 0.5}
graph:
  nodes:
    v: Se
    k: 1
    R: {type: R, value: R}
    J: {type: I, value: J}
  bonds: [v -> k, k -> R, k -> J]
analysis: {inputs: [v], outputs: [J.f], time: {stop: 1, step: 0.1, input: {kind: step}}}
"""


@pytest.fixture
def motor(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "motor.yaml").write_text(MOTOR)
    return tmp_path


def test_new_without_a_name_lists_the_templates(dynid):
    code, said, _ = dynid("new")
    assert code == 0
    listed = [line.split()[0] for line in said.splitlines()[2:]]
    assert {"bond-graph", "chain", "identification", "study", "record", "frf"} <= set(listed)


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (["motor.yaml"], "write: dynid run motor.yaml"),
        (["motor.YML"], "write: dynid run motor.YML"),
        (["motor.h5"], "write: dynid show motor.h5"),
        (["run", "motor.yaml", "--set", "R=3"], "did you mean --set parameters.R=3?"),
        (["run", "motor.yaml", "--set", "Q=3"], "'Q' is not a key"),
        (["run", "motor.yaml", "--set", "parameters.R=3,5"], "decimals stand behind a point"),
        (["run", "motor.yaml", "--set", "analysis.inputs=[torque]"], "no node 'torque'; sources are: v"),
        (
            ["run", "motor.yaml", "--set", "analysis.time.input.source=w9"],
            "'w9' is not an input; there are: v",
        ),
    ],
)
@pytest.mark.usefixtures("motor")
def test_a_wrong_first_command_is_answered_with_the_right_one(dynid, command, answer):
    code, _, said = dynid(*command)
    assert code == 2
    assert answer in said


def test_a_node_that_is_set_by_its_name_alone_is_found(dynid, motor):
    (motor / "motor.yaml").write_text(MOTOR.replace("value: J", "value: 0.5").replace(", J: 0.5", ""))
    assert "did you mean --set graph.nodes.J.value=3?" in dynid("run", "motor.yaml", "--set", "J=3")[2]


@pytest.mark.usefixtures("motor")
def test_the_answer_comes_first_and_derivations_when_they_are_asked_for(dynid):
    code, said, _ = dynid("run", "motor.yaml")
    assert code == 0
    lines = said.splitlines()
    assert any("poles   -4 rad/s" in line for line in lines[:10])
    assert "prototype" not in said
    assert "dynid show --trace" in said
    for command in (("run", "motor.yaml", "-v"), ("show", "motor.h5", "--trace")):
        traced = dynid(*command)[1]
        assert "prototype" in traced
        assert traced.index("poles   -4") < traced.index("prototype")


@pytest.mark.usefixtures("motor")
def test_the_answer_as_one_json_object(dynid):
    code, ran, said = dynid("run", "motor.yaml", "--json")
    assert (code, said) == (0, "")
    answer = json.loads(ran)
    assert list(answer) == ["kind", "title", "status", "answer", "warnings"]
    assert (answer["kind"], answer["title"], answer["status"]) == ("bond-graph", "Motor", "complete")
    assert answer["answer"]["bond_graph/transfer_function/J.f/v/poles"] == [[-4.0, 0.0]]
    assert answer["answer"]["bond_graph/properties/J.f/v/stable"] is True
    assert json.loads(dynid("show", "motor.h5", "--json")[1]) == answer


def test_json_writes_what_it_has_no_numbers_for():
    result = Result("bond-graph")
    result.add("x", [float("inf"), -float("inf"), float("nan"), 1.5], ("k",))
    result.add("z", complex(float("inf"), 0))
    result.add("long", range(101), ("n",))
    document = json.loads(answer_json(result, ["careful"]))
    assert document["answer"] == {"x": ["inf", "-inf", None, 1.5], "z": ["inf", 0.0]}
    assert document["warnings"] == ["careful"]


def test_the_tour_runs_and_leaves_its_files(dynid, tmp_path):
    target = tmp_path / "tour"
    code, said, _ = dynid("demo", "-o", str(target))
    assert code == 0
    assert "converged: optimum found" in said
    assert {"bond-graph.html", "bond-graph.h5", "study.h5", "identification.h5"} <= {
        file.name for file in target.iterdir()
    }
    assert str(target) in said
    code, _, said = dynid("demo", "-o", str(target))
    assert code == 4
    assert "is not empty" in said


def test_the_doctor_names_every_required_package(dynid):
    code, said, _ = dynid("doctor")
    assert code == 0
    assert all(f"  {name} " in said for name in ("numpy", "scipy", "h5py", "python-flint", "click"))
    assert "no problems found" in said


def test_the_doctor_finds_a_package_that_cannot_be_loaded_and_a_folder_that_cannot_be_written(
    dynid, monkeypatch, tmp_path
):
    monkeypatch.setitem(doctor_module._MODULES, "click", "no_such_module_of_click")
    monkeypatch.setattr(doctor_module.tempfile, "tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr(doctor_module, "_version", lambda name: "" if name == "pyarrow" else "1.0")
    code, said, _ = dynid("doctor")
    assert code == 3
    assert "problem: click cannot be loaded" in said
    assert "no folder for temporary files: set TMPDIR" in said
    assert "pip install 'dynid[formats]'" in said


@pytest.mark.parametrize("there", [True, False])
def test_the_doctor_looks_for_the_compiled_library(dynid, monkeypatch, there):
    monkeypatch.setattr("dynid.native.found", lambda: SimpleNamespace(_name="/library.so") if there else None)
    said = dynid("doctor")[1]
    assert ("/library.so" if there else "install dynid again where there is a C compiler") in said


def test_screens_of_an_unknown_kind_have_no_derivations():
    assert summary.summary(Result("of another version", "title"), "").startswith("title")
