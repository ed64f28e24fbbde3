"""Structures with modes that are known by other means, and modal surveys of them."""

import numpy as np
import scipy.linalg

from dynid.arithmetic.dependent import Dependent
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.parameters import Parameter, ParameterPrior
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import StructuralModel, Term

DOFS = (1, 2, 4, 6)
MASSES = (2.0, 2.0, 1.5, 1.0, 1.0, 0.7)


def chain(factor=0.8, *, damping=False, prior=None):
    """Six masses; two joints and a damper are unknown, started at `factor` times their true values.

    `prior`: its mean over the true value, and its relative deviation.
    """
    c = 60.0 if damping else 0.0
    links = [Link((1,), 2e4, c), Link((1, 2), 3e4, c), Link((4, 5), 2e4, c / 3), Link((5, 6), 1.5e4, 0.0)]

    def unknown(true):
        mean = None if prior is None else ParameterPrior(prior[0] * true, prior[1])
        return JointParameter(start=factor * true, true=true, prior=mean)

    joints = [
        Joint("upper", (2, 3), unknown(2e4), unknown(40.0) if damping else None),
        Joint("lower", (3, 4), unknown(1.2e4)),
    ]
    return lumped(MASSES, links, joints)


def true_modes(model, values=None):
    """Poles with Im > 0 and shapes by the eigenvalues of the first-order system, ascending."""
    values = values or {one.name: one.true for one in model.unknowns}
    M, C, K = (np.asarray(matrix) for matrix in model.with_joints(values, loss=True))
    if not C.any() and not np.iscomplexobj(K):
        square, shapes = scipy.linalg.eigh(K, M)
        return 1j * np.sqrt(square), shapes
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles, vectors = np.linalg.eig(A)
    kept = np.flatnonzero(poles.imag > 0)
    kept = kept[np.argsort(np.abs(poles[kept]))]
    return poles[kept], vectors[:n, kept]


def measured(
    model,
    seed=1,
    noise=1.0,
    modes=(0, 1, 2, 3),
    dofs=DOFS,
    *,
    damping=False,
    complex_shapes=False,
    scatter=(0.002, 0.05, 0.02),
    **options,
):
    """A survey of these modes, with Gaussian scatter (of frequencies, damping, shapes), scaled freely."""
    poles, shapes = true_modes(model)
    rng = np.random.default_rng(seed)
    modes = list(modes)
    poles, shapes = poles[modes], np.array([model.row(dof) for dof in dofs]) @ shapes[:, modes]
    omega, zeta = np.abs(poles), -poles.real / np.abs(poles)
    if not complex_shapes:
        shapes = (shapes * np.exp(-0.5j * np.angle(np.sum(shapes**2, axis=0)))).real  # as real as can be
    shapes = shapes / np.abs(shapes).max(axis=0)
    drawn = rng.standard_normal((3, *shapes.shape))
    spread = drawn[0] + 1j * drawn[1] if complex_shapes else drawn[0]
    spread = spread / np.sqrt(2) if complex_shapes else spread
    shapes = shapes + noise * scatter[2] * spread
    scale = rng.uniform(0.3, 3.0, len(modes)) * rng.choice([-1, 1], len(modes))
    known = omega * (1 + noise * scatter[0] * rng.standard_normal(len(modes)))
    ratio = zeta * (1 + noise * scatter[1] * rng.standard_normal(len(modes)))
    return ModalMeasurement(
        known,
        tuple(dofs),
        shapes * scale,
        ratio if damping else None,
        scatter[0] * omega,
        scatter[1] * np.abs(zeta) if damping else None,
        scatter[2] * np.abs(scale) * np.ones(shapes.shape),
        **options,
    )


def plate(split=1.0, start=1.3):
    """Two directions of motion, each with an unknown stiffness; at `split` 1 all modes are repeated."""
    kx, ky = Dependent.parameter("kx", start * 100.0), Dependent.parameter("ky", start * 100.0 * split)
    x, y = np.zeros((4, 4)), np.zeros((4, 4))
    block = np.array([[2.0, -1.0], [-1.0, 1.0]])
    x[:2, :2], y[2:, 2:] = block, block
    K = float(kx) * x + float(ky) * y
    parameters = [
        Parameter("kx", start * 100.0, true=100.0),
        Parameter("ky", start * 100.0 * split, true=100.0 * split),
    ]
    terms = (Term("K", kx, x), Term("K", ky, y))
    return StructuralModel(np.eye(4), np.zeros((4, 4)), K, parameters=tuple(parameters), terms=terms)
