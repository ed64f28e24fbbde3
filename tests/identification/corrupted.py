"""Records with a fault, simulated by an oracle of its own, and what the suite makes of them.

A chain of masses is driven by sums of sines or by a pulse; its response is exact: particular solution by
complex amplitudes, the rest by a matrix exponential. Nothing here is shared with the suite but the scene and
the CSV file, which are written as a user would. ``python -m tests.identification.corrupted [COUNT]`` prints
the table.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.stats import chi2, ncx2

import dynid
from dynid.errors import NumericalError

FAULTS = ("delay", "gain", "mass", "sign", "swap", "saturation", "drift", "outlier", "noise", "none")
FORCES = ("sine", "multisine", "random", "impact")
STEP, SAMPLES = 0.002, 600
#: Lags of the response that a force known by its samples may have, in the saturated model.
LAGS = 100
#: Level of the lack-of-fit test, and the power from which on it has to see a fault.
LEVEL, POWER = 1e-3, 0.99
#: What a warning says that is no warning of a fault.
BESIDE = (
    "hardly distinguishable",
    "poorly known",
    "indistinguishable from 0",
    "% of force gain",
    "1 % of",
    "left to estimate the noise from",
)


class Chain(NamedTuple):
    """Masses in a row, the first one to ground; springs and dampers from each to the one before it."""

    masses: np.ndarray
    k: np.ndarray
    c: np.ndarray

    @property
    def matrices(self):
        n = len(self.masses)
        difference = np.eye(n) - np.eye(n, k=-1)
        return (
            np.diag(self.masses),
            difference.T @ np.diag(self.c) @ difference,
            difference.T @ np.diag(self.k) @ difference,
        )


class Force(NamedTuple):
    """``sum amplitude sin(omega t + phase)`` at a DOF (from 0) until `end`; `settled`: in steady state."""

    dof: int
    omega: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    end: float = np.inf
    settled: bool = False

    def at(self, times):
        angles = np.outer(times, self.omega) + self.phase
        return np.where(times <= self.end, np.sin(angles) @ self.amplitude, 0.0)


class Case(NamedTuple):
    """One record: true chain, unknown springs (from 0), force, channels (DOF from 0, order), and a fault."""

    seed: int
    fault: str
    kind: str
    chain: Chain
    unknown: tuple[int, ...]
    force: Force
    channels: tuple[tuple[int, int], ...]

    @property
    def true(self):
        return np.ravel([[self.chain.k[j], self.chain.c[j]] for j in self.unknown])


def case(seed, fault):
    """Return a random case."""
    rng = np.random.default_rng([17, seed])
    n, kind = int(rng.integers(2, 7)), FORCES[(seed + seed // len(FAULTS)) % 4]
    masses, k = rng.uniform(0.5, 3, n), rng.uniform(0.7, 4, n) * 1e4
    chain = Chain(masses, k, k * rng.uniform(0.5, 2, n) * 1e-3)
    omega = np.sqrt(np.linalg.eigvalsh(chain.matrices[2] / np.sqrt(np.outer(masses, masses))))
    dof = int(rng.integers(n))
    if kind == "impact":  # amplitude (1 - cos) / 2 until `end`
        end = 20 * STEP
        force = Force(
            dof,
            np.array([0.0, 2 * np.pi / end]),
            np.array([15.0, 15.0]),
            np.array([np.pi / 2, -np.pi / 2]),
            end,
        )
    else:
        lines = {"sine": 1, "multisine": int(rng.integers(3, 7)), "random": 60}[kind]
        top = min(1.3 * omega[-1], 0.25 * np.pi / STEP)
        places = (
            rng.uniform(0.5 * omega[0], top, lines)
            if kind != "sine"
            else rng.uniform(0.7, 1.4, 1) * omega[min(1, n - 1)]
        )
        phases, settled = rng.uniform(0, 2 * np.pi, lines), kind != "random" and bool(rng.integers(2))
        force = Force(dof, np.sort(places), rng.uniform(5, 15, lines), phases, settled=settled)
    count = int(rng.integers(1, 4))
    if fault == "swap":
        count = max(2, count)
    order = int(rng.integers(3))
    places = rng.choice(n, min(n, count), replace=False)
    orders = [order] * len(places) if fault == "swap" else rng.integers(3, size=len(places)).tolist()
    joints = 1 + (n > 3 and kind != "sine")
    unknown = tuple(sorted(rng.choice(np.arange(1, n), min(n - 1, joints), replace=False).tolist()))
    return Case(seed, fault, kind, chain, unknown, force, tuple(zip(places.tolist(), orders, strict=True)))


def response(chain, force, channels, times):
    """Return the exact response from rest (times x channels)."""
    return driven(chain, force, channels, times)[0]


def driven(chain, force, channels, times):
    """Return the exact response from rest (times x channels), and free ones (times x channels x 2 n)."""
    M, C, K = chain.matrices
    n, inverse = len(M), np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    b = np.concatenate([np.zeros(n), inverse[:, force.dof]])

    def steady(t):
        z = np.zeros((len(t), 2 * n))
        for omega, amplitude, phase in zip(force.omega, force.amplitude, force.phase, strict=True):
            Z = np.linalg.solve(1j * omega * np.eye(2 * n) - A, b * amplitude)
            z += np.imag(np.outer(np.exp(1j * (omega * t + phase)), Z))
        return z

    begin = np.zeros(2 * n) if force.settled else steady(np.zeros(1))[0]

    def free(start, t):
        w, V = np.linalg.eig(A)
        parts = np.linalg.solve(V, start)
        return np.real(np.exp(np.outer(t, w)) @ (V * parts).T)

    during = times <= force.end
    z = np.empty((len(times), 2 * n))
    z[during] = steady(times[during]) - free(begin, times[during])
    if not during.all():
        last = np.array([force.end])
        left = (steady(last) - free(begin, last))[0]
        z[~during] = free(left, times[~during] - force.end)
    f = force.at(times)
    rows, direct = [], []
    for dof, order in channels:
        row = np.eye(2 * n)[dof] if order == 0 else np.eye(2 * n)[n + dof] if order == 1 else A[n + dof]
        rows.append(row)
        direct.append(f * (b[n + dof] if order == 2 else 0.0))
    rows = np.array(rows)
    Phi, by_start = expm(A * (times[1] - times[0])), np.empty((len(times), len(rows), 2 * n))
    state = np.eye(2 * n)
    for k in range(len(times)):
        by_start[k] = rows @ state
        state = Phi @ state
    return z @ rows.T + np.column_stack(direct), by_start


def faulted(case, times):
    """Return what the sensors give without noise, with the fault (times x channels)."""
    y = response(case.chain, case.force, case.channels, times)
    rng, size = np.random.default_rng([23, case.seed]), np.sqrt(np.mean(y**2, axis=0))
    column = int(rng.integers(y.shape[1]))
    if case.fault == "delay":  # at rest before
        y = np.concatenate([y[:1], y[:-1]])
    elif case.fault == "gain":
        y = y * rng.choice([0.85, 1.15])
    elif case.fault == "sign":
        y[:, column] *= -1
    elif case.fault == "swap":
        y = y[:, [1, 0, *range(2, y.shape[1])]]
    elif case.fault == "saturation":
        most = 0.6 * np.abs(y[:, column]).max()
        y[:, column] = np.clip(y[:, column], -most, most)
    elif case.fault == "drift":
        y[:, column] += 2 * size[column] * times / times[-1]
    elif case.fault == "outlier":
        y[int(rng.integers(len(y))), column] += 100 * 0.03 * size[column]
    return y


def noise_of(case, times):
    """Return the standard deviation of the noise of each channel: 3 % of its RMS without the fault."""
    y = response(case.chain, case.force, case.channels, times)
    return 0.03 * np.sqrt(np.mean(y**2, axis=0))


def modelled(case):
    """Return the masses as the scene has them."""
    masses = case.chain.masses.copy()
    if case.fault == "mass":
        rng = np.random.default_rng([29, case.seed])
        masses[rng.integers(len(masses))] *= rng.choice([0.8, 1.2])
    return masses


def written(case, folder):
    """Write the record and its scene; return the path of the scene."""
    times = STEP * np.arange(SAMPLES)
    sigma = noise_of(case, times)
    rng = np.random.default_rng([31, case.seed])
    values = faulted(case, times) + sigma * rng.standard_normal((SAMPLES, len(sigma)))
    names = [f"y{k}" for k in range(len(sigma))]
    table = np.column_stack([values, case.force.at(times)])
    np.savetxt(
        folder / "record.csv", table, delimiter=",", header=",".join([*names, "f"]), comments="", fmt="%.12g"
    )
    quantities = ("displacement", "velocity", "acceleration")
    channels = ", ".join(f"{{dof: {dof + 1}, quantity: {quantities[order]}}}" for dof, order in case.channels)
    links, joints = [], []
    start = rng.uniform(0.8, 1.25, (len(case.chain.k), 2))
    for j, (k, c) in enumerate(zip(case.chain.k, case.chain.c, strict=True)):
        dofs = f"[{j}, {j + 1}]" if j else "[1]"
        if j in case.unknown:
            starts = [f"{{start: {float(value)!r}}}" for value in (k * start[j, 0], c * start[j, 1])]
            joints.append(f"  j{j}: {{dofs: {dofs}, k: {starts[0]}, c: {starts[1]}}}")
        else:
            links.append(f"{{dofs: {dofs}, k: {float(k)!r}, c: {float(c)!r}}}")
    dof = case.force.dof + 1
    if case.kind in ("random", "impact"):
        load = f"{{dof: {dof}, kind: file, path: record.csv, column: f}}"
    else:
        lists = [np.array(part).tolist() for part in case.force[1:4]]
        lines = f"frequency: {lists[0]}, amplitude: {lists[1]}, phase: {lists[2]}"
        load = f"{{dof: {dof}, kind: multisine, {lines}}}"
    noise = f"  noise: {(sigma / 20).tolist()}\n" if case.fault == "noise" else ""
    text = (
        (
            "dynid: 1\nkind: identification\n"
            f"structure:\n  lumped: {{masses: {modelled(case).tolist()}, links: [{', '.join(links)}]}}\n"
            "joints:\n" + "\n".join(joints) + f"\nexcitation: [{load}]\n"
            f"measurement:\n  step: {STEP}\n  samples: {SAMPLES}\n  channels: [{channels}]\n{noise}"
            f"  file: {{path: record.csv, columns: [{', '.join(names)}]}}\n"
        )
        .replace("np.float64(", "")
        .replace("),", ",")
    )
    path = folder / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def power(case):
    """Return the power of a lack-of-fit test: of the noise-free residual within the saturated model."""
    times = STEP * np.arange(SAMPLES)
    sigma, y = noise_of(case, times), faulted(case, times)

    def left(eta):
        k, c = case.chain.k.copy(), case.chain.c.copy()
        k[list(case.unknown)], c[list(case.unknown)] = np.exp(eta).reshape(-1, 2).T
        forced, by_start = driven(Chain(modelled(case), k, c), case.force, case.channels, times)
        weighted = ((y - forced) / sigma).T.ravel()
        basis = (by_start / sigma[:, None]).swapaxes(0, 1).reshape(len(weighted), -1)
        Q = np.linalg.svd(basis, full_matrices=False)[0]
        return weighted - Q @ (Q.T @ weighted)

    every = [least_squares(left, np.log(case.true) + shift, x_scale="jac") for shift in (0.0, 0.5, -0.5)]
    best = min(every, key=lambda found: found.cost).fun
    basis = _saturated(case, times)
    U, s, _ = np.linalg.svd(basis, full_matrices=False)
    U = U[:, s > 1e-8 * s[0]]
    shares = best.reshape(len(sigma), -1)
    seen = float(np.sum((shares @ U) ** 2))
    degrees = U.shape[1] * len(sigma) - 2 * len(case.unknown) - 2 * len(case.chain.masses)
    return 0.0 if degrees < 1 else float(ncx2.sf(chi2.isf(LEVEL, degrees), degrees, max(seen, 1e-9)))


def _saturated(case, times):
    """Return what the response of any linear system to this force is made of, free decays among it."""
    decays = driven(case.chain, case.force, ((0, 0),), times)[1][:, 0]
    if case.kind in ("sine", "multisine"):
        angles = np.outer(times, case.force.omega)
        return np.column_stack([np.sin(angles), np.cos(angles), decays])
    f = case.force.at(times)
    lagged = [np.concatenate([np.zeros(lag), f[: len(f) - lag]]) for lag in range(LAGS)]
    return np.column_stack([*lagged, decays])


class Outcome(NamedTuple):
    """What came of a record: a word, how far the worst estimate is off, warnings, and the test's power."""

    word: str
    off: float
    said: list[str]
    power: float


def outcome(case, folder):
    """Run a case as a user would."""
    path = written(case, folder)
    try:
        result = dynid.run(dynid.load_scene(path))
    except NumericalError as error:
        return Outcome("refused", np.nan, [str(error)], np.nan)
    group = "identification/parameters"
    names = list(result[f"{group}/name"].data)
    order = [names.index(f"j{j}.{letter}") for j in case.unknown for letter in "kc"]
    estimate, error = (result[f"{group}/{part}"].data[order] for part in ("estimate", "standard_error"))
    off = float(np.max(np.abs(estimate - case.true) / error))
    said = [w for w in result["identification/diagnostics/warnings"].data if not any(b in w for b in BESIDE)]
    if not result.value("identification/diagnostics/converged"):
        return Outcome("not converged", off, said, np.nan)
    if off <= 5:
        return Outcome("right", off, said, np.nan)
    if said:
        return Outcome("warned", off, said, np.nan)
    seen = power(case)
    return Outcome("silently wrong" if seen >= POWER else "silently wrong, no power", off, said, seen)


WORDS = ("right", "refused", "not converged", "warned", "silently wrong, no power", "silently wrong")


def cases(count):
    """Return so many cases, the faults in turn."""
    return [case(seed, FAULTS[seed % len(FAULTS)]) for seed in range(count)]


def main(count):
    """Print the table of faults and outcomes, and the cases that are silently wrong."""
    table = {fault: dict.fromkeys(WORDS, 0) for fault in FAULTS}
    for one in cases(count):
        with TemporaryDirectory() as folder:
            found = outcome(one, Path(folder))
        table[one.fault][found.word] += 1
        print(one.seed, one.fault, one.kind, len(one.chain.masses), one.channels, *found, flush=True)
    print(f"{'':<12}" + "".join(f"{word:>26}" for word in WORDS))
    for fault, row in table.items():
        print(f"{fault:<12}" + "".join(f"{row[word]:>26}" for word in WORDS))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
