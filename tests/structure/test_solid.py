"""Solids from meshes: patch tests, closed forms, refinement, scikit-fem, refused meshes."""

from dataclasses import replace
from math import factorial as f

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from dynid.errors import Singular, UsageError
from dynid.structure.damping import ProportionalDamping
from dynid.structure.modes.modes import modes
from dynid.structure.reduction.modal import CraigBampton
from dynid.structure.reduction.mode_selection import ModeRange
from dynid.structure.solid import Material, SetSupport, solid
from dynid.structure.solid_elements import ELEMENTS
from dynid.structure.solid_mesh import Block, SolidMesh, surface
from tests.structure.boxes import box, joined_meshes
from tests.structure.dependent import unknowns

STEEL = Material(2.1e11, 0.3, 7800.0)
UNIT = Material(1.0, 0.3, 1.0)
KINDS = sorted(ELEMENTS)
SECOND = [kind for kind in KINDS if ELEMENTS[kind].order == 2]


def skewed(xyz):
    """A linear map and a shift: elements stay parallel-sided."""
    return xyz @ np.array([[1.0, 0.2, 0.1], [0.0, 0.9, 0.3], [0.1, 0.0, 1.2]]) + [3.0, -2.0, 1.0]


def irregular(xyz):
    """Corners moved by a smooth map; mid-edge nodes too, so that edges are curved."""
    x, y, z = xyz.T
    return xyz + 0.05 * np.stack([np.sin(2 * y + z), np.cos(3 * x) * z, x * y], axis=1)


def straightened(mesh):
    """The mesh with straight edges: nodes between corners where the corners' linear functions put them."""
    (block,) = mesh.blocks
    element = ELEMENTS[block.kind]
    linear = next(
        one for one in ELEMENTS.values() if one.order == 1 and len(one.corners) == len(element.corners)
    )
    xyz = mesh.xyz.copy()
    xyz[block.cells] = linear.shapes(element.nodes) @ mesh.xyz[block.cells[:, : len(element.corners)]]
    return replace(mesh, xyz=xyz)


def beside(distance):
    return lambda xyz: np.add(xyz, [distance, 0.0, 0.0])


def dense(matrix):
    return matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)


@pytest.mark.parametrize("kind", KINDS)
def test_shape_functions_have_their_nodes_and_rules_their_degree(kind):
    element = ELEMENTS[kind]
    np.testing.assert_allclose(element.shapes(element.nodes), np.eye(len(element.nodes)), atol=1e-13)
    h = 1e-30
    point = np.array([[0.31, 0.22, 0.17]])
    exact = [element.shapes(point + 1j * h * np.eye(3)[axis]).imag[0] / h for axis in range(3)]
    np.testing.assert_allclose(element.slopes(point)[0], exact, atol=1e-12)
    assert np.all(element.rule.weights > 0)


def test_the_rule_of_the_tetrahedron_is_exact_to_degree_five():
    points, weights = ELEMENTS["tetra10"].rule
    for a in range(6):
        for b in range(6 - a):
            for c in range(6 - a - b):
                found = weights @ (points[:, 0] ** a * points[:, 1] ** b * points[:, 2] ** c)
                assert found == pytest.approx(f(a) * f(b) * f(c) / f(a + b + c + 3), rel=1e-13)


@pytest.mark.parametrize("move", [skewed, irregular])
@pytest.mark.parametrize("kind", KINDS)
def test_a_free_solid_has_six_rigid_body_modes_and_the_mass_of_its_volume(kind, move):
    model = solid(box(kind, (2, 1, 1), move=move), UNIT)
    motions = model.nodes.rigid(model.dofs)
    K, M = dense(model.K), dense(model.M)
    assert np.abs(K @ motions).max() < 1e-13 * np.abs(K).max() * np.abs(motions).max()
    values = np.linalg.eigvalsh(K)
    assert values[5] < 1e-12 * values[-1] < values[6]
    volume = abs(np.linalg.det(skewed(np.eye(3)) - skewed(np.zeros((1, 3))))) if move is skewed else None
    inertia = motions.T @ M @ motions
    assert inertia[0, 0] == pytest.approx(inertia[1, 1], rel=1e-12)
    if volume is not None:
        assert inertia[:3, :3] == pytest.approx(volume * np.eye(3), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_the_inertia_of_a_block_is_exact_with_elements_of_second_order(kind):
    a, b, c = 1.5, 0.7, 0.4
    model = solid(box(kind, (2, 1, 1), (a, b, c), lambda xyz: xyz - [a / 2, b / 2, c / 2]), UNIT)
    motions = model.nodes.rigid(model.dofs)
    inertia = motions.T @ dense(model.M) @ motions
    m = a * b * c
    exact = np.diag([m, m, m, *(m / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b]))])
    assert inertia == pytest.approx(exact, rel=1e-12, abs=1e-12)  # rotations are linear in position


@pytest.mark.parametrize("move", [skewed, irregular])
@pytest.mark.parametrize("kind", KINDS)
def test_patch_of_constant_strain(kind, move):
    """A linear displacement field strains all elements alike; forces at inner nodes vanish (Irons)."""
    mesh = straightened(box(kind, (2, 2, 2), move=move))
    model = solid(mesh, UNIT)
    field = np.array([[1.0, -0.4, 0.3], [0.2, 0.5, -0.7], [0.1, 0.6, 0.8]])
    u = (mesh.xyz @ field.T).ravel()
    forces = (model.K @ u).reshape(-1, 3)
    on_surface = np.zeros(len(mesh.xyz), dtype=bool)
    for members in mesh.sets.values():
        on_surface[members] = True
    assert np.abs(forces[~on_surface]).max() < 1e-13 * np.abs(dense(model.K)).max()
    strain = (field + field.T) / 2
    nu = UNIT.nu
    energy = (nu / (1 + nu) / (1 - 2 * nu) * np.trace(strain) ** 2 + (strain**2).sum() / (1 + nu)) / 2
    volume = dense(model.M).sum() / 3
    assert u @ (model.K @ u) / 2 == pytest.approx(energy * volume, rel=1e-12)


def test_bar_in_tension_contracts_by_poissons_ratio():
    L, b, c = 2.0, 0.3, 0.2
    for kind in KINDS:
        mesh = box(kind, (3, 1, 1), (L, b, c))
        roller = [SetSupport("x0", ("x",)), SetSupport("y0", ("y",)), SetSupport("z0", ("z",))]
        model = solid(mesh, STEEL, supports=roller)
        u = np.zeros((len(mesh.xyz), 3))
        strain = 1e-3
        u[:] = mesh.xyz * strain * np.array([1.0, -0.3, -0.3])
        kept = [model.dofs.index(f"{n}:{d}") for n in mesh.numbers for d in "xyz" if f"{n}:{d}" in model.dofs]
        motion = np.array([u[int(label.split(":")[0]) - 1, "xyz".index(label[-1])] for label in model.dofs])
        forces = model.K @ motion
        pulled = [model.dofs.index(f"{mesh.numbers[n]}:x") for n in mesh.sets["x1"]]
        assert forces[pulled].sum() == pytest.approx(STEEL.E * strain * b * c, rel=1e-11)
        rest = np.setdiff1d(kept, pulled)
        assert np.abs(forces[rest]).max() < 1e-9 * np.abs(forces).max()


def rollers():
    return [SetSupport(f"{axis}{end}", (axis,)) for axis in "xyz" for end in (0, 1)]


def lowest(model, count):
    from scipy.sparse.linalg import eigsh

    if not model.is_sparse:
        return np.sqrt(eigh(model.K, model.M, eigvals_only=True)[:count])
    return np.sqrt(np.sort(eigsh(model.K, k=count, M=model.M, sigma=0.0, return_eigenvectors=False)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_block_on_rollers_converges_to_its_exact_modes(kind):
    """A block whose faces slide without friction has the modes of an infinite lattice of mirror images.

    u = (A sin kx x cos ky y cos kz z, …) with k = pi n / L: shear waves, omega = c_s |k|, are the lowest.
    """
    exact = np.sqrt(1 / 2 / 1.3) * np.pi * np.sqrt(1 + 1 / 1.1**2)  # k = (1, 1 / 1.1, 0) pi
    order = 2 * ELEMENTS[kind].order
    counts = (4, 8) if order == 2 else (2, 4)
    errors = [
        lowest(solid(box(kind, (n, n, 1), (1.0, 1.1, 0.2)), UNIT, supports=rollers()), 1)[0] / exact - 1
        for n in counts
    ]
    assert all(error > 0 for error in errors)  # a subspace: from above
    assert 0.6 * 2**order < errors[0] / errors[1] < 1.5 * 2**order, errors
    assert errors[1] < (4e-3 if order == 4 else 0.05)


def timoshenko(L, EI, GA, rhoA, rhoI):
    """The lowest natural frequency of a cantilever by Timoshenko's equations, rad/s."""

    def determinant(omega):
        waves = np.roots([EI * GA, 0, omega**2 * (EI * rhoA + GA * rhoI), 0,
                          omega**2 * rhoA * (omega**2 * rhoI - GA)]).astype(complex)  # fmt: skip
        slope = (GA * waves**2 + omega**2 * rhoA) / (GA * waves)  # rotation of a section per deflection
        end = np.exp(waves * L)
        rows = [np.ones(4), slope, slope * waves * end, (waves - slope) * end]
        return (np.linalg.det(np.array(rows)) / np.linalg.det(np.vander(waves))).real

    guess = 1.8751040687119611**2 * np.sqrt(EI / rhoA) / L**2
    return brentq(determinant, 0.9 * guess, guess, xtol=1e-9)


@pytest.mark.parametrize(("kind", "counts"), [("hexahedron20", (8, 1, 1)), ("tetra10", (10, 1, 1))])
def test_a_slender_bar_of_second_order_bends_as_a_timoshenko_beam(kind, counts):
    h, E, rho = 0.1, 2.1e11, 7800.0  # no contraction, which a clamped end would prevent
    model = solid(
        box(kind, counts, (1.0, h, h)), Material(E, 0.0, rho), supports=[SetSupport("x0", ("x", "y", "z"))]
    )
    exact = timoshenko(1.0, E * h**4 / 12, 5 / 6 * E / 2 * h**2, rho * h**2, rho * h**4 / 12)
    assert lowest(model, 2) == pytest.approx([exact, exact], rel=3e-3)


@pytest.mark.parametrize(("kind", "name"), [
    ("tetra", "ElementTetP1"), ("tetra10", "ElementTetP2"),
    ("hexahedron", "ElementHex1"), ("hexahedron27", "ElementHex2"),
])  # fmt: skip
def test_stiffness_and_mass_agree_with_scikit_fem(kind, name):
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = box(kind, (2, 1, 1), move=skewed)
    corners = mesh.blocks[0].cells[:, : len(ELEMENTS[kind].corners)].T
    if kind.startswith("hex"):
        corners = mesh.blocks[0].cells[:, [0, 3, 4, 1, 7, 2, 5, 6]].T
    used, cells = np.unique(corners, return_inverse=True)
    shape = skfem.MeshTet if kind.startswith("tet") else skfem.MeshHex
    other = shape(np.ascontiguousarray(mesh.xyz[used].T), np.ascontiguousarray(cells.reshape(corners.shape)))
    basis = skfem.Basis(other, skfem.ElementVector(getattr(skfem, name)()), intorder=5)
    K = skfem.asm(linear_elasticity(*lame_parameters(UNIT.E, UNIT.nu)), basis)
    M = skfem.asm(skfem.BilinearForm(lambda u, v, _: skfem.helpers.ddot(u[:, None], v[:, None])), basis)
    model = solid(mesh, UNIT)
    place = {tuple(np.round(point, 9)): n for n, point in enumerate(mesh.xyz)}
    rows = np.empty(K.shape[0], dtype=int)
    for dof, point in enumerate(basis.doflocs.T):
        rows[dof] = 3 * place[tuple(np.round(point, 9))]
    for start in np.unique(rows):  # the three DOFs of a location come in the order x, y, z
        rows[rows == start] = start + np.arange(3)
    np.testing.assert_allclose(dense(model.K)[np.ix_(rows, rows)], K.toarray(), atol=1e-13)
    np.testing.assert_allclose(dense(model.M)[np.ix_(rows, rows)], M.toarray(), atol=1e-14)


def test_a_mirrored_mesh_is_the_mirrored_solid():
    one = solid(box("tetra10", (1, 1, 1), move=irregular), UNIT)
    mesh = box("tetra10", (1, 1, 1), move=lambda xyz: irregular(xyz) * [1, -1, 1])
    other = solid(mesh, UNIT)
    flip = np.tile([1.0, -1.0, 1.0], len(mesh.xyz))
    np.testing.assert_allclose(dense(other.K) * np.outer(flip, flip), dense(one.K), rtol=1e-12, atol=1e-14)


def test_moduli_and_densities_may_be_unknown():
    mesh = box("hexahedron20", (2, 1, 1), move=skewed)
    halves = {"left": (np.array([0]),), "right": (np.array([1]),)}
    mesh = replace(mesh, groups=halves)
    p, parameters = unknowns(E=3.0, r=0.7, a=0.1)

    def made(E, r, a, **more):
        materials = {"left": Material(2 * E, 0.25, r), "right": Material(5.0, 0.4, 3 * r)}
        return solid(mesh, materials, supports=[SetSupport("x0", ("x", "y", "z"))],
                     damping=ProportionalDamping(a, 0.2 * r), **more)  # fmt: skip

    model = made(p["E"], p["r"], p["a"], parameters=parameters)
    values = {"E": 2.2, "r": 0.9, "a": 0.3}
    numbers = made(**values)
    for found, letter in zip(model.with_joints(values), "MCK", strict=True):
        np.testing.assert_allclose(dense(found), dense(getattr(numbers, letter)), rtol=0,
                                   atol=1e-14 * np.abs(dense(getattr(numbers, letter))).max())  # fmt: skip
    letters = [term.letter for term in model.terms]
    assert sorted(set(letters)) == ["C", "K", "M"]
    assert letters.count("M") == 1  # multiples of one density are one term
    assert letters.count("K") == 1


def test_nodes_without_a_solid_are_left_out():
    mesh = box("tetra10", (1, 1, 1))
    stray = replace(
        mesh,
        numbers=tuple(range(10, 10 + len(mesh.xyz) + 1)),
        xyz=np.vstack([[9.0, 9, 9], mesh.xyz]),
        blocks=(Block("tetra10", mesh.blocks[0].cells + 1),),
        sets={"stray": np.array([0]), "all": np.arange(len(mesh.xyz) + 1)},
    )
    model = solid(stray, UNIT)
    assert model.nodes.numbers == tuple(range(11, 11 + len(mesh.xyz)))
    assert model.dofs[:3] == ("11:x", "11:y", "11:z")
    assert "stray" not in model.nodes.sets
    assert len(model.nodes.sets["all"]) == len(mesh.xyz)
    np.testing.assert_array_equal(dense(model.K), dense(solid(mesh, UNIT).K))
    with pytest.raises(UsageError, match="no node of the set 'stray' belongs to a solid element"):
        solid(stray, UNIT, supports=[SetSupport("stray", ("x",))])


def test_faces_of_many_nodes_are_told_apart():
    """Of 2^22 nodes, 0 and 2^20 differ by 2^64 in the cube of their number."""
    count = 2**22
    p, q, r, s = range(count - 4, count)
    mesh = SolidMesh(
        range(count),
        np.broadcast_to(np.zeros(3), (count, 3)),
        (Block("tetra", np.array([[0, p, q, r], [2**20, p, q, s], [2**20, p, s, 5]])),),
    )
    first, second, third = surface(mesh).parts
    assert first != second == third


@pytest.mark.parametrize("kind", ["hexahedron20", "wedge", "tetra"])
def test_the_picture_of_a_block_has_the_faces_of_its_surface(kind):
    """Their areas add up to that of the unit cube, and all face outwards."""
    model = solid(box(kind, (2, 2, 2)), UNIT)
    area, volume = 0.0, 0.0
    for face in model.nodes.lines:
        corners = model.nodes.xyz[[model.nodes.places[node] for node in face]]
        normal = np.cross(corners[2] - corners[0], corners[-1] - corners[1]) / 2
        if len(face) == 3:
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0]) / 2
        area += np.linalg.norm(normal)
        volume += normal @ corners.mean(axis=0) / 3
    assert (area, volume) == pytest.approx((6.0, 1.0), rel=1e-12)


def test_doubts():
    assert solid(box("tetra10", (1, 1, 1)), UNIT).nodes.doubts == ()
    (lock,) = solid(box("tetra", (1, 1, 1)), UNIT).nodes.doubts
    assert "6 linear tetrahedra, which lock" in lock
    (bend,) = solid(box("hexahedron", (1, 1, 1)), UNIT).nodes.doubts
    assert "1 linear hexahedra, which are too stiff in bending" in bend
    (volume,) = solid(box("tetra10", (1, 1, 1)), Material(1.0, 0.499, 1.0)).nodes.doubts
    assert "Poisson's ratio is above 0.49" in volume
    two = joined_meshes(box("tetra10", (1, 1, 1)), box("tetra10", (2, 1, 1), move=beside(1.0)))
    (parts,) = solid(two, UNIT).nodes.doubts
    assert "2 parts without a common face (of 12, 6 elements); 9 pairs of nodes lie at one place" in parts


def test_two_parts_have_twelve_rigid_body_modes():
    two = joined_meshes(box("tetra10", (1, 1, 1)), box("tetra10", (1, 1, 1), move=beside(3.0)))
    model = solid(two, {"one": UNIT, "other": Material(2.0, 0.2, 3.0)})
    values = np.linalg.eigvalsh(dense(model.K))
    assert values[11] < 1e-12 * values[-1] < values[12]
    assert "pairs of nodes" not in model.nodes.doubts[0]


def changed(mesh, place, order):
    cells = mesh.blocks[0].cells.copy()
    cells[place] = cells[place][order]
    return replace(mesh, blocks=(Block(mesh.blocks[0].kind, cells),))


TETRA = box("tetra", (1, 1, 1))
HALVES = replace(box("tetra", (2, 1, 1)), groups={"a": (np.arange(6),), "b": (np.arange(3, 12),)})


@pytest.mark.parametrize(
    ("mesh", "materials", "supports", "said"),
    [
        (changed(box("tetra", (2, 1, 1)), 3, [1, 0, 2, 3]), UNIT, [], "the tetra of nodes .* is inverted"),
        (changed(box("hexahedron", (2, 1, 1)), 1, [1, 0, 2, 3, 4, 5, 6, 7]), UNIT, [], "is flat or folded"),
        (box("tetra", (1, 1, 1), move=lambda xyz: xyz * [1, 1, 0]), UNIT, [], "is flat or folded"),
        (replace(TETRA, blocks=TETRA.blocks * 3), UNIT, [], "elements overlap"),
        (joined_meshes(TETRA, box("tetra10", (1, 1, 1))), UNIT, [], "first and second order"),
        (HALVES, {"a": UNIT, "b": UNIT}, [], "the groups 'a' and 'b' have elements in common"),
        (HALVES, {"a": UNIT}, [], "6 of 12 elements have no material"),
        (HALVES, {"c": UNIT}, [], "no group of solid elements 'c'"),
        (HALVES, Material(0.0, 0.3, 1.0), [], "E of the material must be positive"),
        (HALVES, Material(1.0, 0.5, 1.0), [], "nu of the material must lie between -1 and 0.5"),
        (HALVES, Material(1.0, 0.3, -1.0), [], "rho of the material"),
        (HALVES, UNIT, [SetSupport("x2", ("x",))], "no set 'x2'; did you mean"),
        (HALVES, UNIT, [SetSupport(99, ("x",))], "no node 99"),
        (HALVES, UNIT, [SetSupport(f"x{e}", ("x", "y", "z")) for e in (0, 1)]
         + [SetSupport(n, ("x", "y", "z")) for n in range(5, 9)], "the supports leave nothing to move"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(mesh, materials, supports, said):
    with pytest.raises(UsageError, match=said) as raised:
        solid(mesh, materials, supports=supports)
    assert raised.value.names[0].split(".")[0] in {"mesh", "materials", "supports"}


@pytest.fixture(scope="module")
def free_block():
    """A free block of some 1,300 DOFs, sparse."""
    return solid(box("tetra10", (5, 3, 2), (0.5, 0.2, 0.1)), STEEL)


def test_a_free_solid_keeps_its_six_rigid_body_modes_in_sparse_matrices(free_block):
    found = modes(free_block.M, free_block.C, free_block.K, count=9)
    assert found.rigid == 6
    exact = np.sqrt(eigh(dense(free_block.K), dense(free_block.M), eigvals_only=True, subset_by_index=[6, 8]))
    np.testing.assert_allclose(found.omega[6:], exact, rtol=1e-7)


def test_a_free_part_is_reduced_to_its_interface_with_its_rigid_body_modes(free_block):
    """Constraint modes of a free part: the interface holds it; with fewer than six DOFs held it moves."""
    interface = [f"{node}:{along}" for node in free_block.nodes.sets["x0"] for along in "xyz"]
    made = CraigBampton(interface, ModeRange(count=40)).reduce(free_block).model
    rigid = free_block.nodes.rigid(free_block.dofs)
    reduced, *_ = np.linalg.lstsq(made.basis.T, rigid, rcond=None)
    np.testing.assert_allclose(made.basis.T @ reduced, rigid, atol=1e-9)
    found = np.sqrt(np.abs(eigh(made.K, made.M, eigvals_only=True)))
    full = modes(free_block.M, free_block.C, free_block.K, count=9).omega
    assert np.all(found[:6] < 1e-4 * found[6])
    np.testing.assert_allclose(found[6:9], full[6:], rtol=2e-3)
    with pytest.raises(Singular, match="the slaves move freely while the masters are held"):
        CraigBampton(interface[:3], ModeRange(count=3)).reduce(free_block)
