"""The verdict on the stability of a whole system: its loops, and every separate part of its graph."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dynid.bondgraph.exact_engine import ExactEngine
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph, parts_without_output, separate_parts
from dynid.lti.certified_roots import certified_roots
from dynid.lti.stability import SidedRoot, Verdict, combined, no_solution, verdict
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.bondgraph.floating.float_engine import FloatEngine

SYSTEM = "bond_graph/system"
#: Written in place of a number of unstable poles.
INFINITELY_MANY, UNDECIDED = -1, -2


def add_system(result: Result, verdict: Verdict) -> None:
    """Add a verdict on the whole system."""
    count = verdict.unstable_poles
    count_shown = UNDECIDED if math.isnan(count) else INFINITELY_MANY if math.isinf(count) else int(count)
    values: dict[str, Any] = {
        "stable": verdict.stable,
        "stability": verdict.kind,
        "reason": verdict.reason,
        "unstable_poles": count_shown,
    }
    for name, value in values.items():
        result.add(f"{SYSTEM}/{name}", value)


def graph_verdict(engine: ExactEngine | FloatEngine) -> Verdict:
    """Return the verdict on a graph without delays: on every separate part of it, outputs in it or not."""
    reduced = engine.reduced
    parts = {port: frozenset(reduced.reductions[port].junctions) for port in reduced.outputs}
    # One channel of each part has all its modes, shown or hidden.
    channels = {parts[channel[0]]: channel for channel in reversed(list(reduced.channels()))}
    separate = all(
        channel_part == further_part or channel_part.isdisjoint(further_part)
        for channel_part in channels
        for further_part in channels
    )
    if set(channels) == set(parts.values()) and separate:
        verdicts = [verdict(_modes(engine, channel)) for channel in channels.values()]
    elif isinstance(engine, ExactEngine):
        polynomials = separate_parts(reduced, engine.natural)
        verdicts = [verdict(certified_roots(polynomial)) for polynomial in polynomials]
    else:
        return Verdict("undecided", "parts of the graph overlap; use 'engine: exact'", math.nan)
    others = parts_without_output(reduced)
    if others is None:
        return combined([*verdicts, no_solution(reduced.free)])
    verdicts += [verdict(certified_roots(polynomial)) for polynomial in others]
    return combined(verdicts or [verdict([])])


def closed_verdict(reduced: ReducedGraph, *, delayed: bool) -> Verdict:
    """Return the verdict on a graph with its loops closed that has no unique solution with its loops cut.

    Delays, or their approximants, do not change whether a graph has one.
    """
    if reduced.free:
        return no_solution(reduced.free)
    if not delayed:
        return graph_verdict(ExactEngine(reduced))
    return Verdict("undecided", "the graph has no unique solution with its loops cut", math.nan)


def _modes(engine: ExactEngine | FloatEngine, channel: Channel) -> list[SidedRoot]:
    """Return the natural modes of the part of a channel; the output's own integrator is none."""
    poles: list[Any] = list(engine.channel(channel).poles)
    if engine.reduced.graph.integrates(channel[0]):
        at_origin = next((pole for pole in poles if pole.value == 0), None)
        if at_origin is not None:
            poles.remove(at_origin)
            rest = at_origin.multiplicity - 1
            poles += [replace(at_origin, multiplicity=rest)] * (rest > 0)
    return [*poles, *engine.hidden_modes(channel)]


def system_text(result: Result) -> str:
    """Return the verdict in words; '' where there is none."""
    if f"{SYSTEM}/stability" not in result:
        return ""
    kind, reason = (str(result.value(f"{SYSTEM}/{name}")) for name in ("stability", "reason"))
    return f"{kind}: {reason}" if reason else kind
