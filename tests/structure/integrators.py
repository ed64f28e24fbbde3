"""Figures of the march through nonlinear joints: errors, and processor time beside integrators.

``python -m tests.structure.integrators [two] [chain] [beam] [cubic] [jenkins] [bouc_wen] [gap]``: the error
of a time response with the steps that the program chooses, against two integrators without events that agree,
SciPy's LSODA and DOP853 in C (`dop853.c`, built here by ``cc``); then ratios of processor time, medians of
interleaved pairs, to the faster of SciPy's DOP853 and Radau and to the compiled DOP853, each at the loosest
tolerance with which its error is that of the program, and 1e-6. Times of the program are those of
`time_response`; beside what is compiled, of `march` with its tables. `test_nonlinear_joints` checks errors of
other cases without a clock.
"""

import ctypes
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients as tableau

from dynid.lti.generator import RecordTimes
from dynid.lti.signals import signal
from dynid.structure.assembly import Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.hysteretic_laws import BoucWen, Jenkins
from dynid.structure.joint_laws import Cubic, Gap
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.nonlinear import accuracy
from dynid.structure.nonlinear.march import march
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.methods import reduce
from dynid.structure.response import time_response

PAIRS = 11
STRUCTURES = ("two", "chain", "beam")
# A law, and its parameters by the stiffness k at the joint and the largest linear deflection D.
LAWS = {
    "cubic": (Cubic(), lambda k, D: (k / D**2,)),
    "jenkins": (Jenkins(), lambda k, D: (k, 0.1 * k * D)),
    "bouc_wen": (BoucWen(), lambda k, D: (k, 3 / D, 1 / D)),
    "gap": (Gap(), lambda k, D: (3 * k, 0.3 * D, 0.0)),
}


class Case(NamedTuple):
    """A structure, DOFs of its joint and of its load, the sines of this, sampling step, s, and samples."""

    model: object
    joint: tuple
    load: object
    amplitude: list
    omega: list
    step: float
    samples: int


def case(name):
    if name == "two":
        links = [Link((1,), 1000.0, 2.0), Link((2,), 500.0, 1.0)]
        return Case(
            lumped([1.0, 1.2], links), (1, 2), 2, [20.0, 15.0, 10.0], [30.0, 45.0, 61.0], 1 / 100, 1600
        )
    if name == "chain":
        links = [Link((1,), 4e4, 4.0), *(Link((i, i + 1), 4e4, 4.0) for i in range(1, 20))]
        model = lumped([1.0] * 20, links)
        return Case(model, (10,), 20, [300.0, 225.0, 150.0], [20.0, 35.0, 61.0], 1 / 400, 400)
    clamped = [Support(1, ("w", "theta"))]
    fine = beam(20, 0.05, 500.0, 3.0, supports=clamped, damping=ProportionalDamping(0.5, 1e-7))
    reduced = reduce(
        fine, "guyan", masters=[dof for k in range(2, 22, 2) for dof in fine.dofs[2 * k - 2 : 2 * k]]
    )
    tip = reduced.dofs[-2]
    return Case(reduced, (tip,), tip, [20.0, 15.0, 10.0], [3631.0, 5901.0, 25602.0], 3.04e-5, 200)


class Motion:
    """A structure with a joint: by the program, and by integrators of its equation of motion."""

    phase = (0.0, 1.0, 2.0)

    def __init__(self, structure, law):
        self.case = case(structure)
        model, n, step = self.case.model, len(self.case.model.dofs), self.case.step
        self.times = np.arange(self.case.samples) * step
        self.channels = [Channel(dof, q) for q in ("displacement", "velocity") for dof in model.dofs]
        record = RecordTimes(step, self.case.samples)
        lines = {"amplitude": self.case.amplitude, "frequency": self.case.omega, "phase": list(self.phase)}
        self.loads = [Load(self.case.load, signal("multisine", lines, record))]
        M, C, K = (np.asarray(matrix, dtype=float) for matrix in model.dense())
        self.row = np.zeros(n)
        for dof, sign in zip(self.case.joint, (1.0, -1.0), strict=False):
            self.row[model.row(dof).argmax()] = sign
        D = np.abs(self.by_program(model)[:, :n] @ self.row).max()
        kind, values = LAWS[law]
        self.law, self.values = (
            list(LAWS).index(law),
            np.array(values(1 / (self.row @ np.linalg.solve(K, self.row)), D)),
        )
        bound = joint_law(kind, [JointParameter(float(x), signed=True) for x in self.values])
        self.model = model.joined([Joint("bolt", self.case.joint, laws=(bound,))])
        self.A = -np.linalg.solve(M, np.concatenate([K, C], axis=1))
        self.e, self.b = np.linalg.solve(M, self.row), np.linalg.solve(M, model.row(self.case.load))
        self.fastest = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).max()) * step

    def by_program(self, model=None):
        """Return displacements and velocities (times x 2 n) with the steps that the program chooses."""
        result = time_response(model or self.model, self.loads, self.channels, self.times)
        self.events = result.group_attrs.get("structure/joints", {}).get("events", 0)
        return result["structure/time_response/response"].data

    def march(self):
        """Return the motion by the march alone, tables included, with the steps of the last response."""
        kept = []
        with mock.patch.object(accuracy, "march", lambda *a, **k: kept.append((a, k)) or march(*a, **k)):
            self.by_program()
        arguments, options = kept[-1]
        return lambda: march(*arguments, **(options | {"kept": None}))

    def force(self, d, v, z):
        p = self.values
        if self.law == 0:
            return p[0] * d**3, 0.0
        if self.law == 1:
            force = p[0] * (d - z)
            return force, v if abs(force) >= p[1] and force * v > 0 else 0.0
        if self.law == 2:
            return p[0] * z, v * (1 - p[1] * abs(z)) if v * z > 0 else v * (1 + p[2] * abs(z))
        return (p[0] * (abs(d) - p[1]) * np.sign(d) + p[2] * v if abs(d) > p[1] else 0.0), 0.0

    def by_scipy(self, method, rtol, atol):
        """Integrate without location of events (times x 2 n + 1)."""
        n, row, A, b, e = len(self.row), self.row, self.A, self.b, self.e
        a, w, phase = (np.array(x) for x in (self.case.amplitude, self.case.omega, self.phase))

        def rates(t, y):
            f, rate = self.force(row @ y[:n], row @ y[n:-1], y[-1])
            return np.concatenate([y[n:-1], A @ y[:-1] + b * (a @ np.sin(w * t + phase)) - e * f, [rate]])

        end, first = self.times[-1], np.zeros(2 * n + 1)
        solved = solve_ivp(
            rates, (0, end), first, method, self.times, rtol=rtol, atol=atol, max_step=self.longest
        )
        return solved.y.T

    @property
    def longest(self):
        return 4 * self.case.step


class _System(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_long) for name in ("n", "law", "lines")),
        *((name, ctypes.c_void_p) for name in ("A", "b", "e", "row", "p", "amplitude", "omega", "phase")),
    ]


@cache
def _library():
    folder = tempfile.mkdtemp()
    source = Path(__file__).with_name("dop853.c")
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(source), "-o", f"{folder}/dop853.so", "-lm"], check=True)
    function = ctypes.CDLL(f"{folder}/dop853.so").dop853
    function.restype = ctypes.c_long
    return function


def compiled(motion, rtol, atol, longest=None):
    """Integrate by DOP853 in C (times x 2 n + 1)."""
    n = len(motion.row)
    lines = motion.case.amplitude, motion.case.omega, motion.phase
    arrays = [motion.A, motion.b, motion.e, motion.row, motion.values, *lines]
    arrays = [np.ascontiguousarray(array, dtype=float) for array in arrays]
    system = _System(n, motion.law, len(motion.phase), *(array.ctypes.data for array in arrays))
    A = tableau.A.copy()
    A[12, :12] = tableau.B
    kept = [np.ascontiguousarray(array) for array in (A, tableau.C, tableau.E3, tableau.E5, tableau.D)]
    atol = np.ascontiguousarray(np.broadcast_to(atol, 2 * n + 1), dtype=float)
    first, out = np.zeros(2 * n + 1), np.empty((len(motion.times), 2 * n + 1))
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in kept]
    data = [ctypes.c_void_p(array.ctypes.data) for array in (motion.times, first, out)]
    _library()(
        ctypes.byref(system), *pointers, ctypes.c_double(rtol), ctypes.c_void_p(atol.ctypes.data),
        ctypes.c_double(longest or motion.longest), data[0], ctypes.c_long(len(motion.times)), *data[1:],
    )  # fmt: skip
    return out


def figures(structure, law):
    motion = Motion(structure, law)
    n = len(motion.row)
    rough = compiled(motion, 1e-8, 1e-8 * np.r_[np.full(n, 1e-3), np.ones(n), 1e-3])
    size = np.concatenate([np.full(n, np.abs(rough[:, :n]).max()), np.full(n, np.abs(rough[:, n:-1]).max())])
    scale = np.r_[size, max(np.abs(rough[:, -1]).max(), size[0])]
    truth = compiled(motion, 1e-13, 1e-13 * scale, motion.case.step / 64)[:, :-1]
    second = motion.by_scipy("LSODA", 1e-12, 1e-12 * scale)[:, :-1]

    def error(states):
        return float(np.max(np.abs(states[:, : 2 * n] - truth) / size))

    reached = error(motion.by_program())
    print(f"{structure} {law}: fastest mode {motion.fastest:.3g} rad a sample, {motion.events} events, "
          f"integrators agree to {error(second):.1e}, error {reached:.1e}", flush=True)  # fmt: skip
    for target in (max(reached, 1e-9), 1e-6):
        rtol = next(
            r for r in 10.0 ** -np.arange(4, 13, 0.5) if error(compiled(motion, r, r * scale)) <= target
        )
        compare(target, motion.march(), "compiled DOP853", lambda: compiled(motion, rtol, rtol * scale))  # noqa: B023
        states = np.full_like(truth, np.inf)
        while error(states) > target:
            spent, states = timed(lambda: motion.by_scipy("DOP853", rtol, rtol * scale))  # noqa: B023
            best, rtol = ("DOP853", rtol), rtol / 10**0.5
        for tolerance in 10.0 ** -np.arange(4, 13, 0.5):
            taken, states = timed(lambda: motion.by_scipy("Radau", tolerance, tolerance * scale))  # noqa: B023
            if taken > spent:
                break
            if error(states) <= target:
                best = "Radau", tolerance
                break
        name, tolerance = best
        compare(
            target, motion.by_program, f"SciPy's {name}",
            lambda: motion.by_scipy(name, tolerance, tolerance * scale),  # noqa: B023
        )  # fmt: skip


def compare(target, ours, name, theirs):
    pairs = [(timed(ours)[0], timed(theirs)[0]) for _ in range(PAIRS)]
    here, there = 1e3 * np.median(pairs, axis=0)
    ratio = np.median([b / a for a, b in pairs])
    print(f"  at {target:.0e}: {here:.2f} ms, {name} {there:.2f} ms: {ratio:.3g} times", flush=True)


def timed(function):
    start = time.thread_time()
    value = function()
    return time.thread_time() - start, value


if __name__ == "__main__":
    for structure in [name for name in STRUCTURES if name in sys.argv] or STRUCTURES:
        for law in [name for name in LAWS if name in sys.argv] or LAWS:
            figures(structure, law)
