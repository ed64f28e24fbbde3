"""Frequency responses of a graph as functions of unknown parameters, with exact derivatives.

The reduction to each output is written once, in terms of the parameters, with its derivatives. It runs in
double precision with error bounds at all frequencies; frequencies at which a bound is too large are run
again in ball arithmetic. So responses keep their digits where state equations lose them: at frequencies far
below or above the fastest mode of a stiff graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.descriptor import contradiction
from dynid.bondgraph.frequency_response import Bounded
from dynid.bondgraph.parametric_program import ParametricProgram, Tape
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.reduction.reducer import reduce_graph

#: Largest error bound over the response; of a derivative, over it or the response over the parameter.
_TOLERANCE = 1e-10


class ParametricResponse:
    """The responses of a graph's outputs to its inputs at s = j omega.

    Parameters
    ----------
    reduced
        The graph with its inputs and outputs; nodes may depend on parameters.
    unknown
        The names of the parameters to differentiate by.

    Raises
    ------
    Singular
        Where the equations have no unique solution whatever the parameters are.
    """

    def __init__(self, reduced: ReducedGraph, unknown: Sequence[str]) -> None:
        program = self._program = ParametricProgram(reduced.graph, unknown)
        self._shape = len(reduced.outputs), len(reduced.inputs)
        self._unknown = tuple(unknown)
        channels: list[int] = []
        try:
            for port in reduced.outputs:
                found = reduce_graph(reduced.structure, program, port, reduced.inputs, traced=False).channels
                channels += [found.get(source, program.zero) for source in reduced.inputs]
            slopes = program.slopes(channels)
        except ZeroDivisionError:
            raise contradiction() from None
        self._registers = [
            *channels,
            *(slope.get(name, program.zero) for slope in slopes for name in self._unknown),
        ]
        self._tape = Tape(program, self._registers)

    def at(
        self, values: Mapping[str, float], omega: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the responses (L x outputs x inputs), and their derivatives by the parameters (… x p).

        Parameters
        ----------
        values
            The values of the unknown parameters, by name.
        omega
            Angular frequencies, rad/s, not zero (L).

        Raises
        ------
        Singular
            Where a response is infinite, or the equations have no unique solution.
        """
        program, leaves = self._program, self._program.leaves(values)
        bounded = {name: Bounded.rounded(float(number)) for name, number in leaves.items()}
        s = Bounded((1j * omega).astype(np.complex128), np.zeros_like(omega))
        with np.errstate(all="ignore"):
            run = program.run(self._registers, bounded, s, Bounded(np.ones((), dtype=np.complex128), 0.0))
            numbers = [run[register] for register in self._registers]
            found = np.stack([np.broadcast_to(one.value, omega.shape) for one in numbers], axis=-1)
            error = np.stack([np.broadcast_to(one.error, omega.shape) for one in numbers], axis=-1)
            count, size = int(np.prod(self._shape)), np.abs(found)
            theta = np.abs([values[name] for name in self._unknown])
            size[:, count:] = np.maximum(
                size[:, count:],
                (size[:, :count, None] / np.where(theta > 0, theta, np.inf)).reshape(
                    len(omega), size.shape[1] - count
                ),
            )
            trusted = np.all((error <= _TOLERANCE * size) & np.isfinite(found), axis=1)
        for line in np.flatnonzero(~trusted):
            found[line] = self._tape.run(leaves, float(omega[line]))
        return (
            found[:, :count].reshape(len(omega), *self._shape),
            found[:, count:].reshape(len(omega), *self._shape, len(self._unknown)),
        )
