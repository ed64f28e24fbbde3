"""Feedback loops of a scene as loops of a bond graph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dynid.arithmetic.dependent import Dependent, Real, substituted
from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import Number
from dynid.bondgraph.control import Loop
from dynid.scene.schema.quantities import Quantity

if TYPE_CHECKING:
    from dynid.bondgraph.graph import Port
    from dynid.scene.schema.control import ControllerModel, ControlModel, LoopModel, PidModel


def loop_of(loop: LoopModel, measured: Port, place: int) -> Loop:
    """Return the loop at a place in the scene, which measures a variable of the graph."""
    given = loop.controller
    delay = _number(given.delay)
    return Loop(measured, loop.source, *_controller(given), loop.reference, delay, f"control.loops.{place}")


def _controller(controller: ControllerModel) -> tuple[list[Real], list[Real]]:
    if controller.pid is not None:
        return _pid(controller.pid)
    if controller.numerator is not None and controller.denominator is not None:
        return [_number(entry) for entry in controller.numerator], [
            _number(entry) for entry in controller.denominator
        ]
    return [_number(controller.gain)], [Fraction(1)]


def _pid(pid: PidModel) -> tuple[list[Real], list[Real]]:
    """Return kp + ki/s + kd s/(tf s + 1) as one quotient; without an integral there is no pole at 0."""
    kp, ki, kd, tf = (_number(gain) for gain in (pid.kp, pid.ki, pid.kd, pid.tf))
    if not reference(ki) and not isinstance(ki, Dependent):
        return [kp * tf + kd, kp], [tf, Fraction(1)]
    return [kp * tf + kd, kp + ki * tf, ki], [tf, Fraction(1), Fraction(0)]


def _number(given: Quantity | None) -> Real:
    if given is None:
        return Fraction(0)
    return given.exact if given.dependent is None else given.dependent


def with_gains(control: ControlModel, parameters: Mapping[str, Number]) -> ControlModel:
    """Return feedback whose numbers depend on the scene's parameters, or on themselves by their paths."""
    known = {name: Dependent.parameter(name, value) for name, value in parameters.items()}
    loops = []
    for place, loop in enumerate(control.loops):
        path = f"control.loops.{place}.controller"
        made = _dependent(loop.controller, path, known)
        loops.append(loop.model_copy(update={"controller": made}))
    return control.model_copy(update={"loops": loops})


def _dependent(part: Any, path: str, known: Mapping[str, Dependent]) -> Any:
    """Return a part of a controller with numbers that depend on parameters."""
    from pydantic import BaseModel

    if isinstance(part, Quantity):
        if part.expression is not None and part.expression.names:
            return replace(part, dependent=substituted(part.expression, known))
        return replace(part, dependent=Dependent.parameter(path, part.exact)) if part.value else part
    if isinstance(part, list):
        return [_dependent(entry, f"{path}.{k}", known) for k, entry in enumerate(part)]
    if isinstance(part, BaseModel):
        found = {name: _dependent(value, f"{path}.{name}", known) for name, value in part}
        return part.model_copy(update=found)
    return part
