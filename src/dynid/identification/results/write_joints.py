"""Amplitudes for which nonlinear laws of joints were identified, and responses beyond them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.systems.nonlinear_prediction import is_nonlinear
from dynid.identification.systems.structure_system import StructureSystem
from dynid.number_format import general
from dynid.result import Result

GROUP = "identification/joints"
# Deflections beyond the range by less than this part are within it.
_RANGE_TOL = 0.05


def add_joint_ranges(result: Result, records: Sequence[TimeRecord], fits: Sequence[RecordFit]) -> None:
    """Add ``identification/joints/{joint, range}``: the largest deflections of joints in the records."""
    if not records or not is_nonlinear(records[0].model):
        return
    peaks = []
    for record, fit in zip(records, fits, strict=True):
        system = record.model.system
        assert isinstance(system, StructureSystem)
        displacements = (fit.predicted.states * record.model.scale)[:, : system.model.size]
        peaks.append(np.abs(displacements @ system.model.deflections().T).max(axis=0))
        names = [joint.name for joint in system.model.joints if joint.laws]
    result.add_axis(f"{GROUP}/joint", names)
    result.add(f"{GROUP}/range", np.max(peaks, axis=0), ("joint",), "m")


def beyond_range(result: Result) -> str:
    """Return which joints a response deflects beyond the records of their laws, or an empty text."""
    if f"{GROUP}/range" not in result or "structure/joints/deflection" not in result:
        return ""
    peaks = np.abs(result["structure/joints/deflection"].data).max(axis=0)
    beyond = [
        f"{name} deflects by {general(peak)} m, in the records by {general(most)} m"
        for name, peak, most in zip(
            result[f"{GROUP}/joint"].data, peaks, result[f"{GROUP}/range"].data, strict=True
        )
        if peak > (1 + _RANGE_TOL) * most
    ]
    return f"laws hold for the amplitudes of their records: {'; '.join(beyond)}" if beyond else ""
