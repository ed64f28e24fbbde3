"""Processor time of steady states by harmonic balance: of 100 points, and beside pyHarm (pyharm-os 1.2.2).

``python -m benchmarks.steady_states 0``: of 100 points with a cubic spring and with a slider at the tip of a
beam of 12 DOFs, without and with stability.

``python -m benchmarks.steady_states [PAIRS]`` by a Python with both packages: the cubic spring, 40 to 60
rad/s over both folds. Both solve the equations of the same number of harmonics; the error is that of a period
by SciPy's DOP853 from states on the curve, relative to the amplitude. The ratio of processor times is the
median of interleaved pairs. pyHarm is condensed to the nonlinear DOF, and has run before: its compilation is
not counted.
"""

import logging
import statistics
import sys
import time
import warnings
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from dynid.arrays import Array, ComplexArray
from dynid.structure.assembly import Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.hysteretic_laws import Jenkins
from dynid.structure.joint_laws import Cubic
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.law import Law
from dynid.structure.model import StructuralModel
from dynid.structure.model_laws import joint_law
from dynid.structure.nonlinear.continuation import trace
from dynid.structure.nonlinear.harmonic_balance import ForcedResponse, condensed
from dynid.structure.nonlinear.steady_states import harmonic_balance

K3, FORCE, LOW, HIGH, HARMONICS, SAMPLES = 1e6, 1.0, 40.0, 60.0, 7, 64
#: Longest scaled step of pyHarm: with it the curve has about as many points as that of dynid.
LONGEST = 0.4


def structure(law: Law, *parameters: float) -> tuple[StructuralModel, Any]:
    """Return the beam with a law at its tip, and the tip."""
    bare = beam(
        6, 1.0, 500.0, 3.0, supports=[Support(1, ("w", "theta"))], damping=ProportionalDamping(1.0, 1e-5)
    )
    tip = bare.dofs[-2]
    joint = Joint("joint", (tip,), laws=(joint_law(law, [JointParameter(value) for value in parameters]),))
    return bare.joined([joint]), tip


def by_dynid(model: StructuralModel, tip: Any) -> tuple[Array, ComplexArray]:
    """Return frequencies, and amplitudes of the harmonics of all DOFs (points x harmonics x DOFs)."""
    modes = condensed(model, {}, (LOW + HIGH) / 2)
    equations = ForcedResponse(modes, modes.shapes.T @ model.row(tip), FORCE, HARMONICS)
    points = []
    for u in trace(equations, equations.first(LOW), LOW, HIGH, HIGH, 1000, 0.04 * (HIGH - LOW) / HIGH):
        motion = equations.modal_motion(u) @ modes.shapes.T
        points.append((u[-1], np.pad(motion, ((0, HARMONICS + 1 - len(motion)), (0, 0)))))
    return np.array([omega for omega, _ in points]), np.array([motion for _, motion in points])


def by_pyharm(model: StructuralModel, tip: Any) -> tuple[Array, ComplexArray]:
    """Return the same of pyHarm."""
    import pyHarm  # type: ignore[import-not-found,unused-ignore]

    M, C, K = model.without_laws().dense({})
    node, length, omega = model.dofs.index(tip), 1e-2, 45.0
    analysis = {
        "study": "frf", "puls_inf": LOW, "puls_sup": HIGH, "ds_max": LONGEST, "ds_min": 1e-8, "ds0": 0.05,
        "verbose": False, "reductors": [{"type": "NLdofs"}],
    }  # fmt: skip
    at_tip = {"connect": {"beam": [node]}, "dirs": [0]}
    scene = {
        "analysis": {"curve": analysis},
        "system": {
            "type": "Base",
            "nh": HARMONICS,
            "nti": SAMPLES,
            "adim": {"status": True, "lc": length, "wc": omega},
        },
        "substructures": {"beam": {"matrix": {"M": M, "C": C, "K": K, "G": 0 * K}, "ndofs": 1}},
        "connectors": {
            "spring": {"type": "CubicSpring", "k": K3, **at_tip},
            "force": {"type": "GOForcing", "amp": FORCE, "dto": 0, "ho": 1, "phi": 0.0, **at_tip},
        },
        "plugin": [],
        "export": {"status": False},
    }
    run = pyHarm.Maestro(scene)
    run.operate()
    solutions = np.array([point.x for point in run.nls["curve"].SolList if point.flag_accepted])
    q = solutions[:, :-1].reshape(len(solutions), 2 * HARMONICS + 1, -1) * length
    motion = np.concatenate([q[:, :1], q[:, 1::2] - 1j * q[:, 2::2]], axis=1)
    return solutions[:, -1] * omega, motion


def error(model: StructuralModel, tip: Any, omega: float, motion: ComplexArray) -> float:
    """Return the largest change of the tip over a period by DOP853, relative to its amplitude."""
    M, C, K = model.without_laws().dense({})
    n, at = len(M), model.dofs.index(tip)
    order = np.arange(len(motion))
    first = np.concatenate([motion.sum(axis=0).real, (1j * omega * order[:, None] * motion).sum(axis=0).real])

    def rate(t: float, y: Array) -> Array:
        force = -C @ y[n:] - K @ y[:n]
        force[at] += FORCE * np.cos(omega * t) - K3 * y[at] ** 3
        return np.concatenate([y[n:], np.linalg.solve(M, force)])

    t = np.linspace(0, 2 * np.pi / omega, 33)
    y = solve_ivp(rate, (0.0, t[-1]), first, method="DOP853", rtol=1e-10, atol=1e-13, t_eval=t).y[at]
    series = (motion[:, at] * np.exp(1j * np.outer(omega * t, order))).real.sum(axis=1)
    return float(np.abs(y - series).max() / np.abs(series).max())


def cost(runs: int = 5) -> None:
    """Print the processor time of 100 points, median of a few runs."""
    for name, (model, tip), force in (
        ("cubic", structure(Cubic(), K3), FORCE),
        ("jenkins", structure(Jenkins(), 300.0, 0.3), 0.5),
    ):
        for stability in (False, True):
            times = []
            for _ in range(runs + 1):
                before = time.process_time()
                result = harmonic_balance(model, tip, force, LOW, HIGH, stability=stability, backbone=False)
                times.append(time.process_time() - before)
            points = len(result["response/harmonic_balance/omega"].data)
            each = 100 * statistics.median(times[1:]) / points
            print(f"{name}, {points} points, stability {stability}: {each:.2f} s for 100 points", flush=True)


def main(pairs: int) -> None:
    """Print errors, points and ratios of processor time."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    model, tip = structure(Cubic(), K3)
    times: dict[str, list[float]] = {"dynid": [], "pyHarm": []}
    ways = {"dynid": by_dynid, "pyHarm": by_pyharm}
    points = {}
    for name, way in ways.items():
        omega, motion = way(model, tip)
        points[name] = int(np.count_nonzero(omega <= HIGH * (1 + 1e-9)))
        peak = int(np.abs(motion[:, 1, model.dofs.index(tip)]).argmax())
        chosen = [peak // 3, 2 * peak // 3, peak]
        errors = [error(model, tip, omega[k], motion[k]) for k in chosen]
        print(f"{name}: {points[name]} points, errors {', '.join(f'{e:.1e}' for e in errors)}", flush=True)
    for _ in range(pairs):
        for name, way in ways.items():
            before = time.process_time()
            way(model, tip)
            times[name].append(time.process_time() - before)
    ratios = [b / a for a, b in zip(times["dynid"], times["pyHarm"], strict=True)]
    medians = {name: statistics.median(each) for name, each in times.items()}
    each = medians["pyHarm"] / points["pyHarm"] / (medians["dynid"] / points["dynid"])
    print(
        f"processor time of a curve: dynid {medians['dynid']:.3f} s, pyHarm {medians['pyHarm']:.3f} s; "
        f"median ratio of {pairs} pairs {statistics.median(ratios):.1f}, per point {each:.1f}"
    )


if __name__ == "__main__":
    asked = int(sys.argv[1]) if sys.argv[1:] else 11
    main(asked) if asked else cost()
