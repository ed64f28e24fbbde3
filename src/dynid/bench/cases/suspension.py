"""Records of the suspension of five masses (Yang, Table 2) with four unknown parameters.

Two velocities with 5 % noise, 10 + 4 states, started at half the true values.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from dynid.identification.filter import FilterPrior
    from dynid.identification.time_record import TimeLikelihood
    from dynid.structure.model import StructuralModel

STEP = 0.002
OMEGA = (70.0, 110.0, 250.0)  # rad/s


class SuspensionRecord(NamedTuple):
    """A record with its model, and the matrices of the model in SI.

    `start`, `truth`, `bound`: logarithms to start from and to find, and the Cramér–Rao bound on their
    deviations; ``A + sum of values x slopes`` and `b` are the system.
    """

    ensemble: TimeLikelihood
    start: Any
    truth: Any
    bound: Any
    A: Any
    slopes: Any
    b: Any


@lru_cache(maxsize=8)
def case(samples: int, seed: int = 1) -> SuspensionRecord:
    """Return a record of this length and noise."""
    import numpy as np

    from dynid.identification.measurement import Measurement, Simulation, data
    from dynid.identification.record_model import record_model
    from dynid.identification.time_record import TimeLikelihood, TimeRecord
    from dynid.lti.signals import Multisine
    from dynid.structure.response import Channel, Load

    model = _structure()
    loads = [Load(5, Multisine([100.0] * 3, list(OMEGA)))]
    channels = (Channel(2, "velocity"), Channel(3, "velocity"))
    measurement = Measurement(STEP, samples, channels, Simulation(0.05, seed, 10.0))
    record = data(model, loads, measurement)
    joint = record_model(model, loads, channels, measurement.record.times)
    ensemble = TimeLikelihood((TimeRecord(joint, record),))
    truth = np.log(list(model.true_values().values()))
    start = np.log([unknown.start for unknown in model.unknowns])
    assert record.noise is not None
    bound = ensemble.information(ensemble.fit(truth), [record.noise]).deviations()
    return SuspensionRecord(ensemble, start, truth, bound, *_system(model))


def _structure() -> StructuralModel:
    """Return the five masses."""
    from dynid.structure.joints import Joint, JointParameter
    from dynid.structure.lumped import Link, lumped

    joints = [
        Joint(name, dofs, JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0))
        for name, dofs in (("upper", (2, 3)), ("lower", (3, 4)))
    ]
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    return lumped((2, 2, 1.5, 1, 1), links, joints)


def _system(model: StructuralModel) -> tuple[Any, Any, Any]:
    """Return A without the unknowns, its change by each, and b of a force on the last mass."""
    import numpy as np

    from dynid.structure.matrices import as_array

    M, C, K = model.dense({unknown.name: 0.0 for unknown in model.unknowns})
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    slopes = np.zeros((4, 10, 10))
    for slope, unknown in zip(slopes, model.unknowns, strict=True):
        here = slice(0, 5) if unknown.letter == "k" else slice(5, 10)
        slope[5:, here] = -np.linalg.solve(M, as_array(unknown.pattern))
    return A, slopes, np.concatenate([np.zeros(5), np.linalg.inv(M)[:, 4]])


#: Remark on the times of filters.
REMARK = (
    "a process that loads the kernels takes longer before it begins (startup: run-identification-kernels), "
    "so that short records are filtered without them; DYNID_COMPILED=1 has them always"
)


def compiles(samples: int, records: int = 1) -> bool:
    """Return True if dynid compiles its kernels by default for this number and length of records."""
    from dynid.identification.kernels import compiled, repeated

    with repeated(records):
        return compiled(samples, 10 + 2 * len(OMEGA), 4)


@contextmanager
def kernels(wish: str) -> Iterator[None]:
    """Compile or not, for any size."""
    from dynid.identification.kernels import VARIABLE

    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = wish
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def assumed_noise(this: SuspensionRecord) -> Any:
    """Return the deviations that the first pass assumes (times x channels)."""
    from dynid.identification.estimators.filter_passes import first_noise

    return first_noise(this.ensemble)[0]


def first_prior(this: SuspensionRecord) -> FilterPrior:
    """Return the prior of all filters."""
    return this.ensemble.records[0].wide_prior(this.start)


def first_covariance(this: SuspensionRecord) -> Any:
    """Return its covariance in SI (14 x 14)."""
    import numpy as np

    record = this.ensemble.records[0]
    root = first_prior(this).root * np.append(record.model.scale, np.ones(4))[:, None]
    return root @ root.T
