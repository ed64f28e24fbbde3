"""Joints of a beam identified on bases of different width, from an exact record of the full structure."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import BASIS_BAND

_OMEGA = (41.0, 132.0, 271.0)  # rad/s, as Yang excites it
_STEP, _SAMPLES, _SETTLE, _LENGTH = 0.002, 300, 2.0, 7.0
_SENSORS, _DRIVEN = ("w_4", "w_6"), "w_4"


@lru_cache(maxsize=1)
def beam_with_joints(elements: int) -> Any:
    """Return Yang's beam with its two joints, started at half their true values."""
    from dynid.structure.assembly import Support
    from dynid.structure.beam import beam
    from dynid.structure.damping import ProportionalDamping
    from dynid.structure.joints import Joint, JointParameter

    k, c = JointParameter(start=5e3, true=1e4), JointParameter(start=10.0, true=20.0)
    joints = [
        Joint("turn", ("theta_1",), JointParameter(start=2.5e3, true=5e3)),
        Joint("link", ("w_6",), k, c),
    ]
    held = [Support(1, ("w",))]
    damping = ProportionalDamping(alpha=0.1)
    return beam(elements, _LENGTH, 1723.3, 0.1, supports=held, damping=damping, joints=joints)


def _identified(reduce: Callable[[Any], Any]) -> Callable[[int], Callable[[], Any]]:
    def prepare(elements: int) -> Callable[[], Any]:
        from dynid.identification.estimators.filter_passes import Filter
        from dynid.identification.identify import identify
        from dynid.identification.measurement import Measurement, Simulation
        from dynid.lti.signals import Multisine
        from dynid.structure.response import Channel, Load

        full = beam_with_joints(elements)
        loads = [Load(_DRIVEN, Multisine([100.0] * 3, list(_OMEGA)))]
        channels = tuple(Channel(dof, "velocity") for dof in _SENSORS)
        measurement = Measurement(_STEP, _SAMPLES, channels, Simulation(0.0, 1, _SETTLE))

        def work() -> Any:
            found = identify(reduce(full), loads, measurement, Filter(), truth=full)
            return found["identification/parameters/error_percent"].data / 100

        return work

    return prepare


def _below(band: float) -> Callable[[Any], Any]:
    """Keep the modes below so many times the band, and residual vectors at joints, sensors and force."""

    def reduce(full: Any) -> Any:
        from dynid.structure.reduction.modal import ModalTruncation
        from dynid.structure.reduction.mode_selection import Interest, ModeRange

        return (
            ModalTruncation(ModeRange(below=band * max(_OMEGA)), interest=Interest(_SENSORS))
            .reduce(full)
            .model
        )

    return reduce


def _error(_: int, found: Any) -> float:
    return float(abs(found).max())


BENCHMARK = Benchmark(
    title="Joints of a beam identified on its modes below so many times the band of the excitation",
    size="elements",
    sizes=(7,),
    alternatives=(
        *(Alternative(f"below-{band:g}-bands", _identified(_below(band))) for band in (5, 1, 2, 10)),
        Alternative("full", _identified(lambda full: full), most=14),
    ),
    error=_error,
    measure="largest relative error of a joint's parameter",
    default=lambda _: f"below-{BASIS_BAND.value:g}-bands",
    full=(14,),
    remark="beams this small are filtered in about the same time on any basis: times that differ by less "
    "than a third, and with them the front, change from run to run; the errors do not",
)
