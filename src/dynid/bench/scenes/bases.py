"""Reductions of any size by all methods, as a scene would describe them."""

from __future__ import annotations

from typing import Any

from dynid.errors import UsageError
from dynid.scene.schema.reductions import JointAwareModel, Reduction
from dynid.structure.reduction.methods import METHODS as _CLASSES

#: Joint-aware with its modes alone; what is called joint-aware has residual vectors.
ALONE = "joint-aware-modes"
METHODS = (*_CLASSES, ALONE)


def name_of(part: Reduction) -> str:
    """Return what a reduction of a scene is called among the alternatives."""
    return (
        ALONE if isinstance(part, JointAwareModel) and part.residuals in (None, [], "none") else part.method
    )


def sizes_around(size: int, most: int) -> list[int]:
    """Return a size and twice that, as far as these are fewer than all coordinates."""
    return [each for each in (size, 2 * size) if each < most] or [size]


def described(name: str, size: int, ends: int) -> dict[str, Any]:
    """Return a reduction onto so many coordinates.

    Parameters
    ----------
    name
        The method, or `ALONE`.
    size
        Coordinates.
    ends
        How many DOFs of joints, sensors and loads there are: a boundary, or loads with residual vectors.

    Raises
    ------
    UsageError
        If these leave no coordinate for modes.
    """
    chosen = {"masters": {"count": size}}
    if name in ("guyan", "dynamic", "irs"):
        return {"method": name, **chosen}
    if name == "serep":
        return {"method": name, **chosen, "modes": {"count": size}}
    if name == ALONE:
        return {"method": "joint-aware", "modes": {"count": size}, "residuals": "none"}
    if size <= ends:
        raise UsageError(f"{ends} DOFs of joints, sensors and loads leave no coordinate for modes")
    modes = {"modes": {"count": size - ends}}
    return {"method": name, **modes} | ({} if name == "craig-bampton" else {"residuals": "auto"})
