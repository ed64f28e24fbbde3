"""The lowest modes of a structure at values of its parameters, and their exact derivatives.

Natural frequencies are magnitudes of poles, damping ratios minus their cosines. Without damping modes are
real.

Derivatives of modes: with ``Z = lambda^2 M + lambda C + K`` and the modes Psi of a span that contains psi,
``B = (2 lambda M + C) Psi``, the bordered system ``[Z B; B^T 0] [psi'; x] = [-Z' psi; 0]`` is regular where Z
is not: R. B. Nelson, AIAA J. 14 (1976) 1201–1205; I.-W. Lee, G.-H. Jung, *Mech. Mach. Theory* 32 (1997). It
gives the part of psi' outside the span, also of close and multiple modes; the part within is that of another
scale, and of a rotation in the span.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import NumericalError, Singular
from dynid.parameters import Parameter
from dynid.structure.matrices import Matrix, as_array, is_sparse
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import modes
from dynid.structure.poles import EQUAL, STILL, lowest_oscillating, second_order_poles

Vectors = NDArray[Any]
"""Vectors in columns, real without damping."""

# Most steps of Newton's method to a damped mode; the last ones of its pole and its shape, relative.
_MOST_STEPS, _LAST_STEP, _LAST_TURN = 20, 1e-12, 1e-10
# An approximate pole that is corrected by more, relative, would have become another one.
_MAX_POLE_CORRECTION = 1e-3
# Part of the largest inverse eigenvalue below which a motion has no mass.
_MASSLESS_MOTION_TOL = 1e-13
# Least part of the largest entry of its column that a diagonal pivot may be.
_PIVOT = 0.01
# The part of all modes below which bisection for these alone takes less time than all by divide and conquer.
_FEW_MODES = 0.2
# Dense structures up to this size have all their eigenvectors computed: derivatives then cost nothing.
_MOST_WHOLE = 400
# Columns of a basis that are dependent on others to this part are left out.
_DEPENDENT_COLUMN_TOL = 1e-9
# Energy of a change of modes over theirs that bases for frequencies leave out: half of it is the relative
# change of a frequency, for parameters off by their expected change; the basis follows these.
_NEGLIGIBLE_ENERGY = 4e-4


class Inverse(NamedTuple):
    """All eigenpairs of ``M v = mu (K + s M) v``, `mu` descending, with ``v^T (K + s M) v = 1``.

    Eigenvalues ``lambda = 1 / mu - s``; motions without mass have mu = 0.
    """

    mu: Array
    vectors: Array
    shift: float

    def solve(self, square: float, span: Sequence[int], forces: Array) -> Array:
        """Return x without parts in a span of modes, ``(K - square M) x = forces`` outside that span."""
        divisor = 1 - self.mu * (square + self.shift)
        divisor[list(span)] = np.inf
        return np.asarray(self.vectors @ ((self.vectors.T @ forces) / divisor[:, None]))


@dataclass(frozen=True, eq=False)
class ModalSolution:
    """The lowest modes at values of the parameters.

    `model`, `values`: the structure, and the values of its unknown parameters by name; `poles`: poles with a
    positive imaginary part (m), ascending in magnitude, 1/s; `shapes`: mode shapes (n x m), of unit modal
    mass; complex with damping; `matrices`: mass, damping and stiffness with the joints, that of damped modes
    with structural damping; `inverse`: all
    eigenvectors of a dense structure without damping; None of others.
    """

    model: StructuralModel
    values: Mapping[str, float]
    poles: ComplexArray
    shapes: Vectors
    matrices: tuple[Matrix, Matrix, Matrix]
    inverse: Inverse | None = None

    @property
    def omega(self) -> Array:
        """Natural frequencies (m), rad/s."""
        return np.abs(self.poles)

    @property
    def zeta(self) -> Array:
        """Damping ratios (m)."""
        size = np.abs(self.poles)
        return np.asarray(-self.poles.real / np.where(size > 0, size, 1.0))

    @property
    def damped(self) -> bool:
        """True if the modes are those of a damped structure."""
        return np.iscomplexobj(self.shapes)

    def _powers(self, pole: Any) -> dict[str, Any]:
        """Return the factors of mass, damping, stiffness and loss in ``Z`` at a pole, or at several."""
        if not self.damped:
            return {"M": (pole**2).real, "C": 0.0, "K": 1.0, "H": 0.0}
        return {"M": pole**2, "C": pole, "K": 1.0, "H": 1j}

    def _forces(self, pole: complex, shape: Vectors, slopes: Sequence[Mapping[str, Matrix]]) -> Vectors:
        """Return ``-Z' psi`` for each parameter (n x p)."""
        powers = self._powers(pole)
        forces = np.zeros((len(shape), len(slopes)), dtype=self.shapes.dtype)
        for j, changes in enumerate(slopes):
            for letter, change in changes.items():
                if powers[letter] != 0:
                    forces[:, j] -= powers[letter] * np.asarray(change @ shape)
        return forces

    def _border(self, pole: complex, span: Vectors) -> Vectors:
        """Return ``(2 lambda M + C) Psi`` (n x k), without damping ``2 M Psi``."""
        M, C, _ = self.matrices
        B = 2 * np.asarray(M @ span)
        return pole * B + np.asarray(C @ span) if self.damped else B

    @guarded("the derivatives of the modes")
    def pole_slopes(self, pole: Any, shape: Vectors, slopes: Sequence[Mapping[str, Matrix]]) -> ComplexArray:
        """Return the derivatives of a pole by the parameters (p), or of several poles (k x p).

        `pole`, `shape`: the pole and its shape (n), or poles (k) and shapes (n x k); of equal poles shapes of
        their span that stay ones; `slopes`: derivatives of the matrices by each parameter (p), as of
        `StructuralModel.slopes`.
        """
        powers = self._powers(pole)
        work = np.zeros((len(slopes), *np.shape(pole)), dtype=self.shapes.dtype)
        for j, changes in enumerate(slopes):
            for letter, change in changes.items():
                if np.any(powers[letter]):
                    products = np.sum(shape * np.asarray(change @ shape), axis=0)
                    work[j] -= powers[letter] * products
        slopes_of_pole = np.asarray(work / np.sum(shape * self._border(pole, shape), axis=0), dtype=complex)
        if not self.damped:  # of -omega^2 / 2, from which that of the pole j omega follows
            still = np.zeros_like(slopes_of_pole)
            slopes_of_pole = np.divide(slopes_of_pole, pole, out=still, where=np.asarray(pole) != 0)
        return slopes_of_pole.T

    @guarded("the derivatives of the modes")
    def shape_slopes(self, mode: int, span: Sequence[int], slopes: Sequence[Mapping[str, Matrix]]) -> Vectors:
        """Return the derivatives of a shape by the parameters, without their parts in a span (n x p).

        `mode`: the mode, from 0; `span`: the modes at its frequency: itself alone, or also close and equal
        ones; `slopes`: as of `pole_slopes`.
        """
        pole = complex(self.poles[mode])
        forces = self._forces(pole, self.shapes[:, mode], slopes)
        if self.inverse is not None:
            return self.inverse.solve(pole.imag**2, span, forces)
        matrices: tuple[Any, Any, Any] = self.matrices
        M, C, K = matrices
        Z: Any = K + (pole**2 if self.damped else (pole**2).real) * M
        if self.damped:
            Z = Z + pole * C
        return _bordered(Z, self._border(pole, self.shapes[:, list(span)]), forces)


def _bordered(Z: Any, B: Vectors, forces: Vectors) -> Vectors:
    """Return x of ``[Z B; B^T 0] [x; y] = [forces; 0]``."""
    n, k = B.shape
    # Rows and columns are scaled to pivots of one size: translations and rotations differ.
    size = np.sqrt(np.abs(Z.diagonal()))
    size = 1 / np.where(size > 0, size, 1.0)
    B = size[:, None] * B
    B = B / np.linalg.norm(B, axis=0)
    right = np.concatenate([size[:, None] * forces, np.zeros((k, forces.shape[1]))])
    if is_sparse(Z):
        from scipy.sparse import block_array, csc_array, diags_array
        from scipy.sparse.linalg import splu

        scaled, border = diags_array(size) @ csc_array(Z) @ diags_array(size), csc_array(B)
        bordered: Any = block_array([[scaled, border], [border.T, None]], format="csc")
        # The border alone needs pivots: a loose threshold keeps the ordering, and a step of refinement the
        # digits.
        factor = splu(bordered, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=_PIVOT)
        right = right.astype(bordered.dtype)
        solution = factor.solve(right)
        solution = solution + factor.solve(right - bordered @ solution)
    else:
        bordered = np.zeros((n + k, n + k), dtype=np.result_type(Z.dtype, B.dtype))
        bordered[:n, :n] = size[:, None] * as_array(Z) * size
        bordered[:n, n:], bordered[n:, :n] = B, B.T
        solution = np.linalg.solve(bordered, right)
    return np.asarray(size[:, None] * solution[:n])


def has_damping(model: StructuralModel) -> bool:
    """Return True if a structure has damping, known or unknown."""
    C = model.with_known_joints()[1]
    entries = C.data if is_sparse(C) else C
    if np.any(entries) or model.modal or model.hysteretic:
        return True
    return any(term.letter == "C" for term in (*model.terms, *model.joint_terms)) or any(
        unknown.name.endswith(".c") for unknown in model.joint_unknowns
    )


@guarded("the modes of the structure")
def lowest_modes(
    model: StructuralModel,
    values: Mapping[str, float],
    count: int,
    near: float,
    *,
    damped: bool,
    with_shapes: bool = True,
) -> ModalSolution:
    """Return the lowest modes of a structure.

    `model`: the structure, full or reduced; `values`: its unknown parameters by name; `count`: how many
    modes; fewer where there are not so many; `near`: an angular frequency, rad/s, of the size of the lowest
    elastic ones; `damped`: True to take damping into account; `with_shapes`: False where derivatives of
    frequencies are needed alone, for which a dense structure needs no further modes.

    Raises Singular if a motion has neither mass nor stiffness, or the stiffness is indefinite, and
    NumericalError if damped modes of a sparse structure are not found.
    """
    M, C, K = model.with_joints(values)
    matrices = M, C, model.with_joints(values, loss=damped)[2] if model.hysteretic else K
    if is_sparse(M):
        computed = modes(M, C, K, count=min(count, model.size - 1), proof=False)
        along = (1j * computed.omega[:count]).astype(np.complex128)
        undamped = ModalSolution(model, values, along, computed.shapes[:, :count], matrices)
        if not damped:
            return undamped
        if (solution := _damped_sparse(undamped)) is not None:
            return solution
    M, C, K = as_array(M), as_array(C), as_array(K)
    if damped:  # in coordinates of all undamped modes
        dense_modes = modes(M, C, K, backend="dense")
        shapes = dense_modes.shapes
        loss = shapes.T @ as_array(matrices[2]).imag @ shapes if model.hysteretic else None
        poles, U = second_order_poles(dense_modes.omega, shapes.T @ C @ shapes, loss)
        kept = np.flatnonzero(poles.imag > STILL * np.abs(poles))[:count]
        return ModalSolution(model, values, poles[kept], shapes @ U[:, kept], matrices)
    all_modes = with_shapes and len(M) <= _MOST_WHOLE
    square, shapes, inverse = _undamped(M, K, len(M) if all_modes else count, near**2)
    poles = np.asarray(1j * np.sqrt(np.maximum(square[:count], 0.0)), dtype=np.complex128)
    return ModalSolution(model, values, poles, shapes[:, :count], matrices, inverse if all_modes else None)


def _undamped(M: Array, K: Array, count: int, shift: float) -> tuple[Array, Array, Inverse]:
    """Return the lowest eigenvalues, vectors of unit modal mass, and the pencil ``M - mu (K + s M)`` solved.

    Low ones are exact to rounding of their own size; directions without mass have mu = 0.
    """
    from scipy.linalg import LinAlgError, eigh

    n = len(M)
    scale = np.sqrt(np.abs(K.diagonal() + shift * M.diagonal()))
    scale = 1 / np.where(scale > 0, scale, 1.0)
    left, first = scale[:, None] * scale, max(0, n - count)
    few = count < _FEW_MODES * n
    try:
        mu, shapes = eigh(
            M * left,
            (K + shift * M) * left,
            subset_by_index=[first, n - 1] if few else None,
            check_finite=False,
        )
    except LinAlgError:
        raise Singular(
            "the stiffness is indefinite, or a motion has neither mass nor stiffness",
            remedy="Check the values of the parameters: a mode needs positive stiffness.",
        ) from None
    if not few:
        mu, shapes = mu[first:], shapes[:, first:]
    inverse = Inverse(mu[::-1], scale[:, None] * shapes[:, ::-1], shift)
    heavy = inverse.mu > _MASSLESS_MOTION_TOL * inverse.mu[0]
    mu, shapes = inverse.mu[heavy], inverse.vectors[:, heavy]
    return 1 / mu - shift, shapes / np.sqrt(mu), inverse


def _damped_sparse(undamped: ModalSolution) -> ModalSolution | None:
    """Return as many damped modes of a sparse structure, after its rigid-body ones.

    None where they are nearly all of its modes. Approximate modes are corrected by Newton's method.
    """
    rigid = int(np.count_nonzero(undamped.omega == 0))
    count, matrices = len(undamped.poles) - rigid, undamped.matrices
    poles, shapes = undamped.poles, undamped.shapes.astype(complex)
    if count:
        poles_and_shapes = lowest_oscillating(matrices, count, rigid, float(undamped.omega[rigid]))
        if poles_and_shapes is None:
            return None
        poles = np.concatenate([poles[:rigid], poles_and_shapes[0]])
        shapes = np.hstack([shapes[:, :rigid], poles_and_shapes[1]])
    near = [rigid + np.flatnonzero(np.abs(poles[rigid:] - pole) <= EQUAL * abs(pole)) for pole in poles]
    for span in near[rigid:]:
        shapes[:, span] = _realigned(shapes[:, span], matrices[0])
    corrected = [
        _corrected(matrices, complex(poles[r]), shapes[:, r], shapes[:, near[r]])
        for r in range(rigid, len(poles))
    ]
    for r, (pole, shape) in enumerate(corrected, rigid):
        poles[r], shapes[:, r] = pole, shape
    for span in near[rigid:]:
        if np.linalg.cond(shapes[:, span] / np.linalg.norm(shapes[:, span], axis=0)) > 1 / EQUAL:
            raise _lost(float(np.abs(poles[span[0]])))
    order = np.argsort(np.abs(poles), kind="stable")[: rigid + count]
    return replace(undamped, poles=poles[order], shapes=shapes[:, order])


def _realigned(span: Vectors, M: Matrix) -> Vectors:
    """Return real vectors of unit modal mass, orthogonal, that span the same; the given ones if none do."""
    k = span.shape[1]
    U, size, _ = np.linalg.svd(np.hstack([span.real, span.imag]), full_matrices=False)
    if k == 1 or size[k] > EQUAL * size[0]:
        return span
    real = U[:, :k]
    return np.asarray(np.linalg.solve(np.linalg.cholesky(real.T @ np.asarray(M @ real)), real.T).T)


def _corrected(
    matrices: tuple[Any, Any, Any], pole: complex, shape: Vectors, span: Vectors
) -> tuple[complex, Vectors]:
    """Return a damped mode, of unit modal mass, by Newton's method; `span` are those of nearly its pole."""
    M, C, K = matrices
    start, last = pole, np.inf
    for _ in range(_MOST_STEPS):
        Z = pole**2 * M + pole * C + K
        B = 2 * pole * np.asarray(M @ span) + np.asarray(C @ span)
        # Z (psi + d) + B y = 0 with B^T d = 0: the direction of psi + d; then its quotient.
        moved = _bordered(Z, B, -np.asarray(Z @ shape)[:, None])[:, 0]
        shape = shape + moved
        roots = np.roots([complex(shape @ np.asarray(matrix @ shape)) for matrix in matrices])
        new = complex(roots[np.argmin(np.abs(roots - pole))])
        step, turn, pole = abs(new - pole) / abs(new), np.linalg.norm(moved) / np.linalg.norm(shape), new
        size = max(step, float(turn))
        # Where rounding leaves more open, steps end at its size.
        if (step <= _LAST_STEP and turn <= _LAST_TURN) or last / 2 <= size <= EQUAL:
            break
        last = size
    else:
        raise _lost(abs(start))
    if abs(pole - start) > _MAX_POLE_CORRECTION * abs(start):
        raise _lost(abs(start))
    heavy = np.asarray(M @ shape)
    turned = np.exp(-0.5j * np.angle(shape @ heavy))
    return pole, np.asarray(turned * shape / np.sqrt((shape.conj() @ heavy).real))


def _lost(omega: float) -> NumericalError:
    return NumericalError(
        f"the damped mode at {omega / (2 * np.pi):.4g} Hz was not found",
        remedy="Reduce the structure: all modes of small dense ones are computed.",
    )


def modal_basis(
    model: StructuralModel,
    values: Mapping[str, float],
    count: int,
    near: float,
    highest: float,
    *,
    damped: bool,
    with_shapes: bool = True,
) -> StructuralModel:
    """Return a structure in coordinates of its lowest modes and their derivatives.

    Frequencies and shapes of these modes are those of the whole structure at these values; elsewhere the
    errors of frequencies are of fourth order in the change of the parameters.

    `values`, `count`, `near`, `damped`: as of `lowest_modes`; `highest`: highest frequency, rad/s, of a mode
    whose derivatives are exact, too; `with_shapes`: False where undamped frequencies are needed alone. These
    have exact derivatives from the modes; what the modes move by is then kept where it matters to them.
    """
    solution = lowest_modes(model, values, count, near, damped=damped)
    slopes = model.slopes(values)
    columns, below = [solution.shapes], np.flatnonzero(solution.omega <= highest)
    if with_shapes or damped:
        for mode in below.tolist():
            omega = solution.omega[mode]
            near_by = {mode, *np.flatnonzero(np.abs(solution.omega - omega) <= EQUAL * omega).tolist()}
            columns.append(solution.shape_slopes(mode, sorted(near_by), slopes))
    else:
        columns.append(_main_changes(solution, slopes, below.tolist(), near**2))
    columns_of_basis = np.concatenate(columns, axis=1)
    if np.iscomplexobj(columns_of_basis):
        columns_of_basis = np.concatenate([columns_of_basis.real, columns_of_basis.imag], axis=1)
    size = np.linalg.norm(columns_of_basis, axis=0)
    columns_of_basis = columns_of_basis[:, size > 0] / size[size > 0]
    U, s, _ = np.linalg.svd(columns_of_basis, full_matrices=False)
    T = U[:, s > _DEPENDENT_COLUMN_TOL * s[0]]
    return model.projected(T, tuple(f"q{k}" for k in range(1, T.shape[1] + 1)))


def _main_changes(
    solution: ModalSolution, slopes: Sequence[Mapping[str, Matrix]], below: Sequence[int], shift: float
) -> Array:
    """Return the main directions (n x m) in which undamped modes change with the parameters.

    Of the static derivatives ``(K + s M)^-1 Z' psi``, beside which those of modes far above are all that
    lacks, the principal components in energy: a component beyond these changes frequencies of second order.
    """
    from scipy.linalg import eigh
    from scipy.sparse import csc_array, diags_array

    from dynid.structure.backends import factorise  # heavy import, of large models alone

    M, _, K = (csc_array(matrix) for matrix in solution.matrices)
    stiff = K + shift * M
    scale = 1 / np.sqrt(stiff.diagonal())
    factor = factorise(csc_array(diags_array(scale) @ stiff @ diags_array(scale)), definite=True)
    sizes = [_expected_change(unknown, solution.values[unknown.name]) for unknown in solution.model.unknowns]
    changes = [solution.shapes[:, :0]]
    for mode in below:
        forces = solution._forces(complex(solution.poles[mode]), solution.shapes[:, mode], slopes)
        forces *= sizes / np.hypot(solution.omega[mode], np.sqrt(shift))
        changes.append(scale[:, None] * factor.solve(scale[:, None] * forces))
    joint = np.concatenate(changes, axis=1)
    joint -= solution.shapes @ (solution.shapes.T @ (M @ joint))
    energies = joint.T @ (stiff @ joint)
    _, axes = eigh(energies, subset_by_value=[_NEGLIGIBLE_ENERGY, np.inf], check_finite=False)
    return np.asarray(joint @ axes)


def _expected_change(unknown: Parameter, value: float) -> float:
    """Return the deviation of the prior of a parameter, else a fifth of its value."""
    return unknown.prior.absolute if unknown.prior is not None else abs(value) / 5 or 1.0
