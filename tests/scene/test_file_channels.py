"""Channels that a Universal File names: records and frequency responses without a list of sensors."""

import numpy as np
import pytest
import yaml
from scipy.linalg import eigh

from dynid.errors import DynidError, SceneError
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from tests.files.universal_files import complex_mode, function, mode, nodes, system, units, written
from tests.scene.test_frf_scenes import HEAD, HERTZ, accelerances

CHAIN = HEAD.replace(", true: 200", "").replace(", true: 1", "")
BEAM = """\
dynid: 1
kind: identification
structure:
  beam: {elements: 4, length: 2, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w, theta]}],
         damping: {beta: 1.0e-4}}
joints:
  tip: {dofs: [w_5], k: {start: 1.0e3, true: 2.0e3}, c: 1}
"""
QUARTER = "[[1, 0, 0], [0, 0, -1], [0, 1, 0]]"  # its z is the model's y
FORCE = {"ordinate_spec_data_type": 13}


def loaded(tmp_path, text):
    (tmp_path / "x.yaml").write_text(text)
    return load_scene(tmp_path / "x.yaml").source.data


def run(tmp_path, text):
    loaded(tmp_path, text)
    return run_scene(load_scene(tmp_path / "x.yaml"))


def refusal(tmp_path, text):
    with pytest.raises(DynidError) as caught:
        loaded(tmp_path, text)
    return str(caught.value).removeprefix(f"{tmp_path}/")


def responses(path, *, second=(2, 3)):
    """Write the responses of two masses to a force at the second, the other one reversed by its direction."""
    one, two = accelerances().T
    sign = np.sign(second[1])
    lines = {"step": HERTZ[1] - HERTZ[0], "start": HERTZ[0], "reference": (2, 3)}
    force = {"orddenom_spec_data_type": 13}
    return written(
        path,
        function(np.full(91, 0.98), kind=6, response=second, **lines),
        function(sign * two, kind=4, response=second, **lines, **force),
        function(one, kind=4, response=(1, 3), **lines, **force),
        function(np.full(91, 0.99), kind=6, response=(1, 3), **lines),
    )


@pytest.mark.parametrize("second", [(2, 3), (2, -3)])
def test_responses_name_their_dofs(tmp_path, second):
    responses(tmp_path / "h.uff", second=second)
    frf = "measurement: {frf: {file: {path: h.uff, coherence: all, averages: 10}}, channels: all}\n"
    measurement = loaded(tmp_path, CHAIN + frf)["measurement"]
    gain = {} if second[1] > 0 else {"gain": -1}
    assert measurement["channels"] == [
        {"dof": 2, "quantity": "acceleration", "reference": {"dof": 2}, **gain},
        {"dof": 1, "quantity": "acceleration", "reference": {"dof": 2}},
    ]
    assert measurement["frf"]["file"] == {
        "path": "h.uff",
        "columns": [1, 2],
        "coherence": [1, 2],
        "averages": 10,
    }
    found = run(tmp_path, CHAIN + frf)
    assert found["identification/parameters/estimate"].data == pytest.approx([200, 1], rel=1e-4)


def test_coherences_are_found_by_their_dofs(tmp_path):
    """The file has them in another order than the responses."""
    responses(tmp_path / "h.uff")
    text = CHAIN + "measurement: {frf: {file: {path: h.uff, columns: [2], coherence: all}}, channels: all}\n"
    assert loaded(tmp_path, text)["measurement"]["frf"]["file"]["coherence"] == [2]


def test_a_record_with_its_force_is_one_line(tmp_path):
    """What was simulated from a list of channels is written to a file, and read without one."""
    listed = BEAM + (
        "excitation: [{dof: 4:y, kind: chirp, amplitude: 10, start: 5, stop: 400}]\n"
        "measurement:\n  step: 0.0005\n  samples: 400\n  channels:\n"
        "    - {dof: 3:y, quantity: acceleration}\n    - {dof: 5:y, quantity: acceleration}\n"
        "  simulate: {noise_ratio: 0.001, seed: 2}\n"
    ).replace("dof: 4:y", "dof: w_4").replace("dof: 3:y", "dof: w_3").replace("dof: 5:y", "dof: w_5")
    made = run(tmp_path, listed)
    measured = made["identification/measurement/measured"].data
    force = made["identification/measurement/input"].data[:, 0]
    same = {"step": 0.0005}
    written(
        tmp_path / "run.uff",
        function(measured[:, 1] * -1, response=(5, -2), **same),
        function(force, response=(4, 2), **same, **FORCE),
        function(measured[:, 0], response=(3, 2), **same),
    )
    data = loaded(tmp_path, BEAM + "measurement: {file: {path: run.uff}, channels: all}\n")
    assert data["measurement"] == {
        "file": {"path": "run.uff", "columns": [1, 3]},
        "channels": [
            {"dof": "w_5", "gain": -1, "quantity": "acceleration"},
            {"dof": "w_3", "quantity": "acceleration"},
        ],
        "step": 0.0005,
        "samples": 400,
    }
    assert data["excitation"] == [{"dof": "w_4", "kind": "file", "path": "run.uff", "column": 2}]
    found = run(tmp_path, BEAM + "measurement: {file: {path: run.uff}, channels: all}\n")
    assert found["identification/parameters/estimate"].data == pytest.approx([2000], rel=1e-3)
    # The scene of the result lists them: it is read again, and drawn, without the file.
    kept = yaml.safe_load(str(found.attrs["scene"]))
    assert kept["measurement"]["channels"] == data["measurement"]["channels"]


def test_positions_in_other_coordinates_and_units(tmp_path):
    """A beam along x that moves along y; measured in mm, from the tip backwards, its deflection along z."""
    written(
        tmp_path / "run.uff",
        units(1000.0, 1.0),
        nodes([101, 102], [(5.0, 0.0, 0.0), (1002.0, 1.0, 0.0)]),
        function(np.zeros(20), response=(101, 3)),
        function(np.zeros(20), response=(102, -3)),
    )
    match = (
        "match: {by: position, tolerance: 0.01, origin: [2, 0, 0], axes: [[-1, 0, 0], [0, 0, 1], [0, 1, 0]]}"
    )
    data = loaded(tmp_path, BEAM + f"measurement: {{file: {{path: run.uff}}, channels: all, {match}}}\n")
    assert data["measurement"]["channels"] == [
        {"dof": "w_5", "quantity": "acceleration"},
        {"dof": "w_3", "gain": -1, "quantity": "acceleration"},
    ]
    said = refusal(
        tmp_path,
        BEAM
        + f"measurement:\n  file: {{path: run.uff}}\n  channels: all\n  {match.replace('0.01', '0.004')}\n",
    )
    assert said.startswith("x.yaml:11:25: 1 of 2 nodes of the test lie more than 0.004 m")
    assert "101: 0.005 m from 5" in said


def test_the_geometry_may_be_a_file_of_its_own(tmp_path):
    written(
        tmp_path / "geometry.unv",
        system(3, (0, 0, 0), (0, 0, 1), (0, 1, 0)),  # its x is basic z, its z is basic y
        nodes([7], [(1.5, 0.0, 0.0)], systems=3),
    )
    written(tmp_path / "run.uff", function(np.zeros(20), response=(7, -3)))
    match = "match: {by: position, tolerance: 0.01, geometry: geometry.unv}"
    data = loaded(tmp_path, BEAM + f"measurement: {{file: {{path: run.uff}}, channels: all, {match}}}\n")
    assert data["measurement"]["channels"] == [{"dof": "w_4", "gain": -1, "quantity": "acceleration"}]
    (tmp_path / "nodes.csv").write_text("node,x,y,z\n7,1.5,0.001,0\n")
    table = f"match: {{by: position, tolerance: 0.01, geometry: nodes.csv, axes: {QUARTER}}}"
    data = loaded(tmp_path, BEAM + f"measurement: {{file: {{path: run.uff}}, channels: all, {table}}}\n")
    assert data["measurement"]["channels"] == [{"dof": "w_4", "gain": -1, "quantity": "acceleration"}]
    other = match.replace("geometry.unv", "run.uff")
    said = refusal(tmp_path, BEAM + f"measurement: {{file: {{path: run.uff}}, channels: all, {other}}}\n")
    assert "run.uff holds no nodes. Data sets 15 and 2411 are read" in said


def test_every_record_has_its_own_file(tmp_path):
    for name, node in (("a", 3), ("b", 5)):
        written(
            tmp_path / f"{name}.uff",
            function(np.zeros(20), response=(node, 2)),
            function(np.zeros(20), response=(4, 2), **FORCE),
        )
    listed = "channels: [{dof: w_5, quantity: acceleration}], step: 0.01, samples: 20"
    a, b = "{file: {path: a.uff}}", "{file: {path: b.uff}}"
    records = f"records: [{a}, {b}, {b[:-1]}, {listed}}}]"
    data = loaded(tmp_path, BEAM + f"measurement: {{channels: all, {records}}}\n")
    first, second, third = data["measurement"]["records"]
    assert "channels" not in data["measurement"]
    assert [one["channels"][0]["dof"] for one in (first, second, third)] == ["w_3", "w_5", "w_5"]
    assert second["excitation"] == [{"dof": "w_4", "kind": "file", "path": "b.uff", "column": 2}]
    assert "excitation" not in third


def test_records_that_list_their_channels_need_no_match(tmp_path):
    written(
        tmp_path / "a.uff",
        function(np.zeros(20), response=(9, 2)),
        function(np.zeros(20), response=(4, 2), **FORCE),
    )
    listed = (
        "{file: {path: b.csv}, channels: [{dof: w_5, quantity: velocity}], step: 0.01, samples: 20, "
        "excitation: []}"
    )
    records = f"match: {{nodes: {{9: 3}}}}, channels: all, records: [{{file: {{path: a.uff}}}}, {listed}]"
    data = loaded(tmp_path, BEAM + f"measurement: {{{records}}}\n")
    first, second = data["measurement"]["records"]
    assert first["channels"][0]["dof"] == "w_3"
    assert second["channels"] == [{"dof": "w_5", "quantity": "velocity"}]
    assert "match" not in data["measurement"]
    none = f"measurement: {{match: {{nodes: {{9: 3}}}}, records: [{listed}]}}\n"
    assert "these channels name their DOFs" in refusal(tmp_path, BEAM + none)


@pytest.mark.thorough
def test_two_hundred_channels_are_one_line(tmp_path):
    masses = ", ".join(["1"] * 200)
    links = ", ".join(["{dofs: [1], k: 100}", *(f"{{dofs: [{k}, {k + 1}], k: 100}}" for k in range(1, 200))])
    text = (
        f"dynid: 1\nkind: identification\nstructure:\n  lumped: {{masses: [{masses}], links: [{links}]}}\n"
        "joints: {j: {dofs: [200], k: {start: 10}}}\nmeasurement: {file: {path: run.uff}, channels: all}\n"
    )
    written(tmp_path / "run.uff", *(function(np.zeros(8), response=(k, 3)) for k in range(1, 201)))
    channels = loaded(tmp_path, text)["measurement"]["channels"]
    assert channels == [{"dof": k, "quantity": "acceleration"} for k in range(1, 201)]


def simulated(tmp_path):
    """Return force and acceleration of the beam's tip, N and m/s2."""
    made = run(
        tmp_path,
        BEAM + "excitation: [{dof: w_4, kind: chirp, amplitude: 10, start: 5, stop: 400}]\nmeasurement:\n"
        "  {step: 0.0005, samples: 400, channels: [{dof: w_5, quantity: acceleration}],\n"
        "   simulate: {noise_ratio: 0.001, seed: 2}}\n",
    )
    found = made["identification/measurement/input"], made["identification/measurement/measured"]
    return [one.data[:, 0] for one in found]


@pytest.mark.parametrize(
    ("record", "labels", "length", "force"),
    [
        (units(1e3, 1e-3), ("", ""), 1e3, 1e-3),
        (units(1 / 0.0254, 1 / 4.4482216152605, code=7), ("", "lbf"), 1 / 0.0254, 1 / 4.4482216152605),
        (None, ("g", "kN"), 1 / 9.80665, 1e-3),
    ],
)
def test_units_of_the_file_are_converted(tmp_path, record, labels, length, force):
    """The same record in mm and kN, in inches and pounds, or labelled g and kN: the same estimate."""
    drives, measured = simulated(tmp_path)
    sets = [
        function(force * drives, response=(4, 2), step=0.0005, ordinate_axis_units_lab=labels[1], **FORCE),
        function(length * measured, response=(5, 2), step=0.0005, ordinate_axis_units_lab=labels[0]),
    ]
    written(tmp_path / "run.uff", *([record] if record else []), *sets)
    found = run(tmp_path, BEAM + "measurement: {file: {path: run.uff}, channels: all}\n")
    assert found["identification/parameters/estimate"].data == pytest.approx([2000], rel=1e-3)
    np.testing.assert_allclose(
        found["identification/measurement/input"].data[:, 0], drives, rtol=1e-6, atol=1e-5
    )


def test_contradicting_units_are_decided_by_the_scene(tmp_path):
    drives, measured = simulated(tmp_path)
    written(
        tmp_path / "run.uff",
        units(1.0, 1.0, code=1),
        function(drives, response=(4, 2), step=0.0005, **FORCE),
        function(measured / 9.80665, response=(5, 2), step=0.0005, ordinate_axis_units_lab="g", id1="tip"),
    )
    text = BEAM + "measurement: {file: {path: run.uff}, channels: all}\n"
    with pytest.raises(DynidError) as caught:
        run(tmp_path, text)
    assert "the unit of the column 'tip' is in doubt: its label says g" in str(caught.value)
    decided = text.replace("all}", "all, match: {units: labels}}")
    assert loaded(tmp_path, decided)["measurement"]["channels"][0]["unit"] == "g"
    found = run(tmp_path, decided)
    assert found["identification/parameters/estimate"].data == pytest.approx([2000], rel=1e-3)
    by_record = loaded(tmp_path, decided.replace("labels", "record"))
    assert by_record["measurement"]["channels"][0]["unit"] == "m/s2"


def test_units_follow_from_a_quantity_that_the_scene_states(tmp_path):
    written(
        tmp_path / "run.uff",
        units(1e3, 1.0),
        function(np.zeros(8), response=(3, 2), ordinate_spec_data_type=0),
    )
    match = "match: {quantity: velocity}"
    data = loaded(tmp_path, BEAM + f"measurement: {{file: {{path: run.uff}}, channels: all, {match}}}\n")
    assert data["measurement"]["channels"] == [{"dof": "w_3", "quantity": "velocity", "unit": "mm/s"}]


@pytest.mark.parametrize(
    ("rate", "step"), [(65536, 1 / 65536), (3000, 1 / 3000), (10000 / 3, 3e-4), (500, 0.002)]
)
def test_steps_of_whole_rates_are_exact(tmp_path, rate, step):
    """The file has six digits: 1.52588E-05 is taken for 1/65536."""
    written(tmp_path / "run.uff", function(np.zeros(8), response=(3, 2), step=1 / rate))
    data = loaded(tmp_path, BEAM + "measurement: {file: {path: run.uff}, channels: all}\n")
    assert data["measurement"]["step"] == pytest.approx(step, rel=1e-15)


@pytest.mark.parametrize(
    ("functions", "more", "said"),
    [
        ([function(np.zeros(8), response=(3, 2), ordinate_spec_data_type=0, id1="mic")], "", "x.yaml:8:22: "),
        (
            [function(np.zeros(8), response=(3, 2), ordinate_spec_data_type=0, id1="mic")],
            "",
            "does not say that these are motions or forces: functions 1 (mic). Give the quantity",
        ),
        (
            [function(np.zeros(8), response=(3, 0), id1="a")],
            "",
            "gives no node and direction of these: functions 1 (a). List the channels",
        ),
        (
            [
                function(np.zeros(8), response=(3, 2), id1="a"),
                function(np.zeros(8), response=(3, 2), id1="b"),
            ],
            "",
            "measures the acceleration at w_3 twice: functions 1 (a), 2 (b). Name the functions to use",
        ),
        ([function(np.zeros(8), response=(3, 2), **FORCE)], "", "holds no motion"),
        (
            [function(np.zeros(8), response=(9, 2))],
            "",
            "x.yaml:8:38: the model has no DOFs at 1 of the 1 nodes of the test: 9; it has some at 2; 3; 4;",
        ),
        (
            [function(np.zeros(8), response=(3, 1))],
            "",
            "3:x of the test: node 3 of the model has y, rz. Leave the channel out",
        ),
        (
            [function(np.zeros(8), response=(3, 1))],
            ", match: {axes: [[1, 0, 0], [0, 2, 0], [0, 0, 1]]}",
            "x.yaml:8:61: the axes of the test are not orthonormal",
        ),
        (
            [function(np.zeros(8), response=(3, 1))],
            ", match: {by: position}",
            "x.yaml:8:53: nodes matched by position need a 'tolerance'. Give it in m",
        ),
        (
            [function(np.zeros(8), response=(3, 1))],
            ", match: {axes: [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]}",
            "3:x of the test, which is +0.8 x +0.6 y of the model: node 3 of the model has y, rz",
        ),
        ([function(np.zeros(8), kind=4)], "", "holds no time history"),
    ],
)
def test_what_a_file_does_not_name_is_located(tmp_path, functions, more, said):
    written(tmp_path / "run.uff", *functions)
    text = f"measurement: {{file: {{path: run.uff}}, channels: all{more}}}\n"
    assert said in refusal(tmp_path, BEAM + text)


def test_the_scene_says_what_the_file_does_not(tmp_path):
    written(
        tmp_path / "run.uff",
        function(np.zeros(8), response=(3, 2), ordinate_spec_data_type=0),
        function(np.zeros(8), response=(9, 2), ordinate_spec_data_type=0),
    )
    match = "match: {quantity: velocity, nodes: {9: 4}}"
    data = loaded(tmp_path, BEAM + f"measurement: {{file: {{path: run.uff}}, channels: all, {match}}}\n")
    assert data["measurement"]["channels"] == [
        {"dof": "w_3", "quantity": "velocity"},
        {"dof": "w_4", "quantity": "velocity"},
    ]
    columns = f"measurement: {{file: {{path: run.uff, columns: [2]}}, channels: all, {match}}}\n"
    assert [one["dof"] for one in loaded(tmp_path, BEAM + columns)["measurement"]["channels"]] == ["w_4"]


@pytest.mark.parametrize(
    ("measurement", "said"),
    [
        (
            "{channels: all, simulate: {noise_ratio: 0}}",
            "'channels: all' are those of a file, and a measurement",
        ),
        (
            "{file: {path: run.csv}, channels: all}",
            "run.csv names no nodes and directions. List the channels",
        ),
        ("{file: {path: none.uff}, channels: all}", "none.uff"),
        ("{file: {path: run.csv}, channels: some}", "x.yaml:8:"),
        (
            "{file: {path: run.csv}, channels: [{dof: w_3, quantity: velocity}], match: {}}",
            "'match' goes with 'channels: all'",
        ),
        (
            "{match: {by: number}, modes: {values: [{frequency: 1}]}}",
            "'match' goes with 'channels: all'; write that of modes under 'measurement.modes'",
        ),
        (
            "{file: {path: run.csv}, channels: all, match: {origin: [1, 0, 0]}}",
            "'origin' says nothing of nodes with the same numbers; give a tolerance",
        ),
        (
            "{frf: {file: {path: h.uff, coherence: all}}, channels: [{dof: w_3, quantity: velocity}]}",
            "'coherence: all' goes with 'channels: all'",
        ),
    ],
)
def test_all_channels_need_a_file_that_names_them(tmp_path, measurement, said):
    (tmp_path / "run.csv").write_text("1\n2\n")
    assert said in refusal(tmp_path, BEAM + f"measurement: {measurement}\n")


def test_a_graph_has_no_nodes_and_directions(tmp_path):
    graph = """\
dynid: 1
kind: identification
parameters: {k: {start: 3}}
graph: {nodes: {F: Se, J: 1, m: {type: I, value: 2}, s: {type: C, value: 1/k}}, bonds: [F -> J -> m, J -> s]}
measurement: {file: {path: run.uff}, channels: all}
"""
    written(tmp_path / "run.uff", function(np.zeros(8)))
    said = refusal(tmp_path, graph)
    assert "x.yaml:5:" in said
    assert "names nodes and directions, which a graph has not" in said


def test_faults_of_the_scene_come_before_those_of_the_file(tmp_path):
    with pytest.raises(SceneError) as caught:
        loaded(
            tmp_path,
            BEAM.replace("rhoA: 0.1", "rhoB: 0.1") + "measurement: {file: {path: x.uff}, channels: all}\n",
        )
    assert len(caught.value.faults) >= 1
    assert "none.uff" not in str(caught.value)


def exact_modes():
    """Return frequencies (Hz) and shapes at nodes 3 and 5 of the beam with its spring, by dense matrices."""
    h, EI, rhoA = 0.5, 1723.3, 0.1
    size = np.diag([1, h, 1, h])
    bending = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    inertia = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    K, M = np.zeros((10, 10)), np.zeros((10, 10))
    for k in range(4):
        at = slice(2 * k, 2 * k + 4)
        K[at, at] += EI / h**3 * size @ bending @ size
        M[at, at] += rhoA * h / 420 * size @ inertia @ size
    K[8, 8] += 2000
    values, shapes = eigh(K[2:, 2:], M[2:, 2:])
    return np.sqrt(values) / (2 * np.pi), shapes[[2, 6]]


@pytest.mark.parametrize("turned", [False, True])
def test_shapes_of_a_survey_are_matched(tmp_path, turned):
    """By number along y; or by position, in mm, the deflection along -z of turned coordinates."""
    hertz, shapes = exact_modes()
    zero = [0.0, 0.0]
    if turned:
        place = [units(1e3, 1.0), nodes([1, 2], [(1000.0, 0.0, 0.0), (2000.0, 0.0, 0.0)])]
        sets = [mode(f, [1, 2], zero, zero, -one) for f, one in zip(hertz[:3], shapes.T, strict=False)]
        axes = "[[1, 0, 0], [0, 0, -1], [0, 1, 0]]"
        modes = f"{{file: survey.unv, match: {{by: position, tolerance: 0.01, axes: {axes}}}}}"
        sensors = ["w_3", "w_5"]
    else:
        place = []
        sets = [mode(f, [3, 5], zero, one, zero) for f, one in zip(hertz[:3], shapes.T, strict=False)]
        modes, sensors = "{file: survey.unv}", ["w_3", "w_5"]
    written(tmp_path / "survey.unv", *place, *sets)
    text = BEAM.replace("c: 1}", "c: 0}").replace(",\n         damping: {beta: 1.0e-4}}", "}")
    text += f"measurement: {{modes: {modes}}}\n"
    assert loaded(tmp_path, text)["measurement"]["modes"]["sensors"] == sensors
    found = run(tmp_path, text)
    assert found["identification/parameters/estimate"].data == pytest.approx([2000], rel=1e-4)
    assert found["identification/modes/mac"].data == pytest.approx([1, 1, 1], abs=1e-8)


def test_turned_shapes_have_signed_dofs(tmp_path):
    written(tmp_path / "survey.unv", mode(3.0, [3], [0.0], [1.0], [0.0]))
    axes = "[[-1, 0, 0], [0, -1, 0], [0, 0, 1]]"
    text = BEAM + f"measurement: {{modes: {{file: survey.unv, match: {{axes: {axes}}}}}}}\n"
    assert loaded(tmp_path, text)["measurement"]["modes"]["sensors"] == ["3:-y"]


def test_shapes_that_cannot_be_matched_are_located(tmp_path):
    written(tmp_path / "survey.unv", mode(3.0, [9], [0.0], [1.0], [0.0]))
    said = refusal(tmp_path, BEAM + "measurement:\n  modes:\n    file: survey.unv\n")
    assert said.startswith("x.yaml:10:5: the model has no DOFs at 1 of the 1 nodes of the test: 9")
    more = "measurement:\n  modes: {file: survey.unv, match: {nodes: {9: 3}}"
    assert loaded(tmp_path, BEAM + more + "}\n")["measurement"]["modes"]["sensors"] == ["w_3"]
    assert "here the scene names the DOFs" in refusal(tmp_path, BEAM + more + ", sensors: [w_3]}\n")
    assert "are those of channels" in refusal(
        tmp_path, BEAM + more.replace("9: 3}", "9: 3}, units: labels") + "}\n"
    )


def test_complex_shapes_are_fitted_and_their_complexity_is_reported(tmp_path):
    """Of (1, c i) after any rotation the imaginary part left over is c / sqrt(1 + c^2)."""
    hertz, shapes = exact_modes()
    first, zero, c = shapes[:, 0] / np.linalg.norm(shapes[:, 0]), [0j, 0j], 0.01
    across = np.array([-first[1], first[0]])
    values = np.exp(0.7j) * (first + 1j * c * across)
    omega = 2 * np.pi * hertz[0]
    pole = omega * complex(-1.0e-4 * omega / 2, 1)  # the beam's own damping
    written(tmp_path / "survey.unv", complex_mode(pole, [3, 5], zero, values, zero))
    found = run(tmp_path, BEAM.replace("c: 1}", "c: 0}") + "measurement: {modes: {file: survey.unv}}\n")
    complexity = found["identification/modes/complexity_measured"].data
    assert complexity == pytest.approx([c / np.hypot(1, c)], rel=1e-2)  # six digits in the file
    assert found["identification/modes/mac"].data[0] > 0.999


SPACE = """\
dynid: 1
kind: identification
structure:
  space_frame:
    nodes: [[0, 0, 0], [1, 0, 0]]
    members: [{nodes: [1, 2], EA: 1.0e6, EIy: 1.0e3, EIz: 2.0e3, GJ: 1.0e3, rhoA: 1, rhoJ: 0.01}]
    supports: [{node: 1, fix: [x, y, z, rx, ry, rz]}]
    damping: {beta: 1.0e-4}
joints:
  tip: {dofs: ["2:y"], k: {start: 1.0e3, true: 2.0e3}}
"""


def test_a_slanting_sensor_is_a_sum_of_dofs(tmp_path):
    """The tip's motion along (0, 0.6, 0.8), and a force along (0, 0.8, -0.6), from a displacement system."""
    text = SPACE + (
        "motions: {s: {2:y: 0.6, 2:z: 0.8}, f: {2:y: 0.8, 2:z: -0.6}}\n"
        "measurement:\n  channels: [{dof: s, quantity: acceleration, reference: {dof: f}}]\n"
        "  frf: {simulate: {lines: {start: 5, stop: 60, points: 56, scale: linear, unit: Hz}}}\n"
    )
    values = run(tmp_path, text)["identification/measurement/measured"].data[:, 0]
    written(
        tmp_path / "h.unv",
        system(4, (0, 0, 0), (1, 0, 0), (0, -0.6, -0.8)),  # its z is -(0, 0.6, 0.8), its y (0, -0.8, 0.6)
        nodes([2], [(1.0, 0.0, 0.0)], systems=4),
        function(values, kind=4, response=(2, -3), reference=(2, -2), step=1.0, start=5.0),
    )
    listed = SPACE + "measurement: {frf: {file: {path: h.unv}}, channels: all}\n"
    data = loaded(tmp_path, listed)
    z, y = data["motions"]["test 2:z"], data["motions"]["test 2:y"]
    assert z == pytest.approx({"2:y": -0.6, "2:z": -0.8}, rel=1e-5)
    assert y == pytest.approx({"2:y": -0.8, "2:z": 0.6}, rel=1e-5)
    found = run(tmp_path, listed)
    assert found["identification/parameters/estimate"].data == pytest.approx([2000], rel=1e-3)


def test_the_dofs_of_a_motion_exist(tmp_path):
    text = SPACE + "motions: {s: {2:y: 0.6, 7:z: 0.8}}\nanalysis: {modes: {count: 1}}\n"
    with pytest.raises(DynidError, match="there is no DOF '7:z'"):
        run(tmp_path, text)
