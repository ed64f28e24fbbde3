"""Run a scene: the analysis of its kind is loaded only then."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene

_RUNNERS = {
    "bond-graph": "dynid.scene.kinds.bond_graph",
    "identification": "dynid.scene.kinds.identification",
}


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
    return result
