"""Measured modes beside those of the model, before and after: ``identification/modes/``.

- `frequency_measured`, `frequency_start`, `frequency` (in the unit of the measured ones), their relative
  errors `frequency_error_start`, `frequency_error`, and `frequency_std` (scatter with its floor); `damping…`
  alike.
- `mac_start`, `mac`: modal assurance criterion of each pair; `mac_table_start`, `mac_table` of all pairs of
  measured and computed modes; `comac_start`, `comac`: that of each sensor over all modes.
- `model_mode_start`, `model_mode`: the modes of the model that the measured ones are paired with, from 1.
- `shape_measured`, `shape_start`, `shape`: shapes at the sensors, largest measured component 1.
- `model_error`: errors of the model's form, relative, of each quantity, with the floor of its scatter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynid.identification.modal_record import ModalFit, ModalRecord
from dynid.identification.posterior import Posterior
from dynid.parameters import starts
from dynid.result import Result
from dynid.structure.correlation import comac
from dynid.structure.model import StructuralModel

Array = NDArray[np.float64]

GROUP = "identification/modes"


def add_modes(result: Result, posterior: Posterior, full: StructuralModel) -> Result:  # noqa: ARG001
    """Add measured and computed modes, and return the result.

    Parameters
    ----------
    result
        The result to add to.
    posterior
        The posterior of parameters, one of whose records is of modes.
    full
        The structure, not reduced.
    """
    if not result.wants_below(GROUP):
        return result
    k, record = next(
        (k, one) for k, one in enumerate(posterior.likelihood.records) if isinstance(one, ModalRecord)
    )
    after = posterior.fit.parts[k]
    before = record.fit(starts(record.unknowns), record.data.values)
    assert isinstance(after, ModalFit)
    measured, r = record.measurement, record.measurement.modes
    factor = 1 / (2 * math.pi) if measured.unit == "Hz" else 1.0
    result.add_axis(f"{GROUP}/mode", np.arange(1, r + 1))
    result.add_axis(f"{GROUP}/quantity", np.array([one.name for one in record.channels], dtype=object))
    dims = ("mode",)
    result.add(f"{GROUP}/frequency_measured", factor * measured.omega, dims, measured.unit)
    scatter = measured.deviations()
    result.add(f"{GROUP}/frequency_std", factor * scatter[0] * measured.omega, dims, measured.unit)
    for suffix, fit in (("_start", before), ("", after)):
        result.add(f"{GROUP}/frequency{suffix}", factor * fit.omega, dims, measured.unit)
        result.add(f"{GROUP}/frequency_error{suffix}", fit.omega / measured.omega - 1, dims)
        result.add(f"{GROUP}/model_mode{suffix}", fit.pairs + 1, dims)
        if measured.has_damping:
            result.add(f"{GROUP}/damping{suffix}", fit.damping, dims)
    if measured.has_damping:
        assert measured.damping is not None
        result.add(f"{GROUP}/damping_measured", measured.damping, dims)
        result.add(f"{GROUP}/damping_std", scatter[1] * np.abs(measured.damping), dims)
    if len(measured.dofs):
        _add_shapes(result, record, before, after)
    result.add(f"{GROUP}/model_error", record.error, ("quantity",))
    floors = [getattr(measured.floors, one.name) for one in record.channels]
    result.add(f"{GROUP}/scatter_floor", floors, ("quantity",))
    return result


def _add_shapes(result: Result, record: ModalRecord, before: ModalFit, after: ModalFit) -> None:
    """Add shapes at the sensors and their correlation."""
    measured = record.measurement
    result.add_axis(f"{GROUP}/sensor", np.array([str(dof) for dof in measured.dofs], dtype=object))
    count = max(before.mac.shape[1], after.mac.shape[1])
    result.add_axis(f"{GROUP}/computed", np.arange(1, count + 1))
    result.add(f"{GROUP}/shape_measured", measured.shapes, ("sensor", "mode"))
    for suffix, fit in (("_start", before), ("", after)):
        table = np.full((measured.modes, count), np.nan)
        table[:, : fit.mac.shape[1]] = fit.mac
        result.add(f"{GROUP}/mac{suffix}", fit.own_mac, ("mode",))
        result.add(f"{GROUP}/mac_table{suffix}", table, ("mode", "computed"))
        result.add(f"{GROUP}/shape{suffix}", fit.shapes, ("sensor", "mode"))
        result.add(f"{GROUP}/comac{suffix}", comac(measured.shapes, fit.shapes), ("sensor",))
