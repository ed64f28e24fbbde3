"""What an estimator is, and what it returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.identification.ensemble import Ensemble, JointFit, Likelihood
from dynid.identification.filtering.filter import Pass

Array = NDArray[np.float64]

Sweep: TypeAlias = Sequence[Pass]
"""One pass over each record, in order."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One attempt of an estimator, without what is as long as the records.

    Attributes
    ----------
    name
        What was done.
    logs
        The logarithms that it came to (p).
    residual_ratio
        RMS of the residuals there over that of the measured values (channels of all records).
    misfit
        Minus the logarithm of the likelihood there, up to a constant.
    iterations
        Steps of a search.
    """

    name: str
    logs: Array
    residual_ratio: Array
    misfit: float
    iterations: int

    @classmethod
    def at(cls, name: str, ensemble: Likelihood, fit: JointFit, iterations: int = 0) -> Self:
        """Return the attempt that ended with a fit."""
        return cls(name, fit.logs, ensemble.residual_ratio(fit), ensemble.misfit(fit), iterations)


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
