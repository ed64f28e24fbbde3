"""Geometry of tests in Universal Files: positions, axes and lines against closed forms."""

import math
import random

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.table import DataFile
from dynid.files.universal_geometry import read_nodes, read_shapes
from tests.files.universal_files import mode, nodes, system, units, written

XYZ = [(1.0, 2.0, 3.0), (-1.0, 0.5, 0.0), (0.0, 2.0, 1.0)]


def refusal(path):
    with pytest.raises(FileError) as caught:
        read_nodes(path)
    return str(caught.value)


@pytest.mark.parametrize("kind", [15, 2411])
@pytest.mark.parametrize("length", [1.0, 1000.0, 1 / 0.0254])
def test_positions_are_in_metres(tmp_path, kind, length):
    path = written(tmp_path / "x.unv", units(length, 1.0), nodes([7, 20, 3], XYZ, kind=kind))
    found = read_nodes(path).nodes
    assert found.numbers == (7, 20, 3)
    np.testing.assert_allclose(found.xyz, np.array(XYZ) / length, rtol=1e-15)
    assert not found.axes


def test_a_file_without_nodes_has_none(tmp_path):
    with pytest.raises(FileError, match="holds no nodes"):
        read_nodes(written(tmp_path / "x.unv", mode(1.0, [1], [1.0], [0.0], [0.0])))


def test_axes_are_those_of_the_displacement_systems(tmp_path):
    """System 5: turned by 30 degrees about z, its origin moved; its node stands in it at (1, 0, 0)."""
    cosine, sine = math.cos(math.pi / 6), 0.5
    path = written(
        tmp_path / "x.unv",
        system(5, (10.0, 0.0, 1.0), (cosine, sine, 0.0), (0.0, 0.0, 1.0)),
        nodes([1], [(1.0, 0.0, 0.0)], systems=5, defined=5),
        nodes([2], [(1.0, 0.0, 0.0)]),
    )
    found = read_nodes(path).nodes
    np.testing.assert_allclose(found.xyz, [[10 + cosine, sine, 1.0], [1.0, 0.0, 0.0]], atol=2e-5)
    np.testing.assert_allclose(found.axes[1], [[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]], atol=2e-5)
    assert found.axes.keys() == {1}


def test_systems_refer_to_systems(tmp_path):
    """System 1 maps x to y, y to z; system 2, in it, its own x to y: x of system 2 is basic z."""
    path = written(
        tmp_path / "x.unv",
        system(2, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), reference=1),
        system(1, (0.0, 0.0, 5.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
        nodes([1], [(2.0, 0.0, 0.0)], systems=2, defined=2),
    )
    found = read_nodes(path).nodes
    np.testing.assert_allclose(found.axes[1], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(found.xyz, [[0.0, 1.0, 7.0]], atol=1e-12)


def test_cylindrical_axes_are_radial_tangential_axial(tmp_path):
    angle = 2.0
    path = written(
        tmp_path / "x.unv",
        system(3, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), kind=1),
        nodes([1], [(2 * math.cos(angle), 2 * math.sin(angle), 4.0)], systems=3),
    )
    axes = read_nodes(path).nodes.axes[1]
    radial, tangential = (
        (math.cos(angle), math.sin(angle), 0),
        (-math.sin(angle), math.cos(angle), 0),
    )
    np.testing.assert_allclose(axes, [radial, tangential, (0, 0, 1)], atol=1e-5)


def test_systems_of_data_sets_2420(tmp_path):
    rows = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 5.0, 5.0]])
    path = written(
        tmp_path / "x.unv",
        {"type": 2420, "CS_sys_labels": [8], "CS_names": ["A"], "CS_matrices": [rows]},
        nodes([1], [(1.0, 2.0, 3.0)], systems=8, kind=2411),
    )
    np.testing.assert_array_equal(read_nodes(path).nodes.axes[1], rows[:3])
    np.testing.assert_array_equal(read_nodes(path).nodes.xyz, [[1.0, 2.0, 3.0]])


def test_lines_lift_the_pen_at_zero(tmp_path):
    trace = {
        "type": 82,
        "trace_num": 1,
        "n_nodes": 6,
        "color": 1,
        "id": "t",
        "nodes": np.array([1, 2, 0, 2, 3, 9]),
    }
    path = written(tmp_path / "x.unv", nodes([1, 2, 3], XYZ), trace)
    assert read_nodes(path).nodes.lines == ((1, 2), (2, 3))  # there is no node 9


def test_elements_are_outlined(tmp_path):
    same = {"phys_table": 1, "mat_table": 1, "color": 1}
    beam = dict.fromkeys(("beam_orientation", "beam_foreend_cross", "beam_aftend_cross"), 1)
    one = {"element_nums": 1, "fe_descriptor": 11, "num_nodes": 2, "nodes_nums": [3, 1], **same, **beam}
    two = {"element_nums": 2, "fe_descriptor": 91, "num_nodes": 3, "nodes_nums": [1, 2, 3], **same}
    elements = {"type": 2412, 11: [one], 91: [two]}
    path = written(tmp_path / "x.unv", nodes([1, 2, 3], XYZ), elements)
    assert read_nodes(path).nodes.lines == ((3, 1), (1, 2, 3))


def test_elements_that_cannot_be_read_are_not_drawn(tmp_path):
    """Elements of ten nodes take two lines, which pyuff does not read; positions are what matters."""
    path = written(tmp_path / "x.unv", nodes([1, 2, 3], XYZ))
    lines = ["    -1", "  2412", f"{1:10d}{118:10d}{1:10d}{1:10d}{1:10d}{10:10d}"]
    lines += ["".join(f"{k:10d}" for k in range(1, 9)), f"{9:10d}{10:10d}", "    -1", ""]
    path.write_text(path.read_text() + "\n".join(lines))
    assert read_nodes(path).nodes.lines == ()
    assert read_nodes(path).nodes.numbers == (1, 2, 3)


@pytest.mark.parametrize(
    ("data_sets", "said"),
    [
        ([nodes([1, 1], XYZ[:2])], "node 1 has two positions"),
        ([nodes([1], XYZ[:1], systems=7)], "uses the coordinate system 7, which the file does not define"),
        ([units(0.0, 1.0), nodes([1], XYZ[:1])], "(164) has the factors 0, 1"),
        ([units(1.0, 1.0), units(2.0, 1.0), nodes([1], XYZ[:1])], "several records of units"),
        (
            [
                system(3, (0, 0, 0), (1, 0, 0), (0, 0, 1), kind=1),
                nodes([1], [(0, 0, 2)], systems=3),
            ],
            "where no direction is radial",
        ),
        (
            [
                system(3, (0, 0, 0), (1, 0, 0), (0, 0, 1), kind=1),
                nodes([1], [(1, 0, 2)], defined=3),
            ],
            "which is not Cartesian. Export Cartesian positions",
        ),
        ([system(3, (0, 0, 0), (1, 0, 0), (0, 0, 1), kind=2), nodes([1], XYZ[:1], systems=3)], "spherical"),
        ([system(3, (0, 0, 0), (1, 0, 0), (1, 0, 0)), nodes([1], XYZ[:1], systems=3)], "not orthonormal"),
        (
            [system(3, (0, 0, 0), (1, 0, 0), (0, 0, 1), reference=3), nodes([1], XYZ[:1], systems=3)],
            "system 3 refers to system 3, which does not resolve",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path, data_sets, said):
    assert said in refusal(written(tmp_path / "x.unv", *data_sets))


@pytest.mark.parametrize("cut", [0.2, 0.5, 0.9, 0.99])
def test_a_truncated_file_is_refused(tmp_path, cut):
    path = written(tmp_path / "x.unv", units(1.0, 1.0), nodes([7, 20, 3], XYZ))
    text = path.read_text()
    path.write_text(text[: int(cut * len(text))].rstrip("-1 \n"))
    assert "truncated" in refusal(path)


def damaged(whole, seed):
    """Return the text of a file with characters changed, lines lost, or parts repeated."""
    chance, text = random.Random(seed), whole
    for _ in range(chance.choice([1, 2, 8])):
        at, length = chance.randrange(len(text)), chance.choice([1, 10, 81])
        inserted = chance.choice(["", "9", "nan", "-", "\n", "1e400", text[at : at + length]])
        text = text[:at] + inserted + text[at + (length if chance.random() < 0.5 else 0) :]
    return text


@pytest.mark.thorough
def test_damaged_files_are_refused_or_read(tmp_path):
    """No other error, and no warning, leaves the readers."""
    whole = written(
        tmp_path / "x.unv",
        units(1e3, 1.0),
        system(3, (0, 0, 0), (1, 0, 0), (0, 0, 1), kind=1),
        nodes([1, 2, 3], XYZ, systems=3),
        {"type": 82, "trace_num": 1, "n_nodes": 3, "color": 1, "id": "t", "nodes": np.array([1, 2, 3])},
        mode(2.0, [1, 2, 3], [1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.5, 0.5, 1.0]),
    ).read_text()
    refused = 0
    for seed in range(150):
        (tmp_path / "y.unv").write_text(damaged(whole, seed))
        for read in (read_nodes, lambda path: read_shapes(DataFile(path))):
            try:
                read(tmp_path / "y.unv")
            except FileError:
                refused += 1
    assert refused > 50
