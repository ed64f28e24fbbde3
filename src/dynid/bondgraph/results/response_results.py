"""State equations, frequency response, time response and zero-input response of a graph in a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bondgraph.analysis_request import modelled_storages
from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.graph import ACTIVATED, Port
from dynid.bondgraph.reduced_graph import ReducedGraph, characteristic_polynomials
from dynid.bondgraph.reduction.network import STORED
from dynid.bondgraph.results.prototype_results import add_ratio
from dynid.defaults import PEAKS_NEAR_POLES
from dynid.result import Result, common_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.lti.delay_system import DelayedResponse, DelaySystem
    from dynid.lti.generator import Signal
    from dynid.lti.peaks import ResponseFunction
    from dynid.lti.time_response import TimeResponse


# --- state equations and responses ----------------------------------------------------------------


_TIME = "bond_graph/time_response"
_SHARED = (
    "some storage elements depend on others or on a source: stored energy given to one of them is shared at "
    "t = 0+, as in an impact (Park & Kim 1997, eqs 13 to 16), so that the response starts elsewhere"
)


_FRACTIONAL = "the last inputs are the last outputs, each by its delay before"
_SHIFTED = (
    "an input's derivative enters the state equations: the states of the matrices are these variables less a "
    "multiple of the input, so that it does not"
)


def add_state_space(result: Result, reduced: ReducedGraph, delays: Sequence[Fraction] = ()) -> None:
    """Add the state equations; `feedthrough` holds D and, where improper, the matrices on u', u'', ….

    With delays it is a linear fractional form: the last inputs are the last outputs, each a delay before.
    """
    from dynid.bondgraph.graph_state_space import state_space
    from dynid.bondgraph.state_equations import state_equations

    system, group = state_space(reduced), "bond_graph/state_space"
    written = state_equations(reduced, system.states)
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
    if delays:
        result.add_axis(f"{group}/delay", [float(delay) for delay in delays], "s", note=_FRACTIONAL)
    result.add(f"{group}/equations", np.array(written.states, dtype=object), ("rate_of",))
    result.add(f"{group}/output_equations", np.array(written.outputs, dtype=object), ("output",))
    if written.definitions:
        result.add_numbered(f"{group}/definition", written.definitions)
    if any("(d" in equation for equation in written.states):
        result.annotate(group, note=_SHIFTED)


def add_frequency_response(
    result: Result,
    reduced: ReducedGraph,
    omega: NDArray[np.float64],
    evaluate: ResponseFunction | None = None,
) -> None:
    """Add T(j omega) of every channel, and the largest magnitude over the band of the frequencies.

    `evaluate` gives the responses where they are not those of the graph (loops with delays).
    """
    from dynid.bondgraph.graph_response import frequency_response
    from dynid.lti.peaks import add_peaks

    group, evaluate = "bond_graph/frequency_response", evaluate or partial(frequency_response, reduced)
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/output", [str(port) for port in reduced.outputs])
    result.add_axis(f"{group}/input", list(reduced.inputs))
    units = reduced.units
    unit_rows = [[units.of_channel(port, source) for source in reduced.inputs] for port in reduced.outputs]
    response, unit = evaluate(omega), common_unit(chain.from_iterable(unit_rows))
    result.add(f"{group}/response", response, ("omega", "output", "input"), unit)
    if any(map(any, unit_rows)):
        result.add(f"{group}/unit", np.array(unit_rows, dtype=object), ("output", "input"))
    # responses may be large near the frequencies of the poles
    prefix = "bond_graph/transfer_function/"
    known_poles = [
        variable.data
        for path, variable in result.items()
        if path.startswith(prefix) and path.endswith("/poles")
    ]
    if (
        not known_poles
        and 0 < modelled_storages(reduced) <= PEAKS_NEAR_POLES.value
        and _may_resonate(reduced)
    ):
        from dynid.bondgraph.graph_state_space import state_space

        known_poles = [np.linalg.eigvals(state_space(reduced).A)]
    poles = np.concatenate([np.zeros(0, dtype=complex), *known_poles])
    real, imag = np.abs(poles.real), np.abs(poles.imag)
    resonant = real < imag
    apart, sums = (imag - real)[resonant], (imag + real)[resonant]  # whose product may overflow
    near = np.concatenate([imag, np.sqrt(apart) * np.sqrt(sums)])
    add_peaks(result, "bond_graph", evaluate, near)


def _may_resonate(reduced: ReducedGraph) -> bool:
    """Test whether poles may be complex: not of positive R and one kind of storage without gyrators."""
    nodes = reduced.graph.nodes.values()
    kinds = {node.type for node in nodes}
    return bool({"I", "C"} <= kinds or kinds & {"GY", ACTIVATED}) or any(
        node.value is not None and node.value < 0 for node in nodes
    )


def add_time_response(
    result: Result,
    reduced: ReducedGraph,
    times: NDArray[np.float64],
    signals: Sequence[tuple[str, Signal]],
    initial: Mapping[str, float | Fraction],
    *,
    apart: bool = False,
    storages: int,
    delayed: DelaySystem | None = None,
) -> None:
    """Add the response to signals, and to stored energy as equivalent sources (eqs 13 to 16).

    The system is linear: both are computed alone and superposed. Where both stand, `zero_state` is the
    response to the signals from rest, `zero_input` that to what is stored. Responses to single sources that
    are apart are along a third axis, `source`.

    `signals`: pairs of an input and what drives it. `initial`: the flow of an I or the effort of a C at t =
    0, by name. `apart`: True: each input has one signal, nothing is stored, and the responses are not added.
    `storages`: how many the graph has. `delayed`: the graph with the delays of its loops; default: none.
    """
    from dynid.arrays import guarded
    from dynid.bondgraph.graph_state_space import rational_matrices, state_space
    from dynid.lti.refined_response import refined_response
    from dynid.lti.signals import Impulse
    from dynid.lti.time_response import impulsive_outputs

    system = state_space(reduced, tuple(initial)) if delayed is None else delayed.lft
    stored = [(f"{STORED}{name}", Impulse(float(value))) for name, value in initial.items()]
    driven: dict[str, Sequence[tuple[str, Signal]]] = {"zero_state": signals, "zero_input": stored}
    if apart:
        driven = {name: [(name, signal)] for name, signal in signals}
    solved: dict[str, TimeResponse | DelayedResponse] = {}
    responses: list[DelayedResponse] = []
    doubts = [0.0]  # the parts of an output that are in doubt
    for signal, driving in driven.items():
        if driving or not any(driven.values()):
            names, shapes = [name for name, _ in driving], [signal for _, signal in driving]
            rational = partial(rational_matrices, reduced, tuple(initial), names)
            with guarded("the time response", names=("analysis.time",)):
                if delayed is not None:
                    solved[signal] = response = delayed.with_inputs(names).response(shapes, times)
                    responses.append(response)
                    continue
                solved[signal], doubt = refined_response(system.with_inputs(names), shapes, times, rational)
            doubts.append(doubt)
    sources = np.zeros((len(times), len(reduced.inputs)))
    if apart:
        outputs = {"response": np.stack([solved[name].outputs for name in reduced.inputs], axis=-1)}
        for column, name in enumerate(reduced.inputs):
            sources[:, column] = solved[name].inputs[:, 0]
    else:
        outputs = {"response": np.asarray(sum(response.outputs for response in solved.values()))}
        outputs |= {name: alone.outputs for name, alone in solved.items()} if len(solved) > 1 else {}
        for column, (name, _) in enumerate(signals):
            sources[:, reduced.inputs.index(name)] += solved["zero_state"].inputs[:, column]
    _add_courses(result, reduced, times, outputs, sources)
    result.annotate(_TIME, states=", ".join(system.states), order=len(system.states))
    notes = [_SHARED] if initial and len(system.states) < storages else []
    all_signals = [*signals, *stored]
    if delayed is not None:
        impulsive = np.any([response.impulsive for response in responses], axis=0)
        error = np.sum([response.error for response in responses], axis=0)
        result.add(f"{_TIME}/error_estimate", error, ("output",), result[f"{_TIME}/response"].units)
        result.annotate(_TIME, segments=sum(response.segments for response in responses))
    else:
        shapes = [signal for _, signal in all_signals]
        alone = system.with_inputs([name for name, _ in all_signals])
        impulsive = impulsive_outputs(alone, shapes, float(times[-1]))
    names = [str(port) for port, has_impulse in zip(reduced.outputs, impulsive, strict=True) if has_impulse]
    if names:
        where = "where an input, or a derivative of one, jumps"
        verb = "has" if len(names) == 1 else "have"
        notes.append(f"{', '.join(names)} {verb} {where} a Dirac impulse, which is not shown")
    if max(doubts):
        notes.append(f"rounding moves an output by about {max(doubts):.1g} of its largest value")
    if notes:
        result.annotate(_TIME, note="; ".join(notes))


def _add_courses(
    result: Result,
    reduced: ReducedGraph,
    times: NDArray[np.float64],
    outputs: Mapping[str, NDArray[np.float64]],
    sources: NDArray[np.float64],
) -> None:
    """Add the histories of outputs (times x outputs, or times x outputs x inputs) and sources, with units."""
    unit_texts = [reduced.units.of_output(port) for port in reduced.outputs]
    driving = [reduced.units.of_input(name) for name in reduced.inputs]
    result.add_axis(f"{_TIME}/time", times, "s")
    result.add_axis(f"{_TIME}/output", [str(port) for port in reduced.outputs])
    result.add_axis(f"{_TIME}/source", list(reduced.inputs))
    for name, values in outputs.items():
        dims = ("time", "output", "source")[: values.ndim]
        result.add(f"{_TIME}/{name}", values, dims, common_unit(unit_texts))
    result.add(f"{_TIME}/input", sources, ("time", "source"), common_unit(driving))
    if any(unit_texts):
        result.add(f"{_TIME}/unit", unit_texts, ("output",))
    if any(driving):
        result.add(f"{_TIME}/input_unit", driving, ("source",))


# --- zero-input response --------------------------------------------------------------------------


def add_zero_input(result: Result, reduced: ReducedGraph, initial: Mapping[str, float | Fraction]) -> None:
    """Add the Laplace transform of every output, all inputs zero, over the polynomial of the natural modes.

    Common factors stay: a numerator that shares a root with the natural modes does not excite that mode.

    `initial`: the flow of an I or the effort of a C at t = 0, by name.
    """
    for port, output in zero_input_outputs(reduced, initial).items():
        add_ratio(result, f"bond_graph/zero_input/{port}", output)
    stored = ", ".join(f"{name} = {float(value):g}" for name, value in initial.items())
    result.annotate("bond_graph/zero_input", initial=stored)


def zero_input_outputs(
    reduced: ReducedGraph, initial: Mapping[str, float | Fraction]
) -> dict[Port, TransferFunction]:
    """Return every output's transform as numerator over natural polynomial, not in lowest terms.

    The displacement or momentum of what is no storage has a factor s more below: it integrates.
    """
    from flint import fmpq, fmpq_poly

    lifted: Any = fmpq_poly if reduced.field is None else lambda polynomial: polynomial
    stored, natural = reduced.stored(initial), characteristic_polynomials(reduced)
    ratios = reduced.rational(stored.values())
    outputs = {}
    for port in reduced.outputs:
        answers = {name: TransferFunction.over_field(ratios[stored[port, name]]) for name in initial}
        below = lifted(natural[port])
        remainders = [below % lifted(answer.denominator) for answer in answers.values()]
        if any(remainder.degree() >= 0 for remainder in remainders):
            below = below * fmpq_poly([0, 1])  # an answer integrates it
        above = 0 * below
        for name, answer in answers.items():
            value = Fraction(initial[name])
            share = lifted(answer.numerator) * (below // lifted(answer.denominator))
            above += fmpq(value.numerator, value.denominator) * share
        if reduced.field is None:
            above, below = above.numer(), below.numer() * above.denom()
        outputs[port] = TransferFunction(above, below)
    return outputs
