"""Run a scene: the analysis of its kind is loaded only then."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dynid.result import Result
    from dynid.scene.load import Scene

#: For every kind the module that runs its scenes.
RUNNERS = {
    "bond-graph": "dynid.scene.kinds.bond_graph",
    "identification": "dynid.scene.kinds.identification",
    "reduction": "dynid.scene.kinds.reduction",
    "study": "dynid.scene.kinds.study",
}


def _seeds(data: dict[str, Any]) -> Iterator[int]:
    """Yield the seeds of a scene: of its measurement's noise first, then of its random signals."""
    measurement = data.get("measurement") or {}
    simulate = measurement.get("simulate") or (measurement.get("frf") or {}).get("simulate")
    if simulate is not None:
        yield simulate.get("seed", 0)
    time = (data.get("analysis") or {}).get("time") or {}
    for signals in (data.get("excitation"), time.get("input")):
        for signal in [signals] if isinstance(signals, dict) else signals or []:
            if signal["kind"] == "random":
                yield signal.get("seed", 0)


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
    result: Result = import_module(RUNNERS[scene.kind]).run(scene)
    result.attrs["scene"] = scene.source.resolved_text()
    result.attrs["seed"] = next(_seeds(scene.source.data), 0)  # 0 where nothing in the scene is random
    return result
