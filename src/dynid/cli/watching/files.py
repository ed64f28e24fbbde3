"""Which files a scene reads, and whether they changed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

#: Longest text of a scene that may be the name of a file, and how deep one scene may name another.
_LONGEST, _DEEPEST = 1000, 4

Stamp = tuple[tuple[str, int, int, int], ...]


def files_of(scene: str) -> list[Path]:
    """Return the scene's file and every file that a text in it names, and so on from scenes named there.

    Whatever is no file is no matter: a scene with faults is watched too.
    """
    found: dict[Path, None] = {}
    _gather(Path(scene), found, _DEEPEST)
    return list(found)


def _gather(file: Path, found: dict[Path, None], deeper: int) -> None:
    from dynid.errors import DynidError
    from dynid.scene.yaml.source import read_source

    found[file] = None
    if not deeper:
        return
    try:
        data = read_source(file).data
    except DynidError:
        return
    for text in _texts(data):
        other = file.parent / text
        if other in found or not _is_file(other):
            continue
        found[other] = None
        if other.suffix in (".yaml", ".yml"):
            _gather(other, found, deeper - 1)


def _texts(data: Any) -> Iterator[str]:
    stack = [data]
    while stack:
        item = stack.pop()
        if isinstance(item, str) and 0 < len(item) <= _LONGEST:
            yield item
        elif isinstance(item, dict):
            stack += item.values()
        elif isinstance(item, list):
            stack += item


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def stamp(files: list[Path]) -> Stamp:
    """Return what changes when a file is saved; what is not there has a stamp too."""
    return tuple(_stamp(file) for file in files)


def _stamp(file: Path) -> tuple[str, int, int, int]:
    try:
        status = file.stat()
    except OSError:
        return str(file), 0, 0, 0
    return str(file), status.st_mtime_ns, status.st_size, status.st_ino
