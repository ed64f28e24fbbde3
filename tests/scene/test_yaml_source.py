import contextlib
import math
import os
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import FileError, SceneError
from dynid.scene.yaml.parser import MAX_CHARACTERS
from dynid.scene.yaml.source import apply_overrides, parse_source, read_source, set_values
from dynid.scene.yaml.writer import dump, plain
from dynid.suggestions import did_you_mean, did_you_mean_path, short_paths
from tests.work import at_most


def faults_of(text):
    with pytest.raises(SceneError) as caught:
        parse_source(text, "s.yaml")
    return [(fault.line, fault.column, fault.message) for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0), ("1.0e4", 1e4), (".5", 0.5), ("5.", 5.0), ("-.5e-3", -0.0005), ("+12", 12),
        ("-0", 0),
        ("007", 7), ("0o17", 15), ("0x1F", 31), (".inf", math.inf), ("-.INF", -math.inf), ("+.Inf", math.inf),
        ("~", None), ("null", None), ("NULL", None), ("true", True), ("FALSE", False),
        ("on", "on"), ("off", "off"), ("yes", "yes"), ("no", "no"), ("y", "y"), ("12:30", "12:30"),
        ("12:30:45", "12:30:45"), ("1_000", "1_000"), ("0b1", "0b1"), ("-0x1", "-0x1"),
        ("2024-01-02", "2024-01-02"),
        ("inf", "inf"), ("nan", "nan"), ("nULL", "nULL"), ("tRUE", "tRUE"), ("1e", "1e"), (".", "."),
        ("=", "="),
        ("'1'", "1"), ('"true"', "true"), ("''", ""), ("a**2 * b", "a**2 * b"),
        ("v_in -> body", "v_in -> body"),
        ("!!str 12", "12"), ("!!float 3", 3.0), ("! 5", "5"), ("!!int 0x10", 16),
    ],
)  # fmt: skip
def test_scalars_follow_yaml_1_2(text, value):
    found = parse_source(f"x: {text}").data["x"]
    assert found == value
    assert type(found) is type(value)


def test_a_truth_value_before_a_colon_is_a_word():
    assert parse_source("k: {start: 1, true: 2}\nfalse: true\n").data == {
        "k": {"start": 1, "true": 2},
        "false": True,
    }
    assert "given twice" in faults_of("true: 1\n'true': 2\n")[0][2]


def test_nan_is_a_number():
    assert math.isnan(parse_source("x: .NaN").data["x"])


@pytest.mark.parametrize(
    "bytes_", [b"\xef\xbb\xbfa: 1\n", b"a: 1\r\n", b"# title\n---\na: 1\n...\n", b"%YAML 1.2\n---\na: 1"]
)
def test_harmless_variations_read_the_same(tmp_path, bytes_):
    path = tmp_path / "s.yaml"
    path.write_bytes(bytes_)
    assert read_source(path).data == {"a": 1}


def test_places_of_keys_and_values():
    source = parse_source("analysis:\n  inputs: [v_in, F]\nnodes:\n  1: {type: I}\n", "s.yaml")
    marks = source.marks["analysis", "inputs"]
    assert (marks.key, marks.value) == ((2, 3), (2, 11))
    assert source.marks["analysis", "inputs", 1].value == (2, 18)
    assert source.marks["nodes", 1, "type"].value == (4, 13)
    assert str(source.fault(("analysis", "inputs"), "bad", key=True)) == "s.yaml:2:3: bad"


def test_what_is_missing_is_reported_at_its_holder():
    source = parse_source("title: x\nanalysis:\n  inputs: [a]\n", "s.yaml")
    assert str(source.fault(("analysis", "outputs"), "missing")) == "s.yaml:2:1: missing"


def test_all_faults_come_in_one_go():
    found = faults_of("a: !foo 1\nb: 1\nb: 2\n<<: 3\n? [k]\n: 5\nnull: 3\nc: *nowhere\n")
    assert [place[:2] for place in found] == [(1, 4), (3, 1), (4, 1), (5, 3), (7, 1), (8, 4)]
    assert "twice, first on line 2" in found[1][2]


def test_faults_before_a_syntax_error_are_kept():
    found = faults_of("a: 1\na: 2\nb: [1, 2\n")
    assert [place[0] for place in found] == [2, 4]
    assert "begins at line 3, column 4" in found[1][2]


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("a: b: c", 1, 5, "':' is not expected"),
        ("a:\n\t- b", 2, 1, "tab"),
        ("a: @x", 1, 4, "quotes"),
        ("a: 'x", 1, 6, "not closed"),
        ("- a\nb: 1", 2, 1, "list entry"),
        ("a: !foo!x 1", 1, 4, "tags"),
        ('a: "\\q"', 1, 5, "escape"),
        ("", 1, 1, "empty"),
        ("# only a comment\n", 1, 1, "empty"),
        ("a: 1\n---\nb: 2", 2, 1, "second document"),
        ("a: 1\nb: x\0y", 2, 5, "U+0000"),
        ('a: "x\\0y"', 1, 4, "NUL"),
        ("a: &x [1, *x]", 1, 11, "inside"),
        ("a: !!python/object/apply:os.getcwd []", 1, 4, "tag"),
        ("a: !!int x", 1, 4, "int"),
        ("a: 1e999", 1, 4, "too large"),
        ("a: " + "9" * 401, 1, 4, "400 digits"),
        ("a: 0x" + "f" * 100_000, 1, 4, "400 digits"),
        ("1.5: x", 1, 1, "key"),
        ("? {a: 1}\n: x", 1, 3, "key"),
    ],
)  # fmt: skip
def test_faults_say_where_and_what(text, line, column, words):
    [found] = faults_of(text)
    assert found[:2] == (line, column)
    assert words in found[2]


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("a: {R: 0,6}", [(1, 8, "0.6")]),
        ("a: {k: 9,0e4, c: 15}", [(1, 8, "9.0e4")]),  # 0e4 is a number, which no key can be
        ("a: {k: -9,5}", [(1, 8, "-9.5")]),
        ("{R: 0,6, L: 1,6, k: 2}", [(1, 5, "0.6"), (1, 13, "1.6")]),  # not as the key 6 given twice
        ("{k: 2*3,5}", [(1, 5, "2*3.5")]),
        ("{a: {b: 1,5, b: 2}}", [(1, 9, "1.5"), (1, 14, "given twice")]),
    ],
)
def test_a_decimal_comma_in_a_flow_mapping_is_reported_once_at_its_number(text, faults):
    found = faults_of(text)
    assert [each[:2] for each in found] == [each[:2] for each in faults]
    for each, (_, _, words) in zip(found, faults, strict=True):
        assert words in each[2]
        assert "given twice" in words or "decimals stand behind a point" in each[2]


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("{1: 2,3: 4}", {1: 2, 3: 4}),
        ("{a: 1, 2: }", {"a": 1, 2: None}),
        ("{a: '1',2: }", {"a": "1", 2: None}),
        ("{a: max(1,2)}", {"a": "max(1", "2)": None}),  # the expression says what is wrong
        ("a: 9\n0: \n", {"a": 9, 0: None}),
        ("[1,2,3]", [1, 2, 3]),
    ],
)
def test_commas_that_are_not_decimal_stay(text, data):
    assert parse_source(text).data == data


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "- " * 100_000,
        "{a: " * 100_000,
        "\n".join(f"{'  ' * depth}a:" for depth in range(100)),
        "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 90)),
        "a0: &a0 [" + "1, " * 99 + "1]\n"
        + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 100)}]\n" for i in range(1, 9)),
        "x: " + "a" * 2**24,
    ],
    ids=["flow", "block", "mappings", "indented", "alias tower", "alias bomb", "long"],
)  # fmt: skip
def test_hostile_sizes_are_refused(text):
    [found] = faults_of(text)
    assert "nested" in found[2] or "more than" in found[2] or "longer" in found[2]


def test_aliases_share_values_and_are_reported_where_they_stand():
    source = parse_source("a: &m {k: 1}\nb: *m\n")
    assert source.data == {"a": {"k": 1}, "b": {"k": 1}}
    assert source.fault(("b", "k"), "x").line == 2
    assert apply_overrides(source, ["b.k=2"]).data == {"a": {"k": 1}, "b": {"k": 2}}


def test_a_word_repeats_as_a_mapping_does():
    assert parse_source("a: &x 5\nb: *x\nc: [*x, *x]\n").data == {"a": 5, "b": 5, "c": [5, 5]}


def test_very_many_faults_end_at_a_number():
    found = faults_of("".join(f"k{n}: !what 1\n" for n in range(150)))
    assert [place[0] for place in found] == list(range(1, 101))


def test_of_characters_that_cannot_be_typed_the_first_ten_are_named():
    found = faults_of("a: " + "\x01x" * 30)
    assert [place[:2] for place in found] == [(1, 4 + 2 * k) for k in range(10)]


def test_bytes_that_are_not_utf8_have_a_place(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_bytes("title: ü\nname: ".encode() + b"caf\xe9")
    with pytest.raises(SceneError) as caught:
        read_source(path)
    assert (caught.value.faults[0].line, caught.value.faults[0].column) == (2, 10)
    path.write_bytes("a: 1".encode("utf-16"))
    with pytest.raises(SceneError, match="UTF-16"):
        read_source(path)


def test_what_cannot_be_read_is_a_file_error(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "scene.yaml").write_text("a: 1")
    cases = {
        "pipe": "regular",
        "": "directory",
        "scenee.yaml": "did you mean 'scene.yaml'",
        "a\0b": "cannot be read",
        "nowhere/scene.yaml": "no such file. To begin with a template: dynid new$",
        "large.yaml": "too large for a scene; put large data in files of their own",
    }
    with (tmp_path / "large.yaml").open("wb") as file:
        file.truncate(4 * MAX_CHARACTERS + 1)
    for name, words in cases.items():
        with pytest.raises(FileError, match=words):
            read_source(f"{tmp_path}/{name}")


@given(st.binary(max_size=60))
def test_random_bytes_give_data_or_a_scene_error(tmp_path_factory, raw):
    path = tmp_path_factory.getbasetemp() / "random.yaml"
    path.write_bytes(raw)
    with contextlib.suppress(SceneError):
        read_source(path)


@given(st.text("ab:-?*&!|>'\"%@`{}[], \n#~1.<=\\", max_size=40))
@settings(max_examples=100)
def test_random_yaml_gives_data_or_a_scene_error(text):
    found = []
    try:
        parse_source(text)
    except SceneError as error:
        found = [*error.faults]
    assert all(fault.line > 0 and fault.column > 0 and fault.message for fault in found)


KEYS = st.text(max_size=8).filter(lambda word: "\0" not in word) | st.integers(-(10**30), 10**30)
TRICKY = ["1e3", "on", "<<", "~", "0x1", ".inf", "- a", "a: b", " a", "x\n", "9" * 500, "#", "'", "1e999"]
TEXTS = st.text().filter(lambda word: "\0" not in word) | st.sampled_from(TRICKY)
LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXTS
DATA = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4)
)


@given(DATA.filter(lambda data: data is not None))
@settings(max_examples=100)
def test_what_is_dumped_reads_back_the_same(data):
    found = parse_source(dump(data)).data
    assert found == data
    assert repr(found) == repr(data)


@given(DATA.filter(lambda data: data is not None) | st.dictionaries(LEAVES, LEAVES, max_size=3))
@settings(max_examples=100)
def test_plain_data_are_what_their_text_says_or_refused(data):
    try:
        expected = repr(parse_source(dump(data)).data)
    except SceneError:
        with pytest.raises(ValueError, match=r"^$"):
            plain(data)
    else:
        with contextlib.suppress(ValueError):
            assert repr(plain(data)) == expected


def test_the_text_as_run_is_the_original_unless_changed():
    text = "a: 0x10 # sixteen\n"
    assert parse_source(text).resolved_text() == text
    changed = apply_overrides(parse_source(text), ["b=[1e3, '2']"])
    assert parse_source(changed.resolved_text()).data == {"a": 16, "b": [1000.0, "2"]}


@pytest.mark.parametrize(
    ("assignment", "path", "value"),
    [
        ("analysis.inputs=[a,b]", ("analysis", "inputs"), ["a", "b"]),
        ("parameters.m=1e3", ("parameters", "m"), 1000.0),
        ("parameters.m=a**2", ("parameters", "m"), "a**2"),
        ("loads.1.dof=3", ("loads", 1, "dof"), 3),
        ("gains.2=7", ("gains", 2), 7),
        ("gains.4=7", ("gains", 4), 7),
        ("new.deep.path=x=y", ("new", "deep", "path"), "x=y"),
        ("blank.x=1", ("blank", "x"), 1),
        ("vary.parameters.m.values=[2]", ("vary", "parameters.m", "values"), [2]),
        ("title=", ("title",), None),
        (f"new.{'9' * 401}=1", ("new", "9" * 401), 1),
    ],
)
def test_overrides_set_values(assignment, path, value):
    text = "title: t\nparameters: {m: 1}\nloads: [{dof: 1}, {dof: 2}]\ngains: {2: 5}\nblank:\n"
    source = parse_source(text + "vary: {parameters.m: {values: [1]}}\n")
    before = repr(source.data)
    item = apply_overrides(source, [assignment]).data
    for key in path:
        item = item[key]
    assert item == value
    assert repr(source.data) == before


def test_faults_of_overrides_name_the_option():
    source = parse_source("a: {b: {c: 1}}\nmass: 3\n")
    changed = apply_overrides(source, ["a.b=[1, {x: 2}]"])
    assert str(changed.fault(("a", "b", 1, "x"), "bad")) == "--set a.b:1:9: bad"
    assert ("a", "b", "c") not in changed.marks
    bad = ["a.b", "a..b=1", "=1", "mass.x=1", "a.b=[1", "a.b=1", "a.b.c.d=2"]
    with pytest.raises(SceneError) as caught:
        apply_overrides(source, bad)
    assert [fault.file for fault in caught.value.faults] == sorted(
        ["--set a.b", "--set a..b", "--set ", "--set mass.x", "--set a.b", "--set a.b.c.d"]
    )


@pytest.mark.parametrize(("text", "said"), [("5", "a number"), ("word", "a text"), ("true", "a Boolean")])
def test_a_scene_that_is_no_mapping_has_nothing_to_set(text, said):
    with pytest.raises(SceneError, match=f"the scene is {said}, not a mapping; it has no 'a'"):
        apply_overrides(parse_source(text), ["a=1"])


@pytest.mark.parametrize(
    ("word", "candidates", "expected"),
    [
        ("TR", ["Se", "Sf", "I", "C", "R", "TF", "GY", "0", "1"], "TF"),
        ("bdy", ["base", "body"], "body"),
        ("freqency", ["time", "frequency"], "frequency"),
        ("Mass", ["mass"], "mass"),
        ("mass", ["stiffness", "kind"], ""),
        ("x" * 10_000, ["x"], ""),
        ("a", [], ""),
    ],
)
def test_did_you_mean(word, candidates, expected):
    assert did_you_mean(word, candidates) == (f"; did you mean '{expected}'?" if expected else "")


@pytest.mark.parametrize("word", ["Node_500", "node-500", "nod_500", "nodes_500"])
def test_the_closest_of_many_alike_names_is_meant(word):
    names = [f"node_{number:03}" for number in range(1000)]
    assert did_you_mean(word, names) == "; did you mean 'node_500'?"


def test_reading_scenes_imports_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'pydantic'}"
    modules = "dynid.scene.yaml.source, dynid.arithmetic.expression"
    code = f"import sys, {modules}; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("paths", "short"),
    [
        (["parameters.b", "parameters.m"], ["b", "m"]),
        (["graph.nodes.n.value", "joints.upper.k.true"], ["n.value", "k.true"]),
        (["excitation.0.amplitude.1", "measurement.simulate.seed"], ["amplitude.1", "seed"]),
        (["joints.a.k.true", "joints.b.k.true"], ["joints.a.k.true", "joints.b.k.true"]),
        (["a.b, c.d", "0.value"], ["a.b, c.d", "0.value"]),
    ],
)
def test_short_names_of_paths_still_say_what_they_are(paths, short):
    assert short_paths(paths) == short


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("bond_graph/propertys", "bond_graph/properties"),
        ("bond_graph/properties/m.f/u/dc_gian", "bond_graph/properties/m.f/u/dc_gain"),
        ("bond_graph/properties/m.e/u", "bond_graph/properties/m.f/u"),
        ("study/sample", ""),
        ("bond_graph/dc_gain", "bond_graph/properties/m.f/u/dc_gain"),  # not the group that looks like it
        ("bond_graph/prope", "bond_graph/properties"),
        ("order", "bond_graph/properties/m.f/u/order"),
        ("m.f/u/order", "bond_graph/properties/m.f/u/order"),
        ("need/properties", "bond_graph/properties"),
    ],
)
def test_the_name_of_a_path_counts_before_its_groups(path, expected):
    known = [
        "bond_graph/properties/m.f/u/dc_gain",
        "bond_graph/properties/m.f/u/order",
        "bond_graph/need/part",
    ]
    assert did_you_mean_path(path, known) == (f"; did you mean '{expected}'?" if expected else "")


def test_a_name_at_many_places_is_suggested_as_a_pattern():
    known = ["g/m.f/u/poles", "g/m.f/v/poles", "g/m.f/u/zeros"]
    assert did_you_mean_path("poles", known) == "; did you mean 'g/m.f/u/poles' (1 more ends so: */poles)?"


def test_without_a_similar_name_the_group_is_listed():
    known = ["identification/parameters/name", "identification/parameters/estimate"]
    found = did_you_mean_path("identification/parameters/upper.k", known)
    assert found == "; 'identification/parameters' holds name, estimate"
    assert did_you_mean_path("plan/modes/estimated", known) == ""


@pytest.mark.parametrize("names", [70, 300, 800, 20_000])
def test_a_path_deeper_than_a_scene_is_refused_at_once(names):
    path = ".".join("a" * names)
    for change in (lambda s: apply_overrides(s, [f"{path}=1"]), lambda s: set_values(s, {path: 1})):
        refusal = r"a scene is at most 64 deep|nested more than 64 deep"
        with at_most(calls=200_000), pytest.raises(SceneError, match=refusal):
            change(parse_source("b: 1"))


def test_an_override_may_reach_the_greatest_depth_of_a_scene_and_no_more():
    path = ".".join("a" * 63)
    source = apply_overrides(parse_source("b: 1"), [f"{path}=[1]"])
    assert parse_source(dump(source.data)).data == source.data
    with pytest.raises(SceneError, match="nested more than 64 deep"):
        apply_overrides(parse_source("b: 1"), [f"{path}=[[1]]"])


def test_a_key_that_holds_dots_is_one_name_however_many():
    key = ".".join(["x", *"a" * 100])
    source = apply_overrides(parse_source(f"b: {{{key}: 1}}"), [f"b.{key}=2"])
    assert source.data == {"b": {key: 2}}
