"""Element matrices: Euler–Bernoulli beams and bars with consistent mass.

Source: J. S. Archer, "Consistent mass matrix for distributed mass systems", 1963.
"""

from __future__ import annotations

import numpy as np

from dynid.structure.matrices import Array


def bending(EI: float, rhoA: float, length: float) -> tuple[Array, Array]:
    """Return stiffness and consistent mass (4 x 4) of a beam element, DOFs [w1, theta1, w2, theta2].

    Rotations are the slopes ``dw/dx``.
    """
    L = length
    k = np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    m = np.array(
        [
            [156, 22 * L, 54, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54, 13 * L, 156, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    )
    return EI / L**3 * k, rhoA * L / 420 * m


def stretching(EA: float, rhoA: float, length: float) -> tuple[Array, Array]:
    """Return stiffness and consistent mass (2 x 2) of a bar element, DOFs [u1, u2]."""
    return EA / length * np.array([[1.0, -1], [-1, 1]]), rhoA * length / 6 * np.array([[2.0, 1], [1, 2]])


def released(k: Array, m: Array, ends: list[int]) -> tuple[Array, Array]:
    """Condense DOFs that carry no force out of an element (Guyan), leaving zeros in their place.

    Parameters
    ----------
    k, m
        Stiffness and mass (d x d).
    ends
        The released DOFs, from 0.
    """
    if not ends:
        return k, m
    kept = [place for place in range(len(k)) if place not in ends]
    T = np.zeros((len(k), len(k)))
    T[kept, kept] = 1.0
    T[np.ix_(ends, kept)] = -np.linalg.solve(k[np.ix_(ends, ends)], k[np.ix_(ends, kept)])
    return T.T @ k @ T, T.T @ m @ T
