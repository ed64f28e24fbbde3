"""Free responses of many channels in the decays that they share.

The derivative of every channel by the first state is a combination of the decays of the poles. These are
factorised once, D = Q R, and a fit projects each channel onto Q, instead of factorising derivatives anew for
every channel. A = V diag(poles) V^-1 has to be diagonalisable: errors are rounding times the condition of V.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynid.arrays import Array
from dynid.defaults import SHARED_DECAYS
from dynid.identification.least_squares import tall_qr
from dynid.identification.systems.parametric_model import ParametricModel

# Condition of the eigenvectors up to which they are used: ten digits are left.
_MAX_CONDITION = 1e6


@dataclass(frozen=True, eq=False)
class FreeDecays:
    """Decays (times x n), and the derivatives of channels by the first state as combinations of them."""

    columns: Array  # the decays
    weights: Array  # of the decays in the derivatives of each channel (channels x n x n)

    @cached_property
    def factors(self) -> tuple[Array, Array]:
        """The factors Q (times x n) and R (n x n) of the decays."""
        return tall_qr(self.columns)

    def by_state(self, channel: int) -> Array:
        """Return the derivatives of a channel by the first state (times x n)."""
        return np.asarray(self.columns @ self.weights[channel])


def are_many(model: ParametricModel) -> bool:
    """Return True if the free responses of a model are so many that sharing decays is worth it."""
    return len(model.channels) * len(model.times) * model.states**2 >= SHARED_DECAYS.value


def free_decays(model: ParametricModel, eta: Array) -> FreeDecays | None:
    """Return the free responses of a model at coordinates (p); None where they are few, or ill-conditioned.

    The channels are sampled at the times of the model.
    """
    n = model.states
    if not are_many(model):
        return None
    C = model.output(eta)[0]
    poles, V = np.linalg.eig(model.at(eta).A)
    with np.errstate(all="ignore"):
        if not np.linalg.cond(V) < _MAX_CONDITION:
            return None
        upper = poles.imag >= 0
        passed = model.times - model.line.nodes[0]
        ends = np.where(poles.real > 0, passed[-1], 0.0)[upper]  # growing ones are scaled to their end
        decays = np.exp(poles[upper] * (passed[:, None] - ends))
        residues = (C @ V[:, upper])[:, :, None] * np.linalg.inv(V)[upper]
        residues = residues * (np.exp(poles[upper] * ends) * np.where(poles[upper].imag > 0, 2, 1))[:, None]
    real = np.stack([np.ones(len(ends)), poles[upper].imag != 0], axis=1).astype(bool).ravel()
    columns = np.ascontiguousarray(decays).view(float)[:, real]
    weights = np.stack([residues.real, -residues.imag], axis=2).reshape(len(C), -1, n)[:, real]
    if columns.shape[1] != n or not (np.isfinite(columns).all() and np.isfinite(weights).all()):
        return None
    return FreeDecays(columns, weights)
