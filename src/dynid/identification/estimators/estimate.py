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
    """The end of one attempt of an estimator, without arrays that are as long as the records.

    Attributes
    ----------
    name
        Name of the attempt.
    eta
        The coordinates that it ended with (p).
    residual_ratio
        RMS of the residuals there over that of the measured values (channels of all records).
    misfit
        Minus the logarithm of the likelihood there, up to a constant.
    iterations
        Steps of a search.
    """

    name: str
    eta: Array
    residual_ratio: Array
    misfit: float
    iterations: int

    @classmethod
    def at(cls, name: str, likelihood: Likelihood, fit: Fit, iterations: int = 0) -> Self:
        """Return the attempt that ended with a fit."""
        return cls(name, fit.eta, likelihood.residual_ratio(fit), likelihood.misfit(fit), iterations)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate that an estimator returns, with its history.

    Attributes
    ----------
    fit
        The estimate.
    histories
        The sweeps over the records, in order; none where the estimator takes each record as a whole.
    stages
        The attempts, in order.
    counts
        Numbers of starts, equations and the like, by name.
    likelihood
        The likelihood that `fit` maximises, where it is not the given one: that of a robust loss.
    disputed
        True: starts ended at different optima, none of which leaves white residuals; this one may be local.
    cut_off
        The number of evaluations after which a search was cut off; 0 of one that ended by itself.
    comparison
        Comparison of the model at `fit` with others, if it was made already.
    """

    fit: Fit
    histories: Sequence[Sweep]
    stages: Sequence[EstimationStage]
    counts: Mapping[str, int] = field(default_factory=dict)
    likelihood: Likelihood | None = None
    disputed: bool = False
    cut_off: int = 0
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
