"""Poles of increasing orders by the polyreference least-squares complex frequency-domain method (pLSCF).

Right matrix fraction with complex coefficients in ``z = exp(i omega T)``, the band mapped to nearly the full
circle. With the lowest coefficient as the identity spurious poles are unstable, so those that remain are
physical. Source: P. Guillaume et al., *Proc. IMAC XXI* 2003; B. Cauberghe, thesis, VUB 2004.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.arrays import ComplexArray
from dynid.modal.frf_matrix import FrfMatrix

# Part by which the circle is wider than the band, so that its ends are no neighbours.
_WIDER = 1.03
# Roots in 1/z below this magnitude are of a vanishing highest coefficient.
_VANISHING_ROOT = 1e-8


def poles_by_order(frf: FrfMatrix, orders: Sequence[int]) -> list[ComplexArray]:
    """Return the poles (rad/s) of denominators of increasing orders; each has order x references."""
    highest, references = orders[-1], frf.values.shape[2]
    omega = frf.omega
    T = 2 * np.pi / ((omega[-1] - omega[0]) * _WIDER)
    M = _normal_matrix(frf, np.exp(1j * (omega - omega[0]) * T), highest)
    return [_poles(M[: (n + 1) * references, : (n + 1) * references], n, T, omega[0]) for n in orders]


def _normal_matrix(frf: FrfMatrix, z: ComplexArray, order: int) -> ComplexArray:
    """Return the reduced normal matrix of the denominator's coefficients, numerators eliminated."""
    lines, responses, references = frf.values.shape
    powers = z[None, :] ** np.arange(-order, order + 1)[:, None]
    # Residual of response o: (numerator row - H_o A) / sigma; sigma is one for all references of a response.
    weight = np.sqrt(np.mean(frf.weights**2, axis=2))
    values = np.where(frf.weights > 0, frf.values, 0.0) * weight[:, :, None]
    size = order + 1
    # Entry (j, k) of a normal matrix is the moment of power k - j of z.
    at = order + np.arange(size)[None, :] - np.arange(size)[:, None]
    M = np.zeros((size * references, size * references), dtype=complex)
    for o in range(responses):
        w, H = weight[:, o], values[:, o]
        R = (powers @ (w**2 + 0j))[at]
        S = -(powers @ (w[:, None] * H))[at].reshape(size, size * references)
        products = (H.conj()[:, :, None] * H[:, None, :]).reshape(lines, -1)
        Q = (powers @ products).reshape(-1, references, references)[at]
        M += Q.transpose(0, 2, 1, 3).reshape(M.shape) - S.conj().T @ np.linalg.solve(_ridged(R), S)
    return M


def _poles(M: ComplexArray, order: int, T: float, start: float) -> ComplexArray:
    """Return the poles of the denominator that minimises its normal matrix, lowest coefficient I."""
    references = len(M) // (order + 1)
    higher = -np.linalg.solve(_ridged(M[references:, references:]), M[references:, :references])
    # In u = 1/z: u^n I + u^(n-1) A_1 + … + A_n, monic.
    companion = np.zeros((order * references, order * references), dtype=complex)
    companion[:-references, references:] = np.eye((order - 1) * references)
    coefficients = higher.reshape(order, references, references)[::-1]
    companion[-references:] = -coefficients.transpose(1, 0, 2).reshape(references, -1)
    roots = np.linalg.eigvals(companion)
    logarithm = np.log(1 / roots[np.abs(roots) > _VANISHING_ROOT])
    return np.asarray((logarithm.real + 1j * (logarithm.imag % (2 * np.pi))) / T + 1j * start)


def _ridged(matrix: ComplexArray) -> ComplexArray:
    """Return a normal matrix with round-off of its trace on the diagonal: singular ones are of exact data."""
    return np.asarray(matrix + np.finfo(float).eps * np.trace(matrix).real * np.eye(len(matrix)))
