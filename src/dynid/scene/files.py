"""The files that a scene names, and the same scene in another folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dynid.scene.yaml.core import Path as KeyPath

#: Under `matrices`, what may be a file by its name alone.
_MATRICES = ("mass", "stiffness", "damping", "labels", "state_space")


def file_places(data: Any, path: KeyPath = ()) -> Iterator[KeyPath]:
    """Yield the places in a scene's data where the name of a file stands."""
    if isinstance(data, list):
        for place, item in enumerate(data):
            yield from file_places(item, (*path, place))
    if not isinstance(data, dict):
        return
    for key, value in data.items():
        if not path and key == "expect":
            continue  # paths in the result
        if isinstance(value, str):
            if key == "path" or (path[-1:] == ("matrices",) and key in _MATRICES):
                yield (*path, key)
        else:
            yield from file_places(value, (*path, key))


def moved(name: str, folder: Path, target: Path) -> str:
    """Return the name under which a scene in another folder finds a file.

    Parameters
    ----------
    name
        As the scene has it.
    folder, target
        Where the scene is, and where it goes.
    """
    if Path(name).is_absolute():
        return name
    return Path(os.path.relpath(folder.resolve() / name, target.resolve())).as_posix()
