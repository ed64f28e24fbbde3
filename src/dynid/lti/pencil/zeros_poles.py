"""Zeros and poles of linear systems given by matrices, exactly or in floating point.

References
----------
A. Emami-Naeini, P. Van Dooren, "Computation of zeros of linear multivariable systems", Automatica 18 (1982)
415-430: the finite zeros are the finite Smith zeros of the system pencil [sE - A, -B; C, D].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from dynid.errors import Singular, Undecided, UsageError
from dynid.lti.certified_roots import CertifiedRoot, certified_roots, repeated
from dynid.lti.stability import SidedRoot, all_left, far, stability, zero_stability

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.lti.pencil.eigenvalues import FiniteEigenvalues
    from dynid.lti.pencil.exact import IntegerPencil, PencilStructure
    from dynid.lti.pencil.rational_matrices import Reading

Engine = Literal["exact", "float"]

#: Relative smallest singular value: below the first where the rank drops, above the second elsewhere.
_RANK_DROP_RTOL, _FULL_RANK_RTOL = 1e-11, 1e-7


class _SystemZerosPoles(NamedTuple):
    """Finite zeros and poles of a system, with error bounds, multiplicities and verdicts.

    Parameters
    ----------
    zeros, poles
        Finite invariant zeros (decoupling zeros included) and finite poles, repeated by multiplicity.
    zero_bounds, pole_bounds
        Bounds on their absolute errors: certified by the exact engine, first-order by the floating-point
        engine.
    zero_roots, pole_roots
        The same with multiplicities and half-planes: exact from the exact engine; from the floating-point
        engine one by one, with the side where the bound decides it.
    normal_rank
        Rank of the transfer matrix at almost every s.
    relative_degree
        Of one input and one output: poles minus zeros, negative where improper, infinite where the input
        does not affect the output; else None.
    infinite_zeros
        Number of zeros at infinity, where the system pencil is square and of full rank; else None.
    gain
        Of one input and one output, from the exact engine: T(s) = gain prod(s - zeros) / prod(s - poles);
        else None.
    engine, reading
        As requested.
    """

    zeros: NDArray[np.complex128]
    poles: NDArray[np.complex128]
    zero_bounds: NDArray[np.float64]
    pole_bounds: NDArray[np.float64]
    zero_roots: tuple[SidedRoot, ...]
    pole_roots: tuple[SidedRoot, ...]
    normal_rank: int
    relative_degree: int | float | None
    infinite_zeros: int | None
    gain: float | None
    engine: Engine
    reading: Reading

    @property
    def stable(self) -> bool | None:
        """True if every finite pole lies in the open left half-plane; None if undecided."""
        return all_left(self.pole_roots)

    @property
    def stability(self) -> str:
        """The stability verdict in words, with the poles that decide it."""
        return stability(self.pole_roots)

    @property
    def minimum_phase(self) -> bool | None:
        """True if every zero lies in the open left half-plane; None if undecided."""
        return False if self.vanishes else all_left(self.zero_roots)

    @property
    def zero_stability(self) -> str:
        """The phase verdict in words, with the zeros that decide it, noting where all of these are far."""
        return zero_stability(self.zero_roots, self.pole_roots, vanishes=self.vanishes)

    @property
    def far_zeros(self) -> NDArray[np.complex128]:
        """The zeros more than 1,000 times beyond the largest pole."""
        return repeated(far(self.zero_roots, self.pole_roots))

    @property
    def vanishes(self) -> bool:
        """True if no input affects any output."""
        return self.normal_rank == 0


def _float_roots(eigenvalues: FiniteEigenvalues) -> tuple[SidedRoot, ...]:
    """Return eigenvalues as roots, sided by their error bounds; those at the origin, exact, are one root."""
    at_origin = (eigenvalues.values == 0) & (eigenvalues.bounds == 0)
    roots = [SidedRoot(0j, int(at_origin.sum()), 0.0, 0)] if at_origin.any() else []
    others = eigenvalues.values[~at_origin].tolist(), eigenvalues.bounds[~at_origin].tolist()
    for z, bound in zip(*others, strict=True):
        roots.append(SidedRoot(z, 1, bound, (z.real > 0) - (z.real < 0) if abs(z.real) > bound else None))
    return tuple(roots)


def zeros_poles(
    A: Any, B: Any, C: Any, D: Any, E: Any = None, engine: Engine = "exact", reading: Reading = "binary"
) -> _SystemZerosPoles:
    """Return finite invariant zeros and poles of E x' = A x + B u, y = C x + D u.

    Parameters
    ----------
    A, B, C, D, E
        (n x n), (n x m), (p x n), (p x m), (n x n) or None for the identity: ints, floats, Fractions or
        text such as '1/3', in nested lists, NumPy arrays or SciPy sparse matrices. D may be 0.
    engine
        'exact': rational arithmetic, certified to the last digit. 'float': double precision; only counts
        and the zeros at the origin are decided exactly.
    reading
        Interpretation of floats: 'binary', the exact value, or 'decimal', the shortest decimal that prints
        as the float (0.1 is 1/10).

    Raises
    ------
    UsageError
        For shapes that do not fit, entries that are not finite numbers, unknown engines or readings.
    Singular
        Where sE - A is singular for every s: the equations do not determine the states.
    Undecided
        Where rounding leaves a result of the floating-point engine undecided.
    """
    from dynid.lti.pencil.rational_matrices import one_of

    one_of("engine", engine, ("exact", "float"))
    system = _GivenSystem.read((A, B, C, D, E), reading)
    if engine == "float":
        if system.state.rank() < system.state.shape[0]:
            raise _singular()
        poles, of_poles = _checked_zeros(system.state)
        zeros, of_zeros = _checked_zeros(system.whole)
        return _SystemZerosPoles(
            zeros=zeros.values,
            poles=poles.values,
            zero_bounds=zeros.bounds,
            pole_bounds=poles.bounds,
            zero_roots=_float_roots(zeros),
            pole_roots=_float_roots(poles),
            gain=None,
            engine="float",
            **system.structure(of_zeros.rank, of_zeros.finite, of_poles.finite),
        )
    from dynid.lti.pencil.exact import determinant
    from dynid.lti.pencil.exact import zeros as zeros_of

    denominator = determinant(system.state.F, system.state.G)
    if denominator == 0:
        raise _singular()
    numerator, rank = zeros_of(system.whole)
    zero_roots, pole_roots = certified_roots(numerator), certified_roots(denominator)
    structure = system.structure(rank, numerator.degree(), denominator.degree())
    gain = None
    if system.siso:
        leads = (Fraction(int(p.leading_coefficient())) for p in (numerator, denominator))
        gain = system.gain(*leads) if structure["normal_rank"] else 0.0
    return _SystemZerosPoles(
        zeros=repeated(zero_roots),
        poles=repeated(pole_roots),
        zero_bounds=_bounds(zero_roots),
        pole_bounds=_bounds(pole_roots),
        zero_roots=zero_roots,
        pole_roots=pole_roots,
        gain=gain,
        engine="exact",
        **structure,
    )


@dataclass(frozen=True)
class _GivenSystem:
    """A system over the rationals: the pencils sE - A and [sE - A, -B; C, D], and the rank of E."""

    state: IntegerPencil
    whole: IntegerPencil
    siso: bool
    rank_E: int
    reading: Reading

    @classmethod
    def read(cls, matrices: tuple[Any, ...], reading: Reading) -> _GivenSystem:
        """Read A, B, C, D, E; the numbers of inputs and outputs are those of D if B and C have none."""
        from dynid.lti.pencil.exact import IntegerPencil
        from dynid.lti.pencil.rational_matrices import exact_rows, shape_of

        states = exact_rows("A", matrices[0], reading)
        n = len(states)
        if any(len(row) != n for row in states):
            raise UsageError(f"A is {n} x {len(states[0])}", remedy="A must be square.")
        of_B, of_C, of_D = (shape_of(*pair) for pair in zip("BCD", matrices[1:4], strict=True))
        inputs, outputs = (of_D[1], of_D[0]) if len(of_D) == 2 else (1, 1)
        inputs = of_B[1] if n and len(of_B) == 2 else inputs
        outputs = of_C[0] if n and len(of_C) == 2 else outputs
        shapes = {"B": (n, inputs), "C": (outputs, n), "D": (outputs, inputs), "E": (n, n)}
        identity = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
        B, C, D, E = (
            identity if matrix is None and name == "E" else exact_rows(name, matrix, reading, shape)
            for (name, shape), matrix in zip(shapes.items(), matrices[1:], strict=True)
        )
        none = [Fraction(0)] * inputs
        dynamic = [row + none for row in E] + [[Fraction(0)] * n + none] * outputs
        static = [a + b for a, b in zip(states, B, strict=True)]
        static += [[-x for x in c + d] for c, d in zip(C, D, strict=True)]
        state = IntegerPencil(E, states, n)
        return cls(
            state,
            IntegerPencil(dynamic, static, n + inputs),
            inputs == outputs == 1,
            int(state.F.rank()),
            reading,
        )

    def structure(self, rank: int, zeros: int, poles: int) -> dict[str, Any]:
        """Return the fields that follow from the normal rank and the numbers of zeros and poles."""
        normal_rank = rank - self.state.shape[0]
        regular = self.whole.shape == (rank, rank)
        return {
            "normal_rank": normal_rank,
            "relative_degree": (poles - zeros if normal_rank else math.inf) if self.siso else None,
            "infinite_zeros": self.rank_E - zeros if regular else None,
            "reading": self.reading,
        }

    def gain(self, lead_of_zeros: Fraction, lead_of_poles: Fraction) -> float:
        """Return the quotient of the leading coefficients, with the scales of the integer pencils removed."""
        return float(lead_of_zeros / lead_of_poles * self.whole.scale / self.state.scale)


def _bounds(roots: tuple[CertifiedRoot, ...]) -> NDArray[np.float64]:
    import numpy as np

    return np.array([root.radius for root in roots for _ in range(root.multiplicity)], dtype=float)


def _singular() -> Singular:
    return Singular(
        "sE - A is singular for every s: the equations do not determine the states",
        remedy="Check E and A: some equation is a combination of the others, or some state is in none.",
    )


def _checked_zeros(pencil: IntegerPencil) -> tuple[FiniteEigenvalues, PencilStructure]:
    """Return the finite zeros of a pencil of any shape in floating point, with error bounds and structure.

    The structure is exact. Where the pencil is not square or not of full rank, the zeros are those
    eigenvalues of a random square compression at which the rank of the whole pencil drops: at a zero of the
    pencil every compression is singular; its other eigenvalues are not zeros.
    """
    import numpy as np
    from scipy.sparse import csr_array

    from dynid.lti.pencil.eigenvalues import (
        EXACT,
        FiniteEigenvalues,
        finite_eigenvalues,
        scaled,
        settle_origin,
    )

    structure = pencil.structure()
    if structure.finite == 0:
        return FiniteEigenvalues(np.zeros(0, complex), np.zeros(0), 0), structure
    F, G = pencil.floats()
    rank = structure.rank
    if pencil.shape == (rank, rank):
        return finite_eigenvalues(F, G, structure.finite, origin=structure.origin), structure
    sparse_F, sparse_G, unit = scaled(csr_array(F), csr_array(G))
    F, G = sparse_F.toarray(), sparse_G.toarray()
    generator = np.random.default_rng(0)
    U = np.linalg.qr(generator.standard_normal((F.shape[0], rank)))[0].T
    V = np.linalg.qr(generator.standard_normal((F.shape[1], rank)))[0]
    eigenvalues = finite_eigenvalues(U @ F @ V, U @ G @ V)
    distance = np.zeros(len(eigenvalues.values))  # from a lower rank, relative to the terms of the pencil
    for k, z in enumerate(eigenvalues.values):
        if smallest := np.linalg.svd(z * F - G, compute_uv=False)[rank - 1]:
            distance[k] = float(smallest / (abs(z) * np.linalg.norm(F) + np.linalg.norm(G)))
    order = np.argsort(distance, kind="stable")
    kept, others = order[: structure.finite], order[structure.finite :]
    clear = (distance[kept] < _RANK_DROP_RTOL).all() and (distance[others] > _FULL_RANK_RTOL).all()
    if len(kept) < structure.finite or not clear:
        raise Undecided(
            f"rounding hides which points are the {structure.finite} zeros of a pencil of rank {rank}",
            remedy=EXACT,
        )
    kept = np.sort(kept)
    values, bounds = eigenvalues.values[kept] * unit, eigenvalues.bounds[kept] * unit
    settle_origin(values, bounds, structure.origin)
    return FiniteEigenvalues(values, bounds, rank - structure.finite), structure
