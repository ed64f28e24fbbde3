"""Results channel by channel, from transfer functions to hidden modes; the verdict on the whole system."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.analysis_request import Analysis, EngineChoice, FormulaRequest, choose_engine
from dynid.bondgraph.exact_engine import ExactEngine, TransferFunction
from dynid.bondgraph.formula_printers import LATEX, TEXT
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph, parts_without_output, separate_parts
from dynid.errors import Undecided
from dynid.lti.certified_roots import CertifiedRoot, certified_roots
from dynid.lti.stability import SidedRoot, TransferProperties, Verdict, combined, no_solution, verdict
from dynid.progress import tracked
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.bondgraph.floating.float_engine import FloatEngine


class _ChannelEngine(Protocol):
    """An engine, as far as results of channels need it; one of samples as well."""

    @property
    def reduced(self) -> ReducedGraph:
        """The graph."""

    def channel(self, channel: Channel, /) -> Any:
        """Return the transfer function of a channel."""

    def hidden_modes(self, channel: Channel, /) -> Sequence[SidedRoot]:
        """Return the natural modes that cancel in a channel."""


# --- formulas -------------------------------------------------------------------------------------


def _add_formulas(result: Result, reduced: ReducedGraph, request: FormulaRequest | None) -> None:
    """Add the formulas of every channel.

    A formula of a page is the attribute `symbolic` (and `latex`) of its channel. On demand a channel has the
    datasets `program` and `program_latex` (named assignments, none expanded), and where it is to be expanded
    `symbolic_numerator` and `symbolic_denominator`, however long.
    """
    from dynid.bondgraph.formulas.symbolic import plain, quotient, written
    from dynid.bondgraph.formulas.transfer import expanded, nested, readable

    for channel, (numerator, denominator) in readable(reduced).items():
        latex, rank = written(numerator, LATEX)
        if denominator != 1:
            latex, rank = LATEX.quotient((latex, rank), written(denominator, LATEX))
        result.annotate(_group(channel), symbolic=quotient(numerator, denominator)[0], latex=latex)
    if request is None:
        return
    for channel, register in reduced.channels().items():
        for name, hand in (("program", TEXT), ("program_latex", LATEX)):
            result.add(f"{_group(channel)}/{name}", nested(reduced, [register], hand))
    if request.form == "expanded":
        for channel, polynomials in expanded(reduced, request.terms).items():
            for name, polynomial in zip(("numerator", "denominator"), polynomials, strict=True):
                result.add(f"{_group(channel)}/symbolic_{name}", plain(polynomial), terms=len(polynomial))


def _group(channel: Channel) -> str:
    return f"bond_graph/transfer_function/{channel[0]}/{channel[1]}"


# --- channels -------------------------------------------------------------------------------------


#: Properties of a channel that are one value.
_PROPERTIES = (
    "relative_degree",
    "dc_gain",
    "high_frequency_gain",
    "stable",
    "stability",
    "minimum_phase",
    "order",
    "zero_stability",
)
#: Those that have the unit of the channel.
_GAINS = frozenset({"dc_gain", "high_frequency_gain"})


def add_channels(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Add the requested results of every channel, from the requested engine or the one that fits the size.

    Raises `Undecided` where the floating-point engine was asked for and cannot decide.
    """
    choice = choose_engine(reduced, analysis)
    try:
        channels = _channels(reduced, analysis, choice)
    except Undecided as error:
        if choice.forced:
            raise
        choice = EngineChoice("exact", f"{error.problem}; the exact engine decides")
        channels = _channels(reduced, analysis, choice)
    result.merge(channels)
    about = {"engine": choice.engine, "engine_reason": choice.reason, "engine_limits": choice.limits}
    result.annotate("bond_graph", **about, reading=analysis.reading)


def _channels(reduced: ReducedGraph, analysis: Analysis, choice: EngineChoice) -> Result:
    result = Result("bond-graph")
    for channel in reduced.channels():
        units = {"unit": unit} if (unit := reduced.units.of_channel(*channel)) else {}
        result.annotate(_group(channel), engine=choice.engine, reading=analysis.reading, **units)
    if "transfer_function" in analysis.results:
        nested = FormulaRequest() if choice.engine == "symbolic" else None
        _add_formulas(result, reduced, analysis.formulas or nested)
    if choice.engine == "symbolic":
        return result
    engine: ExactEngine | FloatEngine
    if choice.engine == "exact":
        engine = ExactEngine(reduced)
    else:
        from dynid.bondgraph.floating.float_engine import FloatEngine

        engine = FloatEngine(reduced)
    for channel in tracked(reduced.channels(), "zeros and poles of channel"):
        add_channel(result, engine, channel, analysis.results)
    if "properties" in analysis.results and analysis.opened is None:
        add_system(result, _graph_verdict(engine))
    return result


def add_channel(result: Result, engine: _ChannelEngine, channel: Channel, asked: frozenset[str]) -> None:
    """Add the requested results of one channel."""
    transfer, group = engine.channel(channel), _group(channel)
    if "transfer_function" in asked:
        if isinstance(transfer, TransferFunction):
            add_coefficients(result, group, transfer)
        else:
            result.add(f"{group}/gain", transfer.gain)
    for name in ("zeros", "poles"):
        if name in asked:
            roots = transfer.zeros if name == "zeros" else transfer.poles
            estimated = not isinstance(transfer, TransferFunction)
            add_roots(result, group, name, roots, estimated=estimated)
    if "properties" in asked:
        _add_properties(result, channel, transfer, engine.reduced)
    if asked & {"properties", "hidden_modes"}:
        _add_hidden_modes(result, engine, channel, explained="hidden_modes" in asked)


def _add_properties(
    result: Result, channel: Channel, transfer: TransferProperties, reduced: ReducedGraph
) -> None:
    """Add the properties; a Boolean that is undecided is left out, and its verdict says so."""
    group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
    units = reduced.units.of_channel(*channel)
    for path, name in ((f"{group}/{name}", name) for name in _PROPERTIES):
        if result.wants(path) and (value := getattr(transfer, name)) is not None:
            result.add(path, value, units=units if name in _GAINS else "")
    result.add(f"{group}/prototype", reduced.reductions[channel[0]].prototype.letter)
    modal = ("natural_frequency", "damping_ratio", "time_constant")
    if any(result.wants(f"{group}/{name}") for name in modal):
        poles = each(transfer.poles, "value", np.complex128)
        size, damping = natural_frequencies(poles)
        result.add_axis(f"{group}/mode", np.arange(1, len(size) + 1))
        result.add(f"{group}/natural_frequency", size, ("mode",), "rad/s")
        result.add(f"{group}/damping_ratio", damping, ("mode",))
        result.add(f"{group}/time_constant", time_constants(poles), ("mode",), "s")


def natural_frequencies(poles: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return |s| and -Re s / |s| of the poles, a conjugate pair once; a pole at 0 has the damping ratio 0."""
    upper = poles[poles.imag >= 0]
    size = np.abs(upper)
    return size, -upper.real / np.where(size > 0, size, 1.0) + 0.0  # + 0: no -0


def time_constants(poles: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return -1/Re s of the poles, a conjugate pair once: negative for growth, inf on the axis."""
    rates = -poles[poles.imag >= 0].real
    with np.errstate(over="ignore"):
        return np.asarray(np.divide(1.0, rates, out=np.full(len(rates), np.inf), where=rates != 0))


def _add_hidden_modes(result: Result, engine: _ChannelEngine, channel: Channel, *, explained: bool) -> None:
    """Add the natural modes that cancel in the channel; their causes where requested and known."""
    group = f"bond_graph/properties/{channel[0]}/{channel[1]}"
    if not result.wants(f"{group}/hidden_modes"):
        return
    if not (explained and isinstance(engine, ExactEngine)):
        values = each(engine.hidden_modes(channel), "value", np.complex128)
        result.add_numbered(f"{group}/hidden_mode", values, "rad/s")
        return
    from dynid.bondgraph.hidden_modes import hidden_modes

    hidden = hidden_modes(engine.reduced, channel, engine.hidden_polynomial(channel))
    modes = [mode for mode in hidden for _ in range(mode.root.multiplicity)]
    values = np.array([mode.root.value for mode in modes], dtype=complex)
    result.add_numbered(f"{group}/hidden_mode", values, "rad/s")
    result.add(f"{group}/hidden_mode_cause", [mode.cause for mode in modes], ("hidden_mode",))
    result.add(f"{group}/hidden_mode_elements", [mode.elements for mode in modes], ("hidden_mode",))


def add_coefficients(result: Result, group: str, transfer: TransferFunction) -> None:
    """Add numerator and denominator in descending powers, denominator monic."""
    for name, coefficients in zip(("numerator", "denominator"), transfer.coefficients(), strict=True):
        result.add_axis(f"{group}/{name}_power", np.arange(len(coefficients))[::-1])
        result.add(f"{group}/{name}", coefficients, (f"{name}_power",))


def note_measuring_integrals(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Say of hidden modes at 0 where they are of integrals that dynid adds to measure for a loop."""
    from dynid.bondgraph.controller_circuits import close_loops
    from dynid.bondgraph.hidden_modes import conserved

    assert analysis.opened is not None
    groups = {channel: f"bond_graph/properties/{channel[0]}/{channel[1]}" for channel in reduced.channels()}
    at_zero = {
        channel: group
        for channel, group in groups.items()
        if f"{group}/hidden_modes" in result and (result[f"{group}/hidden_modes"].data == 0).any()
    }
    integrals = close_loops(analysis.opened, analysis.loops).integrals if at_zero else {}
    # Channels of one part of the graph and one input have the same [A, b].
    dependent_states: dict[tuple[frozenset[str], str], list[str]] = {}
    for (output, source), group in at_zero.items() if integrals else ():
        key = frozenset(reduced.reductions[output].junctions), source
        if key not in dependent_states:
            dependent_states[key] = conserved(reduced, (output, source), integrals)
        measured = dict.fromkeys(str(integrals[name]) for name in dependent_states[key])
        if measured:
            note = (
                f"0: the integral that measures {', '.join(measured)} for a loop differs by a constant from "
                "states of the graph; no fault of the graph"
            )
            result.annotate(group, hidden_mode_note=note)


# --- roots -----------------------------------------------------------------------------------------


def roots_of(polynomial: Any) -> tuple[CertifiedRoot, ...]:
    """Return certified roots, cached: at a port those of one polynomial are requested repeatedly."""
    from flint import fmpz_poly

    polynomial = polynomial if isinstance(polynomial, fmpz_poly) else polynomial.numer()
    return _roots(tuple(int(c) for c in (polynomial // polynomial.content()).coeffs()))


@lru_cache(maxsize=32)
def _roots(coefficients: tuple[int, ...]) -> tuple[CertifiedRoot, ...]:
    from flint import fmpz_poly

    return certified_roots(fmpz_poly(list(coefficients)))


def add_roots(
    result: Result,
    group: str,
    name: str,
    roots: Sequence[SidedRoot],
    *,
    estimated: bool = False,
    note: str = "",
) -> None:
    """Add roots, each as often as its multiplicity says, with certified error bounds or with estimates.

    `name`: the plural, `zeros` has the axis `zero`. `estimated`:
    whether their errors are estimates, of roots that have residuals, too. `note`: which roots they are.
    """
    axis = name[:-1]
    about = {"note": note} if note else {}
    result.add_numbered(f"{group}/{axis}", each(roots, "value", np.complex128), "rad/s", **about)
    error = f"{group}/{axis}_error_{'estimate' if estimated else 'bound'}"
    if result.wants(error):
        result.add(error, each(roots, "radius", np.float64), (axis,), "rad/s")
    if estimated:
        result.add(f"{group}/{axis}_residual", each(roots, "residual", np.float64), (axis,))


def each(roots: Sequence[SidedRoot], what: str, dtype: type) -> NDArray[Any]:
    """Return an attribute of roots, each as often as its multiplicity says."""
    return np.array([getattr(root, what) for root in roots for _ in range(root.multiplicity)], dtype=dtype)


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


def _graph_verdict(engine: ExactEngine | FloatEngine) -> Verdict:
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
        return _graph_verdict(ExactEngine(reduced))
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
