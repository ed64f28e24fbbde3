"""Samples of studies: in a batch, as a study, one by one, in a process each.

The isolator over four parameters, reductions of a beam, and identifications of a suspension over seeds.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from decimal import Decimal, localcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark

if TYPE_CHECKING:
    from dynid.study.plan import Plan

_POLES = "bond_graph/transfer_function/m_s.f/v_in/poles"
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


def planned(samples: int, scene: str, study: str) -> Plan:
    """Write a scene and the study of it (a format of `samples`) into a folder of their own, and plan it."""
    from dynid.scene.load import load_scene
    from dynid.study.plan import make_plan

    folder = Path(tempfile.mkdtemp())
    text = study.format(samples=samples)
    name = next(line for line in text.splitlines() if line.startswith("scene:")).split()[1]
    (folder / name).write_text(scene, encoding="utf-8")
    (folder / "study.yaml").write_text(text, encoding="utf-8")
    return make_plan(load_scene(folder / "study.yaml"))


_plan = partial(planned, scene=_SCENE, study=_STUDY)


def _together(plan: Plan, path: str) -> Any:
    """Return the array at a path of the samples of a study, run as one batch."""
    from dynid.scene.batch import run_batch

    outcomes = run_batch(plan.base, plan.overrides(range(plan.size)), plan.collect)
    return np.array([outcome.values[path].data for outcome in outcomes])


def _alone(plan: Plan, path: str) -> Any:
    """Return that of samples run one by one in this process."""
    from dynid.scene.batch import run_alone

    outcomes = [run_alone(plan.base, override, plan.collect) for override in plan.overrides(range(plan.size))]
    return np.array([outcome.values[path].data for outcome in outcomes])


def _in_processes(plan: Plan, path: str) -> Any:
    """Return that of the results of one command for each sample."""
    from dynid.store import read_result

    results = []
    for number in range(plan.size):
        target = Path(tempfile.mkdtemp()) / "sample.h5"
        settings = [f"--set={key}={value!r}" for key, value in plan.override(number).items()]
        command = [sys.executable, "-m", "dynid", "run", plan.base.source.file, "-q", "-o", str(target)]
        subprocess.run([*command, *settings], check=True)
        results.append(read_result(target)[path].data)
    return np.array(results)


def _as_study(plan: Plan, executor: str) -> Any:
    """Run a planned study as by the command: with journal, file and statistics."""
    from dynid.store import read_result
    from dynid.study.executors import make_executor
    from dynid.study.run import run_study

    target = Path(tempfile.mkdtemp()) / "study.h5"
    run_study(plan, target, make_executor(executor))
    return read_result(target)[f"study/results/{_POLES}"].data


def _ways(path: str) -> tuple[Alternative, ...]:
    """Return the ways to run the samples of a study for the array at a path."""
    return (
        Alternative("together", partial(_together, path=path)),
        Alternative("run", partial(_alone, path=path), max_size=100),
        Alternative("process-each", partial(_in_processes, path=path), max_size=3),
    )


def _error(samples: int, results: Any) -> float:
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
            poles = results[number].tolist()
            off = ((Decimal(p.real) - real) ** 2 + (abs(Decimal(p.imag)) - imag) ** 2 for p in poles)
            errors.append(float(max(squared.sqrt() for squared in off) / size))
    return max(errors)


BENCHMARK = Benchmark(
    title="Zeros, poles and gains of samples of the isolator over four parameters",
    size="samples",
    sizes=(3, 100, 1000, 10_000),
    alternatives=(
        *(
            Alternative(f"study-{executor}", partial(_as_study, executor=executor))
            for executor in ("processes", "serial")
        ),
        *_ways(_POLES),
    ),
    error=_error,
    problem=_plan,
    measure="largest relative distance of poles from eq 21 in 50 digits",
    full=(100_000,),
)


# SEREP over stiffness and mass of a beam.
_FREQUENCIES = "reduction/serep/frequencies"
_ELEMENTS, _LENGTH = 12, 7.0
_BEAM = f"""\
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
_BEAMS = f"""\
dynid: 1
kind: study
scene: beam.yaml
vary:
  parameters.EI: {{{{distribution: uniform, low: 1500, high: 2000}}}}
  parameters.rhoA: {{{{distribution: uniform, low: 0.05, high: 0.2}}}}
sampling: {{{{method: latin-hypercube, samples: {{samples}}, seed: 1}}}}
collect: [{_FREQUENCIES}]
"""
_beams = partial(planned, scene=_BEAM, study=_BEAMS)


def _off_frequencies(samples: int, frequencies: Any) -> float:
    """Return the error against the frequencies of one beam, scaled by the root of EI / rhoA."""
    from scipy.linalg import eigh

    from dynid.structure.assembly import Support
    from dynid.structure.frame import beam
    from dynid.structure.matrices import as_array

    ends = [Support(1, ("w",)), Support(_ELEMENTS + 1, ("w", "theta"))]
    unit = beam(_ELEMENTS, _LENGTH, 1.0, 1.0, supports=ends)
    omega = np.sqrt(eigh(as_array(unit.K), as_array(unit.M), eigvals_only=True)[: frequencies.shape[1]])
    plan = _beams(samples)
    values = np.array([list(plan.override(number).values()) for number in range(samples)], dtype=float)
    true = np.sqrt(values[:, :1] / values[:, 1:]) * omega
    return float(np.max(np.abs(frequencies / true - 1)))


REDUCTIONS = Benchmark(
    title="SEREP of samples of a beam of 23 DOFs over its stiffness and mass",
    size="samples",
    sizes=(3, 100),
    full=(10_000,),
    alternatives=_ways(_FREQUENCIES),
    problem=_beams,
    default=lambda _: "together",
    error=_off_frequencies,
    measure="largest relative error of a frequency",
)


# Yang's beam with two joints over their stiffnesses, as commands.
_MASTERS = (1, 6, 10)
_METHODS = {
    "irs": f"method: irs, masters: {[*_MASTERS]}",
    "serep": f"method: serep, masters: {[*_MASTERS]}, modes: [2, 3, 4]",  # mode 1 is rigid
    "guyan": f"method: guyan, masters: {[*_MASTERS]}",
    "craig-bampton": f"method: craig-bampton, masters: {[*_MASTERS]}, modes: {{count: 2}}",
    "joint-aware": f"method: joint-aware, masters: {[*_MASTERS]}, modes: [1, 2, 3]",
}
_JOINED = """\
dynid: 1
kind: reduction
structure:
  beam: {elements: 7, length: 7, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w]}]}
joints:
  root: {dofs: [1], k: 5.0e3}
  support: {dofs: [10], k: 1.0e4, c: 20}
reduction:
"""
_JOINTS = """\
dynid: 1
kind: study
scene: beam.yaml
vary:
  joints.root.k: {{distribution: uniform, low: 2000, high: 8000}}
  joints.support.k: {{distribution: uniform, low: 5000, high: 20000}}
sampling: {{method: latin-hypercube, samples: {samples}, seed: 1}}
"""
#: IRS of all samples side by side; the joints' stiffnesses are in `joints.npy`.
_STACKED = f"""\
import numpy as np
n, EI, rhoA = 7, 1723.3, 0.1
ke = EI * np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4.0]])
me = rhoA / 420 * np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4.0]])
K, M = np.zeros((2, 16, 16))
for e in range(n):
    K[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += ke
    M[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += me
K, M, joints = K[1:, 1:], M[1:, 1:], np.load("joints.npy")
Ks = np.repeat(K[None], len(joints), 0)
Ks[:, 0, 0] += joints[:, 0]
Ks[:, 9, 9] += joints[:, 1]
m = np.array({[*_MASTERS]}) - 1
s = np.setdiff1d(np.arange(15), m)
T = np.zeros((len(joints), 15, 3))
T[:, m] = np.eye(3)
inverse = np.linalg.inv(Ks[:, s][:, :, s])
T[:, s] = -inverse @ Ks[:, s][:, :, m]
def reduced(T):
    return [np.swapaxes(T, 1, 2) @ A @ T for A in (Ks, M)]
Kr, Mr = reduced(T)
S = np.zeros_like(Ks)
S[:, s[:, None], s] = inverse
Kr, Mr = reduced(T + S @ M @ T @ np.linalg.solve(Mr, Kr))
L = np.linalg.inv(np.linalg.cholesky(Mr))
np.save("irs.npy", np.sqrt(np.linalg.eigvalsh(L @ Kr @ np.swapaxes(L, 1, 2))))
"""


def _joined(samples: int, methods: tuple[str, ...]) -> Path:
    """Write the study of some methods, and the script beside it, into a folder of their own."""
    scene = _JOINED + "".join(f"  - {{{_METHODS[name]}}}\n" for name in methods)
    collected = f"collect: [{', '.join(f'reduction/{name}/frequencies' for name in methods)}]\n"
    plan = planned(samples, scene, _JOINTS + collected)
    folder = plan.base.folder
    np.save(folder / "joints.npy", np.array([plan.values(path, range(samples)) for path in plan.settings]).T)
    (folder / "script.py").write_text(_STACKED, encoding="utf-8")
    return folder


def _command(folder: Path, method: str) -> tuple[str, Any]:
    """Run the study, and return the frequencies of a method."""
    from dynid.store import read_result

    target = folder / "study.h5"
    target.unlink(missing_ok=True)
    command = [sys.executable, "-m", "dynid", "study", "study.yaml", "-q"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return method, read_result(target)[f"study/results/reduction/{method}/frequencies"].data


def _stacked(folder: Path) -> tuple[str, Any]:
    subprocess.run([sys.executable, "script.py"], cwd=folder, check=True, capture_output=True)
    return "irs", np.load(folder / "irs.npy")


def _off_joined(samples: int, answer: tuple[str, Any]) -> float:
    """Return the error of the frequencies of some samples against dense ones."""
    from scipy.linalg import block_diag, eigh, solve

    from dynid.structure.assembly import Support
    from dynid.structure.frame import beam
    from dynid.structure.matrices import as_array

    method, frequencies = answer
    bare = beam(7, 7.0, 1723.3, 0.1, supports=[Support(1, ("w",))])
    M, K, errors = as_array(bare.M), as_array(bare.K), []
    order = np.r_[np.array(_MASTERS) - 1, np.setdiff1d(np.arange(15), np.array(_MASTERS) - 1)]
    M, bare_K = M[order][:, order], K[order][:, order]
    values = np.load(_joined(samples, (method,)) / "joints.npy")
    for k in range(0, samples, max(1, samples // 20)):
        K = bare_K + np.diag([values[k, 0], 0, values[k, 1], *[0.0] * 12])
        if method == "irs":
            inverse = block_diag(np.zeros((3, 3)), np.linalg.inv(K[3:, 3:]))
            T = np.vstack([np.eye(3), -solve(K[3:, 3:], K[3:, :3])])
            T = T + inverse @ M @ T @ solve(T.T @ M @ T, T.T @ K @ T)
        else:
            shapes = eigh(bare_K, M)[1][:, 1:4]
            T = shapes @ np.linalg.inv(shapes[:3])
        true = np.sqrt(eigh(T.T @ K @ T, T.T @ M @ T, eigvals_only=True))
        errors.append(np.max(np.abs(frequencies[k] / true - 1)))
    return float(max(errors))


def _as_command(name: str, *methods: str) -> Alternative:
    return Alternative(name, partial(_command, method=methods[0]), partial(_joined, methods=methods))


REDUCTION_COMMANDS = Benchmark(
    title="Reductions of samples of a beam with two joints over their stiffness, whole processes",
    size="samples",
    sizes=(3, 1000),
    alternatives=(
        _as_command("irs", "irs"),
        _as_command("serep", "serep"),
        _as_command("five-methods", *_METHODS),
        Alternative("stacked-irs", _stacked, partial(_joined, methods=("irs",)), peer=True),
    ),
    error=_off_joined,
    default=lambda _: "irs",
    measure="largest relative error of a frequency by IRS, or SEREP",
    remark="stacked-irs is a script for this beam alone, in stacks of NumPy, without checks, journal or file",
)


# Yang's Table 2 over seeds of its noise.
_ESTIMATE = "identification/parameters/estimate"
_SUSPENSION = """\
dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 2, 1.5, 1, 1]
    links:
      - {dofs: [1], k: 2.0e4, c: 20}
      - {dofs: [1, 2], k: 3.0e4, c: 30}
      - {dofs: [4, 5], k: 2.0e4, c: 20}
joints:
  upper: {dofs: [2, 3], k: {start: 1.0e4, true: 2.0e4}, c: {start: 10, true: 20}}
  lower: {dofs: [3, 4], k: {start: 1.0e4, true: 2.0e4}, c: {start: 10, true: 20}}
excitation: [{dof: 5, kind: multisine, amplitude: [100, 100, 100], frequency: [70, 110, 250]}]
measurement:
  step: 0.002
  samples: 800
  channels: [{dof: 2, quantity: velocity}, {dof: 3, quantity: velocity}]
  simulate: {noise_ratio: 0.05, seed: 1, settle: 10}
"""
_SEEDS = """\
dynid: 1
kind: study
scene: suspension.yaml
vary: {{measurement.simulate.seed: {{start: 1, stop: {samples}, points: {samples}}}}}
collect:
  - identification/parameters/estimate
  - identification/parameters/standard_error
  - identification/parameters/cramer_rao
  - identification/parameters/error_percent
  - identification/diagnostics/converged
  - identification/diagnostics/whiteness_p
"""
_seeds = partial(planned, scene=_SUSPENSION, study=_SEEDS)


def _off_optimum(samples: int, estimates: Any) -> float:
    """Return the distance from the maximum of the likelihood, climbed from the truth, in standard errors."""
    from dynid.scene.batch import run_alone

    plan, worst = _seeds(samples), 0.0
    error = "identification/parameters/standard_error"
    truth: dict[str, str | float] = {"estimator.method": "output-error"}
    for joint in ("upper", "lower"):
        truth |= {f"joints.{joint}.k.start": 2.0e4, f"joints.{joint}.c.start": 20}
    for number in range(min(samples, 10)):
        reference = run_alone(plan.base, {**plan.override(number), **truth}, (_ESTIMATE, error)).values
        off = np.abs(estimates[number] - reference[_ESTIMATE].data) / reference[error].data
        worst = max(worst, float(off.max()))
    return worst


IDENTIFICATIONS = Benchmark(
    title="Identifications of the suspension from noisy records (Yang, Table 2) over their seeds",
    size="samples",
    sizes=(3, 100),
    full=(10_000,),
    alternatives=_ways(_ESTIMATE),
    problem=_seeds,
    default=lambda _: "together",
    error=_off_optimum,
    measure="largest distance from the maximum of the likelihood, in standard errors",
)
