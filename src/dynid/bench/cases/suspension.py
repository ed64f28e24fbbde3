"""The five-mass suspension of Yang with two unknown joints and 5 % noise (his Table 2), as a record."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

_MASSES = (2.0, 2.0, 1.5, 1.0, 1.0)
_STEP, _NOISE, _SETTLE = 0.002, 0.05, 10.0
_OMEGA = (70.0, 110.0, 250.0)  # rad/s


class Record(NamedTuple):
    """A record with its model; starts and true values as logarithms, and their Cramér–Rao bounds (p each)."""

    ensemble: Any
    start: Any
    true: Any
    bound: Any

    def error(self, logs: Any) -> float:
        """Return the RMS error of estimates over their bounds: about 1 of the best that can be done."""
        return float(np.sqrt(np.mean(((logs - self.true) / self.bound) ** 2)))


@lru_cache(maxsize=2)
def record(samples: int) -> Record:
    """Return the record with so many samples."""
    from dynid.identification.augmented import augmented
    from dynid.identification.ensemble import Ensemble
    from dynid.identification.fit import fitter
    from dynid.identification.measurement import Measurement, Simulation, data
    from dynid.lti.signals import Multisine
    from dynid.structure.joints import Joint, JointParameter
    from dynid.structure.lumped import Link, lumped
    from dynid.structure.response import Channel, Load

    joints = [
        Joint(name, dofs, JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0))
        for name, dofs in (("upper", (2, 3)), ("lower", (3, 4)))
    ]
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    model = lumped(_MASSES, links, joints)
    loads = [Load(5, Multisine([100.0] * 3, list(_OMEGA)))]
    channels = (Channel(2, "velocity"), Channel(3, "velocity"))
    measurement = Measurement(_STEP, samples, channels, Simulation(_NOISE, 1, _SETTLE))
    measured = data(model, loads, measurement)
    joint = augmented(model, loads, channels, measurement.record.times)
    ensemble = Ensemble((fitter(joint, model, channels, measured),))
    true = np.log([each.true or np.nan for each in model.unknowns])
    start = np.log([each.start for each in model.unknowns])
    assert measured.noise is not None
    bound = ensemble.information(ensemble.fit(true), [measured.noise]).deviations()
    return Record(ensemble, start, true, bound)
