"""Matrices out of files: every format says the same, damaged files end in one sentence."""

import importlib.util
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import mmwrite, savemat
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array, csr_array, save_npz

from dynid.errors import FileError, UsageError
from dynid.files.matrix_market import read_matrix_market
from dynid.files.read_matrix import MatrixFile, matrix_file, read_labels, read_matrix
from dynid.files.read_structure import from_state_space, imported
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from tests.copies import answers

pytestmark = pytest.mark.usefixtures("untried")

FE = Path(__file__).parents[3] / "shared" / "data" / "fe"
needs_data = pytest.mark.skipif(not FE.is_dir(), reason="the shared data are not here")
needs_pyyeti = pytest.mark.skipif(
    importlib.util.find_spec("pyyeti") is None, reason="pyyeti is not installed"
)

K = np.array([[4.0, -1.5, 0.0], [-1.5, 3.0, -1.0e-3], [0.0, -1.0e-3, 2.0]])
M = np.diag([1.0, 2.0, 0.0])


def write_mtx(folder):
    mmwrite(folder / "k.mtx", csc_array(K), symmetry="symmetric", precision=17)
    return folder / "k.mtx", None


def write_mtx_array(folder):
    mmwrite(folder / "k.mtx", K, precision=17)
    return folder / "k.mtx", None


def write_triplets(folder):
    rows, columns = np.nonzero(K)
    lines = [f"{i + 1} {j + 1}  {float(K[i, j])!r}" for i, j in zip(rows, columns, strict=True)]
    (folder / "k.mtx").write_text("\n".join(["** exported", *lines]) + "\n")
    return folder / "k.mtx", None


def write_half_triplets(folder):
    rows, columns = np.nonzero(np.triu(K))
    lines = [f"{i + 1}, {j + 1}, {K[i, j]:.17E}" for i, j in zip(rows, columns, strict=True)]
    (folder / "k.mtx").write_text("\n".join(lines).replace("E", "D"))
    return folder / "k.mtx", None


def write_mat(folder):
    savemat(folder / "k.mat", {"K": csc_array(K), "other": np.eye(2), "cell": np.array([{}], dtype=object)})
    return folder / "k.mat", None


def write_mat_73(folder):
    """As MATLAB does: HDF5 behind a block of 512 bytes, columns first."""
    with h5py.File(folder / "k.mat", "w", userblock_size=512) as store:
        store["stiff"] = K.T
        store["stiff"].attrs["MATLAB_class"] = np.bytes_("double")
        slim = csc_array(K)
        group = store.create_group("slim")
        group.attrs["MATLAB_sparse"] = np.uint64(3)
        group["data"], group["ir"], group["jc"] = (
            slim.data, slim.indices.astype(np.uint64), slim.indptr.astype(np.uint64)
        )  # fmt: skip
    with (folder / "k.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file")
    return folder / "k.mat", "slim"


def write_npz(folder):
    np.savez(folder / "k.npz", k=K, m=M)
    return folder / "k.npz", None


def write_sparse_npz(folder):
    save_npz(folder / "k.npz", csr_array(K))
    return folder / "k.npz", None


def write_coordinates_npz(folder):
    save_npz(folder / "k.npz", coo_array(K))
    return folder / "k.npz", None


def write_npy(folder):
    np.save(folder / "k.npy", K)
    return folder / "k.npy", None


def write_h5(folder):
    with h5py.File(folder / "k.h5", "w") as store:
        store["model/stiffness"] = K
        store["model/labels"] = np.arange(3)
    return folder / "k.h5", None


def write_sparse_h5(folder):
    slim = csr_array(K)
    with h5py.File(folder / "k.h5", "w") as store:
        group = store.create_group("model/K")
        group["data"], group["indices"], group["indptr"] = slim.data, slim.indices, slim.indptr
        group.attrs["shape"], group.attrs["encoding-type"] = slim.shape, "csr_matrix"
    return folder / "k.h5", "/model/K"


def write_op4(folder):
    from pyyeti.nastran import op4

    op4.write(str(folder / "k.op4"), {"KGG": coo_array(K), "MGG": M}, sparse="nonbigmat")
    return folder / "k.op4", None


WRITERS = [
    write_mtx, write_mtx_array, write_triplets, write_half_triplets, write_mat, write_mat_73,
    write_npz, write_sparse_npz, write_coordinates_npz, write_npy, write_h5, write_sparse_h5,
    pytest.param(write_op4, marks=needs_pyyeti),
]  # fmt: skip


@pytest.mark.parametrize("write", WRITERS)
def test_every_format_holds_the_same_matrix(tmp_path, write):
    path, name = write(tmp_path)
    found = read_matrix(MatrixFile(path, name), "stiffness").matrix
    np.testing.assert_array_equal(found if isinstance(found, np.ndarray) else found.toarray(), K)


def refusal(file):
    """Return what is said of a file that cannot be read, or nothing."""
    try:
        read_matrix(file, "stiffness")
    except FileError as error:
        return error.problem
    return None


@pytest.mark.parametrize("trials", [30, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.parametrize("write", WRITERS)
def test_a_damaged_file_is_one_sentence_or_a_matrix(tmp_path, write, trials):
    """Cut off anywhere, or with any byte changed: never a traceback, never memory for what is not there."""
    path, name = write(tmp_path)
    whole, contents = path.read_bytes(), []
    rng = np.random.default_rng(11)
    for trial in range(trials):
        spoilt = bytearray(whole)
        if trial % 3:
            for place in rng.integers(0, len(whole), 1 + trial % 5):
                spoilt[place] = rng.integers(256)
        else:
            del spoilt[int(rng.integers(len(whole))) :]
        contents.append(bytes(spoilt))
    for said in answers(lambda file: refusal(MatrixFile(file, name)), path, contents):
        assert said is None or (str(path) in said and "\n" not in said)


MARKET = "%%MatrixMarket matrix"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{MARKET} coordinate real symmetric\n3 3 1000000000000\n1 1 1\n", "truncated"),
        (f"{MARKET} coordinate real general\n1000000000000 1000000000000 1\n1 1 1\n", "truncated"),
        (f"{MARKET} array real general\n1000000 1000000\n1\n", "claims a matrix of 1000000"),
        (f"{MARKET} array real symmetric\n2 2\n1\n2\n", "truncated"),
        (f"{MARKET} coordinate real symmetric\n3 3 3\n1 1 1\n2 2 1\n", "truncated"),
        (f"{MARKET} coordinate real symmetric\n3 3 1\n1 1 1\n2 2 1\n", "header is wrong"),
        (f"{MARKET} coordinate real symmetric\n3 3 2\n1 1 1.0\n2 2 1.0e+", "could not convert"),
        (f"{MARKET} coordinate real symmetric\n3 2 1\n1 1 1.0\n", "is square, not 3 x 2"),
        (f"{MARKET} coordinate pattern symmetric\n1 1 1\n1 1\n", "is pattern"),
        (f"{MARKET} coordinate complex general\n1 1 1\n1 1 1 0\n", "is complex"),
        (f"{MARKET} coordinate real skew-symmetric\n2 3 1\n2 1 1\n", "skew-symmetric matrix is square"),
        (f"{MARKET} heap real symmetric\n2 2 1\n2 1 1\n", "is heap"),
        (f"{MARKET} coordinate real\n", ":1: a Matrix Market header has five"),
        (f"{MARKET} coordinate real general\n% x\n3 three\n", ":3: the sizes"),
        (f"{MARKET} coordinate real general\n2 2 1\n3 1 1\n", r"entry \(3, 1\)"),
        ("1 1 2.0\n0 1 2.0\n", r"entry \(0, 1\)"),
        ("1 1 2.0\n1 1000000000000 2.0\n", r"entry \(1, 1000000000000\)"),
        ("1 1.5 2.0\n", "names no row and column: 1, 1.5"),
        ("1 nan 2.0\n", "names no row and column"),
        ("1 1 two\n", "'two'"),
        ("1 1 2.0\n2 2\n", "row 2 has 2 numbers, not 3"),
        ("1 2 3 4\n", "has 4 columns"),
        ("** nothing\n", "no triplets"),
        ("", "no triplets"),
    ],
)
def test_a_file_that_lies_is_refused(tmp_path, text, said):
    (tmp_path / "k.mtx").write_text(text)
    with pytest.raises(FileError, match=said):
        read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness")


@pytest.mark.parametrize("end", ["\n", "", "\r\n", " \n", " ", "\n2 2 1\n"])
@pytest.mark.parametrize(
    "number",
    [
        "3",
        "-3",
        "+3",
        "3.",
        ".5",
        "-.5",
        "1e5",
        "1E+05",
        "5.e-3",
        "1.0D+5",
        "1d2",
        "1e-400",
        "0.1",
        "1234567890123456789012e-21",
        "-0",
        "1.0.5",
        "1e",
        "1.0e+",
        "1e5+3",
        "1-2",
        "1,0",
        "0x10",
        "1_0",
        "1.5f",
        "5e5e5",
        ".",
        "-",
        "++5",
    ],
)
def test_a_number_is_read_to_the_last_bit_or_refused(tmp_path, number, end):
    """SciPy's reader takes many of them for another number, or ends the process."""
    path = tmp_path / "k.mtx"
    count = 2 + end.count("2 2")
    half = "5d-1" if "d" in number.lower() else "0.5"  # the first entry shows how exponents are written
    path.write_text(f"{MARKET} coordinate integer symmetric\n% x\n2 2 {count}\n2 1 {half}\n1 1 {number}{end}")
    try:
        wanted = float(number.upper().replace("D", "E").replace("_", "x"))
    except ValueError:
        with pytest.raises(FileError):
            read_matrix(MatrixFile(path), "stiffness")
        return
    matrix = read_matrix(MatrixFile(path), "stiffness").matrix.toarray()
    np.testing.assert_array_equal(matrix, [[wanted, 0.5], [0.5, count - 2.0]])


@pytest.mark.parametrize("name", ["k.docx", "k.mtx"])
def test_what_is_no_file_of_matrices_is_refused(tmp_path, name):
    with pytest.raises(FileError, match=r"no file"):
        read_matrix(MatrixFile(tmp_path / name), "stiffness")


def test_numpy_files_are_never_unpickled_and_claim_no_more_than_they_hold(tmp_path):
    np.save(tmp_path / "k.npy", np.array([[{}]], dtype=object))
    with pytest.raises(FileError):
        read_matrix(MatrixFile(tmp_path / "k.npy"), "stiffness")
    np.savez(tmp_path / "k.npz", K=np.array([[{}]], dtype=object))
    with pytest.raises(FileError):
        read_matrix(MatrixFile(tmp_path / "k.npz"), "stiffness")
    np.save(tmp_path / "k.npy", np.eye(3))
    raw = (tmp_path / "k.npy").read_bytes().replace(b"(3, 3), }    ", b"(900, 1000), }"[:14].ljust(13))
    (tmp_path / "k.npy").write_bytes(raw)
    with pytest.raises(FileError):
        read_matrix(MatrixFile(tmp_path / "k.npy"), "stiffness")


def test_hdf5_claims_without_storage_are_refused(tmp_path):
    with h5py.File(tmp_path / "k.h5", "w") as store:
        store.create_dataset("K", (10**6, 10**6), "f8", chunks=(10, 10))
    with pytest.raises(FileError, match="claims a matrix of 1000000 x 1000000"):
        read_matrix(MatrixFile(tmp_path / "k.h5"), "stiffness")


def test_which_matrix_of_several(tmp_path):
    savemat(tmp_path / "model.mat", {"K": K, "mass": M, "Z": 1j * K, "stiff2": K})
    file = tmp_path / "model.mat"
    np.testing.assert_array_equal(read_matrix(MatrixFile(file), "mass").matrix, M)
    np.testing.assert_array_equal(read_matrix(MatrixFile(file, "stiff2"), "mass").matrix, K)
    with pytest.raises(FileError, match=r"has no matrix 'stiff'; did you mean 'stiff2'"):
        read_matrix(MatrixFile(file, "stiff"), "mass")
    with pytest.raises(
        FileError, match=r"does not say which matrix is the damping; it has K \(3 x 3\), mass"
    ):
        read_matrix(MatrixFile(file), "damping")
    with pytest.raises(FileError, match="complex"):
        read_matrix(MatrixFile(file, "Z"), "mass")
    savemat(tmp_path / "text.mat", {"K": "a text, no matrix", "M": M})
    with pytest.raises(FileError, match="'K' is no matrix: it holds text"):
        read_matrix(MatrixFile(tmp_path / "text.mat"), "stiffness")


def test_pointers_that_run_backwards_are_refused(tmp_path):
    path, name = write_sparse_h5(tmp_path)
    with h5py.File(path, "a") as file:
        file[name]["indptr"][-1] = 0
    assert "do not increase" in refusal(MatrixFile(path, name))


def test_a_sparse_layout_that_is_not_read_is_named(tmp_path):
    for layout in ("dia", "bsr"):
        save_npz(tmp_path / "k.npz", csr_array(K).asformat(layout))
        with pytest.raises(FileError, match=f"layout '{layout}'; csc, csr, coo are read"):
            read_matrix(MatrixFile(tmp_path / "k.npz"), "mass")
    wrong = {"data": np.ones(1), "row": np.array([7]), "col": np.array([0]), "format": "coo", "shape": (3, 3)}
    np.savez(tmp_path / "k.npz", **wrong)
    with pytest.raises(FileError, match=r"cannot be read as a sparse matrix"):
        read_matrix(MatrixFile(tmp_path / "k.npz"), "mass")


def test_labels_out_of_a_file(tmp_path):
    path = tmp_path / "labels.txt"
    path.write_text("left\n\n 12 \nüber\n", encoding="utf-8")
    assert read_labels(path) == ["left", 12, "über"]
    path.write_bytes(b"\xff\n")
    with pytest.raises(FileError, match="no text in UTF-8"):
        read_labels(path)
    for other in (tmp_path, tmp_path / "missing", Path("/dev/zero")):  # the last one never ends
        with pytest.raises(FileError, match="is no file"):
            read_labels(other)
    with path.open("wb") as stream:
        stream.truncate(10**9)
    with pytest.raises(FileError, match="too large"):
        read_labels(path)


def test_a_path_inside_an_hdf5_file_stands_behind_it(tmp_path):
    write_sparse_h5(tmp_path)
    assert matrix_file(tmp_path, "k.h5:/model/K") == MatrixFile(tmp_path / "k.h5", "model/K")
    assert matrix_file(tmp_path, "a:/k.mtx") == MatrixFile(tmp_path / "a:/k.mtx", None)


@needs_pyyeti
def test_without_pyyeti_a_nastran_file_says_what_to_install(tmp_path, monkeypatch):
    path, _ = write_op4(tmp_path)
    monkeypatch.setitem(__import__("sys").modules, "pyyeti.nastran.op4", None)
    with pytest.raises(FileError, match="pyyeti") as caught:
        read_matrix(MatrixFile(path), "stiffness")
    assert "dynid[formats]" in caught.value.remedy


# --- Matrix Market without its banner ---------------------------------------------------------------

LAYOUTS = ("lower", "upper", "both")


def symmetric_entries(rng, n, layout):
    """Return a random symmetric matrix, none of its diagonal zero, and its entries as a file lists them."""
    dense = np.where(rng.random((n, n)) < 0.3, rng.standard_normal((n, n)), 0.0)
    dense = np.tril(dense, -1) + np.tril(dense, -1).T + np.diag(rng.uniform(1, 9, n))
    part = {"lower": np.tril(dense), "upper": np.triu(dense), "both": dense}[layout]
    rows, columns = np.nonzero(part)
    order = rng.permutation(len(rows))
    return dense, [(rows[k] + 1, columns[k] + 1, float(part[rows[k], columns[k]])) for k in order]


def lines_of(entries):
    return [f"{i} {j} {value!r}" for i, j, value in entries]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("top", [[], ["% by hand"], ["", "%"], ["** x"]], ids=str)
@pytest.mark.parametrize("seed", range(4))
def test_a_size_line_is_none_of_the_entries_with_a_banner_or_without(tmp_path, layout, top, seed):
    rng = np.random.default_rng(seed)
    dense, entries = symmetric_entries(rng, int(rng.integers(1, 9)), layout)
    n = len(dense)
    body = [f"{n} {n} {len(entries)}", *lines_of(entries)]
    (tmp_path / "k.mtx").write_text("\n".join([*top, *body]) + "\n")
    found = read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness")
    np.testing.assert_array_equal(found.matrix.toarray(), dense)
    assert not found.at_least
    (tmp_path / "k.mtx").write_text("\n".join(top + lines_of(entries)) + "\n")
    bare = read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness")
    np.testing.assert_array_equal(bare.matrix.toarray(), dense)
    assert bare.at_least


def test_whole_values_and_commas_hide_no_size_line(tmp_path):
    (tmp_path / "k.mtx").write_text("3, 3, 4\n1, 1, 2\n2, 2, 4\n3, 3, 5\n2, 1, -1\n")
    found = read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness").matrix.toarray()
    np.testing.assert_array_equal(found, [[2, -1, 0], [-1, 4, 0], [0, 0, 5]])


def test_a_size_line_keeps_dofs_that_have_no_entries(tmp_path):
    (tmp_path / "k.mtx").write_text("4 4 2\n1 1 2.5\n2 2 1.5\n")
    found = read_matrix(MatrixFile(tmp_path / "k.mtx"), "mass")
    np.testing.assert_array_equal(found.matrix.toarray(), np.diag([2.5, 1.5, 0, 0]))
    (tmp_path / "k.mtx").write_text("4 4 0\n")
    with pytest.raises(FileError, match="the mass has no entry but 0"):
        read_matrix(MatrixFile(tmp_path / "k.mtx"), "mass")


@pytest.mark.parametrize(
    ("text", "diagonal"),
    [
        ("3 3 7\n2 2 5\n1 1 4\n", [4, 5, 7]),  # whole values throughout: the last DOF first
        ("3 3 2.0\n2 2 5.0\n1 1 4.0\n", [4, 5, 2]),
        ("1 1 2\n2 2 5.5\n3 3 4.5\n", [2, 5.5, 4.5]),
        ("1 1 9\n", [9]),
    ],
)
def test_a_first_entry_that_is_no_size_line_stays_one(tmp_path, text, diagonal):
    (tmp_path / "k.mtx").write_text(text)
    found = read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness").matrix.toarray()
    np.testing.assert_array_equal(found, np.diag(diagonal))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("2 2 4\n1 1 2.5\n2 1 -1.0\n2 2 3.5\n", "'2 2 4' above 3 entries"),  # truncated
        ("2 2 2\n1 1 2.5\n2 1 -1.0\n2 2 3.5\n", "'2 2 2' above 3 entries"),  # too many
        ("2 2 4\n1 1 2\n2 1 -1\n2 2 3\n", "'2 2 4' above 3 entries"),  # its entry stands below as well
        ("7 7 4\n", "'7 7 4' above 0 entries"),
        ("3 2 2\n1 1 1.5\n3 2 1.0\n", "3 x 2; a structural matrix is square"),
        ("% x\n%%MatrixMarket matrix coordinate real skew-symmetric\n2 2 1\n2 1 1\n", "behind its first"),
        ("9000000 9000000 1\n1 1 1.5\n", "claims 9000000 rows"),
    ],
)
def test_a_first_line_that_may_be_either_is_refused(tmp_path, text, said):
    (tmp_path / "k.mtx").write_text(text)
    with pytest.raises(FileError, match=said):
        read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness")


@needs_data
@pytest.mark.parametrize("name", ["bcsstk01", "bcsstm03", "bcsstk08"])
def test_a_matrix_market_file_says_the_same_without_its_first_line(tmp_path, name):
    whole = read_matrix(MatrixFile(FE / f"{name}.mtx"), "stiffness").matrix
    (tmp_path / "k.mtx").write_text((FE / f"{name}.mtx").read_text().split("\n", 1)[1])
    assert (read_matrix(MatrixFile(tmp_path / "k.mtx"), "stiffness").matrix != whole).nnz == 0


# --- structures out of matrices --------------------------------------------------------------------


def structure_of(folder, mass, stiffness, **more):
    (folder / "m.mtx").write_text(mass)
    (folder / "k.mtx").write_text(stiffness)
    return imported(MatrixFile(folder / "m.mtx"), MatrixFile(folder / "k.mtx"), **more)


def test_labelled_triplets_give_labels_and_find_each_other(tmp_path):
    """Abaqus exports `node,dof,node,dof,value`; the mass names fewer DOFs than the stiffness."""
    stiffness = "12,1,12,1,4.0\n12,1,12,6,1.0\n12,6,12,6,3.0\n7,2,7,2,5.0\n"
    model = structure_of(tmp_path, "12,1,12,1,2.0\n7,2,7,2,1.5\n", stiffness)
    assert model.dofs == ("7:2", "12:1", "12:6")
    assert model.kinds == ("translation", "translation", "rotation")
    np.testing.assert_array_equal(model.M, np.diag([1.5, 2.0, 0.0]))
    np.testing.assert_array_equal(model.K, [[5, 0, 0], [0, 4, 1], [0, 1, 3]])


def test_triplets_may_end_before_the_last_massless_dof(tmp_path):
    model = structure_of(tmp_path, "1 1 2.0\n", "1 1 2.0\n2 2 3.0\n")
    np.testing.assert_array_equal(model.M, np.diag([2.0, 0.0]))


def test_damping_may_be_made_from_mass_and_stiffness(tmp_path):
    text = "1 1 2.0\n2 2 3.0\n"
    model = structure_of(tmp_path, text, text, damping=ProportionalDamping(0.5, 0.25))
    np.testing.assert_array_equal(model.C, 0.75 * model.K)
    assert structure_of(tmp_path, text, text, damping=ModalDamping(0.1)).C[0, 0] == pytest.approx(0.4)


def test_labels_and_joints_may_be_given(tmp_path):
    text = "1 1 2.0\n2 2 3.0\n"
    model = structure_of(
        tmp_path, text, text, labels=["left", "right"], joints=[Joint("j", ("right", 1), 5.0)]
    )
    np.testing.assert_array_equal(model.with_joints()[2], [[7, -5], [-5, 8]])
    with pytest.raises(UsageError, match="1 DOF label for 2 DOFs") as caught:
        structure_of(tmp_path, text, text, labels=["left"])
    assert caught.value.names == ("labels",)


@pytest.mark.parametrize(
    ("mass", "stiffness", "said", "part"),
    [
        ("1 1 1\n2 2 1\n", "1 1 2\n1 2 5\n2 1 2.0\n2 2 9\n", r"\(1, 2\) is 5, \(2, 1\) is 2", "stiffness"),
        ("1 1 1\n2 2 -1\n", "1 1 2\n2 2 1\n", r"mass is negative: entry \(2, 2\) is -1", "mass"),
        ("1 1 1\n2 2 1\n", "1 1 2\n2 2 nan\n", r"no number at entry \(2, 2\): nan", "stiffness"),
        ("1 1 1\n2 2 1\n", "1 1 2\n2 2 1\n2 1 5\n", r"indefinite: entry \(\d, \d\) is 5", "stiffness"),
        (
            "%%MatrixMarket matrix coordinate real symmetric\n3 3 3\n1 1 1\n2 2 1\n3 3 1\n",
            "%%MatrixMarket matrix coordinate real symmetric\n2 2 2\n1 1 1\n2 2 1\n",
            "stiffness matrix is 2 x 2, but must be 3 x 3",
            "stiffness",
        ),
    ],
)  # fmt: skip
def test_matrices_that_are_no_structure_are_refused_by_entry(tmp_path, mass, stiffness, said, part):
    with pytest.raises(UsageError, match=said) as caught:
        structure_of(tmp_path, mass, stiffness)
    assert caught.value.names[0] == part


@needs_data
@pytest.mark.parametrize("pair", ["01", "03", "08"])
def test_the_harwell_boeing_pairs_have_their_published_eigenvalues(pair):
    model = imported(MatrixFile(FE / f"bcsstm{pair}.mtx"), MatrixFile(FE / f"bcsstk{pair}.mtx"))
    known = json.loads((FE / "eigenvalues.json").read_text())[f"bcsstk{pair}/bcsstm{pair}"]
    assert model.size == known["n"]
    assert model.is_sparse == (known["n"] > 400)
    M, _, K = model.dense()
    assert np.count_nonzero(np.diag(M) == 0) == known["zero_mass_dofs"]
    n = model.size
    mu = eigh(M, K, eigvals_only=True, subset_by_index=[n - 12, n - 1])
    # mu = 1/lambda, the largest ones: accurate to rounding times the condition of K (up to 3e7).
    np.testing.assert_allclose(1 / mu[::-1], known["lowest_lambda"], rtol=1e-8)


@needs_data
def test_the_abaqus_block_is_free():
    model = imported(MatrixFile(FE / "blockC3D8_MASS1.mtx"), MatrixFile(FE / "blockC3D8_STIF1.mtx"))
    M, _, K = model.dense()
    assert model.size == 528
    square = eigh(K, M, eigvals_only=True, subset_by_index=[0, 6])
    assert np.all(np.abs(square[:6]) < 1e-9 * square[6])


# --- state spaces ----------------------------------------------------------------------------------


def state_space_file(folder, matrices, **ports):
    M, C, K = matrices
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    savemat(folder / "s.mat", {"A": A, **ports})
    return folder / "s.mat"


def chain():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((5, 5))
    M = np.diag(rng.uniform(1, 3, 5)) + 0.1 * np.ones((5, 5))
    K = root @ root.T
    return M, 0.3 * M + 0.01 * K, K


def test_a_port_tells_the_matrices_behind_a_state_space(tmp_path):
    M, C, K = chain()
    b, zero = np.linalg.solve(M, np.eye(5)[:, 2]), np.zeros((5, 1))
    far = np.linalg.solve(M, np.eye(5)[:, 0])
    B = np.block([[zero, zero], [far[:, None], b[:, None]]])
    rows = np.concatenate([np.zeros((1, 5)), np.eye(5)[[2]]], axis=1)
    model = from_state_space(state_space_file(tmp_path, (M, C, K), B=B, C=rows))
    for found, exact in zip((model.M, model.C, model.K), (M, C, K), strict=True):
        np.testing.assert_allclose(found, exact, atol=1e-10 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("seen", "driven"),
    [
        (np.r_[np.eye(5)[2], np.eye(5)[2]], np.ones(5)),  # displacement and velocity in one
        (np.r_[np.zeros(5), np.eye(5)[2]], np.zeros(5)),  # no mode is driven
        (np.r_[np.zeros(5), -np.eye(5)[2]], np.eye(5)[2]),  # not collocated: of the other sign
    ],
)
def test_a_port_that_is_not_collocated_tells_nothing(tmp_path, seen, driven):
    """The mass is the one that there would be without it."""
    M, C, K = chain()
    B = np.concatenate([np.zeros(5), np.linalg.solve(M, driven)])[:, None]
    found = from_state_space(state_space_file(tmp_path, (M, C, K), B=B, C=seen[None, :]))
    without = from_state_space(state_space_file(tmp_path, (M, C, K)))
    np.testing.assert_array_equal(found.M, without.M)


def test_a_sparse_group_without_one_of_its_arrays_is_refused(tmp_path):
    with h5py.File(tmp_path / "k.h5", "w") as store:
        store["K/data"], store["K/indices"], store["K/shape"] = [1.0], [0], [1, 1]
        store.create_group("K/indptr")
    with pytest.raises(FileError, match="'/K' has no dataset 'indptr'"):
        read_matrix(MatrixFile(tmp_path / "k.h5", "K"), "stiffness")


def test_without_a_port_the_mass_is_the_one_closest_to_unity(tmp_path):
    M, C, K = chain()
    M = np.eye(5) + 1e-3 * K
    model = from_state_space(state_space_file(tmp_path, (M, C, K)))
    np.testing.assert_allclose(model.M @ np.linalg.solve(M, K), model.K, atol=1e-9 * np.abs(K).max())
    assert np.linalg.norm(model.M - np.eye(5)) <= np.linalg.norm(M - np.eye(5)) + 1e-12
    same = from_state_space(state_space_file(tmp_path, (np.eye(5), 0.3 * np.eye(5), K)))
    np.testing.assert_allclose(same.M, np.eye(5), atol=1e-12)


def test_damping_that_couples_modes_tells_modal_masses(tmp_path):
    M, _, K = chain()
    C = np.zeros((5, 5))
    C[0, 0] = 1.0
    model = from_state_space(state_space_file(tmp_path, (M, C, K)))
    scale = model.M[0, 0] / M[0, 0]
    np.testing.assert_allclose(model.M, scale * M, atol=1e-6)
    np.testing.assert_allclose(model.C, scale * C, atol=1e-6)


def test_state_spaces_of_no_structure_are_refused(tmp_path):
    M, C, K = chain()
    swirl = np.zeros((5, 5))
    swirl[0, 1], swirl[1, 0] = 5.0, -5.0
    for spoilt, said in (
        ((M, C + swirl, K), "damping"),
        ((M, C, K + 10 * swirl), "eigenvalue"),
        ((M, C, -K), "eigenvalue"),
    ):
        with pytest.raises(UsageError, match=said) as caught:
            from_state_space(state_space_file(tmp_path, spoilt))
        assert caught.value.names == ("state_space",)
    savemat(tmp_path / "s.mat", {"A": np.eye(4)})
    with pytest.raises(UsageError, match=r"not \[0 I\]: entry \(1, 1\) is 1"):
        from_state_space(tmp_path / "s.mat")
    savemat(tmp_path / "s.mat", {"A": np.eye(3)})
    with pytest.raises(UsageError, match="3 x 3; that of a structure is square and even"):
        from_state_space(tmp_path / "s.mat")


@needs_data
def test_the_slicot_building_is_recovered_from_its_state_space():
    from scipy.io import loadmat

    model = from_state_space(FE / "official_building.mat")
    stored = loadmat(FE / "official_building.mat", spmatrix=False)
    A, B, C = (part.toarray() if hasattr(part, "toarray") else part for part in (stored[n] for n in "ABC"))
    assert model.size == 24
    flexibility = np.linalg.solve(model.M, np.concatenate([model.K, model.C], axis=1))
    # The published matrix has its states rounded to some eight digits: its damping is symmetric to those.
    np.testing.assert_allclose(flexibility, -A[24:], atol=1e-7 * np.abs(A[24:]).max())
    for omega in (5.2, 24.5, 80.0):
        exact = (C @ np.linalg.solve(1j * omega * np.eye(48) - A, B)).item()
        dynamic = model.K + 1j * omega * model.C - omega**2 * model.M
        found = 1j * omega * np.linalg.solve(dynamic, model.row(1))[0]
        assert found == pytest.approx(exact, rel=1e-7)
    assert np.linalg.eigvalsh(model.M)[0] > 0.7 * np.linalg.eigvalsh(model.M)[-1]


# --- what is no matrix, and what cannot be read -----------------------------------------------------


def test_mat_files_and_hdf5_hold_other_things_too(tmp_path):
    savemat(tmp_path / "k.mat", {"K": K, "z": 1j * K, "words": "abc", "cube": np.zeros((2, 2, 2))})
    with h5py.File(tmp_path / "k.h5", "w") as store:
        store["K"], store["z"], store["cube"], store["words"] = K, 1j * K, np.zeros((2, 2, 2)), "abc"
        store.create_group("g")
        empty = store.create_group("empty")
        empty.attrs["MATLAB_sparse"] = 3
        empty["jc"] = np.zeros(4, dtype=np.uint64)
        shapeless = store.create_group("shapeless")
        for name in ("data", "indices", "indptr"):
            shapeless[name] = [0]
    for name, said in {
        "z": "k.h5: 'z' is no matrix: it holds complex numbers. Save its real part",
        "cube": "k.h5: 'cube' is no matrix: it holds an array of the shape (2, 2, 2)",
        "words": "k.h5: 'words' is no matrix: it holds text",
        "g": "k.h5 has no matrix 'g'; it has K",
    }.items():
        with pytest.raises(FileError, match=re.escape(said)):
            read_matrix(MatrixFile(tmp_path / "k.h5", name), "stiffness")
    for name, said in {
        "z": "'z' holds complex numbers; a structural matrix is real",
        "words": "'words'",
        "cube": "'cube'",
    }.items():
        with pytest.raises(FileError, match=said):
            read_matrix(MatrixFile(tmp_path / "k.mat", name), "stiffness")
    with pytest.raises(FileError, match="the sparse matrix '/shapeless' has no shape"):
        read_matrix(MatrixFile(tmp_path / "k.h5", "shapeless"), "stiffness")
    for values, said in (
        (1j * K, "holds complex numbers; a structural matrix is real"),
        (np.zeros((2, 2, 2)), "has 3 dimensions; a matrix has two"),
        (np.array([["a"]]), "holds no plain numbers"),
    ):
        np.save(tmp_path / "k.npy", values)
        with pytest.raises(FileError, match=said):
            read_matrix(MatrixFile(tmp_path / "k.npy"), "stiffness")
    with pytest.raises(FileError, match="the stiffness has no entry but 0"):
        read_matrix(MatrixFile(tmp_path / "k.h5", "empty"), "stiffness")


def test_full_matrices_of_matrix_market_stand_column_by_column(tmp_path):
    A = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    mmwrite(tmp_path / "a.mtx", A)
    np.testing.assert_array_equal(read_matrix(MatrixFile(tmp_path / "a.mtx", None), "stiffness").matrix, A)


def test_more_than_is_read_is_refused_before_it_is(tmp_path, monkeypatch):
    savemat(tmp_path / "k.mat", {"K": K})
    np.savez(tmp_path / "k.npz", K=K)
    for module in ("untrusted", "numpy_arrays"):
        monkeypatch.setattr(f"dynid.files.{module}.MOST_NUMBERS", 5)
    with pytest.raises(FileError, match="is larger than the 40 bytes that are read"):
        read_matrix(MatrixFile(tmp_path / "k.mat", None), "stiffness")
    with pytest.raises(FileError, match=r"K\.npy claims \d+ bytes"):
        read_matrix(MatrixFile(tmp_path / "k.npz", None), "stiffness")


def test_a_state_space_must_tell_a_structure(tmp_path):
    (tmp_path / "k.mtx").write_text("%%MatrixMarket matrix array real general\n1 1\n1\n")
    with pytest.raises(FileError, match="holds one matrix; a state space takes several"):
        from_state_space(tmp_path / "k.mtx")
    savemat(tmp_path / "s.mat", {"A": np.full((2, 2), np.nan)})
    with pytest.raises(UsageError, match="entries that are no numbers"):
        from_state_space(tmp_path / "s.mat")


@pytest.mark.parametrize(("half", "missing"), [(np.triu, "lower"), (np.tril, "upper")])
@pytest.mark.parametrize("sparse", [False, True])
def test_a_triangle_alone_is_told_which_one_is_missing(tmp_path, half, missing, sparse):
    path = tmp_path / "k.npz"
    save_npz(path, csr_array(half(K))) if sparse else np.savez(path, half(K))
    stored = read_matrix(MatrixFile(path), "stiffness").matrix
    with pytest.raises(UsageError, match=f"its {missing} triangle is missing"):
        StructuralModel(np.eye(len(K)), np.zeros_like(K), stored)


@pytest.mark.parametrize("dense", [True, False])
def test_a_skew_symmetric_matrix_is_mirrored_with_its_sign(tmp_path, dense):
    upper = np.triu(np.random.default_rng(0).standard_normal((5, 5)), 1)
    matrix = upper - upper.T
    mmwrite(
        tmp_path / "g.mtx", matrix if dense else coo_array(matrix), symmetry="skew-symmetric", precision=17
    )
    assert np.array_equal(as_array(read_matrix_market(tmp_path / "g.mtx").matrix), matrix)
    text = (tmp_path / "g.mtx").read_text().replace("\n2 1 ", "\n2 1 +")  # not plainly written
    (tmp_path / "g.mtx").write_text(text)
    assert np.array_equal(as_array(read_matrix_market(tmp_path / "g.mtx").matrix), matrix)
