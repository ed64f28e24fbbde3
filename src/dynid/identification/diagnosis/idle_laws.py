"""Laws of joints that do not act in a record: sliders that stick, and gaps that stay open.

Until then the joint is linear, so the excitation that would reach the slip force or the clearance is the
present one times a factor.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.number_format import short_percent
from dynid.structure.joint_laws import Gap, Jenkins


def idle_laws(record: RecordLikelihood, fit: RecordFit) -> Iterator[str]:
    """Yield one sentence for each law that does not act in a record at a fit."""
    if not isinstance(record, NonlinearRecord):
        return
    motion, hidden, laws = record.joint_motion(fit)
    z = iter(hidden)
    for name, bound in laws:
        d = motion[:, bound.row] + bound.offset
        first = next(z) if bound.law.hidden else 0.0
        if isinstance(bound.law, Jenkins):
            kt, fs = bound.values
            reached = float(np.abs(kt * (motion[:, bound.row] - first)).max()) / fs
            does, limit, unknown = "never slips", "the slip force", f"{name}.fs"
        elif isinstance(bound.law, Gap):
            reached = max(float((side * d).max()) for side in bound.law.sides) / bound.values[1]
            does, limit, unknown = "never closes", "the clearance", f"{name}.kg and clearance"
        else:
            continue
        if 0 < reached < 1:
            yield (
                f"joint {name} {does} in this record (it reaches {short_percent(100 * reached)} of {limit}): "
                f"{unknown} cannot be identified; an excitation {1 / reached:.2g} times as large reaches it"
            )
