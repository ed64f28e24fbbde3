"""Run a scene: the analysis of its kind is loaded only then."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dynid.result import Result
    from dynid.scene.load import Scene

_RUNNERS = {
    "bond-graph": "dynid.scene.kinds.bond_graph",
    "identification": "dynid.scene.kinds.identification",
}


def _seeds(data: Any) -> Iterator[int]:
    """Yield the seeds in a scene: of its measurement's noise first, then of its random signals."""
    if isinstance(data, dict):
        parts = sorted(data.items(), key=lambda item: item[0] != "measurement")
        if data.get("kind") == "random" or "noise_ratio" in data or "seed" in data:
            yield int(data.get("seed", 0))
        for _, part in parts:
            yield from _seeds(part)
    elif isinstance(data, list):
        for part in data:
            yield from _seeds(part)


def run_scene(scene: Scene) -> Result:
    """Run a valid scene.

    Returns
    -------
    Result
        The arrays of its analysis, with the scene's text.

    Raises
    ------
    NumericalError
        Where the question has no trustworthy answer.
    FileError
        Where a file that the scene names cannot be read.
    """
    result: Result = import_module(_RUNNERS[scene.kind]).run(scene)
    result.attrs["scene"] = scene.source.resolved_text()
    seeds = list(_seeds(scene.source.data))
    result.attrs["seed"] = seeds[0] if seeds else 0  # 0: nothing in the scene is random
    return result
