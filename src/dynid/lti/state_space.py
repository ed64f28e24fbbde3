"""Linear time-invariant systems in state-space form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import UsageError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear system ``x' = A x + B u``, ``y = C x + D u + D1 u' + D2 u'' + …``.

    Parameters
    ----------
    A, B, C, D
        Matrices (states x states, states x inputs, outputs x states, outputs x inputs), SI units.
    higher
        The further feedthrough matrices D1, D2, … of an improper system, D-shaped, on u', u'', ….
    inputs, outputs, states
        Names; absent: ``u1``, ``y1``, ``x1``, ….
    input_units, output_units
        SI units by name's order; absent: none.

    Raises
    ------
    UsageError
        If shapes do not fit together or an entry is not finite.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    higher: tuple[Array, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("A", "B", "C", "D"):
            object.__setattr__(self, name, _matrix(name, getattr(self, name)))
        higher = tuple(_matrix(f"D{order}", D) for order, D in enumerate(self.higher, 1))
        object.__setattr__(self, "higher", higher)
        n, m, p = len(self.A), self.B.shape[1], len(self.C)
        wanted = [("A", self.A, (n, n)), ("B", self.B, (n, m)), ("C", self.C, (p, n)), ("D", self.D, (p, m))]
        wanted += [(f"D{order}", D, (p, m)) for order, D in enumerate(higher, 1)]
        for name, matrix, shape in wanted:
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


def _matrix(name: str, values: ArrayLike) -> Array:
    matrix = np.array(values, dtype=float)
    if matrix.ndim != 2:
        raise UsageError(f"{name} must be a matrix, but has {matrix.ndim} axes")
    if not np.all(np.isfinite(matrix)):
        raise UsageError(f"{name} has entries that are not finite numbers")
    matrix.setflags(write=False)
    return matrix
