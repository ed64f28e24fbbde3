"""Frequency response functions: by solving at every frequency, or on modes with residual vectors.

Both give ``(i omega)^p rows (K + i omega C - omega^2 M)^-1 forces``: receptance (p = 0), mobility (1) and
accelerance (2). The modes of the band, completed by what static solutions of forces and read-outs leave over
(residual vectors, D. J. Rixen, Proc. IMAC XIX (2001); of higher orders, as A. Y. T. Leung 1978), make a small
model that keeps the damping between them; vectors are added until the response stands.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array, ComplexArray
from dynid.defaults import DENSE_STRUCTURES, FEW_FREQUENCIES
from dynid.errors import DynidError, NumericalError, Singular, UsageError
from dynid.lti.frequency_response import WORST_CONDITION, on_a_pole, second_order_response
from dynid.structure.matrices import Matrix, as_array, is_sparse
from dynid.structure.modes.modes import modes
from dynid.structure.modes.pencil import scaled, times
from dynid.structure.ports import Ports
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.structure.backends import Factorisation
    from dynid.structure.modes.pencil import Pencil


METHODS = ("auto", "direct", "modal")
"""Methods to compute a response."""

# Up to this size a dense solution at every frequency is the simplest and the most accurate.
_DENSE = DENSE_STRUCTURES.value
# A bound on cost: up to this size a dense solution finds the infinite responses at an undamped pole.
_MOST_AT_A_POLE = 2000
# Modes are kept up to this multiple of the highest frequency: the remainder is then smooth in the
# band, and a few orders of residual vectors give it. They are added until the response stands in any case.
_BAND = 1.5
# A bound: each order shrinks the remainder to 1 / _BAND^2, so that 1e-8 takes half of them at the worst.
_MOST_ORDERS = 16
# The least part of a vector outside a basis that is not rounding.
_INDEPENDENT = 1e-9


_NOWHERE: Array = np.zeros(0)


class FrequencyResponse(NamedTuple):
    """A response (omega x output x input) and how it was found.

    `method` is direct or modal; `modes` is how many are kept, 0 of a direct solution, `vectors` the number of
    residual vectors beside them. `error` is relative to the sum of a channel's response and its median: of
    modal responses the larger of the last change and of the difference from a direct solution where that
    change was largest and at the highest frequency; 0 of direct ones, whose solutions are checked. `evaluate`
    returns the response at other frequencies of the band, and is None where every one of them would take a
    factorisation; `near` are natural frequencies, rad/s, about which it may be large.
    """

    response: ComplexArray
    method: str
    modes: int
    vectors: int
    error: float
    evaluate: Callable[[Array], ComplexArray] | None = None
    near: Array = _NOWHERE


def frequency_response_functions(
    M: Matrix,
    C: Matrix,
    K: Matrix,
    ports: Ports,
    omega: ArrayLike,
    *,
    method: str = "auto",
    accuracy: float = 1e-8,
    backend: str = "auto",
) -> FrequencyResponse:
    """Compute frequency response functions.

    `M`, `C`, `K`: mass, damping and stiffness (n x n), dense or sparse; a complex stiffness is that with
    structural damping, K + i H, at positive frequencies; `ports`: directions of forces and
    rows of outputs; `omega`: angular frequencies, rad/s; `method`: ``direct``; ``modal``; or ``auto``: modal
    where matrices are large and sparse and frequencies many; `accuracy`: relative error that is asked for of
    modal responses; `backend`: factorisation backend of modes and residual vectors.

    Raises Singular if a frequency lies on an undamped pole, and the responses that are infinite there are not
    determined, NumericalError if the accuracy is not reached by modes; a direct solution does, and UsageError
    if there is no such method.
    """
    w = np.atleast_1d(np.asarray(omega, dtype=float))
    if method not in METHODS:
        raise UsageError(
            f"there is no way {method!r} to a frequency response{did_you_mean(method, METHODS)}",
            remedy=f"Use one of {', '.join(METHODS)}.",
            names=(method,),
        )
    if method == "auto":
        large = is_sparse(K) and K.shape[0] > _DENSE
        method = "modal" if large and len(w) > FEW_FREQUENCIES.value and accuracy >= 1e-10 else "direct"
    if method == "direct":
        response = FrequencyResponse(direct(M, C, K, ports, w), method, 0, 0, 0.0)
        if is_sparse(K) and K.shape[0] > _DENSE:
            return response
        near = _NOWHERE
        with suppress(DynidError):  # then the natural frequencies are not known
            near = modes(M, C, _elastic(K), backend="dense").omega
        return response._replace(evaluate=partial(direct, M, C, K, ports), near=near)
    return _by_modes(M, C, K, ports, w, accuracy, backend)


def direct(M: Matrix, C: Matrix, K: Matrix, ports: Ports, omega: Array) -> ComplexArray:
    """Solve with the dynamic stiffness at every frequency.

    Raises Singular if a frequency lies on an undamped pole, and the responses that are infinite there are not
    determined.
    """
    if not is_sparse(K) or K.shape[0] <= _DENSE:
        return second_order_response(as_array(M), as_array(C), as_array(K), *ports, omega)
    out = np.empty((len(omega), len(ports.rows), ports.forces.shape[1]), dtype=complex)
    for at, w in enumerate(omega):
        try:
            X = _solved(M, C, K, ports.forces, float(w))
        except Singular:
            if K.shape[0] > _MOST_AT_A_POLE:
                raise
            out[at] = second_order_response(as_array(M), as_array(C), as_array(K), *ports, [w])[0]
        else:
            out[at] = (1j * w) ** np.array(ports.powers)[:, None] * (ports.rows @ X)
    return out


def _solved(M: Matrix, C: Matrix, K: Matrix, forces: Array, omega: float) -> Array | ComplexArray:
    """Return the displacements (n x inputs) at one frequency."""
    from scipy.sparse import csc_array

    from dynid.structure.backends import factorise

    damping = csc_array(C)
    Z = csc_array(K) - omega**2 * csc_array(M)
    if omega and damping.nnz:
        Z = Z + csc_array(1j * omega * damping.astype(complex))
    weight = np.abs(K.diagonal()) + omega**2 * np.abs(M.diagonal()) + omega * np.abs(C.diagonal())
    scale = np.exp2(np.round(-0.5 * np.log2(np.where(weight > 0, weight, 1.0))))
    Z = csc_array(Z)
    Z.data *= scale[Z.indices] * np.repeat(scale, np.diff(Z.indptr))
    try:
        factor = factorise(Z)
    except NumericalError:
        raise on_a_pole(omega) from None
    if factor.condition > WORST_CONDITION:
        raise on_a_pole(omega)
    return np.asarray(scale[:, None] * factor.solve(scale[:, None] * forces))


def _by_modes(
    M: Matrix, C: Matrix, K: Matrix, ports: Ports, omega: Array, accuracy: float, backend: str = "auto"
) -> FrequencyResponse:
    """Compute the response of the modes of the band with residual vectors."""
    from scipy.sparse import csc_array

    from dynid.structure.backends import factorise

    elastic = _elastic(K)
    pencil = scaled(csc_array(elastic), csc_array(M))
    basis = np.zeros((pencil.size, 0))
    near, limit = _NOWHERE, _BAND * float(omega.max(initial=0.0))
    if limit > 0:
        structure_modes = modes(
            M, C, elastic, below=limit, backend="dense" if pencil.size <= _DENSE else backend
        )
        near, basis = (
            structure_modes.omega,
            _orthonormal(structure_modes.shapes / pencil.scale[:, None], basis),
        )
    factor: Factorisation = factorise(csc_array(pencil.K + pencil.shift * pencil.M), backend, definite=True)
    block = factor.solve(pencil.scale[:, None] * np.column_stack([ports.forces, ports.rows.T]))
    before, change = _projected(M, C, K, ports, omega, pencil, basis), np.full(len(omega), np.inf)
    for _ in range(_MOST_ORDERS):
        new = _orthonormal(block, basis)
        basis = np.column_stack([basis, new])
        response = _projected(M, C, K, ports, omega, pencil, basis)
        change, before = _difference(response, before), response
        if change.max(initial=0.0) <= accuracy or not new.shape[1]:
            break
        block = factor.solve(times(pencil.M, new))
    error = float(change.max(initial=0.0))
    finite = np.isfinite(response).all(axis=(1, 2))  # what is infinite is so exactly
    if finite.any():  # compared with direct solutions at the highest frequency and at the worst one
        at = np.unique([int(np.argmax(np.where(finite, values, -1.0))) for values in (omega, change)])
        exact = response.copy()
        exact[at] = direct(M, C, K, ports, omega[at])
        error = max(error, float(_difference(exact, response).max(initial=0.0)))
    vectors = basis.shape[1] - len(near)
    if error > 10 * accuracy:
        raise NumericalError(
            f"the response of {len(near)} modes and {vectors} residual vectors has errors of {error:.1g}",
            remedy="Compute it by direct solution, or ask for less accuracy.",
        )

    def evaluate(others: Array) -> ComplexArray:
        return _projected(M, C, K, ports, others, pencil, basis)

    return FrequencyResponse(response, "modal", len(near), vectors, error, evaluate, near)


def _elastic(K: Matrix) -> Matrix:
    """Return a stiffness without its structural damping."""
    return K.real if np.iscomplexobj(K) else K


def _projected(
    M: Matrix, C: Matrix, K: Matrix, ports: Ports, omega: Array, pencil: Pencil, basis: Array
) -> ComplexArray:
    """Return the response of the model in a scaled basis."""
    T = pencil.scale[:, None] * basis
    small = [T.T @ times(matrix, T) for matrix in (M, C, K)]
    M_, C_, K_ = ((matrix + matrix.T) / 2 for matrix in small)
    if not T.shape[1]:
        return np.zeros((len(omega), len(ports.rows), ports.forces.shape[1]), dtype=complex)
    return second_order_response(M_, C_, K_, T.T @ ports.forces, ports.rows @ T, ports.powers, omega)


def _orthonormal(vectors: Array, basis: Array) -> Array:
    """Return an orthonormal extension of a basis by vectors; empty where they lie in its span."""
    size = np.linalg.norm(vectors, axis=0)
    new = vectors / np.where(size > 0, size, 1.0)
    for _ in range(2):
        new = new - basis @ (basis.T @ new)
        Q, values, _ = np.linalg.svd(new, full_matrices=False)
        new = Q[:, values > _INDEPENDENT]
    return np.asarray(new)


def _difference(values: ComplexArray, reference: ComplexArray) -> Array:
    """Return, by frequency, how far two responses differ at most, relative to the sizes of the channels."""
    infinite = np.isinf(values) & np.isinf(reference)
    values, reference = (np.where(infinite, 0.0, array) for array in (values, reference))
    size = np.abs(values) + np.median(np.abs(values), axis=0)
    with np.errstate(invalid="ignore"):
        differ = np.abs(values - reference) / np.where((size > 0) & np.isfinite(size), size, 1.0)
    return np.asarray(differ.max(axis=(1, 2), initial=0.0))
