"""Scenes with solids: what they build, where their faults are, and what is said about a mesh."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import dynid as package
from dynid.files.read_mesh import read_mesh
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import load_scene
from dynid.structure.solid import Material, SetSupport, solid
from tests.structure.boxes import box

pytestmark = pytest.mark.usefixtures("untried")

meshio = pytest.importorskip("meshio")

SCENE = """\
dynid: 1
kind: reduction
structure:
  solid:
    mesh: block.vtk
    unit: cm
    materials: {E: 2.0e11, nu: 0.3, rho: 7800}
    supports: [{node: 1, fix: [x, y, z]}, {node: 2, fix: [x, y]}, {node: 45, fix: [y]}]
    damping: {alpha: 0.1}
joints:
  stop: {dofs: ["3:x"], k: 1.0e6}
reduction: [{method: craig-bampton, masters: ["3:x", "4:z"], modes: {count: 3}}]
"""


@pytest.fixture
def block(folder):
    """A folder with the file of a block, 2 cm long."""
    mesh = box("tetra10", (2, 1, 1), (2.0, 1.0, 0.5))
    meshio.write("block.vtk", meshio.Mesh(mesh.xyz, [("tetra10", mesh.blocks[0].cells)]))
    return folder


def structure_of(folder, text):
    (folder / "s.yaml").write_text(text)
    scene = load_scene("s.yaml")
    return build_structure(scene, scene.model.structure, scene.model.joints)


def test_a_scene_builds_what_python_builds(block):
    found = structure_of(block, SCENE)
    made = solid(
        read_mesh(Path("block.vtk"), 0.01),
        Material(2e11, 0.3, 7800.0),
        supports=[SetSupport(1, ("x", "y", "z")), SetSupport(2, ("x", "y")), SetSupport(45, ("y",))],
    )
    assert found.dofs == made.dofs
    assert found.size == 3 * 45 - 6
    np.testing.assert_array_equal(found.K, made.K)
    assert np.ptp(found.nodes.xyz, axis=0) == pytest.approx([0.02, 0.01, 0.005])


def test_unknown_moduli_have_units(block):
    text = SCENE.replace("kind: reduction", "kind: identification").partition("reduction: [")[0]
    text = text.replace("E: 2.0e11", "E: modulus").replace("rho: 7800", "rho: density")
    text += "parameters: {modulus: {start: 1.9e11}, density: {start: 7000}}\nanalysis: {modes: {count: 2}}\n"
    model = structure_of(block, text)
    assert {one.name: one.unit for one in model.parameters} == {"modulus": "Pa", "density": "kg/m^3"}
    assert [term.letter for term in model.terms].count("K") == 1


def test_a_modulus_is_identified_from_measured_frequencies(block):
    supports = [SetSupport(1, ("x", "y", "z")), SetSupport(2, ("x", "y")), SetSupport(45, ("y",))]
    true = solid(read_mesh(Path("block.vtk"), 0.01), Material(2.2e11, 0.3, 7800.0), supports=supports)
    omega = np.sqrt(eigh(true.K, true.M, eigvals_only=True, subset_by_index=[0, 2]))
    values = "".join(f"\n      - {{frequency: {one!r}, frequency_std: 1}}" for one in omega.tolist())
    text = SCENE.replace("kind: reduction", "kind: identification").partition("joints:")[0]
    text = text.replace("E: 2.0e11", "E: modulus").replace("damping: {alpha: 0.1}", "damping: {alpha: 0}")
    text += f"parameters: {{modulus: {{start: 1.5e11}}}}\nmeasurement:\n  modes:\n    values:{values}\n"
    (block / "s.yaml").write_text(text)
    result = package.run("s.yaml")
    assert result["identification/parameters/estimate"].data == pytest.approx([2.2e11], rel=1e-8)
    assert bool(result["identification/diagnostics/converged"].data)


def test_a_run_compares_reductions_of_a_solid(block):
    (block / "s.yaml").write_text(SCENE)
    result = package.run("s.yaml")
    assert result["reduction/craig-bampton/frequency_error"].data.shape[0] >= 3


def test_doubts_about_a_mesh_are_said(dynid, folder):
    mesh = box("tetra", (2, 1, 1), (2.0, 1.0, 0.5))
    meshio.write("block.vtk", meshio.Mesh(mesh.xyz, [("tetra", mesh.blocks[0].cells)]))
    (folder / "s.yaml").write_text(SCENE.replace("node: 45", "node: 12"))
    code, _, err = dynid("run", "s.yaml")
    assert code == 0
    assert "s.yaml: warning: the mesh has 12 linear tetrahedra, which lock" in err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("unit: cm", "unit: kg", "6:11: 'kg' is no unit of length"),
        ("unit: cm", "unit: furlongsss", "6:11: "),
        ("nu: 0.3", "nu: 0.5", "7:32: Poisson's ratio lies between -1 and 0.5, not at 0.5"),
        ("rho: 7800", "rho: -1", "-1 is negative"),
        ("materials: {E: 2.0e11, nu: 0.3, rho: 7800}", "materials: {body: {E: 2.0e11, nu: 0.3, rho: 7800}}",
         "7:17: the mesh has no group of solid elements 'body'; it has none"),
        ("materials: {E: 2.0e11, nu: 0.3, rho: 7800}", "materials: {}", "7:16: "),
        ("node: 1, fix", "node: 900, fix", "8:17: the solid has no node 900"),
        ("node: 1, fix", "set: base, fix", "8:17: the mesh has no set 'base'; it has none"),
        ("node: 1, fix", "set: 12, fix", "the mesh has no set '12'"),
        ("node: 1, fix", "node: 1, set: base, fix", "a support is at a 'set' of nodes of the mesh, or at"),
        ("[y]}]", "[ry]}]", "cannot be 'ry'; it is one of x, y, z"),
        ('["3:x"], k', '["3:rx"], k', "there is no DOF '3:rx'"),
        ('["3:x"], k', '["1:x"], k', "there is no DOF '1:x'"),
    ],
)  # fmt: skip
def test_faults_are_located(dynid, block, old, new, said):
    assert old in SCENE
    (block / "s.yaml").write_text(SCENE.replace(old, new))
    code, _, err = dynid("check", "s.yaml")
    assert code == 2
    assert said in err


def test_a_missing_file_is_located(dynid, block):
    (block / "s.yaml").write_text(SCENE.replace("block.vtk", "none.vtk"))
    code, _, err = dynid("check", "s.yaml")
    assert code == 4
    assert "s.yaml:5:" in err
    assert "none.vtk is no file" in err


def test_poissons_ratio_cannot_be_unknown(dynid, block):
    text = SCENE.replace("kind: reduction", "kind: identification").partition("reduction: [")[0]
    text = text.replace("nu: 0.3", "nu: p") + "parameters: {p: {start: 0.3}}\nanalysis: {modes: {count: 2}}\n"
    (block / "s.yaml").write_text(text)
    code, _, err = dynid("check", "s.yaml")
    assert code == 2
    assert "s.yaml:7:32: this depends on 'p', unknown or known with uncertainty; here a number belongs" in err


def test_an_inverted_element_is_located_at_the_mesh(dynid, folder):
    mesh = box("tetra10", (2, 1, 1), (2.0, 1.0, 0.5))
    cells = mesh.blocks[0].cells.copy()
    cells[5] = cells[5][[1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    meshio.write("block.vtk", meshio.Mesh(mesh.xyz, [("tetra10", cells)]))
    (folder / "s.yaml").write_text(SCENE)
    code, _, err = dynid("check", "s.yaml")
    assert code == 2
    assert "s.yaml:5:5: the tetra10 of nodes" in err
    assert "is inverted" in err


TWO = """\
dynid: 1
kind: identification
structures:
  one:
    solid: {mesh: one.inp, materials: {E: 2.1e11, nu: 0.3, rho: 7800}}
    reduction: {modes: {count: 3}}
  other:
    solid: {mesh: other.inp, materials: {E: 7.0e10, nu: 0.3, rho: 2700}}
points:
  p: {part: one, set: x1, spread: distributed}
  q: {part: other, set: x0, spread: distributed}
joints:
  bush: {points: [p, q], k: {x: 1.0e3, y: 1.0e9, z: 1.0e9, rx: 2, ry: 1.0e9, rz: 1.0e9}}
analysis: {modes: {count: 8}}
"""


def test_two_meshed_parts_on_a_soft_bushing_move_as_rigid_bodies(folder):
    """Along the axis and about it the bushing is soft; the frequencies are those of two rigid bodies."""
    sizes = {"one": (0.2, 0.1, 0.06), "other": (0.3, 0.1, 0.06)}
    for name, (a, b, c) in sizes.items():
        start = 0.0 if name == "one" else 0.2
        mesh = box(
            "tetra10", (2, 1, 1), (a, b, c), lambda xyz, start=start: xyz + np.array([start, -0.05, -0.03])
        )
        sets = {end: mesh.sets[end] for end in ("x0", "x1")}
        meshio.write(
            f"{name}.inp", meshio.Mesh(mesh.xyz, [("tetra10", mesh.blocks[0].cells)], point_sets=sets)
        )
    (folder / "s.yaml").write_text(TWO)
    omega = package.run("s.yaml")["structure/modes/omega"].data
    masses = [7800 * 0.2 * 0.006, 2700 * 0.3 * 0.006]
    turning = [m / 12 * (0.1**2 + 0.06**2) for m in masses]
    exact = sorted([np.sqrt(1e3 * sum(1 / m for m in masses)), np.sqrt(2 * sum(1 / J for J in turning))])
    assert omega[6:] == pytest.approx(exact, rel=1e-5)
    assert np.all(omega[:6] < 1e-2 * omega[6])
