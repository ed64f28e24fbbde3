"""Result of a rejected fit: what was measured and predicted, and the tests that reject it; no answers.

Estimates stand in ``identification/rejected/``, with their starts, true values and units, and nowhere else:
there is neither `parameters` nor what would follow from these. `measurement` has the `residual`, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dynid.errors import DynidError
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.results.write_result import (
    add_diagnostics,
    add_fits,
    add_names,
    add_stages,
    common_unit_of,
)
from dynid.result import REJECTED, Result

#: Group of the estimates.
GROUP = "identification/rejected"
_FAILURES = (DynidError, ArithmeticError, np.linalg.LinAlgError)


def raise_rejected(posterior: Posterior, *further: Callable[[Result, Posterior], Any]) -> None:
    """Raise the error of a rejected fit, with its result, which leaves out what cannot be computed.

    `further`: what is added to it besides, as measured modes.
    """
    error = posterior.rejection
    if error is None:
        return
    result = Result("identification")
    result.attrs["status"] = REJECTED
    result.annotate("identification", estimator=posterior.method, rejected=str(error))
    for add in (_add_estimates, add_stages, add_fits, add_diagnostics, *further):
        group = Result("identification")
        try:
            add(group, posterior)
        except _FAILURES:  # numbers of such a fit may leave their range
            continue
        result.merge(group)
    error.result = result
    raise error


def _add_estimates(result: Result, posterior: Posterior) -> None:
    dims, true, priors = ("parameter",), posterior.true, posterior.likelihood.priors
    add_names(result, GROUP, posterior)
    result.add(f"{GROUP}/estimate", posterior.values, dims, common_unit_of(posterior))
    result.add(f"{GROUP}/at_bound", priors.at_bound(posterior.fit.eta) & ~priors.fixed, dims)
    nonzero = np.where(true == 0, np.nan, true)
    result.add(f"{GROUP}/error_percent", 100 * np.abs(posterior.values / nonzero - 1), dims, "%")
