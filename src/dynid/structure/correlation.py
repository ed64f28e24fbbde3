"""Correlation of a reduced model with the full one: frequencies, shapes, responses, energies.

Sources: R. J. Allemang, *Sound and Vibration* 37 (2003) 14–23 (MAC); W. Heylen & S. Lammens, *Proc. Int.
Conf. Identification in Engineering Systems* 1996 (FRAC).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix
from dynid.structure.model import StructuralModel

# Frequencies closer than this, relative, are one multiple frequency to double precision.
_MULTIPLE = 1e-8
# Frequencies below this part of the lowest measured one are those of rigid-body modes, which cost this much.
_ELASTIC, _NEVER = 1e-3, 1e3


def frequency_error(frequencies: Array, reference: Array) -> Array:
    """Return ``frequencies / reference - 1``; of rigid-body modes over the lowest elastic frequency.

    `frequencies`, `reference`: natural frequencies (r), rad/s.
    """
    elastic = reference[reference > 0]
    size = np.where(reference > 0, reference, elastic.min() if len(elastic) else 1.0)
    return np.asarray((frequencies - reference) / size)


def mac(a: NDArray[np.inexact], b: NDArray[np.inexact]) -> Array:
    """Return the modal assurance criterion ``|a^H b|^2 / (a^H a) (b^H b)`` of all pairs (columns of a x b).

    `a`, `b`: mode shapes (n x r, n x s), or stacks of them; a shape that is zero agrees with none.
    """
    size = np.linalg.norm(a, axis=-2)[..., None] * np.linalg.norm(b, axis=-2)[..., None, :]
    cosine = np.abs(a.conj().swapaxes(-1, -2) @ b) / np.where(size > 0, size, 1.0)
    return np.asarray(np.minimum(cosine, 1.0) ** 2)


def complexity(shapes: NDArray[np.inexact]) -> Array:
    """Return what no phase makes real of each shape: the norm of its imaginary part over its own.

    0 for a shape of one phase, as of a normal mode; at most 0.71. The phase is that of the sum of squares,
    which makes the real part largest.

    `shapes`: mode shapes (n x r); NaN where a component is missing.
    """
    filled = np.nan_to_num(shapes)
    turned = filled * np.exp(-0.5j * np.angle(np.sum(filled**2, axis=0)))
    size = np.linalg.norm(filled, axis=0)
    return np.asarray(np.linalg.norm(turned.imag, axis=0) / np.where(size > 0, size, 1.0))


def frac(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> Array:
    """Return the frequency response assurance criterion of each response (… of omega x …).

    ``|sum a conj(b)|^2 / (sum |a|^2 sum |b|^2)`` over the frequencies; two responses of zero agree. Where
    either is infinite, at an undamped pole, it is left out.

    `a`, `b`: responses (omega x …), of one shape.
    """
    finite = np.isfinite(a) & np.isfinite(b)
    a, b = (np.where(finite, values, 0.0) for values in (a, b))
    a, b = (values / np.where((size := np.abs(values).max(axis=0)) > 0, size, 1.0) for values in (a, b))
    cross = np.abs((a * b.conj()).sum(axis=0)) ** 2
    size = (np.abs(a) ** 2).sum(axis=0) * (np.abs(b) ** 2).sum(axis=0)
    same = np.all(a == b, axis=0)
    return np.asarray(np.where(size > 0, np.minimum(cross / np.where(size > 0, size, 1.0), 1.0), same))


def orthogonality(a: Array, M: Matrix, b: Array) -> Array:
    """Return the cross-orthogonality ``|a^T M b|`` of shapes, or of stacks, of unit modal mass (r x s)."""
    Ma, Mb = np.asarray(M @ a), np.asarray(M @ b)
    size = np.sqrt((a * Ma).sum(axis=-2)[..., None] * (b * Mb).sum(axis=-2)[..., None, :])
    return np.asarray(np.abs(a.swapaxes(-1, -2) @ Mb) / np.where(size > 0, size, 1.0))


def counterparts(shapes: Array, places: NDArray[np.int64], full: Array, omega: Array, M: Matrix) -> Array:
    """Return the full modes that correspond to reduced ones; of a multiple frequency they are rotated.

    `shapes`: shapes of the reduced model at all DOFs (n x r); `places`: indices of the full modes they stand
    for (r), ascending; `full`, `omega`: shapes (n x s) and frequencies (s) of the full model, normed to unit
    modal mass; `M`: mass (n x n).

    It returns modes (n x r): of each multiple frequency those nearest to the reduced ones.
    """
    out = full[:, places].copy()
    ends = np.flatnonzero(np.diff(omega) > _MULTIPLE * omega[1:]) + 1
    for group in np.split(np.arange(len(omega)), ends):
        mine = np.flatnonzero(np.isin(places, group))
        if len(group) > 1 and len(mine):
            cross = full[:, group].T @ np.asarray(M @ shapes[:, mine])
            left, _, right = np.linalg.svd(cross, full_matrices=False)
            out[:, mine] = full[:, group] @ (left @ right)
    return out


def energy_shares(
    model: StructuralModel,
    shapes: Array,
    omega: Array,
    parts: Mapping[str, Sequence[Label]] | None = None,
) -> tuple[list[str], Array]:
    """Return names of substructures and joints, and their shares in modes' potential energy (r x parts).

    The energy of the DOFs i of a substructure is ``sum x_i (K x)_i``, so that all of them add up. Joints come
    after the substructures; shares are zero in a rigid-body mode.

    `shapes`, `omega`: shapes at all DOFs (n x r), normed to unit modal mass, and their frequencies (r),
    rad/s; `parts`: substructures: name and DOFs; default: all is the one ``structure``. The remaining DOFs
    are ``rest``.
    """
    by_dof = shapes * np.asarray(model.K @ shapes)
    sets = {name: [model.index(dof) for dof in dofs] for name, dofs in (parts or {}).items()}
    left = np.setdiff1d(np.arange(model.size), [k for places in sets.values() for k in places])
    if len(left):
        sets["rest" if parts else "structure"] = left.tolist()
    energies = {name: by_dof[places].sum(axis=0) for name, places in sets.items()}
    for joint in model.joints:
        ends = np.array([model.row(dof) for dof in joint.dofs]) @ shapes
        energies[joint.name] = np.zeros(len(omega))
        for term in joint.terms:
            if term.letter == "k":
                strain = np.einsum("ir,ij,jr->r", ends, term.block, ends)
                energies[joint.name] += float(term.parameter.value or 0.0) * strain
    total = np.where(omega > 0, omega, np.inf) ** 2
    return list(energies), np.array(list(energies.values())).T / total[:, None]


def paired(table: Array, measured: Array, omega: Array) -> NDArray[np.int_]:
    """Return the modes of a model that measured modes are paired with (r), each with another one.

    The sum over pairs of ``1 - MAC + ln^2(omega ratio)`` is least.

    `table`: MAC of measured and computed shapes (r x m); rows of zeros where no shape is known; `measured`,
    `omega`: natural frequencies, measured (r) and computed (m), m >= r.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    elastic = omega > _ELASTIC * measured.min()
    ratio = np.log(np.where(elastic, omega, 1.0) / measured[:, None])
    cost = 1 - table + np.where(elastic, ratio**2, _NEVER)
    return np.asarray(min_weight_full_bipartite_matching(csr_array(cost + 1))[1])  # weights are not 0


def comac(a: NDArray[np.inexact], b: NDArray[np.inexact]) -> Array:
    """Return the coordinate MAC of each sensor over paired shapes: ``(sum |a b|)^2 / (sum |a|^2 sum |b|^2)``.

    Source: N. A. J. Lieven, D. J. Ewins, *Proc. IMAC VI* 1988, 690–695. It depends on the scales of the
    shapes, which must be those that make pairs agree.

    `a`, `b`: paired shapes (s x r), NaN where one is missing; a sensor without motion has NaN.
    """
    there = ~(np.isnan(a) | np.isnan(b))
    a, b = np.where(there, a, 0.0), np.where(there, b, 0.0)
    size = (np.abs(a) ** 2).sum(axis=1) * (np.abs(b) ** 2).sum(axis=1)
    cross = np.abs(a * b).sum(axis=1) ** 2
    return np.asarray(np.where(size > 0, np.minimum(cross / np.where(size > 0, size, 1.0), 1.0), np.nan))
