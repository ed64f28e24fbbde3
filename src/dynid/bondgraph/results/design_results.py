"""Results of a design: designed values, targets wanted and reached, minimum, responses before and after."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dynid.bondgraph.design.design_request import Criterion, LoopTarget, RootTarget, Target
from dynid.bondgraph.graph import GraphUnits
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.arrays import Array
    from dynid.bondgraph.design.functions import DesignFunctions, Evaluation
    from dynid.bondgraph.design.solve import Designed

GROUP = "bond_graph/design"
#: Points of the responses where the scene has no frequencies, and their range beyond the poles.
_RESPONSE_POINTS, _RANGE_FACTOR = 400, 10.0


def add_design(result: Result, designed: Designed, omega: Array | None) -> None:
    """Add the results of a design.

    `omega`: frequencies of the responses before and after, rad/s; None: around the poles.
    """
    functions = designed.functions
    design, coordinates = functions.design, functions.coordinates
    best = designed.solution
    result.annotate(GROUP, starts=design.starts, ended=designed.ended, seed=design.seed)
    result.add_axis(f"{GROUP}/name", [parameter.name for parameter in design.free])
    values = coordinates.values(best.evaluation.eta)
    lows = np.array([-math.inf if parameter.low is None else parameter.low for parameter in design.free])
    highs = np.array([math.inf if parameter.high is None else parameter.high for parameter in design.free])
    for name, column in (
        ("start", np.array([parameter.start for parameter in design.free])),
        ("value", values),
        ("min", lows),
        ("max", highs),
    ):
        result.add(f"{GROUP}/{name}", column, ("name",))
    bound = np.where(values <= lows, "min", np.where(values >= highs, "max", "")).astype(object)
    result.add(f"{GROUP}/bound", bound, ("name",))
    influence = np.array([parameter.name not in designed.idle for parameter in design.free])
    result.add(f"{GROUP}/influence", influence, ("name",))
    result.add(f"{GROUP}/met", best.met)
    if best.conditions is not None:
        result.add(f"{GROUP}/objective", best.objective)
        result.add(f"{GROUP}/optimum", best.conditions.verified)
        result.add(f"{GROUP}/stationarity", best.conditions.stationarity)
        result.add(f"{GROUP}/curvature", best.conditions.curvature)
        result.add(f"{GROUP}/active_maxima", best.conditions.active)
    _add_targets(result, designed)
    optima = designed.optima
    result.add_axis(f"{GROUP}/optima/optimum", np.arange(1, len(optima) + 1))
    result.add_axis(f"{GROUP}/optima/name", [parameter.name for parameter in design.free])
    optimal_values = np.array([coordinates.values(optimum.solution.evaluation.eta) for optimum in optima])
    result.add(f"{GROUP}/optima/value", optimal_values, ("optimum", "name"))
    result.add(f"{GROUP}/optima/objective", [optimum.solution.objective for optimum in optima], ("optimum",))
    result.add(f"{GROUP}/optima/count", [optimum.count for optimum in optima], ("optimum",))
    _add_responses(result, designed, omega)
    if best.conditions is not None and not best.conditions.verified:
        text = (
            f"the design is no verified minimum: the first-order residual is "
            f"{best.conditions.stationarity:.1g}; try more 'starts'"
        )
        result.add_axis(f"{GROUP}/warnings", [text])


def _add_targets(result: Result, designed: Designed) -> None:
    """Add the targets: wanted, at the start, reached, and reached by the designs that are compared."""
    functions = designed.functions
    design, group = functions.design, f"{GROUP}/targets"
    result.add_axis(f"{group}/target", [str(target) for target in design.targets])
    kinds = [target.kind for target in design.targets]
    result.add(f"{group}/kind", np.array(kinds, dtype=object), ("target",))
    for name in ("output", "input"):
        names = [str(getattr(target, name)) for target in design.targets]
        result.add(f"{group}/{name}", np.array(names, dtype=object), ("target",))
    units = [_unit(functions, target) for target in design.targets]
    result.add(f"{group}/unit", np.array(units, dtype=object), ("target",))
    frequencies = [0.0 if isinstance(target, Criterion) else target.frequency for target in design.targets]
    dampings = [
        target.damping if isinstance(target, RootTarget) and target.damping is not None else 0.0
        for target in design.targets
    ]
    note = "rad/s of a zero or pole; a margin in its unit; 0 of a norm, which is minimised"
    result.add(f"{group}/wanted", frequencies, ("target",), note=note)
    result.add(f"{group}/wanted_damping", dampings, ("target",), note="where one is wanted")
    damped = [isinstance(target, RootTarget) and target.damping is not None for target in design.targets]
    result.add(f"{group}/damping_wanted", damped, ("target",))
    for name, at in (("start", designed.start), ("reached", designed.solution.evaluation)):
        rows = _values(functions, at)
        result.add(f"{group}/{name}", [row[0] for row in rows], ("target",))
        result.add(f"{group}/{name}_damping", [row[1] for row in rows], ("target",), note="0 of a norm")
    residuals = [row[2] for row in _values(functions, designed.solution.evaluation)]
    result.add(f"{group}/residual", residuals, ("target",))
    if design.compared:
        others = [functions.at(functions.coordinates.of(values)) for values in design.compared.values()]
        group = f"{GROUP}/compared"
        result.add_axis(f"{group}/design", list(design.compared))
        result.add_axis(f"{group}/name", [parameter.name for parameter in design.free])
        result.add_axis(f"{group}/target", [str(target) for target in design.targets])
        compared_values = np.array([functions.coordinates.values(at.eta) for at in others])
        result.add(f"{group}/value", compared_values, ("design", "name"))
        table = np.array([_values(functions, at) for at in others])
        result.add(f"{group}/reached", table[:, :, 0], ("design", "target"))
        result.add(f"{group}/reached_damping", table[:, :, 1], ("design", "target"), note="0 of a norm")


def _unit(functions: DesignFunctions, target: Target) -> str:
    if isinstance(target, RootTarget):
        return "rad/s"
    if isinstance(target, LoopTarget):
        return target.unit
    unit = GraphUnits(functions.design.graph).of_channel(target.output, target.input)
    return f"{unit}.s^-0.5" if target.kind == "h2" and unit else unit


def _values(functions: DesignFunctions, at: Evaluation) -> list[tuple[float, float, float]]:
    """Return of each target frequency, damping ratio and residual, or norm and 0, 0; inf without a root."""
    roots, sizes = iter(at.reached), iter(at.norms)
    rows = []
    for target in functions.design.targets:
        if isinstance(target, Criterion):
            rows.append((next(sizes).value, 0.0, 0.0))
        elif (root := next(roots)) is None:
            rows.append((math.inf, 0.0, 0.0))
        else:
            rows.append((root.frequency, root.damping, float(np.abs(root.residuals).max())))
    return rows


def _add_responses(result: Result, designed: Designed, omega: Array | None) -> None:
    """Add the responses of the targets' channels at the start and as designed."""
    functions, group = designed.functions, f"{GROUP}/frequency_response"
    design = functions.design
    if any(loop.delayed or loop.sampling is not None for loop in design.loops):
        return  # the equations have approximants of delays, and sampled loops cut
    ends = (functions.coordinates.start, designed.solution.evaluation.eta)
    matrices = [functions.matrices(eta) for eta in ends]
    channels: dict[str, Target] = {}
    for target in design.targets:
        channels.setdefault(f"{target.output}/{target.input}", target)
    if omega is None:
        sizes = np.concatenate([np.abs(np.linalg.eigvals(system.A)) for system in matrices])
        sizes = sizes[sizes > 1e-9 * sizes.max(initial=0.0)]
        low, high = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
        omega = np.geomspace(low / _RANGE_FACTOR, high * _RANGE_FACTOR, _RESPONSE_POINTS)
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/channel", list(channels))
    units = GraphUnits(design.graph)
    texts = [units.of_channel(target.output, target.input) for target in channels.values()]
    result.add(f"{group}/unit", np.array(texts, dtype=object), ("channel",))
    for name, channel_matrices in zip(("start", "designed"), matrices, strict=True):
        columns = [functions.response(channel_matrices, target, omega) for target in channels.values()]
        result.add(f"{group}/{name}", np.array(columns).T, ("omega", "channel"))
