"""Energy of free and forced motions: its shares in storage elements, and its dissipation in resistors.

In a motion with amplitudes e and f at an angular frequency, or of a mode at an instant, an I stores
I |f|²/4 as a mean over the phase, a C stores C |e|²/4, and an R dissipates R |f|²/2. In a mode s = σ + jω
all of it falls as e^{2σt}; power is the rate of energy, P = -2σ W, so that every resistor has its part of -σ.

The result has them for modes and elements, and the performance of sources over frequency.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.analysis_request import Analysis, choose_engine
from dynid.bondgraph.graph import ACTIVATED, STORAGES, BondGraph, Port, bond_sign, unit_quotient
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.result import Result

#: The part whose elements stand for controllers.
CONTROL = "control"
#: Most storages whose natural polynomial is formed without being asked for: it takes 20 ms.
_MAX_EXACT_STORAGES = 60
#: From this condition on, the inverse of eigenvectors has fewer than ten digits, and left ones are computed.
_MAX_INVERTED_CONDITION = 1e6
#: What is said of eigenvalues in floating point, of which none can be proved to be repeated.
_UNPROVED = "True where the error bounds of eigenvalues overlap; 'engine: exact' decides"


class _EnergyElements:
    """The elements of a graph that store or dissipate energy, and the variables that measure it.

    Attributes
    ----------
    ports
        The variable of every single element: the flow of an I or R, the effort of a C.
    values
        Its I, C or R.
    storages, resistors
        Names of the elements as they are drawn; a field or a structure is one.
    controlled
        Whether controllers have states, which store no energy.
    """

    def __init__(self, graph: BondGraph) -> None:
        elements = [node for node in graph.nodes.values() if node.type in STORAGES or node.type == "R"]
        single = [node for node in elements if node.part != CONTROL]
        self.controlled = any(node.type in STORAGES for node in elements if node.part == CONTROL)
        self.ports = [Port(node.name, "e" if node.type == "C" else "f") for node in single]
        self.values = np.array([float(graph.value(node.name)) for node in single])
        self._stores = np.array([node.type in STORAGES for node in single], dtype=bool)
        self._owners = [node.part or node.name for node in single]
        self.storages = self._names(stores=True)
        self.resistors = self._names(stores=False)

    def _names(self, *, stores: bool) -> list[str]:
        pairs = zip(self._owners, self._stores, strict=True)
        return list(dict.fromkeys(owner for owner, is_store in pairs if is_store is np.bool_(stores)))

    @property
    def passive(self) -> bool:
        """True where no element has a negative value."""
        return bool((self.values >= 0).all())

    @property
    def storage_values(self) -> Array:
        """The values of storage elements, 0 elsewhere."""
        return np.where(self._stores, self.values, 0.0)

    def energy(self, squares: Array) -> Array:
        """Return the mean energy stored in `storages`, from squared amplitudes (…, ports)."""
        return self._summed(squares, 0.25, stores=True)

    def power(self, squares: Array) -> Array:
        """Return the mean power dissipated in `resistors`, from squared amplitudes (…, ports)."""
        return self._summed(squares, 0.5, stores=False)

    def _summed(self, squares: Array, factor: float, *, stores: bool) -> Array:
        """Return sums over the single elements of every element as drawn."""
        names = self.storages if stores else self.resistors
        sums = np.zeros((*squares.shape[:-1], len(names)))
        for column, (owner, is_store) in enumerate(zip(self._owners, self._stores, strict=True)):
            if is_store == stores and self.values[column]:  # without 0 times inf
                sums[..., names.index(owner)] += factor * self.values[column] * squares[..., column]
        return sums


class _FreeMotions(NamedTuple):
    """The free motions of a graph: `poles` (rad/s, one of each pair), squared amplitudes (modes x ports).

    `repeated` has True for the poles that stand more than once; the amplitudes of such a pole are means over
    its motions, of equal energy.
    """

    poles: ComplexArray
    squares: Array
    repeated: NDArray[np.bool_]


def _free_motions(reduced: ReducedGraph, elements: _EnergyElements, *, exact: bool) -> _FreeMotions:
    """Return the free motions of a graph, all sources zero.

    `exact`: multiplicities are those of the factors of its natural polynomial; else poles are repeated
    where the error bounds of eigenvalues overlap.
    """
    from scipy.linalg import cholesky, solve_triangular

    from dynid.bondgraph.graph_state_space import natural_polynomial, state_space
    from dynid.lti.certified_roots import certified_roots

    system = state_space(reduced)
    if not len(system.A):
        return _FreeMotions(np.zeros(0, complex), np.zeros((0, len(elements.ports))), np.zeros(0, bool))
    # In coordinates whose squares are energies a passive graph has well-conditioned eigenvectors.
    weights = system.C.T * elements.storage_values
    root = cholesky(weights @ system.C, lower=False)
    A = root @ solve_triangular(root, system.A.T, trans="T", lower=False).T
    C = solve_triangular(root, system.C.T, trans="T", lower=False).T
    spectrum = _Spectrum.of(A)
    if exact:
        roots = certified_roots(natural_polynomial(reduced), list(spectrum.values))
        poles = [(root.value, root.multiplicity, root.multiplicity) for root in roots]
    else:
        bounded = zip(spectrum.values, spectrum.bounds, strict=True)
        clusters = (spectrum.cluster(value, bound) for value, bound in bounded)
        poles = [(pole, size, 1) for pole, size in clusters]
    poles = sorted((pole for pole in poles if pole[0].imag >= 0), key=lambda pole: abs(pole[0]))
    motions = [spectrum.motions(A, pole, size, exact=exact) for pole, size, _ in poles]
    times = [count for _, _, count in poles]
    squares = np.abs(C @ np.concatenate(motions, axis=1)) ** 2
    ends = np.cumsum([basis.shape[1] for basis in motions])[:-1]
    return _FreeMotions(
        np.repeat([pole for pole, _, _ in poles], times),
        np.repeat([part.mean(axis=1) for part in np.split(squares, ends, axis=1)], times, axis=0),
        np.repeat([size > 1 for _, size, _ in poles], times),
    )


class _Spectrum(NamedTuple):
    """Eigenvalues of a matrix with their error bounds, of first order in the rounding, and eigenvectors."""

    values: ComplexArray
    bounds: Array
    vectors: ComplexArray

    @classmethod
    def of(cls, A: Array) -> _Spectrum:
        values, vectors = np.linalg.eig(A)
        try:  # the condition of an eigenvalue is the norm of its row here, that of a vector is 1
            with np.errstate(over="ignore"):  # infinite of nearly parallel vectors
                conditions = np.linalg.norm(np.linalg.inv(vectors), axis=1)
        except np.linalg.LinAlgError:
            conditions = np.full(len(values), np.inf)
        if not conditions.max() < _MAX_INVERTED_CONDITION:
            from scipy.linalg import eig

            _, left, right = cast("Any", eig(A, left=True))  # unit vectors
            overlaps = np.abs((left.conj() * right).sum(axis=0))
            # that of a defective one is beyond all bounds
            conditions = np.asarray(1 / np.maximum(overlaps, np.finfo(float).eps))
        return cls(values, _rounding_of(A) * conditions, vectors)

    def cluster(self, value: complex, bound: float) -> tuple[complex, int]:
        """Return the mean of the eigenvalues whose bounds overlap that of one of them, and their number."""
        near = np.abs(self.values - value) <= self.bounds + bound
        mean = complex(self.values[near].mean())
        return complex(mean.real, 0.0 if abs(value.imag) <= bound else mean.imag), int(near.sum())

    def motions(self, A: Array, pole: complex, size: int, *, exact: bool) -> ComplexArray:
        """Return an orthonormal basis of the eigenvectors of a pole that stands for so many eigenvalues."""
        distances = np.abs(self.values - pole)
        near = distances <= self.bounds + distances.min()
        if size == 1 and near.sum() == 1:
            return self.vectors[:, near]
        _, singular, vectors = np.linalg.svd(A - pole * np.eye(len(A)))
        # a mean of eigenvalues that are not apart is off by as much as their spread
        spread = 0.0 if exact else float(np.sort(distances)[size - 1])
        count = int((singular <= 10 * _rounding_of(A) + spread).sum())
        return np.asarray(vectors[len(A) - min(max(count, 1), size) :].conj().T)


def _rounding_of(A: Array) -> float:
    return float(len(A) * np.finfo(float).eps * np.linalg.norm(A))


_ENERGY, _SOURCES = "bond_graph/energy", "bond_graph/source_performance"
_CONTROLLED = "undefined: modes that controllers have part in have no shares of energy"
_NEGATIVE = "undefined: shares of energy are not defined for elements of negative values"


def add_energy(result: Result, graph: BondGraph, analysis: Analysis) -> None:
    """Add the shares of energy and dissipation of every mode, and energy and power at every frequency.

    `graph`: the graph. Its pseudo bonds (thermal) have shares as well, of e f instead of power. `analysis`:
    what is asked: the inputs, of amplitude 1 each alone, and the angular frequencies; without these the modes
    alone. Raises `Singular` where the graph leaves a variable of an element undetermined.
    """
    elements, inputs, omega = _EnergyElements(graph), analysis.inputs, analysis.omega
    reduced = ReducedGraph(graph, inputs, elements.ports, traced=False)
    result.add_axis(f"{_ENERGY}/storage", np.array(elements.storages, dtype=object))
    result.add_axis(f"{_ENERGY}/resistor", np.array(elements.resistors, dtype=object))
    if elements.controlled or not elements.passive:
        result.add(f"{_ENERGY}/status", _CONTROLLED if elements.controlled else _NEGATIVE)
    else:
        small = np.count_nonzero(elements.storage_values) <= _MAX_EXACT_STORAGES or analysis.engine == "exact"
        exact = small and choose_engine(reduced, analysis).engine == "exact"
        _add_modes(result, elements, reduced, exact=exact)
    if omega is None:
        return
    squares = np.abs(frequency_response(reduced, omega).transpose(0, 2, 1)) ** 2
    result.add_axis(f"{_ENERGY}/omega", omega, "rad/s")
    result.add_axis(f"{_ENERGY}/input", list(inputs))
    domains = (reduced.units.domains.get(port.node, "thermal") for port in elements.ports)
    # e f is a power where every domain is known, and none is thermal
    joule, watt = ("J", "W") if all(domain != "thermal" for domain in domains) else ("", "")
    result.add(f"{_ENERGY}/energy", elements.energy(squares), ("omega", "input", "storage"), joule)
    result.add(f"{_ENERGY}/power", elements.power(squares), ("omega", "input", "resistor"), watt)


def _add_modes(result: Result, elements: _EnergyElements, reduced: ReducedGraph, *, exact: bool) -> None:
    """Add the poles of the whole graph with shares of stored energy, and of what damps them."""
    free = _free_motions(reduced, elements, exact=exact)
    stored, lost = elements.energy(free.squares), elements.power(free.squares)
    total = stored.sum(axis=1, keepdims=True)
    rates, all_lost = lost / (2 * total), lost.sum(axis=1, keepdims=True)
    shares = np.divide(lost, all_lost, out=np.zeros_like(lost), where=all_lost > 0)
    result.add(f"{_ENERGY}/status", "defined")
    result.add_axis(f"{_ENERGY}/mode", np.arange(1, len(free.poles) + 1))
    result.add(f"{_ENERGY}/poles", free.poles, ("mode",), "rad/s")
    result.add(f"{_ENERGY}/repeated", free.repeated, ("mode",), **({} if exact else {"note": _UNPROVED}))
    result.add(f"{_ENERGY}/stored_share", stored / total, ("mode", "storage"))
    result.add(f"{_ENERGY}/dissipated_share", shares, ("mode", "resistor"))
    result.add(f"{_ENERGY}/decay_rate", rates, ("mode", "resistor"), "1/s")
    if any(node.type == ACTIVATED for node in reduced.graph.nodes.values()):
        fed = free.poles.real + rates.sum(axis=1)
        result.add(f"{_ENERGY}/growth_rate_by_control", fed, ("mode",), "1/s")


def add_source_performance(result: Result, graph: BondGraph, inputs: tuple[str, ...], omega: Array) -> None:
    """Add what every input gives at an amplitude of 1, the others zero: effort, flow, impedance and power.

    Effort and flow are amplitudes, with power positive out of the source; active power is ½ Re(e f*),
    reactive power ½ Im(e f*). Where there is no gyrator between, reactive power is 2ω times the energy of
    I less that of C; a gyrator turns its sign.

    `inputs`: the inputs. Setpoints of controllers are signals, and left out.
    """
    result.add_axis(f"{_SOURCES}/omega", omega, "rad/s")
    for name in inputs:
        if graph.nodes[name].part == CONTROL:
            continue
        efforts = graph.nodes[name].type == "Se"
        answered = Port(name, "f" if efforts else "e")
        reduced = ReducedGraph(graph, [name], [answered], traced=False)
        answer = frequency_response(reduced, omega)[:, 0, 0]
        if bond_sign(graph, name) > 0:
            answer = -answer
        units = [reduced.units.of(name, quantity) for quantity in "ef"]
        unity = np.ones_like(answer)
        effort, flow = (unity, answer) if efforts else (answer, unity)
        impedance = _inverse(answer) if efforts else answer
        group, has_units = f"{_SOURCES}/{name}", all(units)
        result.add(f"{group}/effort", effort, ("omega",), units[0])
        result.add(f"{group}/flow", flow, ("omega",), units[1])
        ratio = unit_quotient(units[0], units[1]) if has_units else ""
        result.add(f"{group}/impedance", impedance, ("omega",), ratio)
        watt = "W" if has_units and reduced.units.domains[name] != "thermal" else ""
        result.add(f"{group}/active_power", answer.real / 2, ("omega",), watt)
        # Im(e f*) is -Im f for e = 1, and Im e for f = 1
        reactive = (-answer.imag if efforts else answer.imag) / 2
        result.add(f"{group}/reactive_power", reactive, ("omega",), watt)
        result.add(f"{group}/apparent_power", np.abs(answer) / 2, ("omega",), watt)


def _inverse(values: ComplexArray) -> ComplexArray:
    """Return 1/z; inf for 0, and 0 for inf."""
    inverse = np.full(len(values), np.inf, dtype=complex)
    finite = np.isfinite(values)
    np.divide(1.0, values, out=inverse, where=finite & (values != 0))
    inverse[~finite] = 0
    return inverse
