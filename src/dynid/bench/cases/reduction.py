"""Reductions of a plate to few DOFs, and joints of a beam identified on reduced bases.

The records of the beam are exact ones of its full structure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any, get_args

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.modes import plate, reference
from dynid.defaults import BASIS_BAND, MASTERS, RESIDUALS
from dynid.identification.records.measurement import Experiment
from dynid.structure.reduction.masters import Choice, Masters

#: Coordinates kept, and modes that are compared.
_KEPT, _COMPARED = 10, 5
_MODES = tuple(range(1, _KEPT + 1))
#: Sampling step, s, and length of the beam, m.
_STEP, _LENGTH = 0.002, 7.0
#: Sensors and force, and the elements of the beam on a basis of a number of modes.
_SENSORS, _DRIVEN, _ELEMENTS = ("w_4", "w_6"), "w_4", 7
#: Frequencies of the force, rad/s: as Yang excites the beam, and where the paper's basis fails most.
_OMEGA, _HARD_OMEGA = (41.0, 132.0, 271.0), (45.0, 250.0, 300.0)


def _model(dofs: int) -> Any:
    from scipy.sparse import csc_array

    from dynid.structure.model import StructuralModel

    K, M = plate(dofs)
    return StructuralModel(M, csc_array(K.shape), K)


def _reduced(model: Any, method: str, **options: Any) -> Any:
    from dynid.structure.modes import modes
    from dynid.structure.reduction.methods import reduce

    return modes(*reduce(model, method, **options).dense()).omega ** 2


def _error(dofs: int, result: Any) -> float:
    true = reference(plate, dofs)[:_COMPARED]
    return float(np.max(np.abs(np.sqrt(result[:_COMPARED] / true) - 1)))


def _model_and_masters(dofs: int) -> tuple[Any, list[int]]:
    """Return the plate, and deflections that are spread evenly over it."""
    from dynid.bench.meshes import deflections

    places = deflections(max(2, round((dofs / 3) ** 0.5) - 1))
    spread = np.linspace(0, len(places) - 1, _KEPT + 2).astype(int)[1:-1]
    return _model(dofs), [int(places[k]) for k in spread]


def _on_masters(method: str, **options: Any) -> Alternative:
    def work(problem: tuple[Any, list[int]]) -> Any:
        return _reduced(problem[0], method, masters=problem[1], **options)

    return Alternative(method, work, _model_and_masters)


def _chosen(choose: Choice) -> Alternative:
    """Choose the masters of a SEREP basis by a rule, from the modes that it keeps."""
    options = {"modes": _MODES, "masters": Masters(_KEPT, choose)}
    return Alternative(f"serep-{choose}", partial(_reduced, method="serep", **options))


PLATE = Benchmark(
    title="A plate reduced onto ten coordinates, its first five frequencies",
    size="DOFs",
    sizes=(1000, 5000),
    alternatives=(
        *map(_chosen, get_args(Choice)),
        Alternative("modal", partial(_reduced, method="modal", modes=_MODES)),
        _on_masters("guyan"),
        _on_masters("irs"),
        _on_masters("craig-bampton", modes=tuple(range(1, 6))),
    ),
    error=_error,
    problem=_model,
    measure="largest relative error of the first five frequencies",
    default=lambda _: f"serep-{MASTERS.value}",
    full=(50_000,),
)


@lru_cache(maxsize=1)
def _beam_with_joints(elements: int) -> Any:
    """Return Yang's beam with its two joints, started at half their true values."""
    from dynid.structure.assembly import Support
    from dynid.structure.damping import ProportionalDamping
    from dynid.structure.frame import beam
    from dynid.structure.joints import Joint, JointParameter

    k, c = JointParameter(start=5e3, true=1e4), JointParameter(start=10.0, true=20.0)
    joints = [
        Joint("turn", ("theta_1",), JointParameter(start=2.5e3, true=5e3)),
        Joint("link", ("w_6",), k, c),
    ]
    held = [Support(1, ("w",))]
    damping = ProportionalDamping(alpha=0.1)
    return beam(elements, _LENGTH, 1723.3, 0.1, supports=held, damping=damping, joints=joints)


def _record(omega: Sequence[float], samples: int, settle: float) -> tuple[Any, Any]:
    """Return the load of sines of 100 N, and the measurement of two velocities without noise."""
    from dynid.identification.records.measurement import Measurement, Simulation
    from dynid.lti.signals import Multisine
    from dynid.structure.ports import Channel, Load

    loads = [Load(_DRIVEN, Multisine([100.0] * len(omega), list(omega)))]
    channels = tuple(Channel(dof, "velocity") for dof in _SENSORS)
    return loads, Measurement(_STEP, samples, channels, Simulation(0.0, 1, settle))


def _errors(model: Any, omega: Sequence[float], samples: int, settle: float, **options: Any) -> Any:
    """Return the relative errors of the joints' parameters, identified with a model of the beam."""
    from dynid.identification.estimators.filter_passes import Filter
    from dynid.identification.identify import identify

    loads, measurement = _record(omega, samples, settle)
    result = identify(model, Experiment(loads, measurement), Filter(), **options)
    return result["identification/parameters/error_percent"].data / 100


def _below(full: Any, band: float | None) -> Any:
    """Identify on the modes below so many times the band with residual vectors; None: on the full model."""
    from dynid.structure.reduction.modal import ModalTruncation
    from dynid.structure.reduction.mode_selection import Interest, ModeRange

    model = full
    if band is not None:
        modes = ModeRange(below=band * max(_OMEGA))
        model = ModalTruncation(modes, interest=Interest(_SENSORS)).reduce(full).model
    return _errors(model, _OMEGA, 300, 2.0, truth=full)


def _with_residuals(count: int, residuals: Any) -> Any:
    """Identify on a number of modes with the joints, and these residual vectors."""
    from dynid.structure.reduction.mode_selection import Interest, ModeRange
    from dynid.structure.reduction.serep import JointAware

    full = _beam_with_joints(_ELEMENTS)
    method = JointAware(None, ModeRange(count), Interest(_SENSORS), residuals=residuals)

    def rebuild(values: Any) -> Any:
        return method.at(values).reduce(full).model

    return _errors(method.reduce(full).model, _HARD_OMEGA, 400, 10.0, truth=full, rebuild=rebuild)


def _largest(_: int, result: Any) -> float:
    return float(abs(result).max())


BASIS = Benchmark(
    title="Joints of a beam identified on its modes below so many times the band of the excitation",
    size="elements",
    sizes=(7,),
    alternatives=(
        *(Alternative(f"below-{band:g}-bands", partial(_below, band=band)) for band in (5, 1, 2, 10)),
        Alternative("full", partial(_below, band=None), max_size=14),
    ),
    error=_largest,
    problem=_beam_with_joints,
    measure="largest relative error of a joint's parameter",
    default=lambda _: f"below-{BASIS_BAND.value:g}-bands",
    full=(14,),
    remark="beams this small are filtered in about the same time on any basis: times that differ by less "
    "than a third, and with them the front, change from run to run; the errors do not",
)


RESIDUAL_VECTORS = Benchmark(
    title="Joints of a beam identified on its modes with joints, with residual vectors and without",
    size="modes",
    sizes=(5,),
    alternatives=(
        Alternative(f"residuals-{RESIDUALS.value}", partial(_with_residuals, residuals=RESIDUALS.value)),
        Alternative("residuals-none", partial(_with_residuals, residuals=())),
    ),
    error=_largest,
    measure="largest relative error of a joint's parameter",
    default=lambda _: f"residuals-{RESIDUALS.value}",
    full=(6, 8, 12),
    remark="sizes are numbers of requested modes; residual vectors add a coordinate for each DOF of joints, "
    "sensors and forces. Without them no number of modes is reliably accurate",
)
