"""Frequency response of chains against sparse LU: `benchmarks/frequency_response.py [-o FIGURE.png] [N]…`.

Prints, for chains of N mass-spring-damper stages at 1,000 frequencies: the time of the plan and of the
response, its largest error against 60-digit arithmetic at sampled frequencies, and the time that
`scipy.sparse.linalg.splu` would take on sE - A (states: velocities and elongations) and on the nodal
(impedance) form, extrapolated from a few frequencies. With `-o` it plots the times against N.
"""

from __future__ import annotations

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
SAMPLED = 3  # frequencies at which the rival and the reference are computed
SIZES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000)
MOST_RIVAL = 30_000  # stages up to which the rival runs


class Row(NamedTuple):
    """What was measured of one chain, times in s."""

    stages: int
    graph: float
    plan: float
    response: float
    error: float
    pencil: float
    nodal: float


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return wall time and result."""
    started = time.perf_counter()
    result = work()
    return time.perf_counter() - started, result


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


def rivals(stages: list[Stage], omega: np.ndarray) -> tuple[float, float]:
    """Return what splu takes for all frequencies on sE - A and on the nodal form."""
    E, A, M, B, K = matrices(stages)

    def solve(matrix: Any) -> Any:
        right = np.zeros(matrix.shape[0], dtype=complex)
        right[0] = 1
        return splu(matrix).solve(right)

    sampled = omega[:: len(omega) // SAMPLED][:SAMPLED]
    pencil = min(seconds(lambda w=w: solve(1j * w * E - A))[0] for w in sampled)
    nodal = min(seconds(lambda w=w: solve(1j * w * M + B + K / (1j * w)))[0] for w in sampled)
    return pencil * len(omega), nodal * len(omega)


def measure(size: int) -> Row:
    """Measure a chain of distinct stages."""
    stages, omega = distinct(size), np.geomspace(0.01, 100, POINTS)
    graph_time, graph = seconds(lambda: chain(stages))
    plan, reduced = seconds(lambda: ReducedGraph(graph, [FORCE], [last_velocity(size)], traced=False))
    response, values = seconds(lambda: frequency_response(reduced, omega))
    sampled = np.flatnonzero(np.abs(values[:, 0, 0]) > 1e-280)
    errors = []
    for point in sampled[:: max(1, len(sampled) // SAMPLED)][:SAMPLED]:
        exact = reference(stages, float(omega[point]))
        errors.append(abs(values[point, 0, 0] - exact) / abs(exact))
    pencil, nodal = rivals(stages, omega) if size <= MOST_RIVAL else (np.nan, np.nan)
    return Row(size, graph_time, plan, response, max(errors), pencil, nodal)


def plot(rows: list[Row], path: str) -> None:
    """Plot plan and response, and the rival, against the number of stages."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.add_subplot()
    size = [row.stages for row in rows]
    total = [row.plan + row.response for row in rows]
    axes.loglog(size, total, "o-", label="dynid, plan included")
    axes.loglog(size, [row.response for row in rows], "o--", label="dynid, response alone")
    axes.loglog(size, [row.pencil for row in rows], "s-", label="splu on sE - A")
    axes.loglog(size, [row.nodal for row in rows], "^-", label="splu on the nodal form")
    axes.loglog(size, [total[-1] * n / size[-1] for n in size], "k:", label="proportional to N")
    axes.set(xlabel="stages N", ylabel="time for 1,000 frequencies, s")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def main(arguments: list[str]) -> None:
    """Measure, print the table, and plot."""
    path = arguments[arguments.index("-o") + 1] if "-o" in arguments else None
    sizes = [int(text) for text in arguments if text.isdigit()] or SIZES
    measure(300)  # loads and compiles everything
    print("  N        graph     plan      FRF       error     splu sE-A  ratio   splu nodal  ratio")
    rows = []
    for size in sizes:
        row = measure(size)
        rows.append(row)
        total = row.plan + row.response
        print(
            f"{size:>7} {row.graph:8.3f} s {row.plan:7.3f} s {row.response:7.3f} s {row.error:9.1e} "
            f"{row.pencil:9.2f} s {row.pencil / total:6.1f} {row.nodal:9.2f} s {row.nodal / total:6.1f}",
            flush=True,
        )
    if path:
        plot(rows, path)


if __name__ == "__main__":
    main(sys.argv[1:])
