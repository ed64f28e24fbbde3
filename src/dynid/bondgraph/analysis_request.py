"""Requests to a bond graph: results, formulas, parameters, and the engine that a request is computed by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

from dynid import defaults
from dynid.bondgraph.graph import Bond, Port
from dynid.model_scope import ScopePart, divided
from dynid.number_format import counted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.bondgraph.controller_circuits import ClosedLoops, Loop
    from dynid.bondgraph.graph import BondGraph
    from dynid.bondgraph.operating_point.linearisation import Linearisation
    from dynid.bondgraph.reduced_graph import ReducedGraph
    from dynid.bondgraph.sampled_loops import SampledLoops
    from dynid.bondgraph.state_feedback import StateFeedback
    from dynid.lti.generator import Signal


ResultName = Literal[
    "transfer_function",
    "zeros",
    "poles",
    "properties",
    "hidden_modes",
    "step_info",
    "bandwidth",
    "energy",
    "source_performance",
    "sensitivities",
    "reduction",
    "prototype",
    "causality",
    "state_space",
    "frequency_response",
    "time_response",
]

#: The results that can be asked for, in the order of the report.
RESULTS: tuple[ResultName, ...] = get_args(ResultName)

#: What is computed when nothing in particular is asked for, beside the responses.
USUAL: frozenset[ResultName] = frozenset({"transfer_function", "zeros", "poles", "properties", "reduction"})


#: The names under `bond_graph/properties/OUTPUT/INPUT/`, by the result that they come with.
PROPERTIES: Mapping[ResultName, frozenset[str]] = {
    "properties": frozenset(
        {"relative_degree", "dc_gain", "high_frequency_gain", "stable", "stability", "minimum_phase"}
        | {"order", "zero_stability", "prototype", "mode", "natural_frequency", "damping_ratio"}
        | {"time_constant", "hidden_mode", "hidden_modes"}
    ),
    "hidden_modes": frozenset({"hidden_mode", "hidden_modes", "hidden_mode_cause", "hidden_mode_elements"}),
    "step_info": frozenset(
        {"step_status", "final_value", "initial_value", "rise_time", "settling_time", "transient_time"}
        | {"overshoot", "undershoot", "peak", "peak_time"}
    ),
    "bandwidth": frozenset(
        {"bandwidth_status", "bandwidth", "peak_gain", "peak_frequency", "half_power_low", "half_power_high"}
    ),
}


#: Names in the group `margins` of a graph with loops, with those of its attributes.
MARGINS = frozenset(
    {"loop", "stable", "stability", "unstable_poles", "gain", "gain_reduction", "phase", "delay", "modulus"}
    | {"gain_crossover", "phase_crossover", "modulus_at", "Ms", "Mt", "Mt_at", "undefined"}
    | {"crossing_gain_below", "crossing_gain_above", "undecided"}
    | {"pole", "poles", "poles_error_bound", "approximate"}
)

Engine = Literal["auto", "exact", "float", "symbolic"]
Reading = Literal["decimal", "binary"]
FormulaForm = Literal["nested", "expanded"]
#: How a controller is made discrete: s by the trapezoidal rule or the backward difference, its answer to held
#: samples (zero-order hold), or not, as its coefficients are of z.
Discretisation = Literal["tustin", "backward", "zoh", "z"]

#: The engines themselves; `auto` is a choice among them.
ENGINES = tuple(name for name in get_args(Engine) if name != "auto")
# Results of graphs with sampled loops; all others are of transfer functions in s, which those do not have.
_SAMPLED: frozenset[ResultName] = frozenset(
    {"properties", "step_info", "frequency_response", "time_response", "causality"}
)
# Results of loops that are sampled with several periods, which have no response by z.
_MULTIRATE: frozenset[ResultName] = frozenset({"properties", "time_response", "causality"})
#: Most lines of a graph: the terms of its characteristic function double with each.
MAX_TRANSMISSION_LINES = 8
# Results of graphs with lines (TL).
_WITH_LINES: frozenset[ResultName] = frozenset(
    {
        "transfer_function",
        "zeros",
        "poles",
        "properties",
        "step_info",
        "frequency_response",
        "time_response",
        "reduction",
        "state_space",
    }
)
#: Results that the symbolic engine has no numbers for.
NUMERIC: frozenset[ResultName] = frozenset({"zeros", "poles", "properties", "hidden_modes"})


def available_results(*, sampled: bool, lines: bool, multirate: bool = False) -> frozenset[ResultName]:
    """Return the results that graphs have, with sampled loops, of several periods, or lines (TL)."""
    available = (_MULTIRATE if multirate else _SAMPLED) if sampled else frozenset(RESULTS)
    return available & _WITH_LINES if lines else available


@dataclass(frozen=True)
class FormulaRequest:
    """The formulas to write."""

    #: nested: the reduction's program as named assignments, never expanded; expanded: numerator and
    #: denominator as polynomials, too.
    form: FormulaForm = "nested"
    terms: int = 100_000  # most terms of a polynomial before the expansion is given up


@dataclass(frozen=True)
class SensitivityParameter:
    """A parameter that sensitivities are taken by: the value of a node, or one behind several values."""

    name: str
    value: Fraction
    #: The derivative of each node's value by it, for the nodes that depend on it.
    rates: Mapping[str, Fraction]


@dataclass(frozen=True, eq=False)
class Analysis:
    """The results to compute, and their settings."""

    inputs: tuple[str, ...]  # sources kept as inputs; all others are zero
    outputs: tuple[Port, ...]  # variables asked for
    results: frozenset[str] = USUAL  # names out of `RESULTS`
    omega: NDArray[np.float64] | None = None  # angular frequencies of the frequency response, rad/s
    times: NDArray[np.float64] | None = None  # times of the time response, s, starting at 0
    #: Signals of the time response: pairs of an input and a signal; those of one input add up.
    signals: tuple[tuple[str, Signal], ...] = ()
    #: Stored energy at t = 0: the flow of an I, the effort of a C.
    initial: Mapping[str, float | Fraction] = field(default_factory=dict)
    #: What sensitivities are taken by; default: the value of every node.
    parameters: tuple[SensitivityParameter, ...] | None = None
    #: exact (roots with certified bounds, everything decided), float (eigenvalues with error estimates, for
    #: large graphs), symbolic (formulas alone), or auto: chosen by size.
    engine: Engine = "auto"
    #: What a value means: the decimal as it is written, or the double nearest to it.
    reading: Reading = "decimal"
    #: Formulas to write beside the transfer function; None: its formula where it is short.
    formulas: FormulaRequest | None = None
    #: A bond at which the graph is decomposed, written from the source to the load; default: nowhere.
    port: Bond | None = None
    #: Structures that enter by a reduced model: how many coordinates were kept and left out, and how.
    approximations: tuple[ScopePart, ...] = ()
    #: Results that are computed by default of small graphs alone, with the reason; None: there are none.
    omitted: ScopePart | None = None
    #: opened, loops: Of a graph with feedback: the graph without it, and the loops, for their margins.
    opened: BondGraph | None = None
    loops: tuple[Loop, ...] = ()
    #: linearisation, law_outputs: Of a graph with laws: its linearisation, and the outputs as the graph with
    #: laws has them; of limited loops around a linear graph those of the graph without feedback.
    linearisation: Linearisation | None = None
    law_outputs: tuple[Port, ...] = ()
    law_loops: tuple[Loop, ...] = ()  # its loops, as the graph with laws has what they measure
    feedback: StateFeedback | None = None  # the designed feedback of states, whose loops `loops` are
    #: True: there is one signal for each input, and the responses to them are apart, not added.
    apart: bool = False

    @property
    def late(self) -> bool:
        """True if a loop has a delay."""
        return any(loop.delayed for loop in self.loops)

    @property
    def nonlinear(self) -> bool:
        """True if it has laws or limited controllers."""
        return self.linearisation is not None or any(loop.limits is not None for loop in self.loops)

    @property
    def in_time(self) -> bool:
        """True if a loop has a delay or is sampled: its graph is a circuit of approximants, or cut."""
        return any(loop.delayed or loop.sampling is not None for loop in self.loops)

    def scene_nodes(self, graph: BondGraph) -> dict[str, str]:
        """Return by node of a graph that of the scene: a line for what is in it, none for controllers."""
        assert self.opened is not None
        lines, drawn = {loop.line for loop in self.loops} - {""}, self.opened.nodes
        return {
            name: node.part if node.part in lines else name
            for name, node in graph.nodes.items()
            if node.part in lines or name in drawn
        }

    @cached_property
    def named_delays(self) -> ClosedLoops:
        """The graph for formulas without numbers: each delay is a factor, each line a T of impedances."""
        from dynid.bondgraph.controller_circuits import close_loops
        from dynid.bondgraph.transmission_line import lines_as_circuits

        assert self.opened is not None
        lines = dict.fromkeys(loop.line for loop in self.loops if loop.line)
        feedback = [loop for loop in self.loops if not loop.line]
        return close_loops(lines_as_circuits(self.opened, lines), feedback, named=True)

    def size(self, graph: BondGraph) -> tuple[int, int]:
        """Return the numbers of nodes and bonds; with delays or samples without feedback, lines as nodes."""
        if not self.in_time:
            return len(graph.nodes), len(graph.bonds)
        assert self.opened is not None
        owners = self.scene_nodes(self.opened)
        return len({*owners.values()}), sum(owners[a] != owners[b] for a, b in self.opened.bonds)

    @property
    def undelayed(self) -> BondGraph:
        """The closed graph with sources in place of delayed answers, and sampled loops cut."""
        from dynid.bondgraph.controller_circuits import close_loops

        assert self.opened is not None
        loops = [loop if loop.sampling is None else loop.cut() for loop in self.loops]
        return close_loops(self.opened, loops, cut=True).graph

    @property
    def opened_as_read(self) -> BondGraph:
        """The graph without feedback, with the values as they are read."""
        assert self.opened is not None
        return self.opened.rounded() if self.reading == "binary" else self.opened

    @cached_property
    def sampled_loops(self) -> SampledLoops | None:
        """The loops of a graph whose controllers are sampled; None of others."""
        if all(loop.sampling is None for loop in self.loops):
            return None
        if any(loop.delayed for loop in self.loops):
            from dynid.bondgraph.sampled_delays import SampledLoopsWithDelays

            return SampledLoopsWithDelays(self.opened_as_read, self.loops)
        from dynid.bondgraph.sampled_loops import MultirateLoops, SampledLoops

        if len({loop.sampling.period for loop in self.loops if loop.sampling is not None}) > 1:
            return MultirateLoops(self.opened_as_read, self.loops)
        return SampledLoops(self.opened_as_read, self.loops)


def needed_parts(reduced: ReducedGraph, analysis: Analysis) -> tuple[ScopePart, ScopePart]:
    """Return the elements and the storages that the outputs depend on, and those that none does.

    With delays or samples they are those of the scene, their loops closed.
    """
    from dynid.bondgraph.reduced_graph import ReducedGraph

    names = {name: name for name in reduced.graph.nodes}
    if analysis.in_time:
        graph = analysis.named_delays.graph
        names = analysis.scene_nodes(graph)
        reduced = ReducedGraph(graph, reduced.inputs, reduced.outputs, traced=False)
    unneeded = set(names).intersection(*map(reduced.dropped, reduced.outputs))
    kept = [shown for name, shown in names.items() if name not in unneeded]
    storages = [name for name in reduced.storages if name in names]
    why = "no output depends on them"
    return divided("elements", names.values(), kept, why), divided("storages", storages, kept, why)


# --- choice of the engine --------------------------------------------------------------------------

#: Up to how many storages the exact engine is chosen: on many loops, and where roots are asked for.
_LIMIT = {
    (False, False): defaults.EXACT_POLYNOMIALS,
    (False, True): defaults.EXACT_ROOTS,
    (True, False): defaults.EXACT_POLYNOMIALS_ON_LOOPS,
    (True, True): defaults.EXACT_ROOTS_ON_LOOPS,
}
_LIMITS = {
    "exact": "none: zeros and poles carry certified bounds, every verdict is decided",
    "float": (
        "zeros and poles carry error estimates, a verdict within them is left undecided; numerator and "
        "denominator are not formed, because coefficients of such degrees do not determine their roots "
        "in double precision: zeros, poles and gain do; why a mode is hidden is not said"
    ),
    "symbolic": "formulas alone: zeros, poles and verdicts need numbers",
}


@dataclass(frozen=True)
class EngineChoice:
    """The engine of an analysis, and the reason for it."""

    engine: str
    reason: str  # the reason, in a sentence
    forced: bool = False  # whether the user requested it

    @property
    def limits(self) -> str:
        """Limits of the engine."""
        return _LIMITS[self.engine]


def modelled_storages(reduced: ReducedGraph) -> int:
    """Return the number of storage elements behind the outputs."""
    if reduced.nodal is not None:
        return len(reduced.storages) - sum(name in reduced.storages for name in reduced.nodal.dropped())
    modelled = {name for reduction in reduced.reductions.values() for name in reduction.modelled}
    return sum(name in modelled for name in reduced.storages)


def choose_engine(reduced: ReducedGraph, analysis: Analysis) -> EngineChoice:
    """Choose the engine for what is asked.

    `reduced`: the graph; its size is the number of storage elements behind the outputs. `analysis`: what is
    asked, and the engine if the user named one.
    """
    if analysis.engine != "auto":
        return EngineChoice(analysis.engine, "as requested", forced=True)
    size = modelled_storages(reduced)
    roots = bool(analysis.results & NUMERIC)
    loops = reduced.structure.loops
    looped = loops > defaults.MANY_LOOPS.value
    limit: defaults.Default[int] | defaults.Limit[int] = _LIMIT[looped, roots]
    if roots and reduced.field is not None:
        limit = defaults.EXACT_IRRATIONAL
    where = f" on {loops} loops" if looped else ""
    reason = f"{counted(size, 'storage element')}{where}; chosen by default: {limit}"
    return EngineChoice("exact" if size <= limit.value else "float", reason)
