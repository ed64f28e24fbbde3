"""What an estimator is, and what it returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.identification.filter import Pass
from dynid.identification.fit import Fit, Fitter

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stage:
    """One attempt of an estimator.

    Attributes
    ----------
    name
        What was done.
    fits
        The fits on the way, the last one its result.
    """

    name: str
    fits: Sequence[Fit]

    @property
    def fit(self) -> Fit:
        """Its result."""
        return self.fits[-1]


@dataclass(frozen=True, eq=False)
class Estimation:
    """What an estimator found.

    Attributes
    ----------
    fit
        The estimate.
    histories
        The passes over the record, in order; none where the estimator takes the record as a whole.
    stages
        What was tried, in order.
    facts
        What else is worth knowing of the work, by name.
    """

    fit: Fit
    histories: Sequence[Pass]
    stages: Sequence[Stage]
    facts: Mapping[str, int] = field(default_factory=dict)


class Estimator(Protocol):
    """A way to estimate."""

    @property
    def name(self) -> str:
        """Its name in a scene."""

    def run(self, fitter: Fitter, origin: Array) -> Estimation:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        Diverged
            If estimates run away.
        """
