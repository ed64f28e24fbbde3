"""Estimators and the estimate that they return."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, Self, TypeAlias

from dynid.arrays import Array
from dynid.identification.estimators.filter import Pass
from dynid.identification.likelihood.lack_of_fit import ModelComparison
from dynid.identification.likelihood.likelihood import Fit, Likelihood

Sweep: TypeAlias = Sequence[Pass]
"""One pass over each record, in order."""


@dataclass(frozen=True, eq=False)
class EstimationStage:
    """The end of one attempt of an estimator, without arrays that are as long as the records."""

    name: str  # name of the attempt
    eta: Array  # the coordinates that it ended with (p)
    # RMS of the residuals there over that of the measured values (channels of all records).
    residual_ratio: Array
    misfit: float  # minus the logarithm of the likelihood there, up to a constant
    iterations: int  # steps of a search

    @classmethod
    def at(cls, name: str, likelihood: Likelihood, fit: Fit, iterations: int = 0) -> Self:
        """Return the attempt that ended with a fit."""
        return cls(name, fit.eta, likelihood.residual_ratio(fit), likelihood.misfit(fit), iterations)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate that an estimator returns, with its history."""

    fit: Fit  # the estimate
    # The sweeps over the records, in order; none where the estimator takes each record as a whole.
    histories: Sequence[Sweep]
    stages: Sequence[EstimationStage]  # the attempts, in order
    # Numbers of starts, equations and the like, by name.
    counts: Mapping[str, int] = field(default_factory=dict)
    # The likelihood that `fit` maximises, where it is not the given one: that of a robust loss.
    likelihood: Likelihood | None = None
    # True: starts ended at different optima, none of which leaves white residuals; this one may be local.
    disputed: bool = False
    # The number of evaluations after which a search was cut off; 0 of one that ended by itself.
    cut_off: int = 0
    # Comparison of the model at `fit` with others, if it was made already.
    comparison: ModelComparison | None = None


class Estimator(Protocol):
    """An estimator of parameters from the likelihood of their records."""

    @property
    def name(self) -> str:
        """Its name in a scene."""

    def run(self, likelihood: Any, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises
        ------
        DynidError
            If estimates run away, or no attempt was completed.
        """
