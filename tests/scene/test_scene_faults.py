"""What every kind of scene has in common: all is checked, and each fault is said once, at its place."""

import copy
import json
import math
import re

import jsonschema
import pytest

from dynid.errors import SceneError
from dynid.scene.kind import KINDS
from dynid.scene.load import check_source
from dynid.scene.schema.json_schema import scene_schema
from dynid.scene.yaml.source import apply_overrides, parse_source
from dynid.scene.yaml.writer import dump
from tests.scene.example_scenes import ISOLATOR, JOINTS, MODAL, REDUCTIONS, STUDY, SYNTHESIS, check, faults_of

EXAMPLES = {
    "bond-graph": ISOLATOR,
    "identification": JOINTS,
    "reduction": REDUCTIONS,
    "synthesis": SYNTHESIS,
    "modal-analysis": MODAL,
}
WRONG = [
    None, True, -1, 0, 1.5, 10**399, 1e300, 5e-324, math.nan, math.inf, "", "x", "9**9**9", "1/0",
    "on", "{message}",
    "%s", [], [1], [[]], [None], {}, {"a": 1}, {1: 2}, {"kind": "step"}, {"kind": ["x"]}, {"type": "R"},
]  # fmt: skip
NOT_A_SENTENCE = re.compile(r"pydantic|[Ii]nput should|validation|None|True|False|\{'\w+':")


def paths_in(data, path=()):
    yield path
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in entries:
        yield from paths_in(value, (*path, key))


def replaced(data, path, value):
    if not path:
        return value
    data = copy.deepcopy(data)
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return data


@pytest.mark.parametrize("kind", EXAMPLES)
def test_the_documented_example_is_valid(kind):
    assert check(EXAMPLES[kind]).kind == kind


PLACES = [(kind, path) for kind, text in EXAMPLES.items() for path in paths_in(parse_source(text).data)]


@pytest.mark.parametrize(
    ("kind", "path"),
    PLACES,
    ids=lambda part: part if isinstance(part, str) else ".".join(map(str, part)) or "scene",
)
def test_any_wrong_value_anywhere_is_a_located_sentence_or_harmless(kind, path):
    """At each place every tenth value is tried, beginning with another one."""
    assert_located(kind, path, WRONG[PLACES.index((kind, path)) % 10 :: 10])


@pytest.mark.slow
@pytest.mark.parametrize("kind", EXAMPLES)
def test_every_wrong_value_at_every_place_is_a_located_sentence_or_harmless(kind):
    for path in paths_in(parse_source(EXAMPLES[kind]).data):
        assert_located(kind, path, WRONG)


def assert_located(kind, path, values):
    data = parse_source(EXAMPLES[kind]).data
    for wrong in values:
        text = dump(replaced(data, path, wrong))
        for fault in faults_of(text):
            line, column, message = fault.split(":", 2)
            assert 1 <= int(line) <= text.count("\n") + 1
            assert int(column) >= 1
            assert not NOT_A_SENTENCE.search(message), fault


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        (kind, path)
        for kind, text in EXAMPLES.items()
        for path in paths_in(parse_source(text).data)
        if path
        and isinstance(path[-1], str)
        and not {"parameters", "nodes", "joints", "initial", "substructures"} & {*path[-2:-1]}
    ],
    ids=lambda part: part if isinstance(part, str) else ".".join(map(str, part)),
)
def test_a_misspelt_key_is_named_once_with_the_key_that_is_meant(kind, path):
    if path == ("kind",):
        return
    data = parse_source(EXAMPLES[kind]).data
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    misspelt = f"{path[-1]}x"
    entries = [(misspelt if key == path[-1] else key, value) for key, value in holder.items()]
    found = faults_of(dump(replaced(data, path[:-1], dict(entries))))
    about_it = [fault for fault in found if f"'{misspelt}'" in fault]
    assert len(about_it) == 1
    if len(path[-1]) > 2:
        assert f"did you mean '{path[-1]}'?" in about_it[0]
    assert not any(f"needs the key '{path[-1]}'" in fault for fault in found)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[]", "1:1: a scene is a mapping; it starts with 'dynid: 1' and 'kind: …'"),
        (
            "dynid: 1\n",
            "1:1: a scene needs the key 'kind': bond-graph, identification, reduction, synthesis, "
            "modal-analysis, study",
        ),
        (
            "dynid: 1\nkind: bondgraph\n",
            "2:7: unknown kind 'bondgraph'; it is one of bond-graph, identification, reduction, synthesis, "
            "modal-analysis, study; did you mean 'bond-graph'?",
        ),
        (
            "dynid: 1\nkind: structure\n",
            "2:7: unknown kind 'structure'; it is one of bond-graph, identification, reduction, synthesis, "
            "modal-analysis, study. Modes and responses of a structure alone: kind: identification with "
            "'analysis', without 'measurement'; its reduced models: kind: reduction",
        ),
        (
            "excitation: [{dof: 2, column: Force [N]}]\n",
            "1:37: a mapping that opens with '{' lacks a comma or its '}'; put a text that holds '[' in "
            "quotes",
        ),
    ],
)
def test_what_is_no_scene_is_told_what_a_scene_is(text, fault):
    assert faults_of(text) == [fault]


_SI = "a value is a number in SI units, without its unit"


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("b: 50", "b: 50 kN.s/m", f"4:26: '50 kN.s/m': {_SI}; write 50000 (N.s/m)"),
        ("b: 50", "b: -1.5e2 kg", f"4:26: '-1.5e2 kg': {_SI}; write -150 (kg)"),
        ("b: 50", "b: 15ms", f"4:26: '15ms': {_SI}; write 0.015 (s)"),
        ("b: 50", "b: 5 %", f"4:26: '5 %': {_SI}; write 0.05"),
        ("value: b}", "value: 2 in}", f"11:25: '2 in': {_SI}; write 0.0508 (m)"),
        # the parameter m_s times 2, and gram or standard gravity
        ("value: b}", "value: 2 m_s}", f"11:25: '2 m_s': {_SI}; a product is written 2*m_s"),
        ("value: b}", "value: 2 g}", f"11:25: '2 g': {_SI}; a product is written 2*g"),
        # of frequencies the unit beside them decides
        ("start: 0.1,", "start: 0.1 Hz,", f"'0.1 Hz': {_SI}; write 0.1, its unit stands beside it"),
        ("start: 0.1,", "start: 0.1 rad/s,", f"'0.1 rad': {_SI}; a product is written 0.1*rad"),
        ("start: 0.1,", "start: 0.1 s,", f"'0.1 s': {_SI}; write 0.1 (s)"),
    ],
)
def test_a_value_with_a_unit_is_answered_with_what_to_write(right, wrong, said):
    [fault] = faults_of(ISOLATOR.replace(right, wrong, 1))
    assert said in fault


def test_a_frequency_in_hertz_is_answered_with_the_key_of_its_unit():
    text = ISOLATOR.replace("start: 0.1,", "start: 0.1 Hz,").replace(", unit: Hz}", "}")
    [fault] = faults_of(text)
    assert fault.endswith("a frequency is in rad/s, or in Hz where 'unit: Hz' stands beside it")


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("dynid: 1", "dynid: 2", "1:8: the scene has format 2; this dynid reads formats up to 1: update"),
        ("dynid: 1", "dynid: true", "1:8: 'dynid' cannot be 'true'; it can only be 1"),
        ("dynid: 1 ", "dynid: 1\ndynid: 1", "2:1: the key 'dynid' is given twice, first on line 1"),
        ("title: Passive tuned isolator", "title: 12", "3:8: 'title' must be a text, not 12"),
        ("b: 50", "b: 5O", "4:26: '5O' is neither a number nor a name"),
        (
            "b: 50",
            "b: 50 Ns/m",
            "4:26: '50 Ns': a value is a number in SI units, without its unit; a product",
        ),
        ("parameters:", "paramters:", "4:1: 'paramters' is not a key of a scene; did you mean 'parameters'?"),
        ("b: 50", "b: m_e, x: b + y", "4:34: no parameter 'y'"),
        ("b: 50", "b: 9**9**9", "4:26: the exact value has more than 20,000 binary digits"),
        ("b: 50", "b: .nan", "4:26: the value is not a number (nan)"),
        ("b: 50", "b: .inf", "4:26: the value is infinite, or too large for double precision"),
        ("b: 50", "b: yes", "4:26: no parameter 'yes'"),
        ("b: 50", "b: true", "4:26: true is not a number"),
        ("parameters: {", "parameters: {pi: 3, ", "4:18: 'pi' is the name of a constant; use another"),
        ("value: b}", "value: 1e-200 * 1e-200}", "11:25: the value is too close to zero for double"),
        ("value: b}", f"value: 1{'0' * 399}}}", "11:25: the value is too large for double precision"),
        ("value: b}", "value: mass}", "11:25: no parameter 'mass'"),
        ("rtol: 1.0e-9", "rtol: -1", "32:70: 'rtol' must be at least 0, not -1"),
        (", value: 1, rtol: 1.0e-9", "", "32:5: an expectation needs a 'value', or a 'min', 'max' or"),
        (", rtol: 1.0e-9", ", at: {omega: }", "32:76: 'omega' must be a text or a number, not nothing"),
        ("dc_gain, value: 1", "dc_gain, value: {a: 1}", "32:61: an expected value is a number, a text,"),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(right, wrong, fault):
    found = faults_of(ISOLATOR.replace(right, wrong, 1))
    assert len(found) == 1
    assert found[0].startswith(fault)


def test_parameters_that_define_each_other_are_each_told_the_circle():
    found = faults_of(ISOLATOR.replace("m_s: 10, b: 50", "m_s: b, b: m_s"))
    assert [fault.split(":")[1] for fault in found] == ["19", "25"]
    assert all("is defined by itself: b -> m_s -> b" in fault for fault in found)


def test_what_hangs_on_unreadable_parameters_or_nodes_is_not_reported_as_well():
    unread = re.sub(r"parameters: .*", "parameters: [1]", ISOLATOR)
    assert faults_of(unread) == ["4:13: 'parameters' must be a mapping, not a list"]
    no_nodes = re.sub(r"  nodes:\n(    .*\n)*", "  nodes: 3\n", ISOLATOR)
    assert faults_of(no_nodes) == ["6:10: 'nodes' must be a mapping, not 3"]


def test_words_of_older_yaml_are_texts():
    assert check(ISOLATOR.replace("Passive tuned isolator", "on")).title == "on"
    assert check(ISOLATOR.replace("Passive tuned isolator", "yes")).title == "yes"


def test_ten_mistakes_are_ten_sentences_in_the_order_of_the_file():
    found = faults_of(TEN)
    assert [fault.split(": ", 1)[0] for fault in found] == TEN_PLACES


TEN = """\
dynid: 1
kind: bond-graph
titel: Ten mistakes
parameters: {m: 2, k: m +, x: 9**9**9}
graph:
  nodes:
    F: Se
    m: {type: I, value: mm}
    b: {type: TR, value: 1}
    one: {type: 1, value: 3}
  bonds: [F -> one -> m, one -> bb]
analysis:
  inputs: [m]
  outputs: [one.e]
  frequency: {start: 0, stop: 10}
"""
TEN_PLACES = ["3:1", "4:23", "4:31", "8:25", "9:15", "10:10", "11:26", "13:12", "14:13", "15:14"]


@pytest.mark.parametrize(
    "path", ["parameters.b", "graph.nodes.b.value", "analysis.frequency.start", "expect.1.rtol"]
)
def test_a_decimal_comma_on_the_command_line_is_answered_with_the_point(path):
    with pytest.raises(SceneError) as raised:
        check_source(apply_overrides(parse_source(ISOLATOR, "s.yaml"), [f"{path}=0,02"]))
    [fault] = raised.value.faults
    assert fault.file == f"--set {path}"
    assert "decimals stand behind a point: did you mean 0.02?" in fault.message
    assert raised.value.exit_code == 2


def test_the_command_line_sets_values_before_anything_is_checked():
    source = parse_source(ISOLATOR, "s.yaml")
    changed = apply_overrides(source, ["analysis.frequency.points=1e12", "graph.nodes.b.type=Q"])
    with pytest.raises(SceneError) as caught:
        check_source(changed)
    assert [str(fault) for fault in caught.value.faults] == [
        "--set analysis.frequency.points:1:1: 'points' must be a whole number, not 1000000000000.0",
        "--set graph.nodes.b.type:1:1: unknown node type 'Q'; it is one of Se, Sf, I, C, R, TF, GY, 0, 1, "
        "TL, structure",
    ]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_the_json_schema_accepts_the_example_and_refuses_an_unknown_key(kind):
    schema = json.loads(json.dumps(scene_schema(KINDS[kind].load("model"))))
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    data = parse_source((EXAMPLES | {"study": STUDY})[kind]).data
    assert validator.is_valid(data)
    assert not validator.is_valid({**data, "titel": "x"})
    assert not validator.is_valid({**data, "kind": "other"})


@pytest.fixture(scope="module")
def graph_schema():
    return jsonschema.Draft202012Validator(scene_schema(KINDS["bond-graph"].load("model")))


@pytest.mark.parametrize(
    ("node", "valid"),
    [
        *((node, True) for node in ("Se", 0, "1", {"type": "R", "value": 1})),
        *((node, False) for node in ("XX", 2, True, {"type": "XX"})),
    ],
)
def test_the_json_schema_knows_the_types_of_nodes(graph_schema, node, valid):
    data = parse_source(ISOLATOR).data
    changed = replaced(data, ("graph", "nodes", "base"), node)
    assert graph_schema.is_valid(changed) is valid


@pytest.mark.parametrize(("unit", "valid"), [({}, True), ({"unit": "Hz"}, False)])
def test_the_json_schema_knows_which_signals_have_a_unit(graph_schema, unit, valid):
    changed = replaced(parse_source(ISOLATOR).data, ("analysis", "time", "input"), {"kind": "step", **unit})
    assert graph_schema.is_valid(changed) is valid


@pytest.mark.parametrize(
    ("scene", "key", "said"),
    [
        (JOINTS, "modes", "write it under 'analysis': analysis: {modes: {count: 10}}"),
        (JOINTS, "time", "write it under 'analysis'"),
        (ISOLATOR, "outputs", "write it under 'analysis'"),
        (
            REDUCTIONS,
            "modes",
            "a scene of kind 'identification' lists modes, by analysis: {modes: {count: 10",
        ),
    ],
)
def test_a_key_of_the_analysis_at_the_top_level_has_a_remedy(scene, key, said):
    (found,) = faults_of(f"{scene}\n{key}: {{}}\n")
    assert f"'{key}' is not a key of a scene; {said}" in str(found)
