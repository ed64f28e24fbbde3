"""Natural frequencies, mode shapes and modal damping of small structures, by dense matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Singular
from dynid.lti.floating import guarded

Array = NDArray[np.float64]


class Modes(NamedTuple):
    """Modes in ascending order.

    `omega` (modes): natural frequencies, rad/s, 0 of rigid-body modes; `damping` (modes): modal damping
    ratios, 0 of rigid-body modes; `shapes` (n x modes): normed to unit modal mass.
    """

    omega: Array
    damping: Array
    shapes: Array


@guarded("the modes of the structure")
def modes(M: Array, C: Array, K: Array) -> Modes:
    """Solve ``K phi = omega^2 M phi``.

    The damping ratio of a mode is ``phi^T C phi / (2 omega)``, the diagonal of the modal damping matrix;
    it is the exact one where damping is proportional.

    Parameters
    ----------
    M, C, K
        Mass (positive definite), damping and stiffness (n x n).

    Raises
    ------
    Singular
        If the stiffness is indefinite beyond rounding, so that a frequency is imaginary.
    """
    from scipy.linalg import eigh  # heavy import, needed here only

    square, shapes = eigh(K, M)
    # Rounding of K leaves rigid-body modes with |omega^2| of this size.
    tolerance = 100 * len(M) * np.finfo(float).eps * float(np.abs(square).max(initial=0.0))
    if square[0] < -tolerance:
        raise Singular(
            f"the stiffness matrix is indefinite (omega^2 = {square[0]:.3g})",
            remedy="The structure has no natural frequency there; check signs and units of the stiffness.",
        )
    rigid = square <= tolerance
    omega = np.sqrt(np.where(rigid, 0.0, square))
    dissipation = np.einsum("im,ij,jm->m", shapes, C, shapes)
    damping = np.where(rigid, 0.0, dissipation / (2 * np.where(rigid, 1.0, omega)))
    return Modes(omega, damping, shapes)
