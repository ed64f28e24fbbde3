"""`dynid check` and `dynid run` agree on errors before the start: same exit code, same message."""

import re

import numpy as np
import pytest

from tests.scene.example_scenes import ISOLATOR

GRAPH = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {NODES}
  bonds: [BONDS]
analysis: {ANALYSIS}
"""
MATRICES = """\
dynid: 1
kind: reduction
structure: {matrices: {mass: M.npz, stiffness: K.mtx}}
reduction: [{method: guyan, masters: [1]}]
"""
RECORD = """\
dynid: 1
kind: identification
structure: {lumped: {masses: [2, 2], links: [{dofs: [1], k: 2.0e4, c: 20}]}}
joints: {j: {dofs: [1, 2], k: {start: 1.0e4, true: 2.0e4}, c: {value: 20}}}
excitation: [{dof: 2, kind: sine, amplitude: 1, frequency: 90}]
measurement:
  step: 0.002
  samples: 50
  channels: [{dof: 2, quantity: velocity}]
  file: {path: record.csv}
"""


def graph(nodes, bonds, analysis):
    return GRAPH.replace("NODES", nodes).replace("BONDS", bonds).replace("ANALYSIS", analysis)


def on_a_junction(kind, source):
    return graph(
        f"a: {source}, b: {source}, j: {kind}, r: {{type: R, value: 3}}",
        "a -> j -> r, b -> j",
        "outputs: [r.e]",
    )


DRIVEN = graph(
    "u: Se, j: 1, m: {type: I, value: 2}, r: {type: R, value: 1}",
    "u -> j -> m, j -> r",
    "outputs: [m.f], time: {stop: 1, step: 0.1, input: {kind: file, path: force.csv, column: force}}",
)
#: Scene, exit code, and words of the message.
CATALOGUE = {
    "two flow sources on a 1-junction": (
        on_a_junction(1, "Sf"), 3, "Put 'b' on a 0-junction of its own, with an R or a C",
    ),
    "two effort sources on a 0-junction": (
        on_a_junction(0, "Se"), 3, "Put 'b' on a 1-junction of its own, with an R or an I",
    ),
    "a flow into nothing": (
        graph("u: Sf, j: 0", "u -> j", "outputs: [j.e]"), 3, "Put an R or a C on the 0-junction 'j'",
    ),
    "an effort on nothing": (
        graph("u: Se, j: 1", "u -> j", "outputs: [j.f]"), 3, "Put an R or an I on the 1-junction 'j'",
    ),
    "an output that floats": (
        graph("u: Se, r: {type: R, value: 1}, a: 0, b: 0", "u -> r, a -> b", "outputs: [b.e]"), 3,
        "the effort of 'a' and 'b' is not determined",
    ),
    "a port on a loop": (
        graph(
            "u: Se, s: 1, q: {type: R, value: 1}, a: 0, b: 1, c: 1, d: 0, r: {type: R, value: 1}, "
            "l: {type: I, value: 1}, m: {type: I, value: 2}",
            "u -> s -> q, s -> a -> b -> d -> r, a -> c -> d, b -> l, c -> m",
            "outputs: [r.e], port: a -> b",
        ), 2, "the bond 'a -> b' lies on a loop",
    ),
    "a column that is not there": (DRIVEN, 4, "'force'"),
    "a record that is too short": (RECORD, 4, "record.csv"),
    "a record that is not there": (RECORD.replace("record.csv", "recrod.csv"), 4, "recrod.csv is no file"),
    "a DOF that the matrices have not": (MATRICES.replace("masters: [1]", "masters: [1, 7]"), 2, "7"),
    "a joint at a DOF that the matrices have not": (
        MATRICES + "joints: {j: {dofs: [2, 9], k: {value: 3}}}\n", 2, "9",
    ),
    "matrices of two sizes": (MATRICES.replace("K.mtx", "small.mtx"), 2, "is 2 x 2, but must be 3 x 3"),
    "a matrix that is not square": (MATRICES.replace("K.mtx", "wide.mtx"), 2, "is 1 x 3, but must be 3 x 3"),
    "a matrix that is not in its file": (MATRICES.replace("M.npz", "{path: M.npz, name: Q}"), None, "Q"),
    "a matrix file that is cut off": (MATRICES.replace("K.mtx", "cut.mtx"), 4, "cut.mtx"),
    "a joint that is indefinite": (
        RECORD.replace("joints: {", "joints: {i: {dofs: [1, 2], k: [[1, 2], [2, 1]]}, "), 2, "indefinite",
    ),
    "an unknown factor of an indefinite matrix": (
        RECORD.replace(
            "joints: {", "joints: {i: {dofs: [1, 2], k: {start: 3, true: 4, matrix: [[1, 2], [2, 1]]}}, "
        ).replace("file: {path: record.csv}", "simulate: {}"), 2, "indefinite",
    ),
    "an expectation of what is not requested": (
        graph("u: Se, j: 1, m: {type: I, value: 2}, r: {type: R, value: 1}", "u -> j -> m, j -> r",
              "outputs: [m.f], results: [poles]")
        + "expect: [{path: bond_graph/properties/m.f/u/dc_gain, value: 1}]\n",
        2, "comes with the result 'properties', which",
    ),
    "a contradiction where only causality is asked for": (
        graph("u: Sf, v: Sf, j: 1, r: {type: R, value: 3}", "u -> j -> r, v -> j",
              "outputs: [r.e], results: [causality]"), 3, "'v'",
    ),
}  # fmt: skip


@pytest.fixture
def data(folder):
    (folder / "force.csv").write_text("time,power\n" + "".join(f"{0.1 * k},1\n" for k in range(11)))
    (folder / "record.csv").write_text("1\n" * 20)
    np.savez(folder / "M.npz", M=np.eye(3))
    banner = "%%MatrixMarket matrix array real general\n"
    (folder / "K.mtx").write_text(f"{banner}3 3\n2\n-1\n0\n-1\n2\n-1\n0\n-1\n2\n")
    (folder / "small.mtx").write_text(f"{banner}2 2\n2\n-1\n-1\n2\n")
    (folder / "wide.mtx").write_text(f"{banner}1 3\n2\n-1\n-1\n")
    (folder / "cut.mtx").write_text(f"{banner}3 3\n2\n-1\n0\n-1\n")
    return folder


@pytest.mark.parametrize("name", CATALOGUE)
def test_check_and_run_agree(dynid, data, name):
    scene, expected, words = CATALOGUE[name]
    (data / "s.yaml").write_text(scene)
    code, out, err = dynid("run", "s.yaml")
    assert out == ""
    assert code in ({expected} if expected is not None else {2, 4})
    assert words in err
    checked, out, said = dynid("check", "s.yaml")
    assert (checked, out) == (code, "")
    faults = [line for line in err.splitlines() if re.match(r"s\.yaml:\d+:\d+: ", line)]
    assert faults
    assert set(faults) <= set(said.splitlines())


def test_every_fault_is_reported_with_the_exit_code_of_the_first(dynid, data):
    """A run stops at the structure; check goes on to the record."""
    scene = RECORD.replace(
        "{lumped: {masses: [2, 2], links: [{dofs: [1], k: 2.0e4, c: 20}]}}",
        "{matrices: {mass: M.npz, stiffness: small.mtx}}",
    )
    (data / "s.yaml").write_text(scene)
    code, _, err = dynid("run", "s.yaml")
    checked, _, said = dynid("check", "s.yaml")
    assert checked == code == 2
    assert "is 2 x 2, but must be 3 x 3" in err
    assert "record.csv" not in err
    assert err.strip() in said
    assert "record.csv" in said


def test_valid_scenes_of_which_no_output_depends_on_what_floats_are_valid(dynid, folder):
    (folder / "s.yaml").write_text(
        graph("u: Se, r: {type: R, value: 1}, a: 0, b: 0", "u -> r, a -> b", "outputs: [r.f]")
    )
    assert dynid("check", "s.yaml")[0] == 0
    assert "the effort of 'a' and 'b' is not determined" in dynid("check", "--explain", "s.yaml")[1]


STUDY = "dynid: 1\nkind: study\nscene: s.yaml\nsampling: {method: list}\nvary: {PATH: {values: [VALUES]}}\n"


@pytest.mark.parametrize(
    ("name", "path", "values"),
    [
        ("two flow sources on a 1-junction", "graph.nodes.r.value", "2, 3"),
        ("a record that is too short", "excitation.0.amplitude", "2, 3"),
        ("a DOF that the matrices have not", "title", "a, b"),
        ("a joint that is indefinite", "measurement.step", "0.001, 0.002"),
    ],
)
def test_the_scene_of_a_study_is_checked_as_by_itself(dynid, data, name, path, values):
    (data / "s.yaml").write_text(CATALOGUE[name][0])
    (data / "study.yaml").write_text(STUDY.replace("PATH", path).replace("VALUES", values))
    code, _, said = dynid("check", "s.yaml")
    checked, _, found = dynid("check", "study.yaml")
    assert checked == code != 0
    assert found == said


def test_what_a_study_sets_is_no_fault_of_its_scene(dynid, data):
    """The scene's joint is indefinite; that of each sample is not."""
    matrix = "joints.i.k.matrix"
    scene = RECORD.replace(
        "joints: {", "joints: {i: {dofs: [1, 2], k: {value: 3, matrix: [[1, 2], [2, 1]]}}, "
    ).replace("file: {path: record.csv}", "simulate: {}")
    (data / "s.yaml").write_text(scene)
    assert dynid("check", "s.yaml")[0] == 2
    (data / "study.yaml").write_text(
        STUDY.replace("PATH", matrix).replace("VALUES", "[[2, 1], [1, 2]], [[3, 1], [1, 3]]")
    )
    assert dynid("check", "study.yaml")[0] == 0


def test_a_path_that_no_run_gives_is_refused_before_the_run(dynid, tmp_path):
    scene = tmp_path / "isolator.yaml"
    path = "bond_graph/properties/m_s.f/v_in/stabel"
    scene.write_text(ISOLATOR.partition("expect:")[0] + f"expect: [{{path: {path}, value: true}}]\n")
    code, _, said = dynid("check", scene)
    assert (code, "did you mean 'stable'?" in said) == (2, True)
    assert dynid("run", scene, "-o", tmp_path / "isolator.h5") == (2, "", said)
    assert not (tmp_path / "isolator.h5").exists()
