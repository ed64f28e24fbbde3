"""The frequency response of a graph, certified at every frequency.

The reduction runs on complex arrays that carry their error bounds: in double precision where the graph is
small, in doubled precision, compiled, where it is large and roundings could add up. Where a pivot (nearly)
vanishes at a frequency the bound says so, and that point is run again in ball arithmetic with as many bits
as it takes. A large graph is planned again for that frequency, with pivots that do not vanish there; one
whose bounds grow along its loops (a ladder, a ring) is planned again with short ways through them. At a
point exactly on a natural mode of the graph, or of a part of it, the order of the response there is counted
exactly: it is infinite, zero, or finite, and then taken from beside it. At rest it is an exact limit.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.program.bounded import bounded_response
from dynid.bondgraph.program.program import Program, Tape
from dynid.bondgraph.reduced_graph import GraphProgram, ReducedGraph
from dynid.defaults import COMPILED_RESPONSES, PLANNED_ANEW
from dynid.errors import NumericalError, Singular
from dynid.number_format import frequency_text

#: A point whose relative error bound exceeds this, for every ten operations, is computed again. The bound
#: adds up worst cases: in long chains it lies a thousand times above the true error (3e-14 at 300 stages).
_RESPONSE_TOL = 1e-12
#: Programs longer than this run in doubled precision, with bounds below 1e-12 whatever their length. For
#: shorter ones translating the program into the library's instructions does not pay.
_LONG = COMPILED_RESPONSES.value
#: Responses smaller than this are near the end of the range of doubles: 1e-12 of this is their error bound.
_MIN_RESPONSE = 1e-290
#: Operations in ball arithmetic, over all points, that take as long as planning a graph anew.
_ANEW = PLANNED_ANEW.value
#: Frequencies that are evaluated first where a graph has loops, as many as run at once.
_SAMPLE = 64
_RESPONSE_PRECISIONS = (128, 256, 512)
#: How many bits beside a natural mode what is finite there is taken.
_OFFSET_BITS = 150

#: Finds the same registers in a plan made anew.
Again = Callable[[Any], list[int]]


def frequency_response(reduced: ReducedGraph, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return T(j omega), shape (omega, output, input); a pole on the axis gives inf.

    Raises `NumericalError` where a natural mode is so near to a frequency that no precision is enough.
    """

    def channels(planned: ReducedGraph) -> list[int]:
        return list(planned.channels().values())

    if reduced.nodal is not None and reduced.inputs:
        solution, bounds = reduced.nodal.at(np.asarray(omega, dtype=float))
        trusted = np.all(bounds <= _RESPONSE_TOL * np.abs(solution), axis=(1, 2))
        for point in np.flatnonzero(~trusted):
            certified = _certified(reduced, channels(reduced), float(omega[point]), channels)
            solution[point] = np.reshape(certified, solution.shape[1:])
        return solution
    response = on_axis(reduced, channels(reduced), omega, channels)
    return response.reshape(len(omega), len(reduced.outputs), len(reduced.inputs))


def on_axis(
    planned: GraphProgram, registers: list[int], omega: NDArray[np.float64], again: Again | None = None
) -> NDArray[np.complex128]:
    """Return registers at s = j omega, shape (omega, register); a pole on the axis gives inf.

    `again` finds the same registers where the graph is planned anew; default: it is not.
    """
    if not registers:
        return np.zeros((len(omega), 0), dtype=np.complex128)
    evaluate = _doubled if len(planned.program) > _LONG else _double
    balanced = again is not None and planned.has_short_paths
    if again is not None and balanced:
        planned, evaluate = planned.balanced(), _doubled
        registers = again(planned)
    looped, stride = len(planned.graph.bonds) >= len(planned.graph.nodes), len(omega) // _SAMPLE
    # points that cost as much in ball arithmetic as another plan: the library makes that faster than one
    many = 0 if looped and type(planned.program) is not Program else _ANEW / len(planned.program)
    if again is not None and not balanced and looped and stride > 1 and len(omega) > many:
        _, trusted = evaluate(planned, registers, omega[::stride])  # they show whether the plan serves
        if stride * np.count_nonzero(~trusted) > many:
            planned, evaluate, balanced = planned.balanced(), _doubled, True
            registers = again(planned)
    response, trusted = evaluate(planned, registers, omega)
    unsure = np.flatnonzero(~trusted)
    if again is not None and not balanced and len(unsure) > many:
        planned = planned.balanced()
        registers = again(planned)
        response[unsure], trusted = _doubled(planned, registers, omega[unsure])
        unsure = unsure[~trusted]
    for point in unsure:
        response[point] = _certified(planned, registers, float(omega[point]), again)
    return response


def _doubled(
    planned: GraphProgram, registers: list[int], omega: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.bool_]]:
    """Return the registers from doubled precision, and at which points all can be trusted."""
    from dynid.bondgraph.program.frequency_sweep import sweep_frequencies

    response, bounds = sweep_frequencies(planned.program, registers, planned.graph.value, omega)
    with np.errstate(all="ignore"):
        trusted = bounds <= _RESPONSE_TOL * np.maximum(np.abs(response), _MIN_RESPONSE)
    return response, np.all(trusted & np.isfinite(response), axis=1)


def _double(
    planned: GraphProgram, registers: list[int], omega: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.bool_]]:
    """Return the registers from double precision, and at which points all can be trusted."""
    values = {name: planned.graph.value(name) for name in planned.valued}
    response, bounds = bounded_response(Tape(planned.program, registers), values, omega)
    with np.errstate(invalid="ignore"):
        trusted = bounds <= _RESPONSE_TOL * max(1.0, len(planned.program) / 10) * np.abs(response)
    return response, np.all(trusted & np.isfinite(response), axis=1)


def _certified(
    planned: GraphProgram, registers: list[int], omega: float, again: Again | None
) -> list[complex]:
    """Return the channels at one frequency to full double precision; inf at a pole."""
    if omega == 0.0:  # where storage elements block, hardly a program can be run
        return _at_rest(planned, registers, again)
    values = _planned_again(planned, omega, again) if len(planned.program) > _LONG else None
    values = values or _in_balls(planned, registers, omega) or _on_a_mode(planned, registers, omega)
    if values is None and again is not None:  # long ways through loops may be what costs the digits
        planned = planned.balanced()
        response, trusted = _doubled(planned, again(planned), np.array([omega]))
        values = response[0].tolist() if trusted[0] else None
    if values is None:
        raise NumericalError(
            f"the frequency response at {frequency_text(omega, 17)}: this graph, or a part of it, has a "
            f"natural mode so near that {_RESPONSE_PRECISIONS[-1]} bits do not distinguish the two",
            remedy="Leave this frequency out, or move it by a little.",
        )
    return values


def _at_rest(planned: GraphProgram, registers: list[int], again: Again | None) -> list[complex]:
    """Return the limits of registers at rest; large graphs are planned again where they depend on loops."""
    from dynid.bondgraph.floating.series import SERIES_PRECISIONS, limits_at_rest

    if again is not None and len(planned.program) > _LONG:
        try:
            limits = limits_at_rest(planned, registers, SERIES_PRECISIONS[:1])
        except NumericalError:
            planned = planned.balanced()
            return _at_rest(planned, again(planned), None)
    else:
        limits = limits_at_rest(planned, registers)
    return [complex(limits[register]) for register in registers]


def _planned_again(planned: GraphProgram, omega: float, again: Again | None) -> list[complex] | None:
    """Return registers at one frequency from a plan for it, or none where that does not help."""
    if again is None:
        return None
    try:
        planned = planned.on_axis(Fraction(omega))
    except (Singular, ZeroDivisionError):
        return None
    registers = again(planned)
    response, trusted = _doubled(planned, registers, np.array([omega]))
    return response[0].tolist() if trusted[0] else _in_balls(planned, registers, omega)


def _in_balls(
    planned: GraphProgram, registers: list[int], omega: float, aside: int | None = None
) -> list[complex] | None:
    """Return registers at one frequency from ball arithmetic, or none where no precision is enough.

    `aside` is how many bits smaller than the frequency a real part to add to s is.
    """
    from flint import acb, arb, ctx, fmpq

    for precision in _RESPONSE_PRECISIONS:
        with ctx.workprec(precision):
            exact = {name: planned.graph.value(name) for name in planned.valued}
            values = {name: acb(arb(fmpq(v.numerator, v.denominator))) for name, v in exact.items()}
            s = acb(arb(omega) / arb(2) ** aside if aside else 0, omega)
            balls = planned.run(registers, values, s, acb(1))
            if all(ball.is_zero() or ball.rel_accuracy_bits() > 60 for ball in balls.values()):
                middles = [(balls[register].real.mid(), balls[register].imag.mid()) for register in registers]
                return [complex(float(real), float(imaginary)) for real, imaginary in middles]
    return None


def _on_a_mode(planned: GraphProgram, registers: list[int], omega: float) -> list[complex] | None:
    """Return registers where a part of the graph has a natural mode exactly: infinite, zero, or finite.

    What is finite is taken at two distances beside that mode: it must be the same.
    """
    from dynid.bondgraph.floating.series import orders_on_axis

    orders = orders_on_axis(planned, registers, Fraction(omega))
    limits = {register: complex(np.inf if order < 0 else 0.0) for register, order in orders.items() if order}
    finite = [register for register in registers if register not in limits]
    near, nearer = (_in_balls(planned, finite, omega, aside) for aside in (_OFFSET_BITS, _OFFSET_BITS + 8))
    if near is None or nearer is None or not np.allclose(near, nearer, rtol=1e-15, atol=0.0):
        return None
    limits |= dict(zip(finite, near, strict=True))
    return [limits[register] for register in registers]
