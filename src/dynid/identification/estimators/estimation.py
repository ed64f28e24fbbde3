"""What an estimator is, and what it returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.identification.ensemble import Ensemble, JointFit
from dynid.identification.filtering.filter import Pass

Array = NDArray[np.float64]

Sweep: TypeAlias = Sequence[Pass]
"""One pass over each record, in order."""


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
    fits: Sequence[JointFit]

    @property
    def fit(self) -> JointFit:
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
        The sweeps over the records, in order; none where the estimator takes each record as a whole.
    stages
        What was tried, in order.
    facts
        What else is worth knowing of the work, by name.
    """

    fit: JointFit
    histories: Sequence[Sweep]
    stages: Sequence[Stage]
    facts: Mapping[str, int] = field(default_factory=dict)


class Estimator(Protocol):
    """A way to estimate."""

    @property
    def name(self) -> str:
        """Its name in a scene."""

    def run(self, ensemble: Ensemble, origin: Array) -> Estimation:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        Diverged
            If estimates run away.
        """
