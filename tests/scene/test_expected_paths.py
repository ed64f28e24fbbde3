"""Expectations of paths that no run of a bond graph gives are found before it; others never are."""

import ast
import re
from dataclasses import fields
from pathlib import Path

import pytest

import dynid
from dynid.bondgraph.analysis_request import MARGINS, PROPERTIES
from dynid.checks import check_expectations
from dynid.checks.expectations import axis_of
from dynid.errors import SceneError
from dynid.lti.margins import Bandwidth, Margins
from dynid.lti.step_info import StepInfo
from dynid.scene.kinds import bond_graph
from dynid.scene.kinds.expected_paths import impossible_paths
from dynid.scene.kinds.result_layout import ATTRIBUTES, LAYOUT, names_in
from dynid.scene.load import check_source, load_scene, validated
from dynid.scene.run import run_scene, scene_doubts
from dynid.scene.yaml.source import apply_overrides, parse_source
from tests.scene.example_scenes import ISOLATOR, check

CONFIGS = Path(__file__).parents[2] / "configs"
BASE = "bond_graph/properties"
ALL = (
    "[transfer_function, zeros, poles, properties, hidden_modes, step_info, bandwidth, energy, "
    "sensitivities, frequency_response, time_response]"
)
RESULTS = "[transfer_function, zeros, poles, properties, frequency_response, time_response]"


def expecting(path):
    return ISOLATOR.partition("expect:")[0] + f"expect:\n  - {{path: {path}, value: true}}\n"


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (f"{BASE}/m_s.f/v_in/stabel", "no channel has the property 'stabel'; did you mean 'stable'?"),
        (f"{BASE}/m_s.f/v_in/settling_tim", "did you mean 'settling_time'?"),
        (f"{BASE}/m_s.f/F/stable", "'F' is not an input; there are: v_in"),
        (f"{BASE}/m_s.e/v_in/stable", "'m_s.e' is not an output; did you mean 'm_s.f'?"),
        ("bond_graph/transfer_function/I_f.f/v_in/poles", "'I_f.f' is not an output"),
    ],
)
def test_a_path_that_no_run_can_give_is_a_fault_at_its_place(path, said):
    [fault] = impossible_paths(check(expecting(path)))
    assert (fault.line, fault.column) == (31, 12)
    assert said in fault.message


@pytest.mark.parametrize(
    "path",
    [
        f"{BASE}/m_s.f/v_in/stable",
        f"/{BASE}/m_s.f/v_in/stable",
        f"{BASE}/m_s.f/v_in/natural_frequency",
        "bond_graph/transfer_function/m_s.f/v_in/unit",
        "kind",
        "bond_graph/engine",
    ],
)
def test_other_paths_are_left_to_the_run(path):
    scene = check(expecting(path))
    assert scene_doubts(scene) == []
    assert list(impossible_paths(scene)) == []


def test_bounds_of_poles_need_their_part():
    poles = "path: bond_graph/transfer_function/m_s.f/v_in/poles"
    text = expecting("x").replace("path: x, value: true", f"{poles}, at: {{pole: 1}}, max: -1")
    [fault] = impossible_paths(check(text))
    assert text.splitlines()[fault.line - 1][fault.column - 1 :].startswith(("max: -1", "-1"))
    assert fault.message == (
        "'max' needs real numbers, and 'poles' are complex; add part: real, imaginary or magnitude"
    )
    assert list(impossible_paths(check(text.replace("max: -1", "part: real, max: -1")))) == []
    assert list(impossible_paths(check(text.replace("max: -1", "max_abs: 1")))) == []


def test_margins_of_a_graph_without_loops_are_a_fault():
    [fault] = impossible_paths(check(expecting("bond_graph/margins/phase")))
    assert "a graph without loops has no margins" in fault.message


def collecting(name, *paths, vary="parameters.m: [1, 2]"):
    """Return the faults in `collect` of a study of a shipped scene, with the line of each."""
    base = load_scene(CONFIGS / f"{name}.yaml")
    collect = "".join(f"  - {path}\n" for path in paths)
    text = f"dynid: 1\nkind: study\nscene: x.yaml\nvary: {{{vary}}}\ncollect:\n{collect}"
    study = validated(parse_source(text))
    return [(fault.line, fault.message) for fault in impossible_paths(base, study)]


def test_a_study_cannot_collect_what_no_sample_gives():
    name, margin = "isolator_controlled", "bond_graph/margins"
    good = [f"{margin}/phase", margin, f"{margin}/phase_*", "study/x", f"{BASE}", "bond_graph/engine"]
    assert collecting(name, *good) == []
    found = collecting(name, f"{margin}/phase", f"{margin}/phase_margin", f"{BASE}/no.f/v_in/order")
    assert [line for line, _ in found] == [7, 8]
    assert found[0][1] == "loops have no margin 'phase_margin'; did you mean 'phase'?"
    assert "'no.f' is not an output" in found[1][1]


def test_outputs_that_a_study_varies_may_be_collected():
    vary = "analysis.outputs.0: [no.f, m_s.f]"
    assert collecting("isolator_controlled", f"{BASE}/no.f/v_in/order", vary=vary) == []


def test_the_known_margins_are_those_of_a_result():
    every = {field.name for field in fields(Margins)} | {"loop"}
    assert every <= MARGINS
    assert {f"bond_graph/margins/{name}" for name in every} <= set(
        run_scene(load_scene(CONFIGS / "isolator_controlled.yaml"))
    )


def test_a_property_of_a_result_that_is_not_requested_is_a_fault():
    [fault] = impossible_paths(check(expecting(f"{BASE}/m_s.f/v_in/overshoot")))
    assert (fault.line, fault.column) == (31, 12)
    assert fault.message.startswith("'overshoot' comes with the result 'step_info', which 'results' does not")
    requested = check(expecting(f"{BASE}/m_s.f/v_in/overshoot").replace(RESULTS, ALL))
    assert list(impossible_paths(requested)) == []


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("bond_grap/properties/m_s.f/v_in/stable", "no group 'bond_grap'; did you mean 'bond_graph'?"),
        ("identification/parameters/estimate", "a result of kind bond-graph has no group 'identification'"),
        ("bond_graph/propertes/m_s.f/v_in/stable", "no results 'propertes'; did you mean 'properties'?"),
        ("bond_graph/nothing/x", "a bond graph has no results 'nothing'; there are: causality, "),
        ("bond_graph/state_space/A", "'state_space' comes with the result 'state_space', which 'results'"),
        ("bond_graph/energy/poles", "'energy' comes with the result 'energy', which 'results' does not"),
        ("bond_graph/transfer_function/m_s.f/v_in/pole_s", "there is no 'pole_s' in bond_graph/transfer"),
    ],
)
def test_a_path_of_what_is_not_computed_is_a_fault_at_its_place(path, said):
    scene = check(expecting(path))
    [fault] = impossible_paths(scene)
    assert (fault.line, fault.column) == (31, 12)
    assert said in fault.message
    (outcome,) = check_expectations(run_scene(scene), [{"path": path, "value": True}])
    assert not outcome.passed  # the run has nothing there either
    assert "is not in the result" in outcome.message


@pytest.mark.parametrize(
    ("name", "analysis", "said"),
    [
        ("numerator", "engine: float", "'engine: float' forms no 'numerator'"),
        ("gain", "engine: exact", "in place of 'gain'"),
        ("zeros", "results: [transfer_function]", "'zeros' comes with the result 'zeros'"),
        ("poles", "results: [transfer_function, zeros]", "'poles' comes with the result 'poles'"),
    ],
)
def test_what_the_engine_or_the_results_leave_out_of_a_channel_is_a_fault(name, analysis, said):
    path = f"bond_graph/transfer_function/m_s.f/v_in/{name}"
    scene = check(expecting(path).replace(f"results: {RESULTS}", analysis))
    [fault] = impossible_paths(scene)
    assert said in fault.message
    assert path not in run_scene(scene)


def test_an_estimate_is_chosen_by_its_label():
    text = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1, 2], links: [{dofs: [1], k: 2000, c: 3}]}}
joints: {hinge: {dofs: [1, 2], k: {start: 1.0e4, true: 2.0e4}, c: 2}}
excitation: [{dof: 2, kind: multisine, amplitude: [10, 10], frequency: [30, 90]}]
measurement:
  step: 0.002
  samples: 400
  channels: [{dof: 1, quantity: velocity}]
  simulate: {noise_ratio: 0.01, seed: 1}
expect:
  - {path: identification/parameters/hinge.k/estimate, value: 1}
  - {path: identification/parameters/low/hinge.k, min: 1}
  - {path: identification/parameters/low, at: {parameter: hinge.k}, min: 1}
"""
    first, second = impossible_paths(check(text))
    assert (first.line, second.line) == (13, 14)
    assert "write path: identification/parameters/estimate, at: {parameter: hinge.k}" in first.message
    assert "write path: identification/parameters/low, at: {parameter: hinge.k}" in second.message


def test_a_response_without_its_block_cannot_be_expected():
    text = expecting("bond_graph/time_response/response").replace(f"results: {RESULTS}", "engine: auto")
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("time:")]
    [fault] = impossible_paths(check("\n".join(lines)))
    assert "'time_response' needs the block 'time' in 'analysis'" in fault.message


REDUCED = """dynid: 1
kind: reduction
structure:
  lumped: {masses: [1, 2, 1], links: [{dofs: [1], k: 1}, {dofs: [1, 2], k: 2}, {dofs: [2, 3], k: 1}]}
reduction: [{method: guyan, masters: [1, 3]}, {method: guyan, masters: [2]}]
expect:
  - {path: PATH, min: 0}
"""


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("reduction/serep/mac", "no reduction is called 'serep'; there are: frf, guyan, guyan_2, need"),
        ("reduction/guyan_3/mac", "no reduction is called 'guyan_3'; did you mean 'guyan"),
        (
            "reduction/guyan/frequencis",
            "there is no 'frequencis' in reduction/guyan; did you mean 'frequencies'?",
        ),
        ("bond_graph/properties/a/b/stable", "a result of kind reduction has no group 'bond_graph'"),
    ],
)
def test_a_reduction_that_is_not_made_cannot_be_expected(path, said):
    [fault] = impossible_paths(check(REDUCED.replace("PATH", path)))
    assert (fault.line, fault.column) == (7, 12)
    assert said in fault.message
    for possible in ("reduction/guyan/frequencies", "reduction/guyan_2/mac", "reduction/need/part"):
        assert list(impossible_paths(check(REDUCED.replace("PATH", possible)))) == []


def test_the_known_properties_are_those_of_the_results():
    for name, kind, status in (("step_info", StepInfo, "step"), ("bandwidth", Bandwidth, "bandwidth")):
        own = {field.name for field in fields(kind) if field.name != "status"}
        assert PROPERTIES[name] == {*own, f"{status}_status"}
    result = run_scene(check(ISOLATOR.replace(RESULTS, ALL)))
    found = {path.split("/")[4] for path in result if path.startswith(f"{BASE}/")}
    known = set().union(*PROPERTIES.values())
    assert found <= known
    assert known - found <= {*PROPERTIES["step_info"], "dc_gain", "zero_stability"}  # may be undefined


#: Scenes that run in well below a second; the others are slow tests.
FAST = [
    "isolator_controlled",
    "beam_reduction",
    "synthesis_impedance",
    "table3",
]
SCENES = sorted(
    path.stem for path in CONFIGS.glob("*.yaml") if "kind: study" not in path.read_text(encoding="utf-8")
)


def expecting_all(file, paths, bound="value"):
    """Return a shipped scene that expects paths, and the number of the line of the first one."""
    text = file.read_text().partition("\nexpect:")[0].rstrip() + "\nexpect:\n"
    lines = "".join(f"  - {{path: '{path}', {bound}: 1}}\n" for path in paths)
    return check_source(apply_overrides(parse_source(text + lines, str(file)), ())), text.count("\n") + 1


def stored_paths(result):
    attributes = (f"{group}/{name}" for group, own in result.group_attrs.items() for name in own)
    return [*result, *attributes, *(f"{path}/{name}" for path in result for name in result[path].attrs)]


def spoiled_paths(paths):
    """Yield paths of which one part is changed, each beginning of a path once."""
    seen = set()
    for parts in (path.split("/") for path in paths):
        for place, part in enumerate(parts):
            for other in (f"{part}_x", part[1:] + part[:1], "nothing"):
                changed = (*parts[:place], other)
                if changed not in seen:
                    seen.add(changed)
                    yield "/".join([*changed, *parts[place + 1 :]])


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]
)
def test_every_path_of_a_result_may_be_expected_and_no_other(name):
    file = CONFIGS / f"{name}.yaml"
    result = run_scene(load_scene(file))
    every = stored_paths(result)
    assert list(impossible_paths(expecting_all(file, every)[0])) == []
    bounded, first = expecting_all(file, every, "min")
    refused = [every[fault.line - first] for fault in impossible_paths(bounded)]
    assert all(result[path].dtype.kind == "c" for path in refused)
    spoiled = list(spoiled_paths(every))
    outcomes = check_expectations(result, [{"path": path, "value": 1} for path in spoiled])
    absent = [outcome.path for outcome in outcomes if "is not in the result" in outcome.message]
    assert len(absent) > 0.9 * len(spoiled)
    expecting_absent, first = expecting_all(file, absent)
    found = {absent[fault.line - first] for fault in impossible_paths(expecting_absent)}
    assert [path for path in absent if path not in found] == []


def _beginnings(path):
    parts = path.split("/")
    return ["/".join(parts[:depth]) for depth in range(1, len(parts) + 1)]


#: Axes whose labels the scene says, by beginnings of the groups: of its grids, and numbers up to a count.
GRIDS = {
    "omega": ("bond_graph/frequency_response", "bond_graph/port", "bond_graph/design", "bond_graph/energy",
              "structure/frequency_response", "reduction/frf", "identification/measurement",
              "identification/residual_spectrum"),
    "time": ("bond_graph/time_response", "structure/time_response", "identification"),
}  # fmt: skip
COUNTS = {
    "mode": ("bond_graph/properties", "bond_graph/energy", "structure/modes", "reduction/",
             "identification/modes"),
    "pole": ("bond_graph/transfer_function", "bond_graph/sensitivities", "bond_graph/port"),
    "zero": ("bond_graph/transfer_function", "bond_graph/sensitivities", "bond_graph/port"),
    "natural_mode": ("bond_graph/port", "bond_graph/reduction"),
    "branch": ("bond_graph/root_locus",),
    "optimum": ("bond_graph/design",),
}  # fmt: skip


def _labels_of(result, axes):
    """Yield path, dimension and labels of the first array with each axis in each group."""
    seen = set()
    for path, variable in result.items():
        for dim, length in zip(variable.dims, variable.shape, strict=True):
            key = (path.rpartition("/")[0], dim)
            if length and key not in seen and path.startswith(axes.get(dim, ())):
                seen.add(key)
                yield path, dim, axis_of(result, path, dim, length).labels


def _labels_beyond(scene, result):
    """Yield labels that arrays do not have: between, before and behind those of grids, above any count."""
    for path, dim, labels in _labels_of(result, GRIDS):
        middle = len(labels) // 2
        between = [float(labels[middle - 1 : middle + 1].mean())] if len(labels) > 1 else []
        yield from ((path, dim, label) for label in (*between, labels[0] - 1e-3, labels[-1] * 1.01))
    graph, control = getattr(scene.model, "graph", None), getattr(scene.model, "control", None)
    uncounted = graph is not None and any(node.type == "TL" for node in graph.nodes.values())
    uncounted |= control is not None and any(loop.controller.sample is not None for loop in control.loops)
    for path, dim, _ in _labels_of(result, COUNTS):
        if not uncounted:  # lines and sampled controllers have roots of their own
            yield path, dim, 100_000
    numbered = dict.fromkeys({*COUNTS, "step", "direction", "root", "pair", "lag"}, "")
    yield from ((path, dim, k) for path, dim, _ in _labels_of(result, numbered) for k in (0, -2, 1.5))
    exact = {} if scene.kind != "reduction" else {"mode": ("reduction/",)}
    if scene.kind == "bond-graph" and scene.model.design is None and scene.model.operating_point is None:
        exact = {"step": "bond_graph/"}
    if scene.kind == "identification":
        listed = (
            scene.model.structure_analysis is not None and scene.model.structure_analysis.modes is not None
        )
        exact = {"mode": ("structure/modes",) * listed + ("identification/modes",)}
        exact["direction"] = "identification/"
    yield from ((path, dim, len(labels) + 1) for path, dim, labels in _labels_of(result, exact))


def _labels_within(result):
    axes = {dim: (*GRIDS.get(dim, ()), *COUNTS.get(dim, ())) for dim in GRIDS | COUNTS}
    axes |= dict.fromkeys(("step", "direction", "root", "pair", "lag"), "")
    for path, dim, labels in _labels_of(result, axes):
        yield from ((path, dim, label) for label in (labels[0], labels[len(labels) // 2], labels[-1]))


def _of_other_channels(result):
    """Return paths of derived quantities under the name of an input for the output, and of no record."""
    derived = [
        path.split("/") for path in result if re.match(f"{DERIVED}/(zeros|gains|frequency_resp)", path)
    ]
    swapped = ["/".join([*parts[:3], parts[4], parts[3], *parts[5:]]) for parts in derived]
    several = "identification/measurement/record_1/measured" in result
    record = "measured" if several else "record_1/measured"
    records = [f"identification/measurement/{name}" for name in (record, "record_1001/measured")]
    return swapped + records * ("identification/parameters/estimate" in result)


def expecting_labels(file, labels):
    """Return a shipped scene that expects entries with labels, and the number of the line of the first."""
    text = file.read_text().partition("\nexpect:")[0].rstrip() + "\nexpect:\n"
    paths = [(path, f"at: {{{dim}: {float(label)!r}}}") for path, dim, label in labels]
    lines = "".join(f"  - {{path: '{path}', {at}, value: 1}}\n" for path, at in [("kind", "max: 1"), *paths])
    return check_source(apply_overrides(parse_source(text + lines, str(file)), ())), text.count("\n") + 2


#: Scenes that run in a fraction of a second.
QUICK = [*FAST, "isolator_design", "isolator_transmissibility", "suspension_measured"]
QUICK += ["beam_frf", "beam_joints", "chain_modes", "motor_shaft", "two_tank"]


#: Groups that follow from the data of a run, not from requests of the scene alone.
OF_DATA = {
    *("accuracy", "structure", "structure/nodes"),  # of `run --accuracy`; doubts about entries
    *("identification/rejected", "identification/equivalent_optima", "identification/first_pass"),
    "identification/identifiability/interchangeable",
    *("identification/modes/directions", "identification/modes/trade_off/frequencies"),
    *("identification/modes/trade_off/shapes", "structure/complex_modes"),  # a stiffness may be complex
    "identification/nonlinearity",  # of joints along one direction
}
#: Derived quantities that nobody requests are left out of large systems and of what is not converged.
DERIVED = "identification/derived"


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]
)
def test_groups_and_labels_are_refused_where_the_run_has_none(name):
    """Groups of other results, frequencies and times between those of the grid, numbers above the count."""
    file = CONFIGS / f"{name}.yaml"
    scene = load_scene(file)
    result = run_scene(scene)
    groups = {path.rpartition("/")[0] for path in result} | set(result.group_attrs)
    present = {group for path in groups for group in _beginnings(path)}
    unrequested = DERIVED not in present or not result.group_attrs[DERIVED].get("requested", True)
    absent = [
        f"{group}/{names.split()[0]}"
        for group, names in LAYOUT.items()
        if names and "<" not in group and group not in present | OF_DATA
        if not (group.startswith(DERIVED) and getattr(scene.model, "derived", None) is None and unrequested)
    ]
    absent += _of_other_channels(result)
    expected, first = expecting_all(file, absent)
    refused = {absent[fault.line - first] for fault in impossible_paths(expected)}
    assert [path for path in absent if path not in refused] == []
    labels = list(_labels_beyond(scene, result))
    expected, first = expecting_labels(file, labels)
    refused = {fault.line - first for fault in impossible_paths(expected)}
    assert [label for k, label in enumerate(labels) if k not in refused] == []
    inside = list(_labels_within(result))
    assert list(impossible_paths(expecting_labels(file, inside)[0])) == []


@pytest.mark.parametrize(
    ("name", "path", "at", "said"),
    [
        ("isolator_controlled", "bond_graph/margins/phase", "{loop: nothing}", "there is no loop 'nothing'"),
        ("isolator_controlled", "bond_graph/margins/phase", "{lopp: 1}", "no dimension 'lopp'; did you mean"),
        ("two_tank", "bond_graph/time_response/response", "{output: tank_3.e}", "did you mean 'tank_"),
        (
            "table3",
            "identification/parameters/estimate",
            "{parameter: A.cc}",
            "there are: link.c, link.k, turn.k",
        ),
        ("suspension", "identification/parameters/estimate", "{parameter: m4}", "no parameter 'm4'"),
        ("beam_reduction", "reduction/guyan/mac", "{mode: 0}", "they are numbered from 1"),
        ("beam_reduction", "reduction/guyan/mac", "{mode: first}", "they are numbered from 1"),
        ("beam_reduction", "reduction/frf/frac", "{method: gyan}", "did you mean 'guyan'?"),
        ("suspension", "identification/measurement/measured", "{time: soon}", "a number is meant, s"),
    ],
)
def test_a_label_that_no_array_has_is_refused_at_its_place(name, path, at, said):
    file = CONFIGS / f"{name}.yaml"
    text = file.read_text().partition("\nexpect:")[0].rstrip()
    text += f"\nexpect:\n  - {{path: '{path}', at: {at}, min: 0}}\n"
    [fault] = impossible_paths(check_source(apply_overrides(parse_source(text, str(file)), ())))
    assert said in fault.message
    column = text.splitlines()[-1].index(at) + 2
    assert fault.line == text.count("\n")
    assert column <= fault.column <= column + len(at)


@pytest.mark.parametrize(
    ("name", "block", "path", "said"),
    [
        ("suspension", "derived: [zeros]", f"{DERIVED}/zeros/x/y/value", "'x' is not an output; there are"),
        ("suspension", "derived: [zeros]", f"{DERIVED}/zeros/2.velocity/y/value", "'y' is not an input"),
        ("beam_frf", "derived: [zeros]", f"{DERIVED}/zeros/x/y/value", "'x' is not an output; there are"),
        ("beam_reduction", "", "structure/modes/omega", "no results 'structure/modes'; they stand in"),
        ("chain_modes", "", f"{DERIVED}/zeros/x/y/value", "nothing is derived from measured modes alone"),
        ("suspension", "derived: []", f"{DERIVED}/zeros/x/y/value", "'derived' is empty"),
        (
            "suspension",
            "derived: [zeros]",
            f"{DERIVED}/poles/value",
            "'poles' is not in the list 'derived'; add it",
        ),
    ],
)
def test_a_group_that_no_block_requests_is_refused_with_the_block(name, block, path, said):
    file = CONFIGS / f"{name}.yaml"
    text = file.read_text().partition("\nexpect:")[0].rstrip()
    text += f"\n{block}\nexpect:\n  - {{path: '{path}', min: 0}}\n"
    [fault] = impossible_paths(check_source(apply_overrides(parse_source(text, str(file)), ())))
    assert said in fault.message


RECORDS = """dynid: 1
kind: identification
structure: {lumped: {masses: [1, 2], links: [{dofs: [1], k: 2000, c: 3}]}}
joints: {hinge: {dofs: [1, 2], k: {start: 1.0e4, true: 2.0e4}, c: 2}}
excitation: [{dof: 2, kind: multisine, amplitude: [10, 10], frequency: [30, 90]}]
identifiability: true
measurement:
  channels: [{dof: 1, quantity: velocity, delay: 0}]
  step: 0.002
  simulate: {noise_ratio: 0.01, seed: 1}
  records: [{samples: 250}, {samples: 180, step: 0.005, simulate: {noise_ratio: 0.01, settle: 0.5}}]
expect:
"""


@pytest.mark.parametrize("delay", [0, 0.0007])
def test_labels_of_several_records_are_refused_where_the_run_has_none(delay):
    """What has no label in the result is refused; times that a delay may cut off are left to the run."""
    labels = [
        (f"identification/{group}/record_{number}/{name}", dim, label)
        for number in (1, 2, 3)
        for group, name, dim, values in (
            ("measurement", "measured", "time", (0.498, 0.5, 0.895, 0.0025)),
            ("history", "estimate", "time", (0.498, 0.5, 0.895, -0.002)),
            ("residual_spectrum", "amplitude", "omega", (0, 1, 3141.6)),
        )
        for label in values
    ]
    labels += [("identification/measurement/measured", "time", 0.1)]
    labels += [("identification/identifiability/singular_value", "direction", k) for k in (1, 2, 0)]
    names = ("1.velocity", "record_2.1.velocity", "1.velocty")
    labels += [("identification/measurement/record_2/predicted", "channel", name) for name in names]
    labels += [("identification/diagnostics/residual_ratio", "channel", name) for name in names]
    lines = [f"  - {{path: {path}, at: {{{dim}: {label}}}, value: 1}}\n" for path, dim, label in labels]
    scene = check(RECORDS.replace("delay: 0", f"delay: {delay}") + "".join(lines))
    expected = [{"path": path, "at": {dim: label}, "value": 1} for path, dim, label in labels]
    outcomes = check_expectations(run_scene(scene), expected)
    absent = {k for k, outcome in enumerate(outcomes) if re.search("has no |is not in", outcome.message)}
    first = RECORDS.count("\n") + 1
    refused = {fault.line - first for fault in impossible_paths(scene)}
    assert refused == absent if not delay else refused < absent
    assert len(refused) > 10


def test_labels_are_checked_without_the_whole_search_for_equilibria(monkeypatch):
    starts, build = [], bond_graph.built_graph

    def built(scene, *rest):
        starts.append(scene.model.operating_point.search.starts)
        return build(scene, *rest)

    monkeypatch.setattr(bond_graph, "built_graph", built)
    scene = check("""\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, m: {type: I, value: 2}, c: {type: R, value: 4}, k: {type: C, law: {e: "q**3 - q"}}, b: 1}
  bonds: [F -> b -> m, b -> c, b -> k]
operating_point: {search: {starts: 700}}
analysis: {outputs: [m.f], results: [poles, transfer_function, reduction]}
expect:
  - {path: bond_graph/transfer_function/m.f/F/poles, at: {pole: 3}, max_abs: 3}
  - {path: bond_graph/reduction/steps, at: {step: 1}, value: 1}
""")
    [fault] = impossible_paths(scene)
    assert "there is no pole 3; there are 2 at most" in fault.message
    assert starts
    assert max(starts) < 100


WRITERS = ["bondgraph/results", "bondgraph/synthesis", "identification/results", "identification/systems"]
WRITERS += ["structure/reduction_comparison.py", "structure/geometry.py", "structure/modal_analysis.py"]
WRITERS += [
    "structure/response.py",
    "identification/identifiability.py",
    "identification/diagnosis/model_error.py",
]


#: The methods of a result that write names: of arrays, of several in a group, and of attributes.
WRITING = ("add", "add_axis", "add_numbered", "add_all", "add_axes", "annotate")


@pytest.mark.thorough
def test_every_name_that_a_result_is_given_is_in_the_layout():
    known = {name for names in LAYOUT.values() for name in names.split()}
    known |= {part for group in LAYOUT for part in group.split("/")} | ATTRIBUTES
    package, names = Path(dynid.__file__).parent, set()
    files = [file for path in WRITERS for file in ([*(package / path).rglob("*.py")] or [package / path])]
    for node in (node for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
            continue
        if node.func.attr in WRITING and ast.unparse(node.func.value) == "result":
            names |= {key.arg for key in node.keywords if key.arg not in (None, "dims", "units")}
            path = re.fullmatch(r"f?'.*/(\w+)'", ast.unparse(node.args[0]))
            if path and node.func.attr in ("add", "add_axis", "add_numbered"):
                names |= {path[1], f"{path[1]}s"} if node.func.attr == "add_numbered" else {path[1]}
    assert len(names) > 250
    assert names - known == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_every_label_of_a_result_may_be_selected(name):
    file = CONFIGS / f"{name}.yaml"
    result = run_scene(load_scene(file))
    lines = []
    for path, variable in result.items():
        for dim, length in zip(variable.dims, variable.shape, strict=True):
            labels = axis_of(result, path, dim, length).labels.tolist()
            lines += [f"  - {{path: '{path}', at: {{{dim}: {label!r}}}, value: 1}}" for label in labels[:5]]
    text = file.read_text().partition("\nexpect:")[0].rstrip() + "\nexpect:\n" + "\n".join(lines) + "\n"
    assert list(impossible_paths(check_source(apply_overrides(parse_source(text, str(file)), ())))) == []


def test_what_an_unstable_channel_does_not_have_is_missed_with_its_status():
    scene = check("""\
dynid: 1
kind: bond-graph
title: an active damper
graph:
  nodes: {F: Se, m: {type: I, value: 2}, c: {type: R, value: -4}, body: 1}
  bonds: [F -> body -> m, body -> c]
analysis: {outputs: [m.f, m.e], results: [step_info, bandwidth]}
""")
    result = run_scene(scene)
    flow, effort = f"{BASE}/m.f/F", f"{BASE}/m.e/F"
    step, band = result.value(f"{flow}/step_status"), result.value(f"{effort}/bandwidth_status")
    assert "unstable" in step
    assert "T(0) is 0" in band
    paths = [f"{flow}/overshoot", f"{effort}/bandwidth", f"{flow}/overshot"]
    outcomes = check_expectations(result, [{"path": path, "max": 5} for path in paths])
    shoot, width, misspelt = (outcome.message for outcome in outcomes)
    assert shoot == f"overshoot has no value; step_status: {step}"
    assert width == f"bandwidth has no value; bandwidth_status: {band}"
    assert misspelt.startswith("overshot is not in the result: ")


def test_labels_that_are_no_mapping_are_a_fault():
    with pytest.raises(SceneError, match="'at' is a mapping of dimensions to labels"):
        check(expecting(f"{BASE}/m_s.f/v_in/dc_gain").replace("value: true", "value: 1, at: 3"))


def test_expectations_of_benchmarks_and_groups_of_records_are_left_to_the_run():
    assert names_in(("identification", "measurement", "record_2")) == names_in(
        ("identification", "measurement")
    )
    assert names_in(("identification", "nothing")) is None


SURVEY = (
    RECORDS.partition("excitation:")[0] + "measurement: {modes: {values: [{frequency: 9, shape: {1: 1}}]}}\n"
)
UNMEASURED = RECORDS.partition("excitation:")[0] + "analysis: {modes: {}}\n"
OSCILLATOR = """dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, m: {type: I, value: 2}, c: {type: R, value: 4}, k: {type: C, value: 3}, b: 1}
  bonds: [F -> b -> m, b -> c, b -> k]
analysis: {outputs: [m.f], results: [poles, reduction]}
"""
GRID = "frequency: {start: 1, stop: 4, points: 4, scale: linear}"
CUT = OSCILLATOR.replace("outputs: [m.f]", f"outputs: [m.f], port: b -> k, {GRID}")
GRAPH = """dynid: 1
kind: identification
parameters: {k: {start: 3, true: 4}}
graph:
  nodes: {F: Se, J: 1, m: {type: I, value: 2}, s: {type: C, value: 1/k}, r: {type: R, value: 1}}
  bonds: [F -> J, J -> m, J -> s, J -> r]
excitation: [{source: F, kind: step}]
measurement: {step: 0.01, samples: 100, channels: [{output: m.f}], simulate: {noise_ratio: 0.01, seed: 1}}
"""
REDUCTION = f"""dynid: 1
kind: reduction
structure:
  lumped: {{masses: [1, 1, 1], links: [{{dofs: [1], k: 1}}, {{dofs: [1, 2], k: 1}}, {{dofs: [2, 3], k: 1}}]}}
reduction: [{{method: craig-bampton, masters: [2], modes: {{below: 9}}}}, {{method: guyan, masters: [1]}}]
{GRID}
inputs: [1]
outputs: [{{dof: 2, quantity: velocity}}]
"""
LAWS = """dynid: 1
kind: identification
structure: {lumped: {masses: [1, 2], links: [{dofs: [1], k: 2000, c: 3}]}}
joints: {hinge: {dofs: [1, 2], k: 1.0e4, laws: [{kind: cubic, k3: 1.0e6}]}}
analysis: {modes: {}}
"""
LAWS_IN_TIME = LAWS.replace(
    "modes: {}", "outputs: [{dof: 1}], time: {stop: 1, step: 0.01, input: [{dof: 1, kind: step}]}"
)
MODAL = (CONFIGS / "chain_ambient.yaml").read_text()
RESPONSES = GRAPH + f"analysis: {{outputs: [m.f], {GRID}}}\nderived: [frequency_response]\n"


@pytest.mark.parametrize(
    ("text", "path", "at", "said"),
    [
        # What is not in the result at all is refused once, whatever labels are written behind it.
        (SURVEY, "structure/modes/omega", "{mode: 3}", "'modes' needs the block 'modes'"),
        (SURVEY, "identification/diagnostics/residual_ratio", "{channel: x}", ""),
        (SURVEY, "identification/modes/mac", "{mode: 2}", "there are 1 at most"),
        (
            UNMEASURED,
            "identification/parameters/estimate",
            "{parameter: x}",
            "without the block 'measurement'",
        ),
        (UNMEASURED, "structure/modes/omega", "{mode: 3}", "there are 2 at most"),
        (OSCILLATOR, "bond_graph/port/prototype", "{step: 9}", "'port' needs the bond"),
        (OSCILLATOR, "bond_graph/reduction/steps", "{step: 99}", "there are 2 at most"),
        (OSCILLATOR, "bond_graph/nothing/m", "{omega: 1}", "no results 'nothing'"),
        (CUT, "bond_graph/port/steps", "{step: 99}", "there is no step 99"),
        (CUT, "bond_graph/port/frequency_response/load_Z_eq", "{omega: 2.5}", "no omega 2.5 on"),
        (GRAPH, "bond_graph/properties/m.f/F/stable", "{mode: 1}", "add the block 'analysis'"),
        (GRAPH, "identification/measurement/measured", "{time: 0.015}", "no time 0.015 on the grid"),
        (RESPONSES, f"{DERIVED}/frequency_response/m.f/F/magnitude/value", "{omega: 2}", ""),
        (RESPONSES, f"{DERIVED}/frequency_response/m.f/F/magnitude/value", "{omega: 2.5}", "no omega 2.5 on"),
        (RESPONSES, "identification/parameters/estimate", "{time: 2}", "no dimension 'time'"),
        (REDUCTION, "reduction/frf/full", "{omega: 2}", ""),
        (REDUCTION, "reduction/frf/full", "{omega: 2.5}", "no omega 2.5 on"),
        (REDUCTION, "reduction/craig-bampton/frequencies", "{mode: 9}", "there are 3 at most"),
        (REDUCTION, "reduction/guyan/frequencies", "{mode: 2}", "there are 1 at most"),
        (RECORDS, "identification/measurement/record_9/measured", "{time: 0.1}", "each record has a group"),
        (LAWS, "structure/joints/force", "{time: 0.1}", "'joints' needs the block 'time'"),
        (LAWS_IN_TIME, "structure/joints/force", "{time: 0.123}", ""),
        (MODAL, "modal/frequency", "{mode: 90}", ""),
    ],
)
def test_labels_of_what_the_scene_leaves_out(text, path, at, said):
    scene = check(text.partition("expect:")[0] + f"expect:\n  - {{path: {path}, at: {at}, value: 1}}\n")
    assert [said in fault.message for fault in impossible_paths(scene)] == ([True] if said else [])
