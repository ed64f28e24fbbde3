"""Linear time-invariant systems in state-space form, and their matrices as functions of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array
from dynid.errors import UsageError


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear system ``x' = A x + B u``, ``y = C x + D u + D1 u' + D2 u'' + …``."""

    #: Matrices (states x states, states x inputs, outputs x states, outputs x inputs), SI units.
    A: Array
    B: Array
    C: Array
    D: Array
    #: The further feedthrough matrices D1, D2, … of an improper system, D-shaped, on u', u'', ….
    higher: tuple[Array, ...] = ()
    #: Names; default: ``u1``, ``y1``, ``x1``, ….
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    #: SI units by name's order; default: none.
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("A", "B", "C", "D"):
            object.__setattr__(self, name, _matrix(name, getattr(self, name)))
        higher = tuple(_matrix(f"D{order}", D) for order, D in enumerate(self.higher, 1))
        object.__setattr__(self, "higher", higher)
        n, m, p = len(self.A), self.B.shape[1], len(self.C)
        shapes = [("A", self.A, (n, n)), ("B", self.B, (n, m)), ("C", self.C, (p, n)), ("D", self.D, (p, m))]
        shapes += [(f"D{order}", D, (p, m)) for order, D in enumerate(higher, 1)]
        for name, matrix, shape in shapes:
            if matrix.shape != shape:
                raise UsageError(f"{name} is {matrix.shape}, but must be {shape} to fit the other matrices")
        for name, count, letter in (("inputs", m, "u"), ("outputs", p, "y"), ("states", n, "x")):
            names = tuple(getattr(self, name)) or tuple(f"{letter}{k}" for k in range(1, count + 1))
            if len(names) != count:
                raise UsageError(f"the {name} need one name each: {count}, not {len(names)}")
            object.__setattr__(self, name, names)
        for name, count in (("input_units", m), ("output_units", p)):
            units = tuple(getattr(self, name)) or ("",) * count
            if len(units) != count:
                raise UsageError(f"the number of {name} must be {count}, not {len(units)}")
            object.__setattr__(self, name, units)

    def with_inputs(self, names: Sequence[str]) -> StateSpace:
        """Return the system with these inputs; a name that repeats is several inputs that act alike."""
        columns = [self.inputs.index(name) for name in names]
        return replace(
            self,
            B=self.B[:, columns],
            D=self.D[:, columns],
            higher=tuple(matrix[:, columns] for matrix in self.higher),
            inputs=tuple(names),
            input_units=tuple(self.input_units[column] for column in columns),
        )


def _matrix(name: str, values: ArrayLike) -> Array:
    matrix = np.array(values, dtype=float)
    if matrix.ndim != 2:
        raise UsageError(f"{name} must be a matrix, but has {matrix.ndim} axes")
    if not np.all(np.isfinite(matrix)):
        raise UsageError(f"{name} has entries that are not finite numbers")
    matrix.setflags(write=False)
    return matrix


class Matrices(NamedTuple):
    """``x' = A x + B u``, ``y = C x + sum_k D[k] d^k u / dt^k`` at some values of the parameters."""

    #: Matrices (n x n, n x loads, channels x n, orders x channels x loads), SI.
    A: Array
    B: Array
    C: Array
    D: Array
    #: Their derivatives by the values of the parameters (p x the shape of the matrix).
    A_slopes: Array
    B_slopes: Array
    C_slopes: Array
    D_slopes: Array


class ParametricSystem(NamedTuple):
    """``x' = A x + b u``, ``y = c x + d u`` of one input and one output, with derivatives (p x …)."""

    A: Array
    b: Array
    c: Array
    d: float
    A_slopes: Array
    b_slopes: Array
    c_slopes: Array
    d_slopes: Array


def single(matrices: Matrices, channel: int, load: int) -> ParametricSystem:
    """Return the system of one channel and load, with integrators where derivatives of the input act.

    An input u that acts by its derivatives up to the k-th is a state with k - 1 others, driven by the k-th
    derivative: the zeros stay the same.
    """
    A, b, c = matrices.A, matrices.B[:, load], matrices.C[channel]
    direct, changes = matrices.D[:, channel, load], matrices.D_slopes[:, :, channel, load]
    p, n = len(matrices.A_slopes), len(A)
    k = max((order for order in range(len(direct)) if direct[order]), default=0)
    if not k:
        return ParametricSystem(
            A, b, c, float(direct[0]) if len(direct) else 0.0, matrices.A_slopes,
            matrices.B_slopes[:, :, load], matrices.C_slopes[:, channel],
            changes[:, 0] if len(direct) else np.zeros(p),
        )  # fmt: skip
    wide, moved = np.zeros((n + k, n + k)), np.zeros((p, n + k, n + k))
    wide[:n, :n], wide[:n, n] = A, b
    wide[n : n + k - 1, n + 1 :] = np.eye(k - 1)
    moved[:, :n, :n], moved[:, :n, n] = matrices.A_slopes, matrices.B_slopes[:, :, load]
    last = np.zeros(n + k)
    last[-1] = 1.0
    rows = np.concatenate([matrices.C_slopes[:, channel], changes[:, :k]], axis=1)
    return ParametricSystem(
        wide, last, np.concatenate([c, direct[:k]]), float(direct[k]), moved, np.zeros((p, n + k)), rows,
        changes[:, k],
    )  # fmt: skip
