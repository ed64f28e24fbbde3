"""Names of a scene, read from its plain data before it is validated: its parameters and its nodes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from dynid.arithmetic.dependent import Dependent, substituted
from dynid.arithmetic.expression import ExpressionError, Number, parse, resolve_parameters
from dynid.errors import Fault
from dynid.scene.schema.quantities import SceneNames
from dynid.scene.schema.raw import (
    mapping,
    mapping_of,
    node_types,
    reference_key,
    reference_values,
    references,
    written_key,
)
from dynid.scene.yaml.source import Source


def read_names(source: Source, free: Mapping[str, float] | None = None) -> tuple[SceneNames, list[Fault]]:
    """Return the values of the parameters and the types of the nodes of a scene.

    Parameters
    ----------
    source
        The scene.
    free
        Parameters of a design that quantities depend on, with their reference values; absent: of an
        identification the unknown and considered ones.

    Returns
    -------
    SceneNames, list of Fault
        The names, and the faults of the parameters.
    """
    given = mapping(source.data, "parameters")
    raw = {str(name): entry for name, entry in given.items()}
    written = reference_values(given) | dict(free or {})
    values, problems = resolve_parameters(written)
    sought = {name for name, entry in raw.items() if isinstance(entry, dict)} if free is None else free.keys()
    dependent = _dependent(sought, written, values)
    located: dict[tuple[str, ...], str] = {}
    for name, text in problems.items():
        key = reference_key(raw[name])
        if key is not None:
            located[name, key] = text
        elif not isinstance(raw[name], dict):  # a mapping without any value is reported by its model
            located[(name,)] = text
    located |= dict(_circular(raw, dependent))
    faults = [
        source.fault(("parameters", written_key(given, name), *keys), text)
        for (name, *keys), text in located.items()
    ]
    names = SceneNames(
        values,
        dependent,
        signed=frozenset(name for name, one in raw.items() if mapping_of(one).get("scale") == "linear"),
        identifying=free is not None or source.data.get("kind") == "identification",
        faulty=frozenset(raw.keys() - values.keys()),
        nodes=node_types(source.data) | references(source.data),
        complete=isinstance(source.data.get("parameters", {}), dict),
    )
    return names, faults


def _dependent(
    sought: Collection[str], written: Mapping[str, Any], values: Mapping[str, Number]
) -> dict[str, Dependent]:
    """Return the parameters that are sought or considered, and those that depend on them."""
    found: dict[str, Dependent] = {}
    if not sought:
        return found
    for name, value in values.items():  # in an order in which each needs only earlier ones
        if name in sought:
            found[name] = Dependent.parameter(name, value)
        elif isinstance(written[name], str):
            expression = parse(written[name])
            if not expression.names.isdisjoint(found):
                known = {used: found.get(used, values[used]) for used in expression.names}
                found[name] = substituted(expression, known)
    return found


def _circular(
    raw: Mapping[str, Any], dependent: Mapping[str, Dependent]
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the numbers of unknown and considered parameters that depend on such themselves."""
    for name, entry in raw.items():
        for keys, text in _texts(entry):
            try:
                used = sorted(parse(text).names & dependent.keys())
            except ExpressionError:
                continue  # reported where it is validated
            if used:
                message = (
                    f"'{keys[-1]}' of '{name}' depends on '{used[0]}', which is not known itself; "
                    f"write a number here, or an expression of '{used[0]}' in place of the whole mapping"
                )
                if used == [name]:
                    message = f"'{keys[-1]}' of '{name}' depends on '{name}' itself; write a number"
                yield (name, *keys), message


def _texts(entry: Any) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the numbers of a parameter that are written as expressions."""
    for key, value in mapping_of(entry).items():
        if isinstance(value, str) and key != "scale":
            yield (str(key),), value
        if key == "prior":
            yield from (
                ((str(key), str(own)), text)
                for own, text in mapping_of(value).items()
                if isinstance(text, str)
            )
