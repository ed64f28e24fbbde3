"""Energy of free and forced motions: its shares in storage elements, and its dissipation in resistors.

In a motion with amplitudes e and f at an angular frequency, or of a mode at an instant, an I stores
I |f|²/4 as a mean over the phase, a C stores C |e|²/4, and an R dissipates R |f|²/2. In a mode s = σ + jω
all of it falls as e^{2σt}; power is the rate of energy, P = -2σ W, so that every resistor has its part of -σ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.graph import STORAGES, BondGraph, Port
from dynid.bondgraph.plan import ReducedGraph

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: The part whose elements stand for controllers.
CONTROL = "control"
#: Eigenvalues nearer to each other than this, relative to the larger one, are one repeated eigenvalue.
_EQUAL = 1e-7
#: A second eigenvector nearer to the first than this is the same one: the eigenvalue is defective.
_PARALLEL = 1e-4


class EnergyElements:
    """The elements of a graph that store or dissipate energy, and the variables that measure it.

    Parameters
    ----------
    graph
        The graph.

    Attributes
    ----------
    ports
        The variable of every single element: the flow of an I or R, the effort of a C.
    values
        Its I, C or R.
    storages, resistors
        Names of the elements as they are drawn; a field or a structure is one.
    controlled
        Whether controllers have states, which store no energy.
    """

    def __init__(self, graph: BondGraph) -> None:
        every = [node for node in graph.nodes.values() if node.type in STORAGES or node.type == "R"]
        single = [node for node in every if node.part != CONTROL]
        self.controlled = any(node.type in STORAGES for node in every if node.part == CONTROL)
        self.ports = [Port(node.name, "e" if node.type == "C" else "f") for node in single]
        self.values = np.array([float(graph.value(node.name)) for node in single])
        self._stores = np.array([node.type in STORAGES for node in single], dtype=bool)
        self._owners = [node.part or node.name for node in single]
        self.storages = self._names(stores=True)
        self.resistors = self._names(stores=False)

    def _names(self, *, stores: bool) -> list[str]:
        pairs = zip(self._owners, self._stores, strict=True)
        return list(dict.fromkeys(owner for owner, own in pairs if own is np.bool_(stores)))

    @property
    def passive(self) -> bool:
        """True where no element has a negative value."""
        return bool((self.values >= 0).all())

    @property
    def storage_values(self) -> Array:
        """The values of storage elements, 0 elsewhere."""
        return np.where(self._stores, self.values, 0.0)

    def energy(self, squares: Array) -> Array:
        """Return the mean energy stored in `storages`, from squared amplitudes (…, ports)."""
        return self._summed(squares, 0.25, stores=True)

    def power(self, squares: Array) -> Array:
        """Return the mean power dissipated in `resistors`, from squared amplitudes (…, ports)."""
        return self._summed(squares, 0.5, stores=False)

    def _summed(self, squares: Array, factor: float, *, stores: bool) -> Array:
        """Return sums over the single elements of every element as drawn."""
        names = self.storages if stores else self.resistors
        sums = np.zeros((*squares.shape[:-1], len(names)))
        for column, (owner, own) in enumerate(zip(self._owners, self._stores, strict=True)):
            if own == stores and self.values[column]:  # without 0 times inf
                sums[..., names.index(owner)] += factor * self.values[column] * squares[..., column]
        return sums


class FreeMotions(NamedTuple):
    """The free motions of a graph: `poles` (rad/s, one of each pair), squared amplitudes (modes x ports).

    `repeated` has True for the poles that stand more than once; the amplitudes of such a pole are means over
    its motions, of equal energy.
    """

    poles: ComplexArray
    squares: Array
    repeated: NDArray[np.bool_]


def free_motions(reduced: ReducedGraph, elements: EnergyElements) -> FreeMotions:
    """Return the free motions of a graph, all sources zero.

    Parameters
    ----------
    reduced
        The graph, its outputs the ports of the elements.
    elements
        Elements of positive values.
    """
    from scipy.linalg import cholesky, solve_triangular

    from dynid.bondgraph.state_space import state_space

    system = state_space(reduced)
    if not len(system.A):
        return FreeMotions(np.zeros(0, complex), np.zeros((0, len(elements.ports))), np.zeros(0, bool))
    # In coordinates whose squares are energies a passive graph has well-conditioned eigenvectors.
    weights = system.C.T * elements.storage_values
    root = cholesky(weights @ system.C, lower=False)
    A = root @ solve_triangular(root, system.A.T, trans="T", lower=False).T
    values, vectors = np.linalg.eig(A)
    C = solve_triangular(root, system.C.T, trans="T", lower=False).T
    poles, squares, repeated = [], [], []
    for pole in values[values.imag >= 0]:
        near = np.abs(values - pole) <= _EQUAL * max(abs(pole), np.finfo(float).tiny)
        left, sizes, _ = np.linalg.svd(vectors[:, near], full_matrices=False)
        own = left[:, sizes > _PARALLEL * sizes[0]]
        poles.append(values[near].mean())
        squares.append((np.abs(C @ own) ** 2).mean(axis=1))
        repeated.append(near.sum() > 1)
    order = np.argsort(np.abs(poles), kind="stable")
    return FreeMotions(np.array(poles)[order], np.array(squares)[order], np.array(repeated)[order])
