"""Zeros, poles and verdicts of channels of graphs whose loops have delays, with the delays as they are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
from flint import fmpz_poly

from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import rounded as rounded_number
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.controller_circuits import Loop
from dynid.bondgraph.cut_loops import CutLoops, controller, rational, rounded
from dynid.bondgraph.delayed_states import delay_system
from dynid.bondgraph.exact_engine import exact_channels
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.bondgraph.results.channels import add_roots, natural_frequencies, time_constants
from dynid.errors import NumericalError, Singular, Undecided
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import certified_roots, root_balls
from dynid.lti.delay_bandwidth import delayed_bandwidth
from dynid.lti.delay_stability import COUNT, rightmost_roots, stability
from dynid.lti.delayed_step import delayed_steps
from dynid.lti.enclosures import EVALUATIONS
from dynid.lti.margins import Bandwidth
from dynid.lti.quasi_polynomials import QuasiPolynomial, RefinedRoot, coprime
from dynid.lti.stability import SidedRoot, Verdict, verdict, zero_stability
from dynid.lti.stability import stability as stability_text
from dynid.lti.step_info import NO_STEADY_STATE, StepInfo
from dynid.result import Result, Variable

#: Roots that are listed, and the order of the approximants whose roots lead to them.
_MAX_LISTED_ROOTS, _STARTS_ORDER = 20, 12
_GROUPS = ("bond_graph/transfer_function/", "bond_graph/properties/")
#: Arrays of channels in which approximants would show.
_REPLACED = frozenset(
    {f"{root}{name}" for root in ("zero", "pole") for name in ("", "s")}
    | {
        f"{root}_{name}"
        for root in ("zero", "pole")
        for name in ("error_bound", "error_estimate", "residual")
    }
    | {"mode", "natural_frequency", "damping_ratio", "time_constant", "stable", "stability", "order"}
    | {"minimum_phase", "zero_stability", "hidden_mode", "hidden_modes", "hidden_mode_cause"}
    | {"hidden_mode_elements"}
)
#: Cost of the approximants' roots of all channels: some seconds.
_ROOT_WORK = 8_000_000


@dataclass(frozen=True)
class _ListedRoots:
    """The rightmost roots of a function, and the verdict on all of them."""

    roots: tuple[SidedRoot, ...]
    note: str  # which they are: all, or those right of a line
    verdict: Verdict
    dead_time: Fraction = Fraction(0)  # the delay of all terms, s

    @property
    def all_right(self) -> bool:
        """True if the roots right of the axis are all among them."""
        return self.verdict.unstable_poles == sum(
            root.multiplicity for root in self.roots if root.side is not None and root.side > 0
        )


class DelayedChannels:
    """The channels of a graph, all loops closed, as quotients of quasi-polynomials.

    A channel is the loop gain of a further loop from its output to its input, all others closed.
    """

    def __init__(self, opened: BondGraph, analysis: Analysis, channels: Iterable[Channel]) -> None:
        loops = analysis.loops
        self._ahead = {loop.setpoint: loop for loop in loops if loop.setpoint}
        driven = {name: loop.source for loop in loops for name in (loop.reference, loop.setpoint) if name}
        self._numbers = {channel: len(loops) + k for k, channel in enumerate(channels)}
        closing = [
            Loop(port, driven.get(source, source), [Fraction(1)], [Fraction(1)])
            for port, source in self._numbers
        ]
        self._cut, self._loops = CutLoops(opened, [*loops, *closing]), range(len(loops))
        self._listed: dict[Any, _ListedRoots] = {}
        self._work, self._root_work = Work(COUNT), Work(_ROOT_WORK, EVALUATIONS)

    def bandwidth(self, channel: Channel) -> Bandwidth:
        """Return bandwidth and resonance of a channel."""
        above, below, _ = self._quotient(channel)
        return delayed_bandwidth(above, below)

    def zeros_and_poles(self, channel: Channel) -> tuple[_ListedRoots, _ListedRoots]:
        """Return the rightmost zeros and poles of a channel."""
        above, below, dead_time = self._quotient(channel)
        if not above.terms:
            nothing = _ListedRoots((), "", Verdict("undefined", "the input does not reach the output", 0))
            return nothing, self._roots(below)
        return replace(self._roots(above), dead_time=dead_time), self._roots(below)

    def _quotient(self, channel: Channel) -> tuple[QuasiPolynomial, QuasiPolynomial, Fraction]:
        """Return numerator and denominator without a common factor, and the delay of all, s, left out."""
        below = self._cut.function(self._loops)
        above = self._cut.function([*self._loops, self._numbers[channel]]) - below
        if not above.terms:
            return above, QuasiPolynomial({Fraction(0): fmpz_poly([1])}), Fraction(0)
        dead_time = Fraction(0)
        if (loop := self._ahead.get(channel[1])) is not None:  # the controller acts on the setpoint alone
            top, bottom = controller(loop, self._cut.reduced.field)
            above, below = above.times(top), below.times(bottom)
            dead_time = rounded_number(reference(loop.delay))
        if not above.terms:  # a controller that answers nothing
            return above, below, Fraction(0)
        above, below = coprime(*rounded([above, below]))
        shared = frozenset.intersection(*above.products)
        late = sum((delay.seconds for delay in shared), Fraction(0))
        if min(above.terms) > late:  # terms without a common loop may have a common delay
            late, above = (
                min(above.terms),
                QuasiPolynomial(
                    {delay - min(above.terms): polynomial for delay, polynomial in above.terms.items()}
                ),
            )
        else:
            above = QuasiPolynomial({chosen - shared: p for chosen, p in above.products.items()})
        return above, below, dead_time + late

    def _roots(self, function: QuasiPolynomial) -> _ListedRoots:
        key = str(sorted((sorted(loops), str(p)) for loops, p in function.products.items()))
        if key not in self._listed:
            self._listed[key] = self._list(function)
        return self._listed[key]

    def _list(self, function: QuasiPolynomial) -> _ListedRoots:
        if function.is_rational:
            certified = certified_roots(function.terms[Fraction(0)])
            return _ListedRoots(tuple(certified), "", verdict(certified))
        decided = stability(function, self._work)
        if math.isinf(decided.unstable_poles):
            return _ListedRoots((), decided.reason, decided)
        roots, line, others = listed_roots(function, decided.unstable_poles, self._root_work)
        note = f"all with a real part above {line:.6g} rad/s" if math.isfinite(line) else others
        return _ListedRoots(tuple(_sided(root) for root in roots), note, decided)


def listed_roots(
    function: QuasiPolynomial, unstable: float, work: Work
) -> tuple[Sequence[RefinedRoot], float, str]:
    """Return the rightmost roots, a line right of which none is missing, and else what may be."""
    others, starts = "others may lie between them", list[complex]()
    try:
        starts = [complex(ball) for ball in root_balls(rational([function], _STARTS_ORDER)[0], work=work)]
    except Undecided as error:
        others = error.problem
    roots, line = rightmost_roots(function, starts, _MAX_LISTED_ROOTS)
    right = sum(root.value.real > 0 for root in roots)
    if unstable > right:
        others = f"{int(unstable)} lie in the right half-plane, of which these are {right}"
    return roots, line, others


def true_channels(result: Result, analysis: Analysis, opened: BondGraph) -> dict[str, Variable | None]:
    """Return the arrays of channels that replace those of approximants; None: there is none."""
    replaced: dict[str, Variable | None] = {}
    paths = [path for path in result if path.startswith(_GROUPS)]
    ports = {str(port): _opened_port(port, opened) for port in analysis.outputs}
    # the signals of loops are known, or what they meet in a controller
    channels_of = dict.fromkeys((path.split("/")[2], path.split("/")[3]) for path in paths)
    pairs = [(output, source) for output, source in channels_of if ports[output].node in opened.nodes]
    try:
        channels = DelayedChannels(opened, analysis, [(ports[output], source) for output, source in pairs])
    except Singular:  # with its loops cut the graph has no unique solution
        return {}
    for output, source in pairs:
        zeros, poles = channels.zeros_and_poles((ports[output], source))
        arrays = Result(result.kind)
        roots, properties = (f"{group}{output}/{source}" for group in _GROUPS)
        for name, listed in (("zeros", zeros), ("poles", poles)):
            add_roots(arrays, roots, name, listed.roots, note=listed.note)
        values = np.array([root.value for root in poles.roots for _ in range(root.multiplicity)], complex)
        size, damping = natural_frequencies(values)
        arrays.add_axis(f"{properties}/mode", np.arange(1, len(size) + 1))
        arrays.add(f"{properties}/natural_frequency", size, ("mode",), "rad/s")
        arrays.add(f"{properties}/damping_ratio", damping, ("mode",))
        arrays.add(f"{properties}/time_constant", time_constants(values), ("mode",), "s")
        arrays.add(f"{properties}/stable", poles.verdict.stable)
        arrays.add(f"{properties}/stability", _stability(poles))
        arrays.add(f"{properties}/zero_stability", _zero_stability(zeros))
        if (minimum_phase := _minimum_phase(zeros)) is not None:
            arrays.add(f"{properties}/minimum_phase", minimum_phase)
        if not poles.note:
            arrays.add(f"{properties}/order", sum(root.multiplicity for root in poles.roots))
        for path in paths:
            name = path.rpartition("/")[2]
            if path.startswith((f"{roots}/", f"{properties}/")) and name in _REPLACED:
                replaced[path] = arrays.get(path)
        for root in ("zero", "pole"):  # also where an engine has estimates instead
            if f"{roots}/{root}s" in result:
                replaced[f"{roots}/{root}_error_bound"] = arrays[f"{roots}/{root}_error_bound"]
    return replaced


def channel_bandwidths(
    reduced: ReducedGraph, analysis: Analysis, opened: BondGraph
) -> dict[Channel, Bandwidth]:
    """Return bandwidth and resonance of all channels, with their delays."""
    ports = {port: _opened_port(port, opened) for port in reduced.outputs}
    known = [(ports[port], source) for port, source in reduced.channels() if ports[port].node in opened.nodes]
    bandwidths = dict.fromkeys(reduced.channels(), Bandwidth("not computed: a signal of a loop"))
    try:
        channels = DelayedChannels(opened, analysis, known)
    except NumericalError as error:
        return dict.fromkeys(bandwidths, Bandwidth(f"not computed: {error.problem}"))
    return bandwidths | {
        (port, source): channels.bandwidth((ports[port], source))
        for port, source in bandwidths
        if (ports[port], source) in known
    }


def channel_steps(reduced: ReducedGraph, analysis: Analysis, opened: BondGraph) -> dict[Channel, StepInfo]:
    """Return the characteristics of the step responses of all channels, with their delays."""
    ports = {port: _opened_port(port, opened) for port in reduced.outputs}
    ports = {port: within for port, within in ports.items() if within.node in opened.nodes}
    try:
        system, _ = delay_system(opened, analysis.loops, reduced.inputs, reduced.outputs)
        channels = DelayedChannels(opened, analysis, product(ports.values(), reduced.inputs))
    except NumericalError as error:
        return dict.fromkeys(reduced.channels(), StepInfo(f"not computed: {error.problem}"))
    transfers = exact_channels(reduced)  # approximants are exact at s = 0
    steps: dict[Channel, StepInfo] = {}
    for source in reduced.inputs:
        stable, slowest = [], -math.inf
        for port in reduced.outputs:
            steps[port, source] = StepInfo("not computed: a signal of a loop")
            if port not in ports:
                continue
            zeros, poles = channels.zeros_and_poles((ports[port], source))
            if zeros.verdict.kind == "undefined":
                steps[port, source] = StepInfo(f"undefined: {zeros.verdict.reason}")
            elif not poles.verdict.stable:
                steps[port, source] = StepInfo(f"undefined: {NO_STEADY_STATE.format(_stability(poles))}")
            elif poles.note and not poles.roots:
                steps[port, source] = StepInfo(f"not computed: {poles.note}")
            else:
                stable.append(port)
                slowest = max([slowest, *(root.value.real for root in poles.roots)])
        if stable:
            alone = system.with_inputs([source]).with_outputs(
                [reduced.outputs.index(port) for port in stable]
            )
            finals = [transfers[port, source].dc_gain for port in stable]
            infos = delayed_steps(alone, finals, slowest)
            steps |= {(port, source): info for port, info in zip(stable, infos, strict=True)}
    return steps


def _stability(poles: _ListedRoots) -> str:
    if not poles.note:  # all of them
        return stability_text(poles.roots)
    if poles.all_right and poles.verdict.kind in ("stable", "unstable"):
        return stability_text([root for root in poles.roots if root.side] or poles.roots)
    return poles.verdict.text


def _minimum_phase(zeros: _ListedRoots) -> bool | None:
    if zeros.dead_time or zeros.verdict.unstable_poles or zeros.verdict.kind in ("undefined", "marginal"):
        return None if math.isnan(zeros.verdict.unstable_poles) and not zeros.dead_time else False
    return True


def _zero_stability(zeros: _ListedRoots) -> str:
    kind, reason, count = zeros.verdict.kind, zeros.verdict.reason, zeros.verdict.unstable_poles
    if kind in ("undefined", "undecided", "at the limit"):
        text = f"{kind}: {reason}"
    elif kind == "stable" or zeros.all_right:
        text = zero_stability(zeros.roots, (), vanishes=False)
    else:
        text = f"non-minimum phase: {reason}" if count else f"marginal, not minimum phase: {reason}"
    if zeros.dead_time:
        late = f"non-minimum phase: dead time of {float(zeros.dead_time):.6g} s"
        text = f"{late}; {text.removeprefix('minimum phase: ').removeprefix('non-minimum phase: ')}"
    return text


def _sided(root: RefinedRoot) -> SidedRoot:
    real = root.value.real
    side = None if abs(real) <= root.radius and root.radius else (real > 0) - (real < 0)
    return SidedRoot(root.value, 1, root.radius, side)


def _opened_port(port: Port, opened: BondGraph) -> Port:
    """Return an output as the graph without feedback has it: variables of driven sources have moved."""
    if port.node in opened.nodes:
        return port
    node, _, quantity = str(port).rpartition(".")
    return Port(node, quantity)  # type: ignore[arg-type]
