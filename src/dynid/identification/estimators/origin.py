"""The origin of an estimation: the starts, or near them, and the parameters that records do not determine."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.information import Information
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.lti.floating import guarded
from dynid.parameters import rates, starts, values

# How far from the starts parameters are looked for that hide there, in units: by a factor of 1.3 to 1.6.
_START_OFFSET = 0.25


class Origin(NamedTuple):
    """The origin of an estimation: coordinates (p), and the parameters that the records do not determine."""

    eta: Array
    undetermined: tuple[str, ...]


def identifiable_origin(likelihood: Likelihood) -> Origin:
    """Return the starts, or coordinates nearby where these alone hide a parameter from the records.

    So do equal starts of interchangeable parameters, which are a stationary point between two optima.

    Raises
    ------
    NotIdentifiable
        If the records determine no parameter.
    """
    eta, unknowns = starts(likelihood.unknowns), likelihood.unknowns
    rms = [record.data.rms for record in likelihood.records]

    def information_at(point: Array) -> Information:
        at_point = likelihood.information(likelihood.fit(point), rms)
        return replace(at_point, values=values(unknowns, point), rates=rates(unknowns, point))

    information = information_at(eta)
    lost = information.dependent()
    if not lost:
        return Origin(eta, ())
    sides = np.where(np.arange(len(eta)) % 2, -1.0, 1.0) * (1 + np.arange(len(eta)) / (1 + len(eta)))
    for side in (sides, -sides[::-1]):
        nearby = likelihood.priors.clipped(eta + _START_OFFSET * side * likelihood.priors.units)
        try:
            with guarded("the prediction"):
                nearby_information = information_at(nearby)
        except DynidError:
            continue
        if len(fewer := nearby_information.dependent()) < len(lost):
            eta, information, lost = nearby, nearby_information, fewer
            if not lost:
                break
    if not np.isfinite(information.bounds()).any():
        information.check()
    return Origin(eta, tuple(unknowns[k].name for k in lost))
