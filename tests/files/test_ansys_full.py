"""Matrices of Ansys `.full` files: of the package's own example, and of what a reader may return."""

import types
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csc_array, triu

from dynid.errors import FileError
from dynid.files.read_matrix import MatrixFile, container_of, read_matrix
from dynid.files.recorder_files import _is_installed

#: Nodes and directions of four equations, in the order of nodes; node 1 is held in y.
DOFS = np.array([[1, 0], [1, 1], [7, 0], [7, 5]], dtype=np.int32)
FULL = np.array([[4.0, 0, -1, 2], [0, 0, 0, 0], [-1, 0, 3, 0.5], [2, 0, 0.5, 5]])
KEPT = [0, 2, 3]


@pytest.fixture
def stored(tmp_path, monkeypatch, untried):  # noqa: ARG001
    """Return a function that lets the reader return equations, and the path of the file."""
    (tmp_path / "x.full").write_bytes(b"a file")

    def read(stiffness=FULL, mass=FULL, dofs=DOFS, const=((1, 1),), kind=types.SimpleNamespace):
        def load_km(as_sparse, sort):
            assert (as_sparse, sort) == (True, True)
            return dofs, csc_array(triu(stiffness)), csc_array(mass)

        content = kind(load_km=load_km, const=[*const])
        module = types.SimpleNamespace(read_binary=lambda _: content)
        monkeypatch.setattr("dynid.files.recorder_files._is_installed", lambda _: True)
        monkeypatch.setattr("dynid.files.ansys_full.import_module", lambda _: module)
        monkeypatch.setattr("dynid.files.untrusted._archives", {})
        return tmp_path / "x.full"

    return read


def refusal(path, role="stiffness"):
    with pytest.raises(FileError) as caught:
        read_matrix(MatrixFile(path), role)
    return str(caught.value)


def test_triangles_are_completed_and_constrained_equations_left_out(stored):
    path = stored()
    assert container_of(path).shapes(path) == {"K": (3, 3), "M": (3, 3)}
    for role in ("stiffness", "mass"):
        imported = read_matrix(MatrixFile(path), role)
        assert imported.labels == ("1:x", "7:x", "7:rz")
        np.testing.assert_array_equal(imported.matrix.toarray(), FULL[np.ix_(KEPT, KEPT)])


def test_an_equation_without_stiffness_that_is_not_constrained_stays(stored):
    assert read_matrix(MatrixFile(stored(const=())), "stiffness").labels == ("1:x", "1:y", "7:x", "7:rz")


def test_both_triangles_of_an_unsymmetric_matrix_stay(stored):
    mass = FULL + np.diag([0, 0, 1.0], 1)
    assert np.any(mass != mass.T)
    np.testing.assert_array_equal(
        read_matrix(MatrixFile(stored(mass=mass)), "mass").matrix.toarray(), mass[np.ix_(KEPT, KEPT)]
    )


def test_what_are_no_equations_of_a_structure_is_refused(stored):
    assert "its 4 equations have 3 DOFs, or one of these twice" in refusal(stored(dofs=DOFS[:3]))
    assert "or one of these twice" in refusal(stored(dofs=DOFS[[0, 1, 2, 2]]))
    assert "such as temperatures" in refusal(stored(dofs=DOFS + np.array([0, 20])))
    only = stored(mass=np.zeros((4, 4)))
    assert "does not say which matrix is the mass; it has K (3 x 3)" in refusal(only, "mass")
    results = stored(kind=lambda **_: types.SimpleNamespace())
    assert "it holds results or element matrices (SimpleNamespace)" in refusal(results)


def test_without_the_reader_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.files.recorder_files.find_spec", lambda _: None)
    (tmp_path / "x.full").write_bytes(b"a file")
    assert "pip install 'dynid[ansys]'" in refusal(tmp_path / "x.full")


def test_the_example_of_the_package(tmp_path):
    if not _is_installed("ansys.mapdl.reader"):
        pytest.skip("ansys-mapdl-reader is an extra")
    path = Path(find_spec("ansys.mapdl.reader").origin).parent / "examples" / "file.full"
    matrices = [read_matrix(MatrixFile(path), role) for role in ("stiffness", "mass")]
    assert matrices[0].labels == matrices[1].labels
    assert len(matrices[0].labels) == 900
    K, M = (imported.matrix.toarray() for imported in matrices)
    hertz = np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=[0, 5])) / (2 * np.pi)
    # As Ansys prints them for the example, in its documentation.
    np.testing.assert_allclose(hertz, [1283.200, 1283.200, 5781.975, 6919.399, 6919.399, 10172.61], rtol=1e-6)
    (tmp_path / "cut.full").write_bytes(path.read_bytes()[:20000])
    assert "cannot be read as an Ansys .full file" in refusal(tmp_path / "cut.full")
