"""Reductions of a plate onto few DOFs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.modes import plate, reference
from dynid.defaults import MASTERS

#: Coordinates kept, and modes that are compared.
_KEPT, _COMPARED = 10, 5


def _method(method: str, **options: Any) -> Callable[[int], Callable[[], Any]]:
    def prepare(dofs: int) -> Callable[[], Any]:
        from scipy.sparse import csc_array

        from dynid.structure.model import StructuralModel
        from dynid.structure.modes import modes
        from dynid.structure.reduction.methods import reduce

        K, M = plate(dofs)
        model = StructuralModel(M, csc_array(K.shape), K)

        def work() -> Any:
            small = reduce(model, method, **options)
            return modes(*small.dense()).omega ** 2

        return work

    return prepare


def _error(dofs: int, found: Any) -> float:
    import numpy as np

    true = reference(plate, dofs)[:_COMPARED]
    return float(np.max(np.abs(np.sqrt(found[:_COMPARED] / true) - 1)))


def _spread(dofs: int) -> list[int]:
    """Return deflections spread evenly over the plate."""
    import numpy as np

    from dynid.bench.meshes import deflections

    places = deflections(max(2, round((dofs / 3) ** 0.5) - 1))
    return [int(places[k]) for k in np.linspace(0, len(places) - 1, _KEPT + 2).astype(int)[1:-1]]


def _on_masters(method: str, **options: Any) -> Callable[[int], Callable[[], Any]]:
    return lambda dofs: _method(method, masters=_spread(dofs), **options)(dofs)


def _chosen(choose: str) -> Callable[[int], Callable[[], Any]]:
    """Choose the masters of a SEREP basis by this rule, from the modes that it is to keep."""
    from dynid.structure.reduction.masters import Masters

    kept = tuple(range(1, _KEPT + 1))
    return _method("serep", modes=kept, masters=Masters(_KEPT, choose))  # type: ignore[arg-type]


BENCHMARK = Benchmark(
    title="A plate reduced onto ten coordinates, its first five frequencies",
    size="DOFs",
    sizes=(1000, 5000),
    alternatives=(
        Alternative("serep-qr", _chosen("qr")),
        Alternative("serep-effective-independence", _chosen("effective-independence")),
        Alternative("serep-mass", _chosen("mass")),
        Alternative("modal", _method("modal", modes=tuple(range(1, _KEPT + 1)))),
        Alternative("guyan", _on_masters("guyan")),
        Alternative("irs", _on_masters("irs")),
        Alternative("craig-bampton", _on_masters("craig-bampton", modes=tuple(range(1, 6)))),
    ),
    error=_error,
    measure="largest relative error of the first five frequencies",
    default=lambda _: f"serep-{MASTERS.value}",
    full=(50_000,),
)
