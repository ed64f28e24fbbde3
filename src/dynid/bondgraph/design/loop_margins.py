"""Margins of loops as functions of free parameters.

Values and derivatives are those of `loop_gains.py`, of sampled loops those of `sampled_gains.py`; `verified`
compares a solution with the margins that miss no crossing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arithmetic.ldl import reference
from dynid.bondgraph.controller_circuits import Loop, close_loops
from dynid.bondgraph.design.design_request import LoopTarget
from dynid.bondgraph.design.loop_gains import LoopGains, LoopValue
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.parametric_equations import ParametricEquations
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import UsageError

#: Relative difference from the margins that miss no crossing, up to which they are the same.
_SAME_RTOL = 1e-6


class LoopMargins:
    """The margins of the loops of a graph at values of its free parameters."""

    def __init__(self, opened: BondGraph, loops: Sequence[Loop], names: Sequence[str]) -> None:
        self._opened, self._loops, self._names = opened, list(loops), tuple(names)
        self._sampled = [k for k, loop in enumerate(loops) if loop.sampling is not None]
        if self._sampled:
            self._equations = self._between_samples()
            return
        for loop in loops:
            if isinstance(loop.delay, Dependent) and loop.delay.names & {*names}:
                raise UsageError(
                    "a delay that depends on a free parameter is not designed",
                    remedy="Hold the delay at a number.",
                    names=[loop.place],
                )
        self._delays = np.array([float(reference(loop.delay)) for loop in loops])
        closed = close_loops(opened, [replace(loop, delay=Fraction(1)) for loop in loops], cut=True)
        answers = [answer for _, answer in closed.delayed]
        reduced = ReducedGraph(closed.graph, [source for source, _ in closed.delayed], answers, traced=False)
        self._equations = ParametricEquations(reduced, names)

    def _between_samples(self) -> ParametricEquations:
        """Return the equations of the graph that is driven by what sampled loops hold."""
        from dynid.bondgraph.design.sampled_gains import refuse_sampling
        from dynid.bondgraph.sampled_loops import cut_graph

        refuse_sampling(self._loops, self._names)
        sampled = [self._loops[k] for k in self._sampled]
        cut = cut_graph(self._opened, sampled, [loop for loop in self._loops if loop.sampling is None])
        return ParametricEquations(ReducedGraph(cut.graph, cut.held, cut.answered, traced=False), self._names)

    @property
    def reached(self) -> frozenset[str]:
        """The free parameters that the loops depend on."""
        coefficients = chain.from_iterable((*loop.numerator, *loop.denominator) for loop in self._loops)
        direct = (c.names for c in coefficients if isinstance(c, Dependent))
        return self._equations.reached.union(*direct) & {*self._names}

    def at(self, values: Mapping[str, float]) -> LoopGains:
        """Return the loops at values of the free parameters."""
        matrices = self._equations.at(values)
        if not self._sampled:
            return LoopGains(matrices, self._delays)
        from dynid.bondgraph.design.sampled_gains import SampledGains

        sampled = [self._loops[k] for k in self._sampled]
        return SampledGains(matrices, sampled, values, self._names)

    def margin(self, loops: LoopGains, target: LoopTarget) -> LoopValue | None:
        """Return a margin; None where there is none, or the closed loops are not stable."""
        if not self._sampled:
            return loops.margin(target.kind, target.loop)
        if target.loop not in self._sampled:
            raise UsageError(
                f"the loop {target.name} is continuous beside sampled ones, and its margins are not computed",
                remedy="Take the margin of a sampled loop.",
                names=["design.targets"],
            )
        return loops.margin(target.kind, self._sampled.index(target.loop))

    def verified(
        self, targets: Sequence[LoopTarget], reached: Sequence[float], values: Mapping[str, float]
    ) -> bool:
        """Test whether the closed loops are stable and margins are these, by counts that miss nothing."""
        from dynid.bondgraph.cut_loops import CutLoops

        def number(item: Any) -> Any:
            return reference(item.referred(values)) if isinstance(item, Dependent) else item

        nodes = [
            node if node.dependent is None else replace(node, value=number(node.dependent), dependent=None)
            for node in self._opened.nodes.values()
        ]
        loops = [
            replace(
                loop,
                numerator=[*map(number, loop.numerator)],
                denominator=[*map(number, loop.denominator)],
                delay=number(loop.delay),
            )
            for loop in self._loops
        ]
        graph = BondGraph(nodes, self._opened.bonds)
        if self._sampled:
            from dynid.bondgraph.sampled_loops import SampledLoops

            sampled = SampledLoops(graph, loops)
            verdict = sampled.verdict
        else:
            cut = CutLoops(graph, loops)
            verdict = cut.verdict()
        if not verdict.stable:
            return False
        for target, value in zip(targets, reached, strict=True):
            if self._sampled:
                margins = sampled.margins(self._sampled.index(target.loop))
            else:
                margins = cut.margins(*cut.loop(target.loop))
            exact = float(getattr(margins, target.margin))
            if not abs(exact - value) <= _SAME_RTOL * abs(value):
                return False
        return True
