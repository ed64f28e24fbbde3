"""Laws of nodes, moduli that depend on variables, and the operating point of a graph."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, PlainValidator, ValidationInfo, WithJsonSchema, model_validator

from dynid.arithmetic.expression import Expression, ExpressionError, parse
from dynid.bondgraph.graph import NODE_TYPES, QUANTITIES, SOURCES, TWO_PORTS, Port, port_fault
from dynid.scene.schema.base import Section
from dynid.scene.schema.graph_variables import unknown_node
from dynid.scene.schema.quantities import (
    AT_KEY,
    Located,
    Quantity,
    SceneNames,
    Value,
    fault,
    names_of,
    raise_faults,
    resolve,
)
from dynid.scene.schema.raw import PORT, law_variable
from dynid.suggestions import did_you_mean

#: Types of nodes whose `value` may depend on variables.
_MODULATED = (*TWO_PORTS, "R")
_LINEAR = "laws are for scenes of kind bond-graph; identify the linear graph at the operating point"
_GIVEN = {"R": ("e", "f"), "I": ("f",), "C": ("e",)}


class LawModel(Section):
    """The law of a one-port: R: e of f, or f of e; I: f of p; C: e of q; other variables as `x.q`."""

    e: str | None = None
    f: str | None = None

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.e is None) == (self.f is None):
            raise fault("a law gives the effort or the flow: {e: …} or {f: …}")
        return self


def _modulated(raw: Any, info: ValidationInfo) -> Quantity:
    """Resolve the value of a node, which may be an expression of variables of the graph."""
    kind, nodes = info.data.get("type"), names_of(info).nodes
    if isinstance(raw, str) and nodes and kind is not None:  # a type that is unknown is a fault of its own
        try:
            expression = parse(raw)
        except ExpressionError:
            return resolve(raw, info, exact=True)
        scene_names = names_of(info)
        unread = (expression.names - scene_names.parameters.keys()) if scene_names.complete else ()
        meant = any("." in name and name.rpartition(".")[2] in QUANTITIES for name in unread)
        if meant or variables_of(expression, nodes):
            if kind not in _MODULATED:
                remedy = "write a law" if kind in _GIVEN else "it has no value"
                raise fault(f"the value of {kind} cannot depend on variables; {remedy}")
            if scene_names.linear:
                raise_faults([((AT_KEY,), _LINEAR)])
            problems = [*_unknown(expression, scene_names, "")]
            if problems:
                raise fault("; ".join(problems))
            return Quantity(1, expression, variable=True)
    return resolve(raw, info, exact=True)


NodeValue = Annotated[
    Quantity,
    PlainValidator(_modulated),
    WithJsonSchema({"type": ["number", "string"], "description": "a number, a parameter or an expression"}),
]
"""The value of a node; a modulus or a resistance may depend on variables of the graph."""


def variables_of(expression: Expression, nodes: Mapping[str, str]) -> dict[str, Port]:
    """Return the names in an expression that are variables of nodes: a node before .e .f .q .p."""
    variables = {}
    for name in sorted(expression.names):
        holder, _, quantity = name.rpartition(".")
        if quantity in QUANTITIES and holder in nodes:
            variables[name] = Port(holder, quantity)
    return variables


def _unknown(expression: Expression, names: SceneNames, variable: str) -> Iterator[str]:
    """Yield what is wrong with the names in a law."""
    variables = variables_of(expression, names.nodes)
    for port in variables.values():
        problem = _variable_fault(names.nodes, port)
        if problem:
            yield problem
    parameters = [*names.parameters, *names.faulty]
    for name in sorted(expression.names - variables.keys() - {variable}):
        if name in parameters or not names.complete:
            continue
        holder, _, quantity = name.rpartition(".")
        if quantity in QUANTITIES and holder:
            yield f"'{name}': {unknown_node(names.nodes, holder)}"
        elif name in QUANTITIES and variable:
            yield f"'{name}' is not the variable of this law, which is {variable}; others are NODE.{name}"
        else:
            others = (f"{node}.{variable}" for node in names.nodes if variable)
            close = did_you_mean(name, [*parameters, *others])
            yield f"no parameter or variable '{name}'{close}"


def _variable_fault(nodes: Mapping[str, str], port: Port) -> str:
    """Return the reason why a law or an operating point cannot have a variable, or an empty text."""
    kind = nodes.get(port.node)
    if kind == PORT:
        return ""
    if kind not in NODE_TYPES:
        return f"'{port}': name a variable of a single node or port"
    return port_fault(nodes, port)


def law_faults(kind: str, law: LawModel, names: SceneNames) -> Iterator[Located]:
    """Yield the faults of the law of a node of some type: of its quantity, and of the names in it."""
    if names.linear:
        yield ("law", AT_KEY), _LINEAR
        return
    for key in sorted(key for key in law.model_fields_set if getattr(law, key) is not None):
        variable = law_variable(kind, key)
        try:
            if not variable:
                form = f"{{{_GIVEN[kind][0]}: …}} of {law_variable(kind, _GIVEN[kind][0])}"
                yield ("law", key, AT_KEY), f"the law of {kind} is {form}"
            elif problems := list(_unknown(parse(getattr(law, key)), names, variable)):
                yield ("law", key), "; ".join(problems)
        except ExpressionError as error:
            yield ("law", key), str(error)


# --- the operating point ---------------------------------------------------------------------------


class SearchModel(Section):
    """Random starts of the search for equilibria."""

    starts: int = Field(default=16, ge=0, le=100_000)
    seed: int = Field(default=0, ge=0)
    ranges: dict[str, Annotated[list[Value], Field(min_length=2, max_length=2)]] = {}


class OperatingPointModel(Section):
    """The point at which laws are linearised: an equilibrium at constant inputs, or given values."""

    inputs: dict[str, Value] = {}
    values: dict[str, Value] = {}
    start: dict[str, Value] = {}
    search: SearchModel = SearchModel()
    choose: Literal["nearest", "stable"] | Annotated[int, Field(ge=1, strict=True)] = "nearest"

    @model_validator(mode="after")
    def _is_given_or_solved(self) -> Self:
        if self.values and (self.start or "search" in self.model_fields_set or self.choose != "nearest"):
            raise fault(
                "a point given by 'values' is not solved for: it has no 'start', 'search' or 'choose'"
            )
        return self

    @model_validator(mode="after")
    def _names_exist(self, info: ValidationInfo) -> Self:
        raise_faults(self._faults(names_of(info).nodes))
        return self

    def _faults(self, types: Mapping[str, str]) -> Iterator[Located]:
        sources = [node for node, kind in types.items() if kind in SOURCES]
        for name in self.inputs:
            if types.get(name) not in SOURCES:
                problem = f"'{name}' is no source (Se, Sf)" if name in types else f"no node '{name}'"
                yield ("inputs", name, AT_KEY), f"{problem}{did_you_mean(name, sources)}"
        for path, names in (
            (("values",), self.values),
            (("start",), self.start),
            (("search", "ranges"), self.search.ranges),
        ):
            for name in names:
                if problem := _variable_problem(types, name):
                    yield (*path, name, AT_KEY), problem
        for name, (low, high) in self.search.ranges.items():
            if low.value > high.value:
                yield ("search", "ranges", name), f"the range of '{name}' starts above its end"


def _variable_problem(types: Mapping[str, str], name: str) -> str:
    holder, _, quantity = name.rpartition(".")
    if not holder or quantity not in QUANTITIES:
        variables = [f"{node}.{letter}" for node in types for letter in QUANTITIES]
        return f"'{name}' is no variable: NODE.e, NODE.f, NODE.q or NODE.p{did_you_mean(name, variables)}"
    if holder not in types:
        variables = [f"{node}.{quantity}" for node in types]
        return f"'{name}': no node '{holder}'{did_you_mean(name, variables)}"
    return _variable_fault(types, Port(holder, quantity))
