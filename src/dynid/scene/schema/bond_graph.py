"""Scenes of kind `bond-graph`: the model of their keys, and checks of several keys together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import pairwise, starmap
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PlainValidator,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from dynid.bondgraph.analysis_request import (
    MAX_TRANSMISSION_LINES,
    NUMERIC,
    USUAL,
    Engine,
    FormulaForm,
    Reading,
    ResultName,
    available_results,
)
from dynid.bondgraph.field_expansion import field_fault
from dynid.bondgraph.graph import (
    FIELDS,
    LINE,
    NODE_TYPES,
    ONE_PORTS,
    SOURCES,
    TWO_PORTS,
    VALUED,
    Bond,
    graph_faults,
)
from dynid.scene.schema.base import (
    ENGINE_RESULTS,
    AccuracyModel,
    ComposedScene,
    Dof,
    FrequencyGrid,
    ParameterEntry,
    Section,
    accuracy_faults,
    by_form,
    once,
    short_for,
)
from dynid.scene.schema.graph_variables import TEXT, Output, SourceName, stored_energy_faults, unknown_node
from dynid.scene.schema.laws import LawModel, NodeValue, OperatingPointModel, law_faults
from dynid.scene.schema.quantities import (
    AROUND,
    AT_KEY,
    Located,
    Quantity,
    SceneNames,
    Uncertain,
    UncertainPositive,
    Value,
    fault,
    names_of,
    raise_faults,
)
from dynid.scene.schema.raw import (
    COUPLING,
    FIELD,
    MAX_COPIES,
    MULTIPORTS,
    PORT,
    STRUCTURE,
    chain_ends,
    chain_fault,
    ports_of,
)
from dynid.scene.schema.references import Later, sections
from dynid.scene.schema.signals import SignalPart, TimeGrid, calibration_faults
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.scene.schema.control import ControlModel

#: Models of sections that few graphs have are loaded where a scene has them.
_SCHEMA = "dynid.scene.schema"
#: Physical domains; `mechanical` is translation.
Domain = Literal["mechanical", "rotational", "electrical", "magnetic", "hydraulic", "acoustic", "thermal"]

_NAME = re.compile(r"[^\W\d][\w-]*|\d+")
# The name of a node of an instance: those of the instances around it stand before.
_INNER = re.compile(r"([^\W\d]\w*\.(\d+\.)?)*([^\W\d][\w-]*|\d+)")
_TYPES = (*NODE_TYPES, LINE, STRUCTURE)


def _node_type(raw: Any) -> str:
    text = str(raw) if isinstance(raw, int) and not isinstance(raw, bool) else raw
    if not isinstance(text, str):
        raise fault(f"a node type is one of {', '.join(_TYPES)}")
    if text not in _TYPES:
        close = did_you_mean(text, _TYPES) or f"; it is one of {', '.join(_TYPES)}"
        raise fault(f"unknown node type '{text}'{close}")
    return text


def _node_name(raw: str) -> str:
    if not _INNER.fullmatch(raw):
        raise fault(f"'{raw}' cannot name a node; use letters, digits, _ and -, starting with a letter")
    return raw


_NodeType = Annotated[
    str, PlainValidator(_node_type), WithJsonSchema({"enum": [*_TYPES, 0, 1], "description": "node type"})
]


def _port_name(raw: str) -> str:
    if not _NAME.fullmatch(raw):
        raise fault(f"'{raw}' cannot name a port; use letters, digits, _ and -, starting with a letter")
    return raw


def _matrix(rows: list[list[Quantity]], info: ValidationInfo) -> list[list[Quantity]]:
    coupling = info.data.get("type") in TWO_PORTS
    for index, row in enumerate(rows):
        if len(row) != len(rows[0] if coupling else rows):
            if coupling:
                raise fault(f"row {index + 1} of the matrix has {len(row)} entries, row 1 has {len(rows[0])}")
            sizes = f"it has {len(rows)} rows, and row {index + 1} has {len(row)} entries"
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
_PortMatrix = Annotated[
    list[Annotated[list[Uncertain], Field(min_length=1, max_length=100)]],
    Field(min_length=1, max_length=100),
    AfterValidator(_matrix),
]


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
    impedance: UncertainPositive | None = None
    delay: UncertainPositive | None = None
    law: Annotated[LawModel, Later()] | None = None
    domain: Domain | None = None
    matrix: _PortMatrix | None = None
    structure: Annotated[Any, Later(f"{_SCHEMA}.structure:StructureModel")] | None = None
    reduction: Annotated[Any, Later(f"{_SCHEMA}.reduction:ReductionModel")] | None = None
    joints: dict[str, Annotated[Any, Later(f"{_SCHEMA}.joints:JointModel")]] = {}
    ports: (
        Annotated[
            Annotated[list[_PortName], Field(min_length=1), once("the port"), Tag("list")]
            | Annotated[dict[_PortName, Dof], Field(min_length=1), Tag("mapping")],
            by_form("list", "mapping"),
        ]
        | None
    ) = None

    @model_validator(mode="after")
    def _has_what_it_needs(self, info: ValidationInfo) -> Self:
        if self.type in (STRUCTURE, LINE):
            return self._is_a_structure() if self.type == STRUCTURE else self._is_a_line(names_of(info))
        if self.law is not None:
            if self.type in TWO_PORTS:
                raise fault(
                    f"a {self.type} has a modulus, and no law; write it as 'value', such as \"r*cos(arm.q)\""
                )
            if self.type not in FIELDS:
                raise fault(f"only R, I and C have a law, not {self.type}")
            others = ("value", "matrix", "ports", "structure", "joints")
            keys = [name for name in others if getattr(self, name)]
            if keys:
                raise fault(f"{self.type} has a 'law' or a '{keys[0]}', not both")
            raise_faults(law_faults(self.type, self.law, names_of(info)))
            return self
        self._has_no_other_keys()
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

    def _has_no_other_keys(self) -> None:
        for key, kind in (
            *((name, STRUCTURE) for name in ("structure", "reduction", "joints")),
            *((name, LINE) for name in ("impedance", "delay")),
        ):
            if getattr(self, key):
                raise fault(f"'{key}' belongs to a node of type {kind}, not {self.type}")

    def _is_a_line(self, names: SceneNames) -> Self:
        others = self.model_fields_set - {"type", "impedance", "delay", "domain"}
        if self.impedance is None or self.delay is None or others:
            raise fault(f"a line is written {{type: {LINE}, impedance: …, delay: …}}")
        if names.linear:
            raise fault("a graph with a line is not identified; write it as pieces of I and C")
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
        from dynid.scene.schema.joints import ParameterModel
        from dynid.scene.schema.reduction import structure_faults

        for name, joint in self.joints.items():
            if joint.points is not None:
                raise fault(f"joint '{name}' is between points, which a structure in a bond graph has not")
            if joint.laws:
                raise fault(
                    f"joint '{name}' has nonlinear laws, and a bond graph takes a structure as linear: leave "
                    "them out, or give its tangent as 'k' and 'c'"
                )
            values = [value for value in (joint.k, joint.c) if isinstance(value, ParameterModel)]
            if any(value.start is not None for value in values):
                raise fault(
                    f"joint '{name}' in a bond graph has values, no 'start'; name an unknown of 'parameters'"
                )
        dofs = [*self.ports.values()]
        twice = [dof for index, dof in enumerate(dofs) if dof in dofs[:index]]
        if twice:
            raise fault(f"two ports are at DOF {twice[0]}; bond several elements to one port instead")
        raise_faults(structure_faults(self, self.structure))
        return self


def _chain_problem(raw: Any, nodes: Mapping[str, str]) -> str:
    """Return the reason why an entry is no bond or chain of bonds between the nodes; else an empty text."""
    if not isinstance(raw, str):
        return "a bond is a text such as 'a -> b'"
    if problem := chain_fault(raw):
        return problem
    unknown = [problem for end in chain_ends(raw) if nodes and (problem := _end_fault(nodes, end))]
    return f"bond '{raw}': {'; '.join(unknown)}" if unknown else ""


def _chains(entries: list[Any], info: ValidationInfo) -> list[tuple[Bond, ...]]:
    nodes = names_of(info).nodes
    problems = {index: text for index, raw in enumerate(entries) if (text := _chain_problem(raw, nodes))}
    ends = [[] if index in problems else chain_ends(raw) for index, raw in enumerate(entries)]
    chains = [tuple(starmap(Bond, pairwise(chain))) for chain in ends]
    faults = [*(((index,), text) for index, text in problems.items())]
    raise_faults([*faults, *_bond_faults(nodes, chains, complete=not faults)])
    return chains


def _bond_faults(
    types: Mapping[str, str], chains: list[tuple[Bond, ...]], *, complete: bool
) -> Iterator[Located]:
    """Yield the faults of the numbers of bonds at nodes; a node that may only lack one needs all bonds."""
    indices = [index for index, chain in enumerate(chains) for _ in chain]
    bonds = [bond for chain in chains for bond in chain]
    ins, outs = (Counter(bond[end] for bond in bonds) for end in (1, 0))
    shaped = {name: kind for name, kind in types.items() if kind in (*NODE_TYPES, LINE)}
    for problem in graph_faults(shaped, bonds):
        if problem.bond is not None:
            yield (indices[problem.bond],), problem.message
        elif (node := problem.node) is not None:
            count, side = ins[node] + outs[node], max(ins[node], outs[node])
            crowded = count > 1 if types[node] in ONE_PORTS else side > 1
            if complete or crowded:
                yield (AROUND, "nodes", node, AT_KEY), problem.message
    for port in (name for name, kind in types.items() if kind == PORT):
        count, holder = ins[port] + outs[port], port.rpartition(".")[0]
        # Elements at a port of a structure share its velocity; at a port of a field they need a junction.
        if types.get(holder) in (FIELD, COUPLING) and (count > 1 or (count == 0 and complete)):
            message = f"port '{port}' has {count} bonds; put a junction between"
            message = message if count else f"port '{port}' has no bond; connect it or leave it out"
            yield (AROUND, "nodes", holder, "ports", AT_KEY), message


def _end_fault(nodes: Mapping[str, str], end: str) -> str:
    """Return the reason why a bond cannot end at a name, or an empty text."""
    kind = nodes.get(end)
    if kind in MULTIPORTS:
        ports = ports_of(nodes, end)
        return f"'{end}' is a {kind}; bonds attach at its ports{': ' if ports else ''}{', '.join(ports)}"
    return unknown_node(nodes, end) if kind is None else ""


def _link(raw: Any, info: ValidationInfo) -> Bond:
    ends = chain_ends(raw) if isinstance(raw, str) else []
    if len(ends) != 2:
        raise fault("a port is one bond of the graph, written 'source side -> load side', such as 'a -> b'")
    if problem := _chain_problem(raw, names_of(info).nodes):
        raise fault(problem)
    return Bond(*ends)


class InstanceModel(Section):
    """An instance of a model, or a chain of copies; all other keys are values of the model's parameters.

    It stands for the nodes and bonds of the model (`dynid.scene.composition`).
    """

    model_config = ConfigDict(extra="allow")

    model: str
    repeat: int | None = Field(default=None, ge=1, le=MAX_COPIES)
    chain: list[str] | None = Field(default=None, min_length=2, max_length=2)
    copies: dict[Annotated[str, Field(pattern="^[0-9]+$")], dict[str, ParameterEntry]] | None = None


_Node = Annotated[NodeModel, short_for("type", NodeModel | InstanceModel | _NodeType)]


_TEXTS = WithJsonSchema({"type": "array", "items": {"type": "string"}, "minItems": 1})


class GraphModel(Section):
    """Nodes and bonds."""

    nodes: dict[Annotated[str, AfterValidator(_node_name)], _Node] = Field(min_length=1)
    bonds: Annotated[list[Any], Field(min_length=1), AfterValidator(_chains), _TEXTS]

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> Self:
        types = names_of(info).nodes
        raise_faults([*self._coupling_faults(types), *self._domain_faults(types)])
        return self

    @property
    def single_bonds(self) -> list[tuple[int, Bond]]:
        """The bonds of all chains, each with the index of its entry."""
        return [(index, bond) for index, chain in enumerate(self.bonds) for bond in chain]

    @property
    def lines(self) -> int:
        """The number of its lines (TL)."""
        return sum(node.type == LINE for node in self.nodes.values())

    def _coupling_faults(self, types: Mapping[str, str]) -> Iterator[Located]:
        """Yield the bonds against the power through a multiport transformer or gyrator."""
        for name in (name for name, kind in types.items() if kind == COUPLING):
            rows = len(self.nodes[name].matrix or ())
            first, second = ports_of(types, name)[:rows], ports_of(types, name)[rows:]
            for index, bond in self.single_bonds:
                for port, against in ((bond.tail, bond.tail in first), (bond.head, bond.head in second)):
                    if against:
                        how = "into its rows" if port in first else "out of its columns"
                        message = f"power of '{name}' is positive {how}; turn the bond at '{port}'"
                        yield ("bonds", index), message

    def _domain_faults(self, types: Mapping[str, str]) -> Iterator[Located]:
        """Yield the pairs of nodes of two domains that have no TF or GY between them."""
        domains: dict[str, str] = {name: node.domain for name, node in self.nodes.items() if node.domain}
        domains |= {port: domains[name] for name in [*domains] for port in ports_of(types, name)}
        near: dict[str, list[str]] = {name: [] for name in types}
        for _, bond in self.single_bonds:
            if not {types[bond.tail], types[bond.head]} & TWO_PORTS:
                near[bond.tail].append(bond.head)
                near[bond.head].append(bond.tail)
        seen = set[str]()
        for first, domain in domains.items():
            reached = [] if first in seen else [first]
            seen.add(first)
            for name in reached:
                if domains.get(name, domain) != domain:
                    message = f"'{first}' is {domain} and '{name}' {domains[name]}"
                    holder = name if name in self.nodes else name.rpartition(".")[0]
                    yield ("nodes", holder, "domain"), f"{message}, but no TF or GY stands between them"
                following = [neighbour for neighbour in dict.fromkeys(near[name]) if neighbour not in seen]
                seen.update(following)
                reached += following


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
        raise_faults(self._formula_faults())
        return self

    def _formula_faults(self) -> Iterator[Located]:
        """Yield the results that formulas do not have, and formulas of no result."""
        for index, name in enumerate(self.results or () if self.engine == "symbolic" else ()):
            if name in NUMERIC:
                message = f"'{name}' needs numbers, and the symbolic engine has formulas alone"
                yield ("results", index), f"{message}; write 'engine: auto'"
        if self.symbolic is not None and self.results and "transfer_function" not in self.results:
            message = "formulas are of the transfer function; 'results' does not list 'transfer_function'"
            yield ("symbolic", AT_KEY), message

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
    design: Annotated[Any, Later(f"{_SCHEMA}.design:DesignModel")] | None = None

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> Self:
        names = names_of(info)
        raise_faults(
            [
                *stored_energy_faults(self.initial, names.nodes),
                *self._control_faults(),
                *self._port_faults(names.nodes),
                *self._energy_faults(),
                *self._driving_faults(),
                *accuracy_faults(self),
            ]
        )
        return self

    @property
    def sources(self) -> list[str]:
        """The sources of its graph and of its closed loops."""
        nodes = [name for name, node in self.graph.nodes.items() if node.type in SOURCES]
        return [*nodes, *(self.control.signals if self.control else ())]

    @property
    def aspects(self) -> set[str]:
        """The aspects in which it chooses between alternatives."""
        control: ControlModel | None = self.control
        if control is not None and (control.delays or control.sampled):
            return set()  # there is one way alone
        requested = {"engine"} if self.analysis.asked() & ENGINE_RESULTS else set()
        if self.analysis.time is not None and "time_response" in self.analysis.asked():
            signals = self.analysis.time.input
            if any(signal.kind != "impulse" for signal in signals) or not (signals or self.initial):
                requested.add("propagation")  # without signals and stored energy a unit step drives it
        return requested

    def _control_faults(self) -> Iterator[Located]:
        """Yield the faults of inputs, responses and designs of graphs with feedback, and of other designs."""
        control: ControlModel | None = self.control
        if self.design is not None:
            driven = control.driven if control else ()
            inputs = self.analysis.inputs or [name for name in self.sources if name not in driven]
            outputs = [str(port) for port in self.analysis.outputs]
            yield from self.design.faults(self.parameters, self.graph.nodes, outputs, inputs)
            yield from self.design.loop_faults(len(control.loops) if control else 0)
            if control is not None and control.states is not None:
                message = "gains of states are designed for a graph of fixed values; leave 'design' out, or "
                yield ("design", AT_KEY), message + "write them as 'loops', each with a gain"
        if self.graph.lines:
            yield from self._line_faults()
        if self._nonlinear or (control is not None and control.limited):
            yield from self._nonlinear_faults()
        if control is None:
            return
        yield from control.input_faults(self.analysis.inputs)
        if control.sampled:
            yield from self._sampling_faults()
        elif control.delays and self.analysis.port is not None and not self.graph.lines:
            from dynid.scene.schema.control import DELAY_REMEDY

            message = f"there is no 'port' where a loop has a delay; {DELAY_REMEDY}"
            yield ("analysis", "port", AT_KEY), message
        if control.delays and self.design is not None and not self.design.of_loops:
            message = "only margins (phase_margin, gain_margin, Ms, Mt) are designed with a delay in a loop; "
            message += "write it as {numerator: …, denominator: …}"
            yield from (((*path, AT_KEY), message) for path in control.delays)

    @property
    def _nonlinear(self) -> bool:
        """True if it has laws, or moduli that depend on variables."""
        return self.operating_point is not None or any(
            node.law is not None or (node.value is not None and node.value.variable)
            for node in self.graph.nodes.values()
        )

    def _nonlinear_faults(self) -> Iterator[Located]:
        """Yield the time response of nonlinear laws or limits where lines or samples act on them."""
        control: ControlModel | None = self.control
        if control is not None and control.sampled and self._nonlinear:
            where = "with sampled loops; leave it out, or write the controllers without 'sample'"
        elif self.graph.lines:
            where = "with a line (TL); leave it out, or write the line as pieces of I and C"
        else:
            return
        what = "nonlinear laws" if self._nonlinear else "controllers with 'limits'"
        message = f"the response of {what} is not computed {where}"
        if self.analysis.results is None and self.analysis.time is not None:
            yield ("analysis", "time", AT_KEY), message
        for index, name in enumerate(self.analysis.results or ()):
            if name == "time_response":
                yield ("analysis", "results", index), message

    def _line_faults(self) -> Iterator[Located]:
        """Yield what a graph with lines does not have."""
        lines = "with a line (TL); leave it out, or write the line as pieces of I and C"
        sampled = self.control is not None and self.control.sampled
        if sampled:
            lines = f"with sampled loops {lines}"
        available = available_results(sampled=sampled, lines=True)
        for index, name in enumerate(self.analysis.results or ()):
            if name not in available:
                yield ("analysis", "results", index), f"there is no '{name}' {lines}"
        if self.analysis.port is not None:
            yield ("analysis", "port", AT_KEY), f"there is no 'port' {lines}"
        if self.graph.lines > MAX_TRANSMISSION_LINES:
            message = f"at most {MAX_TRANSMISSION_LINES} lines (TL), not {self.graph.lines}"
            yield ("graph", "nodes", AT_KEY), message

    def _sampling_faults(self) -> Iterator[Located]:
        """Yield what a graph with sampled loops does not have."""
        control: ControlModel | None = self.control
        multirate = control is not None and control.multirate
        loops = "with sampled loops; leave it out, or write the controllers without 'sample'"
        if multirate:
            loops = "with several sample times; leave it out, or give the loops one 'sample'"
            if self.design is not None:
                yield ("design", AT_KEY), f"there is no design {loops}"
            if self.graph.lines:
                yield ("graph", "nodes", AT_KEY), f"there are no lines (TL) {loops}"
        available = available_results(sampled=True, lines=False, multirate=multirate)
        for index, name in enumerate(self.analysis.results or ()):
            if name not in available:
                yield ("analysis", "results", index), f"there is no '{name}' {loops}"
        if self.design is not None and not self.design.of_loops:
            message = "only margins (phase_margin, gain_margin, Ms, Mt) are designed with sampled loops"
            yield ("design", "targets", AT_KEY), message
        if self.analysis.port is not None and not self.graph.lines:
            yield ("analysis", "port", AT_KEY), f"there is no 'port' {loops}"

    def _port_faults(self, types: Mapping[str, str]) -> Iterator[Located]:
        """Yield the fault of the port at which the graph is cut."""
        port, bonds = self.analysis.port, [bond for _, bond in self.graph.single_bonds]
        if port is not None:
            from dynid.bondgraph.decomposition.graph_bisection import bond_fault, loop_fault

            problem = bond_fault(types, bonds, port)
            if not set(MULTIPORTS) & set(types.values()):  # else loops may pass through what a run expands
                problem = problem or loop_fault(types, bonds, port)
            if problem:
                yield ("analysis", "port"), problem

    def _energy_faults(self) -> Iterator[Located]:
        """Yield the fault of stored energy that no result shows."""
        results, showing = self.analysis.results, {"time_response", "transfer_function"}
        shows = self.analysis.port is not None or results is None or not showing.isdisjoint(results)
        if self.initial and not shows:
            message = "the initial state shows in a time response, a transfer function or at a port only; "
            message += "'results' lists neither 'time_response' nor 'transfer_function'"
            yield ("initial", AT_KEY), message

    def _driving_faults(self) -> Iterator[Located]:
        """Yield the faults of the signals of a time response, which drive inputs."""
        inputs = self.analysis.inputs or self.sources
        for path, signal in sections(self, SignalPart):
            if signal.source is not None and signal.source not in inputs:
                there = did_you_mean(signal.source, inputs) or f"; there are: {shortened(inputs) or 'none'}"
                yield (*path, "source"), f"'{signal.source}' is not an input{there}"
            yield from calibration_faults(path, signal)
            if signal.dof is not None:
                yield (*path, "dof", AT_KEY), "a bond graph has sources, not DOFs"
            for key in {"motion", "base"} & signal.model_fields_set:
                message = f"'{key}' belongs to structures; a flow source prescribes a motion"
                yield (*path, key, AT_KEY), message
