"""A plant between sampled controllers, from one sample to the next, in exact numbers and balls.

Every controller measures at the instants k T, before what is held changes, and holds its answer (zero-order
hold) from its computation time c = l T + ε on, so that over a period the held input is first u[k-l-1], for ε,
and then u[k-l] (the modified z-transform, exactly). With x of the plant, the answers under way and the states
of the controllers, the closed loops are a matrix M of matrix exponentials: balls of as many bits as needed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.lti.discrete_controller import DiscreteController, Rows, as_fmpq
from dynid.lti.minimal_realisation import ExactSystem

#: Bits of what is rounded to doubles.
DOUBLE_BITS = 64
#: Exponentials that are kept: those of the margins of a loop, and of some trials.
_KEPT_EXPONENTIALS = 16


class _Period(NamedTuple):
    """What is at the next sample: ``M = base + entering answers`` of the loops that are closed.

    `answers` are those of the controllers to the states; to what is added to what they measure they answer
    ``-direct``, and their states gain `measuring`.
    """

    base: Any  # arb_mat
    entering: Any  # arb_mat
    answers: Rows
    direct: list[Any]
    measuring: Rows


class SampledEquations:
    """A plant whose input j controller j drives by what it measures of output j.

    `controllers`: the controllers, made discrete for a period, s, in balls of the working precision.
    """

    def __init__(
        self, plant: ExactSystem, controllers: Callable[[Fraction], list[DiscreteController]]
    ) -> None:
        self.plant, self._controllers = plant, controllers
        self._converted = dict[tuple[int, int], Rows]()  # matrices of the plant in balls
        self._exponentials = dict[tuple[Fraction, int], Rows]()

    def matrices(
        self,
        period: Fraction,
        computations: Sequence[Fraction],
        sets: Sequence[Collection[int]],
        bits: int,
    ) -> list[Any]:
        """Return the matrix of the states from one sample to the next (flint `arb_mat`), by loops closed."""
        from flint import ctx

        with ctx.workprec(bits):
            over = self._period(period, computations, bits)
            size = over.base.ncols()
            return [
                over.base
                + over.entering
                * _matrix([row if j in closed else [0] * size for j, row in enumerate(over.answers)], size)
                for closed in sets
            ]

    def monodromy(
        self, periods: Sequence[Fraction], computations: Sequence[Fraction], common: Fraction, bits: int
    ) -> Any:
        """Return the matrix of the states over a common multiple of several periods (flint `arb_mat`).

        The states are x, what is held, the answers under way, and those of the controllers, ahead of what
        happens at the instant.
        """
        from flint import ctx

        loops = range(len(periods))
        instants = {
            step * period + late - (step * period + late) // common * common
            for period, computation in zip(periods, computations, strict=True)
            for step in range(int(common / period))
            for late in (0, computation)
        }
        with ctx.workprec(bits):
            controllers = self._controllers(periods[0])
            C, D = self._balls(self.plant.C, bits), self._balls(self.plant.D, bits)
            under_way = [int(c // T) for c, T in zip(computations, periods, strict=True)]
            sizes = [len(self.plant.A), len(loops), *under_way, *(len(part.h) for part in controllers)]
            *_, size = first = [*accumulate(sizes, initial=0)]
            identity = _matrix([[int(i == k) for k in range(size)] for i in range(size)], size).tolist()
            x, held, *blocks = (identity[a:b] for a, b in pairwise(first))
            waiting, states = blocks[: len(loops)], blocks[len(loops) :]
            for now, following in pairwise([*sorted(instants), common]):
                due = [waiting[j] for j in loops]
                for j in loops:
                    if now % periods[j]:
                        continue
                    F, g, h, d, _ = controllers[j]
                    measured = _combined([*C[j], *D[j]], [*x, *held], size)
                    answer = _combined([-d, *(-value for value in h)], [measured, *states[j]], size)
                    states[j] = [
                        _combined([gain, *row], [measured, *states[j]], size)
                        for gain, row in zip(g, F, strict=True)
                    ]
                    due[j] = [*waiting[j], answer]
                for j in loops:
                    if not (now - computations[j]) % periods[j]:
                        held[j], *due[j] = due[j]
                    waiting[j] = due[j]
                moved = self._exponential(following - now, bits)
                x = [_combined(row, [*x, *held], size) for row in moved]
            parts = [x, held, *waiting, *states]
            return _matrix([row for part in parts for row in part], size)

    def answers(self, period: Fraction, computations: Sequence[Fraction]) -> tuple[Array, ...]:
        """Return M, B, C and D of what the closed loops answer to sequences added to measurements."""
        base, entering, C, measuring, D = self._rounded(period, computations)
        return base + entering @ C, measuring + entering @ D, C, D

    def loop(
        self, number: int, period: Fraction, computations: Sequence[Fraction]
    ) -> Callable[[ComplexArray], ComplexArray]:
        """Return L of a loop, the others closed, by z, in double precision."""
        base, entering, answers, *_ = self._rounded(period, computations)
        b, c = entering[:, number, None], answers[number]
        M = base + entering @ answers - np.outer(b, c)

        def evaluate(z: ComplexArray) -> ComplexArray:
            return np.asarray(-(c @ np.linalg.solve(z[:, None, None] * np.eye(len(M)) - M, b + 0j))[:, 0])

        return evaluate

    def _rounded(self, period: Fraction, computations: Sequence[Fraction]) -> tuple[Array, ...]:
        """Return base, entering, answers and measuring in double precision, and what is answered at once."""
        from flint import ctx

        with ctx.workprec(DOUBLE_BITS):
            over = self._period(period, computations, DOUBLE_BITS)
            size, loops = over.base.ncols(), len(computations)
            rows = ((over.base.tolist(), size), (over.entering.tolist(), loops))
            arrays = [
                np.array([[float(entry) for entry in row] for row in part]).reshape(-1, width or 1)
                for part, width in (*rows, (over.answers, size), (over.measuring, loops))
            ]
        return *arrays, -np.diag([float(gain) for gain in over.direct])

    def _period(self, period: Fraction, computations: Sequence[Fraction], bits: int) -> _Period:
        controllers, inputs = self._controllers(period), range(len(computations))
        steps = [int(delay // period) for delay in computations]
        rests = [delay - step * period for delay, step in zip(computations, steps, strict=True)]
        depths = [
            step + bool(rest or any(row[j] for row in self.plant.D))
            for j, (step, rest) in enumerate(zip(steps, rests, strict=True))
        ]
        n = len(self.plant.A)
        sizes = [*depths, *(len(controller.h) for controller in controllers)]
        *first, size = accumulate(sizes, initial=n)
        under_way, states = first[: len(depths)], first[len(depths) :]
        loops = len(inputs)
        base, entering, measuring = ([[0] * width for _ in range(size)] for width in (size, loops, loops))
        whole = self._exponential(period, bits)
        for j in inputs:
            newest = self._exponential(period - rests[j], bits)
            for i in range(n):  # the answer over the end of a period, and the one before over its begin
                row, late = base[i], newest[i][n + j]
                (row if steps[j] else entering[i])[under_way[j] + steps[j] - 1 if steps[j] else j] = late
                if rests[j]:
                    row[under_way[j] + steps[j]] = whole[i][n + j] - late
            if depths[j]:
                entering[under_way[j]][j] = 1
            for k in range(1, depths[j]):
                base[under_way[j] + k][under_way[j] + k - 1] = 1
        for i in range(n):
            base[i][:n] = whole[i][:n]
        answers = []
        C, D = self._balls(self.plant.C, bits), self._balls(self.plant.D, bits)
        for j, (F, g, h, d, _) in enumerate(controllers):
            measured = {k: value for k, value in enumerate(C[j]) if value != 0}
            measured |= {under_way[i] + steps[i]: value for i, value in enumerate(D[j]) if value != 0}
            answer = [0] * size
            for k, value in measured.items():
                answer[k] = -d * value
            answer[states[j] : states[j] + len(h)] = [-value for value in h]
            answers.append(answer)
            for row, weights, gain, measures in zip(
                base[states[j] :], F, g, measuring[states[j] :], strict=False
            ):
                row[states[j] : states[j] + len(h)] = weights
                measures[j] = gain
                for k, value in measured.items():
                    row[k] = gain * value
        directs = [controller.d for controller in controllers]
        return _Period(_matrix(base, size), _matrix(entering, loops), answers, directs, measuring)

    def _balls(self, rows: Rows, bits: int) -> Rows:
        from flint import arb

        if (id(rows), bits) not in self._converted:
            self._converted[id(rows), bits] = [[arb(entry) for entry in row] for row in rows]
        return self._converted[id(rows), bits]

    def _exponential(self, time: Fraction, bits: int) -> Rows:
        """Return rows of e^(At) beside its integral times B, in balls."""
        from flint import arb_mat

        if not self.plant.A:
            return []
        if (time, bits) not in self._exponentials:
            if len(self._exponentials) >= _KEPT_EXPONENTIALS:
                self._exponentials.clear()
            E = arb_mat(self._joint * as_fmpq(time)).exp().tolist()
            self._exponentials[time, bits] = E[: len(self.plant.A)]
        return self._exponentials[time, bits]

    @cached_property
    def _joint(self) -> Any:
        """A beside B, above zeros (flint `fmpq_mat`)."""
        from flint import fmpq_mat

        n, inputs = len(self.plant.A), len(self.plant.D)
        rows = [[*a, *b] for a, b in zip(self.plant.A, self.plant.B, strict=True)]
        return fmpq_mat([*rows, *([[0] * (n + inputs)] * inputs)])


def _combined(weights: Sequence[Any], rows: Rows, width: int) -> list[Any]:
    """Return a sum of rows with weights."""
    product = _matrix([list(weights)], len(rows)) * _matrix(rows, width)
    return list(product.tolist()[0]) if rows else [0] * width


def _matrix(rows: Rows, width: int) -> Any:
    """Return rows, none perhaps, as a matrix of balls (flint `arb_mat`)."""
    from flint import arb_mat

    return arb_mat(len(rows), width, [entry for row in rows for entry in row])
