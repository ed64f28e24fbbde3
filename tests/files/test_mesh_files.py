"""Meshes out of files: sets, groups, numbers of nodes, and what is refused."""

import sys

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_mesh import read_mesh
from dynid.structure.solid import Material, SetSupport, solid
from dynid.structure.solid_elements import ELEMENTS
from tests.structure.boxes import box

pytestmark = pytest.mark.usefixtures("untried")

meshio = pytest.importorskip("meshio")
UNIT = Material(1.0, 0.3, 1.0)


def test_groups_of_gmsh_by_name_and_by_number(tmp_path):
    path = tmp_path / "block.msh"
    mesh = box("tetra", (2, 1, 1))
    cells = mesh.blocks[0].cells
    left = mesh.xyz[cells].mean(axis=1)[:, 0] < 0.5
    clamp = cells[0, :3]
    blocks = [("tetra", cells[left]), ("tetra", cells[~left]), ("triangle", clamp[None]), ("vertex", [[11]])]
    tags = {
        "gmsh:physical": [
            np.full(len(each), tag) for tag, (_, each) in zip((10, 11, 20, 30), blocks, strict=True)
        ],
        "gmsh:geometrical": [np.ones(len(each), dtype=int) for _, each in blocks],
    }
    names = {"left": np.array([10, 3]), "right": np.array([11, 3]), "clamp": np.array([20, 2])}
    made = meshio.Mesh(mesh.xyz, blocks, cell_data=tags, field_data=names)
    meshio.write(path, made, file_format="gmsh22", binary=False)
    found = read_mesh(path)
    assert set(found.groups) == {"left", "right"}
    assert set(found.sets) == {"left", "right", "clamp", "30"}
    np.testing.assert_array_equal(found.sets["clamp"], np.sort(clamp))
    np.testing.assert_array_equal(found.sets["30"], [11])
    halves = {"left": UNIT, "right": Material(2.0, 0.1, 3.0)}
    whole = solid(found, halves)
    assert np.sum(whole.M) / 3 == pytest.approx(0.5 * 1 + 0.5 * 3, rel=1e-12)
    assert whole.nodes.sets["clamp"] == tuple(np.sort(clamp) + 1)
    held = solid(found, halves, supports=[SetSupport("clamp", ("x",))])
    assert whole.size - held.size == 3


MSH4 = """\
$MeshFormat
4.1 0 8
$EndMeshFormat
$Nodes
2 4 5 9
0 1 0 1
7
0 0 0
3 1 0 3
5
8
9
1 0 0
0 1 0
0 0 1
$EndNodes
$Elements
1 1 1 1
3 1 4 1
1 7 5 8 9
$EndElements
"""
MSH2 = """\
$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
7 0 0 0
5 1 0 0
8 0 1 0
9 0 0 1
$EndNodes
$Elements
1
1 4 2 3 1 7 5 8 9
$EndElements
"""


@pytest.mark.parametrize("text", [MSH2, MSH4])
def test_nodes_have_their_numbers_of_gmsh(tmp_path, text):
    (tmp_path / "one.msh").write_text(text)
    mesh = read_mesh(tmp_path / "one.msh", 1e-3)
    assert mesh.numbers == (7, 5, 8, 9)
    np.testing.assert_allclose(mesh.xyz, 1e-3 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    model = solid(mesh, UNIT)
    assert model.dofs[:4] == ("7:x", "7:y", "7:z", "5:x")


def test_numbers_that_are_not_read_are_a_doubt(tmp_path, monkeypatch):
    mesh = box("tetra", (1, 1, 1))
    meshio.write(tmp_path / "one.e", meshio.Mesh(mesh.xyz, [("tetra", mesh.blocks[0].cells)]))
    monkeypatch.setattr("dynid.files.read_mesh._at", lambda *_: None)
    found = read_mesh(tmp_path / "one.e")
    assert found.numbers == tuple(range(1, 9))
    assert found.doubts == ("the numbers of nodes in one.e are not read; they count from 1",)
    assert found.doubts[0] in solid(found, UNIT).nodes.doubts


BULK = """\
BEGIN BULK
GRID,101,,0.,0.,0.
GRID,7,,1.,0.,0.
GRID,33,,0.,1.,0.
GRID,4,,0.,0.,1.
CTETRA,1,1,101,7,33,4
ENDDATA
"""


def test_nodes_have_their_numbers_of_nastran_and_exodus(tmp_path):
    (tmp_path / "one.bdf").write_text(BULK)
    found = read_mesh(tmp_path / "one.bdf")
    assert found.numbers == (101, 7, 33, 4)
    assert found.doubts == ()
    mesh = box("tetra10", (1, 1, 1))
    meshio.write(tmp_path / "one.e", meshio.Mesh(mesh.xyz, [("tetra10", mesh.blocks[0].cells)]))
    same = read_mesh(tmp_path / "one.e")
    assert same.doubts == ()
    np.testing.assert_array_equal(same.xyz, mesh.xyz)


ABAQUS = """\
*NODE
101, 0, 0, 0
7, 1, 0, 0
33, 0, 1, 0
4, 0, 0, 1
*ELEMENT, TYPE=C3D4, ELSET=body
1, 101, 7, 33, 4
*NSET, NSET=base
101, 7, 33
"""


def test_sets_of_abaqus(tmp_path):
    (tmp_path / "one.inp").write_text(ABAQUS)
    mesh = read_mesh(tmp_path / "one.inp")
    assert set(mesh.groups) == {"body"}
    np.testing.assert_array_equal(mesh.sets["base"], [0, 1, 2])
    assert solid(mesh, {"body": UNIT}, supports=[SetSupport("base", ("x", "y", "z"))]).dofs == (
        "4:x",
        "4:y",
        "4:z",
    )


@pytest.mark.parametrize("kind", ["tetra", "tetra10", "hexahedron", "hexahedron20", "hexahedron27", "wedge"])
@pytest.mark.parametrize("form", [".vtk", ".vtu", ".msh", ".inp"])
def test_the_nodes_of_elements_keep_their_order_through_formats(tmp_path, kind, form):
    """A wrong order folds elements, or changes the volume and the modes."""
    if (kind, form) == ("hexahedron27", ".inp"):
        pytest.skip("meshio does not write these")
    mesh = box(kind, (2, 1, 1), move=lambda xyz: xyz + 0.05 * np.sin(2 * xyz[:, [1, 2, 0]]))
    path = tmp_path / f"block{form}"
    meshio.write(path, meshio.Mesh(mesh.xyz, [(kind, mesh.blocks[0].cells)]),
                 file_format="gmsh22" if form == ".msh" else None)  # fmt: skip
    one, other = solid(mesh, UNIT), solid(read_mesh(path), UNIT)
    K, same = (np.asarray(m.K.todense()) if m.is_sparse else np.asarray(m.K) for m in (one, other))
    np.testing.assert_allclose(same, K, rtol=0, atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("kind", ["hexahedron20", "hexahedron27"])
@pytest.mark.parametrize("own", [True, False])
def test_hexahedra_of_exodus_have_its_order_of_nodes_or_that_of_meshio(tmp_path, kind, own):
    """Exodus II, element types: 13-16 on the vertical edges, 21 the centre, then faces -z +z -x +x -y +y."""
    pytest.importorskip("netCDF4")
    levels = [(-1, k) for k in range(4)] + [(1, k) for k in range(4)]
    corners = [((-1, 1, 1, -1)[k], (-1, -1, 1, 1)[k], z) for z, k in levels]
    below = [(0, -1, -1), (1, 0, -1), (0, 1, -1), (-1, 0, -1)]
    upright = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    above = [(x, y, 1) for x, y, _ in below]
    faces = [(0, 0, 0), (0, 0, -1), (0, 0, 1), (-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)]
    xyz = np.array([*corners, *below, *upright, *above, *faces], dtype=float)[: int(kind[-2:])]
    cells = np.arange(len(xyz))[None]
    if not own:
        xyz = 2 * box(kind, (1, 1, 1)).xyz
        cells = box(kind, (1, 1, 1)).blocks[0].cells
    moved = xyz @ [[1.0, 0.1, 0], [0, 2, 0.2], [0.3, 0, 1]] + 0.01 * np.sin(7 * xyz)
    meshio.write(tmp_path / "one.e", meshio.Mesh(moved, [(kind, cells)]))
    (block,) = read_mesh(tmp_path / "one.e").blocks
    corner = xyz[block.cells[0, :8]]
    expected = corner[0] + ELEMENTS[kind].nodes * (corner[6] - corner[0])
    np.testing.assert_allclose(xyz[block.cells[0]], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ([("triangle", [[0, 1, 2]])], "has no solid elements; it has triangle"),
        ([("pyramid", [[0, 1, 2, 3, 4]])], "has elements of the kind pyramid"),
        ([("vertex", [[0]])], "has no solid elements; it has vertex"),
    ],
)
def test_meshes_without_known_solids_are_refused(tmp_path, cells, said):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]])
    meshio.write(tmp_path / "m.vtk", meshio.Mesh(points, [(kind, np.array(each)) for kind, each in cells]))
    with pytest.raises(FileError, match=said):
        read_mesh(tmp_path / "m.vtk")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none.msh", None, "is no file"),
        ("bad.msh", "hello\n", "is no mesh of gmsh: it does not start with .MeshFormat"),
        ("bad.vtk", "hello\n", "is no mesh that meshio reads"),
        ("cut.msh", MSH4[:70], "ends within .Nodes: it is incomplete"),
        ("cut.msh", MSH4[:143], "ends within .Elements: it is incomplete"),
        ("far.msh", MSH2.replace("1 7 5 8 9", "1 7 5 8 4"), "a tetra has the node 4, which is not there"),
        ("empty.msh", "", "is no mesh of gmsh"),
        ("what.xyzzy", "1 2 3\n", r"is no file of meshes that is read\. Those end in \.bdf, "),
        (
            "what.unv",
            "    -1\n  2411\n",
            r"is a Universal File, from which no meshes are read\. Meshes are read from gmsh, Abaqus, ",
        ),
        ("nan.msh", MSH2.replace("8 0 1 0", "8 0 nan 0"), "a node without a finite position"),
    ],
)
def test_unreadable_files_are_refused(tmp_path, name, content, said, capfd):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(FileError, match=said) as raised:
        read_mesh(tmp_path / name)
    assert raised.value.names == ("mesh",)
    assert capfd.readouterr() == ("", "")


def test_without_meshio_the_message_says_how_to_install_it(tmp_path, monkeypatch):
    (tmp_path / "m.vtk").write_text("# vtk DataFile Version 3.0\n")
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(FileError, match=r"pip install 'dynid\[laboratory\]'"):
        read_mesh(tmp_path / "m.vtk")


@pytest.mark.slow
@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("kind", ["tetra", "tetra10", "wedge", "hexahedron", "hexahedron20", "hexahedron27"])
def test_cylinders_that_gmsh_meshes(tmp_path, kind, version):
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        for name, value in {"General.Terminal": 0, "Mesh.MeshSizeMax": 0.5, "Mesh.MshFileVersion": version,
                            "Mesh.RecombineAll": kind.startswith("hex"), "Mesh.RecombinationAlgorithm": 3,
                            "Mesh.SecondOrderIncomplete": kind.endswith("20")}.items():  # fmt: skip
            gmsh.option.setNumber(name, value)
        disk = gmsh.model.occ.addDisk(0, 0, 0, 1, 0.7)
        layers = {} if kind.startswith("tetra") else {"numElements": [2], "recombine": True}
        gmsh.model.occ.extrude([(2, disk)], 0, 0, 0.8, **layers)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="body")
        gmsh.model.addPhysicalGroup(2, [disk], name="base")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(1 if kind in {"tetra", "wedge", "hexahedron"} else 2)
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        gmsh.write(str(tmp_path / "cylinder.msh"))
    finally:
        gmsh.finalize()
    mesh = read_mesh(tmp_path / "cylinder.msh")
    assert {block.kind for block in mesh.blocks} == {kind}
    where = dict(zip(tags.tolist(), xyz.reshape(-1, 3), strict=True))
    np.testing.assert_allclose(mesh.xyz, [where[number] for number in mesh.numbers], atol=1e-12)
    assert np.all(mesh.xyz[mesh.sets["base"], 2] == 0)
    model = solid(mesh, {"body": UNIT})
    volume = np.pi * 0.7 * 0.8
    assert model.M.sum() / 3 == pytest.approx(
        volume, rel=0.02 if mesh.blocks[0].cells.shape[1] <= 8 else 5e-5
    )
    assert np.abs(model.K @ model.nodes.rigid(model.dofs)).max() < 1e-13
