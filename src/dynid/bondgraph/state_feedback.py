"""Feedback of all states of a graph: gains of least quadratic cost (LQR), or that place poles.

Park & Kim's state variables are not unique: the states are the variables that the scene names. With the exact
state equations x' = A x + B u of the graph and y = T x of these variables, y' = T A T^-1 y + T B u, exactly.
The gains are those of python-control, of equations in balanced units. Each driven source has a junction whose
flow is the sum of gains times states, which one loop of gain 1 feeds back: its margins are those of the
source.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from dynid.arithmetic.numbers import to_fraction
from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.controller_circuits import Circuit, Loop
from dynid.bondgraph.graph import BondGraph, GraphUnits, Port, unit_quotient
from dynid.bondgraph.graph_state_space import rational_matrices
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.sampled_loops import with_rational_values
from dynid.errors import NumericalError, UsageError
from dynid.number_format import counted
from dynid.result import Result

GROUP = "bond_graph/state_feedback"
#: Distance of a pole of the closed loop from the one to be placed, relative to the largest pole: roots of
#: multiplicity m move by the m-th root of the rounding error, and up to triple ones are accepted.
_PLACED_RTOL = 1e-4
#: Residual of the Riccati equation, relative to its largest term, beyond which its solution is refused.
_RICCATI_RTOL = 1e-6
_FULL_SET = "Name as many independent variables; `dynid run` with results: [state_space] shows a set."


@dataclass(frozen=True)
class FeedbackRequest:
    """The states that are fed back to sources, and what their gains are to do: weights, or poles."""

    states: tuple[Port, ...]
    sources: tuple[str, ...]
    state_weights: Mapping[Port, Fraction] = field(default_factory=dict)  # of squares of variables
    source_weights: Sequence[Fraction] = ()
    poles: tuple[complex, ...] = ()  # rad/s
    references: Mapping[str, str] = field(default_factory=dict)  # by source
    setpoints: Mapping[Port, str] = field(default_factory=dict)
    place: str = ""  # where it stands in a scene, as `control.lqr`


@dataclass(frozen=True, eq=False)
class StateFeedback:
    """The gains of states by source, and the poles of the closed loop."""

    request: FeedbackRequest
    gains: Array  # source x state
    poles: ComplexArray  # rad/s


def design_feedback(graph: BondGraph, request: FeedbackRequest) -> StateFeedback:
    """Return the gains.

    Raises `UsageError` where the states are not a full set of the graph. Raises `NumericalError` where the
    sources do not reach modes that are to be moved.
    """
    A, B, C, D = _equations(graph, request)
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(A, permute=False, separate=True)
    scaled = A * scale / scale[:, None], B / scale[:, None]
    if request.source_weights:
        gains = _least_cost(*scaled, C * scale, D, request)
    else:
        gains = _placed(*scaled, request)
    poles = np.linalg.eigvals(scaled[0] - scaled[1] @ gains).astype(complex)
    return StateFeedback(request, gains / scale, poles[np.lexsort((poles.imag, -poles.real))])


def _equations(graph: BondGraph, request: FeedbackRequest) -> tuple[Array, Array, Array, Array]:
    """Return A and B in the states of a request, and C and D of the weighted variables."""
    ports = dict.fromkeys([*request.states, *request.state_weights])
    reduced = ReducedGraph(with_rational_values(graph), request.sources, list(ports), traced=False)
    exact = rational_matrices(reduced, (), request.sources)
    n, order, rows = len(request.states), exact.A.nrows(), exact.C.tolist()
    names = ", ".join(str(port) for port in request.states)
    if n != order:
        raise UsageError(
            f"{counted(n, 'state')} of a graph with {order} behind them: {names}",
            remedy=_FULL_SET,
            names=(f"{request.place}.states",),
        )
    direct, *higher = (matrix.tolist() for matrix in exact.feedthrough)
    for row, port in enumerate(ports):
        if any(any(matrix[row]) for matrix in (higher if row >= n else (direct, *higher))):
            what = "a source that is driven" if row < n else "the rate of a source that is driven"
            raise UsageError(
                f"'{port}' follows {what} at once",
                remedy="Name another variable: the flow of an inertia, the displacement of a spring.",
                names=(f"{request.place}.{'states' if row < n else 'weights'}",),
            )
    T = _matrix(rows[:n], n)
    try:
        inverse = T.inv()
    except ZeroDivisionError:
        raise UsageError(
            f"the states depend on each other: {names}",
            remedy=_FULL_SET,
            names=(f"{request.place}.states",),
        ) from None
    weighted, sources = len(ports) - n, len(request.sources)
    C = _matrix(rows[n:], n) * inverse if weighted else _matrix([], n)
    exact_matrices = (T * exact.A * inverse, T * exact.B, C)
    A, B, behind = (_rounded(matrix) for matrix in exact_matrices)
    every = np.vstack([np.eye(n), behind])
    chosen = [list(ports).index(port) for port in request.state_weights]
    D = np.vstack([np.zeros((n, sources)), _rounded(_matrix(direct[n:], sources))])
    return A, B, every[chosen], D[chosen]


def _matrix(rows: Sequence[Sequence[Any]], width: int) -> Any:
    from flint import fmpq_mat

    return fmpq_mat(len(rows), width, [entry for row in rows for entry in row])


def _rounded(matrix: Any) -> Array:
    entries = [[int(entry.p) / int(entry.q) for entry in row] for row in matrix.tolist()]
    return np.array(entries, dtype=float).reshape(matrix.nrows(), matrix.ncols())


def _least_cost(A: Array, B: Array, C: Array, D: Array, request: FeedbackRequest) -> Array:
    """Return the gains of the least integral of y' W y + u' R u, y = C x + D u."""
    import control

    W = np.array([float(weight) for weight in request.state_weights.values()])[:, None]
    Q, N = C.T @ (W * C), C.T @ (W * D)
    R = np.diag([float(weight) for weight in request.source_weights]) + D.T @ (W * D)
    try:
        gains, S, _ = control.lqr(A, B, Q, R, N, method="scipy")
    except (np.linalg.LinAlgError, ValueError, control.ControlArgument) as error:
        raise NumericalError(
            f"there is no gain of least cost: {str(error).rstrip('.')}",
            remedy="Let a source reach every unstable mode, and give every mode on the axis a weight.",
            names=(request.place,),
        ) from None
    back = S @ B + N
    terms = A.T @ S + S @ A, back @ np.linalg.solve(R, back.T), Q
    residual = np.abs(terms[0] - terms[1] + terms[2]).max()
    unstable = np.linalg.eigvals(A - B @ gains).real.max() >= 0
    if unstable or not residual <= _RICCATI_RTOL * max(np.abs(term).max() for term in terms):
        raise NumericalError(
            "the gains of least cost leave a mode undamped, or are lost to rounding",
            remedy="Give every mode a weight, and choose weights nearer to each other.",
            names=(request.place,),
        )
    return np.asarray(gains)


def _placed(A: Array, B: Array, request: FeedbackRequest) -> Array:
    """Return the gains that place the poles."""
    import control

    try:
        gains = np.asarray(control.place(A, B, request.poles))
    except ValueError as error:
        raise NumericalError(
            f"the poles are not placed: {str(error).rstrip('.')}",
            remedy="Choose poles that differ: one is repeated at most as often as there are driven sources.",
            names=(f"{request.place}.poles",),
        ) from None
    reached = np.linalg.eigvals(A - B @ gains)
    size = max(np.abs(reached).max(), np.abs(request.poles).max())
    from scipy.optimize import linear_sum_assignment

    distances = np.abs(np.subtract.outer(reached, np.asarray(request.poles)))
    if not distances[linear_sum_assignment(distances)].max() <= _PLACED_RTOL * size:
        raise NumericalError(
            "the poles are not reached: no source moves a mode, or gains are lost to rounding",
            remedy="Let the sources reach every mode, or choose poles nearer to those of the graph.",
            names=(f"{request.place}.poles",),
        )
    return gains


def feedback_loops(graph: BondGraph, feedback: StateFeedback) -> tuple[BondGraph, list[Loop]]:
    """Return a graph with the sums that are fed back, and a loop from each to its source."""
    request, circuit = feedback.request, Circuit(graph)
    measured = [circuit.measure(port, "states") for port in request.states]
    targets = {port: circuit.signal(name) for port, name in request.setpoints.items()}
    loops = []
    for source, gains in zip(request.sources, feedback.gains.tolist(), strict=True):
        terms = [(at, scale * to_fraction(gain)) for (at, scale), gain in zip(measured, gains, strict=True)]
        terms += [
            (target, -to_fraction(gains[request.states.index(port)])) for port, target in targets.items()
        ]
        total = Port(circuit.total(f"{source}.feedback", terms), "f", "states")
        reference = request.references.get(source, "")
        loops.append(Loop(total, source, [Fraction(1)], [Fraction(1)], reference, place=request.place))
    return BondGraph(circuit.nodes.values(), circuit.bonds), loops


def add_feedback(result: Result, feedback: StateFeedback, graph: BondGraph) -> None:
    """Add the gains of states by driven source, and the poles of the closed loop."""
    request, units = feedback.request, GraphUnits(graph)
    result.add_axis(f"{GROUP}/source", list(request.sources))
    result.add_axis(f"{GROUP}/state", [str(port) for port in request.states])
    result.add(f"{GROUP}/gain", feedback.gains, ("source", "state"))
    pairs = [[(units.of_input(s), units.of_output(x)) for x in request.states] for s in request.sources]
    texts = [[unit_quotient(*pair) if all(pair) else "" for pair in row] for row in pairs]
    if any(map(any, texts)):
        result.add(f"{GROUP}/unit", np.array(texts, dtype=object), ("source", "state"))
    result.add_axis(f"{GROUP}/pole", np.arange(1, len(feedback.poles) + 1))
    result.add(f"{GROUP}/poles", feedback.poles, ("pole",), "rad/s")
    result.annotate(GROUP, method="lqr" if request.source_weights else "placement")
