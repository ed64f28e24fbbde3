"""Structural damping: matrices, responses, modes, reductions and files against complex matrices of NumPy."""

import re

import h5py
import numpy as np
import pytest
import scipy.linalg
from scipy.io import savemat
from scipy.sparse import csc_array, save_npz

from dynid.arithmetic.dependent import Dependent
from dynid.bondgraph.structure_expansion import expand_structure
from dynid.errors import FileError, UsageError
from dynid.files.read_matrix import MatrixFile
from dynid.files.read_mesh import read_mesh
from dynid.files.read_structure import MatrixPart, imported, model_files
from dynid.lti.signals import Step
from dynid.parameters import Parameter
from dynid.structure.assembly import Spring, Support, assembled_parts
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.modal_analysis import modal_analysis
from dynid.structure.poles import pole_sensitivities
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.methods import METHODS
from dynid.structure.response import frequency_response, time_response
from dynid.structure.solid import Material, SetSupport, solid
from dynid.structure.space_frame import SpaceMember, space_frame
from dynid.structure.state_space import without_massless
from tests.structure.boxes import box, joined_meshes

OMEGA = 2 * np.pi * np.linspace(1.0, 60.0, 30)
MASSES = np.linspace(1.0, 2.0, 12)
JOINTS = {4: (2e4, 0.08), 8: (3e4, 0.03)}
GROUP = "structure/frequency_response/response"


def unknown(true):
    return JointParameter(start=true, true=true)


def chain(**damping):
    """Twelve masses in a row on springs with loss factors, and two joints that are unknown."""
    links, joints = [], []
    for i in range(12):
        dofs = (i + 1,) if i == 0 else (i, i + 1)
        if i in JOINTS:
            k, eta = JOINTS[i]
            joints.append(Joint(f"j{i}", dofs, k=unknown(k), eta=unknown(eta)))
        else:
            links.append(Link(dofs, 5e4, eta=0.002))
    return lumped(list(MASSES), links, joints, **damping)


def complex_chain():
    """Return mass and complex stiffness of `chain`, by other code."""
    K = np.zeros((12, 12), complex)
    for i in range(12):
        b = np.zeros(12)
        b[i] = 1
        if i:
            b[i - 1] = -1
        k, eta = JOINTS.get(i, (5e4, 0.002))
        K += k * (1 + 1j * eta) * np.outer(b, b)
    return np.diag(MASSES), K


def values(model):
    return {item.name: item.start for item in model.unknowns}


def responses(model, dofs=(3, 7, 12), **options):
    outputs = [Channel(dof, "displacement") for dof in dofs]
    result = frequency_response(model, [dofs[0]], outputs, OMEGA, values(model), **options)
    return result[GROUP].data[:, :, 0]


def direct(M, K, force, rows, C=0.0):
    force = force[:, None]
    return np.array([(rows @ np.linalg.solve(K + 1j * w * C - w**2 * M, force))[:, 0] for w in OMEGA])


def test_responses_are_those_of_the_complex_matrices():
    M, K = complex_chain()
    found, wanted = responses(chain()), direct(M, K, np.eye(12)[2], np.eye(12)[[2, 6, 11]])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * abs(wanted).max())
    viscous = chain(damping=ProportionalDamping(0.3, 1e-5, 0.01))  # beside all of it
    C = viscous.dense(values(viscous))[1]
    K = K + 0.01j * viscous.K
    wanted = direct(M, K, np.eye(12)[2], np.eye(12)[[2, 6, 11]], C)
    np.testing.assert_allclose(responses(viscous), wanted, rtol=0, atol=1e-12 * abs(wanted).max())


def test_modal_responses_with_residual_vectors_are_those_of_direct_solutions():
    model = chain().stored_sparse()
    found = responses(model, method="modal")
    np.testing.assert_allclose(found, responses(chain()), rtol=0, atol=1e-8 * abs(found).max())


def test_modes_are_those_of_the_complex_eigenvalue_problem():
    M, K = complex_chain()
    mu, V = scipy.linalg.eig(K, M)
    order = np.argsort(abs(mu))
    mu, V = mu[order], V[:, order]
    for model, count in ((chain(), 12), (chain().stored_sparse(), 4)):
        result = modal_analysis(model, None if count == 12 else count, values=values(model))
        get = {name: result[f"structure/complex_modes/{name}"].data for name in ("pole", "shape", "damping")}
        np.testing.assert_allclose(get["pole"], 1j * np.sqrt(mu[:count]), rtol=1e-11)
        loss = mu.imag[:count] / mu.real[:count]
        found = result["structure/complex_modes/loss_factor"].data
        np.testing.assert_allclose(found, loss, rtol=1e-9)
        np.testing.assert_allclose(get["damping"], np.sin(np.arctan(loss) / 2), rtol=1e-9)
        for k, shape in enumerate(get["shape"].T):  # the same up to a complex factor
            scale = np.vdot(V[:, k], shape) / np.vdot(V[:, k], V[:, k])
            np.testing.assert_allclose(shape, scale * V[:, k], atol=1e-8)
        first_order = result["structure/modes/loss_factor"].data
        np.testing.assert_allclose(first_order, loss, rtol=0.03)  # by the real shapes
        ratio = result["structure/modes/damping"].data
        np.testing.assert_allclose(ratio, np.sin(np.arctan(first_order) / 2), rtol=1e-12)


def test_rigid_body_modes_lose_nothing():
    model = lumped([1.0, 2.0], [Link((1, 2), 100.0, eta=0.1)])
    result = modal_analysis(model)
    np.testing.assert_allclose(result["structure/modes/loss_factor"].data, [0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(result["structure/complex_modes/loss_factor"].data, [0.1], rtol=1e-12)
    only_rigid = modal_analysis(model, 1)
    assert "structure/complex_modes/pole" not in only_rigid


def test_derivatives_of_poles_are_exact():
    model = chain(damping=ProportionalDamping(0.1, 1e-6))
    at = values(model)

    def poles(name, relative):
        return pole_sensitivities(model, at | {name: at[name] * (1 + relative)})

    found = pole_sensitivities(model, at)
    for j, name in enumerate(at):
        table = [(poles(name, h).poles - poles(name, -h).poles) / (2 * h * at[name]) for h in (2e-3, 1e-3)]
        wanted = (4 * table[1] - table[0]) / 3
        size = np.abs(wanted).max()
        by_omega = np.real(found.poles.conj() * wanted) / found.omega
        np.testing.assert_allclose(found.omega_slopes[:, j], by_omega, atol=1e-7 * size)
        by_zeta = (-wanted.real - found.zeta * by_omega) / found.omega
        np.testing.assert_allclose(found.zeta_slopes[:, j], by_zeta, atol=1e-7 * size / found.omega.min())


def stiffened(build):
    """The structural damping is what loss factors add to the stiffness where they stiffen instead."""
    model, softer, stiffer = build(1.0, True), build(1.0, False), build(2.0, False)
    H = np.asarray(model.with_joints(loss=True)[2].imag)
    wanted = np.asarray((stiffer.K - softer.K).toarray() if stiffer.is_sparse else stiffer.K - softer.K)
    H = H.toarray() if hasattr(H, "toarray") else H
    assert np.abs(wanted).max() > 0
    np.testing.assert_allclose(H, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    assert not softer.hysteretic


ETAS = (0.1, 0.02, 0.3)


def _beam(f, lossy):
    stiff = [1e3 * (1 + (f - 1) * eta) for eta in ETAS]
    springs = [Spring(4, "w", 5e3 * (1 + 0.2 * (f - 1)), 0.0, 0.2 * lossy)]
    supports = [Support(1, ("w",))]
    return beam(3, 2.0, stiff, 1.0, supports=supports, springs=springs, eta=ETAS if lossy else 0.0)


def _frame(f, lossy):
    parts = ((1, 2), (2, 3))
    members = [
        Member(nodes, *(number * (1 + (f - 1) * eta) for number in (1e6, 1e3)), 1.0, 2, (), eta * lossy)
        for nodes, eta in zip(parts, ETAS, strict=False)
    ]
    return frame([(0, 0), (1, 0), (1, 2)], members, supports=[Support(1, ("u", "w", "theta"))])


def _space_frame(f, lossy):
    parts = ((1, 2), (2, 3))
    members = [
        SpaceMember(
            nodes,
            *(number * (1 + (f - 1) * eta) for number in (1e6, 1e3, 2e3, 5e2)),
            1.0,
            0.01,
            eta=eta * lossy,
        )
        for nodes, eta in zip(parts, ETAS, strict=False)
    ]
    springs = [Spring(3, "z", 1e3 * (1 + 0.2 * (f - 1)), 0.0, 0.2 * lossy)]
    supports = [Support(1, ("x", "y", "z", "rx", "ry", "rz"))]
    return space_frame([(0, 0, 0), (1, 0, 0), (1, 2, 1)], members, supports=supports, springs=springs)


def _solid(f, lossy):
    one, other = box("hexahedron", (2, 1, 1)), box("tetra", (1, 1, 1), move=lambda xyz: xyz + 3.0)
    materials = {
        name: Material(1e5 * (1 + (f - 1) * eta), 0.3, 10.0, eta * lossy)
        for name, eta in zip(("one", "other"), ETAS, strict=False)
    }
    return solid(joined_meshes(one, other), materials)


@pytest.mark.parametrize("build", [_beam, _frame, _space_frame, _solid], ids=lambda f: f.__name__)
def test_loss_factors_of_elements_are_imaginary_parts_of_their_stiffness(build):
    stiffened(build)


def test_unknown_loss_factors_of_elements_have_exact_derivatives():
    def build(eta, E):
        numbers = {"eta": Dependent.parameter("eta", eta), "E": Dependent.parameter("E", E)}
        mesh = box("hexahedron", (2, 1, 1))
        material = Material(numbers["E"], 0.3, 10.0, numbers["eta"])
        parameters = [Parameter("eta", eta), Parameter("E", E)]
        return solid(mesh, material, supports=[SetSupport("x0", ("x", "y", "z"))], parameters=parameters)

    model = build(0.1, 1e5)
    by_eta, by_E = model.slopes({"eta": 0.2, "E": 2e5})
    one = build(1.0, 1.0)
    np.testing.assert_allclose(by_eta["H"], 2e5 * one.H, rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(by_E["H"], 0.2 * one.H, rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(
        model.with_joints({"eta": 0.2, "E": 2e5}, loss=True)[2].imag, 4e4 * one.H, rtol=1e-10
    )


@pytest.mark.parametrize("method", ["guyan", "craig-bampton", "serep"])
def test_a_complete_reduction_has_the_response_of_the_structure(method):
    full = chain().joined(
        Joint(joint.name, joint.dofs, k=joint.k.start, eta=joint.eta.start) for joint in chain().joints
    )
    options = {
        "guyan": {"masters": list(range(1, 13))},
        "craig-bampton": {"masters": [3, 7, 12], "modes": range(1, 10)},
    }
    options["serep"] = {"masters": list(range(1, 13))}
    reduced = (
        METHODS[method](**{key: tuple(value) for key, value in options[method].items()}).reduce(full).model
    )
    wanted = responses(full)
    np.testing.assert_allclose(responses(reduced), wanted, rtol=0, atol=1e-9 * abs(wanted).max())


def test_a_joint_with_a_block_and_one_between_parts():
    block = [[2e3, -1e3], [-1e3, 3e3]]
    two = lumped([1.0, 1.0], [Link((1,), 1e3)], [Joint("b", (1, 2), k=block, eta=0.1)])
    np.testing.assert_allclose(two.with_joints(loss=True)[2].imag, 0.1 * np.array(block))
    part = lumped([1.0], [Link((1,), 1e3, eta=0.2)])
    plain = lumped([2.0], [Link((1,), 2e3)])
    whole = assembled_parts({"a": part, "b": plain}).joined([Joint("j", ("a.1", "b.1"), k=1e3, eta=0.5)])
    np.testing.assert_allclose(whole.with_joints(loss=True)[2].imag, [[700, -500], [-500, 500]])


# Where it has no meaning


def test_what_needs_a_causal_structure_refuses_it():
    model = chain()
    load, channel = [Load(1, Step(1.0, 0.0))], [Channel(2, "displacement")]
    for call in (
        lambda: time_response(model, load, channel, [0.0, 0.1], values=values(model)),
        lambda: without_massless(model, [1]),
        lambda: expand_structure(None, model, {}, {}, "binary"),
    ):
        with pytest.raises(UsageError, match="is not causal") as raised:
            call()
        assert "equivalent: {at: 40, unit: Hz}" in raised.value.remedy
    with pytest.raises(UsageError, match="no static response"):
        frequency_response(model, [1], channel, [0.0, 1.0], values(model))
    with pytest.raises(UsageError, match="damping ratios of modes stand beside loss factors"):
        chain(damping=ModalDamping(0.01))
    with pytest.raises(UsageError, match="loss factor eta: a number that multiplies its stiffness"):
        Joint("j", (1, 2), c=1.0, eta=0.1)
    with pytest.raises(UsageError, match="eta must be finite and not negative"):
        lumped([1.0], [Link((1,), 1.0, eta=-0.1)])


def test_equivalent_dampers_are_equal_at_their_frequency():
    at = float(OMEGA[7])
    viscous = chain(damping=ProportionalDamping(viscous_at=at))
    assert not viscous.hysteretic
    assert [item.unit for item in viscous.unknowns] == ["N/m", "", "N/m", ""]
    found, wanted = responses(viscous), responses(chain())
    np.testing.assert_allclose(found[7], wanted[7], rtol=1e-10)
    assert np.abs(found[3] / wanted[3] - 1).max() > 1e-3
    result = time_response(
        viscous, [Load(1, Step(1.0, 0.0))], [Channel(2, "displacement")], [0.0, 0.1], values=values(viscous)
    )
    assert np.isfinite(result["structure/time_response/response"].data).all()
    parts = {"a": lumped([1.0], [Link((1,), 1.0)], damping=ProportionalDamping(eta=0.1, viscous_at=1.0))}
    parts["b"] = lumped([1.0], [Link((1,), 1.0)], damping=ProportionalDamping(eta=0.1, viscous_at=2.0))
    with pytest.raises(UsageError, match="equivalent at different frequencies"):
        assembled_parts(parts)
    whole = assembled_parts({"a": parts["a"]}).joined([Joint("j", ("a.1",), k=2.0, eta=0.5)])
    np.testing.assert_allclose(whole.with_joints()[1], [[0.1 + 1.0]])


# Files


def _matrices(n=6, seed=3):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(2, n, n))
    K = A @ A.T + n * np.eye(n)
    return np.diag(rng.uniform(1, 2, n)), K, 0.05 * K + 0.1 * B @ B.T


def _op4(path, stored):
    from pyyeti.nastran import op4

    names = {"M": "MAA", "K": "KAA", "H": "K4AA"}
    op4.write(str(path), {names[name]: matrix for name, matrix in stored.items()}, binary=path.stem != "text")


def _h5(path, stored):
    with h5py.File(path, "w") as store:
        for name, matrix in stored.items():
            store["K4" if name == "H" else name] = matrix


def _h5_of_matlab(path, stored):
    with h5py.File(path, "w") as store:
        for name, matrix in stored.items():
            pairs = np.zeros(matrix.shape, dtype=[("real", "f8"), ("imag", "f8")])
            pairs["real"], pairs["imag"] = matrix.T.real, matrix.T.imag
            store["K4" if name == "H" else name] = pairs if np.iscomplexobj(matrix) else matrix.T
            store["K4" if name == "H" else name].attrs["MATLAB_class"] = np.bytes_("double")


def _mat(path, stored):
    sparse = path.stem == "sparse"
    savemat(
        path, {"K4" if name == "H" else name: csc_array(A) if sparse else A for name, A in stored.items()}
    )


WRITERS = {
    "binary.op4": _op4, "text.op4": _op4, "k.h5": _h5, "matlab.h5": _h5_of_matlab, "k.mat": _mat,
    "sparse.mat": _mat,
}  # fmt: skip


@pytest.mark.parametrize("name", list(WRITERS))
@pytest.mark.usefixtures("untried")
def test_a_complex_stiffness_and_a_matrix_of_its_own_are_one_structural_damping(tmp_path, name):
    M, K, H = _matrices()
    path = tmp_path / name
    WRITERS[name](path, {"M": M, "K": K + 1j * H})
    model = imported(MatrixFile(path), MatrixFile(path))
    for matrix, wanted in ((model.M, M), (model.K, K), (model.H, H)):
        np.testing.assert_allclose(matrix, wanted, atol=1e-9 if name == "text.op4" else 1e-12)
    with pytest.raises(FileError, match="the stiffness is complex: it has structural damping already"):
        imported(MatrixFile(path), MatrixFile(path), structural=[MatrixPart(MatrixFile(path))])
    WRITERS[name](path, {"M": M, "K": K, "H": H})
    files = model_files(path)
    model = imported(files.mass, files.stiffness, structural=[MatrixPart(files.structural[0], 2.0)])
    np.testing.assert_allclose(model.H, 2 * H, atol=1e-9 if name == "text.op4" else 1e-12)


def test_a_stiffness_of_the_other_sign_is_refused(tmp_path):
    M, K, H = _matrices()
    for name, matrix in (("m.npy", M), ("k.npy", K - 1j * H)):
        np.save(tmp_path / name, matrix)
    with pytest.raises(UsageError, match=re.escape("structural damping is negative: entry (1, 1)")):
        imported(MatrixFile(tmp_path / "m.npy"), MatrixFile(tmp_path / "k.npy"))
    save_npz(tmp_path / "k.npz", csc_array(K * (1 + 0.02j)))
    model = imported(MatrixFile(tmp_path / "m.npy"), MatrixFile(tmp_path / "k.npz"))
    np.testing.assert_allclose(model.H, 0.02 * K, atol=1e-12)


DECK = """\
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,1.,1.,0.
GRID,4,,0.,1.,0.
GRID,5,,0.,0.,1.
GRID,6,,1.,0.,1.
GRID,7,,1.,1.,1.
GRID,8,,0.,1.,1.
GRID,9,,0.,0.,2.
GRID,10,,1.,0.,2.
GRID,11,,1.,1.,2.
GRID,12,,0.,1.,2.
CHEXA,1,1,1,2,3,4,5,6
,7,8
CHEXA,2,2,5,6,7,8,9,10
,11,12
"""


def test_a_deck_with_loss_factors_of_materials_is_a_direct_solution(tmp_path):
    """GE of two MAT1 and PARAM G: K (1 + i G) + i sum GE_e K_e (Nastran, Dynamic Analysis)."""
    (tmp_path / "deck.bdf").write_text(DECK)
    mesh = read_mesh(tmp_path / "deck.bdf")
    groups, held = list(mesh.groups), [SetSupport(node, ("x", "y", "z")) for node in (1, 2, 3, 4)]
    E, GE, G = (2e5, 5e4), (0.04, 0.3), 0.01

    def model(E, eta=(0.0, 0.0), G=0.0):
        numbers = zip(groups, E, eta, strict=True)
        materials = {group: Material(number, 0.3, 10.0, loss) for group, number, loss in numbers}
        return solid(mesh, materials, supports=held, damping=ProportionalDamping(eta=G))

    lossy, single = model(E, GE, G), [model((E[0], 1e-9)).K, model((1e-9, E[1])).K]
    K = sum((1 + 1j * (G + loss)) * stiffness for loss, stiffness in zip(GE, single, strict=True))
    wanted = direct(lossy.M, K, np.eye(len(K))[-1], np.eye(len(K)))
    dofs = [*lossy.dofs]
    found = frequency_response(lossy, [dofs[-1]], [Channel(dof, "displacement") for dof in dofs], OMEGA)
    np.testing.assert_allclose(found[GROUP].data[:, :, 0], wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())
