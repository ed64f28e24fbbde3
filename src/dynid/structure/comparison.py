"""Reduction methods compared: what each costs, and how well it agrees with the full structure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.progress import tell
from dynid.result import Result
from dynid.structure import correlation
from dynid.structure.matrices import Array, Label, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes import Modes, modes
from dynid.structure.reduction.cost import Cost, measured
from dynid.structure.reduction.methods import Reductor
from dynid.structure.reduction.reduction import Reduction
from dynid.structure.response import Channel, common_unit, frequency_response


class Responses(NamedTuple):
    """Frequency responses to compare: force DOFs, read-outs, and angular frequencies, rad/s."""

    inputs: Sequence[Label]
    outputs: Sequence[Channel]
    omega: Array


class Candidate(NamedTuple):
    """A reduction that was made, its modes, the numbers of the full modes they stand for, and its cost."""

    reduction: Reduction
    modes: Modes
    numbers: tuple[int, ...]
    cost: Cost


def compare(
    model: StructuralModel,
    methods: Mapping[str, Reductor],
    *,
    responses: Responses | None = None,
    parts: Mapping[str, Sequence[Label]] | None = None,
) -> Result:
    """Reduce a structure by several methods and compare each with the full one, joints included.

    A reduced mode is compared with the full mode that its basis retains; where it retains none of the
    structure with its joints, with the one of the same rank.

    Parameters
    ----------
    model
        The full structure; all joints are known.
    methods
        The methods by the names they shall have in the result.
    responses
        The frequency responses to compare; absent: none.
    parts
        Substructures by name, whose shares of the energy are compared.

    Returns
    -------
    Result
        ``reduction/<name>/{T, mass, stiffness, damping, masters, modes, condition, frequencies, reference,
        frequency_error, mac, orthogonality, energy_error}`` and ``reduction/frf/{omega, full, <name>,
        frac}``. The matrices include the joints. `frequency_error` is relative and signed. Attributes of the
        groups say what the work cost.

    Raises
    ------
    UsageError, Singular
        As of the methods.
    """
    import scipy.linalg  # noqa: F401 - loaded beforehand, so that no method pays for it

    candidates = {}
    for name, method in methods.items():
        tell(f"reducing by {name}")
        candidates[name] = candidate(model, method)
    result = Result("reduction")
    result.add_axis("reduction/method", list(methods))
    result.add_axis("reduction/dof", [str(dof) for dof in model.dofs])
    most = max(max(made.numbers, default=0) for made in candidates.values())
    tell("modes of the full structure")
    with measured() as cost:
        full = modes(*model.with_joints(), count=most)
    result.annotate("reduction", solver=full.method, **cost.attributes())
    if full.doubt:
        result.annotate("reduction", doubt=full.doubt)
    for name, made in candidates.items():
        _add(result, f"reduction/{name}", model, made, full, parts)
    if responses is not None:
        tell("frequency responses")
        _add_responses(result, model, candidates, responses)
    return result


def candidate(model: StructuralModel, method: Reductor) -> Candidate:
    """Reduce a structure, and find the modes of what comes out."""
    with measured() as cost:
        reduction = method.reduce(model)
    found = modes(*reduction.model.with_joints())
    count = len(found.omega)
    retained = reduction.retained and len(reduction.modes) == count
    numbers = tuple(sorted(reduction.modes)) if retained else tuple(range(1, count + 1))
    return Candidate(reduction, found, numbers, cost)


def _add(
    result: Result,
    group: str,
    model: StructuralModel,
    made: Candidate,
    full: Modes,
    parts: Mapping[str, Sequence[Label]] | None,
) -> None:
    """Add a reduced structure, its modes, and how well they agree with those of the full one."""
    _add_reduction(result, group, model, made)
    places = np.array(made.numbers, dtype=np.int64) - 1
    reference, M = full.omega[places], model.with_joints()[0]
    shapes = made.reduction.model.expand(made.modes.shapes)
    target = correlation.counterparts(shapes, places, full.shapes, full.omega, M)
    result.add_axis(f"{group}/mode", places + 1)
    result.add_axis(f"{group}/full_mode", places + 1)
    result.add(f"{group}/frequencies", made.modes.omega, ("mode",), "rad/s")
    result.add(f"{group}/reference", reference, ("mode",), "rad/s")
    error = correlation.frequency_error(made.modes.omega, reference)
    result.add(f"{group}/frequency_error", error, ("mode",))
    result.add(f"{group}/mac", correlation.mac(shapes, target), ("mode", "full_mode"))
    cross = correlation.orthogonality(shapes, M, target)
    result.add(f"{group}/orthogonality", cross, ("mode", "full_mode"))
    names, shares = correlation.energy_shares(model, shapes, made.modes.omega, parts=parts)
    _, true = correlation.energy_shares(model, target, reference, parts=parts)
    result.add_axis(f"{group}/part", names)
    result.add(f"{group}/energy_error", shares - true, ("mode", "part"))


def _add_reduction(result: Result, group: str, model: StructuralModel, made: Candidate) -> None:
    """Add matrices, basis and cost of a reduced structure."""
    reduced = made.reduction.model
    coordinates = [str(label) for label in reduced.dofs]
    result.annotate(group, rule=made.reduction.rule, **made.cost.attributes())
    result.add_axis(f"{group}/coordinate", coordinates)
    result.add_axis(f"{group}/column", coordinates)
    result.add(f"{group}/T", made.reduction.T, ("dof", "coordinate"))
    for name, matrix in zip(("mass", "damping", "stiffness"), reduced.with_joints(), strict=True):
        result.add(f"{group}/{name}", as_array(matrix), ("coordinate", "column"))
    masters = [model.index(label) + 1 for label in made.reduction.masters]
    result.add(f"{group}/masters", np.array(masters, dtype=np.int64), ("master",))
    result.add(f"{group}/modes", np.array(made.reduction.modes, dtype=np.int64), ("basis_mode",))
    if made.reduction.condition is not None:
        result.add(f"{group}/condition", made.reduction.condition)


def _add_responses(
    result: Result, model: StructuralModel, candidates: Mapping[str, Candidate], asked: Responses
) -> None:
    group, dims = "reduction/frf", ("omega", "output", "input")
    units = [f"{channel.unit}/N" for channel in asked.outputs]
    result.add_axis(f"{group}/omega", asked.omega, "rad/s")
    result.add_axis(f"{group}/output", [channel.name for channel in asked.outputs])
    result.add_axis(f"{group}/input", [str(dof) for dof in asked.inputs])
    result.add(f"{group}/unit", units, ("output",))
    full = _response(model, asked)
    result.add(f"{group}/full", full, dims, common_unit(units))
    agreement = []
    for name, made in candidates.items():
        response = _response(made.reduction.model, asked)
        result.add(f"{group}/{name}", response, dims, common_unit(units))
        agreement.append(correlation.frac(response, full))
    result.add(f"{group}/frac", np.array(agreement), ("method", "output", "input"))


def _response(model: StructuralModel, asked: Responses) -> NDArray[np.complex128]:
    result = frequency_response(model, asked.inputs, asked.outputs, asked.omega)
    return result["structure/frequency_response/response"].data
