"""Files that hold no usable matrix: truncated, without entries, complex, or no matrix at all."""

import re
from contextlib import suppress

import h5py
import numpy as np
import pytest
from scipy.io import mmwrite, savemat
from scipy.sparse import coo_array, csc_array, issparse, save_npz

from dynid.errors import FileError
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_structure import model_files

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.usefixtures("untried")]


def matrix(n, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
    return A + A.T + n * np.eye(n)


def dense(found):
    return found.toarray() if issparse(found) else np.asarray(found)


# Without an entry


def _script(path, n):
    path.write_text(f"function k = m()\nt = [\n1 1 0;\n{n} {n} 0;\n];\nk = sparse(t(:,1), t(:,2), t(:,3));\n")


def _harwell_boeing(path, n):
    text = [f"{'zero':72}KEY", "  3  1  1  1", f"RUA {n} {n} {n} 0", "(80I8) (80I8) (80E9.1)"]
    text += ["".join(f"{k:8d}" for k in range(1, n + 2)), "".join(f"{k:8d}" for k in range(1, n + 1))]
    path.write_text("\n".join([*text, "".join(f"{0.0:9.1E}" for _ in range(n))]) + "\n")


def _hdf5(path, n):
    with h5py.File(path, "w") as store:
        store["K"] = np.zeros((n, n))


def _dmig(path, n):
    lines = ["DMIG,KAA,0,6,2"] + [f"DMIG,KAA,{k},1,,{k},1,0.0" for k in range(1, n + 1)]
    path.write_text("\n".join(lines) + "\n")


ZERO = {
    "k.npy": lambda path, n: np.save(path, np.zeros((n, n))),
    "k.npz": lambda path, n: save_npz(path, csc_array((n, n))),
    "k.mat": lambda path, n: savemat(path, {"K": np.zeros((n, n))}),
    "sparse.mat": lambda path, n: savemat(path, {"K": csc_array((n, n))}),
    "k.mtx": lambda path, n: mmwrite(path, coo_array((n, n))),
    "array.mtx": lambda path, n: mmwrite(path, np.zeros((n, n))),
    "triplets.mtx": lambda path, n: path.write_text(f"1 1 0.0\n{n} {n} 0.0\n"),
    "k.txt": lambda path, n: np.savetxt(path, np.zeros((n, n))),
    "k.sti": lambda path, n: path.write_text(f"1 1 0.0\n{n} {n} 0.0\n"),
    "k.m": _script,
    "k.rua": _harwell_boeing,
    "k.h5": _hdf5,
    "k.pch": _dmig,
}


@pytest.mark.parametrize("name", ZERO)
@pytest.mark.parametrize(("role", "n"), [("mass", 3), ("stiffness", 5), ("damping", 4)])
def test_a_structural_matrix_without_an_entry_is_refused_in_every_format(tmp_path, name, role, n):
    path = tmp_path / name
    ZERO[name](path, n)
    name = {".h5": "K", ".mat": "K", ".pch": "KAA"}.get(path.suffix)
    with pytest.raises(FileError, match=f"the {role} has no entry but 0") as raised:
        read_matrix(MatrixFile(path, name), role)
    assert ("Leave 'damping' out" in raised.value.remedy) == (role == "damping")


# OUTPUT4 that ends too early

op4 = pytest.importorskip("pyyeti.nastran.op4", reason="pyyeti is an extra")


@pytest.mark.parametrize("layout", ["dense", "bigmat", "nonbigmat"])
@pytest.mark.parametrize("binary", [True, False])
def test_a_truncated_output4_gives_its_matrix_or_an_error(tmp_path, binary, layout):
    matrices = {"maa": matrix(5, 11), "kaa": matrix(5, 12)}
    op4.write(str(tmp_path / "whole.op4"), matrices, binary=binary, sparse=layout)
    content = (tmp_path / "whole.op4").read_bytes()
    read = 0
    for end in range(24, len(content), 7):
        path = tmp_path / "cut.op4"
        path.write_bytes(content[:end])
        for role, name in (("mass", "maa"), ("stiffness", "kaa")):
            try:
                found = read_matrix(MatrixFile(path, name), role)
            except FileError:
                continue
            read += 1
            np.testing.assert_allclose(dense(found.matrix), matrices[name], rtol=1e-9)
    if binary:
        assert read <= 1  # where the cut is between the matrices
    path.write_bytes(content)
    np.testing.assert_allclose(
        dense(read_matrix(MatrixFile(path, "KAA"), "stiffness").matrix), matrices["kaa"]
    )


@pytest.mark.parametrize("endian", ["<", ">"])
@pytest.mark.parametrize("at", [24, 28, 32, -4, -28])
def test_counts_of_records_that_contradict_each_other_are_damage(tmp_path, endian, at):
    path = tmp_path / "k.op4"
    op4.write(str(path), {"kaa": matrix(4, 5)}, binary=True, sparse="dense", endian=endian)
    np.testing.assert_allclose(dense(read_matrix(MatrixFile(path), "stiffness").matrix), matrix(4, 5))
    content = bytearray(path.read_bytes())
    content[at + (0 if endian == "<" else 3)] ^= 64
    path.write_bytes(content)
    with suppress(FileError):
        found = read_matrix(MatrixFile(path), "stiffness")
        np.testing.assert_allclose(dense(found.matrix), matrix(4, 5))


# No matrix of real numbers


def matlab(path, **variables):
    """Write variables as MATLAB 7.3 stores them."""
    with h5py.File(path, "w") as store:
        for name, variable in variables.items():
            kind, value = variable if isinstance(variable, tuple) else ("double", variable)
            if kind == "cell":
                refs = store.require_group("#refs#")
                cells = []
                for k, content in enumerate(value):
                    refs[f"{name}{k}"] = content
                    cells.append([refs[f"{name}{k}"].ref])
                store.create_dataset(name, data=np.array(cells, dtype=h5py.ref_dtype))
            elif kind == "struct array":
                refs, group = store.require_group("#refs#"), store.create_group(name)
                group.attrs["MATLAB_class"] = np.bytes_("struct")
                for field, contents in value.items():
                    for k, content in enumerate(contents):
                        refs[f"{field}{k}"] = content
                    row = [[refs[f"{field}{k}"].ref] for k in range(len(contents))]
                    group.create_dataset(field, data=np.array(row, dtype=h5py.ref_dtype))
                continue
            elif kind == "empty":
                store[name] = np.array([0, 0], dtype=np.uint64)
                store[name].attrs["MATLAB_empty"] = np.uint8(1)
                kind = "double"
            elif kind == "char":
                store[name] = np.array([[ord(letter)] for letter in value], dtype=np.uint16)
            elif np.iscomplexobj(value):
                pairs = np.empty(value.T.shape, dtype=[("real", "<f8"), ("imag", "<f8")])
                pairs["real"], pairs["imag"] = value.T.real, value.T.imag
                store[name] = pairs
            else:
                store[name] = value.T
            store[name].attrs["MATLAB_class"] = np.bytes_(kind)
    return path


def test_what_stands_in_matlab_73_in_place_of_a_matrix_is_said(tmp_path):
    K = matrix(4, 3)
    path = matlab(
        tmp_path / "m.mat",
        M=K,
        K=K * (1 + 0.02j),
        S=("cell", [K, K, K]),
        part=("struct array", {"M": [K, K, K], "K": [K, K, K]}),
        C=("empty", None),
        note=("char", "MAA"),
    )
    for name, said in {
        "K": "'K' is no matrix: it holds complex numbers. Save its real part",
        "k": "'K' is no matrix: it holds complex numbers",
        "S": "'S' is no matrix: it holds a cell array of 1 x 3 cells. Save the matrix",
        "part/K": "'part/K' is no matrix: it holds a field of a 1 x 3 structure array. Name the field of",
        "C": "'C' is no matrix: it holds an empty array",
        "note": "'note' is no matrix: it holds text",
        "X": "has no matrix 'X'; it has M (4 x 4), ",
    }.items():
        with pytest.raises(FileError, match=re.escape(said)):
            read_matrix(MatrixFile(path, name), "stiffness")
    with pytest.raises(FileError, match="'K' is no matrix: it holds complex numbers"):
        read_matrix(MatrixFile(path), "stiffness")
    with pytest.raises(FileError, match="'C' is no matrix: it holds an empty array"):
        read_matrix(MatrixFile(path), "damping")
    np.testing.assert_array_equal(read_matrix(MatrixFile(path, "m"), "mass").matrix, K)


def test_earlier_matlab_files_say_it_alike(tmp_path):
    K = matrix(3, 8)
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = K, 2 * K
    several = np.array([(K,), (K,), (K,)], dtype=[("K", object)])
    savemat(tmp_path / "m.mat", {"K": K * 1j, "S": cells, "part": several, "C": np.zeros((0, 0)), "t": "a"})
    for name, said in {
        "K": "complex numbers",
        "S": "'S' is no matrix: it holds a cell array of 1 x 2 cells",
        "part/K": "'part' is no matrix: it holds a 1 x 3 structure array",
        "C": "'C' is no matrix: it holds an empty array",
        "t": "'t' is no matrix: it holds text",
    }.items():
        with pytest.raises(FileError, match=re.escape(said)):
            read_matrix(MatrixFile(tmp_path / "m.mat", name), "stiffness")


@pytest.mark.parametrize("name", ["C", "damping"])
def test_a_complex_damping_of_a_whole_model_is_not_dropped(tmp_path, name):
    path = tmp_path / "m.h5"
    with h5py.File(path, "w") as store:
        store["M"], store["K"], store[name] = np.eye(3), matrix(3, 2), matrix(3, 2) * 1j
    with pytest.raises(FileError, match=f"'{name}' is no matrix: it holds complex numbers"):
        model_files(path)


def test_a_sparse_complex_matrix_of_hdf5_is_said_to_be_complex(tmp_path):
    K = csc_array(matrix(3, 4) * (1 + 1j))
    with h5py.File(tmp_path / "k.h5", "w") as store:
        store["M"] = np.eye(3)
        group = store.create_group("K")
        group["data"], group["indices"], group["indptr"] = K.data, K.indices, K.indptr
        group.attrs["shape"] = K.shape
    with pytest.raises(FileError, match="'K' is no matrix: it holds complex numbers"):
        read_matrix(MatrixFile(tmp_path / "k.h5"), "stiffness")


@pytest.mark.parametrize("name", ["k.npz", "k.npy", "sparse.npz", "k.mat", "sparse.mat", "k.op4"])
def test_a_complex_matrix_of_any_format_is_refused_with_what_to_do(tmp_path, name):
    K = matrix(4, 6) * (1 + 0.02j)
    path = tmp_path / name
    if name.endswith("npz"):
        save_npz(path, csc_array(K)) if name.startswith("sparse") else np.savez(path, K=K)
    elif name.endswith("npy"):
        np.save(path, K)
    elif name.endswith("mat"):
        savemat(path, {"K": csc_array(K) if name.startswith("sparse") else K})
    else:
        op4.write(str(path), {"kaa": K}, binary=True)
    with pytest.raises(FileError, match="holds complex numbers; a structural matrix is real") as raised:
        read_matrix(MatrixFile(path), "stiffness")
    assert raised.value.remedy.startswith("Save its real part")


def test_complex_and_rectangular_dmig_are_said(tmp_path):
    path = tmp_path / "m.pch"
    path.write_text(
        "DMIG,K2GG,0,6,4\nDMIG,K2GG,1,1,,1,1,5.0,0.1\nDMIG,RECT,0,2,2\nDMIG,RECT,1,1,,1,1,5.0\n"
        "DMIG,MAA,0,6,2\nDMIG,MAA,1,1,,1,1,5.0\nDMIG,NONE,0,6,2\n"
    )
    for name, said in {
        "K2GG": "it holds complex numbers",
        "rect": "it holds a matrix of form 2",
        "NONE": "it holds no entry",
    }.items():
        with pytest.raises(FileError, match=said):
            read_matrix(MatrixFile(path, name), "stiffness")
    assert read_matrix(MatrixFile(path, "maa"), "mass").matrix.toarray() == [[5.0]]


# Names as the file spells them


@pytest.mark.parametrize("spelled", ["MGG", "mgg", "Mgg"])
def test_a_name_is_found_as_the_file_spells_it(tmp_path, spelled):
    M = matrix(4, 21)
    op4.write(str(tmp_path / "m.op4"), {"MGG": M, "KGG": 2 * M}, binary=True)
    np.savez(tmp_path / "m.npz", MGG=M, KGG=2 * M)
    for file in ("m.op4", "m.npz"):
        found = read_matrix(MatrixFile(tmp_path / file, spelled), "mass")
        np.testing.assert_allclose(dense(found.matrix), M)


def test_names_that_differ_in_the_case_of_letters_are_different(tmp_path):
    np.savez(tmp_path / "m.npz", k=np.eye(2), K=3 * np.eye(2))
    for name, factor in (("k", 1), ("K", 3)):
        np.testing.assert_array_equal(
            read_matrix(MatrixFile(tmp_path / "m.npz", name), "stiffness").matrix, factor * np.eye(2)
        )
    np.savez(tmp_path / "n.npz", kaa=np.eye(2), Kaa=3 * np.eye(2))
    with pytest.raises(FileError, match=r"has no matrix 'KAA'; did you mean '[kK]aa'"):
        read_matrix(MatrixFile(tmp_path / "n.npz", "KAA"), "stiffness")


def test_damage_is_said_without_terms_of_a_library(tmp_path):
    np.savez(tmp_path / "objects.npz", M=np.array([[1, None], [None, 2]], dtype=object))
    with pytest.raises(FileError, match="holds Python objects, which are not read"):
        read_matrix(MatrixFile(tmp_path / "objects.npz", "M"), "mass")
    rows = "%%MatrixMarket matrix coordinate real general\n4 4 4\n1 1 5.0\n2 2 5.0\n3 3 5.0\n4 4"
    (tmp_path / "short.mtx").write_text(rows)
    with pytest.raises(FileError, match=r"row 4 has 2 numbers, not 3$"):
        read_matrix(MatrixFile(tmp_path / "short.mtx"), "mass")
