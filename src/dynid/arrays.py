"""Types of arrays, and errors where numbers leave the range of double precision."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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
