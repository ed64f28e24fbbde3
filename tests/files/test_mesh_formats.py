"""Formats of meshes: gmsh in its forms, input files of FE programs, and files that are not trusted."""

import re
import struct
from pathlib import Path

import h5py
import numpy as np
import pytest

from dynid import trial
from dynid.errors import FileError
from dynid.files.read_mesh import read_mesh
from dynid.structure.matrices import as_array
from dynid.structure.solid import Material, solid
from dynid.trial import survives
from tests.files.mesh_files import ABAQUS, referring
from tests.structure.boxes import box

pytestmark = pytest.mark.usefixtures("untried")

UNIT = Material(1.0, 0.3, 1.0)
KINDS = {"tetra": 4, "hexahedron": 5, "wedge": 6, "triangle": 2, "vertex": 15, "tetra10": 11}


class Gmsh:
    """A mesh as gmsh has it: entities (dimension, tag) with physical groups, and their elements."""

    def __init__(self, xyz, entities, names, numbers=None):
        self.xyz, self.entities, self.names = xyz, entities, names
        self.numbers = np.arange(1, len(xyz) + 1) if numbers is None else numbers

    def header(self, version, binary, order):
        one = struct.pack(f"{order}i", 1) + b"\n" if binary else b""
        names = "".join(f'{d} {tag} "{name}"\n' for (d, tag), name in self.names.items())
        listed = f"$PhysicalNames\n{len(self.names)}\n{names}$EndPhysicalNames\n" if names else ""
        return (
            f"$MeshFormat\n{version} {int(binary)} 8\n".encode() + one + b"$EndMeshFormat\n" + listed.encode()
        )

    def format41(self, binary=False, order="<", entities=True):
        out = Numbers(binary, order)
        if entities:
            counts = [sum(key[0] == d for key in self.entities) for d in range(4)]
            out.section("Entities", "N" * 4, *counts)
            for (dimension, tag), (groups, _, _) in sorted(self.entities.items()):
                box_of = [0.5] * (3 if dimension == 0 else 6)
                out.add("i" + "d" * len(box_of) + "N" + "i" * len(groups), tag, *box_of, len(groups), *groups)
                if dimension:
                    out.add("Nii", 2, 7, -8)
            out.end("Entities")
        half = len(self.xyz) // 2
        out.section("Nodes", "NNNN", 2, len(self.xyz), self.numbers.min(), self.numbers.max())
        for part, dimension in ((slice(half), 2), (slice(half, None), 3)):
            out.add("iiiN", dimension, 1, 0, len(self.numbers[part]))
            for number in self.numbers[part]:
                out.add("N", number)
            for point in self.xyz[part]:
                out.add("ddd", *point)
        out.end("Nodes")
        total = sum(len(cells) for _, _, cells in self.entities.values())
        out.section("Elements", "NNNN", len(self.entities), total, 1, total)
        number = 0
        for (dimension, tag), (_, kind, cells) in self.entities.items():
            out.add("iiiN", dimension, tag, KINDS[kind], len(cells))
            for row in cells:
                number += 1
                out.add("N" * (1 + len(row)), number, *self.numbers[row])
        out.end("Elements")
        return self.header("4.1", binary, order) + out.content

    def format22(self, binary=False, order="<"):
        """Elements of several groups stand once for each, those of none with 0."""
        out = Numbers(binary, order)
        out.section("Nodes", "", counted=len(self.xyz))
        for number, point in zip(self.numbers, self.xyz, strict=True):
            out.add("iddd", number, *point)
        out.end("Nodes")
        rows = [
            (KINDS[kind], group, tag, row)
            for (_, tag), (groups, kind, cells) in self.entities.items()
            for group in (groups or [0])
            for row in cells
        ]
        out.section("Elements", "", counted=len(rows))
        for number, (kind, group, tag, row) in enumerate(rows, 1):
            if binary:
                out.add("iii", kind, 1, 2)
                out.add("iii" + "i" * len(row), number, group, tag, *self.numbers[row])
            else:
                out.add("i" * (5 + len(row)), number, kind, 2, group, tag, *self.numbers[row])
        out.end("Elements")
        return self.header("2.2", binary, order) + out.content


class Numbers:
    def __init__(self, binary, order):
        self.binary, self.order, self.content = binary, order, b""

    def section(self, name, form, *values, counted=None):
        self.content += f"${name}\n".encode()
        if counted is not None:
            self.content += f"{counted}\n".encode()
        if form:
            self.add(form, *values)

    def add(self, form, *values):
        values = [float(v) if kind == "d" else int(v) for kind, v in zip(form, values, strict=True)]
        if self.binary:
            self.content += struct.pack(self.order + form.replace("N", "Q"), *values)
        else:
            self.content += (" ".join(repr(value) for value in values) + "\n").encode()

    def end(self, name):
        self.content += (b"\n" if self.binary else b"") + f"$End{name}\n".encode()


def block(seed=3):
    """A box of tetrahedra in three volumes, of which one has no group and one two; surfaces and a point."""
    mesh = box("tetra", (3, 2, 1), move=lambda xyz: xyz + 0.02 * np.sin(3 * xyz[:, [1, 2, 0]]))
    cells = mesh.blocks[0].cells
    rng = np.random.default_rng(seed)
    numbers = rng.permutation(5 * len(mesh.xyz))[: len(mesh.xyz)] + 3
    one, two, three = np.array_split(cells, [7, 20])
    entities = {
        (3, 1): ([10, 12], "tetra", one),
        (3, 2): ([], "tetra", two),
        (3, 4): ([11], "tetra", three),
        (2, 1): ([], "triangle", cells[:2, :3]),
        (2, 3): ([12], "triangle", cells[5:6, 1:4]),
        (0, 9): ([5], "vertex", np.array([[4]])),
    }
    names = {(3, 10): "steel", (3, 11): "a name", (2, 12): "clamp"}
    return mesh, Gmsh(mesh.xyz, entities, names, numbers)


FORMS = {
    "2.2": lambda made: made.format22(),
    "2.2 binary": lambda made: made.format22(True),
    "2.2 big": lambda made: made.format22(True, ">"),
    "4.1": lambda made: made.format41(),
    "4.1 binary": lambda made: made.format41(True),
    "4.1 big": lambda made: made.format41(True, ">"),
    "4.1 crlf": lambda made: made.format41().replace(b"\n", b"\r\n"),
    "2.2 crlf": lambda made: made.format22().replace(b"\n", b"\r\n"),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", [3, 8])
def test_forms_of_gmsh_hold_the_same_mesh(tmp_path, form, seed):
    mesh, made = block(seed)
    (tmp_path / "m.msh").write_bytes(FORMS[form](made))
    found = read_mesh(tmp_path / "m.msh")
    assert found.numbers == tuple(made.numbers)
    np.testing.assert_array_equal(found.xyz, mesh.xyz)
    (tetra,) = found.blocks
    np.testing.assert_array_equal(tetra.cells, mesh.blocks[0].cells)
    assert {name: parts[0].tolist() for name, parts in found.groups.items()} == {
        "steel": [*range(7)],
        "12": [*range(7)],
        "a name": [*range(20, len(tetra.cells))],
    }
    assert set(found.sets) == {"steel", "12", "a name", "clamp", "5"}
    assert found.sets["clamp"].tolist() == sorted(mesh.blocks[0].cells[5, 1:4].tolist())
    assert found.sets["5"].tolist() == [4]
    assert found.doubts == ()
    one, other = solid(mesh, UNIT), solid(found, UNIT)
    np.testing.assert_allclose(as_array(other.K), as_array(one.K), atol=1e-13)


def test_without_entities_there_are_no_groups(tmp_path):
    _, made = block()
    (tmp_path / "m.msh").write_bytes(made.format41(entities=False))
    found = read_mesh(tmp_path / "m.msh")
    assert found.groups == {}
    assert found.sets == {}


@pytest.mark.parametrize("form", ["2.2", "2.2 binary", "4.1", "4.1 binary"])
def test_a_cut_file_of_gmsh_is_refused(tmp_path, form):
    _, made = block()
    content = FORMS[form](made)
    whole = tmp_path / "m.msh"
    for end in range(0, len(content) - 13, 97):
        whole.write_bytes(content[:end])
        with pytest.raises(FileError) as raised:
            read_mesh(whole)
        assert raised.value.names == ("mesh",)


@pytest.mark.parametrize("form", ["2.2", "4.1"])
@pytest.mark.parametrize("claim", [10**6, 10**10, 2**63 - 1, -5])
def test_counts_that_the_file_cannot_hold_are_refused(tmp_path, form, claim):
    _, made = block()
    lines = FORMS[form](made).split(b"\n")
    for section in (b"$Nodes", b"$Elements", b"$Entities"):
        if section not in lines:
            continue
        changed = list(lines)
        place = changed.index(section) + 1
        words = changed[place].split()
        for at in range(len(words) - 2 if form == "4.1" and section != b"$Entities" else len(words)):
            changed[place] = b" ".join([*words[:at], str(claim).encode(), *words[at + 1 :]])
            if section == b"$Elements" and at == 1:
                continue  # the total, which the blocks have as well
            (tmp_path / "m.msh").write_bytes(b"\n".join(changed))
            with pytest.raises(FileError):
                read_mesh(tmp_path / "m.msh")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda text: text.replace("4.1 0 8", "4 0 8"),
            "has the format 4 of gmsh; 2, 2.0, 2.1, 2.2, 4.1 are read",
        ),
        (
            lambda text: text.replace("$Nodes", "$PartitionedEntities\n0\n$EndPartitionedEntities\n$Nodes"),
            "is partitioned",
        ),
        (lambda text: text.replace("$EndNodes", "x $EndNodes"), "has what is no number"),
        (
            lambda text: re.sub(r"(\$Elements\n.*\n3 1) 4 ", r"\1 77 ", text),
            "elements of type 77 are not known",
        ),
    ],
)
def test_what_of_gmsh_is_not_read_is_said(tmp_path, change, said):
    _, made = block()
    (tmp_path / "m.msh").write_text(change(made.format41().decode()))
    with pytest.raises(FileError, match=re.escape(said)):
        read_mesh(tmp_path / "m.msh")


# Input files


def test_an_input_file_is_read_as_abaqus_reads_it(tmp_path):
    (tmp_path / "m.inp").write_text(ABAQUS)
    found = read_mesh(tmp_path / "m.inp")
    assert found.numbers == (101, 7, 33, 4, 5)
    assert [(each.kind, each.cells.tolist()) for each in found.blocks] == [
        ("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]])
    ]
    assert {name: parts[0].tolist() for name, parts in found.groups.items()} == {
        "Body": [0, 1],
        "both": [0, 1],
        "second": [1],
    }
    sets = {name: [found.numbers[place] for place in places] for name, places in found.sets.items()}
    assert sets == {
        "first": [101, 7],
        "pair": [101, 7, 33],
        "more": [4, 5],
        "all": [101, 7, 4, 5],
        "Body": [101, 7, 33, 4, 5],
        "skin": [7, 33, 5],
        "both": [101, 7, 33, 4, 5],
        "second": [7, 33, 4, 5],
    }


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("2, 7, 33, 4, 5\n", "1, 7, 33, 4, 5\n"), "two elements have the number 1"),
        (
            lambda text: text.replace("2, 7, 33, 4, 5\n", "2, 7, 33, 4\n"),
            "element 2 of type C3D4 has 3 nodes",
        ),
        (
            lambda text: text.replace("2, 7, 33, 4, 5\n", "2, 7, 33, 4, 5, 101\n"),
            "element 2 of type C3D4 has 5 nodes",
        ),
        (lambda text: text.replace("2, 7, 33, 4, 5\n", "2, 7, 33, 4, 99\n"), "an element has the node 99"),
        (lambda text: text.replace("c3d4", "SC6R"), "has elements of the kind SC6R"),
        (lambda text: "*PART, NAME=a\n" + text + "*PART, NAME=b\n", "has several parts"),
        (lambda text: text.replace("c3d4", "C3D5"), "of type C3D5 has"),
    ],
)
def test_what_of_input_files_is_not_read_is_said(tmp_path, change, said):
    (tmp_path / "m.inp").write_text(change(ABAQUS))
    with pytest.raises(FileError, match=re.escape(said)) as raised:
        read_mesh(tmp_path / "m.inp")
    assert raised.value.names == ("mesh",)


@pytest.mark.parametrize("keyword", ["NSET", "ELSET"])
@pytest.mark.parametrize("form", ["itself", "doubling", "generated", "circle"])
def test_sets_are_bounded_in_what_they_make(tmp_path, monkeypatch, keyword, form):
    monkeypatch.setattr("dynid.files.input_file._MOST_MEMBERS", 100_000)
    sets = {
        "itself": ["s\n1\n", "s, s\n"] * 3,
        "circle": ["a\nb\n", "b\na, 1\n", "a\nb\n"],
        "generated": ["s, GENERATE\n1, 99999999999, 1\n"],
        "doubling": ["a0\n1, 2\n", *(f"a{k + 1}\na{k}, a{k}\n" for k in range(60))],
    }[form]
    (tmp_path / "m.inp").write_text(ABAQUS + "".join(f"*{keyword}, {keyword}={text}" for text in sets))
    if form in ("itself", "circle"):
        found = read_mesh(tmp_path / "m.inp")
        assert len(found.sets["s" if form == "itself" else "b"]) in (0, 4)
        return
    with pytest.raises(
        FileError, match=r"its sets have more than 100000 members|it has a set from 1 to 99999999999 by 1"
    ):
        read_mesh(tmp_path / "m.inp")


@pytest.mark.parametrize("kind", ["tetra", "tetra10", "hexahedron", "hexahedron20", "wedge"])
def test_bulk_data_have_the_nodes_of_nastran_in_its_systems(tmp_path, kind):
    mesh = box(kind, (2, 1, 1), move=lambda xyz: xyz + 0.03 * np.sin(2 * xyz[:, [1, 2, 0]]))
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # rows: axes of system 8
    origin = np.array([0.5, -1.0, 2.0])
    ends = [origin, origin + turn[2], origin + turn[0]]
    numbers = [f"{value:.10g}" for point in ends for value in point]
    lines = ["BEGIN BULK", ",".join(["CORD2R", "8", "0", *numbers[:6]]), ",".join(["", *numbers[6:]])]
    for number, point in enumerate(mesh.xyz, 10):
        inside = turn @ (point - origin) if number % 2 else point
        coordinates = ",".join(repr(float(value)) for value in inside)
        lines.append(f"GRID,{number},{8 if number % 2 else ''},{coordinates}")
    order = [*range(12), *range(16, 20), *range(12, 16)] if kind == "hexahedron20" else slice(None)
    card = {"t": "CTETRA", "h": "CHEXA", "w": "CPENTA"}[kind[0]]
    for number, row in enumerate(mesh.blocks[0].cells, 1):
        words = [card, str(number), str(5 + number % 2), *(str(10 + place) for place in row[order])]
        lines += [
            ",".join(["" if k else words[0], *words[1 + k : 9 + k]]) for k in range(0, len(words) - 1, 8)
        ]
    (tmp_path / "m.bdf").write_text("\n".join([*lines, "ENDDATA"]) + "\n")
    found = read_mesh(tmp_path / "m.bdf")
    np.testing.assert_allclose(found.xyz, mesh.xyz, atol=1e-14)
    np.testing.assert_array_equal(found.blocks[0].cells, mesh.blocks[0].cells)
    assert set(found.groups) == {"5", "6"}
    assert found.groups["6"][0].tolist() == [*range(0, len(mesh.blocks[0].cells), 2)]


def test_an_element_with_some_of_its_middle_nodes_is_refused(tmp_path):
    grids = "".join(f"GRID,{k},,{k % 2}.,{k % 3}.,{k % 5}.\n" for k in range(1, 11))
    (tmp_path / "m.bdf").write_text(f"{grids}CTETRA,1,1,1,2,3,4,5,6\n,,8,9,10\n")
    with pytest.raises(FileError, match="CTETRA 1 has 9 nodes"):
        read_mesh(tmp_path / "m.bdf")


# References to other files


@pytest.mark.parametrize("form", ["abaqus", "abaqus nodes", "nastran", "xdmf"])
def test_other_files_are_read_where_the_scene_names_them(tmp_path, form):
    pytest.importorskip("meshio")
    name, other = referring(tmp_path, form)
    with pytest.raises(FileError, match=f"refers to another file, '{other}', which the scene does not name"):
        read_mesh(tmp_path / name)
    with pytest.raises(FileError, match="which the scene does not name"):
        read_mesh(tmp_path / name, 1.0, [tmp_path / "rest.txt"])
    found = read_mesh(tmp_path / name, 1.0, [tmp_path / "parts" / ".." / other])
    assert sum(len(each.cells) for each in found.blocks) == (2 if form == "abaqus" else 1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace('Format="HDF"', 'Format="Binary"'), "as Binary, which is not read"),
        (lambda text: text.replace("/data1", "/data7"), "which has no dataset '/data7'"),
        (lambda text: '<!DOCTYPE x [<!ENTITY a "b">]>' + text, "defines entities of XML"),
        (
            lambda text: text.replace('Format="HDF"', 'Format="XML"').replace('"4 3"', '"400000 30000"'),
            "claims",
        ),
    ],
)
def test_what_xdmf_refers_to_is_checked(tmp_path, change, said):
    name, other = referring(tmp_path, "xdmf")
    (tmp_path / name).write_text(change((tmp_path / name).read_text()))
    with pytest.raises(FileError, match=re.escape(said)):
        read_mesh(tmp_path / name, 1.0, [tmp_path / other])


@pytest.mark.parametrize("link", ["external", "virtual"])
def test_values_of_hdf5_in_other_files_are_refused(tmp_path, link):
    with h5py.File(tmp_path / "other.h5", "w") as store:
        store["x"] = np.arange(12.0)
    with h5py.File(tmp_path / "m.med", "w") as store:
        if link == "external":
            store.create_group("ENS_MAA")["x"] = h5py.ExternalLink("other.h5", "x")
        else:
            layout = h5py.VirtualLayout(shape=(12,), dtype="f8")
            layout[:] = h5py.VirtualSource("other.h5", "x", shape=(12,))
            store.create_virtual_dataset("x", layout)
    with pytest.raises(FileError, match="other file"):
        read_mesh(tmp_path / "m.med")


# Readers that are not trusted


@pytest.mark.parametrize("fate", ["crashes", "never_ends", "takes_memory"])
def test_a_mesh_that_ends_its_reader_is_refused(tmp_path, monkeypatch, fate):
    pytest.importorskip("meshio")
    seconds = 0.01 if fate == "never_ends" else 30
    monkeypatch.setattr(
        trial,
        "survives",
        lambda *_, **__: survives(f"tests.doomed:{fate}", "x", seconds=seconds, memory=2**30),
    )
    (tmp_path / "m.vtk").write_text("# vtk DataFile Version 3.0\n")
    with pytest.raises(FileError, match=r"m\.vtk cannot be read: meshio crashes, or takes over \d+ s or"):
        read_mesh(tmp_path / "m.vtk")


@pytest.mark.parametrize("form", [".vtk", ".vtu", ".mesh"])
def test_a_separate_process_reads_meshes_through_meshio(tmp_path, monkeypatch, form):
    monkeypatch.setattr(trial, "survives", survives)
    meshio = pytest.importorskip("meshio")
    mesh = box("hexahedron", (2, 1, 1))
    cells, xyz = mesh.blocks[0].cells, mesh.xyz
    tags = {"medit:ref": [np.array([4, 7])]} if form == ".mesh" else {}
    meshio.write(tmp_path / f"m{form}", meshio.Mesh(xyz, [("hexahedron", cells)], cell_data=tags))
    found = read_mesh(tmp_path / f"m{form}")
    np.testing.assert_array_equal(found.xyz, xyz)
    np.testing.assert_array_equal(found.blocks[0].cells, cells)
    assert {name: parts[0].tolist() for name, parts in found.groups.items()} == (
        {"4": [0], "7": [1]} if tags else {}
    )


VTK = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"
CLAIMS = {
    "points.vtk": f"{VTK}POINTS 99999999999 double\n0 0 0\n",
    "cells.vtk": f"{VTK}CELLS 1 88888888888\n4 0 1 2 3\n",
    "m.vtu": '<VTKFile type="UnstructuredGrid"><UnstructuredGrid><Piece NumberOfPoints="99999999999999"/>',
    "m.mesh": "MeshVersionFormatted 1\nDimension 3\nVertices\n77777777777\n0 0 0 0\n",
    "m.su2": "NDIME= 3\nNPOIN= 66666666666\n0 0 0 0\n",
    "m.avs": "99999999999 1 0 0 0\n1 0 0 0\n",
}


@pytest.mark.parametrize("name", CLAIMS)
def test_counts_of_other_formats_are_compared_with_the_size(tmp_path, monkeypatch, name):
    monkeypatch.setattr(trial, "survives", None)  # nothing is read
    (tmp_path / name).write_text(CLAIMS[name])
    with pytest.raises(FileError, match=r"claims [\d,]+ points or cells, more than [\d,]+ bytes hold"):
        read_mesh(tmp_path / name)


def test_the_formats_are_listed_where_another_is_named(tmp_path):
    for name in ("m.unv", "m.stl", "m.node", "m"):
        Path(tmp_path / name).write_text("1 2 3\n")
        with pytest.raises(FileError, match="is no file of meshes that is read") as raised:
            read_mesh(tmp_path / name)
        assert {".msh", ".inp", ".bdf", ".vtk", ".med"} <= set(re.findall(r"\.\w+", raised.value.remedy))
