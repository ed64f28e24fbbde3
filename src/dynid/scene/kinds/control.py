"""Feedback loops of a scene as loops of a bond graph."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.ldl import reference
from dynid.bondgraph.control import Loop

if TYPE_CHECKING:
    from dynid.bondgraph.graph import Port
    from dynid.scene.schema.control import ControllerModel, LoopModel, PidModel
    from dynid.scene.schema.quantities import Quantity


def loop_of(loop: LoopModel, measured: Port) -> Loop:
    """Return a loop that measures a variable of the graph."""
    return Loop(measured, loop.source, *_controller(loop.controller), loop.reference)


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
