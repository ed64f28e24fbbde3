"""Zeros and poles of a chain: v_N / F has a zero at 0 and one at -k/b for every joint but the last."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.chain import matrices, reduced, true_roots
from dynid.bench.roots import distance
from dynid.defaults import EXACT_ROOTS, STARTED_ROOTS


def _exact(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.exact_engine import ExactEngine
    from dynid.lti.certified_roots import repeated

    def work() -> Any:
        graph = reduced(stages)
        transfer = ExactEngine(graph).channel(next(iter(graph.channels())))
        return repeated(transfer.zeros), repeated(transfer.poles)

    return work


def _unstarted(stages: int) -> Callable[[], Any]:
    """Certify the exact roots without eigenvalues to begin at."""
    from dynid.bondgraph.exact_engine import TransferFunction
    from dynid.lti.certified_roots import repeated

    def work() -> Any:
        graph = reduced(stages)
        ((_, register),) = graph.channels().items()
        transfer = TransferFunction.of(graph.rational([register])[register])
        return repeated(transfer.zeros), repeated(transfer.poles)

    return work


def _float(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.floating.engine import FloatEngine
    from dynid.lti.certified_roots import repeated

    def work() -> Any:
        graph = reduced(stages)
        transfer = FloatEngine(graph).channel(next(iter(graph.channels())))
        return repeated(transfer.zeros), repeated(transfer.poles)

    return work


def _matrices(stages: int) -> Callable[[], Any]:
    from dynid.lti import zeros_poles

    def work() -> Any:
        A, B, C, D = matrices(stages)
        return zeros_poles(A, B, C, D, engine="float")[:2]

    return work


def controlled(stages: int) -> Callable[[], Any]:
    """Ask control, which takes SLICOT's AB08ND for zeros where slycot is installed."""
    import control

    def work() -> Any:
        system = control.ss(*matrices(stages))
        return control.zeros(system), control.poles(system)

    return work


def _control_alone(stages: int) -> Callable[[], Any]:
    """Ask control as it answers without slycot: QZ on the system's pencil."""
    work = controlled(stages)

    def without_slycot() -> Any:
        hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if name.startswith("slycot")}
        sys.modules["slycot"] = None  # type: ignore[assignment]
        try:
            return work()
        finally:
            del sys.modules["slycot"]
            sys.modules.update(hidden)

    return without_slycot


def _control_tf(stages: int) -> Callable[[], Any]:
    """Convert to polynomials with control, and take their roots."""
    import control

    def work() -> Any:
        transfer = control.tf(control.ss(*matrices(stages)))
        return control.zeros(transfer), control.poles(transfer)

    return work


def _eigenvalues(stages: int) -> Callable[[], Any]:
    """Take eigenvalues of A, and the finite ones of the system's pencil, by SciPy."""
    import numpy as np
    from scipy.linalg import block_diag, eigvals

    def work() -> Any:
        A, B, C, D = matrices(stages)
        zeros = eigvals(np.block([[A, B], [C, D]]), block_diag(np.eye(len(A)), np.zeros_like(D)))
        return zeros[np.isfinite(zeros)], eigvals(A)

    return work


def _polynomials(stages: int) -> Callable[[], Any]:
    from scipy.signal import ss2zpk

    return lambda: ss2zpk(*matrices(stages))[:2]


def _default(stages: int) -> str:
    """Return what is chosen for a chain, which has two storages a stage and no loops."""
    return "exact" if 2 * stages <= EXACT_ROOTS.value else "float"


def _error(stages: int, found: Any) -> float:
    """Return the largest relative distance of roots paired with the true ones; inf for a wrong count."""
    import numpy as np

    true = true_roots(stages)
    size = float(abs(true[1]).max())
    return max(distance(np.asarray(got), roots, size) for got, roots in zip(found, true, strict=True))


BENCHMARK = Benchmark(
    title="Zeros and poles of a chain, from the model on",
    size="stages",
    sizes=(2, 10, 50),
    full=(5, 20, 100, 200, 500),
    alternatives=(
        Alternative("exact", _exact),
        Alternative("float", _float),
        Alternative("exact-unstarted", _unstarted, least=STARTED_ROOTS.value // 2 + 1, most=100),
        Alternative("pencil", _matrices, most=100),
        Alternative("control", _control_alone, needs=("control",), peer=True),
        Alternative("control-tf", _control_tf, needs=("control",), most=100, peer=True),
        Alternative("eigvals", _eigenvalues, peer=True),
        Alternative("ss2zpk", _polynomials, most=100, peer=True),
    ),
    error=_error,
    measure="largest relative distance from the exact roots; inf: a wrong count",
    default=_default,
)
