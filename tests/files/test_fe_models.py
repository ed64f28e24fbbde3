"""Nodes of FE models: DOFs by node and direction, orders that the stiffness confirms or contradicts."""

import importlib.util
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import mmwrite, netcdf_file, savemat
from scipy.sparse import csc_array

from dynid.errors import FileError, UsageError
from dynid.files import exodus
from dynid.files.read_matrix import MatrixFile
from dynid.files.read_structure import imported, read_nodes
from dynid.scene.files import missing_files
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.structure import dof_order
from dynid.structure.dof_order import ModeShapes, NodeFile
from dynid.structure.labels import Nodes
from dynid.structure.matrices import nothing
from dynid.structure.modes.modes import modes

pytestmark = pytest.mark.usefixtures("untried")

FE = Path(__file__).parents[3] / "shared" / "data" / "fe"
needs_data = pytest.mark.skipif(not FE.is_dir(), reason="the shared data are not here")
needs_pyyeti = pytest.mark.skipif(
    importlib.util.find_spec("pyyeti") is None, reason="pyyeti is not installed"
)


@needs_data
@needs_pyyeti
def test_a_nastran_superelement_with_its_punch_file():
    """The output system of node 11 is turned: its z is the basic x. Modal coordinates have numbers."""
    model = imported(
        MatrixFile(FE / "outboard.op4"), MatrixFile(FE / "outboard.op4"), nodes=FE / "outboard.pch"
    )
    assert model.size == 46
    assert model.dofs[:6] == ("3:x", "3:y", "3:z", "3:rx", "3:ry", "3:rz")
    assert model.dofs[24] == 1995001
    R = model.nodes.rigid(model.dofs)
    np.testing.assert_array_equal(R[model.dofs.index("11:z"), :3], [1, 0, 0])
    strain = np.abs(model.K @ R) / np.maximum(np.abs(model.K) @ np.abs(R), 1e-300)
    assert strain.max() < 1e-8
    # All its mass: six rigid-body motions have the mass of the structure in all directions.
    masses = np.diag(R.T @ model.M @ R)[:3]
    np.testing.assert_allclose(masses, masses[0], rtol=1e-6)
    assert not model.nodes.doubts


@needs_data
def test_a_block_whose_nodes_stand_in_another_order():
    """Rows are triples of nodes in an order that no file states: its modes tell it."""
    model = imported(
        MatrixFile(FE / "block_a_Maa.m"), MatrixFile(FE / "block_a_Kaa.m"), nodes=FE / "block_a-eig.exo"
    )
    assert len(model.nodes.numbers) == 525
    # The program's own order, of which SDynPy's documentation has the file block_a_gid.m, starts so.
    gid = [26, 211, 283, 29, 30, 217, 355, 103, 212, 284]
    assert model.dofs[:30:3] == tuple(f"{node}:x" for node in gid)
    assert model.row("20:z").sum() == 1
    R = model.nodes.rigid(model.dofs)
    assert (np.abs(model.K @ R).max(axis=0) < 1e-8 * (np.abs(model.K) @ np.abs(R)).max(axis=0)).all()
    assert len(model.nodes.sets["nodelist_1"]) == 25
    with netcdf_file(FE / "block_a-eig.exo", mmap=False) as stored:
        values = stored.variables
        names = [bytes(row).partition(b"\0")[0] for row in values["name_nod_var"][:]]
        theirs = np.array(
            [
                values[f"vals_nod_var{names.index(b'Disp' + axis) + 1}"][8].copy()
                for axis in (b"X", b"Y", b"Z")
            ]
        )
        hertz = values["time_whole"][:20].astype(float)
    found = modes(model.M, model.C, model.K, 20)
    assert found.rigid == 6
    np.testing.assert_allclose(found.omega[6:] / (2 * np.pi), hertz[6:], rtol=1e-9)
    expected = [theirs["xyz".index(dof[-1]), model.nodes.numbers.index(int(dof[:-2]))] for dof in model.dofs]
    own = found.shapes[:, 8]
    np.testing.assert_allclose(own * np.sign(own @ expected), expected, atol=1e-6 * np.abs(own).max())


SPACING = (0.3, 0.2, 0.5)
CUBE = np.array([[i, j, k] for i in (0, 1, 2) for j in (0, 1) for k in (0, 1)]) * SPACING


def lattice(xyz):
    """Springs of different stiffness between all points of a lattice: a free structure of 3 N DOFs."""
    K = np.zeros((3 * len(xyz), 3 * len(xyz)))
    for i in range(len(xyz)):
        for j in range(i):
            length = np.linalg.norm(xyz[i] - xyz[j])
            if length < 0.8:
                axis = (xyz[i] - xyz[j]) / length
                ends = np.zeros(3 * len(xyz))
                ends[3 * i : 3 * i + 3], ends[3 * j : 3 * j + 3] = axis, -axis
                K += (1e5 + 1e3 * (7 * i + j)) * np.outer(ends, ends)
    return K


def write(folder, K, table, name="nodes.csv"):
    n = len(K)
    mmwrite(folder / "k.mtx", csc_array(K), symmetry="symmetric", precision=17)
    mmwrite(folder / "m.mtx", csc_array(np.diag(np.linspace(1, 2, n))), symmetry="symmetric")
    (folder / name).write_text(table)
    return folder / name


def built(folder, nodes, **more):
    return imported(MatrixFile(folder / "m.mtx"), MatrixFile(folder / "k.mtx"), nodes=nodes, **more)


def table_of(xyz, numbers, columns="", more=()):
    rows = [
        f"{node},{','.join(repr(float(value)) for value in point)}"
        for node, point in zip(numbers, xyz, strict=True)
    ]
    ends = [f",{end}" for end in more] or [""] * len(rows)
    return f"node,x,y,z{columns}\n" + "\n".join(row + end for row, end in zip(rows, ends, strict=True)) + "\n"


NUMBERS = list(range(10, 22))


@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize("by_direction", [False, True])
def test_the_stiffness_confirms_the_order_of_a_table(tmp_path, shuffled, by_direction):
    """Nodes in the order of the file or ascending, directions together or apart."""
    K, place = lattice(CUBE), np.arange(36).reshape(12, 3)
    if by_direction:
        K = K[np.ix_(place.T.ravel(), place.T.ravel())]
    rows = np.random.default_rng(3).permutation(12) if shuffled else np.arange(12)
    nodes = write(tmp_path, K, table_of(CUBE[rows], np.array(NUMBERS)[rows]))
    model = built(tmp_path, nodes)
    expected = [f"{node}:{along}" for node in NUMBERS for along in "xyz"]
    if by_direction:
        expected = [f"{node}:{along}" for along in "xyz" for node in NUMBERS]
    assert model.dofs == tuple(expected)
    assert not model.nodes.doubts
    assert np.abs(model.K @ model.nodes.rigid(model.dofs)).max() < 1e-9 * np.abs(model.K).max()


def test_a_stated_order_that_contradicts_the_stiffness_is_a_doubt(tmp_path):
    numbers = NUMBERS[::-1]
    nodes = write(tmp_path, lattice(CUBE), table_of(CUBE, numbers, ",dofs", ["y x z"] * 12))
    model = built(tmp_path, nodes)
    (doubt,) = model.nodes.doubts
    assert re.fullmatch(
        r"the nodes contradict the stiffness: a rigid-body motion of the nodes strains \d+% of the DOFs .*",
        doubt,
    )


def test_an_order_that_is_not_stated_and_contradicted_is_refused(tmp_path):
    rows = np.random.default_rng(5).permutation(12)
    nodes = write(tmp_path, lattice(CUBE)[::-1, ::-1], table_of(CUBE[rows], NUMBERS))
    with pytest.raises(UsageError, match="none that is usual fits the stiffness") as caught:
        built(tmp_path, nodes)
    assert caught.value.names == ("nodes",)


@pytest.mark.parametrize("along", [1, -1])
def test_orders_that_fit_alike_are_refused(tmp_path, along):
    """A row of cubes, held at one end, whose nodes in reverse are its image in a point."""
    xyz = np.array([[i, j, k] for i in range(6) for j in (0, 1) for k in (0, 1)]) * SPACING
    K, names = lattice(xyz), list(range(1, 25))
    K[range(12), range(12)] += 1e8
    nodes = write(tmp_path, K, table_of(xyz[::along], names[::along]))
    if along == 1:  # one order only
        assert built(tmp_path, nodes).dofs[:4] == ("1:x", "1:y", "1:z", "2:x")
        return
    with pytest.raises(UsageError, match="several fit the stiffness: the nodes of the file, each"):
        built(tmp_path, nodes)
    stated = table_of(xyz, names, ",dofs", ["x y z"] * 24)
    assert built(tmp_path, write(tmp_path, K, stated)).dofs[0] == "1:x"


def test_supports_and_missing_dofs(tmp_path):
    """Of a held structure the DOFs away from its supports are in balance; a column says which DOFs exist."""
    xyz = np.array([[i, j, k] for i in range(6) for j in (0, 1) for k in (0, 1)]) * SPACING
    K = lattice(xyz)[12:, 12:]
    numbers = list(range(1, 25))
    held = ["-"] * 4 + ["x y z"] * 20
    model = built(tmp_path, write(tmp_path, K, table_of(xyz, numbers, ",dofs", held)))
    assert model.dofs[0] == "5:x"
    assert not model.nodes.doubts
    with pytest.raises(UsageError, match="60 DOFs, which is no order of DOFs of the 24 nodes"):
        built(tmp_path, write(tmp_path, K, table_of(xyz, numbers)))


def test_an_order_without_supports_is_confirmed_by_the_stiffness(tmp_path):
    """Rows of the free DOFs only, as Nastran's l-set has them: the bulk data say which are held."""
    xyz = np.array([[i, j, k] for i in range(6) for j in (0, 1) for k in (0, 1)]) * SPACING
    grids = "".join(
        f"GRID,{k},,{','.join(repr(float(x)) for x in point)},,{456 if k > 2 else 123456}\n"
        for k, point in enumerate(xyz, 1)
    )
    nodes = write(tmp_path, lattice(xyz)[12:, 12:], f"{grids}SPC,1,3,123\nSPC1,1,123,4\n", "m.bdf")
    model = built(tmp_path, nodes)
    assert model.dofs == tuple(f"{node}:{along}" for node in range(5, 25) for along in "xyz")
    assert not model.nodes.doubts


def test_sets_and_labels(tmp_path):
    nodes = write(tmp_path, lattice(CUBE), table_of(CUBE, NUMBERS, ",set", ["top left"] * 2 + [""] * 10))
    labels = [f"{node}:U{along}" for node in NUMBERS for along in "XYZ"]
    model = built(tmp_path, nodes, labels=labels)
    assert model.dofs == tuple(labels)
    assert model.nodes.sets == {"top": (10, 11), "left": (10, 11)}
    np.testing.assert_array_equal(model.row("12:z"), np.eye(36)[8])


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", "nodes.csv:1: the columns are missing"),
        ("a,b\n", "nodes.csv:1: the columns are a, b"),
        ("# of a\n\na,b\n", "nodes.csv:3: the columns are a, b"),
        ("node,x,y,z\n", "nodes.csv has no nodes"),
        ("node,x,y,z\n1,0,0\n", "nodes.csv:2: 3 entries below 4 columns"),
        ("node,x,y,z\n1,0,zero,0\n", "nodes.csv:2: 'zero' is no coordinate"),
        ("node,x,y,z\n1,0,nan,0\n", "nodes.csv:2: 'nan' is no coordinate"),
        ("node,x,y,z\n1,0,0,0\n1,1,0,0\n", "two nodes have the number 1"),
        ("node,x,y,z,dofs\n1,0,0,0,x q\n", "nodes.csv:2: 'x q' are no directions"),
    ],
)
def test_a_damaged_table(tmp_path, table, said):
    (tmp_path / "nodes.csv").write_text(table)
    with pytest.raises(FileError, match=re.escape(said)):
        read_nodes(tmp_path / "nodes.csv")


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_table_may_begin_with_comments(tmp_path, mark):
    text = "# nodes, of the model\n\nnode,x,y,z\n# the first\n1,0,0,0.5  # here\n"
    (tmp_path / "nodes.csv").write_text(text.replace(",", mark).replace(f"nodes{mark}", "nodes,"))
    found = read_nodes(tmp_path / "nodes.csv").nodes
    assert found.numbers == (1,)
    np.testing.assert_array_equal(found.xyz, [[0, 0, 0.5]])


def test_a_file_of_another_kind(tmp_path):
    (tmp_path / "nodes.txt").write_text("")
    with pytest.raises(FileError, match="is no file of nodes that is read"):
        read_nodes(tmp_path / "nodes.txt")
    with pytest.raises(FileError, match="is no file"):
        read_nodes(tmp_path / "nodes.csv")


def bulk(folder, text, name="model.bdf"):
    (folder / name).write_text(text)
    return read_nodes(folder / name)


def test_coordinate_systems_of_bulk_data(tmp_path):
    """A cylinder about the basic x axis, turned in space, and a sphere within, in closed form."""
    found = bulk(
        tmp_path,
        "SOL 103\nCEND\nBEGIN BULK\n"
        "$ origin (1, 2, 3), z along the basic x, x along the basic y\n"
        "CORD2C  5       0       1.      2.      3.      2.      2.      3.      +A\n"
        "+A      1.      3.      3.\n"
        "CORD2S,6,5,0.,0.,0.,0.,0.,1.,\n"
        ",1.,0.,0.\n"
        "GRID    1       5       2.      90.     4.      0\n"
        "GRID*   2                              5 2.             9.0+1\n"
        "*        4.000000000D+00               5\n"
        "GRID,3,6,2.,90.,180.,6\n"
        "GRID    4               1.-3    -2.5E-1 3.14    -1\n"
        "CBAR,7,1,1,2,0.,1.,0.\n"
        "CHEXA,8,1,1,2,3,4\n"
        "ENDDATA\nGRID,9,,0.,0.,0.\n",
    )
    # r 2, theta 90 degrees: along the system's y, which is the basic z; 4 along the basic x.
    np.testing.assert_allclose(found.nodes.xyz, [[5, 2, 5], [5, 2, 5], [1, 0, 3]], atol=1e-15)
    assert found.nodes.numbers == (1, 2, 3)
    assert set(found.nodes.axes) == {2, 3}
    np.testing.assert_allclose(found.nodes.axes[2], [[0, 0, 1], [0, -1, 0], [1, 0, 0]], atol=1e-15)
    # At the equator, 180 degrees: r along -x of the system, theta along -z, phi along -y.
    np.testing.assert_allclose(found.nodes.axes[3], [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=1e-15)
    assert found.nodes.lines == ((1, 2),)
    assert "2 coordinate systems" in found.nodes.notes


def test_continuations_with_names(tmp_path):
    """Large and small fields in one card, as NX writes them; the name of a continuation is no card."""
    found = bulk(
        tmp_path,
        "CORD2R*  3                               25.             0.             *     FM\n"
        "*     FM 0.              50.             1.0-6           4.7-14         *     FN\n"
        "+     FN 25.     25.     0.\n"
        "GRID*    8               3               1.              2.             *G8\n"
        "*G8      3.              0\n",
    )
    np.testing.assert_allclose(found.nodes.xyz, [[28, 1, 2]], atol=1e-6)


def test_sets_points_and_constraints_of_bulk_data(tmp_path):
    found = bulk(
        tmp_path,
        "GRDSET,,,,,,,456\nGRID,3\nGRID,1,,1.\nGRID,2,,2.\nSPOINT,11,THRU,13\n"
        "ASET1,123,1,THRU,2\nASET1,0,12\nSPC1,1,123456,3\nMPC,1,1,1,1.,2,1,-1.\nRBE2,5,1,123456,2,3\n",
    )
    by_name = {order.name: order.labels for order in found.orders}
    assert by_name["a-set"] == ("1:x", "1:y", "1:z", "2:x", "2:y", "2:z", 12)
    assert by_name["g-set"][:7] == ("1:x", "1:y", "1:z", "1:rx", "1:ry", "1:rz", "2:x")
    assert by_name["g-set"][18:] == (11, 12, 13)
    assert "constraints, which are not applied: 1 SPC1, 1 MPC, 1 RBE2" in found.nodes.notes
    # 456 of all nodes and all of node 3 are held; 1:x depends by the MPC, nodes 2 and 3 by the RBE2.
    assert by_name["g-set without SPC"] == ("1:x", "1:y", "1:z", "2:x", "2:y", "2:z", 11, 12, 13)
    assert by_name["g-set without SPC and MPC"] == ("1:y", "1:z", 11, 12, 13)
    assert not {order.name: order.stated for order in found.orders}["g-set without SPC"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("GRID,1,,a,b\n", "model.bdf cannot be read as Nastran bulk data"),
        ("", "model.bdf has no nodes (GRID)"),
        ("GRID,1,7,1.\n", "coordinate system 7 is not in the file"),
        ("GRID,1,,1.\nGRID,1,,2.\n", "has two different nodes 1"),
        ("GRID,1,,1.\nSPOINT,1,THRU,999999999999\n", "are too many points"),
        ("GRID,1\nCORD2R,1,,0.,0.,0.,1.,0.,0.,\n,2.,0.,0.\n", "coordinate system 1 lie on one line"),
        ("GRID,1\nCORD2R,1,2,0.,0.,0.,1.,0.,0.,\n,0.,1.,0.\n", "coordinate system 1 refers to one that"),
        ("GRID,1\nCORD1R,1,5,6,7\n", "cannot be read as Nastran bulk data"),
        ("GRID,1\nINCLUDE 'model.bdf'\n", "refers to another file, 'model.bdf', which is not followed"),
        (
            "GRID,1\nINCLUDE '/etc/hostname'\n",
            "refers to another file, '/etc/hostname', which is not followed",
        ),
        ("GRID,1,,1e999\n", "model.bdf"),
        ("GRID,1,,0.,0.,0.\n=,*1,,*10.,==\n=8220\n", "model.bdf repeats cards (=)"),
    ],
)
def test_damaged_bulk_data(tmp_path, text, said):
    with pytest.raises(FileError, match=re.escape(said)):
        bulk(tmp_path, text)


@needs_data
@needs_pyyeti
def test_positions_and_axes_are_those_of_pyyeti():
    from pyyeti.nastran import bulk as reader

    uset = reader.asm2uset(str(FE / "outboard.pch"))[0]
    found = read_nodes(FE / "outboard.pch")
    for node, point in zip(found.nodes.numbers, found.nodes.xyz, strict=True):
        rows = uset.loc[node][["x", "y", "z"]].to_numpy()
        np.testing.assert_array_equal(point, rows[0])
        axes = found.nodes.axes.get(node, np.eye(3))
        np.testing.assert_allclose(axes, rows[3:].T, atol=1e-15)


@needs_data
@pytest.mark.parametrize("kept", [2, 3, 100, 5000, 40_000, 400_000, 1_298_000])
def test_a_truncated_exodus_file(tmp_path, kept):
    (tmp_path / "a.exo").write_bytes((FE / "block_a-eig.exo").read_bytes()[:kept])
    with pytest.raises(FileError, match="cannot be read as Exodus"):
        read_nodes(tmp_path / "a.exo")


def test_exodus_in_hdf5(tmp_path):
    """As netCDF 4 stores it."""
    with h5py.File(tmp_path / "a.exo", "w") as store:
        for axis, column in zip("xyz", CUBE.T, strict=True):
            store[f"coord{axis}"] = column
        store["node_num_map"] = np.arange(10, 22)
        store["eb_prop1"] = [1]
        store["connect1"] = np.array([[1, 5], [2, 6]])
        store["connect1"].attrs["elem_type"] = np.bytes_("BEAM2")
        store["ns_prop1"] = [7]
        store["node_ns1"] = [1, 2]
    found = read_nodes(tmp_path / "a.exo").nodes
    np.testing.assert_array_equal(found.xyz, CUBE)
    assert found.numbers == tuple(range(10, 22))
    assert found.lines == ((10, 14), (11, 15))
    assert found.sets == {"7": (10, 11)}


@needs_data
@needs_pyyeti
def test_scenes_name_dofs_of_nodes(tmp_path):
    """The reduction of a scene at DOFs by node and direction; a table that contradicts is a warning."""
    text = f"""
dynid: 1
kind: reduction
structure:
  matrices: {{mass: {FE}/outboard.op4, stiffness: {FE}/outboard.op4, nodes: {FE}/outboard.pch}}
reduction: [{{method: guyan, masters: ["3:z", "11:z", "19:x", "27:y", "3:rx", "27:rz", "19:rz"]}}]
"""
    (tmp_path / "s.yaml").write_text(text)
    result = run_scene(load_scene(tmp_path / "s.yaml"))
    masters = result["reduction/guyan/masters"].data
    assert "11:z" in result["reduction/dof"].data[masters - 1].tolist()
    assert "structure/nodes" not in result.group_attrs
    table = "node,x,y,z,dofs\n" + "".join(
        f"{k},{k % 3},{k % 5},{k % 7},x y z rx ry rz\n" for k in range(1, 5)
    )
    points = "".join(f"{k},{k},0,0,x\n" for k in range(5, 27))
    (tmp_path / "nodes.csv").write_text(table + points)
    changed = text.replace(f"{FE}/outboard.pch", "nodes.csv").partition("reduction: [")[0]
    (tmp_path / "s.yaml").write_text(f"{changed}reduction: [{{method: modal, modes: {{count: 8}}}}]")
    found = run_scene(load_scene(tmp_path / "s.yaml")).group_attrs["structure/nodes"]["doubt"]
    assert found.startswith("the nodes contradict the stiffness")


def test_a_missing_file_of_nodes_is_located(tmp_path):
    write(tmp_path, lattice(CUBE), "")
    (tmp_path / "s.yaml").write_text(
        "dynid: 1\nkind: reduction\nstructure:\n  matrices:\n    mass: m.mtx\n    stiffness: k.mtx\n"
        "    nodes: none.csv\nreduction: [{method: modal, modes: {count: 8}}]\n"
    )
    (fault,) = missing_files(load_scene(tmp_path / "s.yaml"))
    assert (fault.line, fault.column) == (7, 5)


def test_what_an_exodus_file_leaves_out_is_left_out(tmp_path, monkeypatch):
    """Sets and blocks without members, elements without edges, modes of another size than the nodes."""
    path = tmp_path / "a.exo"
    with h5py.File(path, "w") as store:
        for axis, column in zip("xyz", CUBE.T, strict=True):
            store[f"coord{axis}"] = column
        store["eb_prop1"], store["ns_prop1"] = [1, 2, 3], [4, 5]
        for block, kind in ((1, "SPHERE"), (3, "BEAM2")):
            store[f"connect{block}"] = np.array([[1, 5]])
            store[f"connect{block}"].attrs["elem_type"] = np.bytes_(kind)
        store["node_ns2"] = [3]
        store["name_nod_var"] = np.array([list(f"disp{axis}") for axis in "xyz"], dtype="S1")
        store["name_glo_var"] = np.array([list("eigenfrequency")], dtype="S1")
        store["vals_glo_var"] = np.ones((2, 1))
        for k in (1, 2, 3):
            store[f"vals_nod_var{k}"] = np.ones((2, 5))
    found = read_nodes(path)
    assert found.nodes.sets == {"5": (3,)}
    assert found.nodes.lines == ((1, 5),)
    assert found.modes is None
    monkeypatch.setattr(exodus, "_MOST_OUTLINES", 0)
    assert read_nodes(path).nodes.lines == ()
    with h5py.File(path, "r+") as store:
        for k in (1, 2, 3):
            del store[f"vals_nod_var{k}"]
            store[f"vals_nod_var{k}"] = np.full((2, 12), float(k))
    shapes, frequencies = read_nodes(path).modes
    np.testing.assert_allclose(frequencies, 2 * np.pi * np.ones(2), rtol=1e-15)
    np.testing.assert_array_equal(shapes, np.tile([[[1.0], [2.0], [3.0]]], (12, 1, 2)))
    with h5py.File(path, "w") as store:
        store["eb_prop1"] = [1]
    with pytest.raises(FileError, match=r"a\.exo has no nodes"):
        read_nodes(path)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"nodes": np.ones((2, 5))}, "has no nodes. These are a matrix node, nodes, xyz"),
        ({"node": np.array([[1, 0, 3, 0, 0, 0, 0]])}, "has nodes in other than basic coordinates"),
        ({"node": np.array([[1.5, 0, 0, 0]])}, "has numbers of nodes that are not whole"),
        ({"xyz": np.eye(3), "dof": np.ones((2, 3))}, "has DOFs in 3 columns, not one or two"),
        ({"xyz": np.eye(3), "dof": np.array([[1, 7], [2, 1]])}, "has DOFs that are no node and component 1"),
    ],
)
def test_nodes_of_matlab_that_make_no_sense_are_refused(tmp_path, columns, said):
    savemat(tmp_path / "n.mat", columns)
    with pytest.raises(FileError) as caught:
        read_nodes(tmp_path / "n.mat")
    assert said in str(caught.value)


def test_an_order_that_nothing_confirms_is_a_guess(tmp_path):
    """Of a full stiffness on supports, as a reduced structure has it, rigid-body motions say nothing."""
    root = np.random.default_rng(0).standard_normal((36, 36))
    full = root @ root.T + np.eye(36)
    (doubt,) = built(tmp_path, write(tmp_path, full, table_of(CUBE, NUMBERS))).nodes.doubts
    assert doubt.startswith(
        "the order of the DOFs, 10:x, 10:y, 10:z, …, is a guess that could not be confirmed: a rigid-body "
        "motion of the nodes strains 100% of the DOFs"
    )
    stated = write(tmp_path, full, table_of(CUBE, NUMBERS, ",dofs", ["x y z"] * 12))
    assert not built(tmp_path, stated).nodes.doubts
    with pytest.raises(UsageError, match="none that is usual fits the stiffness"):  # springs to the ground
        built(tmp_path, write(tmp_path, np.diag(np.diag(full)), table_of(CUBE, NUMBERS)))


def test_of_a_large_stiffness_rigid_body_modes_are_not_counted(tmp_path, monkeypatch):
    rows = np.random.default_rng(5).permutation(12)
    nodes = write(tmp_path, lattice(CUBE)[::-1, ::-1], table_of(CUBE[rows], NUMBERS))
    monkeypatch.setattr(dof_order, "_MOST_COUNTED", 35)
    (doubt,) = built(tmp_path, nodes).nodes.doubts
    assert "is a guess that could not be confirmed" in doubt


def test_modes_of_the_nodes_tell_the_order_of_the_rows():
    """Rows in any order of the nodes have the shapes of the file, each up to its sign."""
    generator = np.random.default_rng(2)
    K, M = lattice(CUBE), np.diag(np.repeat(np.linspace(1, 2, 12), 3))
    made = modes(M, nothing(36, sparse=False), K, 20)
    shapes = made.shapes.reshape(12, 3, -1) * generator.choice([-1.0, 1.0], 20)
    nodes = Nodes(tuple(NUMBERS), CUBE)
    order = generator.permutation(12)
    rows = np.arange(36).reshape(12, 3)[order].ravel()
    mixed = M[np.ix_(rows, rows)], K[np.ix_(rows, rows)]
    labels, found = dof_order.assigned(*mixed, (), NodeFile(nodes, (), ModeShapes(shapes, made.omega)))
    assert labels == tuple(f"{NUMBERS[k]}:{along}" for k in order for along in "xyz")
    assert not found.doubts
    others = Nodes(tuple(NUMBERS), CUBE[::-1] ** 2)  # of other positions: the stiffness does not confirm it
    for wrong in (
        NodeFile(nodes, (), ModeShapes(shapes, 1.01 * made.omega)),
        NodeFile(nodes, (), ModeShapes(generator.standard_normal(shapes.shape), made.omega)),
        NodeFile(others, (), ModeShapes(shapes, made.omega)),
    ):
        with pytest.raises(UsageError, match="none that is usual fits the stiffness"):
            dof_order.assigned(*mixed, (), wrong)


def test_notes_and_sets_of_sets_of_an_input_file(tmp_path):
    text = """\
** a comment

*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 0, 1, 0
*NSET, NSET=low
1, 2,
*NSET, NSET=all
low, 3
*TRANSFORM, NSET=low
1, 0, 0, 0, 1, 0
*BOUNDARY
low, 1, 3
"""
    (tmp_path / "a.inp").write_text(text)
    nodes = read_nodes(tmp_path / "a.inp").nodes
    assert nodes.sets == {"low": (1, 2), "all": (1, 2, 3)}
    assert nodes.notes[0] == "1 coordinate system of *TRANSFORM, which are not applied"
