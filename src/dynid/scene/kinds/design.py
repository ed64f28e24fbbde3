"""Designs of a scene: the graph as a function of its free parameters, and the scene with designed values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

from pydantic import ValidationError

from dynid.bondgraph.controller_circuits import Loop
from dynid.bondgraph.design.design_request import Criterion, Design, LoopTarget, RootTarget, Target
from dynid.bondgraph.graph import Port
from dynid.errors import SceneError, UsageError
from dynid.parameters import Parameter
from dynid.scene.kinds.graph_parts import build_graph, has_law
from dynid.scene.kinds.parameters import quantities
from dynid.scene.kinds.signals import angular_frequencies
from dynid.scene.load import Scene, check_source, with_text_keys
from dynid.scene.schema.base import DefinedParameter, Section
from dynid.scene.schema.bond_graph import BondGraphScene, GraphModel
from dynid.scene.schema.control import ControlModel
from dynid.scene.schema.design import DesignModel, DesignTarget
from dynid.scene.schema.faults import located_faults
from dynid.scene.schema.quantities import AT_KEY, Located, Quantity
from dynid.scene.schema.raw import read_names
from dynid.units import angular_factor


def designed_scene(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return a scene without its design, in which free parameters have the designed values."""
    data = {key: value for key, value in scene.source.data.items() if key not in ("design", "models", "use")}
    data["parameters"] = {str(name): value for name, value in data["parameters"].items()} | dict(values)
    return check_source(replace(scene.source, data=data, overridden=True))


def design_of(scene: Scene[BondGraphScene]) -> Design:
    """Return the design that a scene requests, its graph a function of the free parameters.

    Raises `UsageError` if a number of a parameter does not fit its scale, or a part of the graph cannot
    depend on parameters.
    """
    model = scene.model
    design_model = cast("DesignModel", model.design)
    parts = _dependent_parts(scene)
    targeted = (item.output for item in design_model.targets if item.output)
    asked = list(dict.fromkeys([*model.analysis.outputs, *targeted]))
    built = build_graph(scene, parts.graph, asked, model.analysis.reading, control=parts.control)
    variables = dict(zip(asked, built.outputs, strict=True))
    sources = (name for name, node in built.graph.nodes.items() if node.type in ("Se", "Sf"))
    inputs = list(model.analysis.inputs or sources)
    outputs = [variables[item] for item in model.analysis.outputs]

    def channel(target: DesignTarget) -> tuple[Port, str]:
        return (variables[target.output] if target.output else outputs[0]), target.input or inputs[0]

    grid = model.analysis.frequency
    omega = angular_frequencies(grid) if grid else None
    band = (0.0, math.inf) if omega is None or len(omega) < 2 else (float(omega[0]), float(omega[-1]))
    free = tuple(_free_parameter(model, design_model, name) for name in design_model.free)
    compared = {}
    for title, values in design_model.compare.items():
        compared[title] = {name: float(value) for name, value in values.items()}
    return Design(
        built.graph,
        free,
        tuple(_target(item, *channel(item), band, built.loops, free) for item in design_model.targets),
        design_model.starts,
        design_model.seed,
        compared,
        built.opened,
        built.loops,
    )


def check_design(scene: Scene[BondGraphScene]) -> None:
    """Check the free parameters of a design.

    Raises `SceneError` if a number does not fit the scale or limits of its parameter, or nothing depends on a
    free one.
    """
    model, source = scene.model, scene.source
    if model.design is None:
        return
    lawful = next((name for name, node in model.graph.nodes.items() if has_law(node)), None)
    if lawful is not None or model.operating_point is not None:
        where = f"'{lawful}' has a law" if lawful is not None else "there is an 'operating_point'"
        message = f"a design is of a linear graph, and {where}; write the slope at its point as a value"
        raise SceneError([source.fault(("design",), message, key=True)])
    try:
        parts = _dependent_parts(scene)
    except ValidationError as error:
        raise SceneError(located_faults(source, _DependentParts, error)) from None
    used: set[str] = set()
    for _, quantity in quantities(parts):
        used |= quantity.dependent.names if quantity.dependent is not None else set()
    message = "nothing in the graph depends on this parameter; use it in a value, or do not free it"
    faults: list[Located] = []
    for name in model.design.free:
        path = ("design", "free", name, AT_KEY)
        if name not in used:
            faults.append((path, message))
        try:
            _free_parameter(model, model.design, name)
        except UsageError as error:
            faults.append((path, str(error)))
    scene.raise_faults(faults)


class _DependentParts(Section):
    """The parts of a scene whose quantities may depend on free parameters."""

    graph: GraphModel
    control: ControlModel | None = None


def _dependent_parts(scene: Scene[BondGraphScene]) -> _DependentParts:
    """Return graph and feedback of a scene with quantities that depend on the free parameters."""
    model = scene.model
    assert model.design is not None
    starts = {name: _start(model, name) for name in model.design.free}
    names, _ = read_names(scene.source, free=starts)
    data = with_text_keys(scene.source.data)
    parts = {key: data[key] for key in ("graph", "control") if key in data}
    return _DependentParts.model_validate(parts, context=names)


def _start(model: BondGraphScene, name: str) -> float:
    """Return the start of a free parameter: its own, else the parameter's value."""
    from dynid.arithmetic.expression import resolve_parameters

    assert model.design is not None
    free_start = model.design.free[name].start
    if free_start is not None:
        return float(free_start)
    entry = model.parameters[name]
    if isinstance(entry, DefinedParameter):
        return float(entry.reference)
    return float(resolve_parameters({name: entry})[0][name])


def _free_parameter(model: BondGraphScene, design: DesignModel, name: str) -> Parameter:
    """Return a free parameter: by its logarithm if it is positive, and a limit is not negative or zero."""
    from dynid.parameters import Parameter

    free, entry = design.free[name], model.parameters[name]
    lowest, highest, scale = free.min, free.max, free.scale
    if isinstance(entry, DefinedParameter):
        lowest, highest, scale = lowest or entry.min, highest or entry.max, scale or entry.scale
    start, low, high = _start(model, name), _number(lowest), _number(highest)
    scale = scale or ("log" if start > 0 and (low is None or low > 0) else "linear")
    return Parameter(name, start, None, low, high, scale=scale)


def _number(quantity: Quantity | None) -> float | None:
    return None if quantity is None else float(quantity)


def _target(
    target: DesignTarget,
    output: Port,
    source: str,
    band: tuple[float, float],
    loops: Sequence[Loop],
    free: Sequence[Parameter],
) -> Target:
    if target.maximise is not None:
        if not next(parameter for parameter in free if parameter.name == target.maximise).logarithmic:
            raise UsageError(
                f"'{target.maximise}' is not positive: what is maximised has a start and a 'min' above 0",
                remedy="Give it a positive start, or 'scale: log'.",
                names=(f"design.free.{target.maximise}",),
            )
        return Criterion("maximise", output, source, parameter=target.maximise)
    if target.margin is not None:
        index = (target.loop or 1) - 1
        name, value = f"{loops[index].measured} -> {loops[index].source}", getattr(target, target.margin)
        return LoopTarget(target.margin, index, name, float(value), output, source)  # type: ignore[arg-type]
    factor = angular_factor(target.frequency_unit)
    root = target.zero or target.pole
    if root is not None:
        damping = None if root.damping is None else float(root.damping)
        kind = "zero" if target.zero else "pole"
        frequency = factor * float(root.frequency)
        return RootTarget(kind, output, source, frequency, damping, hertz=target.frequency_unit == "Hz")  # type: ignore[arg-type]
    assert target.minimise is not None
    low, high = (factor * float(edge) for edge in target.band) if target.band else band
    weight = 1.0 if target.weight is None else float(target.weight)
    if target.minimise != "peak":
        return Criterion(target.minimise, output, source, weight=weight)
    return Criterion("peak", output, source, low, high, weight)
