"""Frequency responses of graphs with feedback, with the delays of loops as they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.ldl import reference
from dynid.arrays import ComplexArray
from dynid.bondgraph.controller_circuits import Loop, close_loops
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.reduced_graph import ReducedGraph

#: Condition of I + L above which a pole lies on the axis.
_MAX_LOOP_CONDITION = 1e12


def delayed_response(
    opened: BondGraph, loops: Sequence[Loop], inputs: Sequence[str], outputs: Sequence[Port]
) -> Callable[[NDArray[np.float64]], ComplexArray]:
    """Return the frequency response of a graph with feedback, with the delays as they are.

    The response without the delays is certified; the delays turn what is fed back by exp(-jωτ) - 1. Where
    the loops without their delays have a pole on the axis, they are taken open instead.

    Of angular frequencies in rad/s, it returns the response, shape (omega, output, input).
    """
    closed = close_loops(opened, loops)
    outputs = [closed.variables.get(port, port) for port in outputs]
    approximate = ReducedGraph(closed.graph, inputs, outputs, traced=False)
    bases: dict[bool, Callable[[NDArray[np.float64]], ComplexArray]] = {}

    def evaluate(omega: NDArray[np.float64]) -> ComplexArray:
        response = np.zeros((len(omega), len(outputs), len(inputs)), dtype=complex)
        rest = omega == 0  # there the approximants are exact
        response[rest] = frequency_response(approximate, omega[rest])
        left = np.flatnonzero(~rest)
        for cut in (False, True):
            if cut not in bases and len(left):
                bases[cut] = _turned_response(opened, loops, inputs, outputs, cut=cut)
            if len(left):
                response[left] = bases[cut](omega[left])
                left = left[~np.isfinite(response[left]).all(axis=(1, 2))]
        return response

    return evaluate


def _turned_response(
    opened: BondGraph, loops: Sequence[Loop], inputs: Sequence[str], outputs: Sequence[Port], *, cut: bool
) -> Callable[[NDArray[np.float64]], ComplexArray]:
    """Return the response with delays, from that of the graph whose delayed loops are prompt, or cut."""
    names = {*opened.nodes, *(name for loop in loops for name in (loop.reference, loop.setpoint)), *inputs}
    late, base = list[tuple[int, str]](), list[Loop]()
    for number, loop in enumerate(loops):
        if not loop.delayed:
            base.append(loop)
            continue
        probe = loop.reference or f"delayed_{number}"
        while probe in names and not loop.reference:
            probe += "_"
        late.append((number, probe))
        answer = [Fraction(0)] if cut else loop.numerator
        base.append(replace(loop, numerator=answer, delay=Fraction(0), reference=probe))
    closed = close_loops(opened, base)
    measured = [closed.answered[number] for number, _ in late]
    rows = list(dict.fromkeys([*outputs, *measured]))
    columns = list(dict.fromkeys([*inputs, *(probe for _, probe in late)]))
    reduced = ReducedGraph(closed.graph, columns, rows, traced=False)
    shown, fed_back = [rows.index(port) for port in outputs], [rows.index(port) for port in measured]
    driven, fed = [columns.index(name) for name in inputs], [columns.index(probe) for _, probe in late]

    def evaluate(omega: NDArray[np.float64]) -> ComplexArray:
        prompt = frequency_response(reduced, omega)
        s = (1j * omega).astype(np.complex128)
        turns = np.stack([_answer(loops[number], s, cut=cut) for number, _ in late], axis=-1)
        with np.errstate(all="ignore"):
            back = prompt[:, :, fed] * turns[:, None, :]
            matrix = np.eye(len(late)) + back[:, fed_back]
            response = np.full((len(omega), len(shown), len(driven)), np.inf, dtype=complex)
            finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(prompt).all(axis=(1, 2))
            solvable = np.flatnonzero(finite)
            solvable = solvable[np.linalg.cond(matrix[solvable]) < _MAX_LOOP_CONDITION]
            solved = np.linalg.solve(matrix[solvable], prompt[solvable][:, fed_back][:, :, driven])
            response[solvable] = prompt[solvable][:, shown][:, :, driven] - back[solvable][:, shown] @ solved
        return response

    return evaluate


def _answer(loop: Loop, s: ComplexArray, *, cut: bool) -> ComplexArray:
    """Return the controller times exp(-s τ), less the controller without its delay unless that is cut."""
    parts = (loop.numerator, loop.denominator)
    top, bottom = (np.polyval([float(reference(c)) for c in part], s) for part in parts)
    turn = -s * float(reference(loop.delay))
    with np.errstate(all="ignore"):
        return np.asarray(top / bottom * (np.exp(turn) if cut else np.expm1(turn)))
