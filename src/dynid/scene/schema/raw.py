"""Plain data before they are validated: values of any type, names, the unit of the frequencies."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from dynid.arithmetic.expression import ExpressionError, Number, parse, resolve_parameters
from dynid.errors import Fault
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean
from dynid.units import HERTZ, RADIANS, FrequencyUnit, si_unit, split_value, unit_fits

if TYPE_CHECKING:
    from dynid.arithmetic.dependent import Dependent
    from dynid.scene.schema.quantities import SceneNames


#: The most copies of an instance of a model.
MAX_COPIES = 100_000


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
    ends = [end.strip() for end in text.split("->")]
    return ends if len(ends) > 1 and all(ends) else []


def chain_fault(entry: Any) -> str:
    """Return why an entry is no chain of bonds, or an empty text; of several it shows the entries."""
    text = str(entry)
    first, *others = (part.strip() for part in re.split("[,;\n]", text))
    if not isinstance(entry, str) or "->" not in first or not (others or chain_ends(text)):
        return f"'{text}' is not a bond; write 'a -> b', or a chain 'a -> b -> c'"
    if not others:
        return ""
    tail = first.rpartition("->")[0].rpartition("->")[2].strip()  # of what is short for a -> b, a -> c
    chains = [first, *(part if "->" in part else f"{tail} -> {part}" for part in others if part)]
    entries = " and ".join(f"- {chain}" for chain in chains)
    return f"bond '{text}': an entry holds one chain; write an entry for each: {entries}"


#: Types of the nodes that bonds attach to at named ports, and of these ports, in `_node_types`.
FIELD, COUPLING, STRUCTURE, PORT = "field", "multiport", "structure", "port"
MULTIPORTS = (FIELD, COUPLING, STRUCTURE)


def _node_types(data: Any) -> dict[str, str]:
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
    """Return the references and setpoints of feedback loops, sources of the closed loop, with their types.

    A reference has the type of the driven source, a setpoint is an effort.
    """
    types, signals = _node_types(data), {}
    for loop in listing(mapping(data, "control"), "loops"):
        for key in ("reference", "setpoint"):
            name = mapping_of(loop).get(key)
            if isinstance(name, str) and name:
                signals[name] = types.get(str(loop.get("to")), "") if key == "reference" else "Se"
    for feedback in ("lqr", "placement"):
        states = mapping(mapping(data, "control"), feedback)
        for key in ("references", "setpoints"):
            for subject, name in mapping(states, key).items():
                if isinstance(name, str) and name:
                    signals[name] = types.get(str(subject), "") if key == "references" else "Se"
    return signals


def ports_of(types: Mapping[str, str], name: str) -> list[str]:
    """Return the ports of a node that has several, ``field.a``, in `_node_types`."""
    return [port for port, kind in types.items() if kind == PORT and port.rpartition(".")[0] == name]


def law_variable(kind: str, gives: str) -> str:
    """Return the variable that the law of an element is a function of; empty where it has no such law."""
    return {("R", "e"): "f", ("R", "f"): "e", ("I", "f"): "p", ("C", "e"): "q"}.get((kind, gives), "")


def read_names(source: Source, free: Mapping[str, float] | None = None) -> tuple[SceneNames, list[Fault]]:
    """Return the values of the parameters and the types of the nodes of a scene.

    Quantities depend on the parameters `free` of a design, by their reference values; default: on the unknown
    and considered ones of an identification. Faults are those of the parameters.
    """
    from dynid.scene.schema.quantities import SceneNames

    parameters = mapping(source.data, "parameters")
    raw = {str(name): entry for name, entry in parameters.items()}
    written = reference_values(parameters) | dict(free or {})
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
    faults = []
    for (name, *keys), text in located.items():
        path = ("parameters", written_key(parameters, name), *keys)
        faults.append(source.fault(path, value_with_unit(source, path) or text))
    # Parameters under a wrong key are reported as such.
    others = (str(key) for key, value in source.data.items() if isinstance(value, dict))
    misnamed = "parameters" not in source.data and any(did_you_mean(key, ["parameters"]) for key in others)
    names = SceneNames(
        values,
        dependent,
        signed=frozenset(
            name for name, definition in raw.items() if mapping_of(definition).get("scale") == "linear"
        ),
        linear=source.data.get("kind") == "identification",
        identifying=free is not None or source.data.get("kind") == "identification",
        faulty=frozenset(raw.keys() - values.keys()),
        nodes=_node_types(source.data),
        references=references(source.data),
        complete=isinstance(source.data.get("parameters", {}), dict) and not misnamed,
    )
    return names, faults


def value_with_unit(source: Source, path: Iterable[Any]) -> str:
    """Return what to write for a value such as `15 ms`; empty where its key has another unit."""
    value, units = source.data, []
    for key in path:
        if isinstance(value, dict):
            units += [str(unit) for name, unit in value.items() if re.fullmatch("(.*_)?unit", str(name))]
        value = value[key]
    split = split_value(value) if isinstance(value, str) else None
    if split is None or split[1] in mapping(source.data, "parameters"):  # a product of a parameter
        return ""
    number, unit, meaning = split
    frequency = any(unit_fits(unit, [candidate]) for candidate in ("Hz", "rad/s"))
    if unit in units:
        write = f"write {number:.12g}, its unit stands beside it"
    elif any(unit_fits(candidate, [unit]) for candidate in units) or (frequency and units):
        return ""
    elif unit_fits(unit, ["Hz"]):
        write = "a frequency is in rad/s, or in Hz where 'unit: Hz' stands beside it"
    else:
        in_si = si_unit(unit, meaning)
        write = f"write {number * meaning.factor:.12g}{f' ({in_si})' if in_si else ''}"
    return f"{value!r}: a value is a number in SI units, without its unit; {write}"


def _dependent(
    sought: Collection[str], written: Mapping[str, Any], values: Mapping[str, Number]
) -> dict[str, Dependent]:
    """Return the parameters that are sought or considered, and those that depend on them."""
    from dynid.arithmetic.dependent import Dependent, substituted

    dependents: dict[str, Dependent] = {}
    if not sought:
        return dependents
    for name, value in values.items():  # in an order in which each needs only earlier ones
        if name in sought:
            dependents[name] = Dependent.parameter(name, value)
        elif isinstance(written[name], str):
            expression = parse(written[name])
            if not expression.names.isdisjoint(dependents):
                operands = {used: dependents.get(used, values[used]) for used in expression.names}
                dependents[name] = substituted(expression, operands)
    return dependents


def _circular(
    raw: Mapping[str, Any], dependent: Mapping[str, Dependent]
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the numbers of unknown and considered parameters that depend on such themselves."""
    for name, entry in raw.items():
        keyed = mapping_of(entry).items()
        numbers: dict[tuple[str, ...], Any] = {(str(key),): number for key, number in keyed if key != "scale"}
        priors = mapping_of(mapping_of(entry).get("prior"))
        numbers |= {("prior", str(key)): number for key, number in priors.items()}
        for keys, text in numbers.items():
            try:
                used = sorted(parse(text).names & dependent.keys()) if isinstance(text, str) else []
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


#: Blocks that describe a frequency axis: where there is one, its unit is that of the scene.
_AXES = frozenset({"frequency", "lines", "frf"})


def unit_of_frequencies(data: Any) -> FrequencyUnit:
    """Return the unit of the frequency axes of a scene; without any, Hz where anything is given in Hz."""
    units = list(_units(data, ""))
    axes = [unit for block, unit in units if block in _AXES] or [unit for _, unit in units]
    return HERTZ if "Hz" in axes else RADIANS


def _units(data: Any, block: str) -> Iterator[tuple[str, str]]:
    """Yield the blocks that have a unit of frequencies, or are axes, with it."""
    if isinstance(data, dict):
        unit = data.get("unit")
        holds_axes = "simulate" in data or "file" in data  # or a file that says its unit itself
        if unit in ("Hz", "rad/s") or (block in _AXES and not holds_axes):
            yield block, unit or "rad/s"
        for key, value in data.items():
            yield from _units(value, str(key))
    elif isinstance(data, list):
        for item in data:
            yield from _units(item, block)
