"""Scenes of kind `bond-graph`: the model of their keys, and checks of several keys together."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from dynid.bondgraph.decomposition.graph_bisection import bond_fault, loop_fault
from dynid.bondgraph.fields import field_fault
from dynid.bondgraph.graph import (
    FIELDS,
    NODE_TYPES,
    ONE_PORTS,
    SOURCES,
    TWO_PORTS,
    VALUED,
    Bond,
    graph_faults,
)
from dynid.bondgraph.request import NUMERIC, USUAL, Engine, FormulaForm, Reading, ResultName
from dynid.errors import Fault
from dynid.scene.model_faults import MAX_COPIES
from dynid.scene.schema.base import (
    AccuracyModel,
    ComposedScene,
    Dof,
    FrequencyGrid,
    ParameterEntry,
    Section,
    once,
)
from dynid.scene.schema.control import control_faults
from dynid.scene.schema.design import DesignModel, design_faults
from dynid.scene.schema.graph_variables import TEXT, Output, SourceName, unknown_node
from dynid.scene.schema.joints import JointModel, ParameterModel
from dynid.scene.schema.later import Later
from dynid.scene.schema.laws import (
    LawModel,
    NodeValue,
    OperatingPointModel,
    law_faults,
    operating_point_faults,
)
from dynid.scene.schema.quantities import Quantity, SceneNames, Uncertain, Value, fault, names_of
from dynid.scene.schema.raw import (
    COUPLING,
    FIELD,
    MULTIPORTS,
    PORT,
    STRUCTURE,
    chain_ends,
    chain_fault,
    listing,
    mapping,
    node_types,
    ports_of,
    references,
    written_key,
)
from dynid.scene.schema.reduction import ReductionModel, structure_faults
from dynid.scene.schema.references import Path, sections
from dynid.scene.schema.signals import SignalPart, TimeGrid
from dynid.scene.schema.structure import StructureModel
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean, shortened

#: Physical domains; `mechanical` is translation.
Domain = Literal["mechanical", "rotational", "electrical", "magnetic", "hydraulic", "acoustic", "thermal"]

_NAME = re.compile(r"[^\W\d][\w-]*|\d+")
# The name of a node of an instance: those of the instances around it stand before.
_INNER = re.compile(r"([^\W\d]\w*\.(\d+\.)?)*([^\W\d][\w-]*|\d+)")
_TYPES = (*NODE_TYPES, STRUCTURE)


def _node_type(raw: Any) -> str:
    text = str(raw) if isinstance(raw, int) and not isinstance(raw, bool) else raw
    if not isinstance(text, str):
        raise fault(f"a node type is one of {', '.join(_TYPES)}")
    if text not in _TYPES:
        close = did_you_mean(text, _TYPES) or f"; it is one of {', '.join(_TYPES)}"
        raise fault(f"unknown node type '{text}'{close}")
    return text


def _as_mapping(raw: Any) -> Any:
    return raw if isinstance(raw, dict) else {"type": raw}


def _node_name(raw: str) -> str:
    if not _INNER.fullmatch(raw):
        raise fault(f"'{raw}' cannot name a node; use letters, digits, _ and -, starting with a letter")
    return raw


_NodeType = Annotated[
    str,
    PlainValidator(_node_type),
    WithJsonSchema({"enum": [*_TYPES, 0, 1], "description": "node type"}),
]


def _port_name(raw: str) -> str:
    if not _NAME.fullmatch(raw):
        raise fault(f"'{raw}' cannot name a port; use letters, digits, _ and -, starting with a letter")
    return raw


def _matrix(rows: list[list[Quantity]], info: ValidationInfo) -> list[list[Quantity]]:
    coupling = info.data.get("type") in TWO_PORTS
    for place, row in enumerate(rows):
        if len(row) != len(rows[0] if coupling else rows):
            if coupling:
                raise fault(f"row {place + 1} of the matrix has {len(row)} entries, row 1 has {len(rows[0])}")
            sizes = f"it has {len(rows)} rows, and row {place + 1} has {len(row)} entries"
            raise fault(f"the matrix is not square: {sizes}")
    if coupling:
        return rows
    names = names_of(info)
    if names.complete and not names.faulty:  # else an entry may have no value
        problem = field_fault([[entry.exact for entry in row] for row in rows])
        if problem:
            raise fault(problem)
    return rows


_PortName = Annotated[str, AfterValidator(_port_name)]
PortMatrix = Annotated[
    list[Annotated[list[Uncertain], Field(min_length=1, max_length=100)]],
    Field(min_length=1, max_length=100),
    AfterValidator(_matrix),
]


def _ports_form(raw: Any) -> str:
    return "mapping" if isinstance(raw, dict) else "list"


class NodeModel(Section):
    """One node: type, value, and physical domain, which determines units.

    A field has the matrix of its ports in place of a value: I: e = M df/dt, C: f = M de/dt, R: e = M f. A
    multiport transformer or gyrator has one of moduli, with the ports of the rows and then those of the
    columns: TF: e1 = N e2, f2 = N^T f1; GY: e1 = N f2, e2 = N^T f1. R, I and C may have a law in place of
    a value; the value of an R, TF or GY may depend on variables of the graph. A structure has ports at
    degrees of freedom, where bonds carry force and velocity; without a reduction it enters by all of them.
    """

    type: _NodeType
    value: NodeValue | None = None
    law: Annotated[LawModel, Later()] | None = None
    domain: Domain | None = None
    matrix: PortMatrix | None = None
    structure: Annotated[StructureModel, Later()] | None = None
    reduction: ReductionModel | None = None
    joints: dict[str, Annotated[JointModel, Later()]] = {}
    ports: (
        Annotated[
            Annotated[list[_PortName], Field(min_length=1), once("the port"), Tag("list")]
            | Annotated[dict[_PortName, Dof], Field(min_length=1), Tag("mapping")],
            Discriminator(_ports_form),
        ]
        | None
    ) = None

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> Self:
        if self.type == STRUCTURE:
            return self._is_a_structure()
        if self.law is not None:
            if self.type in TWO_PORTS:
                raise fault(
                    f"a {self.type} has a modulus, and no law; write it as 'value', such as \"r*cos(arm.q)\""
                )
            if self.type not in FIELDS:
                raise fault(f"only R, I and C have a law, not {self.type}")
            given = [
                name for name in ("value", "matrix", "ports", "structure", "joints") if getattr(self, name)
            ]
            if given:
                raise fault(f"{self.type} has a 'law' or a '{given[0]}', not both")
            return self
        given = [name for name in ("structure", "reduction", "joints") if getattr(self, name)]
        if given:
            raise fault(f"'{given[0]}' belongs to a node of type structure, not {self.type}")
        if self.matrix is not None or self.ports is not None:
            return self._is_a_multiport()
        if self.type in VALUED and self.value is None:
            what = {"TF": "modulus n", "GY": "modulus r"}.get(self.type, "value")
            raise fault(f"{self.type} needs its {what}: write {{type: {self.type}, value: …}}")
        if self.type not in VALUED and self.value is not None:
            raise fault(f"{'a junction' if self.type in '01' else self.type} takes no value")
        if self.type in TWO_PORTS and self.value is not None and self.value.value == 0:
            raise fault(f"the modulus of a {self.type} cannot be zero")
        if self.type in TWO_PORTS and self.domain is not None:
            raise fault(f"a {self.type} joins two domains; give 'domain' to the nodes on its sides")
        return self

    def _is_a_multiport(self) -> Self:
        coupling = self.type in TWO_PORTS
        what = f"a multiport {self.type}" if coupling else "a field"
        if not coupling and self.type not in FIELDS:
            raise fault(f"only I, C, R, TF and GY have a matrix over ports, not {self.type}")
        if self.matrix is None or not isinstance(self.ports, list):
            raise fault(f"{what} is written {{type: {self.type}, matrix: [[…]], ports: [a, b]}}")
        if self.value is not None:
            raise fault(f"{what} has a 'matrix', and no 'value'")
        if coupling and self.domain is not None:
            raise fault(f"{what} joins domains; give 'domain' to the nodes on its sides")
        if len(self.ports) != len(self.matrix) + (len(self.matrix[0]) if coupling else 0):
            size = f"{len(self.matrix)} x {len(self.matrix[0])}"
            order = ": those of the rows, then those of the columns" if coupling else ""
            raise fault(f"the matrix is {size}, but 'ports' names {len(self.ports)}{order}")
        return self

    def _is_a_structure(self) -> Self:
        if self.structure is None or not isinstance(self.ports, dict):
            raise fault("a structure is written {type: structure, structure: {…}, ports: {tip: 6}}")
        if self.value is not None or self.matrix is not None:
            raise fault("a structure has no 'value' and no 'matrix'")
        for name, joint in self.joints.items():
            if joint.points is not None:
                raise fault(f"joint '{name}' is between points, which a structure in a bond graph has not")
            if any(
                isinstance(part, ParameterModel) and part.start is not None for part in (joint.k, joint.c)
            ):
                raise fault(
                    f"joint '{name}' in a bond graph has values, no 'start'; name an unknown of 'parameters'"
                )
        twice = [
            dof for place, dof in enumerate(self.ports.values()) if dof in [*self.ports.values()][:place]
        ]
        if twice:
            raise fault(f"two ports are at DOF {twice[0]}; bond several elements to one port instead")
        return self


def _bonds(raw: Any, info: ValidationInfo) -> tuple[Bond, ...]:
    """Read a bond or a chain of bonds: a -> b -> c."""
    if not isinstance(raw, str):
        raise fault("a bond is a text such as 'a -> b'")
    if problem := chain_fault(raw):
        raise fault(problem)
    ends = chain_ends(raw)
    nodes = names_of(info).nodes
    unknown = [problem for end in ends if nodes and (problem := _end_fault(nodes, end))]
    if unknown:
        raise fault(f"bond '{raw}': {'; '.join(unknown)}")
    return tuple(Bond(tail, head) for tail, head in pairwise(ends))


def _end_fault(nodes: Mapping[str, str], end: str) -> str:
    """Return the reason why a bond cannot end at a name, or an empty text."""
    kind = nodes.get(end)
    if kind in MULTIPORTS:
        ports = ports_of(nodes, end)
        return f"'{end}' is a {kind}; bonds attach at its ports{': ' if ports else ''}{', '.join(ports)}"
    return unknown_node(nodes, end) if kind is None else ""


def _link(raw: Any, info: ValidationInfo) -> Bond:
    """Read the bond of a port: a -> b, from the source to the load."""
    ends = chain_ends(raw) if isinstance(raw, str) else []
    if len(ends) != 2:
        raise fault("a port is one bond of the graph, written 'source side -> load side', such as 'a -> b'")
    return _bonds(raw, info)[0]


class InstanceModel(Section):
    """An instance of a model, or a chain of copies; all other keys are values of the model's parameters.

    It stands for the nodes and bonds of the model (`dynid.scene.composition`).
    """

    model_config = ConfigDict(extra="allow")

    model: str
    repeat: int | None = Field(default=None, ge=1, le=MAX_COPIES)
    chain: list[str] | None = Field(default=None, min_length=2, max_length=2)
    copies: dict[Annotated[str, Field(pattern="^[0-9]+$")], dict[str, ParameterEntry]] | None = None


_Node = Annotated[
    NodeModel, BeforeValidator(_as_mapping, json_schema_input_type=NodeModel | InstanceModel | _NodeType)
]


class GraphModel(Section):
    """Nodes and bonds."""

    nodes: dict[Annotated[str, AfterValidator(_node_name)], _Node] = Field(min_length=1)
    bonds: list[Annotated[tuple[Bond, ...], PlainValidator(_bonds), TEXT]] = Field(min_length=1)


class SubModel(Section):
    """A model: ports, parameters with their usual values, nodes and bonds."""

    title: str = ""
    source: str = ""
    ports: list[str] = []
    parameters: dict[str, ParameterEntry | None] = {}
    nodes: dict[str, _Node] = Field(min_length=1)
    bonds: list[str] = []


class SymbolicModel(Section):
    """Formulas of the transfer function: nested, or also with expanded numerator and denominator."""

    form: FormulaForm = "nested"
    terms: int = Field(default=100_000, ge=1, le=10_000_000)


class AnalysisModel(Section):
    """Requested results and the engine that computes them."""

    inputs: Annotated[list[SourceName], once()] | None = None
    outputs: Annotated[list[Output], once()] = Field(min_length=1)
    results: list[ResultName] | None = None
    port: Annotated[Bond, PlainValidator(_link), TEXT] | None = None
    frequency: FrequencyGrid | None = None
    time: Annotated[TimeGrid, Later()] | None = None
    engine: Engine = "auto"
    reading: Reading = "decimal"
    symbolic: SymbolicModel | None = None

    @model_validator(mode="after")
    def _blocks_stand(self) -> Self:
        for name, block, key in (
            ("frequency_response", self.frequency, "frequency"),
            ("source_performance", self.frequency, "frequency"),
            ("time_response", self.time, "time"),
        ):
            if name in (self.results or ()) and block is None:
                raise fault(f"'{name}' needs the block '{key}'")
        return self

    def asked(self) -> frozenset[ResultName]:
        """Return the results to compute."""
        if self.results is not None:
            return frozenset(self.results)
        responses: set[ResultName] = {"frequency_response"} if self.frequency else set()
        usual = USUAL - NUMERIC if self.engine == "symbolic" else USUAL
        return usual | responses | ({"time_response"} if self.time else set())


class InitialModel(Section):
    """Energy stored at t = 0: the flow of an I, the effort of a C."""

    f: Value | None = None
    e: Value | None = None


class BondGraphScene(ComposedScene):
    """A bond graph and its requested results."""

    kind: Literal["bond-graph"]
    accuracy: Annotated[AccuracyModel, Later()] | None = None
    graph: GraphModel
    analysis: AnalysisModel
    operating_point: Annotated[OperatingPointModel, Later()] | None = None
    initial: dict[str, InitialModel] = {}
    design: Annotated[DesignModel, Later()] | None = None


def bond_graph_faults(source: Source, names: SceneNames) -> list[Fault]:
    """Return the faults of bonds, stored energy, signals, port, engine and domains of a bond graph."""
    faults = [*graph_scene_faults(source, names), *_unshown_energy_faults(source), *_driving_faults(source)]
    faults += operating_point_faults(source)
    faults += design_faults(source)
    analysis = mapping(source.data, "analysis")
    results = listing(analysis, "results")
    for place, name in enumerate(results if analysis.get("engine") == "symbolic" else []):
        if isinstance(name, str) and name in NUMERIC:
            message = f"'{name}' needs numbers, and the symbolic engine has formulas alone"
            faults.append(source.fault(("analysis", "results", place), f"{message}; write 'engine: auto'"))
    asks_for_it = any(did_you_mean(str(name), ["transfer_function"]) for name in results)
    if analysis.get("symbolic") is not None and results and not asks_for_it:
        message = "formulas are of the transfer function; 'results' does not list 'transfer_function'"
        faults.append(source.fault(("analysis", "symbolic"), message, key=True))
    return faults


def graph_scene_faults(source: Source, names: SceneNames) -> list[Fault]:
    """Return the faults of the bonds, domains and stored energy of a graph in a scene of any kind."""
    own = [
        *_bond_faults(source),
        *stored_energy_faults(source),
        *domain_faults(source),
        *control_faults(source),
        *law_faults(source, names),
    ]
    return [*own, *structure_node_faults(source, names)]


def structure_node_faults(source: Source, names: SceneNames) -> list[Fault]:
    """Return the faults of nodes and DOFs in the structures of a graph."""
    faults = []
    for name, node in mapping(mapping(source.data, "graph"), "nodes").items():
        if isinstance(node, dict) and node.get("type") == STRUCTURE:
            faults += structure_faults(source, NodeModel, names, ("graph", "nodes", name))
    return faults


def _bond_faults(source: Source) -> list[Fault]:
    """Return the faults of the numbers of bonds at the nodes, and of the port at which the graph is cut.

    A bond that cannot be read is reported at its own place. A node that may only lack that bond is not
    reported as well; one that has too many already is.
    """
    nodes = mapping(mapping(source.data, "graph"), "nodes")
    types = node_types(source.data)
    bonds, places, complete = _readable_bonds(source, types)
    faults = []
    for found in graph_faults({name: kind for name, kind in types.items() if kind in NODE_TYPES}, bonds):
        if found.bond is not None:
            faults.append(source.fault(("graph", "bonds", places[found.bond]), found.message))
        elif found.node is not None and bonds:
            ins, outs = (sum(found.node == bond[end] for bond in bonds) for end in (1, 0))
            crowded = ins + outs > 1 if types[found.node] in ONE_PORTS else max(ins, outs) > 1
            if complete or crowded:
                path = ("graph", "nodes", written_key(nodes, found.node))
                faults.append(source.fault(path, found.message, key=True))
    for port in (name for name, kind in types.items() if kind == PORT):
        count, holder = sum(port in bond for bond in bonds), port.rpartition(".")[0]
        # Elements at one port of a structure have its velocity; at one port of a field they need a junction.
        # A port's name that has a dot, which is reported at its own place, has no such holder.
        if types.get(holder) in (FIELD, COUPLING) and (count > 1 or (count == 0 and complete and bonds)):
            message = f"port '{port}' has {count} bonds; put a junction between"
            message = message if count else f"port '{port}' has no bond; connect it or leave it out"
            faults.append(
                source.fault(("graph", "nodes", written_key(nodes, holder), "ports"), message, key=True)
            )
    faults += _coupling_faults(source, types, bonds, places)
    text = mapping(source.data, "analysis").get("port")
    ends = chain_ends(text) if isinstance(text, str) else []
    # A port with other faults is reported by its own key, or by the faults of the bonds.
    if len(ends) == 2 and all(end in types for end in ends) and complete:
        problem = bond_fault(types, bonds, Bond(*ends))
        if not set(MULTIPORTS) & set(types.values()):  # else loops may pass through what is expanded in a run
            problem = problem or loop_fault(types, bonds, Bond(*ends))
        faults += [source.fault(("analysis", "port"), problem)] if problem else []
    return faults


def _coupling_faults(
    source: Source, types: Mapping[str, str], bonds: list[Bond], places: list[int]
) -> list[Fault]:
    """Return the bonds against the power through a multiport transformer or gyrator, as faults."""
    faults, nodes = [], mapping(mapping(source.data, "graph"), "nodes")
    for name in (name for name, kind in types.items() if kind == COUPLING):
        rows = len(listing(nodes[written_key(nodes, name)], "matrix"))
        first, second = ports_of(types, name)[:rows], ports_of(types, name)[rows:]
        for number, bond in enumerate(bonds):
            for port, wrong in ((bond.tail, bond.tail in first), (bond.head, bond.head in second)):
                if wrong:
                    how = "into its rows" if port in first else "out of its columns"
                    message = f"power of '{name}' is positive {how}; turn the bond at '{port}'"
                    faults.append(source.fault(("graph", "bonds", places[number]), message))
    return faults


def _readable_bonds(source: Source, types: Mapping[str, str]) -> tuple[list[Bond], list[int], bool]:
    """Return the bonds that can be read, the entry of each in the scene, and True if they are all."""
    bonds, places, complete = [], [], True
    for index, text in enumerate(listing(mapping(source.data, "graph"), "bonds")):
        ends = chain_ends(text) if isinstance(text, str) else []
        read = bool(ends) and all(end in types for end in ends)
        complete = complete and read and all(a != b for a, b in pairwise(ends))
        if read:
            bonds += [Bond(tail, head) for tail, head in pairwise(ends)]
            places += [index] * (len(ends) - 1)
    return bonds, places, complete


def domain_faults(source: Source) -> list[Fault]:
    """Return the pairs of nodes of two domains that have no TF or GY between them, as faults."""
    nodes = mapping(mapping(source.data, "graph"), "nodes")
    types = node_types(source.data)
    given = {
        str(name): node["domain"]
        for name, node in nodes.items()
        if isinstance(node, dict) and isinstance(node.get("domain"), str)
    }
    given |= {port: given[name] for name in [*given] for port in ports_of(types, name)}
    near: dict[str, list[str]] = {name: [] for name in types}
    for bond in _readable_bonds(source, types)[0]:
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
                holder = name if name in types and types[name] != PORT else name.rpartition(".")[0]
                faults.append(source.fault(("graph", "nodes", written_key(nodes, holder), "domain"), message))
            following = [other for other in dict.fromkeys(near[name]) if other not in seen]
            seen.update(following)
            reached += following
    return faults


def stored_energy_faults(source: Source) -> list[Fault]:
    """Return the faults of stored energy: its nodes and its variables."""
    initial = mapping(source.data, "initial")
    types, faults = node_types(source.data), []
    for name, given in initial.items():
        kind, path = types.get(str(name)), ("initial", name)
        if kind is None and types:
            faults.append(source.fault(path, f"no node '{name}'{did_you_mean(str(name), types)}", key=True))
        elif kind in (*MULTIPORTS, PORT):
            message = f"stored energy is given to single I and C, not to a {kind}"
            faults.append(source.fault(path, message, key=True))
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


def _unshown_energy_faults(source: Source) -> list[Fault]:
    """Return the fault of stored energy that no result shows."""
    analysis, faults = source.data.get("analysis", {}), list[Fault]()
    if not mapping(source.data, "initial") or not isinstance(analysis, dict) or "port" in analysis:
        return faults
    results, showing = analysis.get("results"), ("time_response", "transfer_function")
    if isinstance(results, list) and not any(did_you_mean(str(name), showing) for name in results):
        message = "the initial state shows in a time response, a transfer function or at a port only; "
        message += "'results' lists neither 'time_response' nor 'transfer_function'"
        faults.append(source.fault(("initial",), message, key=True))
    return faults


def calibration_faults(source: Source, path: Path, signal: dict[Any, Any]) -> list[Fault]:
    """Return the faults of a signal of a response with a gain or delay, which belong to records."""
    message = "'{}' belongs to the excitation of a record; a response is that to the signal itself"
    given = [key for key in ("gain", "delay") if key in signal]
    return [source.fault((*path, key), message.format(key), key=True) for key in given]


def _driving_faults(source: Source) -> list[Fault]:
    """Return the faults of the signals of a time response, which drive inputs."""
    inputs = [str(name) for name in listing(mapping(source.data, "analysis"), "inputs")]
    sources = node_types(source.data) | references(source.data)
    inputs = inputs or [name for name, kind in sources.items() if kind in SOURCES]
    faults = []
    for path, signal in sections(BondGraphScene, source.data, SignalPart):
        name = signal.get("source")
        if isinstance(name, str) and name not in inputs:
            there = did_you_mean(name, inputs) or f"; there are: {shortened(inputs) or 'none'}"
            faults.append(source.fault((*path, "source"), f"'{name}' is not an input{there}"))
        faults += calibration_faults(source, path, signal)
        if "dof" in signal:
            faults.append(source.fault((*path, "dof"), "a bond graph has sources, not DOFs", key=True))
        for key in ("motion", "base"):
            if key in signal:
                message = f"'{key}' belongs to structures; a flow source prescribes a motion"
                faults.append(source.fault((*path, key), message, key=True))
    return faults
