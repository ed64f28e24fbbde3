"""Structures whose springs and masses differ by many decades, and their modes and reductions with 90 digits.

Written with mpmath by the textbook formulas in the masters' displacements: of chains from the springs
themselves, of other structures from their matrices of doubles.
"""

import mpmath
import numpy as np

from dynid.structure.assembly import PointMass, Spring, Support
from dynid.structure.frame import Member, beam, frame
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import StructuralModel

DIGITS = 90


def graded_chain(rng, n, stiffness_decades, mass_decades, grounded=True):
    """Return masses and links ``(dofs, k)`` of three digits, spread over so many decades."""
    k = 1e3 * 10 ** rng.uniform(-stiffness_decades / 2, stiffness_decades / 2, n)
    masses = 10 ** rng.uniform(-mass_decades / 2, mass_decades / 2, n)
    links = [((i, i + 1), float(f"{k[i]:.3g}")) for i in range(1, n)]
    if grounded:
        links.append(((1,), float(f"{k[0]:.3g}")))
    return [float(f"{mass:.3g}") for mass in masses], links


def built(masses, links):
    return lumped(masses, [Link(dofs, k) for dofs, k in links])


def exact(masses, links):
    """Return the mass and stiffness matrices."""
    M, K = mpmath.diag([mpmath.mpf(mass) for mass in masses]), mpmath.zeros(len(masses))
    for dofs, k in links:
        for i in dofs:
            for j in dofs:
                K[i - 1, j - 1] += mpmath.mpf(k) if i == j else -mpmath.mpf(k)
    return M, K


def block(A, rows, columns):
    return mpmath.matrix([[A[i, j] for j in columns] for i in rows])


def massless_condensed(M, K):
    """Return the matrices without the DOFs that have no mass."""
    empty = [i for i in range(M.rows) if M[i, i] == 0]
    kept = [i for i in range(M.rows) if M[i, i] != 0]
    if empty:
        follow = mpmath.inverse(block(K, empty, empty)) * block(K, empty, kept)
        K = block(K, kept, kept) - block(K, kept, empty) * follow
    return block(M, kept, kept), K


def frequencies(M, K):
    """Return the natural frequencies, ascending, as floats."""
    with mpmath.workdps(DIGITS):
        M, K = massless_condensed(M, K)
        inverse = mpmath.inverse(mpmath.cholesky(M))
        A = inverse * K * inverse.T
        values = mpmath.eigsy((A + A.T) / 2, eigvals_only=True)
        return np.array(sorted(float(mpmath.sqrt(abs(value))) for value in values))


def irs(M, K, masters, iterations):
    """Return the frequencies of the improved reduced system; without iterations of static condensation."""
    with mpmath.workdps(DIGITS):
        n, kept = M.rows, [dof - 1 for dof in masters]
        slaves = [i for i in range(n) if i not in kept]
        inverse = mpmath.inverse(block(K, slaves, slaves))
        static = -inverse * block(K, slaves, kept)
        t = static
        for step in range(iterations + 1):
            T = mpmath.zeros(n, len(kept))
            for column, dof in enumerate(kept):
                T[dof, column] = 1
                for row, slave in enumerate(slaves):
                    T[slave, column] = t[row, column]
            m, k = T.T * M * T, T.T * K * T
            if step < iterations:
                inertia = block(M, slaves, kept) + block(M, slaves, slaves) * t
                t = static + inverse * inertia * (mpmath.inverse(m) * k)
        return frequencies(m, k)


def of_doubles(matrix):
    """Return a matrix of doubles, which are exact numbers."""
    return mpmath.matrix(np.asarray(matrix).tolist())


def graded(rng, decades, size=None):
    """Return numbers of three digits whose logarithms spread uniformly over so many decades."""
    values = 10 ** rng.uniform(-decades / 2, decades / 2, size)
    return [float(f"{value:.3g}") for value in np.atleast_1d(values)]


def graded_beam(rng, decades):
    """Return a beam of 1 to 5 elements, stiffness, mass, length and springs graded; at times free."""
    count = int(rng.integers(1, 6))
    node = int(rng.integers(1, count + 2))
    supports = [(), [Support(1, ("w", "theta"))], [Support(1, ("w",)), Support(count + 1, ("w",))]]
    return beam(
        count,
        graded(rng, decades / 4, count),
        [1e4 * value for value in graded(rng, decades, count)],
        graded(rng, decades / 2, count),
        supports=supports[rng.integers(3)],
        masses=[PointMass(node, graded(rng, decades / 2)[0])],
        springs=[Spring(node, "w", 1e3 * graded(rng, decades)[0])] if rng.random() < 0.5 else [],
    )


def graded_frame(rng, decades):
    """Return a frame of two or three members, clamped, pinned or free, with members of graded stiffness."""
    corners = [(0.0, 0.0), (0.0, 2.0), (3.0, 2.5), (3.5, 0.0)][: int(rng.integers(3, 5))]
    members = [
        Member((i, i + 1), 1e6 * EA, 1e4 * EI, rhoA, hinges=(2,) if rng.random() < 0.2 else ())
        for i, (EA, EI, rhoA) in enumerate(
            (tuple(graded(rng, decades, 2)) + tuple(graded(rng, decades / 2)) for _ in corners[1:]), 1
        )
    ]
    supports = [
        (),
        [Support(1, ("u", "w", "theta"))],
        [Support(1, ("u", "w")), Support(len(corners), ("w",))],
    ]
    return frame(corners, members, supports=supports[rng.integers(3)])


def graded_matrices(rng, decades):
    """Return the structure of full matrices that are graded by their DOFs' units, and by their own modes."""
    n = int(rng.integers(2, 13))
    units, modes = np.array(graded(rng, decades / 4, n)), np.array(graded(rng, decades, n))
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    root = rng.standard_normal((n, n)) + n**0.5 * np.eye(n)
    M, K = units * (root @ root.T) * units[:, None], units * (Q * modes @ Q.T) * units[:, None]
    return StructuralModel((M + M.T) / 2, np.zeros((n, n)), (K + K.T) / 2)
