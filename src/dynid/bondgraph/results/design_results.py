"""Results of a design: designed values, targets wanted and reached, minimum, responses before and after."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dynid.bondgraph.design.design_request import Criterion, RootTarget, Target
from dynid.bondgraph.graph import GraphUnits
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.arrays import Array
    from dynid.bondgraph.design.functions import DesignFunctions, Evaluation
    from dynid.bondgraph.design.solve import Designed

GROUP = "bond_graph/design"
#: Points of the responses where the scene has no frequencies, and their range beyond the poles.
_POINTS, _BEYOND = 400, 10.0


def add_design(result: Result, designed: Designed, omega: Array | None) -> None:
    """Add the results of a design.

    Parameters
    ----------
    result
        Where to add them.
    designed
        The design.
    omega
        Frequencies of the responses before and after, rad/s; None: around the poles.
    """
    functions = designed.functions
    design, coordinates = functions.design, functions.coordinates
    best = designed.solution
    result.annotate(GROUP, starts=design.starts, ended=designed.ended, seed=design.seed)
    result.add_axis(f"{GROUP}/name", [one.name for one in design.free])
    values = coordinates.values(best.found.eta)
    lows = np.array([-math.inf if one.low is None else one.low for one in design.free])
    highs = np.array([math.inf if one.high is None else one.high for one in design.free])
    for name, column in (
        ("start", np.array([one.start for one in design.free])),
        ("value", values),
        ("min", lows),
        ("max", highs),
    ):
        result.add(f"{GROUP}/{name}", column, ("name",))
    bound = np.where(values <= lows, "min", np.where(values >= highs, "max", "")).astype(object)
    result.add(f"{GROUP}/bound", bound, ("name",))
    influence = np.array([one.name not in designed.idle for one in design.free])
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
    result.add_axis(f"{GROUP}/optima/name", [one.name for one in design.free])
    found = np.array([coordinates.values(one.solution.found.eta) for one in optima])
    result.add(f"{GROUP}/optima/value", found, ("optimum", "name"))
    result.add(f"{GROUP}/optima/objective", [one.solution.objective for one in optima], ("optimum",))
    result.add(f"{GROUP}/optima/count", [one.count for one in optima], ("optimum",))
    _add_responses(result, designed, omega)
    _warn(result, designed)


def _warn(result: Result, designed: Designed) -> None:
    """Add warnings of a minimum that is not verified."""
    conditions = designed.solution.conditions
    if conditions is None or conditions.verified:
        return
    text = (
        f"the design is no verified minimum: the first-order residual is {conditions.stationarity:.1g}; "
        "try more 'starts'"
    )
    result.add_axis(f"{GROUP}/warnings", np.array([text], dtype=object))


def _add_targets(result: Result, designed: Designed) -> None:
    """Add the targets: wanted, at the start, reached, and reached by the designs that are compared."""
    functions = designed.functions
    design, group = functions.design, f"{GROUP}/targets"
    result.add_axis(f"{group}/target", [str(one) for one in design.targets])
    kinds = [one.kind for one in design.targets]
    result.add(f"{group}/kind", np.array(kinds, dtype=object), ("target",))
    for name in ("output", "input"):
        names = [str(getattr(one, name)) for one in design.targets]
        result.add(f"{group}/{name}", np.array(names, dtype=object), ("target",))
    units = [_unit(functions, one) for one in design.targets]
    result.add(f"{group}/unit", np.array(units, dtype=object), ("target",))
    wanted = [one.frequency if isinstance(one, RootTarget) else 0.0 for one in design.targets]
    dampings = [
        one.damping if isinstance(one, RootTarget) and one.damping is not None else 0.0
        for one in design.targets
    ]
    note = "rad/s of a zero or pole; 0 of a norm, which is minimised"
    result.add(f"{group}/wanted", wanted, ("target",), note=note)
    result.add(f"{group}/wanted_damping", dampings, ("target",), note="where one is wanted")
    damped = [isinstance(one, RootTarget) and one.damping is not None for one in design.targets]
    result.add(f"{group}/damping_wanted", damped, ("target",))
    for name, at in (("start", designed.start), ("reached", designed.solution.found)):
        rows = _values(functions, at)
        result.add(f"{group}/{name}", [row[0] for row in rows], ("target",))
        result.add(f"{group}/{name}_damping", [row[1] for row in rows], ("target",), note="0 of a norm")
    result.add(f"{group}/residual", _residuals(functions, designed.solution.found), ("target",))
    if design.compared:
        others = [functions.at(functions.coordinates.of(values)) for values in design.compared.values()]
        group = f"{GROUP}/compared"
        result.add_axis(f"{group}/design", list(design.compared))
        result.add_axis(f"{group}/name", [one.name for one in design.free])
        result.add_axis(f"{group}/target", [str(one) for one in design.targets])
        found = np.array([functions.coordinates.values(at.eta) for at in others])
        result.add(f"{group}/value", found, ("design", "name"))
        table = np.array([_values(functions, at) for at in others])
        result.add(f"{group}/reached", table[:, :, 0], ("design", "target"))
        result.add(f"{group}/reached_damping", table[:, :, 1], ("design", "target"), note="0 of a norm")


def _unit(functions: DesignFunctions, target: Target) -> str:
    if isinstance(target, RootTarget):
        return "rad/s"
    unit = GraphUnits(functions.design.graph).of_channel(target.output, target.input)
    return f"{unit}.s^-0.5" if target.kind == "h2" and unit else unit


def _values(functions: DesignFunctions, at: Evaluation) -> list[tuple[float, float]]:
    """Return of each target frequency and damping ratio, or norm and 0; infinite where no root is."""
    roots, sizes = iter(at.reached), iter(at.norms)
    rows = []
    for target in functions.design.targets:
        if isinstance(target, Criterion):
            rows.append((next(sizes).value, 0.0))
        else:
            root = next(roots)
            rows.append((math.inf, 0.0) if root is None else (root.frequency, root.damping))
    return rows


def _residuals(functions: DesignFunctions, at: Evaluation) -> list[float]:
    """Return the largest residual of each wanted root; 0 of norms, which have none."""
    roots = iter(at.reached)
    found = []
    for target in functions.design.targets:
        root = next(roots) if isinstance(target, RootTarget) else None
        found.append(0.0 if root is None else float(np.abs(root.residuals).max()))
    return found


def _add_responses(result: Result, designed: Designed, omega: Array | None) -> None:
    """Add the responses of the targets' channels at the start and as designed."""
    functions, group = designed.functions, f"{GROUP}/frequency_response"
    design = functions.design
    ends = (functions.coordinates.start, designed.solution.found.eta)
    matrices = [functions.matrices(eta) for eta in ends]
    channels: dict[str, Target] = {}
    for target in design.targets:
        channels.setdefault(f"{target.output}/{target.input}", target)
    if omega is None:
        sizes = np.concatenate([np.abs(np.linalg.eigvals(one.A)) for one in matrices])
        sizes = sizes[sizes > 1e-9 * sizes.max(initial=0.0)]
        low, high = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
        omega = np.geomspace(low / _BEYOND, high * _BEYOND, _POINTS)
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/channel", list(channels))
    units = GraphUnits(design.graph)
    texts = [units.of_channel(one.output, one.input) for one in channels.values()]
    result.add(f"{group}/unit", np.array(texts, dtype=object), ("channel",))
    for name, found in zip(("start", "designed"), matrices, strict=True):
        columns = [functions.response(found, one, omega) for one in channels.values()]
        result.add(f"{group}/{name}", np.array(columns).T, ("omega", "channel"))
