"""Scenes of kind reduction: what they give, and what is refused, where, and in which words."""

import numpy as np
import pytest
from scipy.linalg import eigh

import dynid
from dynid.checks import compare
from dynid.cli import main
from dynid.defaults import Limit
from dynid.report.content.reduction import remarks
from tests.scene.example_scenes import REDUCTIONS, check, faults_of
from tests.structure.systems import FE


@pytest.fixture(scope="module")
def result():
    return dynid.run(check(REDUCTIONS))


def test_every_method_has_its_group_and_a_second_use_a_number(result):
    names = ["serep", "joint-aware", "guyan", "irs", "dynamic", "craig-bampton", "modal", "serep_2"]
    assert list(result["reduction/method"].data) == names
    for name in names:
        group = f"reduction/{name}"
        size = result[f"{group}/T"].data.shape[1]
        for part in ("mass", "stiffness", "damping"):
            assert result[f"{group}/{part}"].data.shape == (size, size)
        mass, stiffness = (result[f"{group}/{part}"].data for part in ("mass", "stiffness"))
        frequencies = result[f"{group}/frequencies"].data
        np.testing.assert_allclose(np.sqrt(eigh(stiffness, mass, eigvals_only=True)), frequencies, rtol=1e-9)
        reference = result[f"{group}/reference"].data
        error = result[f"{group}/frequency_error"].data
        np.testing.assert_allclose(frequencies / reference - 1, error, atol=1e-12)
        assert error.min() > -1e-12  # Ritz values lie above
        assert result[f"{group}/mac"].data.shape == (len(frequencies),) * 2
        assert result[f"reduction/frf/{name}"].data.shape == result["reduction/frf/full"].data.shape
    assert result["reduction/serep/masters"].data.tolist() == [1, 3, 5]
    assert result["reduction/guyan/masters"].data.tolist() == [2, 3, 4, 5]  # joints, then the force
    assert len(result["reduction/serep_2/masters"].data) >= 4


def test_what_is_exact_is_so_in_the_result(result):
    group = "reduction/joint-aware"
    assert np.abs(result[f"{group}/frequency_error"].data).max() < 1e-12
    np.testing.assert_allclose(result[f"{group}/mac"].data.diagonal(), 1, rtol=1e-12)
    np.testing.assert_allclose(result[f"{group}/orthogonality"].data, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(result[f"{group}/energy_error"].data, 0, atol=1e-9)
    assert list(result[f"{group}/part"].data) == ["base", "rest", "upper", "lower"]
    assert np.abs(result["reduction/serep/energy_error"].data).max() > 1e-3
    np.testing.assert_allclose(result["reduction/serep/energy_error"].data.sum(axis=1), 0, atol=1e-9)


def test_the_response_is_that_of_the_projected_matrices(result):
    group = "reduction/craig-bampton"
    T = result[f"{group}/T"].data
    M, C, K = (result[f"{group}/{part}"].data for part in ("mass", "damping", "stiffness"))
    w = result["reduction/frf/omega"].data[17]
    response = 1j * w * T[1] @ np.linalg.solve(K + 1j * w * C - w**2 * M, T[4])
    assert result["reduction/frf/craig-bampton"].data[17, 0, 0] == pytest.approx(response, rel=1e-10)
    frac = result["reduction/frf/frac"].data[:, 0, 0]
    a, b = result["reduction/frf/full"].data[:, 0, 0], result["reduction/frf/guyan"].data[:, 0, 0]
    expected = abs(np.vdot(a, b)) ** 2 / (np.vdot(a, a) * np.vdot(b, b)).real
    assert frac[2] == pytest.approx(expected, rel=1e-10)


def test_the_same_scene_gives_the_same_data_whatever_it_cost(result):
    again = dynid.run(check(REDUCTIONS))
    for path, variable in again.items():
        if variable.data.dtype.kind in "bifc":
            assert variable.data.tobytes() == result[path].data.tobytes(), path
    assert again.group_attrs["reduction/serep"]["seconds"] > 0
    assert again.equals(result)
    assert compare(again, result) == []


def test_modes_retained_of_the_structure_are_compared_with_their_like():
    text = REDUCTIONS.replace("joints:\n  upper: {dofs: [2, 3], k: 2.0e4, c: 20}\n", "")
    text = text.replace("  lower: {dofs: [3, 4], k: {value: 2.0e4}}\n", "")
    text = text.replace("masters: [1, 3, 5], modes: [1, 2, 3]}", "masters: [1, 3, 5], modes: [5, 1, 3]}")
    text = text.replace("{method: guyan}", "{method: guyan, masters: [1, 3, 4]}")
    text = text.replace("masters: [1, 3], ", "masters: [1, 3, 4], ").replace("count: 4", "count: 2")
    text = text.replace("links: [", "links: [{dofs: [2, 3], k: 2.0e4}, {dofs: [3, 4], k: 2.0e4, c: 20}, ")
    result = dynid.run(check(text))
    assert result["reduction/serep/mode"].data.tolist() == [1, 3, 5]
    assert np.abs(result["reduction/serep/frequency_error"].data).max() < 1e-12


def test_without_frequencies_no_response_is_computed():
    head = REDUCTIONS[: REDUCTIONS.index("frequency: {start")].replace("  - {method: guyan}\n", "")
    result = dynid.run(check(head))
    assert not [path for path in result if path.startswith("reduction/frf")]


FIRST = "{method: serep, masters: [1, 3, 5], modes: [1, 2, 3]}"


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ("{method: serep, masters: [1, 3, 3], modes: [1]}", "11:30: DOF 3 is listed twice"),
        ("{method: serep, masters: [1, 9], modes: [1]}", "11:34: there is no DOF 9; the structure has 5"),
        ("{method: serep, masters: [1, 3], modes: [1, 1]}", "11:45: mode 1 is listed twice"),
        ("{method: serep, masters: [1, 3], modes: [0, 1]}", "11:46: this entry must be at least 1, not 0"),
        ("{method: serep, masters: [1], modes: [1, 2]}", "11:5: 2 modes are more than 1 master can"),
        ("{method: joint-aware, masters: {count: 2}, modes: {count: 3}}", "11:5: 3 modes are more than 2"),
        ("{method: serep, masters: [1], modes: {count: 0}}", "11:5: at least one mode is needed"),
        ("{method: serep, modes: {count: 2, below: 3}}", "11:28: modes are given by their 'count', or as"),
        ("{method: serep, masters: 3}", "11:30: 'masters' must be a list, not 3"),
        ("{method: serep, masters: {cuont: 3}}", "11:31: 'cuont' is not a key of reduction.0.masters; did"),
        ("{method: serep, masters: {choose: rq}}", "11:39: 'choose' cannot be 'rq'; it is one of qr,"),
        ("{method: serap}", "11:14: 'method' cannot be 'serap'; it is one of serep, guyan, dynamic, irs,"),
        ("{mehtod: serep}", "11:6: 'mehtod' is not a key of reduction.0; did you mean 'method'?"),
        ("{masters: [1]}", "11:5: reduction.0 needs the key 'method'"),
        ("{method: guyan, modes: [1]}", "11:21: 'modes' is not a key of reduction.0"),
        ("{method: joint-aware, residuals: [1, 9]}", "11:42: there is no DOF 9; the structure has 5"),
        ("{method: modal, residuals: all}", "11:32: 'residuals' cannot be 'all'; it is one of auto, none"),
        ("{method: irs, iterations: 0}", "11:31: 'iterations' must be at least 1, not 0"),
        ("{method: dynamic, frequency: -1}", "11:34: -1 is negative"),
        ("serep", "11:5: this entry must be a mapping, not 'serep'"),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(wrong, fault):
    found = faults_of(REDUCTIONS.replace(FIRST, wrong))
    assert len(found) == 1, found
    assert found[0].startswith(fault), found


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("k: {value: 2.0e4}", "k: {start: 1, true: 2}", "9:29: the joints of a comparison are known: give a"),
        ("inputs: [5]", "inputs: [6]", "20:10: there is no DOF 6; the structure has 5"),
        ("{base: [1, 2]}", "{base: [1, 6]}", "22:27: there is no DOF 6; the structure has 5"),
        ("frequency: {start: 10, stop: 100}\n", "", "1:1: 'inputs' and 'outputs' are of frequency responses"),
    ],
)
def test_the_rest_of_the_scene_is_checked_too(right, wrong, fault):
    found = faults_of(REDUCTIONS.replace(right, wrong))
    assert len(found) == 1, found
    assert found[0].startswith(fault), found


@pytest.mark.parametrize(
    ("wrong", "code", "said"),
    [
        (
            "{method: serep, masters: [1, 2], modes: [1, 9]}",
            2,
            ":11:38: 9 modes are asked for, but the struct",
        ),
        ("{method: guyan, masters: {count: 30}}", 2, ":11:21: 30 "),
        ("{method: serep, masters: {count: 2}, modes: {below: 1000}}", 2, ":11:42: 5 modes are more than 2"),
        ("{method: joint-aware, modes: {below: 0.1}}", 2, ":11:27: no mode lies below 0.1 rad/s"),
        ("{method: serep, masters: [4, 5], modes: [1, 3]}", 3, " is invisible at the 2 masters 4, 5 ("),
    ],
)
def test_what_a_run_finds_out_is_said_at_its_place(wrong, code, said, tmp_path, capsys):
    scene = tmp_path / "s.yaml"
    scene.write_text(REDUCTIONS.replace(FIRST, wrong))
    with pytest.raises(SystemExit) as left:
        main(["run", str(scene), "-o", str(tmp_path / "s.h5")])
    error = capsys.readouterr().err
    assert left.value.code == code, error
    assert said in error
    assert len(error.splitlines()) == 1


def test_the_screen_is_one_table(tmp_path, capsys):
    scene = tmp_path / "s.yaml"
    scene.write_text(REDUCTIONS)
    with pytest.raises(SystemExit) as left:
        main(["run", str(scene), "-o", str(tmp_path / "s.h5")])
    out = capsys.readouterr().out
    assert left.value.code == 0
    assert "reduction · 8 methods" in out
    row = next(line for line in out.splitlines() if line.strip().startswith("joint-aware "))
    assert row.split()[1:5] == ["3", "38.05", "94.80", "156.4"]  # size, then the natural frequencies


@pytest.mark.parametrize(
    ("mass", "stiffness"), [("bcsstm08", "bcsstk08"), ("blockC3D8_MASS1", "blockC3D8_STIF1")]
)
def test_multiple_and_rigid_modes_of_real_matrices_are_compared_with_their_like(mass, stiffness):
    if not FE.is_dir():
        pytest.skip(f"the matrices of {FE} are not here")
    text = (
        "dynid: 1\nkind: reduction\n"
        f"structure: {{matrices: {{mass: {FE}/{mass}.mtx, stiffness: {FE}/{stiffness}.mtx}}}}\n"
        "reduction:\n  - {method: serep, modes: {count: 10}}\n  - {method: serep, modes: [1, 3, 8]}\n"
        "  - {method: guyan, masters: {count: 12}}\n"
    )
    result = dynid.run(check(text))
    for name in ("serep", "serep_2"):
        assert np.abs(result[f"reduction/{name}/frequency_error"].data).max() < 1e-10
        np.testing.assert_allclose(result[f"reduction/{name}/mac"].data.diagonal(), 1, rtol=1e-6)
    rigid = 6 if "block" in mass else 0
    assert np.count_nonzero(result["reduction/guyan/frequencies"].data == 0) == rigid


def test_the_screen_shows_the_elastic_modes_of_a_free_structure(tmp_path, capsys):
    scene = tmp_path / "free.yaml"
    scene.write_text(
        "dynid: 1\nkind: reduction\nstructure: {beam: {elements: 4, length: 1, EI: 1, rhoA: 1}}\n"
        "reduction: [{method: modal, modes: {count: 4}}]\n"
    )
    with pytest.raises(SystemExit):
        main(["run", str(scene), "-o", str(tmp_path / "free.h5")])
    out = capsys.readouterr().out
    header, full, row = (line.split() for line in out.splitlines()[3:6])
    assert header[:3] == ["size", "ω3", "ω4"]
    assert full[:2] == ["full", "10"]
    assert full[2:4] == row[2:4]
    assert "modes 1 … 2: of the rigid body, ω = 0" in out


def test_an_indefinite_block_of_a_joint_is_refused_at_the_joint(tmp_path, capsys):
    scene = tmp_path / "s.yaml"
    scene.write_text(
        "dynid: 1\nkind: reduction\nstructure: {lumped: {masses: [1, 2]}}\n"
        "joints:\n  bolt: {dofs: [1, 2], k: [[1, -3], [-3, 1]]}\nreduction: [{method: guyan}]\n"
    )
    with pytest.raises(SystemExit) as stop:
        main(["run", str(scene), "-o", str(tmp_path / "s.h5")])
    assert stop.value.code == 2
    assert "s.yaml:5:3: a joint's matrix must not be indefinite" in capsys.readouterr().err


def test_a_response_between_two_dofs_has_both_among_its_masters():
    text = """\
dynid: 1
kind: reduction
structure:
  beam: {elements: 4, length: 4, EI: 100.0, rhoA: 0.1, supports: [{node: 1, fix: [w, theta]}]}
reduction: [{method: guyan}]
frequency: {start: 1, stop: 20, points: 3}
inputs: [7]
outputs: [{dofs: [3, 5], quantity: displacement}]
"""
    assert list(dynid.run(check(text))["reduction/guyan/masters"].data) == [7, 3, 5]


def test_modes_of_the_full_structure_are_computed_where_a_basis_has_them_or_they_are_asked_for(monkeypatch):
    def comparisons(text):
        result = dynid.run(check(text))
        names = result["reduction/method"].data
        assert all(f"reduction/{name}/frequencies" in result for name in names)
        lacking = [name for name in names if f"reduction/{name}/frequency_error" not in result]
        assert lacking == [name for name in names if f"reduction/{name}/reference" not in result]
        return set(names) - set(lacking), result

    every = set(dynid.run(check(REDUCTIONS))["reduction/method"].data)
    retaining, result = comparisons(f"{REDUCTIONS}compare: false\n")
    assert retaining
    assert not retaining & {"guyan", "irs", "dynamic", "craig-bampton"}
    said = [statement for statement in remarks(result) if "not compared with modes" in str(statement)]
    assert len(said) == len(every - retaining)
    monkeypatch.setattr("dynid.scene.kinds.reduction.COMPARED_DOFS", Limit(2, ""))
    assert comparisons(REDUCTIONS)[0] == retaining
    assert comparisons(f"{REDUCTIONS}compare: true\n")[0] == every
    named = f"{REDUCTIONS}expect: [{{path: reduction/guyan/mac, min: -1}}]\n"
    assert comparisons(named)[0] == every
