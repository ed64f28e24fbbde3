"""Ways to the modes of a structure: dense matrices, or Lanczos on a sparse factorisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dynid.bench.alternative import Alternative
from dynid.bench.scenes.aspect import Aspect
from dynid.choices import ALL_MODES, DENSE_MODES, FEW_MODES
from dynid.structure.factorisation.backends import BACKENDS
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes, solver_for

#: Frequencies below this part of the highest are rigid-body motions, measured by that.
_RIGID = 1e-6


def solvers(
    model: StructuralModel,
    count: int | None,
    below: float | None = None,
    values: Mapping[str, float] | None = None,
) -> Aspect:
    """Return the solvers of a structure's modes, and the one that is chosen.

    Parameters
    ----------
    model
        The structure.
    count, below, values
        As of `dynid.structure.description.modal_analysis`.
    """
    matrices, size = model.with_joints(values), model.size

    def solver(backend: str) -> Callable[[int], Callable[[], Any]]:
        return lambda _: lambda: modes(*matrices, count, below, backend).omega

    names = ["dense", *BACKENDS] if size <= ALL_MODES.value else list(BACKENDS)
    needs = {name: () if name == "splu" else (backend.package,) for name, backend in BACKENDS.items()}
    every = [(Alternative(name, solver(name), needs.get(name, ())), size) for name in names]
    return Aspect(
        title="solver of the modes",
        size="DOFs",
        points=every,
        chosen=frozenset({(solver_for(size, count, below), size)}),
        because=f"chosen by default: {DENSE_MODES}; {FEW_MODES}",
        error=_error,
        measure="largest relative difference of a frequency from the reference's",
    )


def _error(found: Any, reference: Any) -> float:
    if len(found) != len(reference):
        return float("inf")
    scale = np.maximum(reference, _RIGID * reference.max(initial=0.0))
    return float((np.abs(found - reference) / np.where(scale > 0, scale, 1.0)).max(initial=0.0))
