"""Zeros, poles and eigenvalues: of a chain, of a mesh with many loops, and of a sparse pencil."""

from __future__ import annotations

import sys
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache, partial
from itertools import count
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.chain import matrices, reduced, true_roots
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.defaults import EXACT_ROOTS, EXACT_ROOTS_ON_LOOPS, MANY_LOOPS, SPARSE_REFINEMENT, STARTED_ROOTS

#: Errors of roots below this part of the largest pole are relative to that part.
_SMALL_ROOT_RATIO = 1e-3


def distance(got: Any, true: Any, size: float) -> float:
    """Return the largest relative distance of roots paired with the true ones; inf for a wrong count."""
    if len(got) != len(true):
        return float("inf")
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(got[:, None] - true) / relative_to(true, size)
    return float(apart[linear_sum_assignment(apart)].max(initial=0.0))


def relative_to(true: Any, size: float) -> Any:
    """Return the sizes that errors of roots are relative to; `size` is that of the largest pole."""
    scale = np.maximum(np.abs(true), _SMALL_ROOT_RATIO * size)
    return np.where(scale > 0, scale, 1.0)


def _error(roots: Any, true: Any) -> float:
    """Return the largest relative distance of (zeros, poles) from the true ones."""
    size = float(abs(true[1]).max())
    return max(distance(np.asarray(got), roots, size) for got, roots in zip(roots, true, strict=True))


def _by_engine(model: Callable[[int], ReducedGraph], engine: str) -> Callable[[int], Any]:
    """Return zeros and poles of the one channel of a model by the `exact` or the `float` engine."""

    def work(size: int) -> Any:
        from dynid.bondgraph.exact_engine import ExactEngine
        from dynid.bondgraph.floating.float_engine import FloatEngine
        from dynid.lti.certified_roots import repeated

        graph = model(size)
        solver: Any = (ExactEngine if engine == "exact" else FloatEngine)(graph)
        transfer = solver.channel(next(iter(graph.channels())))
        return repeated(transfer.zeros), repeated(transfer.poles)

    return work


def _unstarted(stages: int) -> Any:
    """Certify the exact roots without starting values from eigenvalues."""
    from dynid.bondgraph.exact_engine import TransferFunction
    from dynid.lti.certified_roots import repeated

    graph = reduced(stages)
    ((_, register),) = graph.channels().items()
    transfer = TransferFunction.of(graph.rational([register])[register])
    return repeated(transfer.zeros), repeated(transfer.poles)


def _pencil_engine(stages: int) -> Any:
    from dynid.lti import zeros_poles

    A, B, C, D = matrices(stages)
    return zeros_poles(A, B, C, D, engine="float")[:2]


def controlled(stages: int) -> Any:
    """Return zeros and poles by control, which uses SLICOT's AB08ND for zeros where slycot is installed."""
    import control

    system = control.ss(*matrices(stages))
    return control.zeros(system), control.poles(system)


def _control_alone(stages: int) -> Any:
    """Return zeros and poles by control without slycot: QZ on the system's pencil."""
    hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if name.startswith("slycot")}
    sys.modules["slycot"] = None  # type: ignore[assignment]
    try:
        return controlled(stages)
    finally:
        del sys.modules["slycot"]
        sys.modules.update(hidden)


def _control_tf(stages: int) -> Any:
    import control

    transfer = control.tf(control.ss(*matrices(stages)))
    return control.zeros(transfer), control.poles(transfer)


def _eigenvalues(stages: int) -> Any:
    """Take eigenvalues of A, and the finite ones of the system's pencil, by SciPy."""
    from scipy.linalg import block_diag, eigvals

    A, B, C, D = matrices(stages)
    zeros = eigvals(np.block([[A, B], [C, D]]), block_diag(np.eye(len(A)), np.zeros_like(D)))
    return zeros[np.isfinite(zeros)], eigvals(A)


def _polynomials(stages: int) -> Any:
    from scipy.signal import ss2zpk

    return ss2zpk(*matrices(stages))[:2]


CHAIN = Benchmark(
    title="Zeros and poles of a chain, from the model on",
    size="stages",
    sizes=(2, 10, 50),
    full=(5, 20, 100, 200, 500),
    alternatives=(
        Alternative("exact", _by_engine(reduced, "exact")),
        Alternative("float", _by_engine(reduced, "float")),
        Alternative("exact-unstarted", _unstarted, min_size=STARTED_ROOTS.value // 2 + 1, max_size=100),
        Alternative("pencil", _pencil_engine, max_size=100),
        Alternative("control", _control_alone, needs=("control",), peer=True),
        Alternative("control-tf", _control_tf, needs=("control",), max_size=100, peer=True),
        Alternative("eigvals", _eigenvalues, peer=True),
        Alternative("ss2zpk", _polynomials, max_size=100, peer=True),
    ),
    error=lambda stages, roots: _error(roots, true_roots(stages)),
    measure="largest relative distance from the exact roots; inf: a wrong count",
    default=lambda stages: "exact" if 2 * stages <= EXACT_ROOTS.value else "float",  # two states a stage
)


def _mesh(side: int) -> ReducedGraph:
    """Return a square mesh of capacitors to ground, joined by coils with losses: (side - 1)^2 loops."""
    nodes, bonds, number = [Node("u", "Sf")], [Bond("u", "p0_0")], count(1)
    for row in range(side):
        for column in range(side):
            here = f"p{row}_{column}"
            nodes += [Node(here, "0"), Node(f"c{here}", "C", Fraction(next(number), 97))]
            bonds.append(Bond(here, f"c{here}"))
            for there, inside in ((f"p{row + 1}_{column}", row), (f"p{row}_{column + 1}", column)):
                if inside + 1 < side:
                    link = f"{here}{there}"
                    nodes += [Node(link, "1"), Node(f"i{link}", "I", Fraction(next(number), 89))]
                    nodes.append(Node(f"r{link}", "R", Fraction(next(number), 83)))
                    ends = (here, link, there)
                    bonds += [
                        Bond(*ends[:2]),
                        Bond(*ends[1:]),
                        Bond(link, f"i{link}"),
                        Bond(link, f"r{link}"),
                    ]
    far = f"p{side - 1}_{side - 1}"
    return ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port(far, "e")], traced=False)


#: Return the exact zeros and poles of a mesh, correctly rounded.
_true_roots_of_mesh = lru_cache(maxsize=2)(_by_engine(_mesh, "exact"))


def _engine_for_mesh(side: int) -> str:
    looped = (side - 1) ** 2 > MANY_LOOPS.value
    limit = EXACT_ROOTS_ON_LOOPS if looped else EXACT_ROOTS
    return "exact" if 3 * side**2 - 2 * side <= limit.value else "float"


MESH = Benchmark(
    title="Zeros and poles of a square mesh with (side - 1)^2 loops and 3 side^2 - 2 side storage elements",
    size="side",
    sizes=(3, 4),
    alternatives=(
        Alternative("exact", _by_engine(_mesh, "exact"), max_size=7),
        Alternative("float", _by_engine(_mesh, "float")),
    ),
    error=lambda side, roots: _error(roots, _true_roots_of_mesh(side)),
    measure="largest relative distance from the exact roots; inf: a wrong count",
    default=_engine_for_mesh,
    full=(5, 6),
)


def _pencil(size: int) -> tuple[Any, Any]:
    """Return F and G of sF - G of a chain of unit masses and springs between two walls, with size states."""
    from scipy.sparse import block_array, diags_array, eye_array

    masses = size // 2
    K = diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(masses, masses))
    blocks: Any = [[None, eye_array(masses)], [-K, None]]
    return eye_array(size).tocsr(), block_array(blocks).tocsr()


def _certified(pencil: tuple[Any, Any], *, sparse: bool) -> Any:
    from dynid.lti.pencil.eigenvalues import finite_eigenvalues

    return finite_eigenvalues(*pencil, sparse=sparse).values


def _pencil_error(size: int, roots: Any) -> float:
    masses = size // 2
    omega = 2 * np.sin(np.pi * np.arange(1, masses + 1) / (2 * (masses + 1)))
    true = 1j * np.concatenate([-omega[::-1], omega])
    return float(np.max(np.abs(roots[np.argsort(roots.imag)] - true) / np.abs(true)))


PENCIL = Benchmark(
    title="Natural frequencies of a chain between two walls, each with a bound on its error",
    size="states",
    sizes=(80, 160),
    full=(40, 120, 240, 480),
    alternatives=(
        Alternative("dense", partial(_certified, sparse=False)),
        Alternative("sparse", partial(_certified, sparse=True)),
        Alternative("eigvals", np.linalg.eigvals, lambda size: _pencil(size)[1].toarray(), peer=True),
    ),
    error=_pencil_error,
    problem=_pencil,
    measure="largest relative error of an eigenvalue",
    default=lambda size: "sparse" if size >= SPARSE_REFINEMENT.value else "dense",
    remark="eigvals bounds no error",
)
