"""Second-order systems as first-order ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.lti.model import StateSpace
from dynid.structure.matrices import Array


@guarded("the system matrix of the structure")
def state_space(M: Array, C: Array, K: Array, forces: Array, outputs: Array, orders: ArrayLike) -> StateSpace:
    """Return the state space, states [x, x'], of a second-order system.

    Parameters
    ----------
    M, C, K
        Mass, damping and stiffness (n x n).
    forces
        Force directions (n x inputs).
    outputs
        Displacement rows (outputs x n).
    orders
        Derivative order of each output: 0 displacement, 1 velocity, 2 acceleration.

    Raises
    ------
    UsageError
        If the mass is not positive definite: then displacements and velocities are not a state.
    """
    check_mass(M)
    n = len(M)
    flexibility = np.linalg.solve(M, np.concatenate([-K, -C, forces], axis=1))
    A = np.concatenate([np.eye(n, 2 * n, k=n), flexibility[:, : 2 * n]])
    B = np.concatenate([np.zeros_like(forces), flexibility[:, 2 * n :]])
    order = np.asarray(orders, dtype=int)[:, None]
    by_order = np.stack([np.eye(n, 2 * n), np.eye(n, 2 * n, k=n), A[n:]])
    rows = np.take_along_axis(outputs @ by_order, order[None, :, :], axis=0)[0]
    return StateSpace(A, B, rows, np.where(order == 2, outputs @ B[n:], 0.0))


def check_mass(M: Array) -> None:
    """Refuse a mass matrix (n x n) that is singular to rounding.

    Raises
    ------
    UsageError
        If it is not positive definite.
    """
    diagonal = np.diag(M)
    massless = int(np.count_nonzero(diagonal <= 0))
    if not massless:
        scale = np.sqrt(diagonal)
        smallest = float(np.linalg.eigvalsh(M / scale / scale[:, None])[0])
        if smallest > len(M) * np.finfo(float).eps:
            return
    some = f"{massless} of its {len(M)} DOFs have no mass" if massless else "some motion moves no mass"
    raise UsageError(
        f"the mass matrix is singular ({some}); a motion in time needs mass everywhere",
        remedy="Condense the massless DOFs by a reduction, or give every DOF mass.",
        names=("structure",),
    )
