"""Models of other projects' test suites: right, refused with a reason, or wrong, which none may be.

`DYNID_FOREIGN_MODELS` names a folder with their repositories `pyyeti`, `sdynpy`, `exudyn`, `pynastran` and
`suitesparse`; without it the test is skipped. The file `oracle.json` in it has what pyNastran reads
(`tests/data/foreign_oracle.py` writes it). As a script, ``python -m tests.files.test_foreign_models``,
this module lists the verdict on each file.
"""

import json
import os
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import DynidError
from dynid.files.read_matrix import MatrixFile, container_of, read_matrix
from dynid.files.read_structure import imported, model_files, read_nodes
from dynid.structure.matrices import as_array
from dynid.structure.modes.modes import modes

pytestmark = pytest.mark.usefixtures("untried")

FOLDER = os.environ.get("DYNID_FOREIGN_MODELS", "")
FE = Path(__file__).parents[3] / "shared" / "data" / "fe"

BLOCKS = ("blockC3D8_", "blockC3D10_", "blockC3D20_", "blockC3D20R_", "blockC3D4_")


def verdicts(folder):
    """Yield file, verdict and a note."""
    oracle = json.loads((folder / "oracle.json").read_text())
    yield from sierra(folder / "sdynpy/docs/book/assets")
    yield from abaqus(folder / "exudyn/main/pythonDev/TestModels/testData")
    yield from superelements(folder / "pyyeti/pyyeti/tests")
    yield from sets(folder / "pyyeti/pyyeti/tests")
    yield from bulk_data(folder / "pynastran", oracle["bdf"])
    yield from output4(folder / "pynastran", oracle["op4"])
    yield from harwell_boeing(folder / "suitesparse/CHOLMOD/Demo/Matrix")


def judged(files, check):
    """Return the verdict on files that a function reads and compares."""
    try:
        note = check()
    except DynidError as error:
        return [(file, "refused", str(error)) for file in files]
    except AssertionError as error:
        return [(file, "WRONG", " ".join(str(error).split())[:200]) for file in files]
    return [(file, "right", note) for file in files]


def free(model, rtol=1e-6):
    """A free structure: rigid-body motions strain nothing and have one mass in all directions."""
    R = model.nodes.rigid(model.dofs)
    K, M = as_array(model.K), as_array(model.M)
    strain = np.abs(K @ R) / np.maximum(np.abs(K) @ np.abs(R), 1e-300)
    assert strain.max() < rtol, f"strain {strain.max():.2g}"
    masses = np.diag(R.T @ M @ R)[:3]
    assert np.ptp(masses) < 1e-6 * masses[0], f"masses {masses}"
    assert not model.nodes.doubts
    return f"{model.size} DOFs, |K R| {strain.max():.1g}, mass {masses[0]:.6g}"


def sierra(folder):
    """Sierra/SD: matrices, and the program's frequencies, shapes and order of nodes."""
    from scipy.io import netcdf_file

    for name in ("block_a", "block_a2", "block_ac", "block_bc", "block_c"):
        files = [folder / f"{name}_Maa.m", folder / f"{name}_Kaa.m", folder / f"{name}-eig.exo"]

        def check(files=files, name=name):
            model = imported(MatrixFile(files[0]), MatrixFile(files[1]), nodes=files[2])
            with netcdf_file(files[2], mmap=False) as stored:
                hertz = stored.variables["time_whole"][:20].astype(float)
            found = modes(model.M, model.C, model.K, 20).omega / (2 * np.pi)
            np.testing.assert_allclose(found[6:], hertz[6:], rtol=1e-9)
            gid = re.findall(r"x\(\d+\) = (\d+);", (folder / f"{name}_gid.m").read_text())
            own = [dof[:-2] for dof in model.dofs[::3]]
            error = np.abs(found[6:] / hertz[6:] - 1).max()
            exact = "the program's order of nodes"
            if own != gid:  # a symmetric block: K and M are the same in both orders
                rows = np.array([[3 * own.index(node) + k for k in range(3)] for node in gid]).ravel()
                for matrix in (model.K, model.M):
                    turned = (
                        matrix[np.ix_(rows, rows)]
                        if isinstance(matrix, np.ndarray)
                        else matrix[rows][:, rows]
                    )
                    assert abs(turned - matrix).max() < 1e-9 * abs(matrix).max()
                exact = "an order of the nodes in which K and M are the same"
            return f"{free(model, 1e-9)}, frequencies to {error:.1g}, {exact}"

        yield from judged(files, check)
    for name in ("block_1", "block_2", "block_abc", "block_all"):
        path = folder / f"{name}-eig.exo"

        def check_nodes(path=path):
            found = read_nodes(path)
            with netcdf_file(path, mmap=False) as stored:
                for axis, column in zip("xyz", found.nodes.xyz.T, strict=True):
                    np.testing.assert_array_equal(column, stored.variables[f"coord{axis}"][:])
                np.testing.assert_array_equal(found.nodes.numbers, stored.variables["node_num_map"][:])
            return f"{len(found.nodes.numbers)} nodes, {len(found.nodes.lines)} edges"

        yield from judged([path], check_nodes)


def abaqus(folder):
    """Abaqus, free blocks and a rotor, and a rotor of Ansys."""
    names = [folder / "abaqus" / name for name in BLOCKS] + [folder / "rotorDiscTest"]
    for stem in names:
        source = stem.with_name(f"{stem.name.rstrip('_')}.inp")
        files = [source, stem.with_name(f"{stem.name}MASS1.mtx"), stem.with_name(f"{stem.name}STIF1.mtx")]

        def check(source=source):
            whole = model_files(source)
            model = imported(whole.mass, whole.stiffness, nodes=whole.nodes)
            assert modes(model.M, model.C, model.K, 8).rigid == 6
            return free(model, 1e-5)

        yield from judged(files, check)
    pair = [folder / f"rotorAnsys{name}MatrixSparse.txt" for name in ("Mass", "Stiffness")]

    def check_ansys():
        from scipy.io import mmread

        for file, role in zip(pair, ("mass", "stiffness"), strict=True):
            found = read_matrix(MatrixFile(file), role).matrix
            assert abs(found - mmread(file)).max() == 0
        model = imported(*(MatrixFile(file) for file in pair))
        return f"{model.size} DOFs, {modes(model.M, model.C, model.K, 8).rigid} rigid-body modes"

    yield from judged(pair, check_ansys)
    table = folder / "rotorAnsysNodalCoordinates.txt"
    yield from judged([table], lambda: read_nodes(table))


def superelements(folder):
    """Nastran: matrices of free superelements in OUTPUT4, their nodes in punch files."""
    for place in (
        "cla_test_data/outboard",
        "cla_test_data_2020/outboard",
        "nas2cam_csuper/inboard",
        "nas2cam_extseout/inboard",
        "nas2cam_extseout/outboard",
        "nas2cam_extseout/reduced_bset_notall6",
    ):
        files = [folder / f"{place}.op4", folder / f"{place}.pch"]

        def check(path=files[0]):
            whole = model_files(path)
            model = imported(whole.mass, whole.stiffness, nodes=whole.nodes)
            return free(model, 1e-4)

        yield from judged(files, check)


def sets(folder):
    """Nastran: nodes of OUTPUT2 against those of the bulk data of the same run."""
    for place in (
        "nas2cam_extseout/inboard",
        "nas2cam_extseout/full",
        "nas2cam_extseout/cant_beam",
        "nastran_drm12/inboard",
        "nas2cam_csuper/assemble",
        "cla_test_data/nas2cam",
        "nastran_dmig_data/matrix",
    ):
        files = [folder / f"{place}.op2", folder / f"{place}.dat"]

        def check(files=files):
            one = read_nodes(files[0]).nodes
            other = read_nodes(files[1]).nodes
            assert set(one.numbers) == set(other.numbers)
            order = [other.places[node] for node in one.numbers]
            np.testing.assert_allclose(one.xyz, other.xyz[order], rtol=1e-7, atol=1e-9)
            for node in one.numbers:
                np.testing.assert_allclose(
                    one.axes.get(node, np.eye(3)), other.axes.get(node, np.eye(3)), atol=1e-7
                )
            return f"{len(order)} nodes, {len(one.axes)} with own axes"

        yield from judged([file for file in files if file.is_file()], check)


def bulk_data(folder, oracle):
    """Positions and axes as pyNastran reads them."""
    for name, expected in oracle.items():

        def check(name=name, expected=expected):
            nodes = read_nodes(folder / name).nodes
            assert {str(number) for number in nodes.numbers} == set(expected)
            for number, place in zip(nodes.numbers, nodes.xyz, strict=True):
                position, axes = expected[str(number)]
                np.testing.assert_allclose(place, position, rtol=1e-12, atol=1e-9)
                own = nodes.axes.get(number, np.eye(3))
                np.testing.assert_allclose(own, np.eye(3) if axes is None else axes, atol=1e-12)
            return f"{len(expected)} nodes, {len(nodes.axes)} with own axes"

        yield from judged([folder / name], check)


def output4(folder, oracle):
    """Real matrices as pyNastran reads them."""
    for name, expected in oracle.items():

        def check(path=folder / name, expected=expected):
            shapes = {found.upper(): found for found in container_of(path).shapes(path)}
            right = refused = 0
            for matrix, (shape, kind, values) in expected.items():
                if kind.startswith("complex"):
                    with pytest.raises(DynidError, match="complex"):
                        container_of(path).matrix(path, shapes[matrix])
                    refused += 1
                    continue
                found = as_array(container_of(path).matrix(path, shapes[matrix]).matrix)
                assert list(found.shape) == shape
                if found.size < 1e4:
                    np.testing.assert_allclose(found, values, rtol=1e-6)
                else:
                    sums = [np.abs(found).sum(), (found * np.arange(found.shape[1])).sum()]
                    np.testing.assert_allclose(sums, values, rtol=1e-4, atol=1e-3 * values[0])
                right += 1
            if not right:
                raise DynidError("all matrices are complex, which are refused")
            return f"{right} matrices" + (f", {refused} complex ones refused" if refused else "")

        yield from judged([folder / name], check)


def harwell_boeing(folder):
    """The collection's files against the shared copy in Matrix Market."""
    for name in ("bcsstk01.rsa", "bcsstk02.rsa", "lp_afiro.rra"):
        path = folder / name

        def check(path=path):
            found = as_array(read_matrix(MatrixFile(path), "stiffness").matrix)
            if path.stem == "bcsstk01":
                other = read_matrix(MatrixFile(FE / "bcsstk01.mtx"), "stiffness").matrix
                np.testing.assert_allclose(found, as_array(other), rtol=1e-12)
            assert np.linalg.eigvalsh(found)[0] > 0
            assert (found == found.T).all()
            return f"{len(found)} rows, condition {np.linalg.cond(found):.4g}"

        yield from judged([path], check)


@pytest.mark.slow
@pytest.mark.skipif(not FOLDER, reason="DYNID_FOREIGN_MODELS names no folder")
def test_no_file_of_other_projects_is_read_wrongly():
    found = list(verdicts(Path(FOLDER)))
    assert [item for item in found if item[1] == "WRONG"] == []
    counts = Counter(verdict for _, verdict, _ in found)
    assert counts["right"] >= 40


if __name__ == "__main__":
    everything = list(verdicts(Path(FOLDER)))
    print("| file | verdict | note |\n|---|---|---|")
    for file, verdict, note in everything:
        print(f"| {Path(file).relative_to(FOLDER)} | {verdict} | {str(note).replace(FOLDER + '/', '')} |")
    print("\n", dict(Counter(verdict for _, verdict, _ in everything)))
