"""Joints with nonlinear laws, as they were identified: ranges, energies, forces over time.

Below ``identification/joints``: `range`, the largest deflections of the `joint`s in the records; their
`dissipation` in a cycle of a sine at each `amplitude` (a `fraction` of that range) with its standard error,
and of each record (`record_k` of several) over `time` the `deflection` and `force` of the model, with
standard errors, and as the record has them (`measured_deflection`, `measured_force`, see
`diagnosis.joint_forces`), and the `regime` of each `law`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.arrays import Array
from dynid.identification.diagnosis.joint_forces import FRACTIONS, measured_forces, motion_sizes
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.likelihood.state_deviations import initial_root, stored_rows
from dynid.number_format import general
from dynid.parameters import named
from dynid.result import Result, common_unit

GROUP = "identification/joints"
# Deflections beyond the range by less than this part are within it.
_RANGE_TOL = 0.05
# Relative step of differences of energies by parameters: the cube root of round-off.
_DIFFERENCE = 1e-5


def add_joints(
    result: Result,
    records: Sequence[NonlinearRecord],
    fits: Sequence[RecordFit],
    noise: Sequence[Array],
    root: Array,
    groups: Sequence[str],
) -> None:
    """Add the joints with laws; `root`: of the covariance of coordinates (p x p); `groups`: of records."""
    peaks, rates = motion_sizes(records, fits)
    model = records[0].structure
    joints = [joint.name for joint in model.joints if joint.laws]
    length, force = (common_unit(model.deflection_units(unit)) for unit in ("m", "N"))
    result.add_axis(f"{GROUP}/joint", joints)
    result.add(f"{GROUP}/range", peaks, ("joint",), length)
    result.add_axis(f"{GROUP}/fraction", FRACTIONS)
    result.add(f"{GROUP}/amplitude", FRACTIONS[:, None] * peaks, ("fraction", "joint"), length)
    eta = fits[0].eta
    energy = _energy(records[0], eta, peaks, rates)
    slopes = []
    for k in range(len(eta)):
        step = np.zeros(len(eta))
        step[k] = _DIFFERENCE * (1.0 if records[0].unknowns[k].logarithmic else abs(eta[k]) or 1.0)
        ends = (_energy(records[0], eta + side * step, peaks, rates) for side in (1, -1))
        slopes.append(np.subtract(*ends) / (2 * step[k]))
    deviation = np.linalg.norm(np.tensordot(np.array(slopes), root, (0, 0)), axis=-1)
    dims = ("fraction", "joint")
    result.add_all(GROUP, dims, "J", dissipation=energy, dissipation_deviation=deviation)
    for record, fit, level, group in zip(records, fits, noise, groups, strict=True):
        _add_record(result, record, fit, level, root, group, joints, rates, (length, force))


def _energy(record: NonlinearRecord, eta: Array, peaks: Array, rates: Array) -> Array:
    """Return what each joint dissipates in cycles, its damper included (fractions x joints), J."""
    out, values = np.zeros((len(FRACTIONS), len(peaks))), named(record.unknowns, eta)
    for row, joint in enumerate(joint for joint in record.structure.joints if joint.laws):
        for term in joint.terms:
            if term.key == "c" and term.parameter.matrix is None:
                c = (
                    values[term.name]
                    if term.parameter.start is not None
                    else float(term.parameter.value or 0)
                )
                out[:, row] += np.pi * c * rates[row] * (FRACTIONS * peaks[row]) ** 2
    for _, bound in record.laws_at(eta):
        row = bound.row
        out[:, row] += [bound.cycle_work(x * float(peaks[row]), float(rates[row])) for x in FRACTIONS]
    return out


def _add_record(
    result: Result,
    record: NonlinearRecord,
    fit: RecordFit,
    noise: Array,
    root: Array,
    group: str,
    joints: Sequence[str],
    rates: Array,
    units: tuple[str, str],
) -> None:
    """Add deflections, forces and regimes over the time of a record."""
    motion, slopes = record.joint_forces(fit)
    rows = stored_rows(len(motion.forces))
    result.add_axis(f"{group}/time", record.times[rows], "s")
    if group != GROUP:
        result.add_axis(f"{group}/joint", joints)
    deviation = np.linalg.norm(slopes[rows] @ initial_root(record, fit, noise, root), axis=2)
    dims = ("time", "joint")
    result.add(f"{group}/deflection", motion.deflections[rows], dims, units[0])
    result.add_all(group, dims, units[1], force=motion.forces[rows], force_deviation=deviation)
    rate = float(rates.max())
    if (shown := measured_forces(record, fit, noise, motion.deflections, motion.forces, rate)) is not None:
        columns = []
        for values in shown:
            full = np.full(motion.forces.shape, np.nan)
            full[: len(values)] = values
            columns.append(full[rows])
        result.add(f"{group}/measured_deflection", columns[0], dims, units[0])
        result.add_all(group, dims, units[1], measured_force=columns[1], measured_deviation=columns[2])
    laws = [f"{name}.{bound.law.kind}" for name, bound in record.laws_at(fit.eta)]
    result.add_axis(f"{group}/law", laws)
    result.add(f"{group}/regime", motion.regimes[rows].astype(np.int64), ("time", "law"))


def beyond_range(result: Result) -> str:
    """Return which joints a response deflects beyond the records of their laws, or an empty text."""
    if f"{GROUP}/range" not in result or "structure/joints/deflection" not in result:
        return ""
    peaks = np.abs(result["structure/joints/deflection"].data).max(axis=0)
    unit = result["structure/joints/deflection"].units or "SI"
    beyond = [
        f"{name} deflects by {general(peak)} {unit}, in the records by {general(most)} {unit}"
        for name, peak, most in zip(
            result[f"{GROUP}/joint"].data, peaks, result[f"{GROUP}/range"].data, strict=True
        )
        if peak > (1 + _RANGE_TOL) * most
    ]
    return f"laws hold for the amplitudes of their records: {'; '.join(beyond)}" if beyond else ""
