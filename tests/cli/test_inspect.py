"""`dynid inspect`: what is in files of all formats, and lines of a scene that read them."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from dynid import load_scene
from tests.files import recorder_files
from tests.files.universal_files import function, mode, nodes, written

pytestmark = pytest.mark.usefixtures("untried")

SHARED = Path(__file__).parents[3] / "shared" / "data"
STEP = 0.002
T = STEP * np.arange(50)


@pytest.fixture
def inspected(dynid, tmp_path):
    """Return entries by name, and the lines of a scene."""

    def inspect(path):
        code, out, err = dynid("inspect", tmp_path / path, "--json")
        assert (code, err) == (0, "")
        content = json.loads(out)
        return {entry.pop("name"): entry for entry in content["entries"]}, content["scene"]

    return inspect


SCENE = """
dynid: 1
kind: identification
structure: {lumped: {masses: [1.2, 0.8], links: [{dofs: [1], k: 1.5e4, c: 4}]}}
joints: {bolt: {dofs: [1, 2], k: {start: 0.9e4}, c: {start: 2}}}
"""


def test_a_recording_is_listed_with_lines_that_are_a_scene(dynid, inspected, tmp_path):
    stated = {"wf_increment": STEP, "wf_start_offset": 0.5}
    groups = {
        "Run 1": {
            "acc 1": (np.sin(T), {**stated, "unit_string": "g"}),
            "force": (T, {**stated, "unit_string": "kN"}),
        }
    }
    path = recorder_files.tdms(tmp_path / "r.tdms", groups | {"Run 2": {"other": (T[:9], {})}})
    entries, lines = inspected("r.tdms")
    clock = {"what": "channel", "size": "50", "step": STEP, "start": 0.5}
    assert entries == {
        "Run 1/acc 1": {**clock, "unit": "g"},
        "Run 1/force": {**clock, "unit": "kN"},
        "Run 2/other": {"what": "channel", "size": "9"},
    }
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE + "\n".join(lines[:2]).replace("…", "1"))
    (channel,) = load_scene(scene).model.measurement.channels
    assert channel.quantity == "acceleration"
    assert dynid("check", scene)[0] == 0
    code, out, _ = dynid("inspect", path)
    assert code == 0
    assert "name         what     size  unit  step [s]  start [s]" in out
    assert (
        "In a scene:\n\n  # a smooth curve between its samples; else state hold: linear or hold: zero\n"
        '  excitation: [{dof: …, kind: file, path: r.tdms, group: "Run 1", column: force}]' in out
    )
    assert "  step: …" in out  # of the second group no step is known


def test_tables_of_text_and_workbooks(inspected, tmp_path):
    import openpyxl

    rows = [("time [s]", "v [m/s]", "x"), *((t, np.sin(t), 1.0) for t in T.tolist())]
    (tmp_path / "r.csv").write_text("\n".join(",".join(map(str, row)) for row in rows))
    entries, lines = inspected("r.csv")
    assert entries["v"] == {"what": "column", "size": "50", "unit": "m/s", "step": STEP, "start": 0.0}
    assert "columns: [v, x]" in lines[0]
    assert "quantity: velocity" in lines[0]
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.create_sheet("sums").append(["a", "b"])
    book["sums"].append([1, "=A2"])
    book.save(tmp_path / "r.xlsx")
    entries, lines = inspected("r.xlsx")
    assert entries["Sheet: v"]["step"] == STEP
    assert "the formula =A2 without its value" in entries["sums"]["note"]
    (tmp_path / "modes.csv").write_text("frequency [Hz],damping,1,2\n4.1,0.01,1,0.4\n9.3,0.02,-0.3,1\n")
    assert inspected("modes.csv")[1] == ["measurement: {modes: {file: modes.csv}}"]
    (tmp_path / "frf.csv").write_text("f,a,b\n1,1+2j,3\n2,2-1j,4\n")
    entries, lines = inspected("frf.csv")
    assert entries["a"] == {"what": "frequency response", "size": "2"}
    assert lines == ["measurement: {frf: {file: {path: frf.csv}, unit: Hz}, channels: […]}"]
    (tmp_path / "parts.csv").write_text("f [Hz],re,im\n1,1,2\n2,2,-1\n")
    entries, lines = inspected("parts.csv")
    assert entries == {"re": {"what": "frequency response", "size": "2"}}
    assert lines == ["measurement: {frf: {file: {path: parts.csv}}, channels: […]}"]


def test_matrices_and_what_else_is_in_their_files(inspected, tmp_path):
    savemat(tmp_path / "m.mat", {"M": np.eye(3), "K": 2 * np.eye(3), "v": T, "s": "text"})
    entries, lines = inspected("m.mat")
    assert entries["M"] == {"what": "matrix", "size": "3 x 3"}
    assert entries["s"] == {"what": "text"}
    assert "structure: {matrices: {mass: {path: m.mat, name: M}, stiffness: {path: m.mat, name: K}}}" in lines
    (tmp_path / "bolt_STIF1.mtx").write_text("1 1 2.0\n1 2 -1.0\n2 2 2.0\n")
    entries, lines = inspected("bolt_STIF1.mtx")
    assert entries["bolt_STIF1.mtx"]["size"] == "2 x 2"
    assert lines == ["structure: {matrices: {stiffness: bolt_STIF1.mtx, mass: …}}"]
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["run/A"], file["run/B"] = np.eye(2), np.ones((2, 2))
    assert inspected("x.h5")[1] == ["structure: {matrices: {state_space: {path: x.h5}}}"]


def test_results_of_a_modal_analysis_are_modes(inspected):
    entries, lines = inspected(Path(__file__).parents[2] / "data" / "chain_modal.h5")
    assert entries["modal/frequency"] == {"what": "channel", "size": "5", "unit": "rad/s"}
    assert entries["modal/fit/synthesis"] == {"what": "complex numbers"}
    assert lines == ["measurement: {modes: {file: chain_modal.h5}}"]


def test_universal_files_have_functions_nodes_and_modes(inspected, tmp_path):
    points = nodes([1, 2], [[0, 0, 0], [1, 0, 2.0]])
    written(tmp_path / "x.uff", points, function(np.sin(T)), mode(4.0, [1, 2], [0.1, 0.2], [0, 0], [1, 0.5]))
    entries, lines = inspected("x.uff")
    assert entries["nodes"] == {"what": "nodes", "size": "2", "note": "x 0 to 1, y 0 to 0, z 0 to 2"}
    assert entries["modes"]["note"] == "4 to 4 Hz"
    (history,) = (entry for entry in entries.values() if entry["what"] == "time history")
    assert history == {"what": "time history", "size": "50", "step": 0.01, "note": "1:z"}
    assert lines == [
        "measurement: {file: {path: x.uff}, channels: all}",
        "structure: {matrices: {…, nodes: x.uff}}",
        "measurement: {modes: {file: x.uff}}",
    ]


def test_arrays_with_times_text_and_nothing_even(inspected, dynid, tmp_path):
    np.savez(tmp_path / "r.npz", time=T, acc=np.sin(T), said=np.array(["a"]), wide=np.eye(4))
    entries, lines = inspected("r.npz")
    assert entries["time"]["what"] == "times"
    assert entries["acc"] == {"what": "channel", "size": "50", "step": STEP, "start": 0.0}
    assert entries["said"] == {"what": "text", "size": "1"}
    assert entries["wide"] == {"what": "matrix", "size": "4 x 4"}
    assert len(lines) == 1
    np.savez(tmp_path / "down.npz", time=-T, force=T)
    assert "step" not in inspected("down.npz")[0]["force"]
    code, out, _ = dynid("inspect", tmp_path / "down.npz")
    assert code == 0
    assert "  step: …" in out


def test_what_of_a_universal_file_is_not_read_is_said(inspected, tmp_path):
    H = np.exp(1j * T)
    frf = function(
        H, kind=4, reference=(2, -1), id1="H", ordinate_spec_data_type=12, orddenom_spec_data_type=13
    )
    psd = function(np.abs(H), kind=9, id1="S")
    operating = {"analysis_type": 5, "freq_step_n": 1, "freq": 4.0, "load_case": 1}
    other = {**mode(4.0, [1, 2], [0.1, 0.2], [0, 0], [1, 0.5]), **operating}
    written(tmp_path / "x.uff", frf, psd, other)
    entries, lines = inspected("x.uff")
    assert entries["H"]["what"] == "frequency response"
    assert entries["H"]["note"] == "1:z over 2:-x"
    assert entries["S"]["what"] == "power spectral density"
    assert "mode shapes" in entries["results"]["note"]
    assert lines == ["measurement: {frf: {file: {path: x.uff}}, channels: all}"]


def test_texts_of_complex_numbers_are_modes_or_responses_or_said_to_be_none(inspected, dynid, tmp_path):
    (tmp_path / "m.csv").write_text("frequency (Hz),damping,1,2\n10,0.01,1+1j,2\n20,0.02,1-1j,3j\n")
    entries, lines = inspected("m.csv")
    assert entries == {"modes": {"what": "modes", "size": "2 at 2 DOFs", "note": "10 to 20 Hz"}}
    assert lines == ["measurement: {modes: {file: m.csv}}"]
    (tmp_path / "n.csv").write_text("frequency,damping,1\n10,0.01,1j\n")
    entries, lines = inspected("n.csv")
    assert entries["modes"]["note"] == "10 to 10"
    assert lines == ["measurement: {modes: {file: n.csv, unit: Hz}}"]
    (tmp_path / "h.csv").write_text("f (Hz),H1\n1,1+2j\n2,2-1j\n")
    assert inspected("h.csv")[0] == {"H1": {"what": "frequency response", "size": "2"}}
    for name, text in (("r.csv", "t,x\n0,1+2j\n0.1,2j\n"), ("K.txt", "1+2j 2\n2 3+1j\n")):
        (tmp_path / name).write_text(text)
        code, _, err = dynid("inspect", tmp_path / name)
        assert code == 4
        assert "'1+2j' is a complex number, where real ones are read. Frequency responses are read by" in err
    text = "%%MatrixMarket matrix coordinate complex symmetric\n1 1 1\n1 1 1 2\n"
    (tmp_path / "K.mtx").write_text(text)
    err = dynid("inspect", tmp_path / "K.mtx")[2]
    assert err.strip().endswith("K.mtx:1: the matrix is complex; what is read is real or double or integer")


def test_meshes_and_nodes(inspected, tmp_path):
    (tmp_path / "m.inp").write_text(
        "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n*NSET, NSET=base\n1, 2\n"
        "*ELEMENT, TYPE=C3D4, ELSET=body\n1, 1, 2, 3, 4\n"
    )
    entries, lines = inspected("m.inp")
    assert entries["nodes"]["size"] == "4"
    assert entries["tetra"] == {"what": "elements", "size": "1"}
    assert entries["base"] == {"what": "set of nodes", "size": "2"}
    assert "structure: {solid: {mesh: m.inp, materials: …}}" in lines


def test_what_cannot_be_read_of_a_file_is_said_below_the_lines(dynid, tmp_path):
    elements = "*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 9\n"
    (tmp_path / "m.inp").write_text(f"*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n{elements}")
    code, out, err = dynid("inspect", tmp_path / "m.inp")
    assert (code, err) == (0, "")
    assert "nodes  nodes" in out
    assert "not read: " in out
    assert "an element has the node 9, which is not there" in " ".join(out.split())


def test_the_step_of_rounded_stamps_is_that_of_the_rate(inspected, tmp_path):
    times = np.arange(2000) / 25_600
    (tmp_path / "a.csv").write_text("time,a\n" + "".join(f"{t:.7f},1\n" for t in times))
    entries, _ = inspected("a.csv")
    assert entries["a"]["step"] == 1 / 25_600


def test_what_is_no_data_file_is_refused(dynid, tmp_path):
    (tmp_path / "b.json").write_text('{"a": [1, 2]}')
    code, _, err = dynid("inspect", tmp_path / "b.json")
    assert code == 4
    assert "is a JSON text, from which no records are read. In Python: pandas.read_json(" in err
    (tmp_path / "a.json").write_text("a: b")
    code, _, err = dynid("inspect", tmp_path / "a.json")
    assert code == 4
    assert "ends in .json, as no format does, and is no text table. Formats end in .mtx" in err
    (tmp_path / "a.op4").write_bytes(b"x" * 50)
    code, _, err = dynid("inspect", tmp_path / "a.op4")
    assert code == 4
    assert "cannot be read as Nastran OUTPUT4" in err
    assert dynid("inspect", tmp_path / "none.csv")[0] == 4


@pytest.mark.skipif(not SHARED.is_dir(), reason="the files of other programs are not here")
@pytest.mark.parametrize(
    ("name", "entry", "expected"),
    [
        ("fe/bcsstk01.mtx", "bcsstk01.mtx", {"size": "48 x 48", "note": "400 entries"}),
        ("fe/outboard.op4", "kxx", {"size": "46 x 46", "what": "matrix"}),
        ("fe/outboard.pch", "nodes", {"size": "4"}),
        ("fe/block_a-eig.exo", "modes", {"size": "50"}),
        ("measured/Sample_UFF58b_bin.uff", "Mic 01.0Scalar", {"size": "79292", "unit": "Pa"}),
        ("measured/robot_arm.dat", "column 2", {"size": "1024"}),
        ("updating/ExpModeInfo_FEM.mat", "psiExp_m", {"size": "58 x 5"}),
    ],
)
def test_files_of_other_programs(inspected, name, entry, expected):
    assert expected.items() <= inspected(SHARED / name)[0][entry].items()


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="the files of other programs are not here")
def test_every_file_of_other_programs_is_listed_or_refused_with_its_formats(dynid):
    for path in sorted(SHARED.rglob("*.*")):
        code, out, err = dynid("inspect", path)
        if path.suffix in (".json", ".md"):
            assert (code, out) == (4, ""), path
            assert "as no format does" in err or "is a JSON text" in err
        else:
            assert (code, err) == (0, ""), path
            assert len(out.splitlines()) > 3
