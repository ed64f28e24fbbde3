"""Finite-element matrices of any size: a thin plate of rectangles, a solid of bricks."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.sparse import coo_array, csc_array


def plate(side: int, width: float = 1.0, height: float = 1.3) -> tuple[csc_array, csc_array]:
    """Return stiffness and mass of a simply supported Kirchhoff plate, side x side elements.

    Elements of four nodes with w, dw/dx, dw/dy (Adini, Clough, Melosh), consistent mass; unit bending
    stiffness and mass per area, Poisson's ratio 0.3.
    """
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    K, M = _assembled((side, side), corners, 3, _plate_element(width / side, height / side))
    position = np.indices((side + 1, side + 1)).reshape(2, -1)
    edge = np.any((position == 0) | (position == side), axis=0)
    keep = np.ones(len(edge) * 3, dtype=bool)
    keep[::3] = ~edge  # w is fixed
    return csc_array(K[keep][:, keep]), csc_array(M[keep][:, keep])


def deflections(side: int) -> np.ndarray:
    """Return the DOFs (from 1) of such a plate that are deflections."""
    position = np.indices((side + 1, side + 1)).reshape(2, -1)
    edge = np.any((position == 0) | (position == side), axis=0)
    kinds = np.repeat(~edge, 3) | (np.arange(len(edge) * 3) % 3 > 0)
    return np.flatnonzero((np.arange(len(kinds)) % 3 == 0)[kinds]) + 1


def solid(side: int, sizes: tuple[float, float, float] = (1.3, 1.0, 1.1)) -> tuple[csc_array, csc_array]:
    """Return stiffness and mass of an elastic block clamped on one face, side^3 bricks of eight nodes.

    Full integration, consistent mass; unit modulus and density, Poisson's ratio 0.3.
    """
    corners = np.array(list(product((0, 1), repeat=3)))
    K, M = _assembled((side,) * 3, corners, 3, _brick_element(np.array(sizes) / side))
    free = 3 * (side + 1) ** 2  # the first face is clamped
    return csc_array(K[free:, free:]), csc_array(M[free:, free:])


def _assembled(
    elements: tuple[int, ...], corners: np.ndarray, dofs: int, matrices: tuple[np.ndarray, np.ndarray]
) -> list[csc_array]:
    nodes = tuple(count + 1 for count in elements)
    first = np.indices(elements).reshape(len(elements), -1).T
    numbers = np.stack([np.ravel_multi_index((first + corner).T, nodes) for corner in corners], axis=1)
    dof = (dofs * numbers[:, :, None] + np.arange(dofs)).reshape(len(first), -1).astype(np.int32)
    rows, columns = np.repeat(dof, dof.shape[1], axis=1).ravel(), np.tile(dof, dof.shape[1]).ravel()
    n = dofs * int(np.prod(nodes))
    entries = [np.tile(matrix.ravel(), len(first)) for matrix in matrices]
    return [csc_array(coo_array((entry, (rows, columns)), shape=(n, n))) for entry in entries]


def _gauss(points: int, dimensions: int) -> list[tuple[np.ndarray, float]]:
    """Return places in [0, 1]^d and weights."""
    x, weight = np.polynomial.legendre.leggauss(points)
    grid = product(range(points), repeat=dimensions)
    return [((1 + x[list(at)]) / 2, float(np.prod(weight[list(at)])) / 2**dimensions) for at in grid]


def _plate_element(a: float, b: float, poisson: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (3, 1), (1, 3)]

    def polynomials(x: float, y: float, dx: int, dy: int) -> list[float]:
        """Return the derivatives of the monomials."""
        factors = [(np.prod(np.arange(p, p - dx, -1)), np.prod(np.arange(q, q - dy, -1))) for p, q in powers]
        return [
            float(f * g * x ** max(p - dx, 0) * y ** max(q - dy, 0))
            for (f, g), (p, q) in zip(factors, powers, strict=True)
        ]

    corners = [(0.0, 0.0), (a, 0.0), (a, b), (0.0, b)]
    values = [polynomials(x, y, *order) for x, y in corners for order in ((0, 0), (1, 0), (0, 1))]
    shape = np.linalg.inv(np.array(values))
    law = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    for (x, y), weight in _gauss(4, 2):
        at = x * a, y * b
        second = [polynomials(*at, 2, 0), polynomials(*at, 0, 2), polynomials(*at, 1, 1)]
        curvature = np.array([[1], [1], [2]]) * np.array(second) @ shape
        w = np.array(polynomials(*at, 0, 0)) @ shape
        K += weight * a * b * curvature.T @ law @ curvature
        M += weight * a * b * np.outer(w, w)
    return K, M


def _brick_element(size: np.ndarray, poisson: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    shear = 1 / (2 * (1 + poisson))
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += poisson / ((1 + poisson) * (1 - 2 * poisson))
    corners = np.array(list(product((0, 1), repeat=3)))
    K, M = np.zeros((24, 24)), np.zeros((24, 24))
    volume = float(np.prod(size))
    for at, weight in _gauss(2, 3):
        linear = np.where(corners, at, 1 - at)
        N = linear.prod(axis=1)
        slope = np.where(corners, 1, -1) / size * np.stack([N / linear[:, k] for k in range(3)], axis=1)
        strain = np.zeros((6, 24))
        for k in range(3):
            strain[k, k::3] = slope[:, k]
        for row, (i, j) in enumerate([(0, 1), (1, 2), (2, 0)], 3):
            strain[row, i::3], strain[row, j::3] = slope[:, j], slope[:, i]
        K += weight * volume * strain.T @ law @ strain
        M += weight * volume * np.kron(np.outer(N, N), np.eye(3))
    return K, M
