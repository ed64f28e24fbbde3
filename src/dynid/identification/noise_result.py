"""Result of an identification whose noise is not white: ``identification/noise/``.

- Attribute `kind`: coloured or proportional.
- Coloured: the autoregression ``x_t = a_1 x_(t-1) + … + e_t`` of each channel: `order`,
  `coefficients` (channel x lag, 0 beyond the order), `innovation` and `deviation`, the standard deviations of
  e and x; `bic` of each `tried` order less that of white noise (channel x tried, NaN where not tried); and
  `correlation` of e between channels (channel x other) where that is estimated.
- Proportional: the `ratio` of the deviation of the complex noise to the response (channel).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.identification.frf_record import FrfRecord
from dynid.identification.noise import Autoregression
from dynid.identification.posterior import Posterior
from dynid.identification.time_record import TimeRecord
from dynid.result import Result
from dynid.structure.response import common_unit

Array = NDArray[np.float64]

GROUP = "identification/noise"


def add_noise(result: Result, posterior: Posterior) -> None:
    """Add ``noise/``: the model of a noise that is not white."""
    records = posterior.likelihood.records
    waves = [isinstance(record, TimeRecord | FrfRecord) for record in records]
    places = [place for place in posterior.channels if waves[place.record]]
    names = [place.name for place in places]
    result.add_axis(f"{GROUP}/channel", names)
    if isinstance(records[0], FrfRecord):
        result.annotate(GROUP, kind="proportional")
        result.add(f"{GROUP}/ratio", np.sqrt(2) * posterior.noise[0], ("channel",))
        return
    result.annotate(GROUP, kind="coloured")
    # A record whose noise is given, beside others of coloured noise, is white.
    each = [
        (Autoregression.of((), len(level)) if record.colour is None else record.colour, level)
        for record, level in zip(records, posterior.noise, strict=True)
        if isinstance(record, TimeRecord)
    ]
    dims, unit = ("channel",), common_unit(place.unit for place in places)
    innovation = np.concatenate([colour.innovations(level) for colour, level in each])
    orders = np.concatenate([colour.orders for colour, _ in each])
    result.add(f"{GROUP}/order", orders, dims)
    result.add_axis(f"{GROUP}/lag", np.arange(1, int(orders.max()) + 1))
    result.add(f"{GROUP}/coefficients", _rows([c.coefficients for c, _ in each], 0.0), ("channel", "lag"))
    result.add(f"{GROUP}/innovation", innovation, dims, unit)
    shares = np.concatenate([colour.shares for colour, _ in each])
    result.add(f"{GROUP}/deviation", innovation / shares, dims, unit)
    bic = _rows([np.zeros((len(c.orders), 1)) if c.bic is None else c.bic.T for c, _ in each], np.nan)
    result.add_axis(f"{GROUP}/tried", np.arange(bic.shape[1]))
    result.add(f"{GROUP}/bic", bic, ("channel", "tried"))
    if any(colour.mixing is not None for colour, _ in each):
        correlation, first = np.eye(len(names)), 0
        for colour, level in each:
            here = slice(first, first + len(level))
            correlation[here, here], first = colour.correlation, here.stop
        result.add_axis(f"{GROUP}/other", names)
        result.add(f"{GROUP}/correlation", correlation, ("channel", "other"))


def _rows(each: list[Array], filling: float) -> Array:
    """Return the rows of matrices below each other, filled up to one width."""
    width = max(one.shape[1] for one in each)
    found = np.full((sum(map(len, each)), width), filling)
    first = 0
    for one in each:
        found[first : first + len(one), : one.shape[1]] = one
        first += len(one)
    return found
