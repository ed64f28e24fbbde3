"""Samples of a bond graph that differ in numbers, run together.

What they share is read, checked, planned and expanded once. A sample that differs in more (a value of zero,
a text where the others have numbers, coinciding roots, a fault) is run alone, and so is one with irrational
values, whose cancellations are decided exactly.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Irrational, Number, to_fraction
from dynid.bondgraph.sampling.analysis import SampledAnalysis, shared
from dynid.scene.batch import (
    NotShared,
    Overrides,
    SampleColumn,
    dependent_parameters,
    evaluate,
    numbers,
    run_alone,
    varied_parameter,
)
from dynid.scene.kinds.bond_graph import named_in, question
from dynid.scene.kinds.graph_parts import has_law
from dynid.scene.load import Scene
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.scene.schema.quantities import Quantity

if TYPE_CHECKING:
    from dynid.scene.schema.bond_graph import BondGraphScene

VariedQuantity = tuple[str, str]
"""What a path sets, `parameter`, `value` (of an element) or `stored` (energy), and its name."""


def _varied(scene: Scene[BondGraphScene], path: str) -> VariedQuantity:
    """Return the quantity that a path sets."""
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
    """Samples of one graph that differ in parameters, values of elements and stored energy.

    Parameters
    ----------
    scene
        The scene.
    paths
        The dotted paths of what varies.
    collect
        Paths, groups, or patterns of the arrays to compute.

    Raises
    ------
    NotShared
        If something else varies, or more is collected than what is computed together.
    """

    def __init__(self, scene: Scene[BondGraphScene], paths: Sequence[str], collect: tuple[str, ...]) -> None:
        model = scene.model
        if model.operating_point is not None or any(map(has_law, model.graph.nodes.values())):
            raise NotShared("every sample has an operating point of its own")
        self._varied = {path: _varied(scene, path) for path in paths}
        if model.design is not None:
            raise NotShared("every sample is designed by itself")
        graph, analysis = question(scene)
        if graph.field is not None:
            raise NotShared("values are irrational: their cancellations are decided for each sample")
        exemplar = run_alone(scene, {}, collect)
        if exemplar.error:
            raise NotShared("the scene as it stands cannot be run")
        self._paths = frozenset(exemplar.values)
        names = {name for kind, name in self._varied.values() if kind == "parameter"}
        self._expressions = dependent_parameters(scene.source.data.get("parameters") or {}, names)
        names |= self._expressions.keys()
        nodes = model.graph.nodes.values()
        constant = [model.analysis.frequency, model.analysis.time, model.control]
        constant += [block for node in nodes for block in (node.matrix, node.structure, node.joints)]
        if not shared(self._paths, analysis) or any(names & set(named_in(block)) for block in constant):
            raise NotShared("what is collected is more than numbers of the channels and responses")
        self._binary = analysis.reading == "binary"
        self._fixed = scene.names.parameters
        self._values = _slots({name: node.value for name, node in model.graph.nodes.items()}, names)
        self._stored = _slots({name: stored.f or stored.e for name, stored in model.initial.items()}, names)
        self._initial = dict(analysis.initial)
        varying = [*self._values, *(name for kind, name in self._varied.values() if kind == "value")]
        self._analysis = SampledAnalysis(
            graph.rounded() if self._binary else graph, analysis, dict.fromkeys(varying), self._paths
        )

    def run(self, overrides: Overrides) -> SampleOutcomes:
        """Return the outcomes of samples; those that differ in more than numbers are pending."""
        parameters, values, stored = self._quantities(overrides)
        columns = [*parameters.values(), *values.values(), *stored.values()]
        failed = {k for column in columns for k, value in enumerate(column) if value is None}
        sound = [k for k in range(len(overrides)) if k not in failed]
        exact = {name: [column[k] for k in sound] for name, column in values.items()}
        initial = [self._initial | {name: column[k] for name, column in stored.items()} for k in sound]
        outcomes: list[SampleOutcome | None] = [None] * len(overrides)
        for k, result in zip(sound, self._analysis.run(exact, len(sound), initial), strict=True):
            if result is not None and len(result) == len(self._paths):
                outcomes[k] = SampleOutcome(result)
        return SampleOutcomes.of(outcomes)

    def _quantities(self, overrides: Overrides) -> tuple[dict[str, list[Any]], ...]:
        """Return varied parameters, values of elements and stored energies (both exact), one a sample."""
        numbers_by_name: dict[str, Number | SampleColumn] = dict(self._fixed)
        parameters: dict[str, SampleColumn] = {}
        values: dict[str, list[Fraction | None]] = {}
        stored: dict[str, list[Fraction | None]] = {}
        for path, (kind, name) in self._varied.items():
            column = numbers([override[path] for override in overrides])
            match kind:
                case "parameter":
                    numbers_by_name[name] = parameters[name] = column
                case "value":
                    values[name] = _exact(column, binary=self._binary)
                case _:
                    stored[name] = _exact(column)
        for name, expression in self._expressions.items():
            numbers_by_name[name] = parameters[name] = evaluate(expression, numbers_by_name, len(overrides))
        for name, expression in self._values.items():
            if name not in values:
                values[name] = _exact(
                    evaluate(expression, numbers_by_name, len(overrides)), binary=self._binary
                )
        for name, expression in self._stored.items():
            if name not in stored:
                stored[name] = _exact(evaluate(expression, numbers_by_name, len(overrides)))
        return parameters, values, stored


def _slots(quantities: Mapping[str, Quantity | None], varied: Collection[str]) -> dict[str, Expression]:
    """Return the expressions that depend on varied parameters."""
    expressions = {name: quantity.expression for name, quantity in quantities.items() if quantity is not None}
    return {name: text for name, text in expressions.items() if text is not None and text.names & set(varied)}


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
