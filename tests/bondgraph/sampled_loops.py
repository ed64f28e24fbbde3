"""Sampled loops around chains of masses by SciPy: exponentials, a closed-loop matrix, its eigenvalues."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from dynid.bondgraph.controller_circuits import Loop, Sampling
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port


class Chain(NamedTuple):
    """A chain of masses between springs and dampers, the first at a wall; a force acts on the last."""

    masses: tuple[Fraction, ...]
    dampers: tuple[Fraction, ...]
    springs: tuple[Fraction, ...]  # 0: none
    measured: str  # f or q, of the last mass

    def graph(self) -> BondGraph:
        nodes, bonds = [Node("F", "Se")], []
        for k, (m, b, c) in enumerate(zip(self.masses, self.dampers, self.springs, strict=True)):
            nodes += [Node(f"v{k}", "1"), Node(f"m{k}", "I", m), Node(f"link{k}", "0"), Node(f"rel{k}", "1")]
            nodes += [Node(f"b{k}", "R", b)]
            bonds += [Bond(f"v{k}", f"m{k}"), Bond(f"rel{k}", f"b{k}")]
            if c:
                nodes.append(Node(f"k{k}", "C", 1 / c))
                bonds.append(Bond(f"rel{k}", f"k{k}"))
            bonds += [Bond(f"v{k}", f"link{k}"), Bond(f"link{k}", f"rel{k}")]
            if k:
                bonds.append(Bond(f"link{k}", f"v{k - 1}"))
            else:
                nodes.append(Node("wall", "Sf"))
                bonds.append(Bond("link0", "wall"))
        bonds.append(Bond("F", f"v{len(self.masses) - 1}"))
        return BondGraph(nodes, bonds)

    @property
    def port(self) -> Port:
        return Port(f"m{len(self.masses) - 1}", self.measured)  # type: ignore[arg-type]

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return A, b and c of speeds, then of positions."""
        n = len(self.masses)
        M = np.diag([float(m) for m in self.masses])

        def coupled(values: tuple[Fraction, ...]) -> np.ndarray:
            K = np.zeros((n, n))
            for k, value in enumerate(values):
                K[k, k] += float(value)
                if k:
                    K[k - 1, k - 1] += float(value)
                    K[k, k - 1] -= float(value)
                    K[k - 1, k] -= float(value)
            return K

        A = np.zeros((2 * n, 2 * n))
        A[:n, :n], A[:n, n:] = (
            -np.linalg.solve(M, coupled(self.dampers)),
            -np.linalg.solve(M, coupled(self.springs)),
        )
        A[n:, :n] = np.eye(n)
        b, c = np.zeros(2 * n), np.zeros(2 * n)
        b[n - 1] = 1 / float(self.masses[-1])
        c[n - 1 if self.measured == "f" else 2 * n - 1] = 1.0
        return A, b, c


def random_chain(rng: np.random.Generator, most: int = 3) -> Chain:
    """Return a chain of one to three masses, every mode of which moves the last one."""
    n = int(rng.integers(1, most + 1))

    def numbers(low: int, high: int) -> tuple[Fraction, ...]:
        return tuple(Fraction(int(k), 10) for k in rng.integers(low, high, n))

    return Chain(numbers(5, 30), numbers(1, 15), numbers(1, 60), str(rng.choice(["f", "q"])))


def random_sampling(rng: np.random.Generator) -> Sampling:
    period = Fraction(int(rng.choice([1, 2, 5, 10, 20])), 20)
    share = [Fraction(0), Fraction(1, 3), Fraction(1), Fraction(3, 2), Fraction(1, 2)][int(rng.integers(5))]
    return Sampling(period, period * share)


def random_pi(rng: np.random.Generator) -> tuple[Fraction, Fraction]:
    return Fraction(int(rng.integers(1, 40)), 10), Fraction(int(rng.integers(0, 12)), 10)


def pi_loop(
    chain: Chain, kp: Fraction, ki: Fraction, sampling: Sampling, factor: Fraction = Fraction(1)
) -> Loop:
    numerator, denominator = ([kp, ki], [Fraction(1), Fraction(0)]) if ki else ([kp], [Fraction(1)])
    return Loop(
        chain.port, "F", [factor * c for c in numerator], denominator, setpoint="w", sampling=sampling
    )


def tustin_pi(kp: float, ki: float, T: float) -> tuple[list[float], list[float]]:
    """Return numerator and denominator in z by hand."""
    return ([kp + ki * T / 2, -kp + ki * T / 2], [1.0, -1.0]) if ki else ([kp], [1.0])


def held(A: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    n = len(A)
    E = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * time)
    return E[:n, :n], E[:n, n]


def closed_matrix(chain: Chain, kp: float, ki: float, sampling: Sampling) -> np.ndarray:
    """Return the matrix from sample to sample: states, commands under way, the integral of the errors."""
    A, b, c = chain.matrices()
    T, delay = float(sampling.period), float(sampling.computation)  # type: ignore[arg-type]
    steps = int(Fraction(sampling.computation) // Fraction(sampling.period))  # type: ignore[arg-type]
    rest = delay - steps * T if Fraction(sampling.computation) % Fraction(sampling.period) else 0.0  # type: ignore[arg-type]
    n, past = len(A), steps + bool(rest)
    size = n + past + bool(ki)
    # trapezoids: the integral up to now is q[k] + ki T/2 y[k], q[k+1] = q[k] + ki T y[k]
    command = np.zeros(size)
    command[:n] = -(kp + ki * T / 2) * c
    if ki:
        command[-1] = -1.0
    commands = [command, *np.eye(size)[n : n + past]]
    M = np.zeros((size, size))
    Phi, whole = held(A, b, T)
    M[:n, :n] = Phi
    if rest:
        _, late = held(A, b, T - rest)
        _, early = held(A, b, rest)
        P = held(A, b, T - rest)[0]
        M[:n] += np.outer(late, commands[steps]) + np.outer(P @ early, commands[steps + 1])
    else:
        M[:n] += np.outer(whole, commands[steps])
    for k in range(past):
        M[n + k] = commands[k]
    if ki:
        M[-1, :n], M[-1, -1] = ki * T * c, 1.0
    return M


def loop_gain(chain: Chain, kp: float, ki: float, sampling: Sampling, omega: float) -> complex:
    """Return L at exp(jωT)."""
    A, b, c = chain.matrices()
    T, delay = float(sampling.period), float(sampling.computation)  # type: ignore[arg-type]
    steps = int(delay / T + 1e-9)
    rest = max(delay - steps * T, 0.0)
    z = np.exp(1j * omega * T)
    P, late = held(A, b, T - rest)
    _, early = held(A, b, rest)
    gain = (late + P @ early / z) / z**steps
    top, bottom = tustin_pi(kp, ki, T)
    plant = c @ np.linalg.solve(z * np.eye(len(A)) - held(A, b, T)[0], gain)
    return complex(plant * np.polyval(top, z) / np.polyval(bottom, z))
