"""Reading plain data of which nothing is known yet: what is not as it should be counts as nothing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def signals(path: tuple[Any, ...], given: Any) -> Iterable[tuple[tuple[Any, ...], dict[Any, Any]]]:
    """Yield the signals of one or of a list, each with its path."""
    if isinstance(given, dict):
        yield path, given
    elif isinstance(given, list):
        yield from (
            ((*path, place), signal) for place, signal in enumerate(given) if isinstance(signal, dict)
        )


def mapping_of(value: Any) -> dict[Any, Any]:
    """Return a mapping, or an empty one in the place of anything else."""
    return value if isinstance(value, dict) else {}


def is_mapping_of_mappings(value: Any) -> bool:
    """Tell whether every value of a mapping is one itself."""
    return isinstance(value, dict) and all(isinstance(entry, dict) for entry in value.values())


def mapping(holder: Any, key: str) -> dict[Any, Any]:
    """Return the mapping under a key, or an empty one."""
    return mapping_of(mapping_of(holder).get(key))


def listing(holder: Any, key: str) -> list[Any]:
    """Return the list under a key, or an empty one."""
    value = mapping_of(holder).get(key)
    return value if isinstance(value, list) else []


def written_key(mapping: dict[Any, Any], name: str) -> Any:
    """Return the key of a mapping that is written like `name` (a number may be a key)."""
    return name if name in mapping else next((key for key in mapping if str(key) == name), name)
