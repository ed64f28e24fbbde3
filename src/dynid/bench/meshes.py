"""Finite-element matrices of any size: a thin plate of rectangles, a solid of bricks."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.sparse import coo_array, csc_array

from dynid.structure.solid import Material, SetSupport
from dynid.structure.solid import solid as meshed_solid
from dynid.structure.solid_elements import ELEMENTS
from dynid.structure.solid_mesh import Block, SolidMesh


def plate(
    side: int, width: float = 1.0, height: float = 1.3, rigidities: np.ndarray | float = 1.0
) -> tuple[csc_array, csc_array]:
    """Return stiffness and mass of a simply supported Kirchhoff plate, side x side elements.

    Elements of four nodes with w, dw/dx, dw/dy (Adini, Clough, Melosh), consistent mass; bending stiffness of
    the elements `rigidities`, unit mass per area, Poisson's ratio 0.3.
    """
    numbers = _nodes_of_elements((side, side), np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
    dof = (3 * numbers[:, :, None] + np.arange(3)).reshape(len(numbers), -1).astype(np.int32)
    rows, columns = np.repeat(dof, dof.shape[1], axis=1).ravel(), np.tile(dof, dof.shape[1]).ravel()
    keep = _free(side)
    scales = np.broadcast_to(rigidities, len(numbers)), np.ones(len(numbers))
    K, M = (
        csc_array(coo_array((np.outer(scale, matrix).ravel(), (rows, columns)), shape=(len(keep),) * 2))
        for matrix, scale in zip(_plate_element(width / side, height / side), scales, strict=True)
    )
    return csc_array(K[keep][:, keep]), csc_array(M[keep][:, keep])


def _free(side: int) -> np.ndarray:
    """Return the mask of the DOFs of a plate that are not supported: w is fixed on the edges."""
    position = np.indices((side + 1, side + 1)).reshape(2, -1)
    free = np.ones((position.shape[1], 3), dtype=bool)
    free[:, 0] = ~np.any((position == 0) | (position == side), axis=0)
    return free.ravel()


def deflections(side: int) -> np.ndarray:
    """Return the DOFs (from 1) of such a plate that are deflections."""
    free = _free(side)
    return np.flatnonzero((np.arange(len(free)) % 3 == 0)[free]) + 1


def solid(side: int, sizes: tuple[float, float, float] = (1.3, 1.0, 1.1)) -> tuple[csc_array, csc_array]:
    """Return stiffness and mass of an elastic block clamped on one face, side^3 bricks of eight nodes.

    Unit modulus and density, Poisson's ratio 0.3.
    """
    cells = _nodes_of_elements((side,) * 3, ELEMENTS["hexahedron"].corners.astype(int))
    xyz = np.indices((side + 1,) * 3).reshape(3, -1).T * (np.array(sizes) / side)
    clamped = np.flatnonzero(xyz[:, 0] == 0)
    mesh = SolidMesh(
        tuple(range(1, len(xyz) + 1)), xyz, (Block("hexahedron", cells),), sets={"clamped": clamped}
    )
    support = SetSupport("clamped", ("x", "y", "z"))
    model = meshed_solid(mesh, Material(1.0, 0.3, 1.0), supports=[support])
    return csc_array(model.K), csc_array(model.M)


def _nodes_of_elements(elements: tuple[int, ...], corners: np.ndarray) -> np.ndarray:
    """Return the numbers of the nodes, from 0, of all elements of a grid."""
    nodes = tuple(count + 1 for count in elements)
    first = np.indices(elements).reshape(len(elements), -1).T
    return np.stack([np.ravel_multi_index((first + corner).T, nodes) for corner in corners], axis=1)


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
    nodes, weights = np.polynomial.legendre.leggauss(4)
    for i, j in product(range(4), repeat=2):
        at, weight = ((1 + nodes[i]) / 2 * a, (1 + nodes[j]) / 2 * b), weights[i] * weights[j] / 4
        second = [polynomials(*at, 2, 0), polynomials(*at, 0, 2), polynomials(*at, 1, 1)]
        curvature = np.array([[1], [1], [2]]) * np.array(second) @ shape
        w = np.array(polynomials(*at, 0, 0)) @ shape
        K += weight * a * b * curvature.T @ law @ curvature
        M += weight * a * b * np.outer(w, w)
    return K, M
