"""`dynid run`: files, screen and exit codes."""

import html
import json
import os
import re
from xml.etree import ElementTree

import pytest

from dynid.store import read_result


def test_a_run_writes_one_file_named_after_the_scene_in_the_current_folder(dynid, folder):
    (folder / "scenes").mkdir()
    (folder / "small.yaml").rename(folder / "scenes" / "small.yaml")
    code, out, err = dynid("run", "scenes/small.yaml")
    assert (code, err) == (0, "")
    assert sorted(path.name for path in folder.iterdir()) == ["scenes", "small.h5"]
    assert out.startswith("A mass on a damper")
    assert "wrote small.h5" in out
    assert "1 of 1 expectation met" in out
    result = read_result("small.h5")
    assert result.value("bond_graph/properties/m.f/F/dc_gain") == 1
    assert result.attrs["scene"] == (folder / "scenes" / "small.yaml").read_text()


UNDETERMINED = (
    "dynid: 1\nkind: bond-graph\ngraph:\n"
    "  nodes: {V1: Se, a: 0, b: 0, r: {type: R, value: 4}, x: 1, y: 1}\n"
    "  bonds: [V1 -> a -> b -> r, b -> a, x -> y]\n"
    "analysis: {inputs: [V1], outputs: [r.f]}\n"
)


@pytest.mark.parametrize("streams", ["both", "out", "none"])
def test_warnings_are_printed_once_wherever_both_streams_go(dynid, folder, monkeypatch, streams):
    (folder / "s.yaml").write_text(UNDETERMINED)
    monkeypatch.setenv("NO_COLOR", "1")
    if streams != "none":
        monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    if streams == "both":
        monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    code, out, err = dynid("run", "s.yaml")
    warned = list(read_result("s.h5")["bond_graph/warnings"].data)
    assert (code, bool(warned)) == (0, True)
    assert all(f"s.yaml: warning: {text}" in err for text in warned)
    assert (out + err).count("warning") == len(warned)
    assert not any(text in out for text in warned)


def test_the_output_may_be_named_and_silence_asked_for(dynid, folder):
    assert dynid("run", "small.yaml", "-o", "other.hdf5", "-q") == (0, "", "")
    assert (folder / "other.hdf5").exists()
    assert not (folder / "small.h5").exists()


def test_set_changes_values_and_the_file_says_so(dynid, folder):
    code, _, _ = dynid("run", "small.yaml", "--set", "parameters.m=4", "--set", "title=Heavier", "-q")
    result = read_result("small.h5")
    assert (code, result.title) == (0, "Heavier")
    assert result["bond_graph/transfer_function/m.f/F/denominator"].data.tolist() == [1, 0.25]
    (folder / "again.yaml").write_text(result.attrs["scene"])
    assert dynid("run", "again.yaml", "-q")[0] == 0
    assert read_result("again.h5").equals(result)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("parameters.m", "--set parameters.m:1:1: a value is missing; write --set PATH=VALUE"),
        ("parameters.m=[", "--set parameters.m:2:1: this is not valid YAML"),
        ("title.x=1", "--set title.x:1:1: title is a text, not a mapping; it has no 'x'"),
        (
            "analysis.outputs.3=m.f",
            "--set analysis.outputs.3:1:1: analysis.outputs is a list of 1, counted from 0",
        ),
        ("graph.nodes.m.value=mm", "--set graph.nodes.m.value:1:1: no parameter 'mm'; did you mean 'm'?"),
        (
            "analysis.frequncy.points=3",
            "--set analysis.frequncy.points:1:1: 'frequncy' is not a key of analysis",
        ),
        ("=1", "--set :1:1: an empty name in the path; write it as a.b.c"),
    ],
)
def test_a_wrong_set_is_a_located_sentence(dynid, folder, assignment, message):
    code, out, err = dynid("run", "small.yaml", "--set", assignment)
    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert not (folder / "small.h5").exists()


def test_a_failed_expectation_is_exit_1_with_the_file_for_a_look(dynid, folder):
    code, out, err = dynid("run", "small.yaml", "--set", "expect.0.value=2")
    assert code == 1
    assert err == (
        "small.yaml:14:5: expectation failed: bond_graph/properties/m.f/F/dc_gain: dc_gain is 1, expected 2\n"
    )
    assert "0 of 1 expectation met" in out
    assert (folder / "small.h5").exists()


@pytest.mark.parametrize(("value", "failures"), [(1, "0"), (2, "1")])
@pytest.mark.usefixtures("folder")
def test_junit_counts_the_failures(dynid, value, failures):
    code, _, _ = dynid("run", "small.yaml", "-q", "--set", f"expect.0.value={value}", "--junit", "j.xml")
    root = ElementTree.parse("j.xml").getroot()
    assert code == int(failures)
    assert (root.get("tests"), root.get("failures")) == ("1", failures)
    assert float(root.get("time")) > 0
    assert len(root.findall(".//testcase")) == 1
    assert len(root.findall(".//failure")) == int(failures)


def test_junit_is_written_for_a_scene_that_expects_nothing(dynid, folder):
    (folder / "small.yaml").write_text((folder / "small.yaml").read_text().partition("expect:")[0])
    assert dynid("run", "small.yaml", "-q", "--junit", "j.xml")[0] == 0
    assert ElementTree.parse("j.xml").getroot().get("tests") == "0"


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--set", "graph.nodes.m.valu=1"], 2, "'valu' is not a key of graph.nodes.m"),
        (["--set", "graph.nodes.F=Sf", "--set", "graph.nodes.b=Sf"], 3, "junction 'one'"),
        (["-o", "nowhere/x.h5"], 4, "there is no folder nowhere"),
        (["-o", "small.yaml"], 2, "the result would overwrite the scene"),
    ],
)
@pytest.mark.parametrize("earlier", [True, False])
def test_an_error_that_ends_a_run_replaces_the_junit_file_of_an_earlier_one(
    dynid, folder, arguments, code, said, earlier
):
    if earlier:
        assert dynid("run", "small.yaml", "-q", "--junit", "j.xml")[0] == 0
    found, _, err = dynid("run", "small.yaml", "-q", "--junit", "j.xml", *arguments)
    assert found == code
    if arguments[-1] == "small.yaml" and not earlier:
        assert not (folder / "j.xml").exists()
        return
    root = ElementTree.parse("j.xml").getroot()
    assert [root.get(name) for name in ("tests", "failures", "errors")] == ["1", "0", "1"]
    [error] = root.findall(".//testcase/error")
    assert said in error.get("message")
    assert error.text in err


@pytest.mark.parametrize("name", ["small.yaml", "notes.txt"])
def test_an_error_overwrites_no_other_file_than_a_junit_file(dynid, folder, name):
    (folder / "notes.txt").write_text("mine")
    before = (folder / name).read_bytes()
    assert dynid("run", "small.yaml", "--set", "graph.nodes.m.valu=1", "--junit", name)[0] == 2
    assert (folder / name).read_bytes() == before


@pytest.mark.parametrize("output", ["small.yaml", "./small.yaml", "link.h5"])
def test_a_result_never_overwrites_its_scene(dynid, folder, output):
    before = (folder / "small.yaml").read_text()
    (folder / "link.h5").symlink_to("small.yaml")
    code, _, err = dynid("run", "small.yaml", "-o", output)
    assert code == 2
    assert "the result would overwrite the scene small.yaml" in err
    assert (folder / "small.yaml").read_text() == before


@pytest.mark.parametrize("junit", ["small.yaml", "small.h5"])
def test_junit_overwrites_neither_scene_nor_result(dynid, folder, junit):
    before = (folder / "small.yaml").read_text()
    code, _, err = dynid("run", "small.yaml", "--junit", junit)
    assert code == 2
    assert "would overwrite" in err
    assert (folder / "small.yaml").read_text() == before
    assert not (folder / "small.h5").exists()


SINGULAR = {
    "two efforts": (
        "nodes: {V1: Se, V2: Se, bus: 0, r: {type: R, value: 1}}\n  bonds: [V1 -> bus, V2 -> bus, bus -> r]",
        "r.f",
        r"s.yaml:4:\d+: effort sources 'V1' and 'V2' both fix the effort of junction 'bus'",
    ),
    "two flows": (
        "nodes: {V1: Sf, V2: Sf, bus: 1, r: {type: R, value: 1}}\n  bonds: [V1 -> bus, V2 -> bus, bus -> r]",
        "r.f",
        r"s.yaml:4:\d+: flow sources 'V1' and 'V2' both fix the flow of junction 'bus'",
    ),
    "a part that floats": (
        "nodes: {V1: Se, bus: 0, r: {type: R, value: 1}, x: 0, y: 0}\n  bonds: [V1 -> bus -> r, x -> y]",
        "r.f, x.e",
        r"s.yaml:4:\d+: the effort of 'x' and 'y' is not determined",
    ),
    "a loop without a solution": (
        "nodes: {V1: Se, a: 0, b: 1, c: 1, d: 0, r: {type: R, value: 1}, t: {type: TF, value: 2}}\n"
        "  bonds: [V1 -> a -> b -> d, a -> t -> c -> d -> r]",
        "r.f",
        r"s.yaml:4:\d+: source 'V1' meets a balance without a solution through 'c' and 'b'",
    ),
    "a contradiction that no output needs": (
        "nodes: {V1: Se, bus: 0, r: {type: R, value: 1}, x: 1, V2: Se}\n"
        "  bonds: [V1 -> bus -> r, bus -> x, V2 -> x]",
        "r.f",
        r"s.yaml:4:\d+: sources 'V1' and 'V2' contradict each other through 'x'",
    ),
}


@pytest.mark.parametrize("case", SINGULAR)
def test_a_graph_without_a_unique_solution_is_one_located_sentence_that_names_its_nodes(dynid, folder, case):
    graph, outputs, message = SINGULAR[case]
    text = (
        f"dynid: 1\nkind: bond-graph\ngraph:\n  {graph}\nanalysis: {{inputs: [V1], outputs: [{outputs}]}}\n"
    )
    (folder / "s.yaml").write_text(text)
    code, out, err = dynid("run", "s.yaml")
    assert (code, out) == (3, "")
    assert re.match(message, err)
    assert err.count("\n") == 1
    assert not (folder / "s.h5").exists()


def test_what_is_undetermined_is_a_warning_where_no_output_depends_on_it(dynid, folder):
    (folder / "s.yaml").write_text(UNDETERMINED)
    code, out, err = dynid("run", "s.yaml", "--report", "s.html")
    assert code == 0
    assert "T(s)    = 0.25" in out
    floats = "the flow of 'x' and 'y' is not determined"
    ring = "the flow through the bond 'b -> a' is not determined"
    assert [line.partition(":")[0] for line in err.splitlines()] == ["s.yaml"] * 2
    assert f"s.yaml: warning: {ring}" in err
    assert f"s.yaml: warning: {floats}" in err
    shown = dynid("show", "s.h5")[1]
    page = (folder / "s.html").read_text()
    for words in (ring, floats):
        assert f"warning: {words}" not in out
        assert words in shown
        assert f"{words[0].upper()}{words[1:]}" in html.unescape(page)
    said = [line.partition(": warning: ")[2] for line in err.splitlines()]
    assert list(read_result("s.h5")["bond_graph/warnings"].data) == said


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["smal.yaml"], "smal.yaml: no such file; did you mean 'small.yaml'?"),
        (["."], ". is a directory, not a scene file"),
        (
            ["small.yaml", "-o", "nowhere/x.h5"],
            "nowhere/x.h5 cannot be written: there is no folder nowhere. Make it first.",
        ),
        (["small.yaml", "-o", "."], ". cannot be written: it is not a regular file"),
        (
            ["small.yaml", "-o", "small.yaml/x.h5"],
            "small.yaml/x.h5 cannot be written: there is no folder small.yaml. Make it first.",
        ),
        (["small.yaml", "-o", "x" * 300], f"{'x' * 300} cannot be written: File name too long"),
        (
            ["small.yaml", "--junit", "nowhere/j.xml"],
            "nowhere/j.xml cannot be written: there is no folder nowhere. Make it first.",
        ),
    ],
)
def test_what_cannot_be_read_or_written_is_exit_4(dynid, folder, args, message):
    code, out, err = dynid("run", *args)
    assert (code, out, err) == (4, "", f"{message}\n")
    assert "nowhere" not in {path.name for path in folder.iterdir()}


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is write-protected from root")
def test_a_write_protected_result_stays(dynid, folder):
    target = folder / "small.h5"
    target.write_text("precious")
    target.chmod(0o444)
    code, _, err = dynid("run", "small.yaml")
    assert code == 4
    assert "write-protected" in err
    assert target.read_text() == "precious"


@pytest.mark.parametrize(
    ("error", "code"),
    [(KeyboardInterrupt, 130), (MemoryError, 3), (RecursionError, 3), (ZeroDivisionError, 3)],
)
def test_whatever_happens_in_a_run_the_old_result_stays_and_no_traceback_is_shown(
    dynid, folder, monkeypatch, error, code
):
    assert dynid("run", "small.yaml", "-q")[0] == 0
    before = (folder / "small.h5").read_bytes()

    def fail(*_):
        raise error

    monkeypatch.setattr("dynid.scene.kinds.bond_graph.run", fail)
    left, out, err = dynid("run", "small.yaml")
    assert (left, out) == (code, "")
    assert len(err.splitlines()) <= 2
    assert (folder / "small.h5").read_bytes() == before
    assert sorted(path.name for path in folder.iterdir()) == ["small.h5", "small.yaml"]


@pytest.mark.parametrize("wrong", ["graph.nodes.b.type=Q", "graph.nodes.b.type=Se"])
def test_a_failing_run_leaves_an_old_result_alone(dynid, folder, wrong):
    (folder / "small.h5").write_text("old")
    assert dynid("run", "small.yaml", "--set", wrong)[0] == 2
    assert (folder / "small.h5").read_text() == "old"


@pytest.mark.usefixtures("folder")
def test_an_error_that_nobody_thought_of_says_where_it_happened(dynid, monkeypatch):
    monkeypatch.setattr("dynid.scene.kinds.bond_graph.built_graph", lambda _: 1 / 0)
    code, _, err = dynid("run", "small.yaml")
    assert code == 3
    assert re.match(
        r"this is a fault of dynid itself \(ZeroDivisionError division by zero, dynid\.scene\.", err
    )


@pytest.mark.usefixtures("folder")
def test_setting_a_parameter_that_the_scene_does_not_have_is_refused(dynid):
    code, out, err = dynid("run", "small.yaml", "--set", "parameters.mass=3")
    assert (code, out) == (2, "")
    assert err == "--set parameters.mass:1:1: the scene has no parameter 'mass'; did you mean 'm'?\n"


def test_setting_a_part_of_a_joint_that_the_scene_does_not_have_is_refused(dynid, folder):
    (folder / "rod.yaml").write_text(
        "dynid: 1\nkind: identification\nstructure: {lumped: {masses: [1, 1]}}\n"
        "joints: {root: {dofs: [1], k: {value: 3}}, a.b: {dofs: [1, 2], k: {value: 3}}}\n"
        "analysis: {modes: {count: 2}}\n"
    )
    code, _, err = dynid("check", "rod.yaml", "--set", "joints.rooot.k.value=3")
    said = "--set joints.rooot.k.value:1:1: the scene has no joint 'rooot'; did you mean 'root'?\n1 fault\n"
    assert (code, err) == (2, said)
    new = ("--set", "joints.tip.k.value=4", "--set", "joints.tip.dofs=[2]")
    for fine in (("--set", "joints.root.k.value=4"), ("--set", "joints.a.b.k.value=4"), new):
        assert dynid("check", "rod.yaml", *fine)[0] == 0


MATRIX = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    G: Se
    H: Se
    j: 1
    m: {type: I, value: 2}
    b: {type: R, value: 1}
    k: {type: C, value: 0.5}
  bonds: [F -> j -> m, G -> j, H -> j, j -> b, j -> k]
analysis:
  outputs: [m.f, k.e, b.e]
  results: [transfer_function, zeros, poles, properties]
"""


def test_what_all_channels_share_is_said_once_and_many_channels_are_a_table_in_the_scenes_order(
    dynid, folder
):
    (folder / "matrix.yaml").write_text(MATRIX)
    code, run, _ = dynid("run", "matrix.yaml")
    assert code == 0
    assert run.count("-0.25 ± 0.9682j") == 1
    assert "  every channel\n    poles   -0.25 ± 0.9682j rad/s\n            stable" in run
    assert [line.strip() for line in run.splitlines() if " / " in line and "T(s)" not in line] == [
        *(f"{output} / {source}" for output in ("m.f", "k.e") for source in "FGH"),
        *(
            f"b.e / {source}  0 rad/s      2                1     0     0  marginal, not minimum phase"
            for source in "FGH"
        ),
    ]
    _, show, _ = dynid("show", "matrix.h5")
    assert run.split("every channel")[1].split("wrote")[0].strip() == show.split("every channel")[1].strip()


@pytest.mark.usefixtures("folder")
def test_long_lists_of_roots_and_formulas_are_wrapped_between_roots_and_terms(dynid):
    dynid("new", "chain", "--stages", "10", "--no-schema")
    code, said, _ = dynid("run", "chain.yaml")
    assert code == 0
    assert max(map(len, said.splitlines())) <= 112
    listed = said[said.index("    poles   ") : said.index("\n\n  frequency response")].split("\n")
    assert all(line.startswith(" " * 12) for line in listed[1:])
    poles, _, oscillations = " ".join(line[12:] for line in listed).partition(" rad/s ")
    assert len(oscillations.split(" · ")) == 10
    poles = poles.split(", ")
    assert len(poles) == 10
    assert all(re.fullmatch(r"-[\d.]+ ± [\d.]+j", pole) for pole in poles)


ONE = """
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, m: {type: I, value: 2}, n: 1, k: {type: C, value: 0.5}, loose: {type: R, value: 1}, g: Sf}
  bonds: [F -> n -> m, n -> k, g -> loose]
analysis: {inputs: [g], outputs: [m.f], frequency: {start: 3, stop: 3, points: 1}}
"""


def test_one_is_one_and_a_response_of_nothing_has_no_largest_value(dynid, folder):
    (folder / "one.yaml").write_text(ONE)
    code, said, _ = dynid("run", "one.yaml")
    assert code == 0
    assert "frequency response: 1 frequency, 3 rad/s\n" in said
    assert "m.f / g 0 all" in [" ".join(line.split()) for line in said.splitlines()]
    assert "at 1 frequency\n" in dynid("check", "--explain", "one.yaml")[1]


def test_who_wants_the_traceback_has_it(folder, monkeypatch):
    from dynid.cli import main

    def fails(_):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("dynid.scene.kinds.bond_graph.run", fails)
    monkeypatch.setenv("DYNID_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError, match="by nothing"):
        main(["run", str(folder / "small.yaml")])


@pytest.mark.usefixtures("folder")
def test_a_negative_value_is_warned_of_once_on_standard_error(dynid):
    warning = "not passive: I 'm' (-4) has a negative value and can give energy without end"
    for command in ("run", "check"):
        _, out, err = dynid(command, "small.yaml", "--set", "parameters.m=-4")
        place, _, said = next(line for line in err.splitlines() if "warning" in line).partition(": warning: ")
        assert (place.startswith("small.yaml:"), said) == (True, warning)
        assert err.count("warning") == 1
        assert "not passive" not in out
    assert "bond_graph/warnings" not in read_result("small.h5")  # they are of what is not determined


def test_doubts_about_the_scene_are_warnings_of_run_and_check_and_the_explanation_agrees(dynid, folder):
    text = (folder / "small.yaml").read_text().partition("expect:")[0]
    (folder / "small.yaml").write_text(f"{text}  results: [poles]\n")
    starts = [f"small.yaml:{line}:3: warning: nothing is computed with" for line in (11, 12)]
    code, out, err = dynid("run", "small.yaml", "--json")
    assert code == 0
    assert all(line.startswith(start) for line, start in zip(err.splitlines(), starts, strict=True))
    assert [text[:35] for text in json.loads(out)["warnings"]] == ["nothing is computed with the block "] * 2
    code, out, err = dynid("check", "--explain", "small.yaml")
    assert (code, err.count(": warning: ")) == (0, 2)
    assert "not requested" in out
    assert "frequencies" not in out
    assert "samples" not in out
    code, _, err = dynid("check", "-q", "small.yaml", "--set", "analysis.results=[time_response]")
    assert (code, err.count(": warning: ")) == (0, 1)
