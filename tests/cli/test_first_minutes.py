"""The first commands of a new user: what is there, what is installed, a tour, and answers to wrong ones."""

import json
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import click
import pytest

from dynid.cli import start as start_module
from dynid.cli.arguments import guarded
from dynid.cli.screen import summary
from dynid.cli.text import aligned
from dynid.result import Result
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.store.export import answer_json
from dynid.study.executors import SerialExecutor

CONFIGS = Path(__file__).parents[2] / "configs"
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
    (tmp_path / "data.csv").write_text("time,acc\n0,1\n")
    (tmp_path / "result.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
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
        (["motor"], "write: dynid run motor.yaml"),
        (["data.csv"], "'data.csv' is a file, no command; a scene names measured data"),
        (["Run", "motor.yaml"], "did you mean 'run'?"),
        (["simulate", "motor.yaml"], "no command 'simulate'; write: dynid run"),
        (["validate", "motor.yaml"], "write: dynid check"),
        (["version"], "write: dynid --version"),
        (["-v"], "Did you mean '--version'?"),
        (["gui"], "no command 'gui'; they are run, check, study"),
        (["run", "motor.yaml", "-set", "R=3"], "Did you mean '--set'?"),
        (["run", "motor.yaml", "--verbos"], "Did you mean '--verbose'?"),
        (
            ["run", "motor.yaml", "-o", "motor.csv"],
            "not motor.csv. To export it: dynid",
        ),
        (["run", "motor.yaml", "-o", "motor.html"], "For a page: --report motor.html"),
        (
            ["run", "data.csv"],
            "data.csv:1:1: a scene is a mapping; it starts with 'dynid: 1'",
        ),
        (["run", "result.h5"], "this is an HDF5 file, not a scene; if it is a result: dynid show result.h5"),
        (["study", "motor.yaml"], "not a study. Run it with: dynid run motor.yaml"),
        (["run", "motor.yaml", "--set", "parameters.R"], "a value is missing; write --set PATH=VALUE"),
        (["run", "motor.yaml", "--set", "kind=bondgraph"], "did you mean 'bond-graph'?"),
        (["run", "motor.yaml", "--set", "R=3"], "did you mean --set parameters.R=3?"),
        (
            ["run", "motor.yaml", "--set", "Q=3"],
            "'Q' is not a key of a scene; write the whole path of a value",
        ),
        (["run", "motor.yaml", "--set", "titel=3"], "'titel' is not a key of a scene; did you mean 'title'?"),
        (["run", "motor.yaml", "--set", "graph.J=[3]"], "did you mean --set graph.nodes.J.value=…?"),
        (
            ["run", "motor.yaml", "--set", "graph.nodes.JJ.value=3"],
            "graph.nodes.JJ needs the key 'type'; did you mean --set graph.nodes.J.value=3?",
        ),
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


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (["run", "motr.yaml"], "motr.yaml: no such file; did you mean 'motor.yaml'?"),
        (["run", "motor"], "did you mean 'motor.yaml'?"),
        (["run", "quantum"], "quantum: no such file. To begin with a template: dynid new"),
        (["run", "."], "is a directory, not a scene file"),
        (
            ["report", "motor.yaml"],
            "name the file that `dynid run motor.yaml` writes",
        ),
    ],
)
@pytest.mark.usefixtures("motor")
def test_a_file_that_cannot_be_read_is_answered_with_the_one_that_is_meant(dynid, command, answer):
    code, _, said = dynid(*command)
    assert (code, answer in said) == (4, True), said


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


@pytest.mark.thorough
def test_the_tour_runs_and_leaves_its_files(dynid, tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.study.executors.make_executor", lambda *_: SerialExecutor())
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
    monkeypatch.setitem(start_module._MODULES, "click", "no_such_module_of_click")
    monkeypatch.setattr(start_module.tempfile, "tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr(start_module, "_version", lambda name: "" if name == "pyarrow" else "1.0")
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


@pytest.mark.parametrize(
    ("terminal", "environment", "coloured"),
    [
        (True, {}, True),
        (False, {}, False),
        (True, {"NO_COLOR": "1"}, False),
        (True, {"TERM": "dumb"}, False),
        (False, {"FORCE_COLOR": "1"}, True),
        (False, {"FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
    ],
)
def test_verdicts_and_warnings_are_coloured_on_terminals(monkeypatch, terminal, environment, coloured):
    for name in ("NO_COLOR", "FORCE_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    stream = StringIO()
    stream.isatty = lambda: terminal
    monkeypatch.setattr("sys.stdout", stream)
    with guarded():
        click.echo("  converged: optimum found\na.yaml: warning: \x07evil")
    verdict, warning = (
        ("\x1b[32mconverged\x1b[0m", "\x1b[33mwarning:\x1b[0m") if coloured else ("converged", "warning:")
    )
    assert stream.getvalue() == f"  {verdict}: optimum found\na.yaml: {warning} \\x07evil\n"


def test_a_verdict_of_lack_of_fit_is_coloured_as_a_warning(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    stream = StringIO()
    monkeypatch.setattr("sys.stdout", stream)
    with guarded():
        click.echo("  optimum found, but the model lacks fit (p = 3e-09): it explains 97 %")
    marked = "\x1b[33moptimum found, but the model lacks fit\x1b[0m"
    assert stream.getvalue() == f"  {marked} (p = 3e-09): it explains 97 %\n"


@pytest.mark.parametrize("width", [60, 80, 120])
def test_screens_fit_a_terminal(monkeypatch, width):
    result = run_scene(load_scene(CONFIGS / "dc_motor.yaml"))
    result.title += " with a title that is longer than others are"
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    screen = summary(result, "0.1 s", trace=True).splitlines()
    assert max(map(len, screen)) <= width
    table = [["", "start", "estimate"], ["upper.k [N/m]", "1" * 30, "2" * 40], ["c", "3", "4"]]
    lines = list(aligned(table))
    assert max(map(len, lines)) <= width
    assert lines.count("") == (1 if width < 100 else 0)  # the second block of columns


def test_screens_of_an_unknown_kind_have_no_derivations():
    assert summary(Result("of another version", "title"), "").startswith("title")
