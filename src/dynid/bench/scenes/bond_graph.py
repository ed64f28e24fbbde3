"""Aspects of scenes of kind `bond-graph`: the engine, and the propagation of the time response."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative
from dynid.bench.cases.zeros_poles import distance, relative_to
from dynid.bench.scenes.aspects import Aspect, propagation
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.request import ENGINES, NUMERIC, Analysis, choose_engine, modelled_storages
from dynid.errors import UsageError
from dynid.result import Result
from dynid.scene.kinds.bond_graph import question
from dynid.scene.load import Scene

_TRANSFER_FUNCTIONS = "bond_graph/transfer_function/"


def engine(scene: Scene) -> Aspect:
    """Return the engines, with the chosen one."""
    graph, analysis = question(scene)
    reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs, traced=False)
    size, choice = modelled_storages(reduced), choose_engine(reduced, analysis)

    def with_engine(name: Any) -> Callable[[int], Callable[[], Any]]:
        def prepare(_: int) -> Callable[[], Any]:
            asked = analysis.results & (NUMERIC | {"transfer_function"})
            if name == "symbolic" and "transfer_function" not in asked:
                raise UsageError("formulas alone: zeros, poles and properties need numbers")
            wanted = {"transfer_function"} if name == "symbolic" else asked | {"zeros", "poles"}
            own = replace(analysis, engine=name, results=frozenset(wanted), port=None, times=None, omega=None)
            return lambda: _roots(analyse(graph, own))

        return prepare

    return Aspect(
        title="engine of transfer functions, zeros and poles",
        size="storage elements",
        points=[(Alternative(name, with_engine(name)), size) for name in ENGINES],
        chosen=frozenset({(choice.engine, size)}),
        because=choice.reason,
        error=_error,
        measure="largest relative distance of zeros and poles from the reference's; its own: its bound",
    )


def _roots(result: Result) -> dict[str, tuple[Any, Any]]:
    """Return zeros and poles of every channel, with their error bounds or estimates."""
    found = {}
    for path, variable in result.items():
        group, _, name = path.rpartition("/")
        if path.startswith(_TRANSFER_FUNCTIONS) and name in ("zeros", "poles"):
            errors = (f"{group}/{name[:-1]}_error_{kind}" for kind in ("bound", "estimate"))
            radius = next(result[each].data for each in errors if each in result)
            found[path] = variable.data, radius
    return found


def _error(found: dict[str, tuple[Any, Any]], reference: dict[str, tuple[Any, Any]]) -> float | None:
    if not found:
        return None  # formulas
    worst = 0.0
    for path, (true, radius) in reference.items():
        poles = reference[path.rpartition("/")[0] + "/poles"][0]
        size = float(np.abs(poles).max(initial=0.0))
        if found is reference:
            worst = max(worst, float((radius / relative_to(true, size)).max(initial=0.0)))
        else:
            worst = max(worst, distance(found[path][0], true, size))
    return worst


def response(scene: Scene) -> Aspect:
    """Return the ways to propagate the time response."""
    return response_of(*question(scene))


def response_of(graph: BondGraph, asked: Analysis) -> Aspect:
    """Return the ways to propagate the time response of a graph."""
    assert asked.times is not None
    analysis = replace(asked, results=frozenset({"time_response"}), omega=None, port=None)

    def work(signals: list[Any]) -> Callable[[], Any]:
        driven = tuple(zip((name for name, _ in analysis.signals), signals, strict=True))
        own = replace(analysis, signals=driven)
        return lambda: analyse(graph, own)["bond_graph/time_response/response"].data

    return propagation(work, [signal for _, signal in analysis.signals], asked.times)


ASPECTS = {"engine": engine, "propagation": response}
