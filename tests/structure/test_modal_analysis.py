"""Massless DOFs and rigid-body motions, counted and named."""

from pathlib import Path

import numpy as np
import pytest

from dynid.files.read_matrix import MatrixFile
from dynid.files.read_structure import imported
from dynid.structure.assembly import PointMass, Support
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint
from dynid.structure.lumped import Link, lumped
from dynid.structure.modal_analysis import modal_analysis
from dynid.structure.model import StructuralModel
from dynid.structure.solid import Material, solid
from tests.structure.boxes import box, joined_meshes

FE = Path(__file__).parents[3] / "shared" / "data" / "fe"
needs_data = pytest.mark.skipif(not FE.is_dir(), reason="the shared data are not here")


def rigid_names(model, count=None):
    """Return the names of the rigid-body modes."""
    names = modal_analysis(model, count)["structure/modes/name"].data.tolist()
    return tuple(name for name in names if name)


@pytest.mark.parametrize(
    ("supports", "names"),
    [
        ([], ("translation w", "rotation")),
        ([Support(1, ("w",))], ("rotation",)),
        ([Support(1, ("theta",))], ("translation w",)),
        ([Support(3, ("w", "theta"))], ()),
    ],
)
def test_free_beams(supports, names):
    assert rigid_names(beam(5, 2.0, 3.0, 0.7, supports=supports)) == names


def test_a_long_free_beam_is_sparse_and_says_the_same():
    model = beam(300, 2.0, 3.0, 0.7)
    assert (model.size, model.is_sparse) == (602, True)
    assert rigid_names(model, 7) == ("translation w", "rotation")


def test_a_free_frame_and_one_that_swings():
    members = [Member((1, 2), 1e6, 1e2, 1.0, 2), Member((2, 3), 1e6, 1e2, 1.0, 2)]
    corners = [(0.0, 0.0), (0.0, 2.0), (1.5, 2.0)]
    assert rigid_names(frame(corners, members)) == ("translation u", "translation w", "rotation")
    assert rigid_names(frame(corners, members, supports=[Support(1, ("u", "w"))])) == ("rotation",)
    rail = frame(corners, members, supports=[Support(1, ("w", "theta"))])
    assert rigid_names(rail) == ("translation u",)


def test_a_mechanism_is_named_by_what_moves():
    """Three rods in a row, hinged to each other and to ground: nothing holds the middle sideways."""
    rods = [Member((k, k + 1), 1e4, 1.0, 1.0, 1, (1, 2)) for k in (1, 2, 3)]
    ends = [Support(1, ("u", "w")), Support(4, ("u", "w"))]
    model = frame([(0, 0), (1, 0), (2, 0), (3, 0)], rods, supports=ends)
    uniform, other = rigid_names(model)
    assert uniform == "translation w"
    assert sorted(other.removeprefix("mechanism of ").split(", ")) == ["w_2", "w_3"]


def test_free_chains():
    assert rigid_names(lumped([1, 2, 3], [Link((1, 2), 1e3), Link((2, 3), 1e3)])) == ("translation",)
    joint = [Joint("j", (1,), 5.0)]
    assert rigid_names(lumped([1, 2, 3], [Link((1, 2), 1e3), Link((2, 3), 1e3)], joint)) == ()
    apart = rigid_names(lumped([1, 2, 3], [Link((1, 2), 1e3)]))
    assert apart[0] == "translation"
    assert apart[1].startswith("mechanism of ")


def test_massless_dofs_are_named():
    model = beam(2, 1.0, 1.0, 0.0, supports=[Support(1, ("w", "theta"))], masses=[PointMass(3, 1.0)])
    massless = modal_analysis(model)["structure/modes/massless"].data.tolist()
    assert massless == ["w_2", "theta_2", "theta_3"]
    assert rigid_names(model) == ()


def test_modes_as_a_result():
    model = beam(8, 1.0, 1.0, 1.0)
    result = modal_analysis(model, count=4)
    assert result["structure/modes/name"].data.tolist() == ["translation w", "rotation", "", ""]
    assert result["structure/modes/omega"].data[2] == pytest.approx(4.730040744862704**2, rel=1e-4)
    shape = result["structure/modes/shape"].data
    np.testing.assert_allclose(shape.T @ model.M @ shape, np.eye(4), atol=1e-9)
    assert result.value("structure/modes/rigid") == 2


@needs_data
def test_the_abaqus_block_has_three_translations_and_three_rotations():
    model = imported(MatrixFile(FE / "blockC3D8_MASS1.mtx"), MatrixFile(FE / "blockC3D8_STIF1.mtx"))
    result = modal_analysis(model, count=10)
    assert result["structure/modes/name"].data.tolist() == [
        "translation x", "translation y", "translation z", "rotation 1", "rotation 2", "rotation 3",
        "", "", "", "",
    ]  # fmt: skip
    omega = result["structure/modes/omega"].data
    assert np.all(omega[:6] == 0)
    assert np.all(omega[6:] > 0)


@needs_data
def test_the_harwell_boeing_frames_have_massless_rotations():
    model = imported(MatrixFile(FE / "bcsstm01.mtx"), MatrixFile(FE / "bcsstk01.mtx"))
    assert len(modal_analysis(model)["structure/modes/massless"].data) == 24
    assert rigid_names(model) == ()


@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 7, 11, 14])
@pytest.mark.parametrize("parts", [1, 2])
def test_rigid_body_modes_are_those_of_the_structure_however_few_modes_are_requested(count, parts):
    rng = np.random.default_rng(count)
    one = box("tetra", (1, 1, 2), move=lambda xyz: xyz + 0.05 * rng.normal(size=xyz.shape))
    mesh = one if parts == 1 else joined_meshes(one, box("tetra", (1, 2, 1), move=lambda xyz: xyz + 3))
    model = solid(mesh, Material(1.0, 0.3, 1.0))
    result = modal_analysis(model, count)
    assert result.value("structure/modes/rigid") == 6 * parts
    assert len(result["structure/modes/omega"].data) == count
    names = [str(name) for name in result["structure/modes/name"].data]
    assert names[: min(count, 3)] == ["translation x", "translation y", "translation z"][:count]
    if parts == 1:
        assert names[3:] == ["rotation 1", "rotation 2", "rotation 3", *[""] * count][: max(count - 3, 0)]
    assert [bool(name) for name in names] == [k < 6 * parts for k in range(count)]


def test_all_modes_may_be_rigid_body_modes():
    result = modal_analysis(lumped([1, 2, 3], [Link((1, 2), 1e3)]), 1)
    assert result.value("structure/modes/rigid") == 2
    loose = modal_analysis(StructuralModel(np.eye(4), np.zeros((4, 4)), np.zeros((4, 4))), 2)
    assert loose.value("structure/modes/rigid") == 4
