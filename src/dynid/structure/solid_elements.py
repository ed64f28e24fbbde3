"""Isoparametric solid elements: reference nodes, shape functions, integration points, element matrices.

Nodes of an element are in the order of VTK and meshio: corners, mid-edges, faces, centre. Shape functions are
polynomials that are 1 at one reference node and 0 at the others.

Sources: O. C. Zienkiewicz, R. L. Taylor, "The Finite Element Method", vol. 1 (elements); N. J. Walkington,
"Quadrature on simplices of arbitrary dimension", 2000 (tetrahedron, degree 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array

Exponents = tuple[tuple[int, int, int], ...]


class Rule(NamedTuple):
    """An integration rule: points (q x 3) and positive weights (q) of a reference element."""

    points: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class _SolidElement:
    """A kind of solid element, its nodes at corners, mid-edges (of second order) and further places."""

    corners: Array  # reference coordinates (c x 3)
    edges: tuple[tuple[int, int], ...]  # pairs of corners, in the order of their mid-edge nodes
    faces: tuple[tuple[int, ...], ...]  # corners around each face
    order: int
    exponents: Exponents  # of x, y, z in the polynomials that shape functions are made from (n)
    rule: Rule  # of stiffness and mass, exact for parallel-sided elements
    further: tuple[tuple[float, float, float], ...] = ()

    @cached_property
    def nodes(self) -> Array:
        """Reference coordinates of the nodes (n x 3)."""
        middles = [(self.corners[a] + self.corners[b]) / 2 for a, b in self.edges] if self.order == 2 else []
        return np.array([*self.corners, *middles, *self.further])

    @cached_property
    def _coefficients(self) -> Array:
        return np.asarray(np.linalg.inv(self._monomials(self.nodes)), dtype=np.float64)

    def _monomials(self, points: Array) -> Array:
        return np.array(
            [[np.prod(point ** np.array(powers)) for powers in self.exponents] for point in points]
        )

    def shapes(self, points: Array) -> Array:
        """Return the shape functions at reference points: p x n."""
        return self._monomials(points) @ self._coefficients

    def slopes(self, points: Array) -> Array:
        """Return the derivatives of the shape functions by the reference coordinates: p x 3 x n."""
        parts = []
        for axis in range(3):
            factors = [exponents[axis] for exponents in self.exponents]
            lowered = np.maximum(np.array(self.exponents) - np.eye(3, dtype=int)[axis], 0)
            values = np.array([[np.prod(point**exponents) for exponents in lowered] for point in points])
            parts.append(values * factors @ self._coefficients)
        return np.stack(parts, axis=1)


class _Integrated(NamedTuple):
    """Integrals over elements (e): what stiffness and mass are combined from.

    `strain`: products of derivatives of shape functions (e x n x 3 x n x 3): ``int dN_i/dx_a dN_j/dx_b``;
    `mass`: products of shape functions (e x n x n).
    """

    strain: Array
    mass: Array


def jacobians(element: _SolidElement, points: Array) -> Array:
    """Return the derivatives (e x q x 3 x 3) of positions by reference coordinates at integration points.

    `points`: positions of the elements' nodes (e x n x 3), m.
    """
    return np.asarray(element.slopes(element.rule.points) @ points[:, None])


def integrated(element: _SolidElement, points: Array) -> _Integrated:
    """Return the integrals of products of shape functions and of their derivatives.

    `points`: positions of the elements' nodes (e x n x 3), m; of either orientation, but nowhere singular.
    """
    J = jacobians(element, points)
    weights = np.abs(np.linalg.det(J)) * element.rule.weights
    gradients = np.linalg.solve(J, element.slopes(element.rule.points)[None])
    count, n = len(points), points.shape[1]
    scaled = (gradients * np.sqrt(weights)[..., None, None]).transpose(0, 1, 3, 2).reshape(count, -1, 3 * n)
    strain = (scaled.transpose(0, 2, 1) @ scaled).reshape(count, n, 3, n, 3)
    N = element.shapes(element.rule.points)
    mass = weights @ (N[:, :, None] * N[:, None, :]).reshape(len(N), -1)
    return _Integrated(strain, mass.reshape(count, n, n))


def stiffness(strain: Array, first: float, shear: float) -> Array:
    """Return the stiffness (e x n x 3 x n x 3) of isotropic elements from their strain, as of `_Integrated`.

    `first`, `shear`: Lamé's constants, Pa.
    """
    total = first * strain + shear * strain.transpose(0, 1, 4, 3, 2)
    laplace = shear * np.einsum("eiaja->eij", strain)
    for axis in range(3):
        total[:, :, axis, :, axis] += laplace
    return np.asarray(total)


def _line(count: int) -> tuple[Array, Array]:
    """Return Gauss's points and weights on 0 … 1."""
    x, w = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, w / 2


def _cube(count: int) -> Rule:
    x, w = _line(count)
    return Rule(np.array(list(product(x, x, x))), np.array([a * b * c for a, b, c in product(w, w, w)]))


def _simplex(*orbits: tuple[tuple[float, ...], float]) -> tuple[Array, Array]:
    """Return points and weights of all permutations of barycentric coordinates, the first left out."""
    from itertools import permutations

    points, weights = [], []
    for coordinates, weight in orbits:
        for permuted in sorted(set(permutations(coordinates))):
            points.append(permuted[1:])
            weights.append(weight)
    return np.array(points), np.array(weights)


def _tetrahedron(order: int) -> Rule:
    if order == 1:
        a = (5 - sqrt(5)) / 20
        return Rule(*_simplex(((a, a, a, 1 - 3 * a), 1 / 24)))
    a, b, c = 0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492
    return Rule(
        *_simplex(
            ((a, a, a, 1 - 3 * a), 0.018781320953002641800),
            ((b, b, b, 1 - 3 * b), 0.012248840519393658257),
            ((c, c, 0.5 - c, 0.5 - c), 0.0070910034628469110730),
        )
    )


def _prism() -> Rule:
    flat, weights = _simplex(((1 / 6, 1 / 6, 2 / 3), 1 / 6))
    z, w = _line(2)
    points = np.array([(*point, height) for point, height in product(flat, z)])
    return Rule(points, np.outer(weights, w).ravel())


def _exponents(highest: int) -> Exponents:
    powers = range(highest + 1)
    return tuple(product(powers, powers, powers))


_TET = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
_TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
_WEDGE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]])
_WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
_WEDGE_FACES = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2))
_HEX = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
_HEX_EDGES = (
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)
_HEX_FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3))
_HEX_CENTRES = (
    *((0.0, 0.5, 0.5), (1.0, 0.5, 0.5), (0.5, 0.0, 0.5), (0.5, 1.0, 0.5), (0.5, 0.5, 0.0), (0.5, 0.5, 1.0)),
    (0.5, 0.5, 0.5),
)
_SQUARES = tuple(p for p in _exponents(2) if p.count(2) <= 1)

#: The kinds of solid elements by their names in meshio.
ELEMENTS = {
    "tetra": _SolidElement(
        _TET, _TET_EDGES, _TET_FACES, 1, tuple(p for p in _exponents(1) if sum(p) <= 1), _tetrahedron(1)
    ),
    "tetra10": _SolidElement(
        _TET, _TET_EDGES, _TET_FACES, 2, tuple(p for p in _exponents(2) if sum(p) <= 2), _tetrahedron(2)
    ),
    "wedge": _SolidElement(
        _WEDGE, _WEDGE_EDGES, _WEDGE_FACES, 1,
        tuple(p for p in _exponents(1) if p[0] + p[1] <= 1), _prism()
    ),
    "hexahedron": _SolidElement(_HEX, _HEX_EDGES, _HEX_FACES, 1, _exponents(1), _cube(2)),
    "hexahedron20": _SolidElement(_HEX, _HEX_EDGES, _HEX_FACES, 2, _SQUARES, _cube(3)),
    "hexahedron27": _SolidElement(
        _HEX, _HEX_EDGES, _HEX_FACES, 2, _exponents(2), _cube(3), _HEX_CENTRES
    ),
}  # fmt: skip

Places = NDArray[np.intp]
