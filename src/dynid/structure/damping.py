"""Damping from mass and stiffness: proportional, given ratios of the modes, or structural (hysteretic).

Modal damping ``C = P G P^T`` has P = M Phi, Phi^T M Phi = I and G = diag(2 zeta omega). As mass and stiffness
change by m = Phi^T dM Phi and k = Phi^T dK Phi, ``dPhi = Phi E`` with E_ij = (k_ij - omega_j^2 m_ij) /
(omega_j^2 - omega_i^2), E_ii = -m_ii/2 (R. L. Fox, M. P. Kapoor, AIAA J. 6 (1968) 2426–2429), dP = -P E^T
and dC = P X P^T, X = dG - E^T G - G E. With the divided differences taken in closed form,

    X_ij = (zeta_i + zeta_j) (k_ij + omega_i omega_j m_ij) / (omega_i + omega_j)
         + (zeta_j - zeta_i) (k_ij - omega_i omega_j m_ij) / (omega_j - omega_i)
         + 2 dzeta_i omega_i delta_ij,

which holds on the diagonal and for multiple frequencies of one ratio as well.

A loss factor eta makes ``H = sum eta_e K_e``, a dissipation that does not depend on the frequency. It holds
at positive frequencies: its motion in time is not causal (S. H. Crandall, J. Sound Vib. 11 (1970) 3–18).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real, evaluated
from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError, UsageError
from dynid.number_format import counted
from dynid.structure.matrices import DependentMatrix, Matrix, as_array

if TYPE_CHECKING:
    from dynid.structure.joints import Joint

_MOST_MODAL = 3000
# Frequencies nearer to each other than this part of their size are one.
_FREQUENCY_TOL = 1e-9
# Energy of a change in a motion, relative to the terms that it is summed of, that is rounding.
_ENERGY_TOL = 1e-7


@dataclass(frozen=True)
class ProportionalDamping:
    """``C = alpha M + beta K`` (Rayleigh), alpha in 1/s, beta in s; structural damping ``H = eta K``.

    `viscous_at`: the frequency, rad/s, at which dampers ``H / omega`` stand for structural damping, that of
    elements and joints too; default: none do.
    """

    alpha: Real = 0.0
    beta: Real = 0.0
    eta: Real = 0.0
    viscous_at: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("alpha", self.alpha), ("beta", self.beta), ("eta", self.eta)):
            if not (math.isfinite(float(value)) and float(value) >= 0):
                raise UsageError(f"{name} of the damping must be finite and not negative")

    def of(self, M: DependentMatrix, K: DependentMatrix) -> tuple[DependentMatrix, tuple[()]]:
        """Return C, which depends on parameters by its terms alone."""
        return (M.times(self.alpha) + K.times(self.beta)).merged(), ()


@dataclass(frozen=True)
class ModalDamping:
    """``C = M Phi diag(2 zeta omega) Phi^T M``: a ratio for all modes, or a list from the lowest mode on.

    Modes beyond the list are undamped; rigid-body modes count, but have no damping.
    """

    ratio: Real | Sequence[Real]

    def __post_init__(self) -> None:
        values = np.array([float(ratio) for ratio in self._listed])
        if not np.all(np.isfinite(values) & (values >= 0)):
            raise UsageError("damping ratios must be finite and not negative")

    @property
    def _listed(self) -> list[Real]:
        return list(self.ratio) if isinstance(self.ratio, Sequence | np.ndarray) else [self.ratio]

    def of(self, M: DependentMatrix, K: DependentMatrix) -> tuple[DependentMatrix, tuple[ModalPart, ...]]:
        """Return C, and what it depends on otherwise than by its terms: the modes, where M or K do."""
        C = self.matrix(M.reference, K.reference)
        if M.terms or K.terms:
            return DependentMatrix(C), (ModalPart(self, M, K),)
        if not any(isinstance(ratio, Dependent) for ratio in self._listed):
            return DependentMatrix(C), ()
        omega, momentum = _all_modes(as_array(M.constant), as_array(K.constant))
        total = DependentMatrix(np.zeros_like(C))
        for which, ratio in self._of_modes(len(omega)):
            pattern = (momentum[:, which] * (2 * omega[which])) @ momentum[:, which].T
            total = total + DependentMatrix((pattern + pattern.T) / 2).times(ratio)
        return total.merged(), ()

    def matrix(self, M: Matrix, K: Matrix, values: Mapping[str, float] | None = None) -> Array:
        """Return C (n x n); `values` of the parameters on which the ratios depend, default: reference values.

        Raises UsageError if there are too many DOFs to solve for all modes, or fewer modes than ratios.
        """
        n = int(M.shape[0])
        if n > _MOST_MODAL:
            raise UsageError(
                f"modal damping takes all modes, which {n} DOFs are too many for",
                remedy="Use alpha and beta.",
            )
        omega, momentum = _all_modes(as_array(M), as_array(K))
        zeta = np.zeros(len(omega))
        for which, ratio in self._of_modes(len(omega)):
            zeta[which] = evaluated(ratio, values or {}).value
        C = (momentum * (2 * zeta * omega)) @ momentum.T
        return np.asarray((C + C.T) / 2)

    def _of_modes(self, count: int) -> list[tuple[slice, Real]]:
        """Return the ratios with the modes, of `count`, that have them."""
        if not isinstance(self.ratio, Sequence | np.ndarray):  # one for all
            return [(slice(None), self._listed[0])]
        if len(self._listed) > count:
            raise UsageError(f"{counted(len(self._listed), 'damping ratio')} for {counted(count, 'mode')}")
        return [(slice(at, at + 1), ratio) for at, ratio in enumerate(self._listed)]

    def slopes(self, M: DependentMatrix, K: DependentMatrix, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the derivatives of C (n x n) by the values of parameters, by name.

        Raises UsageError where C has no derivative as a rigid-body mode gets stiffness, or a massless motion
        gets mass, and NumericalError where modes of one frequency have different ratios.
        """
        mass, stiffness = as_array(M.at(values)), as_array(K.at(values))
        from dynid.structure.modes.modes import modes

        found_modes = modes(mass, np.zeros_like(mass), stiffness, backend="dense")
        omega, shapes = found_modes.omega, found_modes.shapes
        momentum = mass @ shapes
        r = len(omega)
        zeta, X = np.zeros(r), dict[str, Array]()
        for which, ratio in self._of_modes(r):
            ratio_value = evaluated(ratio, values)
            zeta[which] = ratio_value.value
            for name, slope in ratio_value.slopes.items():
                X.setdefault(name, np.zeros((r, r)))[which, which] += np.diag(2 * slope * omega[which])
        changes = {
            letter: [
                (coefficient.at(values).slopes, _modal(pattern, shapes, momentum, letter))
                for coefficient, pattern in matrix.terms
            ]
            for letter, matrix in (("M", M), ("K", K))
        }
        for name in {name for terms in changes.values() for slopes, _ in terms for name in slopes}:
            m, k, size = np.zeros((r, r)), np.zeros((r, r)), np.zeros(r)
            for slopes, (momentum_change, _) in changes["M"]:
                m += slopes.get(name, 0.0) * momentum_change
            for slopes, (momentum_change, parts) in changes["K"]:
                k += slopes.get(name, 0.0) * momentum_change
                size += abs(slopes.get(name, 0.0)) * parts
            X[name] = X.get(name, np.zeros((r, r))) + _moved(omega, zeta, k, m, size)
        found_slopes = {name: momentum @ x @ momentum.T for name, x in X.items()}
        return {name: (slope + slope.T) / 2 for name, slope in found_slopes.items()}


@dataclass(frozen=True, eq=False)
class ModalPart:
    """Modal damping of a structure whose mass or stiffness depends on parameters.

    `damping`: the ratios; `M`, `K`: mass and stiffness (N x N), without joints; `T`: the basis (N x n) of a
    reduced model; default: unity.
    """

    damping: ModalDamping
    M: DependentMatrix
    K: DependentMatrix
    T: Array | None = None

    @property
    def names(self) -> frozenset[str]:
        """The names of the parameters that it depends on."""
        ratios = [ratio for ratio in self.damping._listed if isinstance(ratio, Dependent)]
        numbers = [*ratios, *(coefficient for coefficient, _ in (*self.M.terms, *self.K.terms))]
        return frozenset().union(*(number.names for number in numbers))

    def projected(self, T: Array) -> ModalPart:
        """Return the part in coordinates q with ``x = T q``."""
        return replace(self, T=T if self.T is None else self.T @ T)

    def change(self, values: Mapping[str, float]) -> Array:
        """Return the change of C (n x n) from the reference values of the parameters."""
        C = self.damping.matrix(self.M.at(values), self.K.at(values), values)
        return self._seen(C - self.damping.matrix(self.M.reference, self.K.reference))

    def slopes(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the derivatives of C (n x n) by the values of parameters, as `ModalDamping.slopes`."""
        matrix_slopes = self.damping.slopes(self.M, self.K, values)
        return {name: self._seen(slope) for name, slope in matrix_slopes.items()}

    def _seen(self, C: Array) -> Array:
        return C if self.T is None else np.asarray(self.T.T @ C @ self.T)


def _modal(pattern: Matrix, shapes: Array, momentum: Array, letter: str) -> tuple[Array, Array]:
    """Return a pattern in modal coordinates (r x r), and the size of the terms of its diagonal (r)."""
    product = np.asarray(pattern @ shapes)
    modal = shapes.T @ product
    if letter == "M" and shapes.shape[1] < len(shapes):
        residual = product - momentum @ modal
        if np.abs(residual).max(initial=0.0) > _ENERGY_TOL * np.abs(product).max(initial=0.0):
            raise UsageError(
                "modal damping has no derivative by a mass that is unknown where there is none",
                remedy="Give a mass that is not 0 to start from.",
            )
    return modal, np.einsum("ij,ij->j", np.abs(shapes), np.asarray(abs(pattern) @ np.abs(shapes)))


def _moved(omega: Array, zeta: Array, k: Array, m: Array, size: Array) -> Array:
    """Return X (r x r) of the module for constant ratios; `size`: that of the terms of k's diagonal (r)."""
    rigid = omega == 0
    if np.any(rigid) and np.any((np.abs(np.diag(k)) > _ENERGY_TOL * size) & rigid & (zeta > 0)):
        raise UsageError(
            "modal damping has no derivative where a rigid-body mode gets stiffness",
            remedy="Start from a stiffness that is not 0, or use alpha and beta.",
        )
    both, product = np.add.outer(omega, omega), np.multiply.outer(omega, omega)
    gap, apart = np.subtract.outer(omega, omega).T, np.subtract.outer(zeta, zeta).T
    still = both <= 0
    X = np.where(still, 0.0, np.add.outer(zeta, zeta) * (k + product * m) / np.where(still, 1.0, both))
    different = (apart != 0) & ~still
    if np.any(different & (np.abs(gap) <= _FREQUENCY_TOL * both)):
        raise NumericalError(
            "modal damping has no derivative where modes of one frequency have different damping ratios",
            remedy="Give these modes one ratio.",
        )
    return np.asarray(X + np.where(different, apart * (k - product * m) / np.where(different, gap, 1.0), 0.0))


def _all_modes(M: Array, K: Array) -> tuple[Array, Array]:
    """Return all finite natural frequencies and ``M Phi``, mass possibly singular, rigid bodies possible.

    Solved as ``M phi = mu (K + s M) phi``, mu = 1 / (omega^2 + s): massless motions have mu = 0.
    """
    from scipy.linalg import eigh  # heavy import, needed here only

    size = np.sqrt(np.where(np.diag(K) > 0, np.diag(K), 1.0))
    mass, stiffness = M / size / size[:, None], K / size / size[:, None]
    # Small beside any elastic mode, so that those lose no digits; large enough to carry rigid bodies.
    shift = 1e-6 * float(np.trace(stiffness)) / max(float(np.trace(mass)), np.finfo(float).tiny) / len(M)
    mu, shapes = eigh(mass, stiffness + shift * mass)
    there = mu > 1e-12 * mu[-1]
    mu, shapes = mu[there][::-1], shapes[:, there][:, ::-1]
    square = 1 / mu - shift
    omega = np.sqrt(np.where(square > 1e-6 * shift, square, 0.0))
    momentum = mass @ shapes / np.sqrt(mu)
    return omega, np.asarray(momentum * size[:, None])


REMEDY = (
    "Let dampers eta k / omega of one frequency stand for it, `damping: {equivalent: {at: 40, unit: Hz}}` "
    "under `lumped`, `beam` or whatever the structure is, or write c or damping ratios instead of eta."
)
"""What to do where structural damping has no meaning."""


def not_causal(what: str) -> UsageError:
    """Return the error about structural damping where a causal structure is needed."""
    return UsageError(
        f"structural damping (eta) holds at positive frequencies only, and is not causal: it has no {what}",
        remedy=REMEDY,
        names=("structure",),
    )


def not_positive() -> UsageError:
    """Return the error about structural damping at the frequency 0."""
    return UsageError(
        "structural damping (eta) holds at positive frequencies only: it has no static response",
        remedy="Leave the frequency 0 out.",
        names=("analysis.frequency", "measurement.frf", "frequency"),
    )


def viscous(joints: Iterable[Joint], omega: float) -> tuple[Joint, ...]:
    """Return joints whose loss factors act as dampers eta k / omega."""
    return tuple(replace(joint, viscous_at=omega) if joint.eta is not None else joint for joint in joints)


def damping_ratio(loss_factor: Array) -> Array:
    """Return the damping ratio of a pole, sin(atan(eta)/2), whose square is (1 + i eta) omega^2."""
    return np.asarray(np.sin(np.arctan(loss_factor) / 2))


def loss_factors(poles: ComplexArray) -> Array:
    """Return the loss factors eta = Im(mu) / Re(mu) of poles lambda, mu = -lambda^2."""
    square = -(np.asarray(poles) ** 2)
    return np.asarray(square.imag / square.real)
