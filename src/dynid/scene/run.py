"""Run a scene, or only the steps of its run that come before any computation."""

from __future__ import annotations

from collections.abc import Callable
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

    The result has the scene's text. Raises `NumericalError` where the analysis has no trustworthy result; of
    a rejected fit with its `result`. Raises `FileError` where a file that the scene names cannot be read.
    """
    try:
        result: Result = KINDS[scene.kind].load("run")(scene)
    except DynidError as error:
        if error.result is not None:
            error.result.title = scene.title
            _add_origin(error.result, scene)
        raise
    _add_origin(result, scene)
    return result


def _add_origin(result: Result, scene: Scene) -> None:
    """Add the scene's text and the seed of its noise."""
    result.attrs["scene"] = scene.source.resolved_text()
    data = scene.source.data
    measurement, time = data.get("measurement") or {}, (data.get("analysis") or {}).get("time") or {}
    simulate = measurement.get("simulate") or (measurement.get("frf") or {}).get("simulate")
    noisy = [] if simulate is None else [simulate]
    for signals in (data.get("excitation"), time.get("input")):
        listed = [signals] if isinstance(signals, dict) else signals or []
        noisy += [signal for signal in listed if signal["kind"] == "random"]
    # The seed of the noise of the measurement, else that of the first random signal; 0 without both.
    result.attrs["seed"] = noisy[0].get("seed", 0) if noisy else 0


def preparation_errors(scene: Scene) -> list[DynidError]:
    """Return the errors of a run of a valid scene before any computation, in its order.

    The run's own steps are taken, so messages are those of the run: files are read, structures and graphs
    built, signals and records made, sources of a graph tested for contradictions. A study has no steps
    of its own; see those of the scene that it varies.
    """
    steps = KINDS[scene.kind].load("prepare")
    errors: list[DynidError] = []
    for step in steps(scene) if steps else ():
        try:
            step()
        except DynidError as error:
            errors.append(error)
    return errors
