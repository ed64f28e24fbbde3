"""Samples of a beam reduced by SEREP over stiffness and mass: side by side, one by one, a command each."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.study import Work, run_each

if TYPE_CHECKING:
    from dynid.study.plan import Plan

_PATH = "reduction/serep/frequencies"
_ELEMENTS, _LENGTH = 12, 7.0
_SCENE = f"""\
dynid: 1
kind: reduction
parameters: {{EI: 1700, rhoA: 0.1}}
structure:
  beam:
    elements: {_ELEMENTS}
    length: {_LENGTH}
    EI: EI
    rhoA: rhoA
    supports: [{{node: 1, fix: [w]}}, {{node: {_ELEMENTS + 1}, fix: [w, theta]}}]
reduction: [{{method: serep, masters: [1, 5, 10, 16, 22], modes: [1, 2, 3, 4, 5]}}]
"""
_STUDY = f"""\
dynid: 1
kind: study
scene: beam.yaml
vary:
  parameters.EI: {{{{distribution: uniform, low: 1500, high: 2000}}}}
  parameters.rhoA: {{{{distribution: uniform, low: 0.05, high: 0.2}}}}
sampling: {{{{method: latin-hypercube, samples: {{samples}}, seed: 1}}}}
collect: [{_PATH}]
"""


def _plan(samples: int) -> Plan:
    """Write the study into a folder of its own, and plan it."""
    from dynid.scene.load import load_scene
    from dynid.study.plan import make_plan

    folder = Path(tempfile.mkdtemp())
    (folder / "beam.yaml").write_text(_SCENE, encoding="utf-8")
    (folder / "study.yaml").write_text(_STUDY.format(samples=samples), encoding="utf-8")
    return make_plan(load_scene(folder / "study.yaml"))


def _together(samples: int) -> Work:
    import numpy as np

    from dynid.scene.batch import run_batch

    plan = _plan(samples)
    overrides = plan.overrides(range(samples))
    return lambda: np.array(
        [outcome.values[_PATH].data for outcome in run_batch(plan.base, overrides, plan.collect)]
    )


def _alone(samples: int) -> Work:
    import numpy as np

    from dynid.scene.batch import run_alone

    plan = _plan(samples)
    overrides = plan.overrides(range(samples))
    return lambda: np.array([run_alone(plan.base, one, plan.collect).values[_PATH].data for one in overrides])


def _processes(samples: int) -> Work:
    """Return one command for each sample."""
    return run_each(_plan(samples), _PATH)


def _error(samples: int, found: Any) -> float:
    """Return the error against the frequencies of one beam, scaled by the root of EI / rhoA."""
    import numpy as np
    from scipy.linalg import eigh

    from dynid.structure.assembly import Support
    from dynid.structure.beam import beam
    from dynid.structure.matrices import as_array

    ends = [Support(1, ("w",)), Support(_ELEMENTS + 1, ("w", "theta"))]
    unit = beam(_ELEMENTS, _LENGTH, 1.0, 1.0, supports=ends)
    omega = np.sqrt(eigh(as_array(unit.K), as_array(unit.M), eigvals_only=True)[: found.shape[1]])
    plan = _plan(samples)
    values = np.array([list(plan.override(number).values()) for number in range(samples)], dtype=float)
    true = np.sqrt(values[:, :1] / values[:, 1:]) * omega
    return float(np.max(np.abs(found / true - 1)))


BENCHMARK = Benchmark(
    title="SEREP of samples of a beam of 23 DOFs over its stiffness and mass",
    size="samples",
    sizes=(3, 100),
    full=(10_000,),
    alternatives=(
        Alternative("together", _together),
        Alternative("run", _alone, most=100),
        Alternative("process-each", _processes, most=3),
    ),
    default=lambda _: "together",
    error=_error,
    measure="largest relative error of a frequency",
)
