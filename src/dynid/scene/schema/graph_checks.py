"""Faults of a bond graph that concern several keys at once."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from dynid.bondgraph.decomposition.graph_bisection import bond_fault, loop_fault
from dynid.bondgraph.graph import NODE_TYPES, ONE_PORTS, TWO_PORTS, Bond, graph_faults
from dynid.bondgraph.request import NUMERIC
from dynid.errors import Fault
from dynid.scene.schema.quantities import SceneNames
from dynid.scene.schema.raw import chain_ends, listing, mapping, node_types, signals, written_key
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean


def bond_graph_faults(source: Source, names: SceneNames) -> list[Fault]:  # noqa: ARG001
    """Check bonds, stored energy, signals, port, engine and domains of a bond graph."""
    faults = [*_bond_faults(source), *_initial_faults(source), *_driving_faults(source)]
    return [
        *faults,
        *_port_faults(source),
        *_engine_faults(source),
        *domain_faults(source),
        *_unseen_energy_faults(source),
    ]


def _bond_faults(source: Source) -> list[Fault]:
    """Check the number of bonds at every node.

    A bond that cannot be read is reported where it stands. A node that may only lack that bond is not
    reported as well; one that has too many already is.
    """
    nodes = mapping(mapping(source.data, "graph"), "nodes")
    types = node_types(source.data)
    bonds, places, complete = _bonds(source, types)
    faults = []
    for fault in graph_faults({name: kind for name, kind in types.items() if kind in NODE_TYPES}, bonds):
        if fault.bond is not None:
            faults.append(source.fault(("graph", "bonds", places[fault.bond]), fault.message))
        elif fault.node is not None and bonds and (complete or _is_crowded(fault.node, types, bonds)):
            faults.append(
                source.fault(("graph", "nodes", written_key(nodes, fault.node)), fault.message, key=True)
            )
    return faults


def _bonds(source: Source, types: Mapping[str, str]) -> tuple[list[Bond], list[int], bool]:
    """Return the bonds that can be read, the entry that each stands in, and whether they are all."""
    bonds, places, complete = [], [], True
    for index, text in enumerate(listing(mapping(source.data, "graph"), "bonds")):
        ends = chain_ends(text) if isinstance(text, str) else []
        read = bool(ends) and all(end in types for end in ends)
        complete = complete and read and all(a != b for a, b in pairwise(ends))
        if read:
            bonds += [Bond(tail, head) for tail, head in pairwise(ends)]
            places += [index] * (len(ends) - 1)
    return bonds, places, complete


def _port_faults(source: Source) -> list[Fault]:
    """Check that the port is a bond of the graph, and that the graph can be cut there."""
    text, types = mapping(source.data, "analysis").get("port"), node_types(source.data)
    ends = chain_ends(text) if isinstance(text, str) else []
    bonds, _, complete = _bonds(source, types)
    if len(ends) != 2 or not all(end in types for end in ends) or not complete:
        return []  # reported where it stands, or by what is wrong with the bonds
    problem = bond_fault(types, bonds, Bond(*ends)) or loop_fault(types, bonds, Bond(*ends))
    return [source.fault(("analysis", "port"), problem)] if problem else []


def domain_faults(source: Source) -> list[Fault]:
    """Check that nodes of two domains have a TF or GY between them."""
    nodes = mapping(mapping(source.data, "graph"), "nodes")
    types = node_types(source.data)
    given = {str(name): node["domain"] for name, node in nodes.items() if _has_domain(node)}
    near: dict[str, list[str]] = {name: [] for name in types}
    for bond in _bonds(source, types)[0]:
        if not {types[bond.tail], types[bond.head]} & TWO_PORTS:
            near[bond.tail].append(bond.head)
            near[bond.head].append(bond.tail)
    faults, seen = [], set[str]()
    for first, domain in given.items():
        reached = [] if first in seen else [first]
        seen.add(first)
        for name in reached:
            if given.get(name, domain) != domain:
                message = (
                    f"'{first}' is {domain} and '{name}' {given[name]}, but no TF or GY stands between them"
                )
                faults.append(source.fault(("graph", "nodes", written_key(nodes, name), "domain"), message))
            following = [other for other in dict.fromkeys(near[name]) if other not in seen]
            seen.update(following)
            reached += following
    return faults


def _has_domain(node: Any) -> bool:
    return isinstance(node, dict) and isinstance(node.get("domain"), str)


def _is_crowded(name: str, types: Mapping[str, str], bonds: list[Bond]) -> bool:
    """Tell whether a node has more bonds than ports, whatever bonds may be missing."""
    ins, outs = sum(bond.head == name for bond in bonds), sum(bond.tail == name for bond in bonds)
    return ins + outs > 1 if types[name] in ONE_PORTS else max(ins, outs) > 1


def _initial_faults(source: Source) -> list[Fault]:
    """Check that stored energy is given to storages, in their own variable."""
    types, faults = node_types(source.data), []
    for name, given in mapping(source.data, "initial").items():
        kind, path = types.get(str(name)), ("initial", name)
        if kind is None and types:
            faults.append(source.fault(path, f"no node '{name}'{did_you_mean(str(name), types)}", key=True))
        elif kind not in NODE_TYPES:
            continue  # reported where the node stands
        elif kind not in ("I", "C"):
            faults.append(
                source.fault(path, f"'{name}' is {kind} and stores no energy; only I and C do", key=True)
            )
        elif isinstance(given, dict):
            own, other = ("f", "e") if kind == "I" else ("e", "f")
            if other in given or given.get(own) is None:
                message = (
                    f"the energy of {kind} '{name}' is given by its {'flow f' if own == 'f' else 'effort e'}"
                )
                faults.append(source.fault(path, message))
    return faults


def _driving_faults(source: Source) -> list[Fault]:
    """Check that the signals of a time response drive inputs."""
    types, analysis = node_types(source.data), mapping(source.data, "analysis")
    given = mapping(analysis, "time").get("input")
    inputs = [str(name) for name in listing(analysis, "inputs")]
    inputs = inputs or [name for name, kind in types.items() if kind in ("Se", "Sf")]
    faults = []
    for path, signal in signals(("analysis", "time", "input"), given):
        name = signal.get("source")
        if isinstance(name, str) and name not in inputs:
            faults.append(
                source.fault((*path, "source"), f"'{name}' is not an input{did_you_mean(name, inputs)}")
            )
        if "dof" in signal:
            faults.append(source.fault((*path, "dof"), "a bond graph has sources, not DOFs", key=True))
        for key in ("motion", "base"):
            if key in signal:
                message = f"'{key}' belongs to structures; a flow source prescribes a motion"
                faults.append(source.fault((*path, key), message, key=True))
    return faults


def _engine_faults(source: Source) -> list[Fault]:
    """Check that the engine has what is asked for, and that formulas have a transfer function to be of."""
    analysis = mapping(source.data, "analysis")
    results = listing(analysis, "results")
    faults = []
    if analysis.get("engine") == "symbolic":
        faults = [
            source.fault(
                ("analysis", "results", place),
                f"'{name}' needs numbers, and the symbolic engine has formulas alone; write 'engine: auto'",
            )
            for place, name in enumerate(results)
            if isinstance(name, str) and name in NUMERIC
        ]
    asks_for_it = any(did_you_mean(str(name), ["transfer_function"]) for name in results)
    if analysis.get("symbolic") is not None and results and not asks_for_it:
        message = "formulas are of the transfer function; 'results' does not list 'transfer_function'"
        faults.append(source.fault(("analysis", "symbolic"), message, key=True))
    return faults


def _unseen_energy_faults(source: Source) -> list[Fault]:
    """Check that stored energy shows: in a response, beside the transfer functions, or at a port."""
    analysis = source.data.get("analysis", {})
    if not mapping(source.data, "initial") or not isinstance(analysis, dict):
        return []
    results, showing = analysis.get("results"), ("time_response", "transfer_function")
    listed = not isinstance(results, list) or any(did_you_mean(str(name), showing) for name in results)
    if listed or "port" in analysis:
        return []
    message = "the initial state shows in a time response, a transfer function or at a port only; "
    message += "'results' lists neither 'time_response' nor 'transfer_function'"
    return [source.fault(("initial",), message, key=True)]
