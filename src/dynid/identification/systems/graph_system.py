"""A bond graph with unknown parameters as a linear system for the estimators.

The states are the displacement q of each C and the flow f of each I that are independent, less a multiple of
an input where its derivative enters the equations. Only the part of the graph that the channels depend on is
modelled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.graph import SOURCES, STORAGES, BondGraph, GraphUnits, Node, Port, port_fault
from dynid.bondgraph.parametric_equations import ParametricEquations
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import Singular, UsageError
from dynid.identification.records.measurement import Simulation
from dynid.identification.systems.delayed_loops import DelayedAnswer, delayed_poles, delayed_response
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.linear_system import LinearSystem, Responses, StateVariable
from dynid.lti.signals import Impulse, Signal
from dynid.lti.state_space import Matrices, StateSpace
from dynid.lti.time_response import TimeResponse, propagate
from dynid.parameters import Parameter, true_values
from dynid.suggestions import did_you_mean
from dynid.units import as_factor

if TYPE_CHECKING:
    from dynid.lti.filters import Filter
    from dynid.structure.ports import ChannelClock

# Most known storages whose values are considered one by one.
_MAX_STORAGES = 24
#: Derivatives of a sampled input that are no impulses at the samples, by its hold.
_SMOOTH_HOLDS = {"zero": 0, "linear": 1, "spline": 3}


class SourceLoad(NamedTuple):
    """A source of the graph that follows ``gain`` times a signal, ``delay`` earlier (s).

    Several loads of one source add up.
    """

    source: str
    signal: Signal
    unit: str = ""
    gain: Real = 1.0
    delay: Real = 0.0

    @property
    def name(self) -> str:
        """Its name in results: that of the source."""
        return self.source

    @property
    def gain_name(self) -> str:
        """The name of its gain."""
        return f"gain of {self.source}"

    @property
    def motion(self) -> None:
        """No motion of a structure is prescribed."""


class GraphChannel(NamedTuple):
    """A measured variable of the graph: effort, flow, displacement or momentum at a node.

    What is recorded is ``gain`` times the variable ``delay`` earlier (s), behind `filters`, plus ``offset``,
    at the times of its `clock`, by default those of the record.
    """

    port: Port
    unit: str = ""
    gain: Real = 1.0
    offset: Real = 0.0
    delay: Real = 0.0
    filters: tuple[Filter, ...] = ()
    clock: ChannelClock | None = None

    @property
    def name(self) -> str:
        """Its name in results, such as `J.f`."""
        return str(self.port)

    @property
    def quantity(self) -> str:
        """The measured quantity: e, f, q or p."""
        return self.port.quantity

    @property
    def gain_name(self) -> str:
        """The name of its gain."""
        return f"gain of {self.name}"

    def unit_load(self, source: str) -> SourceLoad:
        """Return the load that a frequency response of it refers to: a unit impulse of a source."""
        return SourceLoad(source, Impulse(1.0))


class IdentifiedGraph:
    """A bond graph with unknown parameters: a `SystemModel`.

    Parameters
    ----------
    graph
        The graph; the values of its nodes may depend on the parameters.
    parameters
        The unknown and considered parameters.
    initial
        Stored energy at t = 0 of simulated records: the flow of an I, the effort of a C, by name.
    variables
        Variables of the graph by the names that a scene gives them, where these differ.
    delayed
        Answers of loops with delays, which are cut in `graph`.

    Raises
    ------
    UsageError
        If what is given energy is no storage.
    """

    def __init__(
        self,
        graph: BondGraph,
        parameters: Sequence[Parameter],
        initial: Mapping[str, float] | None = None,
        variables: Mapping[Port, Port] | None = None,
        delayed: Sequence[DelayedAnswer] = (),
    ) -> None:
        self.graph, self.parameters, self.initial = graph, tuple(parameters), dict(initial or {})
        self.variables, self.delayed = dict(variables or {}), tuple(delayed)
        self._units = GraphUnits(graph)
        storages = [name for name, node in graph.nodes.items() if node.type in STORAGES]
        for name in self.initial:
            if name not in storages:
                raise UsageError(
                    f"'{name}' is no I or C of the graph, which store energy{did_you_mean(name, storages)}",
                    names=("initial", name),
                )

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters (p)."""
        return tuple(parameter for parameter in self.parameters if parameter.std is None)

    def with_parameters(self, parameters: Sequence[Parameter]) -> IdentifiedGraph:
        """Return the model with other unknown and considered parameters."""
        return IdentifiedGraph(self.graph, parameters, self.initial, self.variables, self.delayed)

    def with_known_storages(self, parameters: Sequence[Parameter]) -> IdentifiedGraph:
        """Return the model with other `parameters`, and an unknown factor, 1, of each known I and C.

        Those of fields and structures, and of graphs with many storages, have none.
        """
        nodes, factors = self.graph.nodes, dict[str, Node]()
        for name, node in nodes.items():
            if node.type in STORAGES and node.dependent is None and not node.part and node.value:
                factor = f"{'inertia' if node.type == 'I' else 'compliance'} of {name}"
                dependent = Dependent.parameter(factor, Fraction(1)) * node.value
                factors[factor] = replace(node, dependent=dependent)
        if len(factors) > _MAX_STORAGES:
            return self.with_parameters(parameters)
        changed = nodes | {node.name: node for node in factors.values()}
        graph = BondGraph(changed.values(), self.graph.bonds)
        unknowns = (*parameters, *(Parameter(factor, 1.0) for factor in factors))
        return IdentifiedGraph(graph, unknowns, self.initial, self.variables, self.delayed)

    def load(self, source: str, signal: Signal, gain: Real = 1.0, delay: Real = 0.0) -> SourceLoad:
        """Return the load of a source, with its unit.

        Raises UsageError if there is no such source.
        """
        late = {answer.source for answer in self.delayed}
        nodes = {name: node for name, node in self.graph.nodes.items() if name not in late}
        if source not in nodes or nodes[source].type not in SOURCES:
            sources = [name for name, node in nodes.items() if node.type in SOURCES]
            raise UsageError(
                f"'{source}' is no source of the graph{did_you_mean(source, sources)}",
                remedy=f"Its sources are {', '.join(sources) or 'none'}.",
                names=(source,),
            )
        return SourceLoad(source, signal, self._units.of_input(source), gain, delay)

    def channel(
        self,
        port: Port,
        gain: Real = 1.0,
        offset: Real = 0.0,
        delay: Real = 0.0,
        filters: tuple[Filter, ...] = (),
        clock: ChannelClock | None = None,
    ) -> GraphChannel:
        """Return the channel that measures a variable, with its unit.

        Raises UsageError if there is no such variable.
        """
        nodes, port = self.graph.nodes, self.variables.get(port, port)
        if port.node not in nodes:
            raise UsageError(
                f"'{port}': the graph has no node '{port.node}'{did_you_mean(port.node, nodes)}",
                names=(str(port), port.node),
            )
        if fault := port_fault({name: node.type for name, node in nodes.items()}, port):
            raise UsageError(fault, names=(str(port), port.node))
        unit = self._units.of_output(port)
        for item in filters:
            if item.kind == "integrator" and unit:
                unit = f"{as_factor(unit)}.s{item.order if item.order > 1 else ''}"
        return GraphChannel(port, unit, gain, offset, delay, filters, clock)

    def system(self, loads: Sequence[SourceLoad], channels: Sequence[GraphChannel]) -> GraphSystem:
        """Return the system from the loads to the channels.

        Raises UsageError if a source or variable does not exist. Raises Singular if the equations have no
        unique solution.
        """
        return GraphSystem(self, loads, channels)

    def simulated(
        self,
        loads: Sequence[SourceLoad],
        channels: Sequence[GraphChannel],
        times: Array,
        source: Simulation,
    ) -> TimeResponse:
        """Return the exact, noise-free response at the true values, from the stored energy at t = 0.

        The energy is an impulse of strength f(0) on an I, e(0) on a C, at t = 0 (Park & Kim 1997, eqs 13
        to 16): storages that are rigidly coupled share it.

        Raises UsageError if a true value is not known, or a channel follows an impulse.
        """
        values = true_values(self.unknowns)
        system = self.system(loads, channels)
        system.check()
        if self.delayed:
            return self._simulated_with_delays(system, values, times, source)
        space, start = system.state_space(values), system.started(values, self.initial)
        if any(channel.filters for channel in channels):
            from dynid.identification.systems.filtered_system import filtered_space, filters_of

            space = filtered_space(space, filters_of(channels), values)
            start = np.pad(start, (0, len(space.A) - len(start)))
        return propagate(space, system.signals, times, start)

    def _simulated_with_delays(
        self, system: GraphSystem, values: Mapping[str, float], times: Array, source: Simulation
    ) -> TimeResponse:
        """Return the response of loops with delays by the method of steps."""
        from dynid.lti.delay_system import DelaySystem

        if source.settle:
            raise UsageError(
                "a record of a loop with a delay begins at rest, before which nothing was under way",
                remedy="Leave out `settle`.",
                names=("measurement.simulate.settle", "settle"),
            )
        matrices, (delays, _) = system.lft(values), system.loop_delays(values)
        n, m, nu = len(matrices.A), len(delays), len(system.signals)
        start = system.started(values, self.initial)[:, None]
        B = np.concatenate([matrices.B[:, :nu], start, matrices.B[:, nu:]], axis=1)
        C = np.concatenate([matrices.C[:-m], np.eye(n), matrices.C[-m:]])
        direct = np.insert(np.insert(matrices.D, nu, 0.0, axis=2), [len(matrices.C) - m] * n, 0.0, axis=1)
        lft = StateSpace(matrices.A, B, C, direct[0], tuple(direct[1:]))
        delayed = DelaySystem(lft, tuple(map(Fraction, delays.tolist())))
        response = delayed.response([*system.signals, Impulse(1.0)], times)
        return TimeResponse(response.outputs[:, :-n], response.outputs[:, -n:], response.inputs[:, :nu])


class GraphSystem(LinearSystem):
    """The linear system of a bond graph for the loads and channels of one record.

    Parameters
    ----------
    model
        The graph with its parameters.
    loads
        The sources that act; all others are zero.
    channels
        The measured variables.

    Attributes
    ----------
    unreached
        Unknown parameters that no channel depends on: their slopes are zero.
    """

    def __init__(
        self, model: IdentifiedGraph, loads: Sequence[SourceLoad], channels: Sequence[GraphChannel]
    ) -> None:
        self.unknowns, self._loads, self._channels = model.unknowns, loads, channels
        self.signals = [load.signal for load in loads]
        self._names = [parameter.name for parameter in self.unknowns]
        for load in loads:
            model.load(*load[:2])
        ports = list(dict.fromkeys(model.channel(channel.port).port for channel in channels))
        sources = list(dict.fromkeys(load.source for load in loads))
        self.delayed, late = model.delayed, [answer.source for answer in model.delayed]
        answers = [answer.answer for answer in model.delayed if answer.answer not in ports]
        self._reduced = ReducedGraph(model.graph, [*sources, *late], [*ports, *answers], traced=False)
        self._equations = ParametricEquations(self._reduced, self._names)
        self._columns = [sources.index(load.source) for load in loads]
        self._rows = [ports.index(channel.port) for channel in channels]
        units = self._reduced.units
        self.states = tuple(
            StateVariable(str(state.port), units.of_output(state.port)) for state in self._equations.states
        )
        numbers = (answer.delay for answer in model.delayed)
        late_names = (number.names for number in numbers if isinstance(number, Dependent))
        reached = self._equations.reached.union(*late_names)
        self.unreached = tuple(name for name in self._names if name not in reached)

    def check(self) -> None:
        """Refuse loads of which a channel follows a derivative that is an impulse, and graphs without states.

        Raises UsageError, naming the sources.
        """
        if not self.states:
            raise UsageError(
                "the channels follow their sources at once: no state of a storage lies between, and a record "
                "of time has nothing to predict",
                remedy="Identify from frequency responses, or measure a variable that depends on a storage.",
                names=tuple(load.source for load in self._loads),
            )
        for load in self._loads:
            _check_smooth(load, self._equations.orders[load.source])
        if self.delayed:
            self._check_delays()

    def _check_delays(self) -> None:
        """Refuse what no record of loops with delays is predicted with."""
        if any(self._equations.orders[answer.source] > 0 for answer in self.delayed):
            raise UsageError(
                "a channel, or what a controller measures, follows the derivative of a delayed answer",
                remedy="Add a filter to the controller (tf of a PID), or measure another variable.",
                names=("control",),
            )
        instruments = Instruments.of((), self._loads, self._channels)
        if instruments.delayed or instruments.clocked:
            raise UsageError(
                "beside a loop with a delay channels and excitation have no delays or clocks of their own",
                remedy="Leave them out; shift or resample the record beforehand.",
                names=("measurement.channels", "excitation"),
            )
        if any(channel.filters for channel in self._channels):
            raise UsageError(
                "beside a loop with a delay channels have no filters",
                remedy="Leave out their high_pass and low_pass.",
                names=("measurement.channels",),
            )

    def _complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the value of every unknown: those given, else the reference."""
        return {unknown.name: values.get(unknown.name, unknown.expected) for unknown in self.unknowns}

    def at(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices at values of the parameters, by name; absent: their reference values.

        Every entry and derivative has full double precision.

        Raises Singular if the equations change their form there: a divisor vanishes. Raises NumericalError
        if an entry leaves the range of doubles.
        """
        return self._matrices(values, self._rows, self._columns)

    def lft(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices with the delayed answers as last inputs, and the answers as last outputs."""
        inputs, outputs = self._equations.inputs, self._reduced.outputs
        columns = [inputs.index(answer.source) for answer in self.delayed]
        rows = [outputs.index(answer.answer) for answer in self.delayed]
        return self._matrices(values, [*self._rows, *rows], [*self._columns, *columns])

    def poles(self, values: Mapping[str, float]) -> ComplexArray:
        """Return the poles, 1/s; with delays in loops those of slow motions."""
        if not self.delayed:
            return super().poles(values)
        return delayed_poles(self.lft(values), self.loop_delays(values))

    def _matrices(self, values: Mapping[str, float], rows: Sequence[int], columns: Sequence[int]) -> Matrices:
        """Return the matrices of these outputs and inputs of the equations."""
        A, B, C, D, dA, dB, dC, dD = self._equations.at(self._complete(values))
        return Matrices(
            A,
            B[:, columns],
            C[rows],
            D[:, rows][..., columns],
            dA,
            dB[..., columns],
            dC[:, rows],
            dD[:, :, rows][..., columns],
        )

    def started(self, values: Mapping[str, float], initial: Mapping[str, float]) -> Array:
        """Return the state (n) right after storages are given energy: f(0) of an I, e(0) of a C, by name."""
        if not initial:
            return np.zeros(len(self.states))
        # A storage that no channel depends on is not modelled.
        names = [name for name in initial if name in self._equations.storages]
        matrices = ParametricEquations(self._reduced, self._names, names).at(self._complete(values))
        return np.asarray(
            matrices[1][:, len(self._reduced.inputs) :] @ [float(initial[name]) for name in names]
        )

    def prior(self, values: Mapping[str, float], length: float) -> Array:
        """Return a root (n x n) of the wide prior covariance of the state, up to a factor.

        Flows of I have the covariance M^-1 and displacements of C ``(K + S^-1)^-1``, with the stored energy
        ``(q' K q + f' M f) / 2`` and ``S = T^2 G M^-1 G'``, where q' = G f + …: what the flows reach in the
        length T of the record. For a grounded chain of masses and springs, q = L x of displacements x, this
        is L (K_x + M / T^2)^-1 L', the prior of the structure. Displacements that no flow of an I reaches
        (a capacitor on a resistor) are bounded by their energy alone. An integral that stores no energy has
        its own deviation: what its rate reaches in T.
        """
        kinds = np.array([state.kind for state in self._equations.states], dtype=str)
        q, f, free = (np.flatnonzero(kinds == kind) for kind in ("q", "f", "integral"))
        A = self._equations.at(self._complete(values))[0]
        compliance, mobility, axes, omega = self._motions(values)
        root = np.zeros((len(kinds), len(kinds)))
        root[np.ix_(f, f)] = mobility
        bound = np.ones(len(q))
        rank = self._equations.generic_rank(q.tolist(), f.tolist())
        bound[:rank] = length * omega[:rank] / np.hypot(1.0, length * omega[:rank])
        root[np.ix_(q, q)] = compliance @ (axes * bound)
        for row in free:
            deviation = length * float(np.linalg.norm(A[row] @ root))
            root[row, row] = deviation if deviation > 0 else length
        return root

    def _motions(self, values: Mapping[str, float]) -> tuple[Array, Array, Array, Array]:
        """Return roots of K^-1 and M^-1, and principal axes and rates of ``q' = G f`` between these."""
        # The rates are the natural frequencies without resistances, rad/s, the highest first.
        kinds = np.array([state.kind for state in self._equations.states], dtype=str)
        q, f = (np.flatnonzero(kinds == kind) for kind in "qf")
        complete = self._complete(values)
        rows, sizes = self._equations.energy(complete)
        factor = np.sqrt(np.abs(sizes))[:, None] * rows  # the energy is |factor x|^2 / 2
        compliance, mobility = _inverse_root(factor[:, q]), _inverse_root(factor[:, f])
        moving = self._equations.at(complete)[0][np.ix_(q, f)] @ mobility
        axes, omega, _ = np.linalg.svd(np.linalg.solve(compliance, moving), full_matrices=True)
        return compliance, mobility, axes, omega

    def reach(self, values: Mapping[str, float], length: float) -> Array:
        """Return the standard deviation of each channel under the prior of the state (channels).

        The rate of a storage (e of an I, f of a C) is taken for the slowest motion it can be. A channel that
        no state enters bounds none: its reach is infinite.
        """
        root, matrices = self.prior(values, length), self.at(values)
        reach = np.linalg.norm(matrices.C @ root, axis=1)
        *_, omega = self._motions(values)
        slowest = np.hypot(omega.min(initial=np.inf), 1 / length)
        (rows, sizes), equations = self._equations.energy(self._complete(values)), self._equations
        for k, channel in enumerate(self._channels):
            name, quantity = channel.port.node, channel.port.quantity
            rate = {"I": "e", "C": "f"}.get(equations.graph.nodes[name].type)
            if len(omega) and quantity == rate and name in equations.storages:
                row = equations.storages.index(name)
                spread = float(np.linalg.norm(rows[row] @ root))
                reach[k] = min(reach[k], slowest * abs(sizes[row]) * spread)
        return np.where(reach > 0, reach, np.inf)

    def response(self, values: Mapping[str, float], omega: Array) -> Responses:
        """Return frequency responses (L x channels x loads), and their derivatives by the values (… x p).

        They come from the reduction of the graph, which keeps its digits where a stiff state space does not;
        at rest from the state space.

        Raises Singular if a response is infinite.
        """
        if self.delayed:
            return delayed_response(self.lft(values), self.loop_delays(values), omega)
        shape = len(omega), len(self._rows), len(self._columns)
        H, slopes = np.empty(shape, dtype=complex), np.empty((*shape, len(self._names)), dtype=complex)
        rest = omega == 0.0
        if rest.any():
            try:
                H[rest], slopes[rest] = super().response(values, omega[rest])
            except np.linalg.LinAlgError:
                raise Singular(
                    "the response at rest is infinite: something integrates",
                    remedy="Leave out the frequency 0.",
                    names=("frequency",),
                ) from None
        if not rest.all():
            responses, moved = self._equations.response(self._complete(values), omega[~rest])
            H[~rest] = responses[:, self._rows][:, :, self._columns]
            slopes[~rest] = moved[:, self._rows][:, :, self._columns]
        return H, slopes

    def state_space(self, values: Mapping[str, float]) -> StateSpace:
        """Return the state space at values of the parameters, with the names of its states."""
        matrices = self.at(values)
        names = tuple(state.name for state in self.states)
        return StateSpace(
            matrices.A, matrices.B, matrices.C, matrices.D[0], tuple(matrices.D[1:]), states=names
        )


def _inverse_root(factor: Array) -> Array:
    """Return a root of (factor' factor)^-1, of full column rank, in any units."""
    if not factor.shape[1]:
        return np.zeros((0, 0))
    scale = np.linalg.norm(factor, axis=0)
    if not np.all(scale > 0):
        raise Singular("a state of the graph stores no energy", remedy="Give its storage a value.")
    _, triangle = np.linalg.qr(factor / scale)
    return np.asarray(np.linalg.solve(triangle, np.eye(len(triangle))) / scale[:, None])


def _check_smooth(load: SourceLoad, order: int) -> None:
    """Refuse a load of which a channel follows a derivative (its order; -1: none) that is an impulse."""
    hold = getattr(load.signal, "hold", "")
    smooth = _SMOOTH_HOLDS.get(hold, 9)
    kind = load.signal.kind
    if order > smooth or (order >= 0 and kind == "impulse"):
        what = "it" if order == 0 else "its derivative" if order == 1 else f"its derivative of order {order}"
        signal = f"hold: {hold}" if order > smooth else "an impulse"
        raise UsageError(
            f"a channel follows {what} directly where the source '{load.source}' acts, which with {signal} "
            "is not finite",
            remedy="Use `hold: spline`, a smooth signal, or another channel.",
            names=(load.source,),
        )
