"""Measured modes beside those of the model, before and after: ``identification/modes/``.

- `frequency_measured`, `frequency_start`, `frequency` (in the unit of the measured ones), their relative
  errors `frequency_error_start`, `frequency_error`, and `frequency_std` (scatter with its floor); `damping…`
  alike.
- `mac_start`, `mac`: modal assurance criterion of each pair; `mac_table_start`, `mac_table` of all pairs of
  measured and computed modes; `comac_start`, `comac`: that of each sensor over all modes.
- `model_mode_start`, `model_mode`: the modes of the model that the measured ones are paired with, from 1.
- `shape_measured`, `shape_start`, `shape`: shapes at the sensors, the largest measured component of
  magnitude 1; of complex ones `complexity_measured`, the part of each that no phase makes real.
- `expanded_start`, `expanded`: measured shapes at all DOFs, in the span of the modes they are paired with
  (SEREP), of as many of the nearest ones as there are sensors; NaN of a mode whose shape was not measured.
- `model_error`: errors of the model's form, relative, of each quantity, with `scatter_floor`.
- `left_out_error`, `left_out_deviation`, `left_out_by_scatter`: each frequency predicted with it left out,
  over the measured one less 1, and its bars, with the error of the form and by scatter alone; of modes alone,
  NaN where the rest does not determine the parameters.
- `trade_off/<frequencies|shapes>/{frequency_error, mac}`: the fits to frequencies alone and to shapes alone
  (damping ratios, where measured, count in both), where the form is in error.
- `directions/`: combinations of parameters by how much better the data know them than the priors (`strength`,
  singular values of the derivatives times the priors' deviations), where all parameters have priors.
- `statements`: what follows from these, in words.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.identification.identify import Rebuild
from dynid.identification.modal_diagnosis import CONTRADICTED, DETERMINED, directions, left_out, trade_off
from dynid.identification.modal_record import ModalFit, ModalRecord
from dynid.identification.posterior import Posterior
from dynid.parameters import named, starts
from dynid.result import Result
from dynid.structure.correlation import comac, complexity
from dynid.structure.model import StructuralModel
from dynid.units import angular_factor

Array = NDArray[np.float64]

GROUP = "identification/modes"
# A parameter whose standard error is more than this part of the prior's is known by that alone.
_BLIND = 0.8
# The most numbers of expanded shapes.
_MOST_EXPANDED = 2_000_000


def add_modes(
    result: Result,
    posterior: Posterior,
    full: StructuralModel,
    at_start: ModalRecord,
    rebuild: Rebuild | None = None,
) -> Result:
    """Add measured and computed modes, and return the result.

    Parameters
    ----------
    result
        The result to add to.
    posterior
        The posterior of parameters, one of whose records is of modes.
    full
        The structure, not reduced.
    at_start
        The measured modes with the model at the starts.
    rebuild
        Returns the model for parameters by name, where its basis follows them.
    """
    if not result.wants_below(GROUP):
        return result
    k, record = next(
        (k, one) for k, one in enumerate(posterior.likelihood.records) if isinstance(one, ModalRecord)
    )
    after = posterior.fit.parts[k]
    at_start = at_start.with_error(record.error)
    before = at_start.fit(starts(record.unknowns), at_start.data.values)
    assert isinstance(after, ModalFit)
    measured, r = record.measurement, record.measurement.modes
    factor = 1 / angular_factor(measured.unit)
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
        result.add(f"{GROUP}/damping_std", record.scatter_and_size[1][0], dims)
    if len(measured.dofs):
        _add_shapes(result, record, before, after)
    if len(measured.dofs) and full.size * r <= _MOST_EXPANDED and result.wants(f"{GROUP}/expanded"):
        result.add_axis(f"{GROUP}/dof", np.array([str(dof) for dof in full.dofs], dtype=object))
        for suffix, one, fit in (("_start", at_start, before), ("", record, after)):
            shapes = _expanded(one, fit)
            if len(shapes) == full.size:
                result.add(f"{GROUP}/expanded{suffix}", shapes, ("dof", "mode"))
    result.add(f"{GROUP}/model_error", record.error, ("quantity",))
    floors = [getattr(measured.floors, one.name) for one in record.channels]
    result.add(f"{GROUP}/scatter_floor", floors, ("quantity",))
    said = [] if len(posterior.likelihood.records) > 1 else _add_diagnosis(result, posterior, record, rebuild)
    said += _add_directions(result, posterior)
    result.add_axis(f"{GROUP}/statements", np.array(said, dtype=object))
    return result


def _expanded(record: ModalRecord, fit: ModalFit) -> NDArray[Any]:
    """Return measured shapes at all DOFs (n x r) in the span of modes that they are paired with (SEREP).

    J. O'Callahan, P. Avitabile, R. Riemer, *Proc. IMAC VII* 1989, 29–37.
    """
    solution = record.solution(named(record.unknowns, fit.eta))
    whole = record.model.expand(solution.shapes[:, fit.pairs])
    at_sensors, target = record.rows @ solution.shapes[:, fit.pairs], record.measurement.shapes
    found = np.full(whole.shape, np.nan, dtype=np.result_type(whole, target))
    for k in range(target.shape[1]):
        there = ~np.isnan(target[:, k])
        if there.any():
            near = np.argsort(np.abs(fit.omega - fit.omega[k]), kind="stable")[: np.count_nonzero(there)]
            parts = np.linalg.lstsq(at_sensors[np.ix_(there, near)], target[there, k], rcond=None)[0]
            found[:, k] = whole[:, near] @ parts
    return found


def _add_diagnosis(
    result: Result, posterior: Posterior, record: ModalRecord, rebuild: Rebuild | None
) -> list[str]:
    """Add the frequencies left out and the ends of the trade-off; return what they say."""
    group, eta, said = GROUP, posterior.fit.eta, []
    in_error = bool(record.modelled and record.error.any())
    if in_error:
        each = [
            f"{100 * e:.2g} % of {one.name}" for one, e in zip(record.channels, record.error, strict=True)
        ]
        said.append(f"estimated errors of the model's form, in the standard errors: {', '.join(each)}")
    if result.wants_below(f"{group}/left_out_error") and record.measurement.modes > 1:
        found = left_out(record, eta)
        for name, values in zip(("error", "deviation", "by_scatter"), found, strict=True):
            result.add(f"{group}/left_out_{name}", values, ("mode",))
        worst = np.flatnonzero(found.contradicted)
        if len(worst):
            shown = ", ".join(
                f"mode {k + 1} {100 * found.error[k]:+.2g} % (bar {100 * found.by_scatter[k]:.2g} %)"
                for k in worst
            )
            said.insert(
                0,
                "the form of the model contradicts the data: frequencies predicted with them left out are "
                f"off by more than {CONTRADICTED:.0f} bars of the scatter: {shown}",
            )
    if in_error and len(record.measurement.dofs) and result.wants_below(f"{group}/trade_off"):
        also = " and damping ratios" if record.measurement.has_damping else ""
        for name, end in trade_off(record, eta, rebuild).items():
            own = f"{group}/trade_off/{name}"
            result.add_axis(f"{own}/mode", np.arange(1, len(end.error) + 1))
            result.add(f"{own}/frequency_error", end.error, ("mode",))
            result.add(f"{own}/mac", end.mac, ("mode",))
            rms = 100 * float(np.sqrt(np.mean(end.error**2)))
            said.append(
                f"fitted to {name}{also} alone: RMS error of frequencies {rms:.2g} %, mean MAC "
                f"{float(np.nanmean(end.mac)):.3f}"
            )
    return said


def _add_directions(result: Result, posterior: Posterior) -> list[str]:
    """Add the combinations of parameters that the data determine, where all have priors; say which."""
    priors, names = posterior.likelihood.priors, posterior.likelihood.names
    own = f"{GROUP}/directions"
    if not priors.given.all() or not result.wants_below(own):
        return []
    information = posterior.likelihood.information(posterior.fit, posterior.noise, prior=False)
    found = directions(information, priors.deviations)
    labels = [one.label(names) for one in found]
    result.add_axis(f"{own}/direction", np.arange(1, len(found) + 1))
    result.add_axis(f"{own}/parameter", names)
    result.add(f"{own}/strength", [one.strength for one in found], ("direction",))
    result.add(f"{own}/weights", np.array([one.weights for one in found]), ("direction", "parameter"))
    result.add(f"{own}/label", np.array(labels, dtype=object), ("direction",))
    known = [label for one, label in zip(found, labels, strict=True) if one.strength > DETERMINED]
    left = posterior.information.deviations() / priors.deviations
    blind = [name for name, part in zip(names, left, strict=True) if part > _BLIND]
    said = [
        f"the data determine {len(known)} of {len(names)} combinations better than the priors: "
        + "; ".join(known)
    ]
    if blind:
        said.append(f"known by their priors alone: {', '.join(blind)}")
    return said


def _add_shapes(result: Result, record: ModalRecord, before: ModalFit, after: ModalFit) -> None:
    """Add shapes at the sensors and their correlation."""
    measured = record.measurement
    result.add_axis(f"{GROUP}/sensor", np.array([str(dof) for dof in measured.dofs], dtype=object))
    count = max(before.mac.shape[1], after.mac.shape[1])
    result.add_axis(f"{GROUP}/computed", np.arange(1, count + 1))
    result.add(f"{GROUP}/shape_measured", measured.shapes, ("sensor", "mode"))
    if measured.complex_shapes:
        result.add(f"{GROUP}/complexity_measured", complexity(measured.shapes), ("mode",))
    for suffix, fit in (("_start", before), ("", after)):
        table = np.full((measured.modes, count), np.nan)
        table[:, : fit.mac.shape[1]] = fit.mac
        result.add(f"{GROUP}/mac{suffix}", fit.own_mac, ("mode",))
        result.add(f"{GROUP}/mac_table{suffix}", table, ("mode", "computed"))
        result.add(f"{GROUP}/shape{suffix}", fit.shapes, ("sensor", "mode"))
        result.add(f"{GROUP}/comac{suffix}", comac(measured.shapes, fit.shapes), ("sensor",))
