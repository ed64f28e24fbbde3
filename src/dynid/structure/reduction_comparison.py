"""Comparison of reduction methods: the cost of each, and its agreement with the full structure."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.progress import report_progress
from dynid.result import Result, common_unit
from dynid.structure import correlation
from dynid.structure.frf import frequency_response_functions
from dynid.structure.labels import Label
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes import ModeMemory, Modes, modes, remembered_modes
from dynid.structure.ports import Channel, ports, response_units
from dynid.structure.reduction.methods import Reductor
from dynid.structure.reduction.reduced_model import StructuralReduction

_PROCESS = Path("/proc/self")

ARRAYS = (
    "T", "mass", "damping", "stiffness", "mass_without_joints", "damping_without_joints",
    "stiffness_without_joints", "masters", "modes", "condition", "frequencies", "frequency_uncertainty",
    "reference", "reference_uncertainty", "frequency_error", "mac", "orthogonality", "energy_error",
)  # fmt: skip
"""The names of the arrays of a method in the result of `compare`, axes apart."""

COMPARISONS = frozenset({
    "reference", "reference_uncertainty", "frequency_error", "mac", "orthogonality", "energy_error",
})  # fmt: skip
"""Those of them that need modes of the full structure."""


class RequestedResponses(NamedTuple):
    """Frequency responses to compare: force DOFs, read-outs, and angular frequencies, rad/s."""

    inputs: Sequence[Label]
    outputs: Sequence[Channel]
    omega: Array


class Candidate(NamedTuple):
    """A reduction, its modes, the numbers of the corresponding full modes, and its cost."""

    reduction: StructuralReduction
    modes: Modes
    numbers: tuple[int, ...]
    cost: Cost


def compare(
    model: StructuralModel,
    methods: Mapping[str, Reductor],
    *,
    responses: RequestedResponses | None = None,
    parts: Mapping[str, Sequence[Label]] | None = None,
    result: Result | None = None,
    references: bool = True,
) -> Result:
    """Reduce a structure by several methods and compare each with the full one, joints included.

    A reduced mode is compared with the full mode that its basis retains; where it retains none of the
    structure with its joints, with the one of the same rank.

    `model`: the full structure; all joints are known; `methods`: the methods by the names they shall have in
    the result; `responses`: the frequency responses to compare; default: none; `parts`: substructures by
    name, whose shares of the energy are compared; `result`: the result to add to; methods and responses that
    it does not want are left out. Default: a new one; `references`: False to compare only methods whose
    basis retains modes of the structure with its joints, for which no others need to be computed. Raises
    UsageError, Singular as of the methods.

    Returns
    -------
    Result
        ``reduction/<name>/{T, mass, stiffness, damping, masters, modes, condition, frequencies,
        frequency_uncertainty, reference, reference_uncertainty, frequency_error, mac, orthogonality,
        energy_error}``, with structural damping ``structural_damping``, too, and ``reduction/frf/{omega,
        full, <name>, frac}``. The matrices include the joints; where there are some, ``mass_without_joints``,
        ``stiffness_without_joints`` and ``damping_without_joints`` do not (Yang, eq 9). `frequency_error` is
        relative and signed; the uncertainties are what rounding leaves open, rad/s. Attributes of the groups
        hold the cost of the work and the modes in doubt.
    """
    import scipy.linalg  # noqa: F401 - loaded beforehand, so that no method pays for it

    result = Result("reduction") if result is None else result
    result.add_axis("reduction/method", list(methods))
    result.add_axis("reduction/dof", [str(dof) for dof in model.dofs])
    responding = any(result.wants(f"reduction/frf/{name}") for name in ("full", "frac", *methods))
    responses = responses if responding else None
    with remembered_modes() as memory:
        candidates = {}
        for name, method in methods.items():
            if responses is not None or any(result.wants(f"reduction/{name}/{array}") for array in ARRAYS):
                report_progress(f"reducing by {name}")
                candidates[name] = candidate(model, method, memory)
        if not candidates:
            return result
        compared = {
            name for name, evaluated in candidates.items() if references or evaluated.reduction.retained
        }
        full: Modes | None = None
        if compared:
            highest = max(max(candidates[name].numbers, default=0) for name in compared)
            report_progress("modes of the full structure")
            with measured(memory) as cost:
                full = modes(*model.with_joints(), count=highest)
            doubt = {"doubt": full.doubt} if full.doubt else {}
            result.annotate("reduction", solver=full.method, **cost.attributes(), **doubt)
    for name, evaluated in candidates.items():
        _add(result, f"reduction/{name}", model, evaluated, full if name in compared else None, parts)
    if responses is not None:
        report_progress("frequency responses")
        _add_responses(result, model, candidates, responses)
    return result


def candidate(model: StructuralModel, method: Reductor, memory: ModeMemory | None = None) -> Candidate:
    """Reduce a structure, and find the modes of what comes out; `memory` as of `measured`."""
    with measured(memory) as cost:
        reduction = method.reduce(model)
    reduced_modes = modes(*reduction.model.with_joints())
    reduced_modes = reduced_modes.within(model.with_joints()[2], reduction.model.expand(reduced_modes.shapes))
    count = len(reduced_modes.omega)
    retained = reduction.retained and len(reduction.modes) == count
    numbers = tuple(sorted(reduction.modes)) if retained else tuple(range(1, count + 1))
    return Candidate(reduction, reduced_modes, numbers, cost)


def _add(
    result: Result,
    group: str,
    model: StructuralModel,
    evaluated: Candidate,
    full: Modes | None,
    parts: Mapping[str, Sequence[Label]] | None,
) -> None:
    """Add a reduced structure, its modes, and how well they agree with those of the full one, if known."""
    reduced = evaluated.reduction.model
    coordinates = [str(label) for label in reduced.dofs]
    result.annotate(group, rule=evaluated.reduction.rule, **evaluated.cost.attributes())
    result.add_axes(group, coordinate=coordinates, column=coordinates)
    result.add(f"{group}/T", evaluated.reduction.T, ("dof", "coordinate"))
    bare = (reduced.M, reduced.C, reduced.K) if reduced.joints else ()
    for suffix, matrices in (("", reduced.with_joints()), ("_without_joints", bare)):
        for name, matrix in zip(("mass", "damping", "stiffness"), matrices, strict=False):
            result.add(f"{group}/{name}{suffix}", as_array(matrix), ("coordinate", "column"))
    if reduced.hysteretic:
        loss: Any = reduced.with_joints(loss=True)[2].imag
        result.add(f"{group}/structural_damping", as_array(loss), ("coordinate", "column"))
    if evaluated.modes.doubt:
        result.annotate(group, doubt=f"{group.rpartition('/')[2]}: {evaluated.modes.doubt}")
    masters = [model.index(label) + 1 for label in evaluated.reduction.masters]
    basis_modes = np.array(evaluated.reduction.modes, dtype=np.int64)
    result.add(f"{group}/masters", np.array(masters, dtype=np.int64), ("master",))
    result.add(f"{group}/modes", basis_modes, ("basis_mode",))
    if evaluated.reduction.condition is not None:
        result.add(f"{group}/condition", evaluated.reduction.condition)
    places = np.array(evaluated.numbers, dtype=np.int64) - 1
    uncertainty = evaluated.modes.uncertainty
    result.add_axis(f"{group}/mode", places + 1)
    result.add_all(
        group, ("mode",), "rad/s", frequencies=evaluated.modes.omega, frequency_uncertainty=uncertainty
    )
    if full is None:
        return
    reference, M = full.omega[places], model.with_joints()[0]
    shapes = reduced.expand(evaluated.modes.shapes)
    target = correlation.counterparts(shapes, places, full.shapes, full.omega, M)
    result.add_axis(f"{group}/full_mode", places + 1)
    result.add_all(
        group, ("mode",), "rad/s", reference=reference, reference_uncertainty=full.uncertainty[places]
    )
    error = correlation.frequency_error(evaluated.modes.omega, reference)
    result.add(f"{group}/frequency_error", error, ("mode",))
    mac, cross = correlation.mac(shapes, target), correlation.orthogonality(shapes, M, target)
    result.add_all(group, ("mode", "full_mode"), mac=mac, orthogonality=cross)
    if result.wants(f"{group}/energy_error"):
        names, shares = correlation.energy_shares(model, shapes, evaluated.modes.omega, parts=parts)
        _, true = correlation.energy_shares(model, target, reference, parts=parts)
        result.add_axis(f"{group}/part", names)
        result.add(f"{group}/energy_error", shares - true, ("mode", "part"))


def _add_responses(
    result: Result, model: StructuralModel, candidates: Mapping[str, Candidate], asked: RequestedResponses
) -> None:
    group, dims = "reduction/frf", ("omega", "output", "input")
    units = response_units(model, asked.inputs, asked.outputs)
    result.add_axis(f"{group}/omega", asked.omega, "rad/s")
    result.add_axis(f"{group}/output", [channel.name for channel in asked.outputs])
    result.add_axis(f"{group}/input", [str(dof) for dof in asked.inputs])
    result.add(f"{group}/unit", units, ("output",))
    full = _response(model, asked)
    result.add(f"{group}/full", full, dims, common_unit(units))
    agreement = []
    for name, evaluated in candidates.items():
        response = _response(evaluated.reduction.model, asked)
        result.add(f"{group}/{name}", response, dims, common_unit(units))
        agreement.append(correlation.frac(response, full))
    result.add(f"{group}/frac", np.array(agreement), ("method", "output", "input"))


def _response(model: StructuralModel, asked: RequestedResponses) -> NDArray[np.complex128]:
    where = ports(model, asked.inputs, asked.outputs)
    model.needs_positive(asked.omega)
    matrices = model.with_joints(loss=True)
    return frequency_response_functions(*matrices, where, asked.omega).response


@dataclass
class Cost:
    """Wall time and peak of memory of a piece of work.

    `seconds`: wall time; `peak_megabytes`: the process's memory at its highest meanwhile, above what it was
    before; None where unknown.
    """

    seconds: float = 0.0
    peak_megabytes: float | None = None

    def attributes(self) -> dict[str, float]:
        """Return the known values by name; none where files are to be reproducible (SOURCE_DATE_EPOCH)."""
        if "SOURCE_DATE_EPOCH" in os.environ:
            return {}
        peak = {} if self.peak_megabytes is None else {"peak_megabytes": self.peak_megabytes}
        return {"seconds": self.seconds, **peak}


@contextmanager
def measured(memory: ModeMemory | None = None) -> Iterator[Cost]:
    """Measure the cost of the block; it is complete on leaving.

    `memory`: the modes that it shares with others, whose time is counted as if they were computed here.
    """
    cost = Cost()
    before = None
    # Restarts the peak that the system records; elsewhere there is none.
    with suppress(OSError):
        (_PROCESS / "clear_refs").write_text("5")
        before = _resident("VmRSS")
    shared = memory.seconds if memory is not None else 0.0
    started = time.perf_counter()
    yield cost
    cost.seconds = time.perf_counter() - started
    if memory is not None:
        cost.seconds += memory.seconds - shared
    peak = _resident("VmHWM")
    if before is not None and peak is not None:
        cost.peak_megabytes = max(0.0, peak - before)


def _resident(key: str) -> float | None:
    try:
        lines = (_PROCESS / "status").read_text().splitlines()
    except OSError:
        return None
    sizes = (line.split()[1] for line in lines if line.startswith(f"{key}:"))
    kilobytes = next(sizes, None)
    return None if kilobytes is None else int(kilobytes) / 1024
