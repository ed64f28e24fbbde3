"""Access to plain data before they are validated: a value of the wrong type counts as missing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
    """Return True for a mapping whose values are all mappings."""
    return isinstance(value, dict) and all(isinstance(entry, dict) for entry in value.values())


def mapping(holder: Any, key: str) -> dict[Any, Any]:
    """Return the mapping under a key, or an empty one."""
    return mapping_of(mapping_of(holder).get(key))


def listing(holder: Any, key: str) -> list[Any]:
    """Return the list under a key, or an empty one."""
    value = mapping_of(holder).get(key)
    return value if isinstance(value, list) else []


def reference_key(entry: Any) -> str | None:
    """Return the key of a parameter's reference value: its true value, else its start, else its value.

    None of a parameter that is no mapping, or has none of them.
    """
    return next((key for key in ("true", "start", "value") if mapping_of(entry).get(key) is not None), None)


def reference_values(parameters: dict[Any, Any]) -> dict[str, Any]:
    """Return the parameters of a scene as written, unknown and considered ones at their reference values."""
    return {
        str(name): entry.get(reference_key(entry)) if isinstance(entry, dict) else entry
        for name, entry in parameters.items()
    }


def written_key(mapping: dict[Any, Any], name: str) -> Any:
    """Return the key of a mapping that is written like `name` (a number may be a key)."""
    return name if name in mapping else next((key for key in mapping if str(key) == name), name)


def chain_ends(text: str) -> list[str]:
    """Return the nodes along `a -> b -> c`; none where the text is no chain."""
    ends = [part.strip() for part in text.split("->")]
    return ends if len(ends) > 1 and all(ends) else []


#: Types of the nodes that bonds attach to at named ports, and of these ports, in `node_types`.
FIELD, COUPLING, STRUCTURE, PORT = "field", "multiport", "structure", "port"
MULTIPORTS = (FIELD, COUPLING, STRUCTURE)


def node_types(data: Any) -> dict[str, str]:
    """Return the type of every node of a bond graph as written; empty where it cannot be read.

    With `matrix` or `ports` an I, C or R has the type `FIELD`, a TF or GY the type `COUPLING`; the ports of
    these and of structures stand beside them as ``field.a``, of type `PORT`.
    """
    types = {}
    for name, node in mapping(mapping(data, "graph"), "nodes").items():
        kind = node.get("type") if isinstance(node, dict) else node
        types[str(name)] = str(kind) if isinstance(kind, str | int) else ""
        if isinstance(node, dict) and (kind == STRUCTURE or {"matrix", "ports"} & node.keys()):
            types[str(name)] = {STRUCTURE: STRUCTURE, "TF": COUPLING, "GY": COUPLING}.get(str(kind), FIELD)
            ports = node.get("ports")
            types |= {f"{name}.{port}": PORT for port in (ports if isinstance(ports, list | dict) else ())}
    return types


def references(data: Any) -> dict[str, str]:
    """Return the references of feedback loops: sources of the closed loop, of the type of the driven one."""
    types, found = node_types(data), {}
    for loop in listing(mapping(data, "control"), "loops"):
        name = mapping_of(loop).get("reference")
        if isinstance(name, str) and name:
            found[name] = types.get(str(loop.get("to")), "")
    return found


def ports_of(types: Mapping[str, str], name: str) -> list[str]:
    """Return the ports of a node that has several, ``field.a``, in `node_types`."""
    return [port for port, kind in types.items() if kind == PORT and port.rpartition(".")[0] == name]


def own_variable(kind: str, gives: str) -> str:
    """Return the variable that the law of an element is a function of; empty where it has no such law."""
    return {("R", "e"): "f", ("R", "f"): "e", ("I", "f"): "p", ("C", "e"): "q"}.get((kind, gives), "")
