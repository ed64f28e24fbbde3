"""What a user asks of a bond graph, computed and returned as one `Result`.

Only what is asked for is computed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.notation import express, length
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.reduction import Reduction, Step
from dynid.bondgraph.transfer import TransferFunction
from dynid.lti.roots import Root, certified_roots, repeated
from dynid.result import Result

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.lti.generator import Signal
    from dynid.lti.model import StateSpace

#: The results that can be asked for, in the order of the report.
RESULTS = (
    "transfer_function",
    "zeros",
    "poles",
    "properties",
    "hidden_modes",
    "reduction",
    "prototype",
    "state_space",
    "frequency_response",
    "time_response",
)

#: Longest nested formula of a prototype's system that is written out, in operations.
_READABLE = 40


@dataclass(frozen=True, eq=False)
class Analysis:
    """What to compute.

    Parameters
    ----------
    inputs
        Sources kept as inputs; all others are zero.
    outputs
        Variables asked for.
    results
        Names out of `RESULTS`.
    omega
        Angular frequencies of the frequency response, rad/s.
    times
        Times of the time response, s, starting at 0.
    signals
        What drives the time response: pairs of an input and a signal; those of one input add up.
    initial
        Stored energy at t = 0: the flow of an I, the effort of a C.
    """

    inputs: tuple[str, ...]
    outputs: tuple[Port, ...]
    results: frozenset[str] = frozenset({"transfer_function", "zeros", "poles", "properties", "reduction"})
    omega: NDArray[np.float64] | None = None
    times: NDArray[np.float64] | None = None
    signals: tuple[tuple[str, Signal], ...] = ()
    initial: Mapping[str, float] = field(default_factory=dict)


def analyse(graph: BondGraph, analysis: Analysis, title: str = "") -> Result:
    """Run an analysis of a bond graph.

    Parameters
    ----------
    graph
        The bond graph.
    analysis
        What to compute.
    title
        The result's title.

    Returns
    -------
    Result
        Arrays under `bond_graph/`, as far as they were asked for.

    Raises
    ------
    Singular
        Where the graph has no unique solution; it names the nodes.
    """
    reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs)
    result = Result("bond-graph", title)
    result.annotate("bond_graph", **_need(reduced))
    asked = analysis.results
    if asked & {"transfer_function", "zeros", "poles", "properties", "hidden_modes"}:
        _add_exact(result, reduced, asked)
    if "reduction" in asked:
        _add_steps(result, reduced)
    if asked & {"reduction", "prototype"}:
        _add_prototypes(result, reduced)
    if "state_space" in asked:
        _add_state_space(result, reduced)
    if "frequency_response" in asked and analysis.omega is not None:
        _add_frequency_response(result, reduced, analysis.omega)
    if "time_response" in asked and analysis.times is not None:
        _add_time_response(result, reduced, analysis)
    return result


def _need(reduced: ReducedGraph) -> dict[str, Any]:
    """Say what was modelled and what was left out."""
    used = {name for reduction in reduced.reductions.values() for name in reduction.modelled}
    dropped = [name for name in reduced.graph.nodes if name not in used]
    return {"nodes": len(reduced.graph.nodes), "bonds": len(reduced.graph.bonds), "dropped": ", ".join(dropped)}


# --- transfer functions and properties -------------------------------------------------------------


def _add_exact(result: Result, reduced: ReducedGraph, asked: frozenset[str]) -> None:
    from dynid.bondgraph.formula import formulas

    channels = reduced.channels()
    ratios = reduced.rational(channels.values())
    transfers = {channel: TransferFunction.of(ratios[register]) for channel, register in channels.items()}
    readable = formulas(reduced) if "transfer_function" in asked else {}
    natural = _characteristic_polynomials(reduced) if asked & {"properties", "hidden_modes"} else {}
    for channel, transfer in transfers.items():
        _add_transfer_function(result, channel, transfer, asked, readable.get(channel))
        if "properties" in asked:
            _add_properties(result, channel, transfer, reduced.reductions[channel[0]])
        if natural:
            _add_hidden_modes(result, channel, transfer, natural[channel[0]])


def _add_transfer_function(
    result: Result, channel: Channel, transfer: TransferFunction, asked: frozenset[str], formula: str | None
) -> None:
    group = f"bond_graph/transfer_function/{channel[0]}/{channel[1]}"
    result.annotate(group, engine="exact", reading="decimal")
    if "transfer_function" in asked:
        if formula is not None:
            result.annotate(group, symbolic=formula)
        for name, coefficients in zip(("numerator", "denominator"), transfer.coefficients(), strict=True):
            axis = f"{name}_power"
            result.add_axis(f"{group}/{axis}", np.arange(len(coefficients))[::-1])
            result.add(f"{group}/{name}", coefficients, (axis,))
    for name, roots in (("zeros", transfer.zeros), ("poles", transfer.poles)):
        if name in asked:
            _add_roots(result, group, name, roots)


def _add_roots(result: Result, group: str, name: str, roots: Sequence[Root]) -> None:
    """Add roots with their certified error bounds, each as often as its multiplicity says."""
    axis = name[:-1]
    values = repeated(roots)
    radii = [root.radius for root in roots for _ in range(root.multiplicity)]
    result.add_axis(f"{group}/{axis}", np.arange(1, len(values) + 1))
    result.add(f"{group}/{name}", values, (axis,), "rad/s")
    result.add(f"{group}/{axis}_error_bound", np.array(radii, dtype=float), (axis,), "rad/s")


def _add_properties(result: Result, channel: Channel, transfer: TransferFunction, reduction: Reduction) -> None:
    group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
    result.add(f"{group}/relative_degree", transfer.relative_degree)
    result.add(f"{group}/dc_gain", transfer.dc_gain)
    result.add(f"{group}/high_frequency_gain", transfer.high_frequency_gain)
    result.add(f"{group}/stable", transfer.stable)
    result.add(f"{group}/minimum_phase", transfer.minimum_phase)
    result.add(f"{group}/order", transfer.order)
    result.add(f"{group}/prototype", reduction.prototype.letter)
    result.add(f"{group}/zero_stability", transfer.zero_stability)


def _add_hidden_modes(result: Result, channel: Channel, transfer: TransferFunction, natural: Any) -> None:
    """Add the natural modes that cancel in the channel: uncontrollable, unobservable, or both."""
    group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
    hidden = repeated(certified_roots(natural // natural.gcd(transfer.denominator)))
    result.add_axis(f"{group}/hidden_mode", np.arange(1, len(hidden) + 1))
    result.add(f"{group}/hidden_modes", hidden, ("hidden_mode",), "rad/s")


def _characteristic_polynomials(reduced: ReducedGraph) -> dict[Port, Any]:
    """Return, for every output, the polynomial of all natural modes of the part behind it.

    It is the determinant of the nodal form (the product of the pivots) times s for every storage that
    integrates there (its immittance has s in the denominator).
    """
    from flint import fmpz_poly

    structure = reduced.structure
    ratios = reduced.rational({pivot for red in reduced.reductions.values() for pivot in red.pivots})
    polynomials = {}
    for port, reduction in reduced.reductions.items():
        numerator, denominator = fmpz_poly([1]), fmpz_poly([1])
        for pivot in reduction.pivots:
            numerator, denominator = numerator * ratios[pivot].numerator, denominator * ratios[pivot].denominator
            common = numerator.gcd(denominator)
            numerator, denominator = numerator // common, denominator // common
        for junction in reduction.junctions:
            for name in structure.junctions[junction].elements:
                integrates = reduced.graph.nodes[name].type == ("C" if structure.junctions[junction].kind == "1" else "I")
                numerator = numerator * fmpz_poly([0, 1]) if integrates else numerator
        polynomials[port] = numerator // numerator.gcd(denominator)
    return polynomials


# --- the reduction as a trace ----------------------------------------------------------------------


def _add_steps(result: Result, reduced: ReducedGraph) -> None:
    symbols = {name: node.symbol for name, node in reduced.graph.nodes.items()}
    rows = [
        (str(port), step.rule, ", ".join(step.nodes), _equation(reduced, step, symbols), step.meaning)
        for port, reduction in reduced.reductions.items()
        for step in reduction.steps
    ]
    names = ("output", "rule", "nodes", "equation", "meaning")
    table = np.array(rows, dtype=[(name, object) for name in names])
    result.add_axis("bond_graph/reduction/step", np.arange(1, len(rows) + 1))
    result.add("bond_graph/reduction/steps", table, ("step",))


def _add_prototypes(result: Result, reduced: ReducedGraph) -> None:
    symbols = {name: node.symbol for name, node in reduced.graph.nodes.items()}
    ports = list(reduced.reductions)
    result.add_axis("bond_graph/reduction/output", [str(port) for port in ports])
    letters = [reduced.reductions[port].prototype.letter for port in ports]
    if len(ports) == 1:
        result.add("bond_graph/reduction/prototype", letters[0])
    else:
        result.add("bond_graph/reduction/prototype", letters, ("output",))
    prototypes = [reduced.reductions[port].prototype for port in ports]
    result.add("bond_graph/reduction/prototype_equation", [p.equation for p in prototypes], ("output",))
    for part, index in (("system_a", 0), ("system_b", 1)):
        texts = []
        for prototype in prototypes:
            name, ((register, _),) = prototype.definitions[index]
            nested = length(reduced.program, register, _READABLE) < _READABLE
            texts.append(f"{name} = {express(reduced.program, register, symbols, nested=nested)}")
        result.add(f"bond_graph/reduction/{part}", texts, ("output",))


def _equation(reduced: ReducedGraph, step: Step, symbols: Mapping[str, str]) -> str:
    """Write the equations of a step, in terms of what earlier steps have named."""
    program, lines = reduced.program, []
    for name, parts in step.definitions:
        terms = []
        for register, source in parts:
            label = program.labels.get(register)
            text = label if label and label != name else express(program, register, symbols)
            if source and text in ("1", "-1"):
                text = text.replace("1", source)
            elif source:
                text = f"({text})*{source}" if (" + " in text or " - " in text) else f"{text}*{source}"
            terms.append(text)
        lines.append(f"{name} = {' + '.join(terms)}")
    return "; ".join(lines) or step.relation


# --- state equations and responses -------------------------------------------------------------------------------------


def _add_state_space(result: Result, reduced: ReducedGraph) -> None:
    from dynid.bondgraph.state_space import state_space

    system, group = state_space(reduced), "bond_graph/state_space"
    for axis, names in (("state", system.states), ("input", system.inputs), ("output", system.outputs)):
        result.add_axis(f"{group}/{axis}", np.array(names, dtype=object))
    result.add_axis(f"{group}/rate_of", np.array(system.states, dtype=object))
    result.add(f"{group}/A", system.A, ("rate_of", "state"))
    result.add(f"{group}/B", system.B, ("rate_of", "input"))
    result.add(f"{group}/C", system.C, ("output", "state"))
    feedthrough = np.stack([system.D, *system.higher])
    result.add_axis(f"{group}/derivative", np.arange(len(feedthrough)))
    result.add(f"{group}/D", feedthrough[0], ("output", "input"))
    result.add(f"{group}/feedthrough", feedthrough, ("derivative", "output", "input"))


def _add_frequency_response(result: Result, reduced: ReducedGraph, omega: NDArray[np.float64]) -> None:
    from dynid.bondgraph.frequency import frequency_response

    group = "bond_graph/frequency_response"
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/output", [str(port) for port in reduced.outputs])
    result.add_axis(f"{group}/input", list(reduced.inputs))
    result.add(f"{group}/response", frequency_response(reduced, omega), ("omega", "output", "input"))


def _driven_by(system: StateSpace, columns: list[int]) -> StateSpace:
    """Return the system with one input for each signal (several may drive the same source)."""
    return replace(
        system,
        B=system.B[:, columns],
        D=system.D[:, columns],
        higher=tuple(matrix[:, columns] for matrix in system.higher),
        inputs=(),
        input_units=(),
    )


def _add_time_response(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Drive the state equations by the signals, and by stored energy as impulses (eqs 13 to 16)."""
    from dynid.bondgraph.state_space import state_space
    from dynid.lti.propagate import response
    from dynid.lti.signals import Impulse

    assert analysis.times is not None
    system = state_space(reduced, tuple(analysis.initial))
    driven = [*analysis.signals, *((f"initial:{name}", Impulse(value)) for name, value in analysis.initial.items())]
    columns = [system.inputs.index(name) for name, _ in driven]
    solved = response(_driven_by(system, columns), [signal for _, signal in driven], analysis.times)
    sources = np.zeros((len(analysis.times), len(reduced.inputs)))
    for place, (name, _) in enumerate(analysis.signals):
        sources[:, reduced.inputs.index(name)] += solved.inputs[:, place]
    group = "bond_graph/time_response"
    result.add_axis(f"{group}/time", analysis.times, "s")
    result.add_axis(f"{group}/output", list(system.outputs))
    result.add_axis(f"{group}/source", list(reduced.inputs))
    result.add(f"{group}/response", solved.outputs, ("time", "output"))
    result.add(f"{group}/input", sources, ("time", "source"))
    result.annotate(group, states=", ".join(system.states), order=len(system.states))
