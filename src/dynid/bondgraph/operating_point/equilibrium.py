"""Operating points: equilibria of a graph with laws from seeded starts, or a point that is given."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import numpy as np

from dynid.arithmetic.numbers import OutOfRangeError
from dynid.bondgraph.graph import Port
from dynid.bondgraph.operating_point.element_laws import LawGraph
from dynid.bondgraph.operating_point.equations import LawEquations, LawSystem, at_point, at_rest
from dynid.bondgraph.operating_point.newton import CONSISTENT, Factor, NewtonSolution, iterate, refined
from dynid.bondgraph.operating_point.nonlinear_dynamics import LawDynamics
from dynid.defaults import DENSE_EQUILIBRIUM
from dynid.errors import Diverged, NumericalError, Singular, UsageError
from dynid.progress import report_progress

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SOLUTION_TOL = 1e-7  # two solutions are one within it, relative to the larger one
#: Rates beside the terms of their balance above which a given point is no equilibrium.
_EQUILIBRIUM_TOL = 1e-6

Choice = Literal["nearest", "stable"] | int


@dataclass(frozen=True)
class OperatingPointRequest:
    """An operating point to find or to take."""

    #: Constant values of sources. Others are zero at an equilibrium, and free at a given point.
    inputs: Mapping[str, Fraction] = field(default_factory=dict)
    #: Values of variables that give the point; empty: an equilibrium is solved for.
    values: Mapping[Port, Fraction] = field(default_factory=dict)
    #: Values of variables where the iteration starts; of conserved quantities it determines the value.
    start: Mapping[Port, Fraction] = field(default_factory=dict)
    #: starts, seed: Number of further, random starts, and their seed.
    starts: int = 16
    seed: int = 0
    #: Ranges of variables at the random starts.
    ranges: Mapping[Port, tuple[float, float]] = field(default_factory=dict)
    #: The equilibrium to analyse: the first one found, from the start where that leads to one; the first
    #: stable one; or one by its number from 1.
    choose: Choice = "nearest"


@dataclass(frozen=True)
class OperatingPoint:
    """A point of a graph with laws."""

    equations: LawEquations
    request: OperatingPointRequest
    solution: NewtonSolution
    #: All equilibria found, in the order of their distance from the start; of a given point none.
    equilibria: tuple[NewtonSolution, ...] = ()
    #: By equilibrium 1 where all natural modes decay, -1 where one grows, 0 where one does neither.
    stable: tuple[int, ...] = ()
    number: int = 0  # number of the chosen one, from 1; 0 of a given point
    warnings: tuple[str, ...] = ()

    def value(self, port: Port) -> float:
        """Return the value of a variable."""
        return float(self.solution.z[self.equations.column(port)])


def find_operating_point(model: LawGraph, request: OperatingPointRequest) -> OperatingPoint:
    """Return the operating point of a graph with laws.

    Raises `Singular` where there is no equilibrium, or a law needs a variable that the point leaves open.
    Raises `Diverged` where no start leads to an equilibrium.
    """
    integrals = [port for port in (*request.values, *request.start, *request.ranges) if port.quantity in "qp"]
    equations = LawEquations(model, integrals)
    return _given(equations, request) if request.values else _solved(equations, request)


# --- an equilibrium --------------------------------------------------------------------------------


def _solved(equations: LawEquations, request: OperatingPointRequest) -> OperatingPoint:
    system = at_rest(equations, request.inputs, request.start)
    start = _vector(equations, request.start)
    solutions: list[NewtonSolution] = []
    worst: NewtonSolution | None = None
    for z in _first_starts(system, start):
        solution = _solution(system, z)
        if solution is not None and solution.residual <= CONSISTENT:
            solutions.append(solution)
            break
        worst = worst or solution
    reference = solutions[0].z if solutions else start
    if not (solutions and solutions[0].free):
        for number, z in enumerate(_random_starts(equations, request, start, reference), 1):
            report_progress(f"equilibrium from start {number} of {request.starts}")
            solution = _solution(system, z)
            if solution is None or solution.residual > CONSISTENT or solution.free:
                worst = worst or solution
            elif not any(_equal(solution, solution_before) for solution_before in solutions):
                solutions.append(solution)
    if not solutions:
        raise _no_equilibrium(equations, worst)
    scale = np.max([np.abs(solution.z) for solution in solutions], axis=0)
    scale[scale == 0] = 1.0
    first, rest = solutions[0], solutions[1:]
    rest.sort(key=lambda solution: float(np.abs((solution.z - first.z) / scale).max()))
    equilibria = (first, *rest)
    stable = tuple(_stability(equations, request.inputs, solution) for solution in equilibria)
    number = _chosen(request.choose, stable)
    chosen = equilibria[number - 1]
    return OperatingPoint(
        equations,
        request,
        chosen,
        equilibria,
        stable,
        number,
        warnings=tuple(_warnings(equations, request, chosen, len(equilibria), number)),
    )


def _chosen(choose: Choice, stable: tuple[int, ...]) -> int:
    count = len(stable)
    if isinstance(choose, int):
        if choose > count:
            raise Singular(
                f"equilibrium {choose} is chosen, but {count} {'was' if count == 1 else 'were'} found",
                remedy="Choose another one, or give more starts or their ranges in 'operating_point.search'.",
                names=("operating_point.choose",),
            )
        return choose
    if choose == "stable":
        if 1 not in stable:
            raise Singular(
                f"none of the {count} equilibria found is stable"
                if count > 1
                else "the equilibrium is not stable",
                remedy="Write 'choose: nearest' to analyse it, or more starts in 'operating_point.search'.",
                names=("operating_point.choose",),
            )
        return stable.index(1) + 1
    return 1


def _warnings(
    equations: LawEquations, request: OperatingPointRequest, chosen: NewtonSolution, count: int, number: int
) -> Iterator[str]:
    if count > 1:
        yield (
            f"{count} equilibria were found; number {number} is analysed ({request.choose}): choose another "
            "one by 'operating_point.choose', or give a start"
        )
    if chosen.free:
        names = [str(port) for port in equations.states if equations.column(port) in chosen.free]
        what = ", ".join(names) or "some variables"
        where = "taken near 'operating_point.start'"
        yield f"the equilibrium is singular: it does not determine {what}; {where}"


def _no_equilibrium(equations: LawEquations, worst: NewtonSolution | None) -> NumericalError:
    if worst is not None:
        return Singular(
            f"there is no equilibrium: the balance at '{worst.worst}' cannot be met, "
            f"{worst.residual:.2g} of its terms is left",
            remedy="Change 'operating_point.inputs', or give the point itself by 'operating_point.values'.",
            names=(worst.worst, "operating_point"),
        )
    return Diverged(
        "no equilibrium was found from any start",
        remedy=(
            "Give values near it in 'operating_point.start', or ranges of variables and more starts in "
            "'operating_point.search'; the laws may have none at these inputs."
        ),
        names=("operating_point", *equations.model.laws),
    )


def _solution(system: LawSystem, z: NDArray[np.float64]) -> NewtonSolution | None:
    """Return the solution that a start leads to; None where it leads to none, or out of a law's domain."""
    solution = iterate(system, z)
    if solution is None:
        return None
    try:
        return refined(system, *solution)
    except OutOfRangeError:  # at the edge of the domain, as sqrt at 0
        return None


def _vector(equations: LawEquations, values: Mapping[Port, Fraction]) -> NDArray[np.float64]:
    z = np.zeros(equations.size)
    for port, value in values.items():
        z[equations.column(port)] = float(value)
    return z


def _first_starts(system: LawSystem, start: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Yield the start, and solutions of linear graphs: every law replaced by a line through the origin."""
    yield start
    equations, laws = system.equations, system.equations.model.laws
    for slope in (1, 10**6, 10**-6, 10**12):
        linear = list(system.linear)
        for row in equations.laws:
            right = row.factor
            if right < 0:
                right = equations.column(equations.model.own(row.node))
            steep = Fraction(slope) if laws[row.node].gives == "e" else 1 / Fraction(slope)
            factor = Fraction(1) if laws[row.node].gives == "value" else steep
            linear.append((row.node, {row.out: Fraction(1), right: -row.sign * factor}, Fraction(0)))
        residual, matrix = LawSystem(equations, linear, lines=True, fixed=system.fixed).residual(start)
        try:
            factors = Factor(matrix, system.fixed)
        except (OutOfRangeError, np.linalg.LinAlgError):
            continue
        yield start - factors.scale * factors.solve(residual)


def _random_starts(
    equations: LawEquations,
    request: OperatingPointRequest,
    start: NDArray[np.float64],
    reference: NDArray[np.float64],
) -> Iterator[NDArray[np.float64]]:
    """Yield random multiples of a solution; variables that are zero in it have the size 1."""
    random = np.random.default_rng(request.seed)
    held = [equations.column(port) for port in request.start]
    for _ in range(request.starts):
        size = np.where(reference == 0, 1.0, np.abs(reference))
        z = size * random.choice([-1.0, 1.0], len(start)) * 10 ** random.uniform(-2, 1, len(start))
        z[held] = start[held] * random.uniform(-2, 2, len(held))
        for port, (low, high) in request.ranges.items():
            z[equations.column(port)] = random.uniform(low, high)
        yield z


def _equal(a: NewtonSolution, b: NewtonSolution) -> bool:
    size = np.maximum(np.abs(a.z), np.abs(b.z))
    scaled = size / a.scale
    floor = _SOLUTION_TOL * float(scaled.max(initial=0.0)) * a.scale
    return bool((np.abs(a.z - b.z) <= np.maximum(_SOLUTION_TOL * size, 1e-5 * floor)).all())


def _stability(equations: LawEquations, inputs: Mapping[str, Fraction], solution: NewtonSolution) -> int:
    """Return 1 where all natural modes at an equilibrium decay, -1 where one grows, else 0."""
    if equations.size > DENSE_EQUILIBRIUM.value:
        return 0
    sources = tuple(inputs)
    u = np.array([float(inputs[name]) for name in sources])
    modes, size = LawDynamics(equations, solution.z, sources).natural_modes(u)
    modes = np.where(np.abs(modes) <= 1e-7 * size, 0.0, modes)  # what rounding makes of repeated zeros
    margin = 1e-9 * float(np.abs(modes).max(initial=0.0))
    if (modes.real > margin).any():
        return -1
    return 1 if (modes.real < -margin).all() else 0


# --- a given point ---------------------------------------------------------------------------------


def _given(equations: LawEquations, request: OperatingPointRequest) -> OperatingPoint:
    """Return a given point: what follows from the values by the equations, rates free."""
    _check_values(equations, request.values)
    system = at_point(equations, request.inputs, request.values)
    z = _vector(equations, request.values)
    solution = None
    for start in (z, *_first_starts(system, z)):
        solution = _solution(system, start)
        if solution is not None:
            break
    if solution is None:
        raise Diverged(
            "the variables at the given point cannot be determined from its values",
            remedy="Give the values of all variables of the laws in 'operating_point.values'.",
            names=("operating_point.values",),
        )
    solution = _with_values(equations, solution, request.values)
    needed = {column: row.node for row in equations.laws for column in (*row.arguments, row.factor)}
    missing = [equations.port(column) for column in needed if column in solution.free]
    if missing:
        names = ", ".join(f"'{port}'" for port in missing)
        node = next(name for column, name in needed.items() if column in solution.free)
        raise Singular(
            f"the operating point does not determine {names}, which the law of '{node}' needs",
            remedy="Give its value in 'operating_point.values', or the inputs in 'operating_point.inputs'.",
            names=("operating_point.values", node),
        )
    warnings = []
    if solution.residual > CONSISTENT:
        warnings.append(
            f"the given values contradict the equations: at '{solution.worst}' {solution.residual:.2g} of "
            "the terms is left"
        )
    drift = {}
    for port, rate in zip(equations.states, equations.rates, strict=True):
        opposite = float(np.abs(solution.z[equations.beside(rate)]).max())
        if rate not in solution.free and abs(solution.z[rate]) > _EQUILIBRIUM_TOL * opposite:
            drift[port] = float(solution.z[rate])
    if drift:
        rates = ", ".join(f"d({port})/dt = {value:.4g}" for port, value in drift.items())
        warnings.append(
            f"the given point is no equilibrium: {rates}; the linear results hold near it for a short time"
        )
    return OperatingPoint(equations, request, solution, warnings=tuple(warnings))


def _check_values(equations: LawEquations, values: Mapping[Port, Fraction]) -> None:
    """Raise where two names of one variable have different values."""
    ports: dict[int, Port] = {}
    for port, value in values.items():
        port_before = ports.setdefault(equations.column(port), port)
        if values[port_before] != value:
            raise UsageError(
                f"'{port_before}' and '{port}' are one variable, and their values differ",
                remedy="Give one of them in 'operating_point.values'.",
                names=("operating_point.values",),
            )


def _with_values(
    equations: LawEquations, solution: NewtonSolution, values: Mapping[Port, Fraction]
) -> NewtonSolution:
    """Return a solution with the given values as they are given."""
    from flint import arb, fmpq

    z, exact = solution.z.copy(), [*solution.exact]
    for port, value in values.items():
        column = equations.column(port)
        z[column], exact[column] = float(value), arb(fmpq(value.numerator, value.denominator))
    return replace(solution, z=z, exact=exact)
