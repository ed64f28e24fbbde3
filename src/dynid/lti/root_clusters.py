"""Roots of a matrix P(s) that round-off does not resolve: clusters, with their centres and error bounds.

Where P changes by its rounding, an m-fold root falls apart into m roots around it, at a distance of about
``eps^(1/m)``, real ones or pairs as it happens. Two roots are resolved if P has no root between them within
its rounding: if the smallest singular value of P there is above it (L. N. Trefethen, M. Embree, *Spectra and
Pseudospectra*, 2005, section 2). The mean of a cluster is well conditioned (T. Kato, *Perturbation Theory for
Linear Operators*, 1966, section II.2), and takes the place of its roots.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray

#: Smallest singular values of P at points, over the size of its rounding: up to 1 a point may be a root.
Resolution = Callable[[ComplexArray], Array]

#: Relative distance within which roots may be one: eps^(1/m) of nine.
_CLUSTER_RTOL = 0.02
#: Directions in which the reach of a cluster is sought, and its first guess over the size of the cluster.
_DIRECTIONS = np.exp(2j * np.pi * np.arange(8) / 8)


class RootCluster(NamedTuple):
    """Roots that are one to round-off.

    `places` among the roots; `centre`, real where the cluster is its own conjugate; `radius`: within which
    round-off moves its roots.
    """

    places: NDArray[np.intp]
    centre: complex
    radius: float


def root_clusters(values: ComplexArray, resolution: Resolution) -> list[RootCluster]:
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
        clusters.append(RootCluster(places, centre, radius))
        if not overlapping:
            clusters.append(RootCluster(mirrored, centre.conjugate(), radius))
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
