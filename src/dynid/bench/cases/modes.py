"""The lowest ten modes of a plate; with `--size modes=100000` it has 99,739 DOFs."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from dynid.bench.cases.lowest_modes import lowest_modes


@lru_cache(maxsize=1)
def plate(dofs: int) -> tuple[Any, Any]:
    """Return stiffness and mass of a plate of about so many DOFs."""
    from dynid.bench.meshes import plate as mesh

    return mesh(max(2, round((dofs / 3) ** 0.5) - 1))


BENCHMARK = lowest_modes(
    plate,
    ("splu", "splu-uncounted", "dense", "cholespy", "pardiso", "eigsh"),
    title="The lowest ten modes of a simply supported plate",
    sizes=(100, 1000, 5000),
    full=(200, 400, 4000, 10_000, 100_000),
    remark="dense computes all modes whatever is asked for: its time is what the limit of all modes costs; "
    "splu-uncounted and the peer do not prove that no mode is missed, as splu does by one more "
    "factorisation; errors below 1e-10 are roundings, and the front among them changes from run to run",
)
