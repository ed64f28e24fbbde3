"""The operating point of a graph with laws: its variables, all equilibria found, the slopes of the laws.

Its nonlinear response starts from an equilibrium and is given as deviations from it. The state equations are
integrated by LSODA (`scipy.integrate`; Petzold 1983: backward differences where they are stiff, else Adams'
methods), twice at different tolerances: their difference estimates the error.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from dynid.arithmetic.numbers import OutOfRangeError
from dynid.bondgraph.analysis_request import Analysis
from dynid.bondgraph.graph import ONE_PORTS, GraphUnits, Port, unit_quotient
from dynid.bondgraph.operating_point.answer_history import History, delayed_borders
from dynid.bondgraph.operating_point.closed_laws import RestingGraph, resting_graph
from dynid.bondgraph.operating_point.element_laws import LawGraph
from dynid.bondgraph.operating_point.equations import LawEquations
from dynid.bondgraph.operating_point.equilibrium import OperatingPoint
from dynid.bondgraph.operating_point.linearisation import Linearisation
from dynid.bondgraph.operating_point.nonlinear_dynamics import LawDynamics
from dynid.errors import NumericalError
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.arrays import Array
    from dynid.bondgraph.sampled_loops import SampledLoops
    from dynid.lti.generator import Signal


GROUP = "bond_graph/operating_point"
_TIME = "bond_graph/time_response"
_NUMERICAL = (
    "linear results are exact for the slopes as rounded to doubles; roots that cancel only where slopes are "
    "equal are found to rounding, not exactly"
)
_STABILITY = {1: "stable", 0: "neutral", -1: "unstable"}


def add_operating_point(result: Result, linear: Linearisation) -> None:
    """Add the operating point."""
    point, equations = linear.point, linear.point.equations
    units = GraphUnits(equations.model.graph)
    ports = list(_variables(point))
    columns = [equations.column(port) for port in ports]
    determined = [bool(point.equilibria) or column not in point.solution.free for column in columns]
    result.add_axis(f"{GROUP}/variable", [str(port) for port in ports])
    result.add(f"{GROUP}/value", np.where(determined, point.solution.z[columns], np.nan), ("variable",))
    unit_texts = [units.of_output(port) for port in ports]
    if any(unit_texts):
        result.add(f"{GROUP}/unit", unit_texts, ("variable",))
    nodes = equations.model.graph.nodes
    sources = [name for name, node in nodes.items() if node.type in ("Se", "Sf")]
    result.add_axis(f"{GROUP}/input", sources)
    input_values = [
        point.solution.z[equations.column(Port(name, "e" if nodes[name].type == "Se" else "f"))]
        for name in sources
    ]
    result.add(f"{GROUP}/input_value", np.array(input_values, dtype=float), ("input",))
    result.add(f"{GROUP}/residual", point.solution.residual)
    result.add(f"{GROUP}/condition", point.solution.condition)
    if point.equilibria:
        result.add(f"{GROUP}/chosen", point.number)
        result.add_axis(f"{GROUP}/equilibrium", np.arange(1, len(point.equilibria) + 1))
        table = np.array([equilibrium.z[columns] for equilibrium in point.equilibria])
        result.add(f"{GROUP}/equilibria", table, ("equilibrium", "variable"))
        result.add(f"{GROUP}/stability", [_STABILITY[verdict] for verdict in point.stable], ("equilibrium",))
    _add_slopes(result, linear, units)
    about = (
        f"{len(point.equilibria)} {'equilibrium' if len(point.equilibria) == 1 else 'equilibria'} found"
        if point.equilibria
        else "given"
    )
    result.annotate(GROUP, status=about, note=_NUMERICAL)
    if linear.flat:
        result.annotate(GROUP, flat=", ".join(linear.flat))


def _variables(point: OperatingPoint) -> Iterator[Port]:
    """Yield efforts and flows of all elements, states, and what else laws depend on."""
    equations = point.equations
    seen = dict.fromkeys(
        Port(name, quantity)
        for name, node in equations.model.graph.nodes.items()
        if node.type in ONE_PORTS
        for quantity in ("e", "f")
    )
    seen |= dict.fromkeys(equations.states)
    yield from dict.fromkeys([*seen, *(port for law in equations.model.laws.values() for port in law.ports)])


def _add_slopes(result: Result, linear: Linearisation, units: GraphUnits) -> None:
    """Add the derivatives of what laws give by every variable."""
    equations = linear.point.equations
    rows = [(law, column, slope) for law in linear.slopes for column, slope in law.slopes.items()]
    if not rows:
        return
    outs = [equations.port(law_slope.row.out) for law_slope, _, _ in rows]
    bys = [
        dict(zip(law_slope.row.arguments, equations.model.laws[law_slope.row.node].ports, strict=True)).get(
            column, equations.port(column)
        )
        for law_slope, column, _ in rows
    ]
    result.add_axis(f"{GROUP}/slope", [f"d {out} / d {by}" for out, by in zip(outs, bys, strict=True)])
    result.add(
        f"{GROUP}/slope_value",
        np.array([law_slope.row.sign * slope for law_slope, _, slope in rows]),
        ("slope",),
    )
    pairs = [(units.of_output(out), units.of_output(by)) for out, by in zip(outs, bys, strict=True)]
    unit_texts = [unit_quotient(above, below) if above and below else "" for above, below in pairs]
    if any(unit_texts):
        result.add(f"{GROUP}/slope_unit", unit_texts, ("slope",))


def add_nonlinear_response(result: Result, analysis: Analysis) -> None:
    """Add the nonlinear response beside the linear one, and how far they differ.

    Both are deviations from the operating point. `nonlinear_deviation` is their largest difference, beside
    the largest value of the linear response.
    """
    assert analysis.times is not None
    point = None if analysis.linearisation is None else analysis.linearisation.point
    times, initial = analysis.times, analysis.initial
    linear = result[f"{_TIME}/response"]
    try:
        if analysis.sampled_loops is not None:
            outputs, error = _sampled_response(analysis, analysis.sampled_loops)
        elif analysis.apart:  # in the order of the linear responses
            signals = {name: (name, signal) for name, signal in analysis.signals}
            sources = [str(name) for name in result[f"{_TIME}/source"].data]
            resting = _resting(analysis)
            alone = [_nonlinear_response(resting, times, [signals[name]], initial) for name in sources]
            outputs = np.stack([deviations for deviations, _ in alone], axis=-1)
            error = max(error for _, error in alone)
        else:
            outputs, error = _nonlinear_response(_resting(analysis), times, analysis.signals, initial)
    except NumericalError as failure:
        result.annotate(_TIME, nonlinear=f"left out: {failure.problem}")
        return
    size = np.abs(linear.data).max(axis=0)
    size[size == 0] = np.abs(outputs).max(axis=0)[size == 0]
    size[size == 0] = 1.0
    deviation = np.abs(outputs - linear.data).max(axis=0) / size
    result.add(f"{_TIME}/nonlinear", outputs, linear.dims, linear.units)
    if point is not None:
        states = point.equations.states  # an integral that is none of them counts from t = 0
        values = [
            point.value(port) if port.quantity in "ef" or Port(port.node, port.quantity) in states else 0.0
            for port in analysis.law_outputs
        ]
        result.add(f"{_TIME}/operating_value", np.array(values), ("output",), linear.units)
    result.add(f"{_TIME}/nonlinear_deviation", deviation, linear.dims[1:])
    if analysis.sampled_loops is None:
        result.annotate(_TIME, nonlinear_tolerance=CLOSED[0] if analysis.loops else TOLERANCE)
    result.annotate(_TIME, nonlinear_error=error)


def _sampled_response(analysis: Analysis, loops: SampledLoops) -> tuple[Array, float]:
    """Return the response of sampled controllers with limits, which is exact, and its estimated error."""
    from dynid.bondgraph.sampled_response import sampled_system
    from dynid.lti.signals import Impulse

    assert analysis.times is not None
    initial = analysis.initial
    system, _ = sampled_system(loops, analysis.inputs, analysis.outputs, tuple(initial), limited=True)
    signals = [*analysis.signals, *((f"initial:{name}", Impulse(float(e))) for name, e in initial.items())]
    groups = [[signal] for signal in signals] if analysis.apart else [signals]
    responses = []
    for group in groups:
        names, shapes = [name for name, _ in group], [signal for _, signal in group]
        responses.append(system.with_inputs(names).response(shapes, analysis.times))
    error = max(float((response.error / _sizes(response.outputs)).max()) for response in responses)
    outputs = [response.outputs for response in responses]
    return np.stack(outputs, axis=-1) if analysis.apart else outputs[0], error


def _sizes(outputs: Array) -> Array:
    """Return the largest magnitude of each output, 1 where it is zero."""
    size = np.abs(outputs).max(axis=0)
    return np.where(size == 0, 1.0, size)


def _resting(analysis: Analysis) -> RestingGraph:
    """Return the graph of the nonlinear response at rest: with its laws, and loops with limits closed."""
    if analysis.feedback is not None:
        raise NumericalError("gains of states are closed around the linearisation")
    if analysis.linearisation is None:
        assert analysis.opened is not None
        flat = LawGraph(analysis.opened_as_read, {})
        return resting_graph(flat, None, analysis.loops, analysis.law_outputs)
    point = analysis.linearisation.point
    if not point.equilibria:
        raise NumericalError("the point is given, and not solved for as an equilibrium")
    return resting_graph(point.equations.model, point, analysis.law_loops, analysis.law_outputs)


#: Relative tolerance of the response, and that of the one it is compared with; finer ones of closed loops,
#: whose controllers add up errors.
TOLERANCE, COARSE = 1e-8, 1e-6
CLOSED = 1e-10, 1e-8
#: Largest number of variables of a graph whose nonlinear response is computed.
_MAX_VARIABLES = 600
#: Most evaluations of the equations for a response, and as many more for every sample.
_MOST_EVALUATIONS, _MOST_BY_SAMPLE = 20_000, 20


def _nonlinear_response(
    resting: RestingGraph,
    times: Array,
    signals: Sequence[tuple[str, Signal]],
    initial: Mapping[str, float | Fraction],
) -> tuple[Array, float]:
    """Return deviations of outputs from an equilibrium (times x outputs), and the estimate of their error."""
    if any(signal.jump for _, signal in signals):
        raise NumericalError("an impulse has no nonlinear response; give an impact")
    run = _Run(resting, times, signals, initial)
    fine, coarse = map(run.integrated, CLOSED if resting.closed else (TOLERANCE, COARSE))
    return fine, float((np.abs(fine - coarse) / _sizes(fine)).max(initial=0.0))


class _Run:
    """The integration of one response."""

    def __init__(
        self,
        resting: RestingGraph,
        times: Array,
        signals: Sequence[tuple[str, Signal]],
        initial: Mapping[str, float | Fraction],
    ) -> None:
        self._times, self._signals = times, signals
        model, outputs, inputs = resting.model, resting.outputs, resting.inputs
        self._equations = equations = LawEquations(model, [*outputs, *resting.integrals])
        if equations.size > _MAX_VARIABLES:
            raise NumericalError(f"the graph has {equations.size} variables, more than {_MAX_VARIABLES}")
        self._delayed = resting.delayed
        late = [source for source, _, _ in resting.delayed]
        self._sources = tuple(dict.fromkeys([*inputs, *(name for name, _ in signals), *late]))
        self._rest = np.array([float(inputs.get(name, 0)) for name in self._sources])
        self._first = 2 * len(model.graph.bonds)
        z = self._point(resting)
        self._dynamics = LawDynamics(equations, z, self._sources)
        self._c = self._dynamics.at_point(self._rest)
        self._columns = [equations.column(port) for port in outputs]
        self._answers = [equations.column(port) for _, port, _ in resting.delayed]
        self._history = History(len(self._answers))
        self._z, self._x = z, self._with_energy(z, initial)
        self._check_causality()

    def _point(self, resting: RestingGraph) -> Array:
        """Return the variables at the equilibrium; integrals that only outputs need start at zero."""
        equations = self._equations
        z, states = np.zeros(equations.size), set(equations.states)
        for port, value in resting.values.items():
            if port.quantity in "ef" or port in states:
                z[equations.column(port)] = value
        if resting.bonds is not None:
            z[: self._first] = resting.bonds
            return z
        dynamics = LawDynamics(equations, z, self._sources)
        known = [equations.column(port) for port in resting.values if port.quantity in "ef"]
        c = dynamics.unknowns(dynamics.nearest(z, known, self._rest), z[self._first :], self._rest)
        z[: self._first] = dynamics.efforts_and_flows(c, self._rest)
        return z

    def _with_energy(self, z: Array, initial: Mapping[str, float | Fraction]) -> Array:
        """Return the states at t = 0, with the stored energy added."""
        x = z[self._first :].copy()
        for name, value in initial.items():
            kind = self._equations.model.graph.nodes[name].type
            state = Port(name, "p" if kind == "I" else "q")
            out = self._equations.column(Port(name, "f" if kind == "I" else "e"))
            index = self._equations.states.index(state)
            x[index] = self._dynamics.state_with(out, self._first + index, z, float(value))
        return x

    def _check_causality(self) -> None:
        """Raise where sources or stored energy meet storages in derivative causality."""
        N, driven = self._dynamics.constraints(self._c, self._z[self._first :], self._rest)
        if not N.shape[1]:
            return
        moving = {*(name for name, _ in self._signals), *(source for source, _, _ in self._delayed)}
        columns = [k for k, name in enumerate(self._sources) if name in moving]
        if np.abs(driven[:, columns]).max(initial=0.0) > 1e-9:
            raise NumericalError(
                "a source drives a storage element in derivative causality, whose response needs the rate of "
                "the source; put a resistance or a storage element between"
            )
        if (self._x != self._z[self._first :]).any():
            raise NumericalError("stored energy is given to storage elements in derivative causality")

    def integrated(self, tolerance: float) -> Array:
        """Return the deviations of the outputs (times x outputs)."""
        from scipy.integrate import solve_ivp

        dynamics, x = self._dynamics, self._x.copy()
        self._history = History(len(self._answers))
        left = _MOST_EVALUATIONS + _MOST_BY_SAMPLE * len(self._times)
        outputs = np.zeros((len(self._times), len(self._columns)))
        outputs[0] = self._outputs(float(self._times[0]), x, float(self._times[0]))
        size = np.maximum(np.abs(x - self._z[self._first :]), 1e-6 * dynamics.state_sizes())
        for start, stop in self._pieces():
            middle = 0.5 * (start + stop)
            inside = (self._times > start) & (self._times <= stop)
            end = bool(inside.any()) and self._times[inside][-1] == stop
            at = self._times[inside] if end else np.append(self._times[inside], stop)

            def rates(t: float, x: Array, middle: float = middle) -> Array:
                nonlocal left
                left -= 1
                if left < 0:
                    raise NumericalError(
                        f"the nonlinear response grows without bound at {t:.4g} s, or has too few samples"
                    )
                u = self._inputs(t, middle)
                try:
                    self._c = dynamics.unknowns(self._c, x, u)
                except (OutOfRangeError, np.linalg.LinAlgError) as error:
                    problem = f"the nonlinear response leaves the range of a law: {error}"
                    raise NumericalError(problem) from None
                return dynamics.rates(self._c, u)

            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # of failed steps; the error below says it
                atol = tolerance * size
                dense = bool(self._delayed)
                solved = solve_ivp(rates, (start, stop), x, "LSODA", at, dense, rtol=tolerance, atol=atol)
            if not solved.success:
                reached = solved.t[-1] if len(solved.t) else start  # no sample was reached
                raise NumericalError(
                    f"the nonlinear response was integrated to {reached:.4g} s only: no step is short enough "
                    f"for its tolerance; end it before {stop:.4g} s, or use slower inputs"
                )
            size = np.maximum(size, np.abs(solved.y - self._z[self._first :, None]).max(axis=1))
            for row, t, state in zip(np.flatnonzero(inside), solved.t, solved.y.T, strict=False):
                outputs[row] = self._outputs(float(t), state, middle)
            x = solved.y[:, -1]
            if solved.sol is not None:
                course = partial(self._answered, solved.sol, middle)
                self._history.add(start, stop, course, tolerance)
        return outputs

    def _answered(self, states: Callable[[float], Array], middle: float, t: float) -> Array:
        """Return the answers that arrive late, at a time."""
        return self._variables(t, states(t), middle)[self._answers]

    def _pieces(self) -> list[tuple[float, float]]:
        """Return the intervals between the jumps and kinks of the inputs."""
        first, last = float(self._times[0]), float(self._times[-1])
        inner = [signal.breakpoints(first, last) for _, signal in self._signals]
        ends = np.unique(np.concatenate([[first, last], *inner]))
        ends = ends[(ends >= first) & (ends <= last)]
        delays = [delay for _, _, delay in self._delayed]
        return [*pairwise(delayed_borders(ends.tolist(), delays, last) if delays else ends.tolist())]

    def _inputs(self, t: float, middle: float) -> Array:
        u = self._rest.copy()
        for name, signal in self._signals:
            states = signal.states(np.array([t]), np.array([middle]))
            u[self._sources.index(name)] += float(states[0] @ signal.generator()[1])
        for k, (source, _, delay) in enumerate(self._delayed):
            u[self._sources.index(source)] += self._history.at(k, t - delay, middle - delay)
        return u

    def _outputs(self, t: float, x: Array, middle: float) -> Array:
        return (self._variables(t, x, middle) - self._z)[self._columns]

    def _variables(self, t: float, x: Array, middle: float) -> Array:
        u = self._inputs(t, middle)
        self._c = self._dynamics.unknowns(self._c, x, u)
        return np.concatenate([self._dynamics.efforts_and_flows(self._c, u), x])
