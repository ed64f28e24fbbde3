"""Energy of modes and elements, and the performance of sources over frequency, in a result."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.energy import EnergyElements, free_motions
from dynid.bondgraph.frequency_response import frequency_response
from dynid.bondgraph.graph import ACTIVATED, BondGraph, GraphUnits, Port, bond_sign, unit_quotient
from dynid.bondgraph.plan import ReducedGraph
from dynid.result import Result

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_ENERGY, _SOURCES = "bond_graph/energy", "bond_graph/source_performance"
_CONTROLLED = "undefined: modes that controllers have part in have no shares of energy"
_NEGATIVE = "undefined: shares of energy are not defined for elements of negative values"


def add_energy(result: Result, graph: BondGraph, inputs: tuple[str, ...], omega: Array | None) -> None:
    """Add the shares of energy and dissipation of every mode, and energy and power at every frequency.

    Parameters
    ----------
    result
        Where to add them.
    graph
        The graph. Its pseudo bonds (thermal) have shares as well, of e f instead of power.
    inputs
        Inputs of amplitude 1, each alone.
    omega
        Angular frequencies, rad/s; None: the modes alone.

    Raises
    ------
    Singular
        Where the graph leaves a variable of an element undetermined.
    """
    elements = EnergyElements(graph)
    reduced = ReducedGraph(graph, inputs, elements.ports, traced=False)
    result.add_axis(f"{_ENERGY}/storage", np.array(elements.storages, dtype=object))
    result.add_axis(f"{_ENERGY}/resistor", np.array(elements.resistors, dtype=object))
    if elements.controlled or not elements.passive:
        result.add(f"{_ENERGY}/status", _CONTROLLED if elements.controlled else _NEGATIVE)
    else:
        _add_modes(result, elements, reduced)
    if omega is None:
        return
    squares = np.abs(frequency_response(reduced, omega).transpose(0, 2, 1)) ** 2
    result.add_axis(f"{_ENERGY}/omega", omega, "rad/s")
    result.add_axis(f"{_ENERGY}/input", list(inputs))
    joule, watt = ("J", "W") if _true_power(reduced.units, elements.ports) else ("", "")
    result.add(f"{_ENERGY}/energy", elements.energy(squares), ("omega", "input", "storage"), joule)
    result.add(f"{_ENERGY}/power", elements.power(squares), ("omega", "input", "resistor"), watt)


def _add_modes(result: Result, elements: EnergyElements, reduced: ReducedGraph) -> None:
    """Add the poles of the whole graph with shares of stored energy, and of what damps them."""
    free = free_motions(reduced, elements)
    stored, lost = elements.energy(free.squares), elements.power(free.squares)
    total = stored.sum(axis=1, keepdims=True)
    rates, all_lost = lost / (2 * total), lost.sum(axis=1, keepdims=True)
    shares = np.divide(lost, all_lost, out=np.zeros_like(lost), where=all_lost > 0)
    result.add(f"{_ENERGY}/status", "defined")
    result.add_axis(f"{_ENERGY}/mode", np.arange(1, len(free.poles) + 1))
    result.add(f"{_ENERGY}/poles", free.poles, ("mode",), "rad/s")
    result.add(f"{_ENERGY}/repeated", free.repeated, ("mode",))
    result.add(f"{_ENERGY}/stored_share", stored / total, ("mode", "storage"))
    result.add(f"{_ENERGY}/dissipated_share", shares, ("mode", "resistor"))
    result.add(f"{_ENERGY}/decay_rate", rates, ("mode", "resistor"), "1/s")
    if any(node.type == ACTIVATED for node in reduced.graph.nodes.values()):
        fed = free.poles.real + rates.sum(axis=1)
        result.add(f"{_ENERGY}/growth_rate_by_control", fed, ("mode",), "1/s")


def _true_power(units: GraphUnits, ports: list[Port]) -> bool:
    """Return True where e f is a power everywhere: every domain is known, and none is thermal."""
    return all(units.domains.get(port.node, "thermal") != "thermal" for port in ports)


def add_source_performance(result: Result, graph: BondGraph, inputs: tuple[str, ...], omega: Array) -> None:
    """Add what every input gives at an amplitude of 1, the others zero: effort, flow, impedance and power.

    Effort and flow are amplitudes, with power positive out of the source; active power is ½ Re(e f*),
    reactive power ½ Im(e f*). Where there is no gyrator between, reactive power is 2ω times the energy of
    I less that of C; a gyrator turns its sign.

    Parameters
    ----------
    result, graph
        Where to add it, and of what.
    inputs
        The inputs.
    omega
        Angular frequencies, rad/s.
    """
    result.add_axis(f"{_SOURCES}/omega", omega, "rad/s")
    for name in inputs:
        efforts = graph.nodes[name].type == "Se"
        other = Port(name, "f" if efforts else "e")
        reduced = ReducedGraph(graph, [name], [other], traced=False)
        answer = frequency_response(reduced, omega)[:, 0, 0]
        if bond_sign(graph, name) > 0:
            answer = -answer
        units = [reduced.units.of(name, quantity) for quantity in "ef"]
        one = np.ones_like(answer)
        effort, flow = (one, answer) if efforts else (answer, one)
        impedance = _inverse(answer) if efforts else answer
        group, known = f"{_SOURCES}/{name}", all(units)
        result.add(f"{group}/effort", effort, ("omega",), units[0])
        result.add(f"{group}/flow", flow, ("omega",), units[1])
        ratio = unit_quotient(units[0], units[1]) if known else ""
        result.add(f"{group}/impedance", impedance, ("omega",), ratio)
        watt = "W" if known and reduced.units.domains[name] != "thermal" else ""
        result.add(f"{group}/active_power", answer.real / 2, ("omega",), watt)
        # Im(e f*) is -Im f for e = 1, and Im e for f = 1
        reactive = (-answer.imag if efforts else answer.imag) / 2
        result.add(f"{group}/reactive_power", reactive, ("omega",), watt)
        result.add(f"{group}/apparent_power", np.abs(answer) / 2, ("omega",), watt)


def _inverse(values: ComplexArray) -> ComplexArray:
    """Return 1/z; inf for 0, and 0 for inf."""
    found = np.full(len(values), np.inf, dtype=complex)
    finite = np.isfinite(values)
    np.divide(1.0, values, out=found, where=finite & (values != 0))
    found[~finite] = 0
    return found
