"""Structural (hysteretic) damping K + i H: where it has no meaning, and dampers that stand for it.

A loss factor eta makes ``H = sum eta_e K_e``, a dissipation that does not depend on the frequency. It holds
at positive frequencies: its motion in time is not causal (S. H. Crandall, J. Sound Vib. 11 (1970) 3–18).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError

if TYPE_CHECKING:
    from dynid.structure.joints import Joint

REMEDY = (
    "Let dampers eta k / omega of one frequency stand for it, `damping: {equivalent: {at: 40, unit: Hz}}`, "
    "or write c or damping ratios instead of eta."
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
