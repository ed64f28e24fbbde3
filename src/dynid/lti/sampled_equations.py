"""A plant between sampled controllers, from one sample to the next, in exact numbers and balls.

Every controller measures at the instants k T, before what is held changes, and holds its answer (zero-order
hold) from its computation time c = l T + ε on, so that over a period the held input is first u[k-l-1], for ε,
and then u[k-l] (the modified z-transform, exactly). With x of the plant, the answers under way and the states
of the controllers, the closed loops are a matrix M of matrix exponentials: balls of as many bits as needed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.lti.discrete_controller import DiscreteController, Rows, as_fmpq
from dynid.lti.minimal_realisation import ExactSystem

#: Bits of what is rounded to doubles.
DOUBLE_BITS = 64
#: Exponentials that are kept: those of the margins of a loop, and of some trials.
_KEPT_EXPONENTIALS = 16


class SampledEquations:
    """A plant whose input j controller j drives by what it measures of output j.

    `controllers`: the controllers, made discrete for a period, s, in balls of the working precision.
    """

    def __init__(
        self, plant: ExactSystem, controllers: Callable[[Fraction], list[DiscreteController]]
    ) -> None:
        self.plant, self._controllers = plant, controllers
        self._converted = dict[tuple[int, int], Rows]()  # matrices of the plant in balls
        self._exponentials = dict[tuple[Fraction, int], tuple[Any, Any]]()

    def matrix(
        self, period: Fraction, computations: Sequence[Fraction], closed: Collection[int], bits: int
    ) -> Any:
        """Return the matrix of the states from one sample to the next (flint `arb_mat`)."""
        from flint import arb_mat, ctx

        with ctx.workprec(bits):
            rows, size = self._rows(period, computations, closed, bits)
            return arb_mat([row[:size] for row in rows[:size]])

    def answers(self, period: Fraction, computations: Sequence[Fraction]) -> tuple[Array, ...]:
        """Return M, B, C and D of what the closed loops answer to sequences added to measurements."""
        rows, n = self._rows(period, computations, range(len(computations)), DOUBLE_BITS)
        values = np.array([[float(entry) for entry in row] for row in rows])
        return values[:n, :n], values[:n, n:], values[n:, :n], values[n:, n:]

    def _rows(
        self, period: Fraction, computations: Sequence[Fraction], closed: Collection[int], bits: int
    ) -> tuple[Rows, int]:
        """Return rows of the next states and of the answers, over states and what is added to measurements.

        The second value is the number of states.
        """
        from flint import arb, ctx

        with ctx.workprec(bits):
            controllers = self._controllers(period)
            steps = [int(delay // period) for delay in computations]
            rests = [delay - step * period for delay, step in zip(computations, steps, strict=True)]
            Phi, newest, before = self._held(period, rests, bits)
            C, D = self._balls(self.plant.C, bits), self._balls(self.plant.D, bits)
            n, zero, one = len(Phi), arb(0), arb(1)
            depths = [
                step + bool(rest or any(row[j] for row in self.plant.D))
                for j, (step, rest) in enumerate(zip(steps, rests, strict=True))
            ]
            first = n + np.concatenate([[0], np.cumsum(depths)])
            states = first[-1] + np.concatenate([[0], np.cumsum([len(c.h) for c in controllers])])
            size = int(states[-1])
            total = size + len(controllers)
            matrix = [[zero] * total for _ in range(total)]

            def add(row: list[Any], addend: Iterable[tuple[int, Any]], factor: Any = one) -> None:
                for column, value in addend:
                    row[column] += factor * value

            measured = []
            for j in range(len(controllers)):
                late = [(int(first[i]) + steps[i], value) for i, value in enumerate(D[j]) if value != 0]
                now = [(i, value) for i, value in enumerate(C[j]) if value != 0]
                measured.append([*now, *late, (size + j, one)])
            for j, controller in enumerate(controllers):
                row = matrix[size + j]
                if j in closed:
                    add(row, ((int(states[j]) + i, value) for i, value in enumerate(controller.h)), -one)
                    add(row, measured[j], -controller.d)
                answer = [(column, value) for column, value in enumerate(row) if value != 0]
                held = [answer, *([(int(first[j]) + k, one)] for k in range(depths[j]))]
                for i in range(n):
                    add(matrix[i], held[steps[j]], newest[i][j])
                    if rests[j]:
                        add(matrix[i], held[steps[j] + 1], before[i][j])
                for k in range(depths[j]):
                    add(matrix[int(first[j]) + k], held[k])
                for i, (weights, gain) in enumerate(zip(controller.F, controller.g, strict=True)):
                    state = matrix[int(states[j]) + i]
                    add(state, ((int(states[j]) + k, value) for k, value in enumerate(weights)))
                    add(state, measured[j], gain)
            for i, weights in enumerate(Phi):
                add(matrix[i], enumerate(weights))
            return matrix, size

    def _held(self, period: Fraction, rests: Sequence[Fraction], bits: int) -> tuple[Rows, Rows, Rows]:
        """Return e^(AT), and what an input held over the end of a period adds, and one held over its begin.

        `rests`: by input how long the one before is held, s.
        """
        n, inputs = len(self.plant.A), len(rests)
        if not n:
            return [], [], []
        Phi: Any = None
        newest, before = [[0] * inputs for _ in range(n)], [[0] * inputs for _ in range(n)]
        for j, rest in enumerate(rests):
            Phi, late = self._exponential(period - rest, bits)
            early = None
            if rest:
                earlier, gains = self._exponential(rest, bits)
                Phi, early = Phi * earlier, Phi * gains
            for i in range(n):
                newest[i][j] = late[i, j]
                if early is not None:
                    before[i][j] = early[i, j]
        return Phi.tolist(), newest, before

    def _balls(self, rows: Rows, bits: int) -> Rows:
        from flint import arb

        if (id(rows), bits) not in self._converted:
            self._converted[id(rows), bits] = [[arb(entry) for entry in row] for row in rows]
        return self._converted[id(rows), bits]

    def _exponential(self, time: Fraction, bits: int) -> tuple[Any, Any]:
        """Return e^(At) and its integral times B (flint `arb_mat`)."""
        from flint import arb, arb_mat

        if (time, bits) not in self._exponentials:
            n, inputs = len(self.plant.A), len(self.plant.D)
            rows = zip(self._balls(self.plant.A, bits), self._balls(self.plant.B, bits), strict=True)
            joint = arb_mat([*([*a, *b] for a, b in rows), *([[0] * (n + inputs)] * inputs)])
            E = (joint * arb(as_fmpq(time))).exp().tolist()
            if len(self._exponentials) >= _KEPT_EXPONENTIALS:
                self._exponentials.clear()
            self._exponentials[time, bits] = (
                arb_mat([row[:n] for row in E[:n]]),
                arb_mat([row[n:] for row in E[:n]]),
            )
        return self._exponentials[time, bits]
