"""Samples of a bond graph that differ in numbers, run together.

What they share is read, checked, planned and expanded once. A sample that differs in more (a value of zero,
a text where the others have numbers, coinciding roots, a fault) is run alone, and so is one with irrational
values, whose cancellations are decided exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Irrational, to_fraction
from dynid.bondgraph.sampling.analysis import SampledAnalysis, shared
from dynid.scene.batch import (
    NotShared,
    Overrides,
    SampleColumn,
    VariedNumbers,
    evaluate,
    numbers,
    run_exemplar,
    varied_parameter,
)
from dynid.scene.kinds.bond_graph import named_in, question
from dynid.scene.kinds.graph_parts import has_law
from dynid.scene.load import Scene
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.scene.schema.bond_graph import BondGraphScene

_VariedQuantity = tuple[str, str]
"""What a path sets, `parameter`, `value` (of an element) or `stored` (energy), and its name."""


def _varied(scene: Scene[BondGraphScene], path: str) -> _VariedQuantity:
    model, parts = scene.model, path.split(".")
    if name := varied_parameter(model.parameters, parts):
        return ("parameter", name)
    match parts:
        case ["graph", "nodes", name, "value"] if name in model.graph.nodes and model.graph.nodes[name].value:
            return ("value", name)
        case ["initial", name, ("e" | "f") as part] if getattr(model.initial.get(name), part, None):
            return ("stored", name)
    raise NotShared(f"{path} is no parameter, no value of an element and no stored energy")


class GraphSamples:
    """Samples of one graph that differ in parameters, values of elements and stored energy."""

    def __init__(self, scene: Scene[BondGraphScene], paths: Sequence[str], collect: tuple[str, ...]) -> None:
        model = scene.model
        if model.operating_point is not None or any(map(has_law, model.graph.nodes.values())):
            raise NotShared("every sample has an operating point of its own")
        varied = {path: _varied(scene, path) for path in paths}
        if model.design is not None:
            raise NotShared("every sample is designed by itself")
        if model.control is not None and model.control.states is not None:
            raise NotShared("every sample has gains of its own")
        graph, analysis = question(scene)
        if graph.field is not None:
            raise NotShared("values are irrational: their cancellations are decided for each sample")
        self._paths = frozenset(run_exemplar(scene, collect))
        parameters = {path: name for path, (kind, name) in varied.items() if kind == "parameter"}
        self._numbers = VariedNumbers(scene.source, scene.names.parameters, parameters)
        names = {*parameters.values(), *self._numbers.dependent}
        nodes = model.graph.nodes.values()
        constant = [model.analysis.frequency, model.analysis.time, model.control]
        constant += [block for node in nodes for block in (node.matrix, node.structure, node.joints)]
        if not shared(self._paths, analysis) or any(names & set(named_in(block)) for block in constant):
            raise NotShared("what is collected is more than numbers of the channels and responses")
        self._binary = analysis.reading == "binary"
        quantities = {("value", name): node.value for name, node in model.graph.nodes.items()}
        quantities |= {("stored", name): stored.f or stored.e for name, stored in model.initial.items()}
        # Of each value and stored energy that varies, the path that sets it, or its expression.
        self._origins: dict[_VariedQuantity, str | Expression] = {
            place: quantity.expression
            for place, quantity in quantities.items()
            if quantity is not None and quantity.expression is not None and quantity.expression.names & names
        }
        self._origins |= {place: path for path, place in varied.items() if place[0] != "parameter"}
        self._initial = dict(analysis.initial)
        varying = dict.fromkeys(name for kind, name in self._origins if kind == "value")
        graph = graph.rounded() if self._binary else graph
        self._analysis = SampledAnalysis(graph, analysis, varying, self._paths)

    def run(self, overrides: Overrides) -> SampleOutcomes:
        """Return the outcomes of samples; those that differ in more than numbers are pending."""
        parameters = self._numbers.at(overrides)
        columns: dict[_VariedQuantity, list[Any]] = {}
        for (kind, name), origin in self._origins.items():
            if isinstance(origin, str):
                column = numbers([override[origin] for override in overrides])
            else:
                column = evaluate(origin, parameters, len(overrides))
            columns[kind, name] = _exact(column, binary=self._binary and kind == "value")
        varied: list[list[Any]] = [column for column in parameters.values() if isinstance(column, list)]
        failed = {
            k for column in (*varied, *columns.values()) for k, value in enumerate(column) if value is None
        }
        sound = [k for k in range(len(overrides)) if k not in failed]
        exact, stored = (
            {name: [column[k] for k in sound] for (kind, name), column in columns.items() if kind == place}
            for place in ("value", "stored")
        )
        initial = [self._initial | {name: stored[name][k] for name in stored} for k in range(len(sound))]
        outcomes: list[SampleOutcome | None] = [None] * len(overrides)
        for k, result in zip(sound, self._analysis.run(exact, len(sound), initial), strict=True):
            if result is not None and len(result) == len(self._paths):
                outcomes[k] = SampleOutcome(result)
        return SampleOutcomes.of(outcomes)


def _exact(column: SampleColumn, *, binary: bool = False) -> list[Fraction | None]:
    """Return values as fractions; None for those that are irrational, or zero or infinite as doubles."""
    exact: list[Fraction | None] = []
    for value in column:
        try:
            rounded = 0.0 if value is None else float(value)
        except OverflowError:
            exact.append(None)
            continue
        if value is None or rounded == 0 != value or (isinstance(value, Irrational) and not binary):
            exact.append(None)
        elif binary:
            exact.append(Fraction(rounded))
        else:
            exact.append(value if isinstance(value, Fraction) else to_fraction(value))
    return exact
