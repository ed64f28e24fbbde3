"""Models that other programs wrote, against their own eigenvalues; damaged files end in one sentence."""

import importlib.util
import json
import re
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file, savemat

from dynid.errors import DynidError, FileError, SceneError
from dynid.files import input_file
from dynid.files.fe_text import check_reference
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_structure import imported, model_files, read_nodes
from dynid.scene.explanation import explain
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.structure.modes.modes import modes
from tests.copies import answers

pytestmark = pytest.mark.usefixtures("untried")

DATA = Path(__file__).parents[1] / "data" / "fe"
FE = Path(__file__).parents[3] / "shared" / "data" / "fe"
needs_data = pytest.mark.skipif(not FE.is_dir(), reason="the shared data are not here")
needs_pyyeti = pytest.mark.skipif(
    importlib.util.find_spec("pyyeti") is None, reason="pyyeti is not installed"
)


def model_of(path, **more):
    files = model_files(path)
    return imported(files.mass, files.stiffness, files.damping, nodes=files.nodes, **more)


def strain(model):
    R = model.nodes.rigid(model.dofs)
    return np.abs(model.K @ R) / np.maximum(np.abs(model.K) @ np.abs(R), 1e-300)


def test_calculix():
    """A held bracket: its DOFs without those of the support, and the eigenvalues that ccx prints."""
    model = model_of(DATA / "bracket.inp")
    assert model.size == 33
    assert model.dofs[:4] == ("25:x", "25:y", "25:z", "26:x")
    assert model.nodes.sets["TIP"] == (31, 32, 33, 34, 35)
    assert model.nodes.sets["HELD"] == (11, 12, 13, 14)
    sides = [{line[k - 1], line[k]} for line in model.nodes.lines for k in range(len(line))]
    assert all(side in sides for side in ({11, 12}, {31, 35}, {33, 42}))
    assert "constraints, which are not applied: 1 *BOUNDARY" in model.nodes.notes
    expected = np.loadtxt(DATA / "bracket_eigenvalues.txt")
    found = modes(model.M, model.C, model.K, len(expected)).omega ** 2
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    free = model_of(DATA / "free.inp")
    assert strain(free).max() < 1e-10
    assert not free.nodes.doubts
    assert modes(free.M, free.C, free.K, 8).rigid == 6


def test_abaqus_with_nodes_and_components(tmp_path):
    """Lines ``node, component, node, component, value`` beside the input file of the job."""
    dofs = (DATA / "bracket.dof").read_text().replace(".", ", ").splitlines()
    for name, ending in (("STIF1", ".sti"), ("MASS1", ".mas")):
        entries = (line.split() for line in (DATA / f"bracket{ending}").read_text().splitlines())
        lines = [f"{dofs[int(row) - 1]}, {dofs[int(column) - 1]}, {value}" for row, column, value in entries]
        (tmp_path / f"job_{name}.mtx").write_text("\n".join(lines))
    text = (DATA / "bracket.inp").read_text().replace("NSET=TIP", "NSET=Tip")
    (tmp_path / "job.inp").write_text(text, encoding="utf-8-sig")  # with a byte order mark, as Mecway's
    model, other = model_of(tmp_path / "job.inp"), model_of(DATA / "bracket.inp")
    assert model.dofs[:4] == ("25:1", "25:2", "25:3", "26:1")
    np.testing.assert_array_equal(model.K, other.K)
    np.testing.assert_array_equal(model.row("42:z"), other.row("42:z"))
    assert model.nodes.sets["Tip"] == (31, 32, 33, 34, 35)
    assert not model.nodes.doubts


def test_opensees():
    """Full rows of printA, DOFs by the table of nodes."""
    model = imported(
        MatrixFile(DATA / "frame_M.out"), MatrixFile(DATA / "frame_K.out"), nodes=DATA / "frame_nodes.csv"
    )
    assert model.dofs[-4:] == ("4:rz", "5:rx", "5:ry", "5:rz")
    expected = json.loads((DATA / "frame_eigenvalues.json").read_text())
    found = modes(model.M, model.C, model.K, 10).omega ** 2
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    # Nodes 3 and 4 have no supported neighbour but node 5: those of node 3 are in balance.
    rows = [place for place, dof in enumerate(model.dofs) if dof.startswith("3:")]
    assert strain(model)[rows].max() < 1e-12
    assert not model.nodes.doubts


def harwell_boeing(K, name="bcsstk  ", kind="RSA", wide=20):
    """A file as Ansys or the collection has it: fixed columns, Fortran's formats."""
    from scipy.sparse import csc_array, tril

    low = csc_array(tril(csc_array(K)) if kind[1] == "S" else csc_array(K))
    low.sort_indices()

    def cards(numbers, width, count, form):
        words = [form(number).rjust(width) for number in numbers]
        return ["".join(words[k : k + count]) for k in range(0, len(words), count)]

    starts = cards(low.indptr + 1, 8, 10, str)
    rows = cards(low.indices + 1, 8, 10, str)
    values = cards(low.data, wide, 80 // wide, lambda value: f"{value:.12E}".replace("E", "D"))
    total = len(starts) + len(rows) + len(values)
    head = [
        f"{'A stiffness':72}{name}",
        f"{total:14d}{len(starts):14d}{len(rows):14d}{len(values):14d}{0:14d}",
        f"{kind}{'':11}{K.shape[0]:14d}{K.shape[1]:14d}{low.nnz:14d}{0:14d}",
        f"{'(10I8)':16}{'(10I8)':16}{f'(1P,{80 // wide}D{wide}.12)':20}{'':20}",
    ]
    return "\n".join([*head, *starts, *rows, *values]) + "\n"


K = np.array([[4.0, -1.5, 0.0], [-1.5, 3.0, -1.0e-3], [0.0, -1.0e-3, 2.0]])


@pytest.mark.parametrize("kind", ["RSA", "RUA"])
@pytest.mark.parametrize("ending", ["rsa", "rb", "matrix", "hb"])
def test_harwell_boeing(tmp_path, kind, ending):
    (tmp_path / f"k.{ending}").write_text(harwell_boeing(K, kind=kind))
    found = read_matrix(MatrixFile(tmp_path / f"k.{ending}"), "stiffness")
    np.testing.assert_array_equal(found.matrix.toarray(), K)
    assert not found.labels


def test_a_mapping_of_ansys(tmp_path):
    (tmp_path / "k.matrix").write_text(harwell_boeing(K))
    (tmp_path / "k.mapping").write_text(" Matrix Eqn    Node      DOF\n 1  12  UX\n 3  12  ROTZ\n 2  7  UY\n")
    found = read_matrix(MatrixFile(tmp_path / "k.matrix"), "stiffness")
    assert found.labels == ("12:UX", "7:UY", "12:ROTZ")
    (tmp_path / "k.mapping").write_text(" Matrix Eqn    Node      DOF\n 1  12  UX\n")
    with pytest.raises(FileError, match=re.escape("k.mapping names 1 rows of 3")):
        read_matrix(MatrixFile(tmp_path / "k.matrix"), "stiffness")


def test_structures_of_matlab(tmp_path):
    """Fields of a structure, written by SciPy: matrices, nodes, DOFs as node.component."""
    from scipy.sparse import csc_array

    xyz = np.array([[3.0, 0, 0, 0], [8, 1, 0, 0], [5, 1, 2, 0]])
    k = np.diag(np.arange(1.0, 10)) + 0.1
    dof = [[node + component / 100] for node in (8, 3, 5) for component in (1, 2, 3)]
    fields = {"K": csc_array(k), "M": np.eye(9), "nodes": xyz, "DOF": dof, "name": "x", "deep": {"C": k}}
    for compressed in (False, True):
        savemat(tmp_path / "m.mat", {"model": fields, "other": np.eye(2)}, do_compression=compressed)
        model = model_of(tmp_path / "m.mat")
        np.testing.assert_array_equal(model.K, k)
        np.testing.assert_array_equal(model.C, k)
        assert model.dofs[:4] == ("8:x", "8:y", "8:z", "3:x")
        np.testing.assert_array_equal(model.nodes.xyz[2], [1, 2, 0])
    with h5py.File(tmp_path / "m.h5", "w") as store:  # columns of node and component
        store["model/K"], store["model/M"], store["model/nodes"] = k, np.eye(9), xyz
        store["model/dofs"] = [[node, component] for node in (8, 3, 5) for component in (1, 2, 3)]
    assert model_of(tmp_path / "m.h5").dofs == model.dofs


@needs_pyyeti
def test_dmig_matrices(tmp_path):
    """Written by pyyeti: symmetric, one triangle or both, scalar points."""
    import pandas as pd
    from pyyeti.nastran import bulk

    dofs = pd.MultiIndex.from_tuples([(3, 1), (3, 2), (3, 6), (11, 0)], names=["id", "dof"])
    k = np.array([[4.0, -1.5, 0, 1], [-1.5, 3, -1e-3, 0], [0, -1e-3, 2, 0], [1, 0, 0, 5]])
    frames = {name: pd.DataFrame(matrix, dofs, dofs) for name, matrix in (("KAAX", k), ("MAAX", np.eye(4)))}
    bulk.wtdmig(str(tmp_path / "m.pch"), frames)
    with (tmp_path / "m.pch").open("a") as stream:
        stream.write("GRID    3               1.      2.      3.\nSPOINT  11\n")
    model = model_of(tmp_path / "m.pch")
    assert model.dofs == ("3:x", "3:y", "3:rz", 11)
    np.testing.assert_array_equal(model.K, k)
    np.testing.assert_array_equal(model.nodes.xyz, [[1, 2, 3]])


@needs_data
@needs_pyyeti
def test_a_scene_names_one_file_of_a_model(tmp_path):
    for name in ("outboard.op4", "outboard.pch"):
        (tmp_path / name).write_bytes((FE / name).read_bytes())
    scene = "dynid: 1\nkind: reduction\nstructure:\n  matrices: {model: outboard.op4}\n"
    (tmp_path / "s.yaml").write_text(scene + "reduction: [{method: modal, modes: {count: 8}}]\n")
    result = run_scene(load_scene(tmp_path / "s.yaml"))
    assert result["reduction/dof"].data.tolist()[:3] == ["3:x", "3:y", "3:z"]


@pytest.mark.parametrize("cut", [0, 1, 7, 100, 5000, 11_000])
@pytest.mark.parametrize("damaged", ["bracket.inp", "bracket.sti", "bracket.mas", "bracket.dof"])
def test_truncated_files_of_calculix(tmp_path, damaged, cut):
    """Refused, or what is left is a model: an input file may end anywhere behind its nodes."""
    for name in ("bracket.inp", "bracket.sti", "bracket.mas", "bracket.dof"):
        content = (DATA / name).read_bytes()
        (tmp_path / name).write_bytes(content[:cut] if name == damaged else content)
    if cut > (DATA / damaged).stat().st_size:
        pytest.skip("the file is shorter")
    if damaged == "bracket.inp" and cut >= 100:
        (doubt,) = model_of(tmp_path / "bracket.inp").nodes.doubts
        assert doubt == "33 DOFs of 33 have nodes that are not there, first 25"
        return
    with pytest.raises(FileError):
        model_of(tmp_path / "bracket.inp")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no nodes"),
        ("1, 0., 0.\n", "it does not start with a keyword"),
        ("*NODE\n1, 0., x\n", "cannot be read as an input file"),
        ("*PART, NAME=A\n*NODE\n1, 0.\n*PART, NAME=B\n*NODE\n1, 2.\n", "has several parts"),
        ("*NODE\n1, 0.\n*NGEN\n1, 5\n", "has *NGEN, which is not read"),
        ("*NODE, SYSTEM=C\n1, 0.\n", "in a system other than Cartesian"),
        ("*INCLUDE, INPUT=m.inp\n", "refers to another file, 'm.inp', which is not followed"),
        ("*NODE, INPUT=../n.txt\n", "refers to another file, '../n.txt', which is not followed"),
        ("*NODE\n1, 0.\n*NSET, NSET=A, GENERATE\n1, 99999999999, 1\n", "it has a set from 1 to 99999999999"),
        ("*NODE\n1, nan, 0., 0.\n", "finite coordinates"),
        ("*NODE\n1, 0.\n*INSTANCE, NAME=I, PART=P\n1., 0., 0.\n", "has a moved instance"),
    ],
)
def test_damaged_input_files(tmp_path, text, said):
    (tmp_path / "m.inp").write_text(text)
    with pytest.raises(FileError, match=re.escape(said)):
        read_nodes(tmp_path / "m.inp")


@pytest.mark.parametrize("count", [1, 3])
def test_files_that_include_each_other_end(tmp_path, count):
    files = [tmp_path / f"{number}.inp" for number in range(count)]
    for number, file in enumerate(files):
        file.write_text(f"*INCLUDE, INPUT={(number + 1) % count}.inp\n")
    with pytest.raises(FileError, match="too many files include each other"):
        input_file.read_nodes(files[0], partial(check_reference, includes=files))


def spoiled(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("RSA", "RSE", "holds a matrix of type RSE"),
        ("RSA", "CSA", "holds a matrix of type CSA"),
        (
            "             3             3             5",
            "             3             4             5",
            "cannot be",
        ),
        (
            "             3             3             5",
            "       9999999       9999999             5",
            "truncated",
        ),
        (
            "             3             3             5",
            "             3             3     999999999",
            "claims a matrix",
        ),
        (
            "             3             3             5",
            "            -3             3             5",
            "sizes are no whole numbers from 0",
        ),
        ("RSA", "CSA", "holds a matrix of type CSA; what is read is RSA or RUA: real, assembled"),
        ("(10I8)", "(99999I8)", "are no formats"),
        ("(10I8)", "(10F8)", "formats are not those"),
        ("(10I8)", "garbage", "formats are not those"),
        ("D+00", "Q+00", "cannot be read as a Harwell-Boeing file"),
    ],
)
def test_damaged_harwell_boeing(tmp_path, old, new, said):
    (tmp_path / "k.rsa").write_text(spoiled(harwell_boeing(K), old, new))
    with pytest.raises(FileError, match=said):
        read_matrix(MatrixFile(tmp_path / "k.rsa"), "stiffness")


@pytest.mark.parametrize("kept", [0, 0.1, 0.5, 0.8, 0.96])
def test_a_truncated_harwell_boeing_file(tmp_path, kept):
    (tmp_path / "k.rsa").write_text(harwell_boeing(K)[: int(kept * 470)])
    with pytest.raises(FileError, match=r"k\.rsa"):
        read_matrix(MatrixFile(tmp_path / "k.rsa"), "stiffness")


def test_rows_that_are_no_square_matrix(tmp_path):
    (tmp_path / "k.out").write_text("1 2\n3 4\n5 6\n")
    with pytest.raises(FileError, match="has 3 rows of 2 numbers"):
        read_matrix(MatrixFile(tmp_path / "k.out"), "stiffness")


def test_scripts_that_are_no_matrix(tmp_path):
    for text in (
        "a = [\n1 1 2;\n",
        "a=[\n1 1 2;\n];\nb = 3;\n",
        "a=[\n1 1;\n];\na=sparse(a(:,1),a(:,2),a(:,3))\n",
    ):
        (tmp_path / "k.m").write_text(text)
        with pytest.raises(FileError, match="a MATLAB script of a sparse matrix"):
            read_matrix(MatrixFile(tmp_path / "k.m"), "stiffness")
    (tmp_path / "k.m").write_text("a=[\n2 2 5.5;\n1 2 3.5];\na=sparse(a(:,1),a(:,2),a(:,3),3,3);\n")
    found = read_matrix(MatrixFile(tmp_path / "k.m"), "stiffness").matrix.toarray()
    np.testing.assert_array_equal(found, [[0, 3.5, 0], [3.5, 5.5, 0], [0, 0, 0]])


def test_scripts_that_claim_or_hold_too_much(tmp_path, monkeypatch):
    (tmp_path / "k.m").write_text("a=[\n1 1 2;\n];\na=sparse(a(:,1),a(:,2),a(:,3),5000,4000)\n")
    with pytest.raises(FileError, match="it claims 5000 x 4000, more rows than its bytes"):
        read_matrix(MatrixFile(tmp_path / "k.m"), "stiffness")
    monkeypatch.setattr("dynid.files.fe_exports._MAX_SCRIPT_BYTES", 40)
    with pytest.raises(FileError, match=r"k\.m is too large for a script of a matrix"):
        read_matrix(MatrixFile(tmp_path / "k.m"), "stiffness")


def test_arrays_of_structures_hold_no_matrix_that_is_read(tmp_path):
    several = np.array([(K,), (2 * K,)], dtype=[("K", object)])
    savemat(tmp_path / "m.mat", {"models": several, "M": np.eye(3)})
    with pytest.raises(FileError, match="'models' is no matrix: it holds a 1 x 2 structure array"):
        read_matrix(MatrixFile(tmp_path / "m.mat", "models/K"), "stiffness")


def test_models_that_are_not_whole(tmp_path):
    (tmp_path / "a.inp").write_text("*NODE\n1, 0.\n")
    with pytest.raises(FileError, match="has no matrices beside it"):
        model_files(tmp_path / "a.inp")
    (tmp_path / "a.mtx").write_text("")
    with pytest.raises(FileError, match="is no file of a whole model"):
        model_files(tmp_path / "a.mtx")
    with pytest.raises(FileError, match="is no file"):
        model_files(tmp_path / "b.op2")


def test_an_explanation_reports_constraints(tmp_path):
    scene = "dynid: 1\nkind: reduction\nstructure:\n"
    (tmp_path / "s.yaml").write_text(
        f"{scene}  matrices: {{model: {DATA}/bracket.inp}}\n"
        "reduction: [{method: guyan, masters: ['31:x', '32:y', '33:z']}]\n"
    )
    facts = dict(explain(load_scene(tmp_path / "s.yaml")).facts)
    assert facts["nodes"] == "15 nodes; constraints, which are not applied: 1 *BOUNDARY"


def test_faults_of_models_are_located(tmp_path):
    head = "dynid: 1\nkind: reduction\nreduction: [{method: modal, modes: {count: 2}}]\nstructure:\n"
    (tmp_path / "a.inp").write_text("*NODE\n1, 0.\n")
    (tmp_path / "s.yaml").write_text(f"{head}  matrices:\n    model: a.inp\n")
    scene = load_scene(tmp_path / "s.yaml")
    with pytest.raises(FileError, match="has no matrices beside it") as caught:
        run_scene(scene)
    assert caught.value.names[0] == "structure.matrices.model"
    (tmp_path / "s.yaml").write_text(f"{head}  matrices: {{model: a.inp, mass: m.mtx}}\n")
    with pytest.raises(SceneError, match="a 'model' holds mass and stiffness"):
        load_scene(tmp_path / "s.yaml")
    (tmp_path / "s.yaml").write_text(f"{head}  matrices: {{state_space: a.mat, nodes: a.csv}}\n")
    with pytest.raises(SceneError, match="a 'state_space' has no 'nodes'"):
        load_scene(tmp_path / "s.yaml")


def mutated(content, rng):
    """A file cut, or with bytes changed, left out or repeated, mostly near its start."""
    content = bytearray(content)
    if rng.random() < 0.2:
        return bytes(content[: rng.integers(len(content))])
    for _ in range(rng.choice([1, 2, 8])):
        at = int(rng.integers(min(len(content), 600) if rng.random() < 0.7 else len(content)))
        match rng.integers(4):
            case 0:
                content[at] = rng.integers(256)
            case 1:
                content[at : at + 4] = rng.choice(
                    [b"\xff\xff\xff\x7f", b"\x7f\xff\xff\xff", b"9999", b"-1e9"]
                )
            case 2:
                del content[at : at + int(rng.choice([1, 8, 80]))]
            case _:
                content[at:at] = content[at : at + 40]
    return bytes(content)


@pytest.mark.parametrize(
    "name", ["bracket.inp", "bracket.sti", "k.rsa", "k.m", "m.mat", "n.csv", "n.bdf", "e.exo"]
)
def test_changed_files_are_read_or_refused(tmp_path, name):
    """Nothing but an error of this library, whatever stands in the file."""
    if name.startswith("bracket"):
        content = (DATA / name).read_bytes()
    elif name == "m.mat":
        savemat(
            tmp_path / name,
            {"model": {"K": K, "M": np.eye(3), "nodes": np.eye(3), "DOF": [1.01, 1.02, 1.03]}},
        )
        content = (tmp_path / name).read_bytes()
    elif name == "e.exo":
        with netcdf_file(tmp_path / name, "w") as store:
            store.createDimension("num_nodes", 4)
            for axis in "xyz":
                store.createVariable(f"coord{axis}", "d", ("num_nodes",))[:] = np.arange(4.0)
        content = (tmp_path / name).read_bytes()
    else:
        texts = {
            "k.rsa": harwell_boeing(K),
            "k.m": "a=[\n2 2 5.5;\n1 2 3.5];\na=sparse(a(:,1),a(:,2),a(:,3),3,3);\n",
            "n.csv": "node,x,y,z,set,dofs\n1,0,0,0,a,x y\n2,1,0,0,a b,rz\n",
            "n.bdf": "CORD2R,1,,0.,0.,0.,1.,0.,0.,\n,0.,1.,0.\nGRID,1,1,1.\nGRID*,2,1,1.\n*\n"
            "SPOINT,4,THRU,9\nCBAR,1,1,1,1\nDMIG,K,0,6,2,0\nDMIG,K,1,1,,1,1,2.5\n",
        }
        content = texts[name].encode()
    rng, path = np.random.default_rng(11), tmp_path / name

    def refused(path):
        count = 0
        for read in (read_nodes, lambda file: read_matrix(MatrixFile(file), "stiffness")):
            try:
                read(path)
            except DynidError:
                count += 1
        return count

    assert sum(answers(refused, path, [mutated(content, rng) for _ in range(60)])) > 20
