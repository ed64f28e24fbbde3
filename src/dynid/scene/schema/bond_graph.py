"""Scenes of kind `bond-graph`."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from dynid.bondgraph.graph import NODE_TYPES, QUANTITIES, SOURCES, TWO_PORTS, VALUED, Bond, Port, port_fault
from dynid.bondgraph.request import NUMERIC, USUAL, Engine, FormulaForm, Reading, ResultName
from dynid.scene.schema.accuracy import AccuracyModel
from dynid.scene.schema.base import FrequencyGrid, SceneModel, Section
from dynid.scene.schema.quantities import Value, fault, names_of
from dynid.scene.schema.raw import chain_ends
from dynid.scene.schema.signals import TimeGrid
from dynid.suggestions import did_you_mean

#: Physical domains; `mechanical` is translation.
Domain = Literal["mechanical", "rotational", "electrical", "magnetic", "hydraulic", "acoustic", "thermal"]

_NAME = re.compile(r"[^\W\d][\w-]*|\d+")


def _node_type(raw: Any) -> str:
    text = str(raw) if isinstance(raw, int) and not isinstance(raw, bool) else raw
    if not isinstance(text, str):
        raise fault(f"a node type is one of {', '.join(NODE_TYPES)}")
    if text not in NODE_TYPES:
        close = did_you_mean(text, NODE_TYPES) or f"; it is one of {', '.join(NODE_TYPES)}"
        raise fault(f"unknown node type '{text}'{close}")
    return text


def _as_mapping(raw: Any) -> Any:
    return raw if isinstance(raw, dict) else {"type": raw}


def _node_name(raw: str) -> str:
    if not _NAME.fullmatch(raw):
        raise fault(f"'{raw}' cannot name a node; use letters, digits, _ and -, starting with a letter")
    return raw


_NodeType = Annotated[
    str,
    PlainValidator(_node_type),
    WithJsonSchema({"enum": [*NODE_TYPES, 0, 1], "description": "node type"}),
]


class NodeModel(Section):
    """One node: type, value, and physical domain, which determines units."""

    type: _NodeType
    value: Value | None = None
    domain: Domain | None = None

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> Self:
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


def _bonds(raw: Any, info: ValidationInfo) -> tuple[Bond, ...]:
    """Read a bond or a chain of bonds: a -> b -> c."""
    if not isinstance(raw, str):
        raise fault("a bond is a text such as 'a -> b'")
    ends = chain_ends(raw)
    if not ends:
        raise fault(f"'{raw}' is not a bond; write 'a -> b', or a chain 'a -> b -> c'")
    nodes = names_of(info).nodes
    unknown = [f"no node '{end}'{did_you_mean(end, nodes)}" for end in ends if nodes and end not in nodes]
    if unknown:
        raise fault(f"bond '{raw}': {'; '.join(unknown)}")
    return tuple(Bond(tail, head) for tail, head in pairwise(ends))


def _source_name(raw: Any, info: ValidationInfo) -> str:
    if isinstance(raw, bool) or not isinstance(raw, str | int):
        raise fault("an input is the name of a source")
    name, nodes = str(raw), names_of(info).nodes
    sources = [node for node, kind in nodes.items() if kind in SOURCES]
    if nodes and name not in nodes:
        raise fault(f"no node '{name}'{did_you_mean(name, sources)}")
    if nodes and nodes[name] in NODE_TYPES and nodes[name] not in SOURCES:
        raise fault(
            f"'{name}' is no source (Se, Sf); only sources can be inputs{did_you_mean(name, sources)}"
        )
    return name


def _port(raw: Any, info: ValidationInfo) -> Port:
    nodes = names_of(info).nodes
    name, dot, quantity = raw.rpartition(".") if isinstance(raw, str) else ("", "", "")
    if not dot:
        shown = f"'{raw}'" if isinstance(raw, str) else "something else"
        raise fault(f"an output is NODE.e, NODE.f, NODE.q or NODE.p, not {shown}")
    if nodes and name not in nodes:
        raise fault(f"'{raw}': no node '{name}'{did_you_mean(name, nodes)}")
    if quantity not in QUANTITIES:
        raise fault(f"'{raw}': '{quantity}' is not one of e, f, q, p")
    port = Port(name, quantity)
    problem = port_fault(nodes, port) if nodes.get(name) in NODE_TYPES else ""
    if problem:
        raise fault(problem)
    return port


def _link(raw: Any, info: ValidationInfo) -> Bond:
    """Read the bond of a port: a -> b, from the source to the load."""
    ends = chain_ends(raw) if isinstance(raw, str) else []
    if len(ends) != 2:
        raise fault("a port is one bond of the graph, written 'source side -> load side', such as 'a -> b'")
    nodes = names_of(info).nodes
    unknown = [f"no node '{end}'{did_you_mean(end, nodes)}" for end in ends if nodes and end not in nodes]
    if unknown:
        raise fault(f"port '{raw}': {'; '.join(unknown)}")
    return Bond(*ends)


def _listed_once(listed: list[Any]) -> list[Any]:
    names = [str(item) for item in listed]
    twice = [name for place, name in enumerate(names) if name in names[:place]]
    if twice:
        raise fault(f"'{twice[0]}' is listed twice")
    return listed


_TEXT = WithJsonSchema({"type": "string"})
_ONCE = AfterValidator(_listed_once)


class GraphModel(Section):
    """Nodes and bonds."""

    nodes: dict[
        Annotated[str, AfterValidator(_node_name)],
        Annotated[NodeModel, BeforeValidator(_as_mapping, json_schema_input_type=NodeModel | _NodeType)],
    ] = Field(min_length=1)
    bonds: list[Annotated[tuple[Bond, ...], PlainValidator(_bonds), _TEXT]] = Field(min_length=1)


class SymbolicModel(Section):
    """Formulas of the transfer function: nested, or also with expanded numerator and denominator."""

    form: FormulaForm = "nested"
    terms: int = Field(default=100_000, ge=1, le=10_000_000)


class AnalysisModel(Section):
    """Requested results and the engine that computes them."""

    inputs: Annotated[list[Annotated[str, PlainValidator(_source_name), _TEXT]], _ONCE] | None = None
    outputs: Annotated[list[Annotated[Port, PlainValidator(_port), _TEXT]], _ONCE] = Field(min_length=1)
    results: list[ResultName] | None = None
    port: Annotated[Bond, PlainValidator(_link), _TEXT] | None = None
    frequency: FrequencyGrid | None = None
    time: TimeGrid | None = None
    engine: Engine = "auto"
    reading: Reading = "decimal"
    symbolic: SymbolicModel | None = None

    @model_validator(mode="after")
    def _blocks_stand(self) -> Self:
        for name, block in (("frequency_response", self.frequency), ("time_response", self.time)):
            if name in (self.results or ()) and block is None:
                raise fault(f"'{name}' needs the block '{name.split('_')[0]}'")
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


class BondGraphScene(SceneModel):
    """A bond graph and its requested results."""

    kind: Literal["bond-graph"]
    accuracy: AccuracyModel | None = None
    graph: GraphModel
    analysis: AnalysisModel
    initial: dict[str, InitialModel] = {}
