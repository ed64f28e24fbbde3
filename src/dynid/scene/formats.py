"""Formats of scenes: every format ever released is read, each by one step to the next.

Today there is one. A second one comes with the step `STEPS[1]` from the data of the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from dynid.errors import SceneError
from dynid.scene.yaml.source import Source

#: The format that the schema describes.
CURRENT = 1

#: For an older format: what turns its data into those of the next one, without changing them in place.
STEPS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}


def as_current(source: Source) -> Source:
    """Return a scene of any known format as one of the current format.

    Its text stays as written: it is what a result keeps, and what is read again. Faults are reported at the
    places of that text.

    Raises
    ------
    SceneError
        Where the format is newer than this dynid.
    """
    number = source.data.get("dynid") if isinstance(source.data, dict) else None
    if not isinstance(number, int) or isinstance(number, bool):
        return source  # the schema says what is wrong
    if number > CURRENT:
        message = f"the scene has format {number}; this dynid reads formats up to {CURRENT}: update dynid"
        raise SceneError([source.fault(("dynid",), message)])
    data = source.data
    while number < CURRENT and number in STEPS:
        number += 1
        data = {**STEPS[number - 1](data), "dynid": number}
    return source if data is source.data else replace(source, data=data)
