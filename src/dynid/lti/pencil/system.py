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

from dynid.errors import Singular, UsageError
from dynid.lti.certified import Root, certified_roots, repeated
from dynid.lti.verdicts import Root as Sided
from dynid.lti.verdicts import all_left, far, stability, zero_stability

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.lti.pencil.eigenvalues import FiniteEigenvalues
    from dynid.lti.pencil.integer import IntegerPencil
    from dynid.lti.pencil.reading import Reading

Engine = Literal["exact", "float"]


class SystemZerosPoles(NamedTuple):
    """Finite zeros and poles of a system, and how they are known.

    Parameters
    ----------
    zeros, poles
        Finite invariant zeros (decoupling zeros included) and finite poles, repeated by multiplicity.
    zero_bounds, pole_bounds
        Bounds on their absolute errors: certified by the exact engine, first-order by the float engine.
    zero_roots, pole_roots
        The same with multiplicities and half-planes: exact from the exact engine; from the float engine one
        by one, on the side that the bound leaves no doubt of.
    normal_rank
        Rank of the transfer matrix at almost every s.
    relative_degree
        Of one input and one output: poles minus zeros, negative where improper, infinite where the input
        does not reach the output; else None.
    infinite_zeros
        How many zeros lie at infinity, where the system pencil is square and of full rank; else None.
    gain
        Of one input and one output, from the exact engine: T(s) = gain prod(s - zeros) / prod(s - poles);
        else None.
    engine, reading
        What was asked for.
    """

    zeros: NDArray[np.complex128]
    poles: NDArray[np.complex128]
    zero_bounds: NDArray[np.float64]
    pole_bounds: NDArray[np.float64]
    zero_roots: tuple[Sided, ...]
    pole_roots: tuple[Sided, ...]
    normal_rank: int
    relative_degree: int | float | None
    infinite_zeros: int | None
    gain: float | None
    engine: Engine
    reading: Reading

    @property
    def stable(self) -> bool | None:
        """Whether every finite pole lies in the open left half-plane; None where that is undecided."""
        return all_left(self.pole_roots)

    @property
    def stability(self) -> str:
        """The stability verdict in words, with the poles that decide it."""
        return stability(self.pole_roots)

    @property
    def minimum_phase(self) -> bool | None:
        """Whether every zero lies in the open left half-plane; None where that is undecided."""
        return False if self.vanishes else all_left(self.zero_roots)

    @property
    def zero_stability(self) -> str:
        """The phase verdict in words, with the zeros that decide it, and whether those are far."""
        return zero_stability(self.zero_roots, self.pole_roots, vanishes=self.vanishes)

    @property
    def far_zeros(self) -> NDArray[np.complex128]:
        """The zeros more than 1,000 times beyond the largest pole."""
        return repeated(far(self.zero_roots, self.pole_roots))

    @property
    def vanishes(self) -> bool:
        """Whether no input reaches any output."""
        return self.normal_rank == 0


@dataclass(frozen=True)
class FloatRoot:
    """A root in floating point.

    Parameters
    ----------
    value, radius
        The root, and a first-order bound on its error.
    side
        -1 in the open left half-plane, +1 in the open right half-plane, 0 on the imaginary axis (at the
        origin, which is exact); None where the bound leaves that open.
    multiplicity
        Exact at the origin; elsewhere 1, and roots that cannot be told apart stand side by side.
    """

    value: complex
    radius: float
    side: int | None
    multiplicity: int = 1

    @classmethod
    def all_of(cls, found: FiniteEigenvalues) -> tuple[FloatRoot, ...]:
        """Tell sides from the error bounds; what is known to be 0 is one root."""
        at_origin = (found.values == 0) & (found.bounds == 0)
        origin = [cls(0j, 0.0, 0, int(at_origin.sum()))] if at_origin.any() else []
        others = zip(found.values[~at_origin].tolist(), found.bounds[~at_origin].tolist(), strict=True)
        sides = (
            (z, bound, (z.real > 0) - (z.real < 0) if abs(z.real) > bound else None) for z, bound in others
        )
        return (*origin, *(cls(*each) for each in sides))


def zeros_poles(
    A: Any, B: Any, C: Any, D: Any, E: Any = None, engine: Engine = "exact", reading: Reading = "binary"
) -> SystemZerosPoles:
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
        What a float means: 'binary', its value to the last bit, or 'decimal', the shortest decimal that
        prints it (0.1 is 1/10).

    Raises
    ------
    UsageError
        For shapes that do not fit, entries that are no finite numbers, unknown engines or readings.
    Singular
        Where sE - A is singular for every s: the equations do not determine the states.
    Undecided
        Where the float engine cannot tell.
    """
    from dynid.lti.pencil.reading import one_of

    one_of("engine", engine, ("exact", "float"))
    system = _System.read((A, B, C, D, E), reading)
    return (_exactly if engine == "exact" else _in_floats)(system)


@dataclass(frozen=True)
class _System:
    """A system over the rationals.

    Parameters
    ----------
    state, whole
        The pencils sE - A and [sE - A, -B; C, D].
    siso
        Whether it has one input and one output.
    rank_E
        Rank of E.
    reading
        What a float was taken for.
    """

    state: IntegerPencil
    whole: IntegerPencil
    siso: bool
    rank_E: int
    reading: Reading

    @classmethod
    def read(cls, matrices: tuple[Any, ...], reading: Reading) -> _System:
        """Read A, B, C, D, E; the numbers of inputs and outputs are D's where B and C cannot tell."""
        from dynid.lti.pencil.integer import IntegerPencil
        from dynid.lti.pencil.reading import exact_rows, shape_of

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
        """Return what follows from the system pencil's normal rank and the numbers of zeros and poles."""
        normal_rank = rank - self.state.shape[0]
        regular = self.whole.shape == (rank, rank)
        return {
            "normal_rank": normal_rank,
            "relative_degree": (poles - zeros if normal_rank else math.inf) if self.siso else None,
            "infinite_zeros": self.rank_E - zeros if regular else None,
            "reading": self.reading,
        }

    def gain(self, lead_of_zeros: Fraction, lead_of_poles: Fraction) -> float:
        """Return the quotient of the leading coefficients, the integer pencils' scales undone."""
        return float(lead_of_zeros / lead_of_poles * self.whole.scale / self.state.scale)


# --- exact ---------------------------------------------------------------------------------------


def _exactly(system: _System) -> SystemZerosPoles:
    from dynid.lti.pencil.exact import determinant
    from dynid.lti.pencil.exact import zeros as zeros_of

    denominator = determinant(system.state.F, system.state.G)
    if denominator == 0:
        raise _singular()
    numerator, rank = zeros_of(system.whole)
    zeros, poles = certified_roots(numerator), certified_roots(denominator)
    structure = system.structure(rank, numerator.degree(), denominator.degree())
    gain = None
    if system.siso:
        leads = (Fraction(int(p.leading_coefficient())) for p in (numerator, denominator))
        gain = system.gain(*leads) if structure["normal_rank"] else 0.0
    return SystemZerosPoles(
        zeros=repeated(zeros),
        poles=repeated(poles),
        zero_bounds=_bounds(zeros),
        pole_bounds=_bounds(poles),
        zero_roots=zeros,
        pole_roots=poles,
        gain=gain,
        engine="exact",
        **structure,
    )


def _bounds(roots: tuple[Root, ...]) -> NDArray[np.float64]:
    import numpy as np

    return np.array([root.radius for root in roots for _ in range(root.multiplicity)], dtype=float)


def _singular() -> Singular:
    return Singular(
        "sE - A is singular for every s: the equations do not determine the states",
        remedy="Check E and A: some equation is a combination of the others, or some state is in none.",
    )


# --- floating point ------------------------------------------------------------------------------


def _in_floats(system: _System) -> SystemZerosPoles:
    from dynid.lti.pencil.rectangular import checked_zeros

    if system.state.rank() < system.state.shape[0]:
        raise _singular()
    poles, of_poles = checked_zeros(system.state)
    zeros, of_zeros = checked_zeros(system.whole)
    return SystemZerosPoles(
        zeros=zeros.values,
        poles=poles.values,
        zero_bounds=zeros.bounds,
        pole_bounds=poles.bounds,
        zero_roots=FloatRoot.all_of(zeros),
        pole_roots=FloatRoot.all_of(poles),
        gain=None,
        engine="float",
        **system.structure(of_zeros.rank, of_zeros.finite, of_poles.finite),
    )
