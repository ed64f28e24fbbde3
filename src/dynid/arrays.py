"""Types of arrays, norms of inverses, and errors where numbers leave the range of double precision."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError, NumericalError

Array: TypeAlias = NDArray[np.float64]
"""An array of real numbers in double precision."""

ComplexArray: TypeAlias = NDArray[np.complex128]
"""An array of complex numbers in double precision."""

REMEDY = "Check the units, and bring the values nearer to each other and to 1."


@contextmanager
def guarded(
    what: str, kind: type[DynidError] = NumericalError, *, remedy: str = REMEDY, names: Iterable[str] = ()
) -> Iterator[None]:
    """Turn overflow, invalid operations and failed factorisations into an error of dynid; also a decorator.

    Underflow is ignored. Computations in threads of the linear algebra library raise nothing: results of
    products are checked with `finite` before they are factorised.

    `what` is computed, the subject of the message; `kind` is the error, with its remedy and names.
    """
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise", under="ignore"):
            yield
    except (FloatingPointError, OverflowError, np.linalg.LinAlgError) as error:
        raise kind(f"{what} is beyond double precision", remedy=remedy, names=names) from error
    except NumericalError as error:
        error.names = error.names or tuple(names)  # where it was raised the scene is unknown
        raise


def finite(what: str, *arrays: np.ndarray, remedy: str = REMEDY) -> None:
    """Raise a `NumericalError` unless all numbers are finite."""
    if not all(np.isfinite(array).all() for array in arrays):
        raise NumericalError(f"{what} is beyond double precision", remedy=remedy)


#: Steps of the estimate of a norm, and rows up to which it is the norm itself.
_NORM_STEPS, _NORM_ROWS = 5, 4


def norm_of_inverse(
    size: int, solve: Callable[[Array], Array], solve_transposed: Callable[[Array], Array] | None = None
) -> float:
    """Return a lower bound of the 1-norm of an inverse, seldom far below (N. J. Higham, ACM TOMS 14, 1988).

    It takes some five solutions and no random numbers, and is exact up to four rows.

    `size`: rows of the matrix; `solve`, `solve_transposed`: solve with it and its transpose for a vector;
    default: the matrix is symmetric.
    """
    if size <= _NORM_ROWS:
        return float(np.linalg.norm(solve(np.eye(size)), 1))
    transposed = solve_transposed or solve
    image = solve(np.full(size, 1 / size))
    norm, signs, column = np.abs(image).sum(), np.where(image < 0, -1.0, 1.0), -1
    for _ in range(_NORM_STEPS):
        slope = np.abs(transposed(signs))
        steepest = int(slope.argmax())
        if column >= 0 and slope[steepest] <= slope[column]:
            break
        column, unit = steepest, np.zeros(size)
        unit[column] = 1.0
        image = solve(unit)
        before, norm = norm, np.maximum(norm, np.abs(image).sum())
        new_signs = np.where(image < 0, -1.0, 1.0)
        if norm <= before or np.array_equal(new_signs, signs):
            break
        signs = new_signs
    alternating = (1 + np.arange(size) / (size - 1)) * (-1.0) ** np.arange(size)
    return float(np.maximum(norm, 2 * np.abs(solve(alternating)).sum() / (3 * size)))
