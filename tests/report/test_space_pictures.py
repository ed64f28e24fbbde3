"""Pictures of structures by their nodes: everything is there, points where it acts, moves as it should."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from dynid.report import figures
from dynid.report.drawing.space import Space
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source
from dynid.structure.geometry import geometry
from dynid.structure.solid import Material, solid
from tests.report.test_structure_schematics import assert_texts_apart, text_boxes
from tests.structure.boxes import box
from tests.structure.test_geometry import SCENE

pytestmark = pytest.mark.thorough


def run(text):
    return run_scene(check_source(parse_source(text, "s.yaml")))


@pytest.fixture(scope="module")
def spatial():
    joints = 'joints: {"<hinge>": {dofs: ["2:x", "3:x"], k: 5}, foot: {dofs: ["3:y"], k: 2}}'
    return run(SCENE.replace("REDUCTION", joints))


def drawn(result):
    return {figure.name: figure for figure in figures(result)}


def paths(svg, cls):
    return [
        np.array(
            [[tuple(map(float, p.split())) for p in part.split("L")] for part in one.get("d").split("M")[1:]]
        )
        for one in ET.fromstring(svg).iterfind(f".//{{*}}path[@class='{cls}']")
    ]


def test_everything_attached_is_drawn_with_texts_apart_and_listed(spatial):
    figure = drawn(spatial)["structure"]
    texts = {text for text, *_ in text_boxes(figure.svg)}
    assert {"1", "2", "3", "x", "y", "z", "2:-y", "3:-z.velocity", "<hinge>", "foot"} <= texts
    assert_texts_apart(figure.svg)
    assert figure.caption.startswith("The structure, 3 nodes, with 2 joints, 1 load, 1 sensor.")
    rows = {row[:2]: row[2:] for row in figure.table.rows}
    assert rows["2:-y", "load"] == (0.3, 0.1, 1.1, "0, -1, 0")
    assert rows["3:-z.velocity", "sensor"] == (1.2, -0.2, 1.4, "0, 0, -1")
    assert "node 1: x, y, z held" in figure.svg


def test_arrows_point_as_sensors_and_loads_do(spatial):
    """Up on the paper is up in z; a load on 2:-y ends at its node, a sensor starts there."""
    svg = drawn(spatial)["structure"].svg
    (sensor,) = paths(svg, "bond s3")
    ((start, end),) = sensor
    assert end[0] == pytest.approx(start[0], abs=0.011)
    assert end[1] > start[1] + 10  # -z, downwards
    space = Space(spatial)
    assert not space.is_plane
    way = space.flat(np.array([0, -1.0, 0])) * [1, -1]
    (load,) = paths(svg, "bond s2")
    step = load[0][1] - load[0][0]
    np.testing.assert_allclose(step / np.linalg.norm(step), way / np.linalg.norm(way), atol=2e-3)


def test_views_are_parallel_projections_and_keep_planes():
    result = run(SCENE.replace("REDUCTION", ""))
    view = Space(result).view
    np.testing.assert_allclose(view @ view.T, np.eye(2), atol=1e-15)
    assert view[1] @ [0, 0, 1] > 0.9


PLANE = """\
dynid: 1
kind: identification
structure:
  KIND:
    nodes: [[0, 0ZERO], [0.2, 1.1ZERO], [1.3, 1.4ZERO]]
    members:
      - {nodes: [1, 2], EA: 1.0e5, BENDING, rhoA: 2}
      - {nodes: [2, 3], EA: 1.0e5, BENDING, rhoA: 2}
    supports: SUPPORTS
analysis: {modes: {count: 3}}
"""


def test_a_plane_frame_has_the_same_picture_as_one_in_space_that_stays_in_its_plane():
    """The schematic's own formulas against those of the geometry in the result."""
    plane = {"KIND": "frame", "ZERO": "", "BENDING": "EI: 80", "SUPPORTS": "[{node: 1, fix: [u, w, theta]}]"}
    space = {
        "KIND": "space_frame", "ZERO": ", 0", "BENDING": "EIy: 80, EIz: 80, GJ: 40",
        "SUPPORTS": "[{node: 1, fix: [x, y, z, rx, ry, rz]}, {node: 2, fix: [z, rx, ry]}, "
        "{node: 3, fix: [z, rx, ry]}]",
    }  # fmt: skip
    found = []
    for names in (plane, space):
        text = PLANE
        for old, new in names.items():
            text = text.replace(old, new)
        svg = drawn(run(text))["modes"].svg
        points = [np.concatenate([p.reshape(-1, 2) for p in paths(svg, cls)]) for cls in ("hair", "s1")]
        found.append([part.reshape(3, -1, 2) for part in points])
    (rest, moved), (same, also) = found
    np.testing.assert_allclose(same, rest, atol=0.011)
    one, other = moved - rest, also - same
    for mode in range(3):
        sign = np.sign(np.sum(one[mode] * other[mode]))
        np.testing.assert_allclose(sign * other[mode], one[mode], atol=0.03)


def test_modes_of_reduced_beams_move_all_their_nodes():
    text = """\
dynid: 1
kind: identification
structure: {beam: {elements: 4, length: 4, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w]}]}}
joints: {j: {dofs: [theta_1], k: 5.0e3}}
REDUCTION
analysis: {modes: {count: 2}}
"""
    full, reduced = (
        drawn(run(text.replace("REDUCTION", more)))["modes"].svg
        for more in ("", "reduction: {method: craig-bampton, masters: [w_5], modes: {count: 6}}")
    )
    for one, other in zip(paths(full, "s1"), paths(reduced, "s1"), strict=True):
        mirrored = 2 * one[0][0] - one[0]
        mirrored[:, 0] = one[0][:, 0]
        assert min(np.abs(other[0] - way).max() for way in (one[0], mirrored)) < 1.0


def test_nodes_without_lines_are_drawn(tmp_path):
    (tmp_path / "nodes.csv").write_text("node,x,y,z\n1,0,0,0\n2,1,0,0\n3,1,2,0.5\n")
    (tmp_path / "m.mtx").write_text("1 1 1\n2 2 1\n3 3 1\n")
    (tmp_path / "k.mtx").write_text("1 1 4\n2 2 5\n3 3 6\n")
    text = f"""\
dynid: 1
kind: identification
structure:
  matrices:
    mass: {tmp_path}/m.mtx
    stiffness: {tmp_path}/k.mtx
    nodes: {tmp_path}/nodes.csv
    labels: ["1:x", "2:y", "3:z"]
analysis: {{modes: {{count: 2}}}}
"""
    made = drawn(run(text))
    assert made["structure"].svg.count("<circle") >= 3
    assert "@keyframes" in made["modes-animated"].svg
    assert "held" not in made["structure"].svg


MODES = """
parameters: {EI: {start: 60}}
measurement:
  modes:
    unit: Hz
    values:
      - {frequency: 0.66, shape: {"2:x": 0.3, "2:y": 0.2, "3:y": 1.0, "3:z": 0.3}}
      - {frequency: 0.75, shape: {"2:x": 0.5, "2:y": 0.2, "3:y": -.1, "3:z": -1.0}}
"""


def test_measured_shapes_stand_beside_those_of_the_model():
    text = SCENE.replace("REDUCTION", "").replace("EIy: 80", "EIy: EI")
    text = text[: text.index("analysis")] + MODES
    made = run(text)
    figure = drawn(made)["measured-shapes"]
    assert figure.svg.count("<circle") == 16
    assert "measured 2: 0.75 Hz, MAC" in figure.svg
    shape = made["identification/modes/shape"].data
    assert figure.table.rows[2][:3] == ("3:y", 1.0, shape[2, 0])
    arrows = paths(figure.svg, "s1")
    assert len(arrows) == 8
    # A sensor along z moves upright on the paper, and as the model says.
    step = arrows[3][0][1] - arrows[3][0][0]
    assert step[0] == pytest.approx(0, abs=0.011)
    assert -step[1] == pytest.approx(34 * shape[3, 0] * Space(made).view[1][2], abs=0.02)
    # A reversed sensor, with the other sign in its shape, is the same measurement.
    other = run(text.replace('"2:x": 0', '"2:-x": -0'))
    path = "identification/parameters/estimate"
    np.testing.assert_allclose(other[path].data, made[path].data, rtol=1e-9)
    np.testing.assert_array_equal(other["structure/geometry/shape_sensor_direction"].data[0], [-1, 0, 0])


def test_complex_shapes_are_drawn_in_the_phase_of_the_measured_ones():
    """A factor of any phase in a measured shape turns the drawing of neither shape."""
    text = SCENE.replace("REDUCTION", "").replace("EIy: 80", "EIy: EI")
    head = text[: text.index("analysis")]

    def tables(phases):
        made = MODES
        for line, phase in zip([one for one in MODES.splitlines() if "shape" in one], phases, strict=True):
            turn = complex(np.exp(1j * phase))
            own = re.sub(
                r'": (-?[.\d]+)',
                lambda m, turn=turn: f'": [{float(m[1]) * turn.real}, {float(m[1]) * turn.imag}]',
                line,
            )
            made = made.replace(line, own)
        return [row[1:] for row in drawn(run(head + made))["measured-shapes"].table.rows]

    straight, turned = (np.array(tables(phases)) for phases in ((0.0, 0.0), (1.5, -0.8)))
    np.testing.assert_allclose(turned, straight, atol=1e-6)


def test_a_solid_hides_what_is_behind_it():
    """Of a cube seen from above and aside three faces are drawn, each with a shade of its own."""
    space = Space(geometry(solid(box("hexahedron", (1, 1, 1)), Material(E=1.0, nu=0.3, rho=1.0))))
    surface = space.surface()
    assert len(space.faces) == 6
    assert len({shade for _, shade in surface}) == len(surface) == 3
    middle = space.flat(space.position.mean(axis=0))
    ways = [corners.mean(axis=0) - middle for corners, _ in surface]
    assert any(way[1] > 0.2 for way in ways)  # the top
    assert not len(space.beams)
