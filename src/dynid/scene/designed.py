"""The designed scene: the scene of a design with the designed values in place of the starts."""

from __future__ import annotations

from typing import Any

from dynid.errors import SceneError, UsageError
from dynid.result import Result
from dynid.scene.composition import composed
from dynid.scene.identified import changed_at, place_of_unknown, without_keys
from dynid.scene.yaml.parser import Path
from dynid.scene.yaml.source import Source, parse_source
from dynid.scene.yaml.writer import dump, edited

_DESIGN = "bond_graph/design"


def holds_design(result: Result) -> bool:
    """Return True if a result is that of a design."""
    return f"{_DESIGN}/value" in result


def designed_scene_text(result: Result, file: str = "") -> str:
    """Return the scene of a design as YAML, without the design, with all digits of the designed values.

    Comments give the starts. Expectations of the design are left out. Order and comments stay where values
    stand in one line each.

    Parameters
    ----------
    result
        The result of a design, with its scene.
    file
        Its name, for messages.

    Raises
    ------
    UsageError
        If it has no scene.
    """
    text = str(result.attrs.get("scene", ""))
    if not text:
        raise UsageError(f"{file or 'the result'} holds no scene", remedy="Run the scene again.")
    names, values, starts = (result[f"{_DESIGN}/{part}"].data.tolist() for part in ("name", "value", "start"))
    source = parse_source(text, file or "<scene>")
    if not all(place_of_unknown(source.data, name) for name in names):
        text = dump(composed(source).data)  # a parameter within a model: of one instance, not of the model
        source = parse_source(text, file or "<scene>")
    changes: dict[Path, Any] = {}
    notes: dict[Path, str] = {}
    for name, value, start in zip(names, values, starts, strict=True):
        path = place_of_unknown(source.data, name)
        changes[path], notes[path] = value, f"designed, from {start:.6g}"
    given = source.data.get("expect") or []
    expected = [one for one in given if not str(one.get("path", "")).startswith(f"{_DESIGN}/")]
    dropped = {"design"} | ({"expect"} if given and not expected else set())
    data = {key: value for key, value in source.data.items() if key not in dropped}
    if expected and expected != given:
        data["expect"] = expected
        text = _without_entries(source, [k for k, one in enumerate(given) if one not in expected], expected)
    kept = without_keys(text, dropped, data).rstrip() + "\n"
    for path, value in changes.items():
        data = changed_at(data, path, value)
    return edited(kept, data, changes, notes)


def _without_entries(source: Source, places: list[int], expected: list[Any]) -> str:
    """Return the text of a scene without some expectations, each of which stands in a line."""
    lines = {source.marks["expect", place].value[0] for place in places if ("expect", place) in source.marks}
    written = source.text.splitlines(keepends=True)
    text = "".join(line for number, line in enumerate(written, 1) if number not in lines)
    data = {**source.data, "expect": expected}
    try:
        return text if parse_source(text).data == data else dump(data)
    except SceneError:
        return dump(data)
