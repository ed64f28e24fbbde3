"""The scene that a result came from, read again out of the result."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from dynid.errors import SceneError, UsageError
from dynid.scene.load import Scene, check_source
from dynid.scene.yaml.source import parse_source

if TYPE_CHECKING:
    from dynid.result import Result


def scene_of(result: Result) -> Scene:
    """Return the scene whose text a result bears.

    Raises
    ------
    UsageError
        Where it bears none, or one that this dynid does not read.
    """
    return _read(str(result.attrs.get("scene", "")))


@lru_cache(maxsize=4)
def _read(text: str) -> Scene:
    if not text:
        raise UsageError("the result does not hold the text of its scene", remedy="Run the scene again.")
    try:
        return check_source(parse_source(text, "<scene of the result>"))
    except SceneError as error:
        problem = f"the scene in the result cannot be read: {error.faults[0].message}"
        raise UsageError(problem, remedy="Run the scene again.") from error
