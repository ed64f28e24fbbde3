"""Frequency response of chains against sparse LU: `benchmarks/frequency_response.py [-o FIGURE.png] [N]…`.

Prints, for chains of N mass-spring-damper stages at 1,000 frequencies: the time of the plan and of the
response, its largest error against 60-digit arithmetic at sampled frequencies, and the time that
`scipy.sparse.linalg.splu` would take on sE - A (states: velocities and elongations), with its default
ordering and with that for symmetric patterns, and on the nodal (impedance) form, extrapolated from a few
frequencies. Times are processor time, of all threads together, the least of several runs; wall time stands
beside. With `-o` it plots the times against N: `docs/chain_frequency_response.png` was made so.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from dynid.bondgraph.chains import FORCE, Stage, chain, distinct, last_velocity
from dynid.bondgraph.frequency import frequency_response
from dynid.bondgraph.reduced import ReducedGraph

POINTS = 1000
SAMPLED = 5  # frequencies at which the rival and the reference are computed
REPEATS = 3
MOST_REPEATED = 10_000  # stages up to which a run is repeated
SIZES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000)
MOST_RIVAL = 30_000  # stages up to which the rivals run
MOST_SYMMETRIC = 1000  # and up to which sE - A is tried with that ordering, whose fill grows with the square


class Cost(NamedTuple):
    """Processor time and wall time, in s."""

    processor: float
    wall: float


class Row(NamedTuple):
    """What was measured of one chain: what it costs, and the processor time of the rivals in s."""

    stages: int
    graph: Cost
    plan: Cost
    response: Cost
    error: float
    rivals: dict[str, float]


def cost(work: Callable[[], Any], repeats: int) -> tuple[Cost, Any]:
    """Return the least processor time and wall time of several runs, and the result."""
    processor = wall = math.inf
    for _ in range(repeats):
        result = None  # let go of the last one
        started = time.process_time(), time.perf_counter()
        result = work()
        processor = min(processor, time.process_time() - started[0])
        wall = min(wall, time.perf_counter() - started[1])
    return Cost(processor, wall), result


def reference(stages: list[Stage], omega: float) -> complex:
    """Return the response with 60 digits, by superposing impedances from the force to the ground."""
    with mpmath.workdps(60):
        s, force, seen = mpmath.mpc(0, omega), mpmath.mpf(1), mpmath.mpf(0)
        for stage in stages[:-1]:
            m, k, b = (mpmath.mpf(value.numerator) / value.denominator for value in stage)
            seen, joint = seen + s * m, k / s + b
            share = joint / (seen + joint)
            force, seen = force * share, seen * share
        m, k, b = (mpmath.mpf(value.numerator) / value.denominator for value in stages[-1])
        return complex(force / (seen + s * m + k / s + b))


def matrices(stages: list[Stage]) -> tuple[Any, Any, Any, Any, Any]:
    """Return E and A of the states (velocities, elongations), and M, B, K of the nodal form."""
    size = len(stages)
    m, k, b = (np.array([float(stage[place]) for stage in stages]) for place in range(3))
    D = sparse.diags([np.ones(size), -np.ones(size - 1)], [0, 1]).tocsc()
    M, B, K = sparse.diags(m), D.T @ sparse.diags(b) @ D, D.T @ sparse.diags(k) @ D
    E = sparse.block_diag([M, sparse.eye(size)]).tocsc()
    A = sparse.bmat([[-B, -D.T @ sparse.diags(k)], [D, None]]).tocsc()
    return E, A, M.tocsc(), B.tocsc(), K.tocsc()


def rivals(stages: list[Stage], omega: np.ndarray) -> dict[str, float]:
    """Return what splu takes for all frequencies, by the matrix and its ordering."""
    E, A, M, B, K = matrices(stages)

    def solve(matrix: Any, ordering: str) -> Any:
        right = np.zeros(matrix.shape[0], dtype=complex)
        right[0] = 1
        return splu(matrix, permc_spec=ordering).solve(right)

    def least(matrix: Callable[[float], Any], ordering: str) -> float:
        sampled = omega[:: len(omega) // SAMPLED][:SAMPLED]
        times = [cost(lambda w=w: solve(matrix(w), ordering), 1)[0].processor for w in sampled]
        return min(times) * len(omega)

    affordable = len(stages) <= MOST_SYMMETRIC
    return {
        "sE - A": least(lambda w: 1j * w * E - A, "COLAMD"),
        "sE - A, MMD": least(lambda w: 1j * w * E - A, "MMD_AT_PLUS_A") if affordable else math.nan,
        "nodal": least(lambda w: 1j * w * M + B + K / (1j * w), "COLAMD"),
        "nodal, MMD": least(lambda w: 1j * w * M + B + K / (1j * w), "MMD_AT_PLUS_A"),
    }


def measure(size: int) -> Row:
    """Measure a chain of distinct stages."""
    stages, omega = distinct(size), np.geomspace(0.01, 100, POINTS)
    graph_cost, graph = cost(lambda: chain(stages), 1)
    repeats = REPEATS if size <= MOST_REPEATED else 1
    plan, reduced = cost(lambda: ReducedGraph(graph, [FORCE], [last_velocity(size)], traced=False), repeats)
    response, values = cost(lambda: frequency_response(reduced, omega), repeats)
    sampled = np.flatnonzero(np.abs(values[:, 0, 0]) > 1e-280)
    errors = []
    for point in sampled[:: max(1, len(sampled) // SAMPLED)][:SAMPLED]:
        exact = reference(stages, float(omega[point]))
        errors.append(abs(values[point, 0, 0] - exact) / abs(exact))
    found = rivals(stages, omega) if size <= MOST_RIVAL else {}
    return Row(size, graph_cost, plan, response, max(errors), found)


def plot(rows: list[Row], path: str) -> None:
    """Plot plan and response, and the rivals, against the number of stages."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.add_subplot()
    size = [row.stages for row in rows]
    total = [row.plan.processor + row.response.processor for row in rows]
    axes.loglog(size, total, "o-", label="dynid, plan included")
    axes.loglog(size, [row.response.processor for row in rows], "o--", label="dynid, response alone")
    for name, marker in zip(rows[0].rivals, "sD^v", strict=True):
        axes.loglog(size, [row.rivals.get(name, np.nan) for row in rows], marker + "-", label=f"splu, {name}")
    axes.loglog(size, [total[-1] * n / size[-1] for n in size], "k:", label="proportional to N")
    axes.set(xlabel="stages N", ylabel="processor time for 1,000 frequencies, s")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def main(arguments: list[str]) -> None:
    """Measure, print the table, and plot."""
    path = arguments[arguments.index("-o") + 1] if "-o" in arguments else None
    sizes = [int(text) for text in arguments if text.isdigit()] or SIZES
    measure(300)  # loads and compiles everything
    print("processor time in s (wall time), and how many times longer splu takes")
    print("      N   graph    plan             response         error", end="")
    print("    sE - A         sE - A, MMD    nodal          nodal, MMD")
    rows = []
    for size in sizes:
        row = measure(size)
        rows.append(row)
        total = row.plan.processor + row.response.processor
        print(f"{size:>7} {row.graph.processor:7.3f}", end=" ")
        for part in (row.plan, row.response):
            print(f"{part.processor:7.3f} ({part.wall:6.3f})", end=" ")
        print(f"{row.error:8.1e}", end=" ")
        print(*(f"{spent:7.2f} ({spent / total:5.1f})" for spent in row.rivals.values()), flush=True)
    if path:
        plot(rows, path)


if __name__ == "__main__":
    main(sys.argv[1:])
