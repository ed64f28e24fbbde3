"""Geometry of structures in results: where sensors, loads and joints are, and how nodes move in modes."""

import numpy as np
import pytest

import dynid
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source
from dynid.store.files import write_result
from dynid.structure.geometry import GROUP, MOST_FACES, add_motion, geometry, outer_lines, place_of
from dynid.structure.joints import Joint
from dynid.structure.labels import Nodes
from dynid.structure.model import StructuralModel
from dynid.structure.solid import Material, solid
from tests.structure.boxes import box

pytestmark = pytest.mark.thorough

EPS = np.finfo(float).eps


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])


def model(**more):
    labels = ("7:x", "7:y", "7:rz", "8:x", "8:y", "8:z")
    nodes = Nodes((7, 8, 9), [[1, 2, 0], [4, 6, 5], [0, 0, 0]], axes={7: turned(0.3)}, lines=((7, 8), (8, 9)))
    return StructuralModel(np.eye(6), np.zeros((6, 6)), np.eye(6), dofs=labels, nodes=nodes, **more)


def test_a_dof_is_at_its_node_and_along_its_own_axes():
    place = place_of(model(), "7:-y")
    np.testing.assert_array_equal(place.position, [1, 2, 0])
    np.testing.assert_allclose(place.direction, [np.sin(0.3), -np.cos(0.3), 0], rtol=1e-15)
    assert place_of(model(), "7:rz").turns
    assert not place_of(model(), "8:z").turns


def test_a_motion_is_at_the_mean_of_its_nodes():
    motions = {"p:x": {"7:x": 0.25, "8:x": 0.75}, "nothing": {"8:x": 0.0}}
    place = place_of(model(motions=motions), "p:-x")
    np.testing.assert_allclose(place.position, [3.25, 5, 3.75], rtol=1e-15)
    wanted = -(0.25 * turned(0.3)[0] + 0.75 * np.eye(3)[0])
    np.testing.assert_allclose(place.direction, wanted / np.linalg.norm(wanted), rtol=1e-15)
    assert place_of(model(motions=motions), "nothing") is None


def test_geometry_has_everything_that_is_attached():
    whole = model(joints=(Joint("tie", ("7:x", "8:x"), 3.0), Joint("foot", ("8:z",), 2.0)))
    found = geometry(whole, [("8:-z.acceleration", "8:-z")], ["7:y"])
    assert list(found[f"{GROUP}/node"].data) == ["7", "8", "9"]
    np.testing.assert_array_equal(found[f"{GROUP}/edge"].data, [[0, 1], [1, 2]])
    np.testing.assert_array_equal(found[f"{GROUP}/held"].data, [[0, 0, 1], [0, 0, 0], [1, 1, 1]])
    np.testing.assert_array_equal(found[f"{GROUP}/sensor_direction"].data, [[0, 0, -1]])
    np.testing.assert_array_equal(found[f"{GROUP}/load_position"].data, [[1, 2, 0]])
    ends = found[f"{GROUP}/joint_position"].data
    np.testing.assert_array_equal(ends, [[[1, 2, 0], [4, 6, 5]], [[4, 6, 5], [4, 6, 5]]])
    assert f"{GROUP}/held" not in geometry(whole, supports=False)
    assert found.to_xarray(GROUP)["sensor_direction"].sel(sensor="8:-z.acceleration", xyz="z") == -1
    bare = StructuralModel(np.eye(1), np.zeros((1, 1)), np.eye(1))
    assert not list(geometry(bare))


def test_a_point_moves_as_its_motions_say_and_is_not_held():
    whole = model(motions={"9:x": {"7:x": 0.5, "8:x": 0.5}, "9:y": {"8:y": -1.0}, "9:z": {"8:z": 1.0}})
    found = geometry(whole)
    assert not found[f"{GROUP}/held"].data[2].any()
    shapes = np.random.default_rng(4).normal(size=(6, 2))
    found.add("structure/modes/shape", shapes, ("dof", "mode"))
    add_motion(found, whole)
    x7, _, _, x8, y8, z8 = shapes
    np.testing.assert_allclose(
        found[f"{GROUP}/displacement"].data[:, 2].T, [(x7 + x8) / 2, -y8, z8], rtol=1e-14
    )


def test_of_many_lines_the_outer_ones_stay():
    """Of a grid of 5 x 5 nodes the border: its nodes have two or three neighbours, the others four."""
    across = [(5 * row + k, 5 * row + k + 1) for row in range(5) for k in range(4)]
    up = [(5 * row + k, 5 * row + k + 5) for row in range(4) for k in range(5)]
    lines = np.array(across + up)
    border = {(a, b) for a, b in lines.tolist() if all(n < 5 or n >= 20 or n % 5 in (0, 4) for n in (a, b))}
    border -= {(a, b) for a, b in border if abs(a - b) not in (1, 5)}
    kept = outer_lines(lines, len(border))
    assert {tuple(one) for one in kept.tolist()} == border
    np.testing.assert_array_equal(outer_lines(lines, 40), lines)


SCENE = """\
dynid: 1
kind: identification
structure:
  space_frame:
    nodes: [[0, 0, 0], [0.3, 0.1, 1.1], [1.2, -0.2, 1.4]]
    members:
      - {nodes: [1, 2], EA: 1.0e5, EIy: 80, EIz: 50, GJ: 30, rhoA: 2}
      - {nodes: [2, 3], EA: 1.0e5, EIy: 80, EIz: 50, GJ: 30, rhoA: 2}
    supports: [{node: 1, fix: [x, y, z, rx, ry, rz]}]
REDUCTION
analysis:
  modes: {count: 4}
  inputs: ["2:-y"]
  outputs: [{dof: "3:-z", quantity: velocity}]
  frequency: {start: 1, stop: 2, points: 2}
"""


def run(reduction=""):
    return run_scene(check_source(parse_source(SCENE.replace("REDUCTION", reduction), "s.yaml")))


def test_nodes_move_as_the_shapes_say_in_full_and_reduced_models():
    full = run()
    labels = list(full["structure/modes/dof"].data)
    shape = full["structure/modes/shape"].data
    for name, ways in (("displacement", ("x", "y", "z")), ("rotation", ("rx", "ry", "rz"))):
        moved = full[f"{GROUP}/{name}"].data
        assert moved.shape == (4, 3, 3)
        assert not moved[:, 0].any()
        for node, axis in np.ndindex(2, 3):
            row = labels.index(f"{node + 2}:{ways[axis]}")
            np.testing.assert_array_equal(moved[:, node + 1, axis], shape[row])
    reduced = run("reduction: {method: modal, modes: {count: 4}}")
    for name in ("displacement", "rotation"):
        one, other = reduced[f"{GROUP}/{name}"].data, full[f"{GROUP}/{name}"].data
        signs = np.sign(np.sum(one * other, axis=(1, 2)))[:, None, None]
        np.testing.assert_allclose(one, signs * other, rtol=1e-7, atol=1e-9 * np.abs(other).max())
    assert list(full[f"{GROUP}/load"].data) == ["2:-y"]
    assert list(full[f"{GROUP}/sensor"].data) == ["3:-z.velocity"]
    np.testing.assert_array_equal(full[f"{GROUP}/load_direction"].data, [[0, -1, 0]])


def test_a_result_file_keeps_the_geometry(tmp_path):
    made = run()
    write_result(made, tmp_path / "r.h5")
    read = dynid.open_result(tmp_path / "r.h5")
    for path in made:
        if path.startswith(GROUP):
            np.testing.assert_array_equal(read[path].data, made[path].data)
    assert set(read.to_xarray(GROUP).coords) >= {"node", "xyz", "mode", "sensor", "load"}


def test_a_surface_of_many_faces_is_drawn_coarser():
    """What remains of a closed box with 4,800 faces has its corners, is closed, and encloses the volume."""
    model = solid(box("hexahedron", (20, 20, 50)), Material(E=1.0, nu=0.3, rho=1.0))
    found = geometry(model)
    faces, xyz = found[f"{GROUP}/face"].data, found[f"{GROUP}/position"].data
    assert 1000 < len(faces) <= MOST_FACES < len(model.nodes.lines) == 2 * (400 + 1000 + 1000)
    assert found.group_attrs[GROUP]["lines"] == 2 * len(model.nodes.lines)
    np.testing.assert_array_equal([xyz[faces].min((0, 1)), xyz[faces].max((0, 1))], [[0] * 3, [1] * 3])
    corners = xyz[faces]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
    np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-12)
    assert np.sum(normals * corners.mean(axis=1)) / 3 == pytest.approx(1, abs=0.02)
