"""Variables of bond graphs in scenes: outputs at nodes, and at ports of fields and structures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import PlainValidator, ValidationInfo, WithJsonSchema

from dynid.scene.schema.quantities import AT_KEY, Located, fault, names_of
from dynid.scene.schema.raw import MULTIPORTS, PORT, ports_of
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.bondgraph.graph import Port
else:
    Port = Any  # a scene without a graph does not load its modules


def unknown_node(nodes: Mapping[str, str], name: str) -> str:
    """Return the message for a name that no node and no port has."""
    holder, _, port = name.rpartition(".")
    if nodes.get(holder) in MULTIPORTS:
        ports = ports_of(nodes, holder)
        close = did_you_mean(name, ports) or (f"; it has {', '.join(ports)}" if ports else "")
        return f"'{holder}' has no port '{port}'{close}"
    if holder in nodes:
        return f"'{holder}' has no named ports; write '{holder}'"
    return f"no node '{name}'{did_you_mean(name, nodes)}"


def stored_energy_faults(initial: Mapping[Any, Any], types: Mapping[str, str]) -> Iterator[Located]:
    """Yield the faults of the energy that a scene gives to nodes of its graph."""
    for name, energy in initial.items():
        kind, path = types.get(str(name)), ("initial", name)
        key, foreign, quantity = ("f", "e", "flow f") if kind == "I" else ("e", "f", "effort e")
        if kind is None:
            yield (*path, AT_KEY), f"no node '{name}'{did_you_mean(str(name), types)}"
        elif kind in (*MULTIPORTS, PORT):
            yield (*path, AT_KEY), f"stored energy is given to single I and C, not to a {kind}"
        elif kind not in ("I", "C"):
            yield (*path, AT_KEY), f"'{name}' is {kind} and stores no energy; only I and C do"
        elif getattr(energy, foreign) is not None or getattr(energy, key) is None:
            yield path, f"the energy of {kind} '{name}' is given by its {quantity}"


def _port(raw: Any, info: ValidationInfo) -> Port:
    from dynid.bondgraph.graph import LINE, NODE_TYPES, QUANTITIES, Port, port_fault

    nodes = names_of(info).variables
    name, dot, quantity = raw.rpartition(".") if isinstance(raw, str) else ("", "", "")
    if not dot:
        shown = f"'{raw}'" if isinstance(raw, str) else "something else"
        raise fault(f"an output is NODE.e, NODE.f, NODE.q or NODE.p, not {shown}")
    if nodes and name not in nodes:
        raise fault(f"'{raw}': {unknown_node(nodes, name)}")
    if nodes.get(name) in MULTIPORTS:
        ports = [f"{port}.f" for port in ports_of(nodes, name)]
        raise fault(f"'{raw}': '{name}' is a {nodes[name]}; name a port of it, such as {', '.join(ports)}")
    if quantity not in QUANTITIES:
        raise fault(f"'{raw}': '{quantity}' is not one of e, f, q, p")
    port = Port(name, quantity)
    problem = port_fault(nodes, port) if nodes.get(name) in (*NODE_TYPES, LINE) else ""
    if problem:
        raise fault(problem)
    return port


TEXT = WithJsonSchema({"type": "string"})

Output = Annotated[Port, PlainValidator(_port), TEXT]
"""An output of a graph: NODE.e, NODE.f, NODE.q or NODE.p."""


def _source_name(raw: Any, info: ValidationInfo) -> str:
    from dynid.bondgraph.graph import LINE, NODE_TYPES, SOURCES

    if isinstance(raw, bool) or not isinstance(raw, str | int):
        raise fault("an input is the name of a source")
    name, nodes = str(raw), names_of(info).variables
    sources = [node for node, kind in nodes.items() if kind in SOURCES]
    if nodes and name not in nodes:
        there = did_you_mean(name, sources) or f"; sources are: {shortened(sources) or 'none'}"
        raise fault(f"no node '{name}'{there}")
    if nodes and nodes[name] in (*NODE_TYPES, LINE, *MULTIPORTS, PORT) and nodes[name] not in SOURCES:
        raise fault(
            f"'{name}' is no source (Se, Sf); only sources can be inputs{did_you_mean(name, sources)}"
        )
    return name


SourceName = Annotated[str, PlainValidator(_source_name), TEXT]
"""The name of a source."""


def variable_or_source(name: str, info: ValidationInfo) -> None:
    """Raise the fault of a name that is neither a variable of the graph nor a source."""
    nodes = names_of(info).variables
    if name not in nodes and "." in name:
        _port(name, info)
    else:
        _source_name(name, info)
