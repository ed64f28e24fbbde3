"""Joints of a beam identified on its modes with joints, with residual vectors or without."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.basis import beam_with_joints
from dynid.defaults import RESIDUALS

_OMEGA = (45.0, 250.0, 300.0)  # rad/s, where the paper's basis fails most
_STEP, _SAMPLES, _SETTLE = 0.002, 400, 10.0
_SENSORS, _DRIVEN = ("w_4", "w_6"), "w_4"
_ELEMENTS = 7


def _identified(residuals: Any) -> Callable[[int], Callable[[], Any]]:
    def prepare(count: int) -> Callable[[], Any]:
        from dynid.identification.estimators.filter_passes import Filter
        from dynid.identification.identify import identify
        from dynid.identification.measurement import Measurement, Simulation
        from dynid.lti.signals import Multisine
        from dynid.structure.reduction.mode_selection import Interest, ModeRange
        from dynid.structure.reduction.serep import JointAware
        from dynid.structure.response import Channel, Load

        full = beam_with_joints(_ELEMENTS)
        loads = [Load(_DRIVEN, Multisine([100.0] * len(_OMEGA), list(_OMEGA)))]
        channels = tuple(Channel(dof, "velocity") for dof in _SENSORS)
        measurement = Measurement(_STEP, _SAMPLES, channels, Simulation(0.0, 1, _SETTLE))
        method = JointAware(None, ModeRange(count), Interest(_SENSORS), residuals=residuals)

        def work() -> Any:
            found = identify(
                method.reduce(full).model,
                loads,
                measurement,
                Filter(),
                truth=full,
                rebuild=lambda values: method.at(values).reduce(full).model,
            )
            return found["identification/parameters/error_percent"].data / 100

        return work

    return prepare


def _error(_: int, found: Any) -> float:
    return float(abs(found).max())


BENCHMARK = Benchmark(
    title="Joints of a beam identified on its modes with joints, with residual vectors and without",
    size="modes",
    sizes=(5,),
    alternatives=(
        Alternative(f"residuals-{RESIDUALS.value}", _identified(RESIDUALS.value)),
        Alternative("residuals-none", _identified(())),
    ),
    error=_error,
    measure="largest relative error of a joint's parameter",
    default=lambda _: f"residuals-{RESIDUALS.value}",
    full=(6, 8, 12),
    remark="sizes are the modes asked for; residual vectors add a coordinate for each DOF of joints, sensors "
    "and forces. No number of modes alone is right steadily",
)
