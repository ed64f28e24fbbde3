"""Samples of a bond graph that differ in numbers, run together.

What they share is read, checked, planned and expanded once. A sample that differs in more (a value of zero,
a text where the others have numbers, coinciding roots, a fault) is run alone, and so is one with irrational
values, whose cancellations are decided exactly.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Irrational, Number, to_fraction
from dynid.bondgraph.sampling.analysis import SampledAnalysis, shared
from dynid.errors import DynidError
from dynid.result import Variable
from dynid.scene.batch import (
    BatchKey,
    NotShared,
    SampleColumn,
    dependent_parameters,
    evaluate,
    numbers,
    varied_parameter,
)
from dynid.scene.kinds.bond_graph import named_in, question
from dynid.scene.kinds.graph_parts import has_law
from dynid.scene.load import Scene
from dynid.scene.outcomes import SampleOutcome, gather
from dynid.scene.run import run_scene
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.raw import read_names

if TYPE_CHECKING:
    from dynid.scene.schema.bond_graph import BondGraphScene

Overrides = Sequence[Mapping[str, Any]]
Path = tuple[str, ...]


def batched(
    template: Scene,
    overrides: Overrides,
    collect: tuple[str, ...],
) -> list[SampleOutcome | None] | None:
    """Run samples together where they differ in parameters, values of elements and stored energy alone.

    Returns
    -------
    list of SampleOutcome or None, or None
        One a sample, None for one that is to be run alone; None where the samples share too little:
        something else varies, or what is collected is not one of the numbers that are computed together.
    """
    paths = tuple(overrides[0]) if overrides else ()
    if not paths or any(tuple(one) != paths for one in overrides):
        return None
    plan = _planned(BatchKey.of(template, paths, collect))
    if plan is None:
        return None
    return [None if result is None else SampleOutcome(result) for result in plan.run(overrides)]


def why_alone(template: Scene, paths: Sequence[str], collect: tuple[str, ...]) -> str:
    """Return why samples that differ at these paths are not run together; empty where they are."""
    if _has_operating_point(template):
        return "every sample has an operating point of its own"
    for path in paths:
        if _place(template, path) is None:
            return f"{path} is no parameter, no value of an element and no stored energy"
    if cast("BondGraphScene", template.model).design is not None:
        return "every sample is designed by itself"
    if _planned(BatchKey.of(template, paths, collect)):
        return ""
    if question(template)[0].field is not None:
        return "values are irrational: their cancellations are decided for each sample"
    return "what is collected is more than numbers of the channels and responses"


@lru_cache(maxsize=4)
def _planned(family: BatchKey) -> _GraphBatch | None:
    """Return the plan of a batch, made once a process; None where it cannot be run together."""
    places = [_place(family.scene, path) for path in family.paths]
    if None in places or cast("BondGraphScene", family.scene.model).design is not None:
        return None
    if _has_operating_point(family.scene):
        return None
    try:
        exemplar = run_scene(family.scene)
        wanted = tuple(gather(exemplar, family.collect))
        return _GraphBatch(
            family.scene, dict(zip(family.paths, cast("list[Path]", places), strict=True)), wanted
        )
    except (NotShared, DynidError, ArithmeticError):
        return None


def _has_operating_point(scene: Scene) -> bool:
    model = cast("BondGraphScene", scene.model)
    return model.operating_point is not None or any(map(has_law, model.graph.nodes.values()))


def _place(scene: Scene, path: str) -> Path | None:
    """Return what a path refers to: a parameter, the value of an element, or its stored energy."""
    model, parts = cast("BondGraphScene", scene.model), path.split(".")
    if name := varied_parameter(model.parameters, parts):
        return ("parameter", name)
    match parts:
        case ["graph", "nodes", name, "value"] if name in model.graph.nodes and model.graph.nodes[name].value:
            return ("value", name)
        case ["initial", name, ("e" | "f") as part] if getattr(model.initial.get(name), part, None):
            return ("stored", name)
    return None


class _GraphBatch:
    """Samples of one graph, run together.

    Parameters
    ----------
    scene
        The scene.
    places
        The quantity that each varied path refers to.
    wanted
        The arrays to compute.
    """

    def __init__(self, scene: Scene, places: dict[str, Path], wanted: tuple[str, ...]) -> None:
        model = cast("BondGraphScene", scene.model)
        graph, analysis = question(scene)
        if graph.field is not None:
            raise NotShared
        varied = {name for kind, name in places.values() if kind == "parameter"}
        self._expressions = dependent_parameters(scene.source.data.get("parameters") or {}, varied)
        varied |= self._expressions.keys()
        grids = [model.analysis.frequency, model.analysis.time]
        nodes = model.graph.nodes.values()
        parts = [part for node in nodes for part in (node.matrix, node.structure, node.joints)]
        if not shared(wanted, analysis) or any(
            varied & names for names in map(named_in, [*grids, *parts, model.control])
        ):
            raise NotShared
        self._places, self._binary = places, analysis.reading == "binary"
        self._fixed = read_names(scene.source)[0].parameters
        self._values = _slots({name: node.value for name, node in model.graph.nodes.items()}, varied)
        self._stored = _slots({name: one.f or one.e for name, one in model.initial.items()}, varied)
        self._initial = dict(analysis.initial)
        self._wanted = frozenset(wanted)
        varying = [*self._values, *(name for kind, name in places.values() if kind == "value")]
        self._analysis = SampledAnalysis(
            graph.rounded() if self._binary else graph, analysis, dict.fromkeys(varying), wanted
        )

    def run(self, overrides: Overrides) -> list[Mapping[str, Variable] | None]:
        """Return the arrays of every sample; None for one that is to be run alone."""
        parameters, values, stored = self._quantities(overrides)
        columns = [*parameters.values(), *values.values(), *stored.values()]
        failed = {k for column in columns for k, value in enumerate(column) if value is None}
        sound = [k for k in range(len(overrides)) if k not in failed]
        exact = {name: [column[k] for k in sound] for name, column in values.items()}
        initial = [self._initial | {name: column[k] for name, column in stored.items()} for k in sound]
        found: list[Mapping[str, Variable] | None] = [None] * len(overrides)
        for k, result in zip(sound, self._analysis.run(exact, len(sound), initial), strict=True):
            found[k] = result if result is not None and len(result) == len(self._wanted) else None
        return found

    def _quantities(self, overrides: Overrides) -> tuple[dict[str, list[Any]], ...]:
        """Return varied parameters, values of elements and stored energies (both exact), one a sample."""
        known: dict[str, Number | SampleColumn] = dict(self._fixed)
        parameters: dict[str, SampleColumn] = {}
        values: dict[str, list[Fraction | None]] = {}
        stored: dict[str, list[Fraction | None]] = {}
        for path, (kind, name) in self._places.items():
            column = numbers([one[path] for one in overrides])
            match kind:
                case "parameter":
                    known[name] = parameters[name] = column
                case "value":
                    values[name] = _exact(column, binary=self._binary)
                case _:
                    stored[name] = _exact(column)
        for name, expression in self._expressions.items():
            known[name] = parameters[name] = evaluate(expression, known, len(overrides))
        for name, expression in self._values.items():
            if name not in values:
                values[name] = _exact(evaluate(expression, known, len(overrides)), binary=self._binary)
        for name, expression in self._stored.items():
            if name not in stored:
                stored[name] = _exact(evaluate(expression, known, len(overrides)))
        return parameters, values, stored


def _slots(quantities: Mapping[str, Quantity | None], varied: Collection[str]) -> dict[str, Expression]:
    """Return the expressions that depend on varied parameters."""
    given = {name: quantity.expression for name, quantity in quantities.items() if quantity is not None}
    return {name: text for name, text in given.items() if text is not None and text.names & set(varied)}


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
