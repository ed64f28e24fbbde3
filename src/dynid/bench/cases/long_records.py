"""Records of many channels and samples: all default results, beside a Gauss–Newton iteration by hand.

A beam on twelve joints of unknown stiffness, reduced to 32 modes, is driven by a random force at a node;
sixty accelerations are simulated with 5 % noise, from rest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark

CHANNELS, UNKNOWNS, MODES, ELEMENTS = 60, 12, 32, 40
START, DAMPING = 3e4, 20.0  # of each joint, N/m and N s/m
#: Longest step of the logarithm of a stiffness, and the last one.
MAX_STEP, LAST_STEP = 0.5, 1e-5


def _truth() -> Any:
    return 4e4 * (1 + 0.1 * (np.arange(UNKNOWNS) % 5))


@lru_cache(maxsize=2)
def _scene(samples: int) -> Any:
    """Return the checked scene."""
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import parse_source
    from dynid.scene.yaml.writer import dump

    spacing = ELEMENTS // UNKNOWNS
    joints = {
        f"j{k}": {"dofs": [f"w_{1 + spacing * k}"], "k": {"start": START, "true": float(true)}, "c": DAMPING}
        for k, true in enumerate(_truth())
    }
    dofs = [f"{name}_{node}" for name in ("w", "theta") for node in range(1, ELEMENTS + 2)][:CHANNELS]
    damping = {"alpha": 1, "beta": 1e-5}
    beam = {"elements": ELEMENTS, "length": 10, "EI": 2e4, "rhoA": 10, "damping": damping}
    force = {"dof": "w_3", "kind": "random", "amplitude": 100, "seed": 1, "band": [5, 600]}
    data = {
        "dynid": 1,
        "kind": "identification",
        "title": "bench",
        "structure": {"beam": beam},
        "joints": joints,
        "reduction": {"method": "joint-aware", "modes": {"count": MODES}, "residuals": "none"},
        "excitation": [force],
        "measurement": {
            "step": 1e-3,
            "samples": samples,
            "channels": [{"dof": dof, "quantity": "acceleration"} for dof in dofs],
            "simulate": {"noise_ratio": 0.05, "seed": 1, "settle": 0, "model": "reduced"},
        },
    }
    return check_source(parse_source(dump(data), "<bench>"))


def _identified(scene: Any) -> Any:
    from dynid.scene.run import run_scene

    return run_scene(scene)["identification/parameters/estimate"].data


class _Beam:
    """The same beam by hand: its modes and static shapes, a record from rest, and its sensitivities."""

    def __init__(self, samples: int) -> None:
        from scipy.linalg import eigh

        h, count = 10 / ELEMENTS, 2 * (ELEMENTS + 1)
        bending = np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [0, 4 * h * h, -6 * h, 2 * h * h],
                [0, 0, 12, -6 * h],
                [0, 0, 0, 4 * h * h],
            ]
        )
        inertia = np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [0, 4 * h * h, 13 * h, -3 * h * h],
                [0, 0, 156, -22 * h],
                [0, 0, 0, 4 * h * h],
            ]
        )
        K, M = np.zeros((count, count)), np.zeros((count, count))
        for first in range(0, count - 2, 2):
            here = slice(first, first + 4)
            K[here, here] += 2e4 / h**3 * (bending + np.triu(bending, 1).T)
            M[here, here] += 10 * h / 420 * (inertia + np.triu(inertia, 1).T)
        at = 2 * (ELEMENTS // UNKNOWNS) * np.arange(UNKNOWNS)
        started = K.copy()
        started[at, at] += START
        static = np.linalg.solve(started, np.eye(count)[:, at])
        _, modes = eigh(started, M, subset_by_index=[0, MODES - UNKNOWNS - 1])
        T, _ = np.linalg.qr(np.hstack([modes, static]))
        self.joints, inverse = T[at], np.linalg.inv(T.T @ M @ T)
        C = T.T @ (M + 1e-5 * K) @ T + DAMPING * self.joints.T @ self.joints
        self.K, self.C, self.push = inverse @ T.T @ K @ T, inverse @ C, inverse @ self.joints.T
        read = np.concatenate([np.arange(0, count, 2), np.arange(1, count, 2)])[:CHANNELS]
        self.read, self.force, self.samples = T[read], inverse @ T[4], samples
        rng = np.random.default_rng(1)
        self.input = 100 * np.convolve(rng.standard_normal(samples + 4), np.ones(5) / 5, "valid")
        clean = self.response(np.log(_truth()), sensitive=False)[0]
        self.noise = 0.05 * clean.std(axis=1)
        self.record = clean + self.noise[:, None] * rng.standard_normal(clean.shape)

    def response(self, eta: Any, *, sensitive: bool = True) -> tuple[Any, Any]:
        """Return accelerations (channels x samples) at logarithms of the stiffnesses, and derivatives."""
        from scipy.signal import lfilter

        r, h = len(self.K), 1e-3
        K = self.K + self.push * np.exp(eta) @ self.joints
        A = np.block([[np.zeros((r, r)), np.eye(r)], [-K, -self.C]])
        poles, V = np.linalg.eig(A)
        inverse, z = np.linalg.inv(V)[:, r:], np.exp(poles * h)
        ramp = (z - 1 - poles * h) / (poles**2 * h)
        step = (z - 1) / poles - ramp

        def accelerations(load: Any, signal: Any) -> tuple[Any, Any]:
            modal = inverse @ load  # linear between samples
            states = np.array(
                [
                    lfilter([b * new, b * old], [1, -pole], signal)
                    for b, new, old, pole in zip(modal, ramp, step, z, strict=True)
                ]
            )
            return (read @ states).real + np.outer(self.read @ load, signal), states

        read = self.read @ A[r:] @ V
        outputs, states = accelerations(self.force, self.input)
        if not sensitive:
            return outputs, None
        moved = (self.joints @ V[:r] @ states).real
        slopes = [accelerations(-self.push[:, k] * np.exp(eta[k]), moved[k])[0] for k in range(UNKNOWNS)]
        return outputs, np.array(slopes)


def _gauss_newton(beam: _Beam) -> Any:
    eta = np.full(UNKNOWNS, np.log(START))
    for _ in range(50):
        outputs, slopes = beam.response(eta)
        residual = ((beam.record - outputs) / beam.noise[:, None]).ravel()
        J = (slopes / beam.noise[:, None]).reshape(UNKNOWNS, -1)
        step = np.clip(np.linalg.solve(J @ J.T, J @ residual), -MAX_STEP, MAX_STEP)
        eta = eta + step
        if np.abs(step).max() < LAST_STEP:
            break
    return np.exp(eta)


def _error(_: int, estimate: Any) -> float:
    return float(np.max(np.abs(estimate / _truth() - 1)))


def _records(title: str, sizes: tuple[int, ...]) -> Benchmark:
    return Benchmark(
        title=title,
        size="samples",
        sizes=sizes,
        alternatives=(
            Alternative("dynid", _identified, _scene),
            Alternative("gauss-newton", _gauss_newton, _Beam, peer=True),
        ),
        error=_error,
        measure="largest relative error of a stiffness, which is of the noise",
        default=lambda _: "dynid",
        remark="gauss-newton starts from rest, and tests nothing; dynid estimates 64 initial states beside",
    )


WIDE_RECORD = _records("Twelve stiffnesses from sixty channels", (2000,))
LONG_RECORD = _records("Twelve stiffnesses from sixty channels, a long record", (20_000,))
