"""Structures whose numbers depend on parameters, and matrices of complex numbers by other code."""

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.parameters import Parameter

STEP = 1e-40


def unknowns(**starts):
    """The numbers that parameters are, by name, and the parameters."""
    numbers = {name: Dependent.parameter(name, start) for name, start in starts.items()}
    return numbers, [Parameter(name, start, scale="linear") for name, start in starts.items()]


def dense(matrix):
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def assert_as_built(model, oracle, values, rtol=1e-12):
    """Matrices and slopes at values are those of complex matrices of these numbers, by the complex step."""
    exact = oracle(**values)
    for letter, found, wanted in zip("MCK", model.with_joints(values), exact, strict=True):
        size = np.abs(wanted).max() or 1.0
        np.testing.assert_allclose(dense(found), wanted, rtol=0, atol=rtol * size, err_msg=letter)
    assert model.names <= set(values)
    sizes = {letter: np.abs(matrix).max() for letter, matrix in zip("MCK", exact, strict=True)}
    acting = [one for one in model.unknowns if one.name in model.names]
    slopes_of = model.slopes(values, [one.name for one in acting])
    for one, slopes in zip(acting, slopes_of, strict=True):
        moved = oracle(**{**values, one.name: values[one.name] + 1j * STEP})
        for letter, matrix in zip("MCK", moved, strict=True):
            wanted = np.imag(matrix) / STEP
            found = dense(slopes[letter]) if letter in slopes else np.zeros_like(wanted)
            # A slope that cancels leaves rounding of the matrix.
            size = max(np.abs(wanted).max(), 0.1 * sizes[letter] / abs(values[one.name]))
            np.testing.assert_allclose(
                found, wanted, rtol=0, atol=rtol * size, err_msg=f"d{letter}/d{one.name}"
            )


def chain(masses, links):
    """M, C, K of masses and links (from, to or None, k, c), DOFs from 0."""
    n = len(masses)
    M, C, K = np.diag(np.array(masses, dtype=complex)), np.zeros((n, n), complex), np.zeros((n, n), complex)
    for a, b, k, c in links:
        direction = np.zeros(n)
        direction[a] = 1
        if b is not None:
            direction[b] = -1
        K += k * np.outer(direction, direction)
        C += c * np.outer(direction, direction)
    return M, C, K


def bent(EI, rhoA, L, hinges=()):
    """Stiffness and mass of a beam element by its shape functions; hinged rotations solved for."""
    xi, w = np.polynomial.legendre.leggauss(8)
    k, m = np.zeros((4, 4), complex), np.zeros((4, 4), complex)
    for s, weight in zip((xi + 1) / 2, w / 2, strict=True):
        N = np.array(
            [1 - 3 * s**2 + 2 * s**3, L * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, L * (s**3 - s**2)]
        )
        B = np.array([-6 + 12 * s, L * (-4 + 6 * s), 6 - 12 * s, L * (6 * s - 2)]) / L**2
        k += weight * L * EI * np.outer(B, B)
        m += weight * L * rhoA * np.outer(N, N)
    free = [(1, 3)[end - 1] for end in hinges]
    if free:
        kept = [at for at in range(4) if at not in free]
        T = np.zeros((4, 4), complex)
        T[kept, kept] = 1
        T[np.ix_(free, kept)] = -np.linalg.solve(k[np.ix_(free, free)], k[np.ix_(free, kept)])
        k, m = T.T @ k @ T, T.T @ m @ T
    return k, m


def plane(points, members, fixed, n):
    """M and K of a plane frame of elements (from, to, EA, EI, rhoA, hinges), nodes from 0, n nodes."""
    M, K = np.zeros((3 * n, 3 * n), complex), np.zeros((3 * n, 3 * n), complex)
    for a, b, EA, EI, rhoA, hinges in members:
        (x1, y1), (x2, y2) = points[a], points[b]
        L = np.sqrt((x2 - x1) ** 2 + (y2 - y1) ** 2 + 0j)
        c, s = (x2 - x1) / L, (y2 - y1) / L
        R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        T = np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), R]])
        k, m = np.zeros((6, 6), complex), np.zeros((6, 6), complex)
        along, across = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5])
        k[along], m[along] = EA / L * np.array([[1, -1], [-1, 1]]), rhoA * L / 6 * np.array([[2, 1], [1, 2]])
        k[across], m[across] = bent(EI, rhoA, L, hinges)
        places = [3 * node + at for node in (a, b) for at in range(3)]
        K[np.ix_(places, places)] += T.T @ k @ T
        M[np.ix_(places, places)] += T.T @ m @ T
    kept = [at for at in range(3 * n) if at not in fixed]
    return M[np.ix_(kept, kept)], K[np.ix_(kept, kept)]
