"""Samples of the isolator over four parameters: in a batch, as a study, one by one, in a process each."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.bench.benchmark import Alternative, Benchmark

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.scene.outcomes import SampleOutcome
    from dynid.study.plan import Plan

_GROUP = "bond_graph/transfer_function/m_s.f/v_in"
_SCENE = """\
dynid: 1
kind: bond-graph
parameters: {m_s: 10, b: 50, A_p: 0.01, I_f: 2.0e4, C_a: 1.0e-8}
graph:
  nodes:
    v_in: Sf
    base: 0
    body: 1
    m_s: {type: I, value: m_s}
    b: {type: R, value: b}
    tuning: {type: TF, value: A_p}
    fluid: 1
    I_f: {type: I, value: I_f}
    C_a: {type: C, value: C_a}
  bonds: [v_in -> base -> body, body -> m_s, body -> b, base -> tuning -> fluid, fluid -> I_f, fluid -> C_a]
analysis: {inputs: [v_in], outputs: [m_s.f], results: [zeros, poles, properties]}
"""
_STUDY = """\
dynid: 1
kind: study
scene: isolator.yaml
vary:
  parameters.m_s: {{distribution: uniform, low: 5, high: 20}}
  parameters.b: {{distribution: uniform, low: 10, high: 40}}
  parameters.A_p: {{distribution: uniform, low: 0.005, high: 0.02}}
  parameters.C_a: {{distribution: loguniform, low: 0.5e-8, high: 2.0e-8}}
sampling: {{method: latin-hypercube, samples: {samples}, seed: 1}}
collect:
  - bond_graph/transfer_function/m_s.f/v_in/zeros
  - bond_graph/transfer_function/m_s.f/v_in/poles
  - bond_graph/properties/m_s.f/v_in/dc_gain
  - bond_graph/properties/m_s.f/v_in/high_frequency_gain
"""

Work = Callable[[], Any]


def _plan(samples: int) -> Plan:
    """Write the study into a folder of its own, and plan it."""
    from dynid.scene.load import load_scene
    from dynid.study.plan import make_plan

    folder = Path(tempfile.mkdtemp())
    (folder / "isolator.yaml").write_text(_SCENE, encoding="utf-8")
    (folder / "study.yaml").write_text(_STUDY.format(samples=samples), encoding="utf-8")
    return make_plan(load_scene(folder / "study.yaml"))


def _poles(outcomes: Sequence[SampleOutcome]) -> NDArray[np.complex128]:
    import numpy as np

    return np.array([outcome.values[f"{_GROUP}/poles"].data for outcome in outcomes])


def _together(samples: int) -> Work:
    from dynid.scene.batch import run_batch

    plan = _plan(samples)
    overrides = plan.overrides(range(samples))
    return lambda: _poles(run_batch(plan.base, overrides, plan.collect))


def _alone(samples: int) -> Work:
    from dynid.scene.batch import run_alone

    plan = _plan(samples)
    overrides = plan.overrides(range(samples))
    return lambda: _poles([run_alone(plan.base, one, plan.collect) for one in overrides])


def _as_study(executor: str) -> Callable[[int], Work]:
    """Return a planned study run as by the command: with journal, file and statistics."""

    def prepare(samples: int) -> Work:
        from dynid.store import read_result
        from dynid.study.executors import make_executor
        from dynid.study.run import run_study

        plan = _plan(samples)

        def work() -> Any:
            target = Path(tempfile.mkdtemp()) / "study.h5"
            run_study(plan, target, make_executor(executor))
            return read_result(target)[f"study/results/{_GROUP}/poles"].data

        return work

    return prepare


def run_each(plan: Plan, path: str) -> Work:
    """Return one command for each sample of a study, which reads the array at a path of its result."""
    import numpy as np

    from dynid.store import read_result

    def work() -> Any:
        found = []
        for number in range(plan.size):
            target = Path(tempfile.mkdtemp()) / "sample.h5"
            settings = [f"--set={key}={value!r}" for key, value in plan.override(number).items()]
            command = [sys.executable, "-m", "dynid", "run", plan.base.source.file, "-q", "-o", str(target)]
            subprocess.run([*command, *settings], check=True)
            found.append(read_result(target)[path].data)
        return np.array(found)

    return work


def _processes(samples: int) -> Work:
    """Return one command for each sample."""
    return run_each(_plan(samples), f"{_GROUP}/poles")


def _error(samples: int, found: Any) -> float:
    """Return the largest relative distance from the poles of Park & Kim 1997, eq 21, to 50 digits."""
    plan, errors = _plan(samples), []
    for number in range(0, samples, max(1, samples // 100)):
        values = plan.override(number)
        with localcontext(prec=50):
            m_s, b, A_p, C_a = (
                Decimal(repr(float(values[f"parameters.{n}"]))) for n in ("m_s", "b", "A_p", "C_a")
            )
            mass = m_s + A_p**2 * 20_000
            real = -b / (2 * mass)
            imag = (A_p**2 / (C_a * mass) - real**2).sqrt()
            size = (real**2 + imag**2).sqrt()
            poles = found[number].tolist()
            off = ((Decimal(p.real) - real) ** 2 + (abs(Decimal(p.imag)) - imag) ** 2 for p in poles)
            errors.append(float(max(part.sqrt() for part in off) / size))
    return max(errors)


BENCHMARK = Benchmark(
    title="Zeros, poles and gains of samples of the isolator over four parameters",
    size="samples",
    sizes=(3, 100, 1000, 10_000),
    alternatives=(
        Alternative("study-processes", _as_study("processes")),
        Alternative("study-serial", _as_study("serial")),
        Alternative("together", _together),
        Alternative("run", _alone, most=100),
        Alternative("process-each", _processes, most=3),
    ),
    error=_error,
    measure="largest relative distance of poles from eq 21 in 50 digits",
    full=(100_000,),
)
