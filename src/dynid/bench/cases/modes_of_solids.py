"""The lowest ten modes of a solid, whose factors fill more than those of a plate.

With `--size modes-of-solids=86000` it has 86,490 DOFs, whose modes take minutes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from dynid.bench.cases.lowest_modes import lowest_modes


@lru_cache(maxsize=1)
def solid(dofs: int) -> tuple[Any, Any]:
    """Return stiffness and mass of a block, clamped on one face, of about so many DOFs."""
    from dynid.bench.meshes import solid as mesh

    return mesh(max(2, round((dofs / 3) ** (1 / 3) - 2 / 3)))


BENCHMARK = lowest_modes(
    solid,
    ("splu", "splu-uncounted", "pardiso", "eigsh"),
    title="The lowest ten modes of an elastic block, clamped on one face",
    sizes=(300,),
    full=(2000, 8000),
    remark="splu-uncounted and the peer do not prove that no mode is missed",
)
