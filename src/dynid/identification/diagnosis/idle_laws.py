"""Laws of joints that do not act in a record: sliders that stick, and gaps that stay open.

Until then the joint is linear, so the excitation that would reach the slip force or the clearance is the
present one times a factor.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.number_format import short_percent
from dynid.structure.hysteretic_laws import Iwan, Jenkins
from dynid.structure.joint_laws import Gap
from dynid.structure.law import Law


def idle_laws(likelihood: Likelihood, fit: Fit) -> Iterator[str]:
    """Yield one sentence for each law that does not act in any record at a fit."""
    reached: dict[tuple[str, int], tuple[float, Law]] = {}
    for record, record_fit in zip(likelihood.records, fit.parts, strict=True):
        if isinstance(record, NonlinearRecord):
            for key, (ratio, law) in _reached(record, record_fit):
                reached[key] = max(ratio, reached.get(key, (0.0, law))[0]), law
    for (name, _), (ratio, law) in reached.items():
        if not 0 < ratio < 1:
            continue
        does, limit, unknown = ("never slips", "the slip force", f"{name}.fs")
        if isinstance(law, Iwan):
            does, limit = "never slips as a whole", "the deflection where it does"
            unknown = f"{name}.fs and beta"
        if isinstance(law, Gap):
            does, limit, unknown = ("never closes", "the clearance", f"{name}.kg and clearance")
        records = "this record" if len(likelihood.records) == 1 else "these records"
        yield (
            f"joint {name} {does} in {records} (it reaches {short_percent(100 * ratio)} of {limit}): "
            f"{unknown} cannot be identified; an excitation {1 / ratio:.2g} times as large reaches it"
        )


def _reached(record: NonlinearRecord, fit: RecordFit) -> Iterator[tuple[tuple[str, int], tuple[float, Law]]]:
    """Yield joint and place of each law, and the part of its slip force or clearance that it reaches."""
    motion, hidden, laws = record.joint_motion(fit)
    z = iter(hidden)
    for place, (name, bound) in enumerate(laws):
        d = motion[:, bound.row]
        first = next(z) if bound.law.hidden else 0.0
        if isinstance(bound.law, Jenkins):
            kt, fs = bound.values
            yield (name, place), (float(np.abs(kt * (d - first)).max()) / fs, bound.law)
        elif isinstance(bound.law, Iwan):
            # Since the last reversal: a loop from peak to peak is half as wide as first loading.
            reach = max(float(np.abs(d - first).max()), float(np.ptp(d)) / 2)
            yield (name, place), (reach / bound.law.slip(bound.values)[0], bound.law)
        elif isinstance(bound.law, Gap):
            shifted, clearance = d + bound.offset, max(bound.values[1], np.finfo(float).tiny)
            ratio = max(float((side * shifted).max()) for side in bound.law.sides) / clearance
            yield (name, place), (ratio, bound.law)
