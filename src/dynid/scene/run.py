"""Run a scene, or only the steps of its run that come before any computation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from dynid.errors import DynidError
from dynid.scene.kind import KINDS

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene

#: A step of a run: builds or reads something, or raises its error.
PreparationStep = Callable[[], Any]


def run_scene(scene: Scene) -> Result:
    """Run a valid scene.

    Returns
    -------
    Result
        The arrays of its analysis, with the scene's text.

    Raises
    ------
    NumericalError
        Where the analysis has no trustworthy result.
    FileError
        Where a file that the scene names cannot be read.
    """
    result: Result = KINDS[scene.kind].load("run")(scene)
    result.attrs["scene"] = scene.source.resolved_text()
    result.attrs["seed"] = next(_seeds(scene.source.data), 0)  # 0 where nothing in the scene is random
    return result


def _seeds(data: dict[str, Any]) -> Iterator[int]:
    """Yield the seeds of a scene: that of its measurement's noise first, then of its random signals."""
    measurement = data.get("measurement") or {}
    simulate = measurement.get("simulate") or (measurement.get("frf") or {}).get("simulate")
    if simulate is not None:
        yield simulate.get("seed", 0)
    time = (data.get("analysis") or {}).get("time") or {}
    for signals in (data.get("excitation"), time.get("input")):
        for signal in [signals] if isinstance(signals, dict) else signals or []:
            if signal["kind"] == "random":
                yield signal.get("seed", 0)


def preparation_errors(scene: Scene) -> list[DynidError]:
    """Return the errors of a run of a valid scene before any computation, in its order.

    The run's own steps are taken, so messages are those of the run: files are read, structures and graphs
    built, signals and records made, sources of a graph tested for contradictions. A study has no steps
    of its own; see those of the scene that it varies.
    """
    steps = KINDS[scene.kind].load("prepare")
    found: list[DynidError] = []
    for step in steps(scene) if steps else ():
        try:
            step()
        except DynidError as error:
            found.append(error)
    return found
