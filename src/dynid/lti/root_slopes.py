"""Poles and zeros of parametric systems with their exact derivatives.

A simple root z of a matrix P(s) moves by dz = -w^H dP v / (w^H P' v), with the null vectors w and v of P(z)
(P. Lancaster, Numer. Math. 6 (1964) 377–387). P is sI - A for poles, and for the zeros of one input and one
output the system pencil [sI - A, -b; c, d]. The zeros themselves are the eigenvalues of the zero dynamics,
which are split off by orthogonal transformations (A. Emami-Naeini, P. Van Dooren, Automatica 18 (1982)
415–430).

Where P changes by its rounding, an m-fold root falls apart into m roots around it, at a distance of about
``eps^(1/m)``, real ones or pairs as it happens. Two roots are resolved if P has no root between them within
its rounding: if the smallest singular value of P there is above it (L. N. Trefethen, M. Embree, *Spectra and
Pseudospectra*, 2005, section 2). The mean of a cluster is well conditioned (T. Kato, *Perturbation Theory for
Linear Operators*, 1966, section II.2), and replaces its roots.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.lti.exponential import balance, rescaled
from dynid.lti.state_space import ParametricSystem

#: Smallest singular values of P at points, over the size of its rounding: up to 1 a point may be a root.
Resolution = Callable[[ComplexArray], Array]

#: Relative distance within which roots may be one: eps^(1/m) of nine.
_CLUSTER_RTOL = 0.02
#: Directions in which the reach of a cluster is sought, and its first guess over the size of the cluster.
_DIRECTIONS = np.exp(2j * np.pi * np.arange(8) / 8)


class _RootCluster(NamedTuple):
    """Roots that are one to round-off.

    `places` among the roots; `centre`, real where the cluster is its own conjugate; `radius`: within which
    round-off moves its roots.
    """

    places: NDArray[np.intp]
    centre: complex
    radius: float


def _root_clusters(values: ComplexArray, resolution: Resolution) -> list[_RootCluster]:
    """Return the clusters among roots (m) of a real matrix; complex roots come in exact conjugate pairs."""
    upper = np.flatnonzero(values.imag >= 0)
    z = values[upper]
    size = np.abs(z)
    near = np.abs(z[:, None] - z) <= _CLUSTER_RTOL * np.minimum(size[:, None], size)
    real = z.imag <= _CLUSTER_RTOL * size / 2  # half the distance to the conjugate root
    i, j = np.nonzero(np.triu(near, 1))
    both = np.concatenate([(z[i] + z[j]) / 2, z[real].real.astype(np.complex128)])
    if not len(i) and not (real & (z.imag > 0)).any():
        return []
    joined = resolution(both) <= 1
    links = np.zeros((len(z), len(z)), dtype=bool)
    links[i, j] = joined[: len(i)]
    closed = np.zeros(len(z), dtype=bool)
    closed[real] = joined[len(i) :] | (z[real].imag == 0)
    partners = _partners(values)
    clusters = []
    for group in _components(links):
        overlapping = closed[group].any()
        mirrored = partners[upper[group]]
        places = np.union1d(upper[group], mirrored) if overlapping else upper[group]
        if len(places) < 2:
            continue
        centre = complex(values[places].mean())
        centre = complex(centre.real) if overlapping else centre
        radius = _reach(values[places], centre, resolution)
        clusters.append(_RootCluster(places, centre, radius))
        if not overlapping:
            clusters.append(_RootCluster(mirrored, centre.conjugate(), radius))
    return clusters


def _partners(values: ComplexArray) -> NDArray[np.intp]:
    """Return the place of the conjugate of each root; pairs of one value in their order."""
    order = np.lexsort((values.imag, values.real))
    mirrored = np.lexsort((-values.imag, values.real))
    partners = np.empty(len(values), dtype=np.intp)
    partners[order] = mirrored
    return partners


def _components(links: NDArray[np.bool_]) -> Sequence[NDArray[np.intp]]:
    """Return the connected components of a graph, by their first members."""
    reached = links | links.T | np.eye(len(links), dtype=bool)
    while not np.array_equal(further := reached @ reached, reached):
        reached = further
    return [np.flatnonzero(row) for k, row in enumerate(reached) if not row[:k].any()]


def _reach(values: ComplexArray, centre: complex, resolution: Resolution) -> float:
    """Return a distance from the centre, to a factor of 2, beyond which rounding moves no root."""
    radius = max(float(np.abs(values - centre).max()), float(np.finfo(float).eps) * abs(centre))
    while radius < _CLUSTER_RTOL * abs(centre) and (resolution(centre + radius * _DIRECTIONS) <= 1).any():
        radius *= 2
    return radius


# Relative size below which a singular value or a direct term is rounding.
_SINGULAR_VALUE_TOL = 1e-10
# Angles of the points at which a transfer function is tested for zero, rad.
_ANGLES = np.array([0.3, 1.1, 0.7, 0.5])
# Backward errors of reduction and eigenvalues, over n eps and the norm of the matrix.
_BACKWARD_ERROR_FACTOR = 8.0
# Roots nearer than this part of their size are one; a root whose w^H P' v is below it has no derivative.
_SAME_ROOT_RTOL, _DEFECTIVE_RTOL = 1e-7, 1e-6


class Roots(NamedTuple):
    """Finite roots of a parametric matrix, those at the origin first, then by size.

    `values` (m), exactly 0 at the origin; `slopes` (m x p): their derivatives by the parameters, 0 at the
    origin, infinite where a root is multiple or defective; `origin`: number of roots at the origin;
    `clusters`: roots that are one within the errors of the matrix, whose values are their centres.
    """

    values: ComplexArray
    slopes: ComplexArray
    origin: int
    clusters: tuple[_RootCluster, ...] = ()


def poles(
    A: Array, slopes: Array | None = None, scale: Array | None = None, spread: Array | None = None
) -> Roots:
    """Return the eigenvalues of A (n x n), and their derivatives where those of A (p x n x n) are given.

    `scale` (n) balances it, as that of a matrix nearby does; default: its own. With the errors of the
    parameters (p) in `spread`, eigenvalues that are one within these and round-off are merged.
    """
    d = balance(A) if scale is None else scale
    if slopes is None:
        return poles_of_all([A], d)[0]
    A = rescaled(A, d)
    origin = int(_at_origin(A[None])[0])
    values, right = np.linalg.eig(A)
    same, left = np.linalg.eig(A.T)
    left = left[:, np.argmin(np.abs(values[:, None] - same), axis=1)]
    strength = np.einsum("ik,ik->k", left, right)
    slopes = rescaled(slopes, d)
    moved = np.einsum("ik,pij,jk->kp", left, slopes, right, optimize=True)
    resolution = None if spread is None else _resolution(A, _errors(slopes, spread))
    return _ordered(values.astype(np.complex128), _divided(moved, strength), origin, resolution)


def poles_of_all(matrices: Sequence[Array], scale: Array) -> list[Roots]:
    """Return the eigenvalues of matrices (n x n each) that one `scale` (n) balances, without derivatives."""
    if not matrices:
        return []
    A = rescaled(np.array(matrices), scale)
    return _all_ordered(np.linalg.eigvals(A).astype(np.complex128), _at_origin(A))


def zeros(
    system: ParametricSystem, *, scale: Array | None = None, spread: Array | None = None
) -> Roots | None:
    """Return the finite zeros of a system, with their derivatives.

    None where the input does not affect the output. `scale` (n) balances A, as that of a system nearby does;
    default: its own. `spread` merges zeros as it does `poles`.
    """
    n, p = len(system.A), len(system.A_slopes)
    if scale is None:
        scale = balance(system.A)
    A, b, c = rescaled(system.A, scale), system.b / scale, system.c * scale
    speed = max(float(np.linalg.norm(A)), np.finfo(float).tiny)
    of_b, of_c = float(np.linalg.norm(b)), float(np.linalg.norm(c))
    if not (of_b and of_c):  # what is left is the direct term: zeros where the modes are not involved
        return poles(system.A, system.A_slopes, spread=spread) if system.d else None
    gain = speed / (of_b * of_c)
    normalised = (A / speed, b / of_b, c / of_c, np.array(system.d * gain))
    dynamics = None if _vanishes(*normalised) else _zero_dynamics(*(matrix[None] for matrix in normalised))
    if dynamics is None:
        return None
    values: ComplexArray = np.linalg.eigvals(dynamics[0]).astype(np.complex128)
    origin = int(_at_origin(dynamics)[0])
    if not len(values):
        return _ordered(values, np.zeros((0, p), complex), origin)
    pencil = np.zeros((len(values), n + 1, n + 1), dtype=complex)
    pencil[:, :n, :n] = values[:, None, None] * np.eye(n) - A / speed
    pencil[:, :n, n], pencil[:, n, :n], pencil[:, n, n] = -b / of_b, c / of_c, system.d * gain
    U, _, Vh = np.linalg.svd(pencil)
    left, right = U[:, :, -1].conj(), Vh[:, -1].conj()
    strength = np.einsum("ki,ki->k", left[:, :n], right[:, :n])
    change = np.zeros((p, n + 1, n + 1))
    change[:, :n, :n] = -rescaled(system.A_slopes, scale) / speed
    change[:, :n, n] = -system.b_slopes / scale / of_b
    change[:, n, :n], change[:, n, n] = system.c_slopes * scale / of_c, system.d_slopes * gain
    moved = -np.einsum("ki,pij,kj->kp", left, change, right, optimize=True)
    resolution = None
    if spread is not None:
        rounding = _resolution(rescaled(dynamics[0], balance(dynamics[0])), 0.0)
        errors = _errors(change, spread)

        def resolution(points: ComplexArray) -> Array:
            points = points / speed
            matrices = np.broadcast_to(pencil[0], (len(points), n + 1, n + 1)).copy()
            matrices[:, :n, :n] = points[:, None, None] * np.eye(n) - A / speed
            smallest = np.linalg.svd(matrices, compute_uv=False)[:, -1]
            return np.minimum(rounding(points), smallest / errors if errors else np.inf)

    return _ordered(np.asarray(values * speed), _divided(moved * speed, strength), origin, resolution)


def zeros_of_all(systems: Sequence[ParametricSystem], scale: Array) -> list[Roots | None]:
    """Return the finite zeros of systems that one `scale` (n) balances, without derivatives, as `zeros`."""
    if not systems:
        return []
    A = rescaled(np.array([system.A for system in systems]), scale)
    b, c = (
        np.array([system.b for system in systems]) / scale,
        np.array([system.c for system in systems]) * scale,
    )
    d = np.array([system.d for system in systems])
    speed = np.maximum(np.linalg.norm(A, axis=(1, 2)), np.finfo(float).tiny)
    of_b, of_c = np.linalg.norm(b, axis=1), np.linalg.norm(c, axis=1)
    dynamics = None
    if of_b.all() and of_c.all():
        dynamics = _zero_dynamics(
            A / speed[:, None, None], b / of_b[:, None], c / of_c[:, None], d * (speed / (of_b * of_c))
        )
    if dynamics is not None:
        values = np.linalg.eigvals(dynamics).astype(np.complex128) * speed[:, None]
        return [*_all_ordered(values, _at_origin(dynamics))]
    if len(systems) > 1:  # of different structure
        return [zeros_of_all([system], scale)[0] for system in systems]
    (system,) = systems
    involved = of_b[0] and of_c[0]
    return [None if involved or not system.d else poles(system.A)]


def _vanishes(A: Array, b: Array, c: Array, d: Array) -> bool:
    """Return True if the terms of c (s - A)^-1 b + d cancel, or are absent, at a few points Re s > 0."""
    sizes = np.abs(np.linalg.eigvals(A))
    slowest = sizes[sizes > _SINGULAR_VALUE_TOL].min(initial=1.0)
    points = np.geomspace(slowest, 2.0, len(_ANGLES)) * np.exp(1j * _ANGLES)
    right = np.linalg.solve(points[:, None, None] * np.eye(len(A)) - A, b[:, None].astype(complex))[:, :, 0]
    terms = np.column_stack([right * c, np.full(len(points), d)])
    return bool((np.abs(terms.sum(axis=1)) <= _SINGULAR_VALUE_TOL * np.abs(terms).sum(axis=1)).all())


def _zero_dynamics(A: Array, b: Array, c: Array, d: Array) -> Array | None:
    """Return the matrices of motions with output 0 of stacked systems; None if their degrees differ."""
    while (through := np.abs(d) <= _SINGULAR_VALUE_TOL * np.maximum(1.0, np.linalg.norm(b, axis=1))).any():
        length = np.linalg.norm(c, axis=1)
        if not through.all() or not A.shape[1] or (length <= _SINGULAR_VALUE_TOL).any():
            return None
        # The output's direction first, by a reflection: H = 1 - v w^T.
        v = c.copy()
        v[:, 0] += np.copysign(length, v[:, 0])
        w = v * (2 / np.einsum("si,si->s", v, v))[:, None]
        A = A - w[:, :, None] * (v[:, None] @ A)
        A -= (A @ v[:, :, None]) * w[:, None]
        b = b - w * np.einsum("si,si->s", v, b)[:, None]
        A, b, c, d = A[:, 1:, 1:], b[:, 1:], A[:, 0, 1:], b[:, 0]
    return np.asarray(A - b[:, :, None] * c[:, None] / d[:, None, None])


def _at_origin(A: Array) -> NDArray[np.intp]:
    """Return the number of eigenvalues at the origin of matrices (S x n x n), null spaces split off."""
    left, size = A, np.linalg.norm(A, axis=(1, 2))[:, None]
    count = np.zeros(len(A), dtype=np.intp)
    while left.shape[1]:
        s = np.linalg.svd(left, compute_uv=False)
        null = np.count_nonzero(s <= _SINGULAR_VALUE_TOL * size, axis=1)
        if not null.any():
            break
        if (null != null[0]).any():
            return np.concatenate([_at_origin(matrix[None]) for matrix in A])
        kept = np.linalg.svd(left)[2][:, : left.shape[1] - null[0]]
        left, count = kept @ left @ kept.swapaxes(1, 2), count + null
    return count


def _errors(slopes: Array, spread: Array) -> float:
    """Return a bound on the change of a matrix by errors of the parameters (p), by its slopes (p x n x n)."""
    return float(spread @ np.linalg.norm(slopes, axis=(1, 2)))


def _resolution(A: Array, errors: float) -> Resolution:
    """Return the smallest singular value of s - A (n x n) at points over rounding and errors of A."""
    bound = _BACKWARD_ERROR_FACTOR * len(A) * np.finfo(float).eps * float(np.linalg.norm(A, 2)) + errors

    def resolution(points: ComplexArray) -> Array:
        matrices = points[:, None, None] * np.eye(len(A)) - A
        return np.asarray(np.linalg.svd(matrices, compute_uv=False)[:, -1] / bound)

    return resolution


def _divided(moved: ComplexArray, strength: ComplexArray) -> ComplexArray:
    """Return derivatives (m x p), infinite where the divisor (m) says that there are none."""
    weak = np.abs(strength) <= _DEFECTIVE_RTOL
    shifts = moved / np.where(weak, 1.0, strength)[:, None]
    shifts[weak] = np.inf
    return np.asarray(shifts)


def _ordered(
    values: ComplexArray, slopes: ComplexArray, origin: int, resolution: Resolution | None = None
) -> Roots:
    """Return roots by size, those at the origin exact, multiple or unresolved ones without derivatives."""
    order = _by_size(values[None], np.array([origin]))[0]
    values, slopes = values[order], slopes[order].copy()
    values[:origin], slopes[:origin] = 0.0, 0.0
    rest = values[origin:]
    near = np.abs(rest[:, None] - rest) <= _SAME_ROOT_RTOL * np.abs(rest)
    multiple = np.count_nonzero(near, axis=1) > 1
    clusters = []
    for cluster in _root_clusters(rest, resolution) if resolution is not None else ():
        rest[cluster.places], multiple[cluster.places] = cluster.centre, True
        clusters.append(cluster._replace(places=cluster.places + origin))
    slopes[origin:][multiple] = np.inf
    return Roots(values, slopes, origin, tuple(clusters))


def _all_ordered(values: ComplexArray, origin: NDArray[np.intp]) -> list[Roots]:
    """Return roots (S x m) without derivatives as `_ordered`."""
    values = np.take_along_axis(values, _by_size(values, origin), axis=1)
    values[np.arange(values.shape[1]) < origin[:, None]] = 0.0
    none = np.zeros((values.shape[1], 0), dtype=np.complex128)
    return [Roots(row, none, count) for row, count in zip(values, origin.tolist(), strict=True)]


def _by_size(values: ComplexArray, origin: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the order of roots (S x m): those at the origin, then by size, of equal size the upper first."""
    size = np.abs(values)
    rank = np.argsort(np.argsort(size, axis=1, kind="stable"), axis=1)
    rounded = np.round(np.log(size + np.finfo(float).tiny), 9)
    return np.lexsort((-values.imag, np.where(rank < origin[:, None], -np.inf, rounded)), axis=1)
