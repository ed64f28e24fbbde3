"""The frequency response exactly at an undamped pole: infinite, or the limit where the mode is not in it.

Around s0 = j omega the equations are Z(s) = Z0 + Z1 (s - s0) + Z2 (s - s0)^2. With the null vectors V of Z0
on the right and U on the left, Z(s)^-1 begins with V D^-1 U^H / (s - s0)^q, where D = U^H Zq V is the first
of U^H Z1 V and U^H Z2 V that does not vanish. A channel that this term reaches is infinite, but at rest,
where motions count as powers of s. In the others the next term is finite.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Singular

Array = NDArray[Any]
ComplexArray = NDArray[np.complex128]

#: Singular values below this part of the largest belong to a pole.
_NULL = 1e-14
#: What is less than the first times the noise of a null vector is nothing, what is more than the second not.
_NOTHING, _SOMETHING = 30.0, 3e3


def at_a_pole(
    Z: tuple[Array, Array, Array],
    left: Array,
    right: Array,
    powers: NDArray[np.int64],
    omega: float,
) -> ComplexArray:
    """Return ``s^power left Z(s)^-1 right`` as s goes to a pole at j omega.

    Parameters
    ----------
    Z
        Z0, Z1 and Z2 (n x n), scaled so that their entries have similar sizes.
    left, right
        Read-outs (outputs x n) and inputs (n x inputs).
    powers
        The power of s of every output.
    omega
        The frequency, rad/s.

    Returns
    -------
    ComplexArray
        The response (outputs x inputs), inf where it is infinite.

    Raises
    ------
    Singular
        Where double precision cannot tell what is infinite.
    """
    Z0, Z1, Z2 = Z
    U, sizes, Vh = np.linalg.svd(Z0)
    kept = sizes > _NULL * sizes[0] if sizes[0] > 0 else np.zeros(len(sizes), dtype=bool)
    if kept.all():
        raise on_a_pole(omega)
    noise = np.finfo(float).eps * len(Z0) * (sizes[0] / sizes[kept][-1] if kept.any() else 1.0)
    V, Uh = Vh[~kept].conj().T, U[:, ~kept].conj().T
    Zq, order = (Z1, 1) if _matters(Uh @ Z1 @ V, Z1, noise) else (Z2, 2)
    D = Uh @ Zq @ V
    if (order == 2 and omega > 0) or not np.linalg.cond(D) < 1 / noise:
        raise on_a_pole(omega)
    reach, drive = left @ V, np.linalg.solve(D, Uh @ right)
    driven = _driven(reach, drive, D, left, right, noise, omega)
    inverse = (Vh[kept].conj().T / sizes[kept]) @ U[:, kept].conj().T
    beside = right - Zq @ (V @ drive)
    limit = (left - np.linalg.solve(D.T, reach.T).T @ (Uh @ Zq)) @ (inverse @ beside)
    if omega > 0:
        response = (1j * omega) ** powers[:, None] * limit
        return np.where(driven, complex(np.inf), response)
    # At rest s^power meets s^-order.
    net = powers[:, None] - order
    response = np.where(powers[:, None] == 0, limit, 0)
    response = np.where(driven & (net == 0), reach @ drive, response)
    return np.asarray(np.where(driven & (net < 0), complex(np.inf), response))


def _matters(part: Array, of: Array, noise: float) -> bool:
    return bool(np.abs(part).max() > _NOTHING * noise * np.abs(of).max())


def _driven(
    reach: Array, drive: Array, D: Array, left: Array, right: Array, noise: float, omega: float
) -> NDArray[np.bool_]:
    """Return which channels the modes at the pole are in (outputs x inputs)."""
    smallest = np.linalg.svd(D, compute_uv=False)[-1]
    whole = np.linalg.norm(left, axis=1)[:, None] * np.linalg.norm(right, axis=0) / smallest
    part = np.abs(reach @ drive) / np.where(whole > 0, whole, 1.0)
    if np.any((part > _NOTHING * noise) & (part < _SOMETHING * noise)):
        raise on_a_pole(omega)
    return np.asarray(part >= _SOMETHING * noise)


def on_a_pole(omega: float) -> Singular:
    """Return the refusal of a frequency at which it cannot be told what is infinite."""
    return Singular(
        f"the frequency response at {omega:.12g} rad/s: that frequency lies on an undamped pole, or so near "
        "that double precision does not tell which responses are infinite there",
        remedy="Leave that frequency out, or give the system some damping.",
    )
